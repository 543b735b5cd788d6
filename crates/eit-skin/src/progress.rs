//! Progress of long work: stages with their times, told to whoever observes them.

use serde::Serialize;
use std::sync::Mutex;
use std::time::Instant;

/// Sees the stages of long work as they run. Every method does nothing by default.
pub trait Observer: Send {
    /// A stage begins. `group` names what it is part of and may be empty; `steps` is the number of its
    /// steps, or 0 where it has none.
    fn begin(&mut self, _group: &str, _stage: &str, _steps: usize) {}

    /// The current stage turns out to have so many steps.
    fn length(&mut self, _steps: usize) {}

    /// So many steps of the current stage are done.
    fn position(&mut self, _done: usize) {}

    /// What the current stage is doing.
    fn message(&mut self, _text: &str) {}

    /// The current stage has ended.
    fn end(&mut self) {}

    /// Something the user should know.
    fn note(&mut self, _text: &str) {}

    /// An observer for work that runs beside this one, on another thread.
    fn beside(&self) -> Box<dyn Observer> {
        Box::new(Silent)
    }
}

/// Observes nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}

/// Wall time of one stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// What was done.
    pub stage: &'static str,
    /// Wall time, seconds.
    pub time_s: f64,
}

/// Runs stages one after the other, tells an [`Observer`] and keeps their times.
pub struct Progress {
    times: Vec<StageTime>,
    group: String,
    observer: Box<dyn Observer>,
}

/// The steps of a running stage; threads may share them.
pub struct Steps<'a>(Mutex<Counted<'a>>);

struct Counted<'a> {
    done: usize,
    observer: &'a mut dyn Observer,
}

impl<'a> Steps<'a> {
    /// One more step is done.
    pub fn inc(&self) {
        let mut counted = self.counted();
        counted.done += 1;
        let done = counted.done;
        counted.observer.position(done);
    }

    /// So many steps are done.
    pub fn set_position(&self, done: usize) {
        let mut counted = self.counted();
        counted.done = done;
        counted.observer.position(done);
    }

    /// The stage turns out to have so many steps.
    pub fn set_length(&self, steps: usize) {
        self.counted().observer.length(steps);
    }

    /// What the stage is doing.
    pub fn set_message(&self, text: &str) {
        self.counted().observer.message(text);
    }

    /// Something the user should know.
    pub fn note(&self, text: &str) {
        self.counted().observer.note(text);
    }

    /// A thread that panicked between two counts has left a number behind, nothing worse.
    fn counted(&self) -> std::sync::MutexGuard<'_, Counted<'a>> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Default for Progress {
    fn default() -> Self {
        Self::silent()
    }
}

impl Progress {
    /// Tells this observer.
    pub fn new(observer: Box<dyn Observer>) -> Self {
        Self { times: Vec::new(), group: String::new(), observer }
    }

    /// Tells nobody.
    pub fn silent() -> Self {
        Self::new(Box::new(Silent))
    }

    /// For work at the same time, with an observer of its own.
    pub fn beside(&self) -> Self {
        Self::new(self.observer.beside())
    }

    /// Names what the next stages are part of.
    pub fn group(&mut self, name: String) {
        self.group = name;
    }

    /// Runs a stage without inner steps.
    ///
    /// # Errors
    ///
    /// Those of the work.
    pub fn stage<T, E>(
        &mut self,
        stage: &'static str,
        work: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        self.steps(stage, 0, |_| work())
    }

    /// Runs a stage of `steps` steps; the work reports each finished step.
    ///
    /// # Errors
    ///
    /// Those of the work.
    pub fn steps<T, E>(
        &mut self,
        stage: &'static str,
        steps: usize,
        work: impl FnOnce(&Steps<'_>) -> Result<T, E>,
    ) -> Result<T, E> {
        self.observer.begin(&self.group, stage, steps);
        let start = Instant::now();
        let result =
            work(&Steps(Mutex::new(Counted { done: 0, observer: self.observer.as_mut() })));
        self.times.push(StageTime { stage, time_s: start.elapsed().as_secs_f64() });
        self.observer.end();
        result
    }

    /// Tells the observer something that the user should know.
    pub fn note(&mut self, text: &str) {
        self.observer.note(text);
    }

    /// Times so far.
    pub fn times(&self) -> &[StageTime] {
        &self.times
    }
}
