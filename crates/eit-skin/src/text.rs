//! Describes events of an instrument, and makes text from other sources safe to print.

use eit_hw::driver::Event;
use std::borrow::Cow;
use std::fmt;

/// Makes text safe for a terminal or a page: text of devices, recordings, scenes and file names may
/// contain characters that move the cursor, change the window title or reverse the text direction.
/// Line ends and tabs are kept.
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_hostile) {
        return Cow::Borrowed(text);
    }
    Cow::Owned(text.replace(is_hostile, "?"))
}

/// Makes JSON safe for a terminal: escapes what [`printable`] replaces, so that programs read the original
/// text.
pub fn printable_json(json: &str) -> Cow<'_, str> {
    if !json.contains(is_hostile) {
        return Cow::Borrowed(json);
    }
    let mut escaped = String::with_capacity(json.len());
    for character in json.chars() {
        match is_hostile(character) {
            // such characters only occur in strings, and all are in the basic plane
            true => escaped += &format!("\\u{:04x}", u32::from(character)),
            false => escaped.push(character),
        }
    }
    Cow::Owned(escaped)
}

fn is_hostile(character: char) -> bool {
    let turns = matches!(character, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || character.is_control() && !matches!(character, '\n' | '\t')
}

/// Returns a number of things.
///
/// ```
/// use eit_skin::text::counted;
///
/// assert_eq!(counted(1, "touch", "touches"), "1 touch");
/// assert_eq!(counted(2_u64, "touch", "touches"), "2 touches");
/// ```
pub fn counted<N: fmt::Display + PartialEq + From<u8>>(count: N, one: &str, many: &str) -> String {
    format!("{count} {}", if count == N::from(1) { one } else { many })
}

/// Describes an event; `None` for a frame.
pub fn event_text(event: &Event) -> Option<String> {
    Some(match event {
        Event::Frame(_) => return None,
        Event::Gap { frames: 1 } => "1 frame was lost".to_owned(),
        Event::Gap { frames } => format!("{frames} frames were lost"),
        Event::Skipped { frames: 1 } => {
            "1 frame was skipped: it came faster than it was taken".to_owned()
        }
        Event::Skipped { frames } => {
            format!("{frames} frames were skipped: they came faster than they were taken")
        }
        // a single line, whatever it contains
        Event::Notice(text) => printable(text).replace('\n', "?"),
        Event::Silent { for_s, bytes: 0 } => {
            format!("no frame for {for_s:.1} s: check its power and cable")
        }
        Event::Silent { for_s, bytes } => format!(
            "no frame for {for_s:.1} s, although {bytes} bytes came: it sends something else than before, or the \
             line is disturbed"
        ),
        Event::Disconnected { reason } => format!("disconnected: {reason}"),
        Event::Reconnected { epoch } => {
            format!("reconnected; epoch {epoch}: earlier reference frames are invalid")
        }
        Event::Reference { sequences, .. } => {
            format!("the reference is that of the recording: {} frames", sequences.len())
        }
        other => format!("{other:?}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_a_cursor_is_not_printed() {
        let hostile = "sk\u{1b}]0;OWNED\u{7}\u{1b}[31min\rFAKE \u{9b}2J \u{202e}x";
        assert_eq!(printable(hostile), "sk?]0;OWNED??[31min?FAKE ?2J ?x");
        assert_eq!(printable("1 \u{b5}V\n\tok"), "1 \u{b5}V\n\tok");
        let json = serde_json::json!({ "name": hostile }).to_string();
        let safe = printable_json(&json);
        assert!(!safe.contains(is_hostile), "{safe:?}");
        let read: serde_json::Value = serde_json::from_str(&safe).unwrap_or_default();
        assert_eq!(read["name"], hostile);
    }
}
