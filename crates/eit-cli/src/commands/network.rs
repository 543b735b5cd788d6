//! `--zenoh` and `--foxglove`, which are behind cargo features of the same names.

use crate::cli::NetworkArgs;
use crate::commands::prelude::*;
use eit_publish::Publisher;
#[cfg(feature = "foxglove")]
use eit_publish::{FoxgloveSettings, FoxgloveSink};
#[cfg(feature = "zenoh")]
use eit_publish::{SessionSettings, ZenohSettings, ZenohSink};

/// Whether any of them is asked for.
pub(super) fn is_wanted(args: &NetworkArgs) -> bool {
    args.zenoh.is_some() || args.foxglove.is_some() || args.foxglove_record.is_some()
}

/// Adds the sinks that are asked for.
pub(super) fn open(args: &NetworkArgs, publisher: Publisher) -> Result<Publisher, CliError> {
    #[cfg(not(feature = "zenoh"))]
    if args.zenoh.is_some() {
        return Err(super::built_without("zenoh", "zenoh").within("--zenoh"));
    }
    #[cfg(not(feature = "foxglove"))]
    if args.foxglove.is_some() || args.foxglove_record.is_some() {
        return Err(super::built_without("foxglove", "foxglove").within("--foxglove"));
    }
    #[cfg(feature = "zenoh")]
    let publisher = open_zenoh(args, publisher)?;
    #[cfg(feature = "foxglove")]
    let publisher = open_foxglove(args, publisher)?;
    Ok(publisher)
}

#[cfg(feature = "zenoh")]
fn open_zenoh(args: &NetworkArgs, publisher: Publisher) -> Result<Publisher, CliError> {
    let Some(topic) = &args.zenoh else { return Ok(publisher) };
    let mut settings = ZenohSettings::new(topic);
    settings.frame_id.clone_from(&args.frame_id);
    settings.domain = domain(args.ros_domain)?;
    settings.session = SessionSettings {
        connect: args.session.zenoh_connect.clone(),
        listen: args.session.zenoh_listen.clone(),
        config: args.session.zenoh_config.clone(),
        is_hub: false,
    };
    if args.zenoh_every_frame {
        settings.change = None;
    }
    let sink = ZenohSink::new(&settings).map_err(|e| CliError::from(e).within("--zenoh"))?;
    Ok(publisher.with_zenoh(sink))
}

/// The domain given, else that of the environment.
#[cfg(feature = "zenoh")]
fn domain(given: Option<u32>) -> Result<u32, CliError> {
    match (given, std::env::var("ROS_DOMAIN_ID")) {
        (Some(domain), _) => Ok(domain),
        (None, Ok(text)) if !text.is_empty() => text.parse().map_err(|_| {
            CliError::input(format!("ROS_DOMAIN_ID = {text}: it must be a whole number"))
        }),
        _ => Ok(0),
    }
}

#[cfg(feature = "foxglove")]
fn open_foxglove(args: &NetworkArgs, publisher: Publisher) -> Result<Publisher, CliError> {
    if args.foxglove.is_none() && args.foxglove_record.is_none() {
        return Ok(publisher);
    }
    let settings = FoxgloveSettings {
        server: args.foxglove.clone(),
        recording: args.foxglove_record.clone(),
        frame_id: args.frame_id.clone(),
        ..FoxgloveSettings::default()
    };
    let sink = FoxgloveSink::new(&settings).map_err(|e| CliError::from(e).within("--foxglove"))?;
    if let Some(address) = sink.address() {
        eprintln!("eit: Foxglove: open a connection to ws://{address}");
    }
    Ok(publisher.with_foxglove(sink))
}

/// Says once that another program publishes the same topics; `None` if it was said, or there is none.
#[cfg_attr(
    not(feature = "zenoh"),
    allow(unused_variables, clippy::ptr_arg, reason = "there is no network")
)]
pub(super) fn rival(publisher: &Publisher, is_told: &mut bool) -> Option<String> {
    #[cfg(feature = "zenoh")]
    if let Some(sink) = publisher.zenoh().iter().find(|sink| sink.rivals() > 0)
        && !std::mem::replace(is_told, true)
    {
        let topic = sink.topic();
        return Some(format!("--zenoh {topic}: another program publishes these topics, too"));
    }
    None
}

/// Reports what was dropped.
#[cfg_attr(
    not(any(feature = "zenoh", feature = "foxglove")),
    allow(unused_variables, reason = "nothing to report")
)]
pub(super) fn report(publisher: &Publisher) {
    #[cfg(feature = "zenoh")]
    for sink in publisher.zenoh() {
        let dropped = sink.statistics();
        let (sent, refused) = sink.sent();
        if dropped.dropped_frames > 0 || refused > 0 {
            let (topic, all) = (sink.topic(), sent + refused);
            eprintln!(
                "eit: note: --zenoh {topic}: {} of {} frames were dropped because sending was slower, and zenoh \
                 refused {refused} of {all} messages",
                dropped.dropped_frames, dropped.frames
            );
        }
    }
    #[cfg(feature = "foxglove")]
    if let Some(sink) = publisher.foxglove() {
        let dropped = sink.statistics();
        if dropped.dropped_frames > 0 {
            eprintln!(
                "eit: note: --foxglove: {} of {} frames were dropped because showing was slower",
                dropped.dropped_frames, dropped.frames
            );
        }
    }
}
