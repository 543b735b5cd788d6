//! Progress of long work: stages and their times, reported to an observer.

use eit_core::event;
use serde::Serialize;
use std::sync::Mutex;
use std::time::Instant;

/// Observes the stages of long work as they run. Every method does nothing by default.
pub trait Observer: Send {
    /// Called when a stage begins. `group` names what it is part of and may be empty; `steps` is the number
    /// of its steps, or 0 if it has none.
    fn begin(&mut self, _group: &str, _stage: &str, _steps: usize) {}

    /// Called when the number of steps of the current stage changes.
    fn length(&mut self, _steps: usize) {}

    /// Called with the number of finished steps of the current stage.
    fn position(&mut self, _done: usize) {}

    /// Called with a description of what the current stage is doing.
    fn message(&mut self, _text: &str) {}

    /// Called when the current stage ends.
    fn end(&mut self) {}

    /// Called with a note for the user.
    fn note(&mut self, _text: &str) {}

    /// Returns an observer for concurrent work on another thread.
    fn beside(&self) -> Box<dyn Observer> {
        Box::new(Silent)
    }
}

/// An observer that does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}

/// Wall time of one stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: &'static str,
    /// Wall time, seconds.
    pub time_s: f64,
}

/// Runs stages one after the other, reports them to an [`Observer`] and records their times.
///
/// ```
/// use eit_skin::{Observer, Progress};
///
/// /// Prints each stage as it begins.
/// struct Print;
///
/// impl Observer for Print {
///     fn begin(&mut self, _group: &str, stage: &str, _steps: usize) {
///         println!("{stage} ...");
///     }
/// }
///
/// let mut progress = Progress::new(Box::new(Print));
/// let sum = progress.stage("sum", || Ok::<i32, std::fmt::Error>(1 + 1))?;
/// assert_eq!((sum, progress.times()[0].stage), (2, "sum"));
/// # Ok::<(), std::fmt::Error>(())
/// ```
pub struct Progress {
    times: Vec<StageTime>,
    group: String,
    observer: Box<dyn Observer>,
}

/// Steps of a running stage; can be shared between threads.
pub struct Steps<'a>(Mutex<Counted<'a>>);

struct Counted<'a> {
    done: usize,
    observer: &'a mut dyn Observer,
}

impl std::fmt::Debug for Steps<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Steps").field("done", &self.counted().done).finish_non_exhaustive()
    }
}

impl<'a> Steps<'a> {
    /// Reports that one more step is done.
    pub fn inc(&self) {
        let mut counted = self.counted();
        counted.done += 1;
        let done = counted.done;
        counted.observer.position(done);
    }

    /// Reports the number of finished steps.
    pub fn set_position(&self, done: usize) {
        let mut counted = self.counted();
        counted.done = done;
        counted.observer.position(done);
    }

    /// Reports a changed number of steps.
    pub fn set_length(&self, steps: usize) {
        self.counted().observer.length(steps);
    }

    /// Reports what the stage is doing.
    pub fn set_message(&self, text: &str) {
        self.counted().observer.message(text);
    }

    /// Reports a note for the user.
    pub fn note(&self, text: &str) {
        self.counted().observer.note(text);
    }

    /// A panic in another thread leaves at worst a wrong count, so poisoning is ignored.
    fn counted(&self) -> std::sync::MutexGuard<'_, Counted<'a>> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Default for Progress {
    fn default() -> Self {
        Self::silent()
    }
}

impl std::fmt::Debug for Progress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Progress")
            .field("group", &self.group)
            .field("times", &self.times)
            .finish_non_exhaustive()
    }
}

impl Progress {
    /// Creates a progress that reports to `observer`.
    pub fn new(observer: Box<dyn Observer>) -> Self {
        Self { times: Vec::new(), group: String::new(), observer }
    }

    /// Creates a progress that reports to nobody.
    pub fn silent() -> Self {
        Self::new(Box::new(Silent))
    }

    /// Creates a progress for concurrent work, with an observer of its own.
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
    /// The errors of the work.
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
    /// The errors of the work.
    pub fn steps<T, E>(
        &mut self,
        stage: &'static str,
        steps: usize,
        work: impl FnOnce(&Steps<'_>) -> Result<T, E>,
    ) -> Result<T, E> {
        self.observer.begin(&self.group, stage, steps);
        #[cfg(feature = "tracing")]
        let _in_span = eit_core::tracing::debug_span!("stage", name = stage).entered();
        let start = Instant::now();
        let result =
            work(&Steps(Mutex::new(Counted { done: 0, observer: self.observer.as_mut() })));
        let time_s = start.elapsed().as_secs_f64();
        event!(DEBUG, "finished", time_s = time_s, failed = result.is_err());
        self.times.push(StageTime { stage, time_s });
        self.observer.end();
        result
    }

    /// Reports a note for the user.
    pub fn note(&mut self, text: &str) {
        self.observer.note(text);
    }

    /// Returns the times so far.
    pub fn times(&self) -> &[StageTime] {
        &self.times
    }
}
