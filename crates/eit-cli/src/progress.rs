//! Progress on a terminal, nothing in a pipe; and the time of each stage.

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Columns below which a bar has no room beside its words.
const NARROW: u16 = 60;

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
    bars: MultiProgress,
}

impl Progress {
    /// Shows nothing: for the parts of work that has a bar of its own.
    pub fn silent() -> Self {
        Self { silent: true, ..Self::default() }
    }

    /// For work at the same time: its bars stand below those of this one.
    pub fn beside(&self) -> Self {
        Self { silent: self.silent, bars: self.bars.clone(), ..Self::default() }
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
            (false, 0) => self.bars.add(ProgressBar::new_spinner()),
            (false, steps) => self.bars.add(ProgressBar::new(steps as u64)),
        };
        let columns = console::Term::stderr().size_checked().map(|(_, columns)| columns);
        if let Ok(style) = ProgressStyle::with_template(template(steps, columns)) {
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

    /// Says something beside the bars, on stderr: nothing that a pipe would read.
    pub fn note(&self, text: &str) {
        if !self.silent {
            self.bars.suspend(|| eprintln!("eit: note: {text}"));
        }
    }

    /// Times so far.
    pub fn times(&self) -> &[StageTime] {
        &self.times
    }
}

/// What a line shows; on a narrow terminal the words are cut, and nothing runs over its edge.
fn template(steps: usize, columns: Option<u16>) -> &'static str {
    match (steps, columns.is_some_and(|columns| columns < NARROW)) {
        (0, false) => "{spinner} {msg:<28} {elapsed}",
        (0, true) => "{spinner} {wide_msg} {elapsed}",
        (_, false) => "{spinner} {msg:<28} {wide_bar} {pos}/{len} {eta}",
        (_, true) => "{spinner} {wide_msg} {pos}/{len} {eta}",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use indicatif::{ProgressDrawTarget, TermLike};
    use std::io::Result;
    use std::sync::{Arc, Mutex};

    /// A terminal that remembers what was written.
    #[derive(Debug, Clone)]
    struct Paper(u16, Arc<Mutex<String>>);

    impl TermLike for Paper {
        fn width(&self) -> u16 {
            self.0
        }
        fn move_cursor_up(&self, _: usize) -> Result<()> {
            Ok(())
        }
        fn move_cursor_down(&self, _: usize) -> Result<()> {
            Ok(())
        }
        fn move_cursor_right(&self, _: usize) -> Result<()> {
            Ok(())
        }
        fn move_cursor_left(&self, _: usize) -> Result<()> {
            Ok(())
        }
        fn write_line(&self, line: &str) -> Result<()> {
            self.write_str(&format!("{line}\n"))
        }
        fn write_str(&self, text: &str) -> Result<()> {
            self.1.lock().unwrap().push_str(text);
            Ok(())
        }
        fn clear_line(&self) -> Result<()> {
            self.write_line("")
        }
        fn flush(&self) -> Result<()> {
            Ok(())
        }
    }

    /// No line is wider than the terminal, however narrow, and none has a colour.
    #[test]
    fn lines_fit_the_terminal() {
        for columns in [30, 40, 59, 60, 200] {
            for steps in [0, 397] {
                let paper = Paper(columns, Arc::default());
                let target = ProgressDrawTarget::term_like(Box::new(paper.clone()));
                let bar = ProgressBar::with_draw_target(Some(steps), target);
                let template = template(steps as usize, Some(columns));
                bar.set_style(ProgressStyle::with_template(template).unwrap());
                bar.set_message("images and touches: two fingers");
                bar.set_position(steps / 2);
                bar.tick();
                let shown = paper.1.lock().unwrap().clone();
                assert!(shown.contains("images"), "{shown:?}");
                assert!(!shown.contains('\u{1b}'), "{shown:?}");
                for line in shown.lines() {
                    // padding up to the edge is all that may reach it
                    let wide = line.trim_end().chars().count();
                    assert!(wide <= usize::from(columns), "{columns} columns: {line:?}");
                }
            }
        }
    }
}
