//! Events of an instrument in words.

use eit_hw::driver::Event;

/// An event in words; `None` for a frame.
pub fn event_words(event: &Event) -> Option<String> {
    Some(match event {
        Event::Frame(_) => return None,
        Event::Gap { frames } => format!("{frames} frames were lost"),
        Event::Notice(text) => text.clone(),
        Event::Stalled { for_s } => format!("no frame has come for {for_s:.1} s"),
        Event::Disconnected { reason } => format!("disconnected: {reason}"),
        Event::Reconnected { epoch } => {
            format!("connected again; epoch {epoch}: an old reference frame does not hold")
        }
        other => format!("{other:?}"),
    })
}
