//! Shows progress on a terminal, but not in a pipe.

use crate::terminal;
use eit_skin::text::printable;
use eit_skin::{Observer, Progress};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// Creates a progress that is shown on the terminal.
pub(crate) fn terminal() -> Progress {
    match terminal::flags().is_quiet {
        true => Progress::silent(),
        false => Progress::new(Box::new(Bars { all: BARS.clone(), current: None, stage: None })),
    }
}

/// All bars; the program has one terminal.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// Runs code that prints on stderr while the bars are hidden.
pub(crate) fn above<T>(print: impl FnOnce() -> T) -> T {
    BARS.suspend(print)
}

/// One bar per line of work, on stderr, if that is a terminal.
struct Bars {
    all: MultiProgress,
    current: Option<ProgressBar>,
    /// Name and start of the stage, with --verbose.
    stage: Option<(String, Instant)>,
}

impl Observer for Bars {
    fn begin(&mut self, group: &str, stage: &str, steps: usize) {
        let bar = match steps {
            0 => self.all.add(ProgressBar::new_spinner()),
            steps => self.all.add(ProgressBar::new(steps as u64)),
        };
        let columns = console::Term::stderr().size_checked().map(|(_, columns)| columns);
        if let Ok(style) = ProgressStyle::with_template(template(steps, columns)) {
            bar.set_style(style);
        }
        let name = match group {
            "" => stage.to_owned(),
            group => format!("{group}: {stage}"),
        };
        self.stage = terminal::flags().is_verbose.then(|| (name.clone(), Instant::now()));
        bar.set_message(name);
        bar.enable_steady_tick(Duration::from_millis(100));
        self.current = Some(bar);
    }

    fn length(&mut self, steps: usize) {
        self.current.iter().for_each(|bar| bar.set_length(steps as u64));
    }

    fn position(&mut self, done: usize) {
        self.current.iter().for_each(|bar| bar.set_position(done as u64));
    }

    fn message(&mut self, text: &str) {
        self.current.iter().for_each(|bar| bar.set_message(printable(text).into_owned()));
    }

    fn end(&mut self) {
        self.current.take().iter().for_each(ProgressBar::finish_and_clear);
        if let Some((name, start)) = self.stage.take() {
            let seconds = start.elapsed().as_secs_f64();
            self.all.suspend(|| eprintln!("eit: {}: {seconds:.3} s", printable(&name)));
        }
    }

    fn note(&mut self, text: &str) {
        self.all.suspend(|| eprintln!("eit: note: {}", printable(text)));
    }

    fn beside(&self) -> Box<dyn Observer> {
        Box::new(Self { all: self.all.clone(), current: None, stage: None })
    }
}

/// Returns the template of a line; on a narrow terminal, where a bar has no room beside its text, the text is truncated.
fn template(steps: usize, columns: Option<u16>) -> &'static str {
    match (steps, columns.is_some_and(|columns| columns < 60)) {
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

    /// A terminal that records its output.
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

    /// No line is wider than the terminal, however narrow, and none is coloured.
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
                    // only padding may reach the edge
                    let wide = line.trim_end().chars().count();
                    assert!(wide <= usize::from(columns), "{columns} columns: {line:?}");
                }
            }
        }
    }
}
