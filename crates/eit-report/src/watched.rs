//! Output and summary of `eit live` and `eit replay`.

use crate::Answer;
use crate::error::ReportError;
use crate::output::{ImageFile, OutFolder, io};
use crate::reconstruct::touches::{HEADER, write_row, write_state};
use eit_hw::capture::{Entry, TouchesRecord};
use eit_hw::driver::Statistics;
use eit_skin::faults::{ElectrodeFault, fault_lines};
use eit_skin::live::{LiveImages, SkinState, Summary, TouchFrame};
use eit_skin::text::counted;
use serde_json::json;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use tempfile::NamedTempFile;

/// Writes the output folder frame by frame, so memory does not grow with run time.
#[derive(Debug)]
pub struct Kept {
    folder: OutFolder,
    /// Present from the first image on; the second file holds raw images if a network is used.
    images: Option<(ImageFile, Option<ImageFile>)>,
    touches: BufWriter<NamedTempFile>,
    /// State of the skin that a row told last.
    state: SkinState,
}

impl Kept {
    /// Creates the output folder.
    ///
    /// # Errors
    ///
    /// A folder that cannot be written.
    pub fn new(path: impl AsRef<Path>) -> Result<Self, ReportError> {
        let path = path.as_ref();
        let folder = OutFolder::new(path)?;
        let mut touches = folder.begin("touches.csv")?;
        writeln!(touches, "{HEADER}").map_err(io)?;
        Ok(Self { folder, images: None, touches, state: SkinState::Sound })
    }

    /// Stores an image and its touches.
    ///
    /// # Errors
    ///
    /// An image of another size, and a disk that is full.
    pub fn take(&mut self, shown: &TouchFrame<'_>) -> Result<(), ReportError> {
        if let Some(made) = shown.images {
            self.take_image(made)?;
        }
        let before = std::mem::replace(&mut self.state, shown.state);
        if shown.touches.is_empty() && before != shown.state {
            write_state(shown.number, shown.time_s, shown.state, &mut self.touches)?;
        }
        for touch in shown.touches {
            write_row(shown.number, shown.time_s, touch, shown.state, &mut self.touches)?;
        }
        Ok(())
    }

    fn take_image(&mut self, made: &LiveImages) -> Result<(), ReportError> {
        let raster = made.raster();
        if self.images.is_none() {
            let shape = [raster.pixels(); 2];
            let raw = made.raw().map(|_| ImageFile::new(&self.folder, "raw.npy", shape));
            let images = ImageFile::new(&self.folder, "images.npy", shape)?;
            self.images = Some((images, raw.transpose()?));
        }
        if let Some((images, raw)) = &mut self.images {
            images.push(raster.image_from_pixels(made.pixels())?.view())?;
            if let (Some(file), Some(raw)) = (raw, made.raw()) {
                file.push(raster.image_from_pixels(raw)?.view())?;
            }
        }
        Ok(())
    }

    /// Completes the files and returns their names.
    ///
    /// # Errors
    ///
    /// A file that cannot be renamed.
    pub fn finish(self) -> Result<Vec<&'static str>, ReportError> {
        let Self { mut folder, images, touches, .. } = self;
        let mut names = Vec::new();
        if let Some((images, raw)) = images {
            for file in std::iter::once(images).chain(raw) {
                names.push(file.name());
                file.finish(&mut folder)?;
            }
        }
        folder.end("touches.csv", touches)?;
        names.push("touches.csv");
        // images of an earlier run do not stay where this one has none
        folder.commit(&["images.npy", "raw.npy"])?;
        Ok(names)
    }
}

/// Converts a frame to a recording's format.
///
/// # Errors
///
/// A frame that cannot be encoded.
pub fn record_of(shown: &TouchFrame<'_>) -> Result<Entry, ReportError> {
    let json = serde_json::to_string(shown).map_err(|e| ReportError::Failure(e.to_string()))?;
    let record = TouchesRecord::new(json).map(Entry::Touches);
    record.ok_or_else(|| ReportError::Failure("a frame without touches".to_owned()))
}

/// Summarises a run as text and JSON. The text leaves out notices that the user has seen (`shown`).
pub fn answer(
    name: &str,
    summary: &Summary,
    statistics: &Statistics,
    files: &[&str],
    shown: &[String],
) -> Answer {
    let unsearched = unsearched(summary, statistics);
    let text = text(name, summary, statistics, unsearched.as_ref(), shown);
    let json = json!({
        "instrument": name,
        "frames": summary.frames,
        "frame_rate_hz": summary.frame_rate_hz(),
        "touches": summary.touches,
        "most_at_once": summary.most_at_once,
        "not_explained": summary.not_explained,
        "frozen": summary.frozen,
        "lost": statistics.lost,
        "dropped": statistics.dropped,
        "reconnections": statistics.reconnections,
        "references": summary.references,
        "unrest": summary.unrest,
        "unsearched": unsearched.map(|why| json!({ "frames": statistics.frames, "why": why })),
        "latency_s": latency_json(|share| summary.latency_s(share)),
        "image_latency_s": latency_json(|share| summary.image_latency_s(share)),
        "images": summary.images,
        "faulty_electrodes": summary.faults.iter().map(ElectrodeFault::json).collect::<Vec<_>>(),
        "notices": summary.notices,
        "notices_left_out": summary.more_notices,
        "files": files,
    });
    Answer { text, json }
}

/// Median, 95 % quantile and maximum of a latency, seconds.
pub(crate) fn latency_json(of: impl Fn(f64) -> Option<f64>) -> serde_json::Value {
    let [median, p95, worst] = [0.5, 0.95, 1.0].map(of);
    json!({ "median": median, "p95": p95, "worst": worst })
}

/// Why no frame was searched for touches, if none was.
fn unsearched(summary: &Summary, statistics: &Statistics) -> Option<String> {
    (summary.references == 0 && statistics.frames > 0).then(|| {
        let came = counted(statistics.frames, "frame", "frames");
        match summary.unrest {
            Some(_) => format!(
                "{came} came, and none was searched for touches: begin while nothing touches the skin, or take fewer \
                 frames for the reference (--reference-frames; in a replay also [recording] reference = \"0..N\")"
            ),
            None => format!(
                "{came} came, fewer than the reference needs (--reference-frames), and none was searched for touches"
            ),
        }
    })
}

fn text(
    name: &str,
    summary: &Summary,
    statistics: &Statistics,
    unsearched: Option<&String>,
    shown: &[String],
) -> String {
    let mut text = format!(
        "{name}: {}{}{}, {}, at most {} at once; {} frames lost, {} \
         skipped, {} taken",
        counted(summary.frames, "frame", "frames"),
        if summary.images.how.is_empty() { "" } else { " with images" },
        summary.frame_rate_hz().map_or(String::new(), |rate| format!(" at {rate:.1} per second")),
        counted(summary.touches, "touch", "touches"),
        summary.most_at_once,
        statistics.lost,
        statistics.dropped,
        counted(summary.references, "reference", "references"),
    );
    if let Some(change) = summary.unrest {
        text += &format!("\n{}", eit_skin::live::unrest_text(change));
    }
    if let Some(words) = unsearched {
        text += &format!("\n{words}");
    }
    if summary.frozen > 0 {
        let count = counted(summary.frozen, "frame", "frames");
        text += &format!("\n{count} repeat an old one: nothing is known of the skin there");
    }
    if summary.not_explained > 0 {
        text += &format!(
            "\n{} frames are not explained by touches, which are not valid there: a fault, or what another [touch] \
             model explains (docs/SCENE.md)",
            summary.not_explained
        );
    }
    let touches_s = [0.5, 0.95, 1.0].map(|share| summary.latency_s(share));
    let images_s = [0.5, 0.95, 1.0].map(|share| summary.image_latency_s(share));
    for (what, latency_s) in [("touches", touches_s), ("image", images_s)] {
        if let [Some(median), Some(high), Some(worst)] = latency_s.map(|s| s.map(|s| 1e3 * s)) {
            text += &format!(
                "\nfrom the last byte of a frame to its {what}: median {median:.1} ms, 95 % \
                 {high:.1} ms, maximum {worst:.1} ms",
            );
        }
    }
    for line in fault_lines(&summary.faults) {
        text += &format!("\n{line}");
    }
    if !summary.images.how.is_empty() {
        text += &format!("\nimages: {}", summary.images.description());
    }
    for notice in summary.notices.iter().filter(|notice| !shown.contains(notice)).take(20) {
        text += &format!("\nnotice: {notice}");
    }
    text
}
