//! What `eit live` and `eit replay` show, keep and answer.

use super::Answer;
use super::reconstruct::touches::write_csv;
use crate::cli::WatchArgs;
use crate::error::CliError;
use crate::interrupt::Interrupt;
use crate::output::{OutFolder, write_npy};
use crate::watch::{Model, Picture, Sight, Summary, Terminal, Watcher};
use eit_hw::capture::{CaptureWriter, TouchRecord, TouchesRecord};
use eit_hw::driver::{Event, Statistics};
use eit_inverse::touch::{Touch, TouchState};
use eit_mesh::Raster;
use ndarray::Array2;
use serde_json::json;
use std::time::{Duration, Instant};

/// Files of `--out` that a run may leave out.
const OPTIONAL: [&str; 1] = ["images.npy"];

/// Shows, records and keeps.
pub(super) struct Viewer<'a> {
    model: &'a Model,
    frames: u64,
    start: Instant,
    limit: Option<Duration>,
    interrupt: Interrupt,
    terminal: Terminal,
    picture: Option<Picture>,
    writer: Option<CaptureWriter>,
    kept: Option<Kept>,
}

/// What `--out` writes at the end.
struct Kept {
    folder: OutFolder,
    raster: Option<Raster>,
    pixels: Vec<f64>,
    touches: Vec<(usize, f64, Touch)>,
}

impl<'a> Viewer<'a> {
    /// Reserves what will be written.
    pub fn new(
        model: &'a Model,
        args: &WatchArgs,
        limit: Option<Duration>,
        is_shown: bool,
    ) -> Result<Self, CliError> {
        let folder = args.out.as_deref().map(OutFolder::new).transpose()?;
        Ok(Self {
            model,
            frames: args.frames.unwrap_or(u64::MAX),
            start: Instant::now(),
            limit,
            interrupt: Interrupt::listen()?,
            terminal: Terminal::new(is_shown),
            picture: args.picture.as_deref().map(Picture::new).transpose()?,
            writer: None,
            kept: folder.map(|folder| Kept {
                folder,
                raster: None,
                pixels: Vec::new(),
                touches: Vec::new(),
            }),
        })
    }

    /// Records what comes from now on.
    pub fn record(&mut self, writer: CaptureWriter) {
        self.writer = Some(writer);
    }

    /// Ends recording and writes what was kept; the names of the files.
    pub fn finish(self) -> Result<Vec<&'static str>, CliError> {
        if let Some(writer) = self.writer {
            writer.finish()?;
        }
        let Some(mut kept) = self.kept else { return Ok(Vec::new()) };
        if let Some(raster) = &kept.raster {
            let width = raster.masked_pixels().len();
            let shape = (kept.pixels.len() / width.max(1), width);
            let pixels = Array2::from_shape_vec(shape, std::mem::take(&mut kept.pixels))
                .map_err(|e| CliError::Failure(format!("images: {e}")))?;
            let images = raster.images_from_pixels(pixels.view())?;
            kept.folder.write("images.npy", |out| write_npy(&images, out))?;
        }
        kept.folder.write("touches.csv", |out| write_csv(&kept.touches, out))?;
        let names = kept.folder.names();
        kept.folder.commit(&OPTIONAL)?;
        Ok(names)
    }
}

impl Watcher for Viewer<'_> {
    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        match (event, crate::connect::words(event)) {
            (Event::Frame(frame), _) => writer.frame(frame)?,
            (_, Some(words)) => writer.note(&words)?,
            _ => {}
        }
        Ok(())
    }

    fn idle(&mut self) -> Result<(), CliError> {
        match &mut self.writer {
            Some(writer) => Ok(writer.tick()?),
            None => Ok(()),
        }
    }

    fn waiting(&mut self, left: usize) -> Result<(), CliError> {
        self.terminal.waiting(left);
        Ok(())
    }

    fn sight(&mut self, sight: &Sight<'_>) -> Result<(), CliError> {
        self.terminal.show(sight)?;
        if let Some(picture) = &mut self.picture {
            picture.show(self.model, sight)?;
        }
        if let Some(writer) = &mut self.writer
            && !sight.touches.is_empty()
        {
            writer.touches(&record_of(sight))?;
        }
        if let Some(kept) = &mut self.kept {
            kept.raster.get_or_insert_with(|| sight.finder.raster.clone());
            kept.pixels.extend(sight.finder.pixels());
            let number = sight.number as usize;
            kept.touches.extend(sight.touches.iter().map(|touch| (number, sight.time_s, *touch)));
        }
        Ok(())
    }

    fn goes_on(&mut self, summary: &Summary) -> bool {
        summary.frames < self.frames
            && !self.interrupt.is_set()
            && self.limit.is_none_or(|limit| self.start.elapsed() < limit)
    }
}

/// Touches as a recording holds them.
fn record_of(sight: &Sight<'_>) -> TouchesRecord {
    let touches = sight.touches.iter().filter(|touch| touch.state != TouchState::End);
    TouchesRecord {
        sequence: sight.frame.sequence,
        touches: touches
            .map(|touch| TouchRecord {
                name: touch.id,
                position_m: touch.position_m,
                radius_m: Some((touch.area_m2 / std::f64::consts::PI).sqrt()),
                force_n: None,
            })
            .collect(),
    }
}

/// What was seen, for people and for programs.
pub(super) fn answer(
    name: &str,
    summary: &Summary,
    statistics: &Statistics,
    files: &[&str],
) -> Answer {
    let rate_hz =
        (summary.span_s > 0.0).then(|| summary.frames.saturating_sub(1) as f64 / summary.span_s);
    let [median, high, worst] = [0.5, 0.95, 1.0].map(|share| summary.latency_s(share));
    let mut text = format!(
        "{name}: {} frames with images{}, {} touches, at most {} at once; {} frames lost, {} \
         skipped, {} references taken",
        summary.frames,
        rate_hz.map_or(String::new(), |rate| format!(" at {rate:.1} a second")),
        summary.touches,
        summary.most_at_once,
        statistics.lost,
        statistics.dropped,
        summary.references
    );
    if let (Some(median), Some(high), Some(worst)) = (median, high, worst) {
        text += &format!(
            "\nfrom the last byte of a frame to its touches: {:.1} ms in the median, {:.1} ms in 95 \
             %, {:.1} ms at worst",
            1e3 * median,
            1e3 * high,
            1e3 * worst
        );
    }
    for notice in summary.notices.iter().take(20) {
        text += &format!("\nit said: {notice}");
    }
    let json = json!({
        "instrument": name,
        "frames": summary.frames,
        "frame_rate_hz": rate_hz,
        "touches": summary.touches,
        "most_at_once": summary.most_at_once,
        "lost": statistics.lost,
        "dropped": statistics.dropped,
        "reconnections": statistics.reconnections,
        "references": summary.references,
        "latency_s": { "median": median, "p95": high, "worst": worst },
        "notices": summary.notices,
        "files": files,
    });
    Answer { text, json }
}
