//! Electrode movement in the inverse problem: images and touches of the simulated fabric with and
//! without `reconstruction.electrode_movement_m`, and its cost when nothing moves.

use crate::Result;
use crate::recording::{Finger, Recording, Simulator, WITHIN_M, distance_m, valid_touches};
use crate::table::{Cell, Table, quantile};
use eit_fem::fabric::{FabricSettings, Rim};
use eit_inverse::metrics::{Cells, TouchSettings, artefact_energy, touch_position_errors_m};
use eit_inverse::touch::Touch;
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::denoise::{Chain, Chained};
use eit_skin::method::Method;
use ndarray::{ArrayView2, Axis};

/// Assumed electrode movement. In these scripts it is at most 0.7 mm; its root mean square along
/// and across the rim is 0.1 to 0.16 mm.
const MOVEMENT_M: f64 = 0.2e-3;
/// A finger with less force is arriving or leaving: it need not be found, newtons.
const FULL_N: f64 = 0.7;

/// A script on a fabric: name in the table, script, seed, and whether the rim is rigid.
type Case = (&'static str, &'static str, u64, bool);

/// In the last two nothing moves, so they show the cost of allowing for movement. A quick run takes
/// the first and the last.
const CASES: [Case; 6] = [
    ("one finger", "one-finger", 601, false),
    ("two fingers", "two-fingers", 602, false),
    ("stroking", "stroking", 603, false),
    ("random", "random", 604, false),
    ("two fingers, rigid rim", "two-fingers", 605, true),
    ("one finger, rigid rim", "one-finger", 606, true),
];

/// Simulates the scripts; rows of images for each method, and of touches, without and with the
/// setting.
pub(super) fn table(simulator: &Simulator, quick: bool) -> Result<Table> {
    let frames = if quick { 50 } else { 400 };
    let mut rows = Vec::new();
    let mut moved_m = 0.0_f64;
    for &(name, script, seed, is_rigid) in CASES.iter().step_by(if quick { 5 } else { 1 }) {
        let mut fabric = FabricSettings::default();
        if is_rigid {
            fabric.rim = Rim { compliance: 0.0, contact_gain: 0.0 };
        }
        let recording = simulator.built_in(script, seed, &fabric, frames)?;
        for shift in recording.simulation.truth.electrode_shift_m.rows() {
            moved_m = moved_m.max(shift[0].hypot(shift[1]));
        }
        for movement_m in [None, Some(MOVEMENT_M)] {
            let key = movement_m.map_or("-".to_owned(), |m| format!("{} mm", 1e3 * m));
            for method in [Method::GaussNewton, Method::StTv] {
                let chain = simulator.chain(&recording.script, method, movement_m)?;
                let made = recording.reconstruct(&chain)?;
                let label = [name, method.name(), &key].map(Cell::text);
                rows.push([label.to_vec(), image_cells(&recording, &chain, &made)?].concat());
                if method == Method::GaussNewton {
                    let label = [name, "touches", &key].map(Cell::text);
                    rows.push([label.to_vec(), touch_cells(&recording, &made)?].concat());
                }
            }
        }
    }
    Ok(Table {
        title: "Electrodes that move, taken out of the data",
        note: format!(
            "Simulated fabric with all its defaults, including the instrument (rigid rim: compliance \
             and contact gain zero), {0} nodes; at most {frames} frames of a script, {1} x {1} pixels; \
             noise from the quiet frames, no bounds. Key: reconstruction.electrode_movement_m; \
             electrodes moved by up to {2:.2} mm. Away: median fraction of an image's energy farther \
             than {3:.0} mm from every finger. Position: distance of a finger from its blob (half of \
             the largest value) or valid touch, within {3:.0} mm; found: fingers of at least {FULL_N} N \
             that have one; false: blobs or touches per frame that are no finger's. Contrast: median \
             ratio of the integral of the image within {3:.0} mm of the fingers to that of the truth. \
             Images are evaluated in frames in which every finger presses with full force, touches in \
             all frames after the quiet ones.",
            simulator.finer.mesh.surface().nodes().len(),
            simulator.raster.pixels(),
            1e3 * moved_m,
            1e3 * WITHIN_M,
        ),
        columns: vec![
            "script",
            "of",
            "key",
            "away",
            "position, mm",
            "95 %, mm",
            "found",
            "false a frame",
            "contrast",
        ],
        rows,
    })
}

/// Counts of fingers and of what was found of them.
#[derive(Default)]
struct Counts {
    fingers: usize,
    false_ones: usize,
    frames: usize,
    errors_m: Vec<f64>,
}

impl Counts {
    fn cells(&self, away: f64, contrast: f64) -> Vec<Cell> {
        let part = |count: usize, of: usize| Cell::Number(count as f64 / of as f64, 3);
        vec![
            Cell::Number(away, 3),
            Cell::Number(1e3 * quantile(&self.errors_m, 0.5), 1),
            Cell::Number(1e3 * quantile(&self.errors_m, 0.95), 1),
            part(self.errors_m.len(), self.fingers),
            part(self.false_ones, self.frames),
            Cell::Number(contrast, 2),
        ]
    }
}

/// Cells of a row about images.
fn image_cells(recording: &Recording, chain: &Chain, made: &Chained) -> Result<Vec<Cell>> {
    let raster = chain.linearised.raster(&mut Progress::silent())?;
    let cells = Cells::of_raster(raster);
    let settings = TouchSettings { within_m: WITHIN_M, ..Default::default() };
    let (mut away, mut contrast, mut counts) = (Vec::new(), Vec::new(), Counts::default());
    let mut pixels = vec![0.0; raster.masked_pixels().len()];
    for frame in recording.after_quiet() {
        let fingers = recording.fingers(frame);
        if fingers.is_empty() || fingers.iter().any(|finger| finger.force_n < FULL_N) {
            continue;
        }
        let places: Vec<[f64; 2]> = fingers.iter().map(|finger| finger.position_m).collect();
        let image = made.images.index_axis(Axis(0), frame);
        raster.pixels_from_image_into(image, &mut pixels)?;
        away.extend(artefact_energy(&pixels, &cells, &places, WITHIN_M)?);
        let found = touch_position_errors_m(&pixels, &cells, &places, &settings)?;
        counts.fingers += places.len();
        counts.frames += 1;
        counts.false_ones += found.extra;
        counts.errors_m.extend(found.errors_m.into_iter().flatten());
        let truth = &recording.simulation.truth.conductivity_change_s;
        let truth = truth.index_axis(Axis(0), frame);
        let [image, truth] = [image, truth].map(|image| near(raster, image, &places));
        contrast.push(image / truth);
    }
    Ok(counts.cells(quantile(&away, 0.5), quantile(&contrast, 0.5)))
}

/// Cells of a row about touches.
fn touch_cells(recording: &Recording, made: &Chained) -> Result<Vec<Cell>> {
    let touches = valid_touches(made)?;
    let mut counts = Counts::default();
    for frame in recording.after_quiet() {
        let fingers = recording.fingers(frame);
        counts.frames += 1;
        counts.fingers += fingers.iter().filter(|finger| finger.force_n >= FULL_N).count();
        count_pairs(&fingers, &touches[frame], &mut counts);
    }
    Ok(counts.cells(f64::NAN, f64::NAN))
}

/// Pairs touches with fingers, nearest first. A touch of an arriving or leaving finger is not false;
/// a second touch on a finger is.
fn count_pairs(fingers: &[Finger], touches: &[Touch], counts: &mut Counts) {
    let mut pairs = Vec::new();
    for (f, finger) in fingers.iter().enumerate() {
        for (t, touch) in touches.iter().enumerate() {
            pairs.push((distance_m(touch.position_m, finger.position_m), f, t));
        }
    }
    pairs.retain(|(distance_m, ..)| *distance_m <= WITHIN_M);
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut has_touch, mut has_finger) = (vec![false; fingers.len()], vec![false; touches.len()]);
    for (distance_m, f, t) in pairs {
        if !(has_touch[f] || has_finger[t]) {
            (has_touch[f], has_finger[t]) = (true, true);
            if fingers[f].force_n >= FULL_N {
                counts.errors_m.push(distance_m);
            }
        }
    }
    counts.false_ones += has_finger.iter().filter(|has| !**has).count();
}

/// Sums the pixels of an image near any of the given positions.
fn near(raster: &Raster, image: ArrayView2<'_, f64>, places: &[[f64; 2]]) -> f64 {
    let is_near = |[i, j]: [usize; 2]| {
        let [x, y] = raster.centre_m(i, j);
        places.iter().any(|place| (x - place[0]).hypot(y - place[1]) <= WITHIN_M)
    };
    let pixels = raster.masked_pixels().iter().filter(|pixel| is_near(**pixel));
    pixels.map(|pixel| image[*pixel]).filter(|value| value.is_finite()).sum()
}
