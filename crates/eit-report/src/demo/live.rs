//! Runs an experiment as on a real skin: instrument, driver, recording, images, touches.

use super::experiment::Experiment;
use super::{FrameWatcher, Stage};
use crate::error::ReportError;
use crate::watched::{Kept, record_of};
use eit_hw::Frame;
use eit_hw::capture::{CaptureSettings, CaptureWriter};
use eit_hw::driver::{Event, Session};
use eit_hw::emulator::{Emulator, FaultPlan, Listen};
use eit_inverse::touch::{Touch, TouchState};
use eit_skin::Progress;
use eit_skin::Steps;
use eit_skin::connect::{self, Backlog};
use eit_skin::emulate::{self, Content, Hold, PlayedFrames};
use eit_skin::live::{LiveModel, LiveObserver, REFERENCE_FRAMES, Summary, TouchFrame};
use eit_skin::scene::Instrument;
use eit_skin::text::event_text;
use ndarray::{Array2, Array3, Axis};
use std::path::Path;
use std::time::{Duration, Instant};

/// An instrument silent for this long has failed.
const SILENCE: Duration = Duration::from_secs(20);

/// Results of running an experiment live.
pub(super) struct LiveRun {
    /// Frame of the script for each image.
    pub frames: Vec<usize>,
    /// Images before and after the network, siemens, [frame, row, column].
    pub raw: Array3<f64>,
    pub made: Array3<f64>,
    /// Touches of each image.
    pub touches: Vec<Vec<Touch>>,
    /// Counts and delays of the live run.
    pub summary: Summary,
    /// Description of the connection to the instrument.
    pub line: String,
    /// Whether all frames of the script arrived.
    pub is_whole: bool,
}

/// The instrument and its driver.
struct Wire {
    session: Session,
    emulator: Emulator,
    line: String,
    /// Folder that holds the terminal's name; dropped last.
    folder: Option<tempfile::TempDir>,
}

/// Plays the frames of a file once through an emulated instrument and processes them live.
pub(super) fn run(
    experiment: &Experiment,
    frames: usize,
    stage: &Stage<'_>,
    goes_on: &(dyn Fn() -> bool + Sync),
    progress: &mut Progress,
) -> Result<LiveRun, ReportError> {
    let Stage { model, instrument, folder, watcher, .. } = *stage;
    let wanted = frames.saturating_sub(REFERENCE_FRAMES);
    progress.steps(experiment.stages[1], wanted, |bar| {
        let own = folder.join(experiment.folder);
        let hold = Hold::of_first(REFERENCE_FRAMES as u64);
        let mut wire = connect(model, instrument, &own.join("frames.npy"), &hold)?;
        let record = connect::session_record(&model.skin().scene_toml, instrument, &wire.session);
        let place = folder.join(experiment.recording);
        let writer = CaptureWriter::create(&place, &record, CaptureSettings::default())?;
        let mut watcher = Demo {
            writer,
            kept: Kept::new(&own)?,
            hold,
            wanted,
            goes_on,
            bar,
            last: Instant::now(),
            failure: None,
            pile: Pile::default(),
            watch: watcher.map(|watcher| (experiment.name, model.as_ref(), watcher)),
        };
        let summary = model.watch(&mut wire.session, true, &mut watcher);
        wire.session.stop();
        wire.emulator.stop();
        let Demo { writer, kept, pile, failure, .. } = watcher;
        // files are completed in any case, and the first error is reported
        let ended = (writer.finish(), kept.finish());
        let summary = summary?;
        ended.0?;
        ended.1?;
        if let Some(failure) = failure {
            return Err(failure);
        }
        Ok(LiveRun {
            is_whole: pile.frames.len() == wanted,
            frames: pile.frames,
            raw: stacked(&pile.raw)?,
            made: stacked(&pile.made)?,
            touches: pile.touches,
            summary,
            line: wire.line,
        })
    })
}

fn stacked(images: &[Array2<f64>]) -> Result<Array3<f64>, ReportError> {
    let views: Vec<_> = images.iter().map(|image| image.view()).collect();
    match views.is_empty() {
        true => Ok(Array3::zeros((0, 1, 1))),
        false => Ok(ndarray::stack(Axis(0), &views)?),
    }
}

/// Starts the instrument on a pseudo-terminal and opens it; if that fails, uses TCP and gives the
/// reason.
fn connect(
    model: &LiveModel,
    instrument: &Instrument,
    frames: &Path,
    hold: &Hold,
) -> Result<Wire, ReportError> {
    let frames = PlayedFrames::File(frames);
    let content = Content { frames, serial: "demo", seed: 0, scan_share: 0.0, hold: Some(hold) };
    let open = |listen: &Listen, line: &str| {
        let mut silent = Progress::silent();
        let device = emulate::device(model.skin(), instrument, &content, &mut silent)?;
        let emulator = Emulator::start(device, listen, FaultPlan::default())?;
        let port = emulator.endpoint().to_string();
        let session = connect::open(instrument, Some(&port), Backlog::Recorded)?;
        Ok::<_, ReportError>(Wire { session, emulator, line: line.to_owned(), folder: None })
    };
    let why = match on_terminal(&open) {
        Ok(wire) => return Ok(wire),
        Err(why) => why,
    };
    let line = format!("TCP on this computer, because no pseudo-terminal was available ({why})");
    open(&Listen::Tcp("127.0.0.1:0".to_owned()), &line)
}

/// Connects through a pseudo-terminal.
#[cfg(unix)]
fn on_terminal(
    open: &dyn Fn(&Listen, &str) -> Result<Wire, ReportError>,
) -> Result<Wire, ReportError> {
    let folder = tempfile::Builder::new().prefix("eit-demo-").tempdir().map_err(|e| {
        ReportError::Failure(format!("cannot create a folder for the terminal: {e}"))
    })?;
    let mut wire = open(&Listen::PseudoTerminal(folder.path().join("skin")), "a pseudo-terminal")?;
    wire.folder = Some(folder);
    Ok(wire)
}

#[cfg(not(unix))]
fn on_terminal(
    _: &dyn Fn(&Listen, &str) -> Result<Wire, ReportError>,
) -> Result<Wire, ReportError> {
    Err(ReportError::Failure("not supported by this system".to_owned()))
}

/// Records and stores the data, and reports progress.
struct Demo<'a, 'b> {
    writer: CaptureWriter,
    kept: Kept,
    /// The fingers, which wait until the reference has been taken.
    hold: Hold,
    /// Number of frames of the script after those of the reference.
    wanted: usize,
    goes_on: &'a (dyn Fn() -> bool + Sync),
    bar: &'a Steps<'b>,
    /// Time of the last frame.
    last: Instant,
    failure: Option<ReportError>,
    pile: Pile,
    /// Observer of the frames, with the name of the experiment and its model.
    watch: Option<(&'static str, &'a LiveModel, &'a FrameWatcher<'a>)>,
}

/// Data for evaluation and drawing, one entry per image.
#[derive(Default)]
struct Pile {
    frames: Vec<usize>,
    raw: Vec<Array2<f64>>,
    made: Vec<Array2<f64>>,
    touches: Vec<Vec<Touch>>,
}

impl LiveObserver for Demo<'_, '_> {
    type Error = ReportError;

    fn event(&mut self, event: &Event) -> Result<(), ReportError> {
        match (event, event_text(event)) {
            (Event::Frame(frame), _) => {
                self.last = Instant::now();
                self.writer.frame(frame)?;
            }
            (_, Some(words)) => self.writer.note(&words)?,
            _ => {}
        }
        Ok(())
    }

    fn idle(&mut self) -> Result<(), ReportError> {
        if self.last.elapsed() > SILENCE {
            self.failure = Some(ReportError::Failure(format!(
                "the emulated instrument has been silent for {} s",
                SILENCE.as_secs()
            )));
        }
        Ok(self.writer.tick()?)
    }

    /// The demo's pictures and errors need all frames, even on a busy computer.
    fn wants_every_image(&self) -> bool {
        true
    }

    fn reference(
        &mut self,
        taken: &[Frame],
        _: &[String],
        until: Option<u64>,
    ) -> Result<(), ReportError> {
        self.hold.release();
        let record = connect::reference_record(taken, until);
        Ok(record.map_or(Ok(()), |record| self.writer.reference(&record))?)
    }

    fn frame(&mut self, shown: &TouchFrame<'_>) -> Result<(), ReportError> {
        self.kept.take(shown)?;
        if let Some((name, model, watcher)) = self.watch {
            watcher(name, model, shown);
        }
        self.writer.write(&record_of(shown)?)?;
        let (Some(images), Some(frame)) = (shown.images, self.hold.frame(shown.sequence)) else {
            return Ok(());
        };
        let made = images.raster().image_from_pixels(images.pixels())?;
        let raw = match images.raw() {
            Some(raw) => images.raster().image_from_pixels(raw)?,
            None => made.clone(),
        };
        let alive = shown.touches.iter().filter(|touch| touch.state != TouchState::End);
        self.pile.frames.push(frame as usize);
        self.pile.raw.push(raw);
        self.pile.made.push(made);
        self.pile.touches.push(alive.copied().collect());
        self.bar.set_position(self.pile.frames.len());
        Ok(())
    }

    fn ended(&mut self, last: &TouchFrame<'_>) -> Result<(), ReportError> {
        self.kept.take(last)?;
        Ok(self.writer.write(&record_of(last)?)?)
    }

    fn goes_on(&mut self, _: &Summary) -> bool {
        self.pile.frames.len() < self.wanted && self.failure.is_none() && (self.goes_on)()
    }
}
