//! Images of both experiments: by equation (7), through the nets of the two trainings, and by this program's defaults.

use super::{EXPERIMENTS, Experiment, SNAPSHOTS, Shown};
use crate::error::ReportError;
use eit_core::median;
use eit_denoise::{Denoiser, ImageStack, ThresholdRule, Weights};
use eit_fem::fabric::TrueTouch;
use eit_mesh::Raster;
use eit_skin::scene::{DenoiseSettings, Scene};
use eit_skin::simulate::SimulatedRecording;
use eit_skin::{MeanPressure, MeshOverride, Progress, Reconstruction, Skin};
use ndarray::{Array3, ArrayView2, Axis};
use std::path::Path;
use std::time::Instant;

/// Distance within which an image shows a finger, metres: the width of a fingertip.
const NEAR_M: f64 = 0.02;
/// Share of the strongest pixel before a net that is left where a finger is still shown.
const SHOWN: f64 = 0.2;

/// Images of a recording, and how far they are from the wanted images of the rule and from the truth.
pub(super) struct Imaged {
    /// Siemens, [frame, row, column].
    pub values: Array3<f64>,
    pub raster: Raster,
    /// Mean squared error of each frame to the rule's wanted image, siemens squared.
    pub to_rule_s2: Vec<f64>,
    /// The same to the truth.
    pub to_truth_s2: Vec<f64>,
    /// The same before the U-net of the defaults; empty without it.
    pub raw_to_truth_s2: Vec<f64>,
    /// Pressures, where forces are known.
    pub pressed: Option<Pressed>,
    /// Touches of each frame as seen from +z, metres.
    pub marks_m: Vec<Vec<[f64; 2]>>,
    /// Computing time, seconds.
    pub time_s: f64,
}

/// Pressures of a recording.
#[derive(Clone)]
pub(super) struct Pressed {
    /// Pascal, [frame, row, column].
    pub images_pa: Array3<f64>,
    /// Touches with a pressure: frame, place in metres, and mean pressure.
    pub touches: Vec<(usize, [f64; 2], MeanPressure)>,
}

/// Images without their errors.
#[derive(Clone)]
struct Made {
    values: Array3<f64>,
    /// Images before the U-net, if there is one.
    raw: Option<Array3<f64>>,
    raster: Raster,
    pressed: Option<Pressed>,
    marks_m: Vec<Vec<[f64; 2]>>,
    time_s: f64,
}

/// Reconstructs both recordings in both forms, on two threads, and runs the nets.
pub(super) fn of_both(
    recordings: [SimulatedRecording; 2],
    skin: &Skin,
    nets: &[Weights; 2],
    learned: &Path,
    progress: &mut Progress,
) -> Result<[Shown; 2], ReportError> {
    let defaults = defaults(skin.pixels(), learned, progress)?;
    let [one, two] = &recordings;
    let mut beside = progress.beside();
    // the first experiment by equation (7) takes as long as the other three
    let (one_7, [two_7, one_default, two_default]) = std::thread::scope(|scope| {
        let one_7 = scope.spawn(|| reconstruct(one, skin, &mut beside));
        let others = [(two, skin), (one, &defaults), (two, &defaults)]
            .map(|(recording, skin)| reconstruct(recording, skin, progress));
        (one_7.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), others)
    });
    let [one, two] = recordings;
    Ok([
        shown(EXPERIMENTS[0], one, [one_7?, one_default?], nets)?,
        shown(EXPERIMENTS[1], two, [two_7?, two_default?], nets)?,
    ])
}

/// The skin with this program's defaults: normalised differences, two weights, penalised form, the shipped net; and the
/// forces that were learnt.
fn defaults(pixels: usize, learned: &Path, progress: &mut Progress) -> Result<Skin, ReportError> {
    let mut scene = Scene::load("paper-disc")?;
    scene.reconstruction.pixels = Some(pixels);
    scene.denoise = Some(DenoiseSettings { weights: "default".to_owned(), any_skin: false });
    let learned = std::path::absolute(learned).map_err(|e| ReportError::at(learned, e))?;
    scene.touch.learned = Some(learned);
    Ok(Skin::set_up(&scene, &MeshOverride::default(), progress)?)
}

fn reconstruct(
    recording: &SimulatedRecording,
    skin: &Skin,
    progress: &mut Progress,
) -> Result<Made, ReportError> {
    let start = Instant::now();
    let skin = recording.described(skin.clone());
    let frames = skin.frames_of_values(&recording.simulation.frames_v)?;
    let count = frames.values.nrows();
    let mut made = skin.reconstruct(frames, None, progress)?;
    let raw = made.net.as_ref().map(|_| made.images.values.clone());
    made.denoise(progress)?;
    Ok(Made {
        pressed: pressed(&made)?,
        marks_m: made.touches.as_ref().map_or_else(Vec::new, |found| found.marks(count)),
        raw,
        values: made.images.values,
        raster: made.images.raster,
        time_s: start.elapsed().as_secs_f64(),
    })
}

fn pressed(made: &Reconstruction) -> Result<Option<Pressed>, ReportError> {
    let (Some(found), Some(pressures)) = (&made.touches, made.pressures()?) else {
        return Ok(None);
    };
    let rows = found.rows.iter().zip(&pressures.touches);
    let touches = rows.filter_map(|(row, mean)| {
        let [x, y, _] = row.touch.position_m;
        mean.map(|mean| (row.frame, [x, y], mean))
    });
    Ok(Some(Pressed { touches: touches.collect(), images_pa: pressures.images_pa }))
}

/// Runs the nets on the images of an experiment, and judges all images.
fn shown(
    experiment: Experiment,
    recording: SimulatedRecording,
    [equation_7, defaults]: [Made; 2],
    nets: &[Weights; 2],
) -> Result<Shown, ReportError> {
    let mask = equation_7.raster.mask().clone();
    let raw = ImageStack::new(equation_7.values.clone(), mask.clone())?;
    let wanted = ThresholdRule::default().on(mask.view())?.apply(&raw)?.into_parts().0;
    let truth = &recording.simulation.truth.conductivity_change_s;
    let through = |net: &Weights| {
        let start = Instant::now();
        let values = Denoiser::new(net, mask.view())?.denoise(&raw)?.into_parts().0;
        let made = Made { values, time_s: start.elapsed().as_secs_f64(), ..equation_7.clone() };
        Ok::<_, ReportError>(made.judged(&wanted, truth))
    };
    let [first, second] = nets.each_ref().map(through);
    let trained = [first?, second?];
    let mut touched: Vec<usize> =
        recording.simulation.truth.touches.iter().map(|touch| touch.frame).collect();
    touched.dedup();
    let snapshot = |k: usize| touched.get(k * (touched.len().max(1) - 1) / (SNAPSHOTS - 1));
    Ok(Shown {
        experiment,
        equation_7: equation_7.judged(&wanted, truth),
        defaults: defaults.judged(&wanted, truth),
        trained,
        snapshots: (0..SNAPSHOTS).filter_map(|k| snapshot(k).copied()).collect(),
        touched,
        recording,
    })
}

impl Made {
    fn judged(self, wanted: &Array3<f64>, truth: &Array3<f64>) -> Imaged {
        let errors = |images: &Array3<f64>, aim: &Array3<f64>| -> Vec<f64> {
            let pairs = images.outer_iter().zip(aim.outer_iter());
            pairs.map(|(image, aim)| squared_error(image, aim)).collect()
        };
        let Self { values, raw, raster, pressed, marks_m, time_s } = self;
        Imaged {
            to_rule_s2: errors(&values, wanted),
            to_truth_s2: errors(&values, truth),
            raw_to_truth_s2: raw.map_or_else(Vec::new, |raw| errors(&raw, truth)),
            values,
            raster,
            pressed,
            marks_m,
            time_s,
        }
    }
}

/// Mean squared error over the pixels that both images have; masks of two meshes may differ by a pixel at the rim.
pub(in super::super) fn squared_error(
    image: ArrayView2<'_, f64>,
    truth: ArrayView2<'_, f64>,
) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for off in image.iter().zip(truth).map(|(a, b)| a - b).filter(|off| off.is_finite()) {
        sum += off * off;
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

impl Shown {
    /// Root mean square error to the truth over the truth's root mean square, median of the frames with a finger.
    pub(super) fn relative_error(&self, to_truth_s2: &[f64]) -> f64 {
        let truth = &self.recording.simulation.truth.conductivity_change_s;
        let energy = |&frame: &usize| {
            let image = truth.index_axis(Axis(0), frame);
            squared_error(image, ndarray::Array2::zeros(image.dim()).view())
        };
        let of = self.touched.iter().map(|frame| (to_truth_s2[*frame] / energy(frame)).sqrt());
        median(of).unwrap_or(f64::NAN)
    }

    /// Squared error of a net's images over that of the images by equation (7), median of the frames with a finger: to
    /// the rule's wanted images, and to the truth.
    pub(super) fn over_raw(&self, imaged: &Imaged) -> [f64; 2] {
        let raw = &self.equation_7;
        [(&imaged.to_rule_s2, &raw.to_rule_s2), (&imaged.to_truth_s2, &raw.to_truth_s2)].map(
            |(made, raw)| {
                let ratios = self.touched.iter().map(|&frame| made[frame] / raw[frame]);
                median(ratios.filter(|ratio| ratio.is_finite())).unwrap_or(f64::NAN)
            },
        )
    }

    /// Share of all fingers in all frames that images show: the strongest pixel within [`NEAR_M`] has at least
    /// [`SHOWN`] of that of the image by equation (7).
    pub(super) fn fingers_shown(&self, imaged: &Imaged) -> f64 {
        let touches = &self.recording.simulation.truth.touches;
        let is_shown = |touch: &&TrueTouch| {
            let strongest = |imaged: &Imaged| {
                let image = imaged.values.index_axis(Axis(0), touch.frame);
                let near = image.indexed_iter().filter(|((row, column), value)| {
                    let [x, y] = imaged.raster.centre_m(*row, *column);
                    let [at_x, at_y] = touch.position_m;
                    (x - at_x).hypot(y - at_y) < NEAR_M && value.is_finite()
                });
                near.fold(0.0_f64, |most, (_, value)| most.max(*value))
            };
            strongest(imaged) >= SHOWN * strongest(&self.equation_7)
        };
        touches.iter().filter(is_shown).count() as f64 / touches.len().max(1) as f64
    }

    /// Share of the frames with a finger in which a net more than halves the squared error to the rule's images.
    pub(super) fn halved(&self, imaged: &Imaged) -> f64 {
        let raw = &self.equation_7.to_rule_s2;
        let is_halved = |frame: &&usize| imaged.to_rule_s2[**frame] < 0.5 * raw[**frame];
        self.touched.iter().filter(is_halved).count() as f64 / self.touched.len() as f64
    }
}

/// Mean pressures of the touches beside the true ones.
pub(super) struct PressureErrors {
    /// Number of touches, and medians over them: pressure found and true, pascal; their ratio's distance from one; the
    /// stated standard deviation relative to the pressure.
    pub touches: usize,
    pub found_pa: f64,
    pub true_pa: f64,
    pub error: f64,
    pub stated: f64,
}

impl Shown {
    /// Compares the pressures of the defaults with the truth: force over contact area of the nearest finger.
    pub(super) fn pressure_errors(&self) -> Option<PressureErrors> {
        let truth = &self.recording.simulation.truth.touches;
        let pairs =
            self.defaults.pressed.as_ref()?.touches.iter().filter_map(|(frame, place, mean)| {
                let fingers = truth.iter().filter(|touch| touch.frame == *frame);
                let distance = |at: [f64; 2]| (at[0] - place[0]).hypot(at[1] - place[1]);
                let nearest = fingers
                    .min_by(|a, b| distance(a.position_m).total_cmp(&distance(b.position_m)))?;
                Some((mean, nearest.force_n / nearest.area_m2))
            });
        let pairs: Vec<_> = pairs.collect();
        let of = |value: &dyn Fn(&MeanPressure, f64) -> f64| {
            median(pairs.iter().map(|(mean, true_pa)| value(mean, *true_pa)))
        };
        Some(PressureErrors {
            touches: pairs.len(),
            found_pa: of(&|mean, _| mean.pressure_pa)?,
            true_pa: of(&|_, true_pa| true_pa)?,
            error: of(&|mean, true_pa| (mean.pressure_pa / true_pa - 1.0).abs())?,
            stated: of(&|mean, _| mean.std_pa.unwrap_or(f64::NAN) / mean.pressure_pa)?,
        })
    }
}
