//! Progress on a terminal, nothing in a pipe; and the time of each stage.

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Time of one stage.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct StageTime {
    /// What was done.
    pub stage: &'static str,
    /// Wall time, seconds.
    pub time_s: f64,
}

/// Runs stages one after the other, shows the present one, keeps the times.
#[derive(Default)]
pub(crate) struct Progress {
    times: Vec<StageTime>,
    silent: bool,
    /// What the stages are part of; may be empty.
    group: String,
}

impl Progress {
    /// Shows nothing: for the parts of work that has a bar of its own.
    pub fn silent() -> Self {
        Self { silent: true, ..Self::default() }
    }

    /// Names what the next stages are part of.
    pub fn group(&mut self, name: String) {
        self.group = name;
    }

    /// Runs a stage without inner steps.
    pub fn stage<T, E>(
        &mut self,
        stage: &'static str,
        work: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        self.steps(stage, 0, |_| work())
    }

    /// Runs a stage of `steps` steps; the work reports each finished step.
    pub fn steps<T, E>(
        &mut self,
        stage: &'static str,
        steps: usize,
        work: impl FnOnce(&ProgressBar) -> Result<T, E>,
    ) -> Result<T, E> {
        // draws to stderr, and only if that is a terminal
        let bar = match (self.silent, steps) {
            (true, _) => ProgressBar::hidden(),
            (false, 0) => ProgressBar::new_spinner(),
            (false, steps) => ProgressBar::new(steps as u64),
        };
        let template = if steps > 0 {
            "{spinner} {msg:<28} {wide_bar} {pos}/{len} {eta}"
        } else {
            "{spinner} {msg:<28} {elapsed}"
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        match self.group.as_str() {
            "" => bar.set_message(stage),
            group => bar.set_message(format!("{group}: {stage}")),
        }
        if !self.silent {
            bar.enable_steady_tick(Duration::from_millis(100));
        }
        let start = Instant::now();
        let result = work(&bar);
        self.times.push(StageTime { stage, time_s: start.elapsed().as_secs_f64() });
        bar.finish_and_clear();
        result
    }

    /// Times so far.
    pub fn times(&self) -> &[StageTime] {
        &self.times
    }
}
