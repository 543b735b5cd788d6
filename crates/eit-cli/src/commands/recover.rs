//! `eit recover`: writes the intact parts of a damaged recording to a new one.

use super::{Answer, check_ending};
use crate::cli::RecoverArgs;
use crate::error::CliError;
use eit_hw::HwError;
use eit_hw::capture::{Damage, PartFile, Recovered, check_new, recover};
use eit_report::output;
use serde_json::json;
use std::io::ErrorKind::StorageFull;

/// Writes the new recording and reports what is missing.
pub(crate) fn run(args: &RecoverArgs) -> Result<Answer, CliError> {
    check_ending(&args.out, &["mcap"])?;
    check_new(&args.out)?;
    output::remember(PartFile::part_of(&args.out));
    let recovered = recover(&args.input, &args.out).map_err(|error| match error {
        // a place where no file can be created is invalid input, unlike a full disk
        HwError::Write { ref source, .. } if source.kind() != StorageFull => {
            CliError::input(error.to_string())
        }
        HwError::Read { .. } if args.out.exists() => {
            let what = "it cannot be read any further, and everything before is in";
            CliError::Failure(format!("{error}; {what} {}", args.out.display()))
        }
        _ => error.into(),
    })?;
    check_any_frame(args, &recovered)?;
    let Recovered {
        frames,
        messages,
        unreadable,
        other_set_ups,
        attachments,
        bad_attachments,
        damage,
        ..
    } = recovered;
    let Damage {
        unfinished,
        truncated_bytes,
        skipped_bytes,
        bad_chunks,
        mended_chunks,
        bad_messages,
        missing_parts,
    } = damage;
    let place = args.out.display();
    let mut text = format!(
        "{frames} frames, {messages} other messages and {attachments} attachments in {place}"
    );
    for (count, what) in [
        (bad_chunks as u64, "damaged chunk(s) skipped"),
        (bad_messages as u64, "unreadable message(s), schema(s) or channel(s) skipped"),
        (
            unreadable,
            "message(s) are not what their topic holds: copied unchanged, but every reader skips them",
        ),
        (
            other_set_ups,
            "frame(s) or session(s) have other measurements than the first: copied unchanged, but no \
          command reads such a mix",
        ),
        (bad_attachments, "damaged attachment(s) skipped"),
        (skipped_bytes, "byte(s) between complete records skipped"),
        (truncated_bytes, "byte(s) at the end skipped: not a complete record"),
        (missing_parts as u64, "part(s) of the recording are missing"),
        (mended_chunks as u64, "chunk(s) had a damaged header and are complete"),
    ] {
        if count > 0 {
            text += &format!("\n{count} {what}");
        }
    }
    let is_sound = bad_attachments + unreadable + other_set_ups == 0 && !damage.is_any();
    text += match (!is_sound, unfinished) {
        (false, false) => "\nno damage found",
        (false, true) => "\nthe recording was not finished; no other damage found",
        (true, _) => "",
    };
    let json = json!({
        "file": place.to_string(),
        "frames": frames,
        "messages": messages,
        "unreadable": unreadable,
        "other_set_ups": other_set_ups,
        "attachments": attachments,
        "bad_attachments": bad_attachments,
        "bad_chunks": bad_chunks,
        "mended_chunks": mended_chunks,
        "bad_messages": bad_messages,
        "skipped_bytes": skipped_bytes,
        "truncated_bytes": truncated_bytes,
        "missing_parts": missing_parts,
        "unfinished": unfinished,
    });
    Ok(Answer { text, json })
}

/// Rejects a recording of this program without an intact frame. Notes, attachments and the like are
/// kept in the new recording; one that holds the session alone would look like a success.
fn check_any_frame(args: &RecoverArgs, recovered: &Recovered) -> Result<(), CliError> {
    let &Recovered { frames, messages, sessions, unreadable, attachments, .. } = recovered;
    if frames > 0 || sessions == 0 {
        return Ok(());
    }
    let (from, to) = (args.input.display(), args.out.display());
    if messages + unreadable + attachments == sessions {
        std::fs::remove_file(&args.out).map_err(|error| CliError::at(&args.out, error))?;
        return Err(CliError::Failure(format!("{from}: no frame is intact; {to} is not written")));
    }
    let rest = messages + unreadable;
    Err(CliError::Failure(format!(
        "{from}: no frame is intact; {to} holds the rest: {rest} other messages and {attachments} attachments"
    )))
}
