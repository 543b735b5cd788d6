//! Progress of long work: stages with their times, told to whoever observes them.

use serde::Serialize;
use std::time::Instant;

/// Sees the stages of long work as they run. Every method does nothing by default.
pub trait Observer: Send {
    /// A stage begins. `group` names what it is part of and may be empty; `steps` is the number of its
    /// steps, or 0 where it has none.
    fn begin(&mut self, _group: &str, _stage: &str, _steps: usize) {}

    /// So many steps of the current stage are done.
    fn position(&mut self, _done: usize) {}

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

/// The steps of a running stage.
pub struct Steps<'a> {
    done: usize,
    observer: &'a mut dyn Observer,
}

impl Steps<'_> {
    /// One more step is done.
    pub fn inc(&mut self) {
        self.set_position(self.done + 1);
    }

    /// So many steps are done.
    pub fn set_position(&mut self, done: usize) {
        self.done = done;
        self.observer.position(done);
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
        work: impl FnOnce(&mut Steps<'_>) -> Result<T, E>,
    ) -> Result<T, E> {
        self.observer.begin(&self.group, stage, steps);
        let start = Instant::now();
        let result = work(&mut Steps { done: 0, observer: self.observer.as_mut() });
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
