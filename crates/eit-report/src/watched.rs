//! What `eit live` and `eit replay` show, keep and answer.

use crate::Answer;
use super::reconstruct::touches::{HEADER, write_row};
use crate::cli::WatchArgs;
use crate::error::ReportError;
use eit_skin::StopFlag;
use crate::output::{ImageFile, OutFolder, io};
use eit_skin::live::{Model, Picture, Sight, Summary, Terminal, Watcher};
use eit_hw::capture::{CaptureWriter, TouchRecord, TouchesRecord};
use eit_hw::driver::{Event, Statistics};
use eit_inverse::touch::TouchState;
use serde_json::json;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

/// Files of `--out` that a run may leave out.
pub(super) const OPTIONAL: [&str; 2] = ["images.npy", "raw.npy"];

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

/// What `--out` writes, frame by frame: memory does not grow with the hours.
pub(super) struct Kept {
    folder: OutFolder,
    /// From the first image on; the raw ones where a net follows.
    images: Option<(ImageFile, Option<ImageFile>)>,
    touches: BufWriter<NamedTempFile>,
}

impl Kept {
    /// Reserves the folder.
    pub fn new(path: &Path) -> Result<Self, ReportError> {
        let folder = OutFolder::new(path)?;
        let mut touches = folder.begin("touches.csv")?;
        writeln!(touches, "{HEADER}").map_err(io)?;
        Ok(Self { folder, images: None, touches })
    }

    /// Takes an image and its touches.
    pub fn take(&mut self, sight: &Sight<'_>) -> Result<(), ReportError> {
        let raster = &sight.finder.raster;
        if self.images.is_none() {
            let shape = [raster.pixels(); 2];
            let raw = sight.movie.raw().map(|_| ImageFile::new(&self.folder, "raw.npy", shape));
            let images = ImageFile::new(&self.folder, "images.npy", shape)?;
            self.images = Some((images, raw.transpose()?));
        }
        if let Some((images, raw)) = &mut self.images {
            images.push(raster.image_from_pixels(sight.movie.pixels())?.view())?;
            if let (Some(file), Some(raw)) = (raw, sight.movie.raw()) {
                file.push(raster.image_from_pixels(raw)?.view())?;
            }
        }
        for touch in sight.touches {
            write_row(sight.number, sight.time_s, touch, &mut self.touches)?;
        }
        Ok(())
    }

    /// Puts the files in their places; their names.
    pub fn finish(self) -> Result<Vec<&'static str>, ReportError> {
        let Self { mut folder, images, touches } = self;
        if let Some((images, raw)) = images {
            images.finish(&mut folder)?;
            if let Some(raw) = raw {
                raw.finish(&mut folder)?;
            }
        }
        folder.end("touches.csv", touches)?;
        let names = folder.names();
        folder.commit(&OPTIONAL)?;
        Ok(names)
    }
}

impl<'a> Viewer<'a> {
    /// Reserves what will be written.
    pub fn new(
        model: &'a Model,
        args: &WatchArgs,
        limit: Option<Duration>,
        is_shown: bool,
    ) -> Result<Self, ReportError> {
        let kept = args.out.as_deref().map(Kept::new).transpose()?;
        Ok(Self {
            model,
            frames: args.frames.unwrap_or(u64::MAX),
            start: Instant::now(),
            limit,
            interrupt: Interrupt::listen()?,
            terminal: Terminal::new(is_shown),
            picture: args.picture.as_deref().map(Picture::new).transpose()?,
            writer: None,
            kept,
        })
    }

    /// Records what comes from now on.
    pub fn record(&mut self, writer: CaptureWriter) {
        self.writer = Some(writer);
    }

    /// Ends recording and writes what was kept; the names of the files.
    pub fn finish(self) -> Result<Vec<&'static str>, ReportError> {
        if let Some(writer) = self.writer {
            writer.finish()?;
        }
        self.kept.map_or(Ok(Vec::new()), Kept::finish)
    }
}

impl Watcher for Viewer<'_> {
    fn event(&mut self, event: &Event) -> Result<(), ReportError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        match (event, eit_skin::connect::words(event)) {
            (Event::Frame(frame), _) => writer.frame(frame)?,
            (_, Some(words)) => writer.note(&words)?,
            _ => {}
        }
        Ok(())
    }

    fn idle(&mut self) -> Result<(), ReportError> {
        match &mut self.writer {
            Some(writer) => Ok(writer.tick()?),
            None => Ok(()),
        }
    }

    fn waiting(&mut self, left: usize) -> Result<(), ReportError> {
        self.terminal.waiting(left);
        Ok(())
    }

    fn sight(&mut self, sight: &Sight<'_>) -> Result<(), ReportError> {
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
            kept.take(sight)?;
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
pub(super) fn record_of(sight: &Sight<'_>) -> TouchesRecord {
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
    text += &format!("\nimages: {}", summary.images_words());
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
        "images": summary.images_json(),
        "notices": summary.notices,
        "notices_left_out": summary.more_notices,
        "files": files,
    });
    Answer { text, json }
}
