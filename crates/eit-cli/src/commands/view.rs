//! The latest image and its touches, on a terminal or as a picture that is redrawn continuously.

use super::frame_rate::FrameRate;
use crate::commands::prelude::*;
use eit_inverse::touch::TouchState;
use eit_picture::{ColorMap, FrameLabels, PictureSettings, SkinDrawing, draw_sheet};
use eit_skin::live::{LiveImages, LiveModel, TouchFrame};
use eit_skin::text::printable;
use ndarray::{ArrayView2, Axis};
use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::Write as _;

/// Colour range, steady over 50 frames: their largest value, and at least twice the weakest touch, so that noise
/// stays pale.
#[derive(Debug, Default)]
struct Range {
    largest: VecDeque<f64>,
}

impl Range {
    /// Returns the range after an image; `level_s` is the conductivity change of the faintest touch.
    fn of(&mut self, images: &LiveImages, level_s: f64) -> f64 {
        let size = images.pixels().iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        self.largest.push_back(size);
        if self.largest.len() > 50 {
            self.largest.pop_front();
        }
        let largest = self.largest.iter().copied().fold(0.0, f64::max);
        largest.max(2.0 * level_s)
    }
}

/// A PNG file of the latest image, replaced atomically.
pub(super) struct Picture {
    path: PathBuf,
    skin: Option<SkinDrawing>,
    range: Range,
    last: Option<Instant>,
}

impl Picture {
    /// Creates a picture at this path, which must be writable.
    pub(super) fn new(path: &Path) -> Result<Self, CliError> {
        OutFile::new(path)?;
        Ok(Self { path: path.to_path_buf(), skin: None, range: Range::default(), last: None })
    }

    /// Draws the picture if the last one is old enough.
    pub(super) fn show(
        &mut self,
        model: &LiveModel,
        shown: &TouchFrame<'_>,
    ) -> Result<(), CliError> {
        let Some(images) = shown.images else { return Ok(()) };
        let range = self.range.of(images, shown.level_s);
        if self.last.is_some_and(|last| last.elapsed() < Duration::from_millis(200)) {
            return Ok(());
        }
        let raster = images.raster();
        let mesh = &model.skin().mesh;
        let skin = self.skin.get_or_insert_with(|| SkinDrawing::from_raster(mesh, raster));
        let marks = shown.touches.iter().filter(|touch| touch.valid);
        let label = format!("frame {}, {:.2} s", shown.sequence, shown.time_s);
        let settings = PictureSettings {
            title: model.skin().name.clone(),
            footnote: images.description().to_owned(),
            labels: FrameLabels::Text(vec![label]),
            range: Some([-range, range]),
            marks_m: vec![marks.map(|t| [t.position_m[0], t.position_m[1]]).collect()],
            ..Default::default()
        };
        let image = raster.image_from_pixels(images.pixels())?.insert_axis(Axis(0));
        let sheet = draw_sheet(image.view(), skin, &settings)?;
        OutFile::new(&self.path)?.write(|out| Ok(sheet.write_png(out)?))?;
        self.last = Some(Instant::now());
        Ok(())
    }
}

/// The view on a terminal; does nothing if stdout is not a terminal.
#[derive(Default)]
pub(super) struct Terminal {
    pub(super) is_on: bool,
    range: Range,
    last: Option<Instant>,
    rate: FrameRate,
    /// Number of lost frames.
    pub(super) lost: u64,
    /// Text shown last.
    shown: String,
    /// The first notes that were printed on stderr and stay: the summary need not repeat them.
    pub(super) printed: Vec<String>,
}

impl Terminal {
    /// Creates a view on stdout if that is a terminal and not reserved for an answer.
    pub(super) fn new(is_wanted: bool) -> Self {
        use std::io::IsTerminal as _;
        Self { is_on: is_wanted && std::io::stdout().is_terminal(), ..Self::default() }
    }

    /// Shows progress while the reference is taken.
    pub(super) fn waiting(&mut self, left: usize) {
        if self.is_on {
            self.say(&format!("do not touch the skin: {left} more frames for the reference\n"));
        }
    }

    /// Reports something to the user at once; on a terminal the view shows it.
    pub(super) fn news(&mut self, words: &str) {
        if self.is_on {
            self.say(&format!("{}{}\n", self.shown, printable(words)));
        } else if !terminal::flags().is_quiet {
            eprintln!("eit: note: {}", printable(words));
            // as many as a summary has: a broken line repeats the same note all day
            if self.printed.len() < 100 && !self.printed.iter().any(|note| note == words) {
                self.printed.push(words.to_owned());
            }
        }
    }

    /// Shows a silence: the picture is outdated.
    pub(super) fn silent(&mut self, silence: Duration) {
        if !self.is_due() {
            return;
        }
        self.rate.interrupt();
        let silent_s = silence.as_secs_f64();
        let words = "check its power and cable; the picture is outdated";
        self.say(&format!("{}NO FRAME for {silent_s:.1} s: {words}\n", self.shown));
    }

    /// Whether the view is on and the last one is old enough; the next one is counted from now on.
    fn is_due(&mut self) -> bool {
        let is_old = |last: Instant| last.elapsed() >= Duration::from_millis(100);
        let is_due = self.is_on && self.last.is_none_or(is_old);
        self.last = if is_due { Some(Instant::now()) } else { self.last };
        is_due
    }

    /// Draws the view if the last one is old enough.
    pub(super) fn show(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        self.rate.frame(Instant::now());
        let range = shown.images.map(|images| self.range.of(images, shown.level_s));
        if !self.is_due() {
            return Ok(());
        }
        let mut text = match (shown.images, range) {
            (Some(images), Some(range)) => {
                let is_colored = terminal::is_colored(&std::io::stdout());
                let image = images.raster().image_from_pixels(images.pixels())?;
                blocks(image.view(), range, is_colored)
            }
            _ => String::new(),
        };
        let rate_hz = self.rate.recent_hz().unwrap_or_default();
        let latency =
            shown.latency_s.map_or(String::new(), |s| format!(", latency {:.1} ms", 1e3 * s));
        // writing to a String cannot fail
        let (frame, lost) = (shown.sequence, self.lost);
        let _ = writeln!(text, "frame {frame}, {rate_hz:.1} per second, {lost} lost{latency}");
        if let Some(why) = shown.state.why_not_known() {
            let _ = writeln!(text, "not known: {why}");
        }
        for touch in shown.touches.iter().filter(|touch| touch.state != TouchState::End) {
            let [x, y, _] = touch.position_m.map(|part| 1e3 * part);
            let _ = writeln!(
                text,
                "touch {}: x {x:.1} mm, y {y:.1} mm, {:.2e} S m2{}{}{}",
                touch.id,
                touch.intensity_s_m2,
                match (touch.force_n(), touch.force_std_n()) {
                    (Some(force_n), Some(std_n)) => format!(", {force_n:.2} N +- {std_n:.2}"),
                    _ => String::new(),
                },
                if touch.valid { "" } else { " (uncertain)" },
                match touch.learnt {
                    Some(learnt) if learnt.is_unlike => " (unlike every press that was learnt)",
                    _ => "",
                }
            );
        }
        self.say(&text);
        self.shown = text;
        Ok(())
    }

    /// Clears the terminal and writes; a terminal that has gone away is not an error.
    fn say(&self, text: &str) {
        let mut out = std::io::stdout().lock();
        let _ = write!(out, "\x1b[H\x1b[J{text}").and_then(|()| out.flush());
    }
}

/// Draws an image in at most 44 columns of characters, each of which shows two pixels.
fn blocks(image: ArrayView2<'_, f64>, range: f64, is_colored: bool) -> String {
    let (rows, columns) = image.dim();
    let step = (columns.max(rows) as f64 / 44.0).max(1.0);
    let at = |row: usize, column: usize| {
        let [i, j] = [row, column].map(|index| ((index as f64 + 0.5) * step) as usize);
        image.get([i, j]).copied().filter(|value| value.is_finite())
    };
    let [high, wide] = [rows, columns].map(|count| (count as f64 / step) as usize);
    let mut text = String::new();
    for row in (0..high).step_by(2) {
        for column in 0..wide {
            let paint = |value: Option<f64>, ground: u8| match value {
                Some(value) => {
                    let [r, g, b] = ColorMap::CoolWarm.color(0.5 + 0.5 * value / range);
                    format!("\x1b[{ground}8;2;{r};{g};{b}m")
                }
                None => format!("\x1b[{ground}9m"),
            };
            let (upper, lower) = (at(row, column), at(row + 1, column));
            if !is_colored {
                text.push(shade(upper.into_iter().chain(lower), range));
                continue;
            }
            let sign = if upper.is_none() && lower.is_none() { ' ' } else { '\u{2580}' };
            // writing to a String cannot fail
            let _ = write!(text, "{}{}{sign}", paint(upper, 3), paint(lower, 4));
        }
        text += if is_colored { "\x1b[0m\n" } else { "\n" };
    }
    text
}

/// The character of the stronger of two values, for terminals without colours: a rise or a fall.
fn shade(values: impl Iterator<Item = f64>, range: f64) -> char {
    let value =
        values.fold(0.0, |most: f64, value| if value.abs() > most.abs() { value } else { most });
    let step = ((value.abs() / range).min(1.0) * 4.0).round() as usize;
    let shades = if value < 0.0 { " .-=#" } else { " \u{2591}\u{2592}\u{2593}\u{2588}" };
    shades.chars().nth(step).unwrap_or(' ')
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn characters_hold_two_rows_and_leave_out_what_is_no_skin() {
        let image = array![[1.0, f64::NAN], [-1.0, f64::NAN]];
        let text = blocks(image.view(), 1.0, true);
        assert_eq!(text.lines().count(), 1);
        assert_eq!(text.matches('\u{2580}').count(), 1, "{text:?}");
        let [red, blue] = [1.0, 0.0].map(|at| ColorMap::CoolWarm.color(at));
        let wanted = format!(
            "\x1b[38;2;{};{};{}m\x1b[48;2;{};{};{}m\u{2580}",
            red[0], red[1], red[2], blue[0], blue[1], blue[2]
        );
        assert!(text.starts_with(&wanted), "{text:?}");
        // without colours: no escape, and what rises differs from what falls
        let image = array![[1.0, -1.0, 0.5, f64::NAN], [0.2, 0.0, 0.0, f64::NAN]];
        let plain = blocks(image.view(), 1.0, false);
        assert_eq!(plain.lines().next(), Some("\u{2588}#\u{2592} "), "{plain:?}");
        assert!(!plain.contains('\x1b'));
    }
}
