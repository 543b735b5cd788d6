//! Whether confidence is calibrated: for touches of simulated recordings, compares the confidence
//! with the fraction of touches near a finger.

use super::super::table::{Cell, Table};
use super::grid::Grid;
use super::script_recording::ScriptRecording;
use super::simulated_disc::{SimulatedDisc, distance_m};
use super::tracking_scores::WITHIN_M;
use crate::error::ReportError;
use crate::output::OutFolder;
use eit_fem::fabric::{FabricSettings, Instrument};
use eit_inverse::touch::TouchState;
use eit_picture::{Plot, Series, draw_plot};
use eit_skin::Progress;
use eit_skin::method::Method;
use eit_skin::touches::touches;

/// Edges of the confidence bins.
const EDGES: [f64; 8] = [0.0, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0];
/// Scripts with the seeds for their randomness and that of the fabric. With `--quick`, only the
/// last.
const SCRIPTS: [(&str, u64); 6] = [
    ("paper-one-finger", 701),
    ("paper-two-fingers", 702),
    ("stroking", 703),
    ("tapping", 704),
    ("closing-in", 705),
    ("random", 706),
];
/// Noise of the instrument, volts: 87 and 67 dB below the root mean square of the reference. With
/// little noise, few touches are uncertain.
const NOISE_V: [f64; 2] = [2e-5, 2e-4];
/// Quantile of the normal distribution for a two-sided 95 % interval.
const WITH_95: f64 = 1.96;

/// A touch reported to a robot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Told {
    /// Its confidence.
    pub confidence: f64,
    /// Whether it is near a finger.
    pub is_true: bool,
    /// Whether any finger is on the skin.
    pub is_touched: bool,
}

/// Touches in a bin.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Bin {
    count: usize,
    true_ones: usize,
    said: f64,
}

impl Bin {
    fn of<'a>(told: impl Iterator<Item = &'a Told>) -> Self {
        told.fold(Self::default(), |bin, told| Self {
            count: bin.count + 1,
            true_ones: bin.true_ones + usize::from(told.is_true),
            said: bin.said + told.confidence,
        })
    }

    /// Mean confidence; NaN for an empty bin.
    fn mean_said(&self) -> f64 {
        self.said / self.count as f64
    }

    /// Fraction of the touches that are true.
    fn part(&self) -> f64 {
        self.true_ones as f64 / self.count as f64
    }

    /// 95 % interval of that fraction, by Wilson's score: with the fraction `p` of `n` and
    /// `z = 1.96`, `(p + z^2 / 2n +- z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n)`. Touches
    /// of one press are correlated, so the interval is too narrow rather than too wide.
    fn interval(&self) -> [f64; 2] {
        let (n, p, z) = (self.count as f64, self.part(), WITH_95);
        let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        [-1.0, 1.0].map(|sign| (p + z * z / (2.0 * n) + sign * half) / (1.0 + z * z / n))
    }

    fn cells(&self, name: String) -> Vec<Cell> {
        let count = |count: usize| Cell::Number(count as f64, 0);
        vec![
            Cell::Text(name),
            count(self.count - self.true_ones),
            count(self.count),
            Cell::Number(self.mean_said(), 3),
            Cell::Number(self.part(), 3),
        ]
    }
}

/// Confidence bins that contain touches, with their names.
fn bins(told: &[Told]) -> Vec<(String, Bin)> {
    let edges = EDGES.iter().zip(&EDGES[1..]);
    let bins = edges.map(|(&low, &high)| {
        let is_last = high >= 1.0;
        let within = |t: &&Told| t.confidence >= low && (t.confidence < high || is_last);
        (format!("said {low} to {high}"), Bin::of(told.iter().filter(within)))
    });
    bins.filter(|(_, bin)| bin.count > 0).collect()
}

/// Scripts of a run.
fn scripts(grid: &Grid) -> &'static [(&'static str, u64)] {
    if grid.all_scripts { &SCRIPTS } else { &SCRIPTS[SCRIPTS.len() - 1..] }
}

/// Number of steps of [`measure`].
pub(super) fn steps(grid: &Grid) -> usize {
    scripts(grid).len() * NOISE_V.len()
}

/// Returns the touches of all recordings after their quiet frames.
pub(super) fn measure(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Vec<Told>, ReportError> {
    let mut told = Vec::new();
    for &(script, seed) in scripts(grid) {
        for noise_v in NOISE_V {
            let instrument = Instrument { noise_v: [noise_v; 2], ..Instrument::default() };
            let fabric = FabricSettings { instrument, ..FabricSettings::default() };
            let most = grid.reliability_frames;
            let recording = ScriptRecording::simulate(disc, script, seed, &fabric, most)?;
            told.extend(told_of(disc, &recording)?);
            bar.inc();
        }
    }
    Ok(told)
}

/// Detects touches in a recording as `eit reconstruct` does.
fn told_of(disc: &SimulatedDisc, recording: &ScriptRecording) -> Result<Vec<Told>, ReportError> {
    let chain = recording.chain(disc, Method::GaussNewton, None)?;
    let mut made = chain.reconstruct(&recording.simulation.frames_v)?;
    made.fitted.frames.rate_hz = Some(recording.script.frame_rate_hz);
    let found = touches(&made.fitted, &mut Progress::silent())?;
    let Some(found) = found else {
        return Err(ReportError::Failure("the noise of simulated frames is unknown".to_owned()));
    };
    let acted_on = found.rows.iter().filter(|row| {
        let is_alive = row.touch.valid && row.touch.state != TouchState::End;
        is_alive && row.frame >= recording.script.quiet_frames
    });
    let told = acted_on.map(|row| {
        let present = recording.present(row.frame);
        let is_near = |place| distance_m(row.touch.position_m, place) <= WITHIN_M;
        Told {
            confidence: row.touch.confidence,
            is_true: present.iter().any(|finger| is_near(finger.position_m)),
            is_touched: !present.is_empty(),
        }
    });
    Ok(told.collect())
}

/// Creates the table, starting with touches that should not exist.
pub(super) fn table(grid: &Grid, told: &[Told]) -> Table {
    let untouched = Bin::of(told.iter().filter(|told| !told.is_touched));
    let mut rows = vec![
        untouched.cells("while nothing touched the skin".to_owned()),
        Bin::of(told.iter()).cells("all".to_owned()),
    ];
    rows.extend(bins(told).into_iter().map(|(name, bin)| bin.cells(name)));
    let names: Vec<&str> = scripts(grid).iter().map(|(name, _)| *name).collect();
    Table {
        name: "reliability",
        title: "Is the confidence of touches calibrated?",
        note: format!(
            "All touches reported to a robot, in each frame, and whether a finger was within {:.0} \
             mm. Without a finger: touches reported although nothing was there, which should not \
             happen. The confidence is the expected fraction of true touches: of those with \
             confidence 0.9, nine in ten should have a finger. Simulated fabric with all its \
             defaults, scripts {}, {} frames each at most, noise of {:.0} and {:.0} uV; touches as \
             detected by `eit reconstruct` with default settings. For each range: the mean \
             confidence, and the fraction that came true.",
            1e3 * WITHIN_M,
            names.join(", "),
            grid.reliability_frames,
            1e6 * NOISE_V[0],
            1e6 * NOISE_V[1],
        ),
        columns: vec!["touches", "without a finger", "reported", "said", "came true"],
        rows,
    }
}

/// Draws the reliability diagram; nothing if there are no touches.
pub(super) fn draw(told: &[Told], out: &mut OutFolder) -> Result<(), ReportError> {
    let bins: Vec<Bin> = bins(told).into_iter().map(|(_, bin)| bin).collect();
    let Some(first) = bins.first() else { return Ok(()) };
    let curve = |name: &str, markers, y: &dyn Fn(&Bin) -> f64| Series {
        name: name.to_owned(),
        points: bins.iter().map(|bin| [bin.mean_said(), y(bin)]).collect(),
        line: true,
        markers,
    };
    let lowest = first.mean_said();
    let as_said = Series {
        name: "calibrated".to_owned(),
        points: vec![[lowest, lowest], [1.0, 1.0]],
        line: true,
        markers: false,
    };
    let counts: Vec<String> = bins.iter().map(|bin| bin.count.to_string()).collect();
    let picture = draw_plot(&Plot {
        title: "Touches: confidence and fraction of true touches".to_owned(),
        footnote: format!(
            "Number of touches per point, from the left: {}. Above the line, the confidence is too \
             low; below it, too high.",
            counts.join(", ")
        ),
        x_label: "confidence".to_owned(),
        y_label: format!("fraction with a finger within {:.0} mm", 1e3 * WITHIN_M),
        x_log: false,
        y_log: false,
        series: vec![
            curve("came true", true, &Bin::part),
            as_said,
            curve("95 % interval, from", false, &|bin| bin.interval()[0]),
            curve("95 % interval, to", false, &|bin| bin.interval()[1]),
        ],
        zoom: 2,
    })?;
    out.write("reliability.png", |w| Ok(picture.write_png(w)?))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::float_cmp, reason = "sums of these few numbers are exact")]

    use super::*;

    fn told(confidence: f64, is_true: bool) -> Told {
        Told { confidence, is_true, is_touched: true }
    }

    /// Each touch is in exactly one bin, including those at the edges and at 0 and 1; empty bins
    /// are omitted.
    #[test]
    fn every_touch_is_in_one_bin() {
        let all: Vec<Told> = [0.0, 0.8, 0.9, 0.999, 1.0].map(|c| told(c, c > 0.85)).to_vec();
        let found: Vec<_> = bins(&all).into_iter().map(|(name, bin)| (name, bin.count)).collect();
        let wanted = [("0 to 0.8", 1), ("0.8 to 0.9", 1), ("0.9 to 0.95", 1), ("0.999 to 1", 2)];
        assert_eq!(found, wanted.map(|(name, count)| (format!("said {name}"), count)));
        let whole = Bin::of(all.iter());
        assert_eq!((whole.count, whole.true_ones), (5, 3));
        assert_eq!(whole.part(), 0.6);
    }

    /// Wilson's interval for 8 of 10 and 10 of 10: 0.490 to 0.943 and 0.722 to 1 (calculated by
    /// hand).
    #[test]
    fn intervals_are_those_of_wilson() {
        let of = |true_ones| Bin { count: 10, true_ones, said: 9.0 }.interval();
        for (found, wanted) in of(8).into_iter().chain(of(10)).zip([0.4902, 0.9433, 0.7225, 1.0]) {
            // four digits are given
            assert!((found - wanted).abs() < 1e-4, "{found} {wanted}");
        }
    }

    /// Touches that should not exist come first, and those without a finger are counted separately.
    #[test]
    fn touches_without_a_finger_come_first() {
        let ghost = Told { confidence: 0.85, is_true: false, is_touched: false };
        let table =
            table(&super::super::grid::QUICK, &[ghost, told(0.97, true), told(0.97, false)]);
        assert_eq!(table.columns[1], "without a finger");
        let firsts: Vec<&[Cell]> = table.rows.iter().map(|row| &row[1..3]).collect();
        let counts = |without: f64, reported: f64| [without, reported].map(|n| Cell::Number(n, 0));
        assert_eq!(firsts[0], counts(1.0, 1.0));
        assert_eq!(firsts[1], counts(2.0, 3.0));
        // bins of 0.8 to 0.9 and of 0.95 to 0.98
        assert_eq!(firsts[2..], [counts(1.0, 1.0), counts(1.0, 2.0)]);
    }
}
