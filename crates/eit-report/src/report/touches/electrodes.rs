//! Electrode movement in the inverse problem: images and touches of the simulated fabric with and
//! without `reconstruction.electrode_movement_m`, and its cost when nothing moves.

use super::super::statistics::quantile;
use super::super::table::{Cell, Table};
use super::grid::Grid;
use super::script_recording::ScriptRecording;
use super::simulated_disc::SimulatedDisc;
use super::tracking_scores::{FULL_N, TrackingScores, WITHIN_M};
use crate::error::ReportError;
use eit_fem::fabric::{FabricSettings, Rim};
use eit_inverse::metrics::{Cells, TouchSettings, artefact_energy, touch_position_errors_m};
use eit_inverse::touch::Touch;
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::denoise::{Chain, Chained};
use eit_skin::method::Method;
use eit_skin::touches::touches;
use ndarray::{ArrayView2, Axis};

/// Assumed electrode movement. In these scripts it is at most 0.7 mm; its root mean square along
/// and across the rim is 0.1 to 0.16 mm.
const MOVEMENT_M: f64 = 0.2e-3;
/// Methods whose images are evaluated.
const METHODS: [Method; 2] = [Method::GaussNewton, Method::StTv];

/// A script on a fabric.
struct Case {
    name: &'static str,
    script: &'static str,
    seed: u64,
    rigid: bool,
}

const fn case(name: &'static str, script: &'static str, seed: u64, rigid: bool) -> Case {
    Case { name, script, seed, rigid }
}

/// The scripts of `eit demo` and `eit report`; in the last two nothing moves, so they show the cost
/// of allowing for movement. With `--quick`, only the first and the last.
const CASES: [Case; 6] = [
    case("one finger", "paper-one-finger", 601, false),
    case("two fingers", "paper-two-fingers", 602, false),
    case("stroking", "stroking", 603, false),
    case("random", "random", 604, false),
    case("two fingers, rigid rim", "paper-two-fingers", 605, true),
    case("one finger, rigid rim", "paper-one-finger", 606, true),
];

/// Number of steps of the table.
pub(super) fn steps(grid: &Grid) -> usize {
    cases(grid).count() * 2 * METHODS.len()
}

fn cases(grid: &Grid) -> impl Iterator<Item = &'static Case> {
    let skipped = if grid.all_scripts { 1 } else { CASES.len() - 1 };
    CASES.iter().step_by(skipped)
}

/// Creates the table: rows of images for each method, and of touches, without and with the setting.
pub(super) fn table(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Table, ReportError> {
    let mut rows = Vec::new();
    let mut moved_m = 0.0_f64;
    for case in cases(grid) {
        let mut fabric = FabricSettings::default();
        if case.rigid {
            fabric.rim = Rim { compliance: 0.0, contact_gain: 0.0 };
        }
        let Case { script, seed, .. } = *case;
        let recording = ScriptRecording::simulate(disc, script, seed, &fabric, grid.script_frames)?;
        moved_m = moved_m.max(recording.moved_m());
        for movement_m in [None, Some(MOVEMENT_M)] {
            let key = movement_m.map_or("-".to_owned(), |m| format!("{} mm", 1e3 * m));
            for method in METHODS {
                let chain = recording.chain(disc, method, movement_m)?;
                let mut made = chain.reconstruct(&recording.simulation.frames_v)?;
                made.fitted.frames.rate_hz = Some(recording.script.frame_rate_hz);
                let label = [case.name, method.name(), &key].map(Cell::text);
                rows.push([label.to_vec(), recording.image_cells(&chain, &made)?].concat());
                if method == Method::GaussNewton {
                    let label = [case.name, "touches", &key].map(Cell::text);
                    rows.push([label.to_vec(), recording.touch_cells(&made)?].concat());
                }
                bar.inc();
            }
        }
    }
    Ok(Table {
        name: "electrodes",
        title: "Movement of electrodes inside the inverse",
        note: format!(
            "Simulated fabric with all its defaults, including the instrument (rigid rim: \
             compliance and contact gain zero), {0} nodes; at most {1} frames of a script, {2} x \
             {2} pixels; noise from the quiet frames, no bounds. Key: \
             reconstruction.electrode_movement_m; electrodes moved by up to {3:.2} mm. Away: \
             median fraction of an image's energy farther than {4:.0} mm from every finger. \
             Position: distance of a finger from its blob (half of the largest value) or touch, \
             within {4:.0} mm; found: fingers of at least {FULL_N} N that have one; invented: \
             false blobs or touches per frame. Contrast: median ratio of the integral of the image \
             within {4:.0} mm of the fingers to that of the truth. Touches: as detected by `eit \
             reconstruct` from the frames. Images are evaluated in frames in which every finger \
             presses with full force, touches in all frames after the quiet ones.",
            disc.simulation.mesh.surface().nodes().len(),
            grid.script_frames,
            disc.model.raster.pixels(),
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
            "invented a frame",
            "contrast",
        ],
        rows,
    })
}

impl ScriptRecording {
    /// Returns the cells of a row about images.
    fn image_cells(&self, chain: &Chain, made: &Chained) -> Result<Vec<Cell>, ReportError> {
        let raster = chain.linearised.raster(&mut Progress::silent())?;
        let cells = Cells::of_raster(raster);
        let settings = TouchSettings { within_m: WITHIN_M, ..Default::default() };
        let (mut away, mut contrast, mut errors_m) = (Vec::new(), Vec::new(), Vec::new());
        let (mut fingers, mut invented, mut frames) = (0, 0, 0);
        let mut pixels = vec![0.0; raster.masked_pixels().len()];
        for frame in self.script.quiet_frames..self.script.frames {
            let present = self.present(frame);
            if present.is_empty() || present.iter().any(|finger| !finger.is_full) {
                continue;
            }
            let places: Vec<[f64; 2]> = present.iter().map(|finger| finger.position_m).collect();
            let image = made.images.index_axis(Axis(0), frame);
            raster.pixels_from_image_into(image, &mut pixels)?;
            away.extend(artefact_energy(&pixels, &cells, &places, WITHIN_M)?);
            let found = touch_position_errors_m(&pixels, &cells, &places, &settings)?;
            (fingers, frames) = (fingers + places.len(), frames + 1);
            invented += found.extra;
            errors_m.extend(found.errors_m.into_iter().flatten());
            let truth = &self.simulation.truth.conductivity_change_s;
            let truth = truth.index_axis(Axis(0), frame);
            let [image, truth] = [image, truth].map(|image| near(raster, image, &places));
            contrast.push(image / truth);
        }
        let part = |count: usize, of: usize| count as f64 / of as f64;
        Ok(vec![
            Cell::Number(quantile(&away, 0.5), 3),
            Cell::Number(1e3 * quantile(&errors_m, 0.5), 1),
            Cell::Number(1e3 * quantile(&errors_m, 0.95), 1),
            Cell::Number(part(errors_m.len(), fingers), 3),
            Cell::Number(part(invented, frames), 3),
            Cell::Number(quantile(&contrast, 0.5), 2),
        ])
    }

    /// Returns the cells of a row about touches.
    fn touch_cells(&self, made: &Chained) -> Result<Vec<Cell>, ReportError> {
        let found = touches(&made.fitted, &mut Progress::silent())?;
        let Some(found) = found else {
            return Err(ReportError::Failure(
                "the noise of simulated frames is unknown".to_owned(),
            ));
        };
        let mut scores = TrackingScores::default();
        for frame in self.script.quiet_frames..self.script.frames {
            let of_frame = found.rows.iter().filter(|row| row.frame == frame);
            let touches: Vec<Touch> = of_frame.map(|row| row.touch).collect();
            scores.add(&self.present(frame), &touches);
        }
        Ok(vec![
            Cell::Number(f64::NAN, 3),
            Cell::Number(1e3 * quantile(&scores.errors_m, 0.5), 1),
            Cell::Number(1e3 * quantile(&scores.errors_m, 0.95), 1),
            Cell::Number(scores.found as f64 / scores.fingers as f64, 3),
            Cell::Number(scores.false_touches as f64 / scores.frames as f64, 3),
            Cell::Number(f64::NAN, 2),
        ])
    }
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
