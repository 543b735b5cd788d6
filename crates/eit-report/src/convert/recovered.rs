//! What is intact of a damaged recording.

use crate::Answer;
use crate::error::ReportError;
use crate::settings::ConvertSettings;
use eit_hw::HwError;
use eit_hw::capture::{Recovered, recover};
use serde_json::json;

/// Writes the new recording and reports what is missing.
pub(super) fn run(settings: &ConvertSettings) -> Result<Answer, ReportError> {
    let out = settings.out.display();
    let found = recover(&settings.input, &settings.out).map_err(|error| match error {
        // a place where no file can be created is invalid input, unlike a full disk
        HwError::Write { ref source, .. } if source.kind() != std::io::ErrorKind::StorageFull => {
            ReportError::input(error.to_string())
        }
        HwError::Read { .. } if settings.out.exists() => ReportError::Failure(format!(
            "{error}; it cannot be read any further, and everything before is in {out}"
        )),
        _ => error.into(),
    })?;
    check_any_frame(settings, &found)?;
    let damage = found.damage;
    let json = json!({
        "file": out.to_string(),
        "frames": found.frames,
        "messages": found.messages,
        "unreadable": found.unreadable,
        "other_set_ups": found.other_set_ups,
        "attachments": found.attachments,
        "bad_attachments": found.bad_attachments,
        "bad_chunks": damage.bad_chunks,
        "mended_chunks": damage.mended_chunks,
        "bad_messages": damage.bad_messages,
        "skipped_bytes": damage.skipped_bytes,
        "truncated_bytes": damage.truncated_bytes,
        "missing_parts": damage.missing_parts,
        "unfinished": damage.unfinished,
    });
    Ok(Answer { text: text(&found, settings), json })
}

/// Counts what the new recording holds, and what is missing.
fn text(found: &Recovered, settings: &ConvertSettings) -> String {
    let &Recovered { frames, messages, attachments, damage, .. } = found;
    let out = settings.out.display();
    let mut text = format!(
        "{frames} frames, {messages} other messages and {attachments} attachments in {out}"
    );
    for (count, what) in [
        (damage.bad_chunks as u64, "damaged chunk(s) skipped"),
        (damage.bad_messages as u64, "unreadable message(s), schema(s) or channel(s) skipped"),
        (
            found.unreadable,
            "message(s) are not what their topic holds: copied unchanged, but every reader skips them",
        ),
        (
            found.other_set_ups,
            "frame(s) or session(s) have other measurements than the first: copied unchanged, but no \
             command reads such a mix",
        ),
        (found.bad_attachments, "damaged attachment(s) skipped"),
        (damage.skipped_bytes, "byte(s) between complete records skipped"),
        (damage.truncated_bytes, "byte(s) at the end skipped: not a complete record"),
        (damage.missing_parts as u64, "part(s) of the recording are missing"),
        (damage.mended_chunks as u64, "chunk(s) had a damaged header and are complete"),
    ] {
        if count > 0 {
            text += &format!("\n{count} {what}");
        }
    }
    let problems = found.bad_attachments + found.unreadable + found.other_set_ups;
    text + match (problems > 0 || damage.is_any(), damage.unfinished) {
        (false, false) => "\nno damage found",
        (false, true) => "\nthe recording was not finished; no other damage found",
        (true, _) => "",
    }
}

/// Fails for a recording of ours without an intact frame. Notes, attachments and the like are kept in the new
/// recording; one with nothing but what instrument it was would only be taken for a success.
fn check_any_frame(settings: &ConvertSettings, recovered: &Recovered) -> Result<(), ReportError> {
    let &Recovered { frames, messages, sessions, unreadable, attachments, .. } = recovered;
    if frames > 0 || sessions == 0 {
        return Ok(());
    }
    let (from, to) = (settings.input.display(), settings.out.display());
    if messages + unreadable + attachments == sessions {
        std::fs::remove_file(&settings.out)
            .map_err(|error| ReportError::at(&settings.out, error))?;
        return Err(ReportError::Failure(format!(
            "{from}: no frame is intact; {to} is not written"
        )));
    }
    let rest = messages + unreadable;
    Err(ReportError::Failure(format!(
        "{from}: no frame is intact; {to} holds the rest: {rest} other messages and {attachments} attachments"
    )))
}
