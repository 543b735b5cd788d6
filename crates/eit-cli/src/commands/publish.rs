//! Publishes touches to other programs, in addition to the output of `eit live` and `eit replay`.

use super::network;
use crate::cli::PublishArgs;
use crate::commands::prelude::*;
use eit_picture::SkinDrawing;
use eit_publish::{Publisher, SkinImage, SkinShape, Start, UdpSink, WebServer};
use eit_skin::live::{LiveModel, TouchFrame};
use eit_skin::text::printable;

/// Opens the requested outputs; `None` if there are none. The page can record if frames are those of an instrument.
pub(super) fn open(args: &PublishArgs, can_record: bool) -> Result<Option<Publisher>, CliError> {
    if args.json_lines && terminal::flags().is_json {
        let message = "--json-lines and --json both need stdout: use one";
        return Err(CliError::input(message));
    }
    let is_networked = network::is_wanted(&args.network);
    if !args.json_lines && args.udp.is_empty() && args.page.web.is_none() && !is_networked {
        return Ok(None);
    }
    let mut publisher = network::open(&args.network, Publisher::new())?;
    for address in &args.udp {
        let sink = UdpSink::new(address).map_err(|e| CliError::from(e).within("--udp"))?;
        publisher = publisher.with_udp(sink);
    }
    if let Some(address) = &args.page.web {
        publisher = open_page(address, publisher, can_record)?;
    }
    if args.json_lines {
        let out = std::io::stdout();
        publisher = match args.latest {
            true => publisher.with_latest_lines(out)?,
            false => publisher.with_lines(out)?,
        };
    }
    Ok(Some(publisher))
}

/// Serves the page, and prints its address.
pub(super) fn open_page(
    address: &str,
    publisher: Publisher,
    can_record: bool,
) -> Result<Publisher, CliError> {
    let server = match can_record {
        true => WebServer::with_recording(address),
        false => WebServer::new(address),
    };
    let server = server.map_err(|e| CliError::from(e).within("--web"))?;
    eprintln!("eit: live page at {}", server.url());
    Ok(publisher.with_web(server))
}

/// Announces a skin and the instrument or recording whose frames follow.
pub(super) fn start(
    publisher: &mut Publisher,
    model: &LiveModel,
    instrument: &str,
    is_live: bool,
) -> Result<(), CliError> {
    if publisher.takes_images() {
        publisher.skin(&shape(model)?)?;
    }
    let skin = model.skin();
    Ok(publisher.start(&Start {
        skin: &skin.name,
        instrument,
        electrodes: skin.mesh.electrodes().len(),
        reference_frames: model.reference_frames,
        is_live,
    })?)
}

/// Publishes the image of a frame, if there is one and it is wanted.
pub(super) fn image(publisher: &mut Publisher, shown: &TouchFrame<'_>) -> Result<(), CliError> {
    let Some(images) = shown.images else { return Ok(()) };
    if !publisher.wants_image() {
        return Ok(());
    }
    let raster = images.raster();
    let change = raster.image_from_pixels(images.pixels())?;
    let before_net = images.raw().map(|raw| raster.image_from_pixels(raw)).transpose()?;
    Ok(publisher.image(SkinImage {
        change_s: change.view(),
        before_net_s: before_net.as_ref().map(|raw| raw.view()),
        faintest_s: shown.level_s,
        gap: images.state().gap,
    })?)
}

/// Converts the skin for drawing on the page.
fn shape(model: &LiveModel) -> Result<SkinShape, CliError> {
    let raster = model.linearised.raster(&mut Progress::silent())?;
    let mut drawing = SkinDrawing::from_raster(&model.skin().mesh, raster);
    drawing.electrodes.sort_by_key(|electrode| electrode.number);
    let electrodes = drawing.electrodes.into_iter();
    let extent = drawing.extent;
    Ok(SkinShape {
        name: model.skin().name.clone(),
        outlines_m: drawing.outlines_m,
        electrodes_m: electrodes.map(|electrode| electrode.rim_m).collect(),
        extent_m: [extent.x_min_m, extent.x_max_m, extent.y_min_m, extent.y_max_m],
    })
}

/// Sends the last line, and reports what could not be sent.
pub(super) fn end(mut publisher: Publisher) -> Result<(), CliError> {
    publisher.end()?;
    for sink in publisher.udp() {
        if let Some(error) = sink.last_error() {
            let (address, unsent) = (sink.address(), sink.unsent());
            let all = sink.sent() + unsent;
            eprintln!("eit: note: --udp {address}: {unsent} of {all} lines were not sent: {error}");
        }
    }
    if let Some(lines) = publisher.line_statistics().filter(|lines| lines.dropped_frames > 0) {
        let (dropped, all) = (lines.dropped_frames, lines.frames);
        eprintln!(
            "eit: note: --json-lines: {dropped} of {all} frames were not written: the reader is slower than the skin"
        );
    }
    network::report(&publisher);
    Ok(())
}

/// Moves the text of an answer to stderr if stdout is used for lines.
pub(super) fn moved(answer: Answer, has_lines: bool) -> Answer {
    if !has_lines {
        return answer;
    }
    eprintln!("{}", printable(&answer.text));
    Answer { text: String::new(), ..answer }
}
