//! `eit learn --live`: asks for presses, collects them, and learns.
//!
//! Over 300 lines because one dialogue with a person asks, waits, answers and ends in many ways.

use super::outputs::Outputs;
use super::{Parts, finish};
use crate::cli::LearnArgs;
use crate::commands::{Ended, SILENT, record};
use crate::error::CliError;
use crate::interrupt;
use crate::progress;
use eit_hw::capture::SessionRecord;
use eit_hw::driver::{Event, FrameSource, Session};
use eit_skin::connect::{self, Backlog};
use eit_skin::learn::collect::{
    AskedPress, CollectSettings, Collecting, ErrorPoint, FallingError, PressCollector, PressStore,
    StoredPresses, draw_places, place_words,
};
use eit_skin::learn::{Frame, LearnedSkin};
use eit_skin::scene::Scene;
use eit_skin::words::{event_words, printable};
use eit_skin::{LinearisedSkin, MeshOverride, Progress, Skin, StopFlag};
use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// How often to check for shutdown.
const WAIT: Duration = Duration::from_millis(50);
/// The error is shown after every so many presses.
const SHOWN_EVERY: usize = 5;
/// A touch that is neither held nor released for this long is reported, repeatedly.
const UNSTEADY: Duration = Duration::from_secs(10);
/// Fewest presses from which anything is learnt.
const LEAST_PRESSES: usize = 4;

/// Collects presses until the error no longer falls, all are made, or Ctrl-C; then learns from them.
pub(super) fn run(args: &LearnArgs) -> Result<Ended, CliError> {
    let settings = settings(args)?;
    let mut scene = Scene::load(&args.scene)?;
    scene.touch.learned = None;
    let instrument = scene.instrument()?;
    let [table, recording] = places(args);
    let outputs = Outputs::new(args, &scene)?;
    let earlier = args.with.as_deref().map(LearnedSkin::read).transpose()?;
    let interrupt = interrupt::listen()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let linearised = Arc::new(skin.linearise(&mut progress)?);
    let port = args.live.port.as_deref();
    let mut session =
        progress.stage("connect", || connect::open(&instrument, port, Backlog::Recorded))?;
    let record = connect::session_record(&scene.to_toml()?, &instrument, &session);
    let (store, stored) = open(args, [&table, &recording], &record)?;
    stored.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let begun = stored.presses.len();
    let setup = session.setup();
    let (unit, rate_hz) = (setup.unit, setup.frame_rate_hz);
    let StoredPresses { presses: made, frames, .. } = stored;
    let collector = PressCollector::new(&linearised, unit, rate_hz, settings, made, frames)?;
    let mut teacher =
        Teacher::new(args, &linearised, collector, store, earlier.as_ref(), &interrupt);
    let ended = teacher.teach(&mut session);
    session.stop();
    let Teacher { collector, store, .. } = teacher;
    let stored = store.finish();
    let why = ended?;
    stored?;
    let presses = collector.presses().len();
    let collected = format!(
        "{why}: {} presses made now, {presses} in {}; their frames are in {}",
        presses - begun,
        table.display(),
        recording.display()
    );
    let Some((fitted, pressed)) = collector.pressed().filter(|_| presses >= LEAST_PRESSES) else {
        return Err(CliError::Failure(format!(
            "{collected}; at least {LEAST_PRESSES} are needed: continue with --append"
        )));
    };
    let is_silent = why == Why::Lost;
    let parts = Parts {
        fitted,
        pressed: &pressed,
        frame: frame(args),
        earlier: earlier.as_ref(),
        notes: vec![collected],
    };
    let answer = finish(args, parts, outputs, &mut progress)?;
    Ok(Ended { answer, exit_code: if is_silent { SILENT } else { 0 } })
}

fn frame(args: &LearnArgs) -> Frame {
    if args.fit_frame { Frame::Fitted } else { Frame::Scene }
}

fn settings(args: &LearnArgs) -> Result<CollectSettings, CliError> {
    crate::commands::check_ending(&args.out, &["learned"])?;
    let live = &args.live;
    let settings = CollectSettings {
        presses: live.number,
        forces_n: live.force_n.clone(),
        hold_s: live.hold_s,
        frame: frame(args),
    };
    if live.number < LEAST_PRESSES {
        let message = format!("--number {}: it must be {LEAST_PRESSES} or more", live.number);
        return Err(CliError::input(message));
    }
    settings.validate()?;
    Ok(settings)
}

/// Table and recording.
fn places(args: &LearnArgs) -> [PathBuf; 2] {
    let table = args.presses.clone().unwrap_or_else(|| args.out.with_extension("presses.csv"));
    let recording = table.with_extension("mcap");
    [table, recording]
}

/// Creates or continues both files.
fn open(
    args: &LearnArgs,
    [table, recording]: [&PathBuf; 2],
    record: &SessionRecord,
) -> Result<(PressStore, StoredPresses), CliError> {
    let exists = table.exists() || recording.exists();
    if args.live.append && exists {
        return Ok(PressStore::append(recording, table, record)?);
    }
    if exists {
        let place = if table.exists() { table } else { recording };
        return Err(CliError::input(format!(
            "{} exists: continue it with --append, or name another table with --presses",
            place.display()
        )));
    }
    let none = StoredPresses { presses: Vec::new(), frames: 0, notes: Vec::new() };
    Ok((PressStore::create(recording, table, record)?, none))
}

fn say(text: &str) {
    eprintln!("{}", printable(text));
}

/// Why collecting ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Why {
    All,
    Settled,
    Interrupted,
    Lost,
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::All => "all presses are made",
            Self::Settled => "the error no longer falls",
            Self::Interrupted => "interrupted",
            Self::Lost => "the instrument has gone",
        })
    }
}

/// Asks for presses and stores them.
struct Teacher<'a> {
    args: &'a LearnArgs,
    skin: Arc<LinearisedSkin>,
    collector: PressCollector,
    store: PressStore,
    earlier: Option<&'a LearnedSkin>,
    interrupt: &'a StopFlag,
    /// Lines of standard input, once a force was asked for.
    typed: Option<Receiver<std::io::Result<String>>>,
    falling: FallingError,
    /// State after the last frame.
    state: Option<Collecting>,
    /// Time since when something touches the skin without being held, or since the last report of
    /// it.
    unsteady_since: Option<Instant>,
    /// Number of the press that was asked for.
    asked: Option<usize>,
    /// Number of presses after which the error was last shown.
    shown: usize,
}

impl<'a> Teacher<'a> {
    fn new(
        args: &'a LearnArgs,
        skin: &Arc<LinearisedSkin>,
        collector: PressCollector,
        store: PressStore,
        earlier: Option<&'a LearnedSkin>,
        interrupt: &'a StopFlag,
    ) -> Self {
        Self {
            args,
            skin: Arc::clone(skin),
            shown: collector.presses().len(),
            collector,
            store,
            earlier,
            interrupt,
            typed: None,
            falling: FallingError::default(),
            state: None,
            unsteady_since: None,
            asked: None,
        }
    }

    /// Collects until the end.
    fn teach(&mut self, session: &mut Session) -> Result<Why, CliError> {
        loop {
            if self.interrupt.is_set() {
                return Ok(Why::Interrupted);
            }
            match session.next_event(WAIT)? {
                Some(Event::Frame(frame)) => {
                    self.store.frame(&frame)?;
                    let state = self.collector.push(&frame)?;
                    session.recycle(frame);
                    if let Some(why) = self.follow(state)? {
                        return Ok(why);
                    }
                }
                Some(event) => self.tell(&event)?,
                None if session.is_over() => return Ok(Why::Lost),
                None => self.store.tick()?,
            }
        }
    }

    /// Handles events other than frames: after a lost connection the untouched skin is measured
    /// again.
    fn tell(&mut self, event: &Event) -> Result<(), CliError> {
        if matches!(event, Event::Disconnected { .. } | Event::Reconnected { .. }) {
            self.collector.restart();
            (self.state, self.asked) = (None, None);
        }
        if let Some(words) = event_words(event) {
            self.store.note(&words)?;
            if record::is_news(event) {
                say(&words);
            }
        }
        Ok(())
    }

    /// Acts on the state after a frame; returns why collecting ends, if it does.
    fn follow(&mut self, state: Collecting) -> Result<Option<Why>, CliError> {
        let before = self.state.replace(state);
        let is_new = before != Some(state);
        match state {
            Collecting::Measuring if is_new => {
                say("measuring the untouched skin: do not touch it");
            }
            Collecting::Collected => self.collected()?,
            Collecting::Refused => {
                say(
                    "this press cannot be used: it began before it was asked for, or values are missing; \
                     release it, and wait",
                );
                // asked for once more when the skin is untouched
                self.asked = None;
            }
            _ => {}
        }
        self.follow_unsteady(state);
        let is_held = |state| matches!(state, Collecting::Held | Collecting::Collected);
        let is_released = before.is_some_and(is_held) && !is_held(state);
        let presses = self.collector.presses().len();
        if is_released && presses.is_multiple_of(SHOWN_EVERY) && presses > self.shown {
            self.shown = presses;
            self.show_error();
            if self.falling.has_settled() && !self.args.live.all {
                return Ok(Some(Why::Settled));
            }
        }
        match self.collector.asked() {
            None => return Ok((!is_held(state)).then_some(Why::All)),
            Some(asked) if state == Collecting::Waiting && self.asked != Some(asked.number) => {
                self.asked = Some(asked.number);
                self.ask(&asked)?;
            }
            Some(_) => {}
        }
        Ok(None)
    }

    /// Reports a touch that has lasted long without being held, since nothing is collected then.
    fn follow_unsteady(&mut self, state: Collecting) {
        if state != Collecting::Unsteady {
            self.unsteady_since = None;
            return;
        }
        let since = self.unsteady_since.get_or_insert_with(Instant::now);
        if since.elapsed() >= UNSTEADY {
            *since = Instant::now();
            // the press that follows may be another try: it is asked for again
            self.asked = None;
            say(&format!(
                "the touch has changed for {} s: hold it still, or release it; if nothing touches the skin, stop with \
                 Ctrl-C and continue with --append, which measures the untouched skin anew",
                UNSTEADY.as_secs()
            ));
        }
    }

    /// Asks for a press.
    fn ask(&self, asked: &AskedPress) -> Result<(), CliError> {
        let mesh = &self.skin.skin.mesh;
        if std::io::stderr().is_terminal() {
            let presses = self.collector.presses().iter().map(|made| &made.press);
            let done: Vec<[f64; 3]> =
                presses.map(|p| [p.x_m, p.y_m, p.z_m.unwrap_or(0.0)]).collect();
            say(&draw_places(mesh, &done, asked.place_m)?);
        }
        let force = asked.force_n.map_or_else(String::new, |n| format!(" with {n} N"));
        say(&format!(
            "press {} of {}{force} at {}; hold it",
            asked.number + 1,
            self.args.live.number,
            place_words(mesh, asked.place_m)
        ));
        Ok(())
    }

    /// Stores the press that was just held.
    fn collected(&mut self) -> Result<(), CliError> {
        say("detected; release it");
        if self.args.live.ask_force
            && let Some(force_n) = self.read_force()?
        {
            self.collector.set_last_force(force_n)?;
        }
        match self.collector.presses().last() {
            Some(made) => Ok(self.store.press(&made.press)?),
            None => Ok(()),
        }
    }

    /// Learns from the presses so far and shows the error.
    fn show_error(&mut self) {
        let before = self.falling.points().last().copied();
        match self.collector.learn(self.earlier, &mut Progress::silent()) {
            Ok(learning) => {
                let now = self.falling.push(&learning.skin);
                say(&error_words(&now, before.as_ref()));
            }
            // one more press may mend it; all are stored
            Err(error) => say(&format!("not learnt yet: {error}")),
        }
    }

    /// Reads a force from standard input; `None` for an empty line, at its end and after Ctrl-C.
    fn read_force(&mut self) -> Result<Option<f64>, CliError> {
        loop {
            say("force of this press, N (empty line if unknown):");
            let Some(line) = self.read_line()? else { return Ok(None) };
            let text = line.trim().replace(',', ".");
            if text.is_empty() {
                return Ok(None);
            }
            match text.parse::<f64>() {
                Ok(force_n) if force_n > 0.0 && force_n.is_finite() => return Ok(Some(force_n)),
                _ => say(&format!("\"{text}\" is not a force above 0")),
            }
        }
    }

    /// Waits for a line of standard input, but not after Ctrl-C: the press must still be stored.
    fn read_line(&mut self) -> Result<Option<String>, CliError> {
        let typed = self.typed.get_or_insert_with(|| {
            let (sender, receiver) = std::sync::mpsc::channel();
            // reading cannot be interrupted; the thread ends with the program
            std::thread::spawn(move || {
                let mut lines = std::io::stdin().lines();
                while lines.next().is_some_and(|line| sender.send(line).is_ok()) {}
            });
            receiver
        });
        while !self.interrupt.is_set() {
            match typed.recv_timeout(WAIT) {
                Ok(line) => {
                    let failed = |e| CliError::Failure(format!("standard input: {e}"));
                    return line.map(Some).map_err(failed);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
            }
        }
        Ok(None)
    }
}

/// Describes the error after some presses, and the one before.
fn error_words(now: &ErrorPoint, before: Option<&ErrorPoint>) -> String {
    let mm = |m: f64| format!("{:.1} mm", 1e3 * m);
    let was = |words: String| format!(" (was {words})");
    let place = before.map_or_else(String::new, |b| was(mm(b.place.mean_m)));
    let percent = |ln: f64| format!("{:.0} %", 100.0 * ln);
    let force = now.force_ln.map_or_else(String::new, |ln| {
        let old = before.and_then(|b| b.force_ln).map_or_else(String::new, |l| was(percent(l)));
        format!("; force {}{old}", percent(ln))
    });
    format!(
        "{} presses: error of held-out presses {} median, {} mean{place}{force}, by {}",
        now.presses,
        mm(now.place.median_m),
        mm(now.place.mean_m),
        now.places_by.words()
    )
}
