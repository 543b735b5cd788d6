//! `eit body`: many patches as one list of touches.

use super::publish;
use crate::cli::BodyArgs;
use crate::commands::prelude::*;
#[cfg(feature = "foxglove")]
use eit_publish::FoxgloveBody;
use eit_publish::body::{Body, BodyNews, BodySettings};
use eit_skin::text::printable_json;
use std::io::{ErrorKind, Write as _};

/// Joins patches until Ctrl-C, the end of `--seconds` or a closed pipe.
pub(super) fn run(args: &BodyArgs) -> Result<Answer, CliError> {
    let (mut until, is_json) = (Until::new(args.seconds)?, terminal::flags().is_json);
    let settings = BodySettings::load(&args.body)?;
    #[cfg(feature = "foxglove")]
    let mut shown = match &args.foxglove {
        Some(place) => Some(
            FoxgloveBody::new(place, &settings)
                .map_err(|e| CliError::from(e).within("--foxglove"))?,
        ),
        None => None,
    };
    #[cfg(feature = "foxglove")]
    if let Some(shown) = &shown {
        eprintln!("eit: Foxglove: open a connection to ws://{}", shown.address());
    }
    #[cfg(not(feature = "foxglove"))]
    if args.foxglove.is_some() {
        return Err(super::built_without("foxglove", "foxglove").within("--foxglove"));
    }
    let mut body = Body::open(&settings)?;
    until.restart();
    let mut lists = 0_u64;
    let mut is_open = is_json || print(&body.start_line(&settings))?;
    while is_open && !until.is_over() {
        let Some(news) = body.next(SHUTDOWN_WAIT) else { continue };
        #[cfg(feature = "foxglove")]
        if let Some(shown) = &mut shown {
            shown.show(&body, &news);
        }
        lists += u64::from(matches!(news, BodyNews::Touches(_)));
        is_open = is_json || print(&body.line(&news))?;
    }
    let answer = summary(&body, lists, until.start.elapsed());
    if is_open && !is_json {
        print(&body.end_line(lists))?;
    }
    Ok(publish::moved(answer, !is_json))
}

/// Prints a line; whether there is still a reader.
fn print(line: &Value) -> Result<bool, CliError> {
    let text = line.to_string();
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", printable_json(&text)).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(CliError::failure(format!("cannot write a line: {error}"))),
    }
}

fn summary(body: &Body, lists: u64, time: Duration) -> Answer {
    let patches = body.patches();
    let received: u64 = patches.iter().map(|patch| patch.received).sum();
    let lost: u64 = patches.iter().map(|patch| patch.lost).sum();
    let silent: Vec<&str> =
        patches.iter().filter(|patch| patch.silent).map(|patch| patch.name.as_str()).collect();
    let [overflowed, refused] = body.dropped();
    let latency = body.latency();
    let milliseconds = |share| latency?.quantile_s(share).map(|seconds| 1e3 * seconds);
    let mut text = format!(
        "{} patches: {received} messages, {lost} lost, {lists} lists in {:.1} s",
        patches.len(),
        time.as_secs_f64()
    );
    if let (Some(median), Some(late)) = (milliseconds(0.5), milliseconds(0.99)) {
        text += &format!("\nlatency: median {median:.2} ms, 99 % {late:.2} ms");
    }
    if latency.is_none() {
        text += "\nlatency: not known, because the clocks of two computers differ";
    }
    if !silent.is_empty() {
        text += &format!("\nsilent: {}", silent.join(", "));
    }
    if overflowed + refused > 0 {
        text += &format!("\ndropped here: {overflowed} messages, {refused} lists");
    }
    let of_patch = |patch: &eit_publish::ros::PatchState| {
        let (name, silent) = (&patch.name, patch.silent);
        json!({ "name": name, "silent": silent, "received": patch.received, "lost": patch.lost })
    };
    let json = json!({
        "seconds": time.as_secs_f64(),
        "lists": lists,
        "received": received,
        "lost": lost,
        "dropped_messages": overflowed,
        "refused_lists": refused,
        "latency_ms": { "median": milliseconds(0.5), "p99": milliseconds(0.99) },
        "patches": patches.iter().map(of_patch).collect::<Vec<_>>(),
    });
    Answer { text, json }
}
