//! `eit learn --live`: asks for presses, collects them, and learns.

use super::inputs;
use crate::cli::LearnArgs;
use crate::commands::prelude::*;
use crate::commands::record::is_news;
use eit_hw::capture::SessionRecord;
use eit_hw::driver::{Event, Session};
use eit_report::learnt::{LearnFiles, Presses};
use eit_skin::LinearisedSkin;
use eit_skin::connect::{self, Backlog};
use eit_skin::learn::LearnedSkin;
use eit_skin::learn::collect::{
    AskedPress, CollectSettings, Collecting, ErrorPoint, FallingError, PressCollector, PressStore,
    StoredPresses, draw_places, place_text,
};
use eit_skin::text::{event_text, printable};
use std::io::IsTerminal as _;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};

/// Fewest presses from which anything is learnt.
const LEAST_PRESSES: usize = 4;

/// Collects presses until the error no longer falls, all are made, or Ctrl-C; then learns from them.
pub(super) fn run(args: &LearnArgs) -> Result<Ended, CliError> {
    let settings = settings(args)?;
    let mut scene = Scene::load(&args.scene)?;
    scene.touch.learned = None;
    let instrument = scene.instrument()?;
    let table = args.presses.clone().unwrap_or_else(|| args.out.with_extension("presses.csv"));
    let recording = table.with_extension("mcap");
    let outputs = LearnFiles::new(&args.out, &inputs(args, &scene))?;
    let interrupt = interrupt::listen()?;
    let earlier = args.with.as_deref().map(LearnedSkin::read).transpose()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let linearised = Arc::new(skin.linearise(&mut progress)?);
    let port = args.live.port.as_deref();
    let mut session =
        progress.stage("connect", || connect::open(&instrument, port, Backlog::Recorded))?;
    let record = connect::session_record(&scene.to_toml()?, &instrument, &session);
    let (store, stored) = open(args, &table, &recording, &record)?;
    stored.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let before = stored.presses.len();
    let (unit, rate_hz) = (session.setup().unit, session.setup().frame_rate_hz);
    let StoredPresses { presses: made, frames, .. } = stored;
    let collector = PressCollector::new(&linearised, unit, rate_hz, settings, made, frames)?;
    let mut dialogue = Dialogue {
        args,
        skin: linearised,
        collector,
        store,
        earlier: earlier.as_ref(),
        interrupt,
        typed: None,
        falling: FallingError::default(),
        state: None,
        unsteady_since: None,
        asked: None,
        shown: before,
    };
    let end = dialogue.hold(&session);
    session.stop();
    let Dialogue { collector, store, .. } = dialogue;
    let stored = store.finish();
    let (why, exit) = end?;
    stored?;
    let presses = collector.presses().len();
    let (now, table, recording) = (presses - before, table.display(), recording.display());
    let collected = format!(
        "{why}: {now} presses made now, {presses} in {table}; their frames are in {recording}"
    );
    let Some((fitted, pressed)) = collector.pressed().filter(|_| presses >= LEAST_PRESSES) else {
        return Err(CliError::failure(format!(
            "{collected}; at least {LEAST_PRESSES} are needed: continue with --append"
        )));
    };
    let (pressed, earlier, notes) = (&pressed, earlier.as_ref(), vec![collected]);
    let presses = Presses { fitted, pressed, frame: args.frame(), earlier, notes };
    let answer = outputs.learn(presses, &mut progress)?;
    Ok(Ended { answer, exit })
}

fn settings(args: &LearnArgs) -> Result<CollectSettings, CliError> {
    check_ending(&args.out, &["learned"])?;
    let live = &args.live;
    let wanted = format!("{LEAST_PRESSES} or more");
    check_option("--number", live.number, live.number >= LEAST_PRESSES, &wanted)?;
    let settings = CollectSettings {
        presses: live.number,
        forces_n: live.force_n.clone(),
        hold_s: live.hold_s,
        frame: args.frame(),
    };
    settings.validate()?;
    Ok(settings)
}

/// Creates or continues table and recording.
fn open(
    args: &LearnArgs,
    table: &Path,
    recording: &Path,
    record: &SessionRecord,
) -> Result<(PressStore, StoredPresses), CliError> {
    match [table, recording].into_iter().find(|path| path.exists()) {
        Some(_) if args.live.append => Ok(PressStore::append(recording, table, record)?),
        Some(path) => Err(CliError::input(format!(
            "{} exists: continue it with --append, or name another table with --presses",
            path.display()
        ))),
        None => {
            let none = StoredPresses { presses: Vec::new(), frames: 0, notes: Vec::new() };
            Ok((PressStore::create(recording, table, record)?, none))
        }
    }
}

fn say(text: &str) {
    eprintln!("{}", printable(text));
}

/// Asks for presses and stores them.
struct Dialogue<'a> {
    args: &'a LearnArgs,
    skin: Arc<LinearisedSkin>,
    collector: PressCollector,
    store: PressStore,
    earlier: Option<&'a LearnedSkin>,
    interrupt: StopFlag,
    /// Lines of standard input, once a force was asked for.
    typed: Option<Receiver<std::io::Result<String>>>,
    falling: FallingError,
    /// State after the last frame.
    state: Option<Collecting>,
    /// Since when something touches the skin without being held, or since that was last said.
    unsteady_since: Option<Instant>,
    /// Number of the press that was asked for.
    asked: Option<usize>,
    /// Number of presses after which the error was last shown.
    shown: usize,
}

impl Dialogue<'_> {
    /// Collects until the end; returns why it ended.
    fn hold(&mut self, session: &Session) -> Result<(&'static str, Exit), CliError> {
        while !self.interrupt.is_set() {
            match session.next_event(SHUTDOWN_WAIT)? {
                Some(Event::Frame(frame)) => {
                    self.store.frame(&frame)?;
                    let state = self.collector.push(&frame)?;
                    session.recycle(frame);
                    if let Some(why) = self.follow(state)? {
                        return Ok((why, Exit::Done));
                    }
                }
                Some(event) => self.event(&event)?,
                None if session.is_over() => {
                    return Ok(("the instrument has gone", Exit::Silent));
                }
                None => self.store.tick()?,
            }
        }
        Ok(("interrupted", Exit::Done))
    }

    /// Something other than a frame: after a lost connection the untouched skin is measured again.
    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        if matches!(event, Event::Disconnected { .. } | Event::Reconnected { .. }) {
            self.collector.restart();
            (self.state, self.asked) = (None, None);
        }
        let Some(words) = event_text(event) else { return Ok(()) };
        if is_news(event) {
            say(&words);
        }
        Ok(self.store.note(&words)?)
    }

    /// Acts on the state after a frame; returns why collecting ends, if it does.
    fn follow(&mut self, state: Collecting) -> Result<Option<&'static str>, CliError> {
        let before = self.state.replace(state);
        match state {
            Collecting::Measuring if before != Some(state) => {
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
        if is_released && presses.is_multiple_of(5) && presses > self.shown {
            self.shown = presses;
            self.show_error();
            if self.falling.has_settled() && !self.args.live.all {
                return Ok(Some("the error no longer falls"));
            }
        }
        let Some(asked) = self.collector.asked() else {
            return Ok((!is_held(state)).then_some("all presses are made"));
        };
        if state == Collecting::Waiting && self.asked != Some(asked.number) {
            self.asked = Some(asked.number);
            self.ask(&asked)?;
        }
        Ok(None)
    }

    /// Says if something has touched the skin for long without being held: nothing is collected then.
    fn follow_unsteady(&mut self, state: Collecting) {
        if state != Collecting::Unsteady {
            self.unsteady_since = None;
            return;
        }
        let since = self.unsteady_since.get_or_insert_with(Instant::now);
        if since.elapsed() >= Duration::from_secs(10) {
            *since = Instant::now();
            // the press that follows may be another try: it is asked for again
            self.asked = None;
            say(
                "the touch has changed for 10 s: hold it still, or release it; if nothing touches the skin, stop \
                 with Ctrl-C and continue with --append, which measures the untouched skin anew",
            );
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
        let (number, all) = (asked.number + 1, self.args.live.number);
        let place = place_text(mesh, asked.place_m);
        say(&format!("press {number} of {all}{force} at {place}; hold it"));
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
        let made = self.collector.presses().last();
        Ok(made.map_or(Ok(()), |made| self.store.press(&made.press))?)
    }

    /// Learns from the presses so far and shows the error.
    fn show_error(&mut self) {
        let before = self.falling.points().last().copied();
        match self.collector.learn(self.earlier, &mut Progress::silent()) {
            Ok(learning) => {
                let now = self.falling.push(&learning.skin);
                say(&error_text(&now, before.as_ref()));
            }
            // one more press may mend it; all are stored
            Err(error) => say(&format!("not learnt yet: {error}")),
        }
    }

    /// Reads a force from standard input; `None` for an empty line, at its end and after Ctrl-C.
    fn read_force(&mut self) -> Result<Option<f64>, CliError> {
        loop {
            say("force of this press, N (empty line if unknown):");
            let text = self.read_line()?.trim().replace(',', ".");
            match text.parse::<f64>() {
                Ok(force_n) if force_n > 0.0 && force_n.is_finite() => return Ok(Some(force_n)),
                _ if text.is_empty() => return Ok(None),
                _ => say(&format!("\"{text}\" is not a force above 0")),
            }
        }
    }

    /// Waits for a line of standard input, but not after Ctrl-C: the press must still be stored. Empty at its end.
    fn read_line(&mut self) -> Result<String, CliError> {
        let typed = self.typed.get_or_insert_with(|| {
            let (sender, receiver) = channel();
            // reading cannot be interrupted; the thread ends with the program
            std::thread::spawn(move || {
                let mut lines = std::io::stdin().lines();
                while lines.next().is_some_and(|line| sender.send(line).is_ok()) {}
            });
            receiver
        });
        while !self.interrupt.is_set() {
            match typed.recv_timeout(SHUTDOWN_WAIT) {
                Ok(line) => {
                    return line.map_err(|e| CliError::failure(format!("standard input: {e}")));
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(String::new())
    }
}

/// The error after some presses, and that before them.
fn error_text(now: &ErrorPoint, before: Option<&ErrorPoint>) -> String {
    let mm = |m: f64| format!("{:.1} mm", 1e3 * m);
    let percent = |ln: f64| format!("{:.0} %", 100.0 * ln);
    let was =
        |words: Option<String>| words.map_or(String::new(), |words| format!(" (was {words})"));
    let place = was(before.map(|before| mm(before.place.mean_m)));
    let force = now.force_ln.map_or_else(String::new, |ln| {
        let before = was(before.and_then(|before| before.force_ln).map(percent));
        format!("; force {}{before}", percent(ln))
    });
    let (presses, median, mean) = (now.presses, mm(now.place.median_m), mm(now.place.mean_m));
    let by = now.places_by.description();
    format!(
        "{presses} presses: error of held-out presses {median} median, {mean} mean{place}{force}, by {by}"
    )
}
