//! `eit recover`: writes the intact parts of a damaged recording to a new one.

use super::{Answer, check_ending};
use crate::cli::RecoverArgs;
use crate::error::CliError;
use eit_hw::HwError;
use eit_hw::capture::{Damage, Recovered, recover};
use serde_json::json;
use std::io::ErrorKind::StorageFull;

/// Writes the new recording and reports what is missing.
pub(crate) fn run(args: &RecoverArgs) -> Result<Answer, CliError> {
    check_ending(&args.out, &["mcap"])?;
    if args.out.exists() {
        return Err(CliError::input(format!(
            "{}: exists, and a recording is never written over: name another file",
            args.out.display()
        )));
    }
    let recovered = recover(&args.input, &args.out).map_err(|error| match error {
        // a place where no file can be created is invalid input, unlike a full disk
        HwError::Write { ref source, .. } if source.kind() != StorageFull => {
            CliError::input(error.to_string())
        }
        HwError::Read { .. } if args.out.exists() => {
            let what = "it cannot be read any further, and what came before is in";
            CliError::Failure(format!("{error}; {what} {}", args.out.display()))
        }
        _ => error.into(),
    })?;
    let Recovered { frames, messages, attachments, bad_attachments, damage } = recovered;
    let Damage {
        unfinished,
        truncated_bytes,
        skipped_bytes,
        bad_chunks,
        mended_chunks,
        bad_messages,
    } = damage;
    let place = args.out.display();
    let mut text = format!(
        "{frames} frames, {messages} other messages and {attachments} attachments in {place}"
    );
    for (count, what) in [
        (bad_chunks as u64, "damaged chunk(s) left out"),
        (bad_messages as u64, "message(s) that cannot be read left out"),
        (bad_attachments, "damaged attachment(s) left out"),
        (skipped_bytes, "byte(s) between whole records left out"),
        (truncated_bytes, "byte(s) at the end left out: no whole record"),
        (mended_chunks as u64, "chunk(s) had a damaged head and are whole"),
    ] {
        if count > 0 {
            text += &format!("\n{count} {what}");
        }
    }
    text += match (damage.is_any() || bad_attachments > 0, unfinished) {
        (false, false) => "\nnothing was wrong",
        (false, true) => "\nit was not finished, and nothing else was wrong",
        (true, _) => "",
    };
    let json = json!({
        "file": place.to_string(),
        "frames": frames,
        "messages": messages,
        "attachments": attachments,
        "bad_attachments": bad_attachments,
        "bad_chunks": bad_chunks,
        "mended_chunks": mended_chunks,
        "bad_messages": bad_messages,
        "skipped_bytes": skipped_bytes,
        "truncated_bytes": truncated_bytes,
        "unfinished": unfinished,
    });
    Ok(Answer { text, json })
}
