//! A synthetic skin of twelve electrodes, and what is known of it.

mod dense_tests;
mod frame_tests;

use super::model::Model;
use super::places::Grid;
use super::state::{TouchState, Touches};
use super::*;
use crate::touch::detector::UnknownKind;
use eit_mesh::Surface;
use fixtures::Random;
use ndarray::Array2;
use std::f64::consts::TAU;

const COUNT: usize = 41;
const SIDE_M: f64 = 0.2;

/// A square sheet of 20 cm.
fn sheet() -> Surface {
    let step = SIDE_M / (COUNT - 1) as f64;
    let node = |k: usize| [step * (k % COUNT) as f64, step * (k / COUNT) as f64, 0.0];
    let corner = |i: usize, j: usize| (COUNT * j + i) as u32;
    let halves = |k: usize| {
        let (i, j) = (k % (COUNT - 1), k / (COUNT - 1));
        let first = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1)];
        [first, [corner(i, j), corner(i + 1, j + 1), corner(i, j + 1)]]
    };
    let cells = (COUNT - 1) * (COUNT - 1);
    Surface::new((0..COUNT * COUNT).map(node).collect(), (0..cells).flat_map(halves).collect())
        .unwrap()
}

/// A made-up instrument: pairs of electrodes around the sheet whose sensitivity is the product of two smooth fields.
struct Skin {
    surface: Surface,
    jacobian: Array2<f64>,
    unknowns: Array2<f64>,
    kinds: Vec<UnknownKind>,
    volts: Vec<f64>,
    noise: Vec<f64>,
    used: Vec<bool>,
    reciprocal: Vec<usize>,
    of_electrode: Vec<Vec<usize>>,
    drive: Vec<usize>,
    none: Vec<f64>,
    common: Vec<f64>,
}

const ELECTRODES: usize = 12;

impl Skin {
    fn new() -> Self {
        let surface = sheet();
        let centre = |e: usize| {
            let (sin, cos) = (TAU * e as f64 / ELECTRODES as f64).sin_cos();
            [0.1 + 0.1 * cos, 0.1 + 0.1 * sin, 0.0]
        };
        let pairs: Vec<[usize; 2]> = (0..ELECTRODES)
            .flat_map(|a| (0..ELECTRODES).map(move |b| [a, b]))
            .filter(|[a, b]| a != b)
            .collect();
        let field = |e: usize, p: [f64; 3]| {
            let c = centre(e);
            (-((p[0] - c[0]).powi(2) + (p[1] - c[1]).powi(2)) / 0.01).exp()
        };
        let centroids = surface.centroids();
        let areas = surface.areas_m2();
        let jacobian = Array2::from_shape_fn((pairs.len(), centroids.len()), |(row, e)| {
            let [a, b] = pairs[row];
            300.0 * areas[e] * (field(a, centroids[e]) * field(b, centroids[e]) + 0.02)
        });
        let index = |pair: [usize; 2]| pairs.iter().position(|p| *p == pair).unwrap();
        let contact = |row: usize, e: usize| f64::from(u8::from(pairs[row].contains(&e)));
        Self {
            jacobian,
            unknowns: Array2::from_shape_fn((pairs.len(), ELECTRODES), |(row, e)| {
                1e-4 * contact(row, e)
            }),
            kinds: (0..ELECTRODES).map(|e| UnknownKind::Contact { at_m: centre(e) }).collect(),
            volts: pairs.iter().map(|[a, b]| 0.1 + 0.01 * (a + b) as f64).collect(),
            noise: vec![1e-5; pairs.len()],
            used: vec![true; pairs.len()],
            reciprocal: pairs.iter().map(|[a, b]| index([*b, *a])).collect(),
            of_electrode: (0..ELECTRODES)
                .map(|e| (0..pairs.len()).filter(|&i| pairs[i].contains(&e)).collect())
                .collect(),
            drive: pairs.iter().map(|[a, _]| *a).collect(),
            none: vec![0.0; pairs.len()],
            common: vec![0.0; pairs.len()],
            surface,
        }
    }

    fn model(&self) -> ScoreModel<'_> {
        ScoreModel {
            skin: DetectorModel {
                surface: &self.surface,
                jacobian: &self.jacobian,
                model_v: &self.volts,
                unknowns: &self.unknowns,
                kinds: &self.kinds,
                reference_v: &self.volts,
                noise_std_v: &self.noise,
                quiet_v: ndarray::ArrayView2::from_shape((0, self.used.len()), &[]).unwrap(),
                used: &self.used,
                reciprocal: &self.reciprocal,
                of_electrode: &self.of_electrode,
            },
            conductivity_s: 1.0,
            reference_frames: 40,
            step_v: 0.0,
            drive: &self.drive,
            common_v: &self.common,
            leak_v: &self.none,
        }
    }

    /// What is known before the first frame.
    fn known(&self, settings: &ScoreSettings) -> Model {
        Model::new(&self.model(), &Array2::zeros((self.used.len(), 0)), settings).unwrap()
    }

    /// A detector that expects a sheet without rings which does not drift: fields as wide as these show little else.
    fn detector(&self) -> ScoreDetector {
        let settings = ScoreSettings {
            ring: 0.15,
            settle: 0.05,
            drift_sheet: 2e-3,
            drift_contact: 5e-3,
            ..ScoreSettings::default()
        };
        self.detector_with(settings)
    }

    fn detector_with(&self, settings: ScoreSettings) -> ScoreDetector {
        let dents = Array2::zeros((self.used.len(), 0));
        ScoreDetector::new(&self.model(), &dents, settings).unwrap()
    }

    /// A frame whose drives take turns in a part of its time, of a touch that begins at time 3, in frames.
    fn scan(
        &self,
        begin: f64,
        part: f64,
        at: impl Fn(f64) -> [f64; 2],
        random: &mut Random,
    ) -> Vec<f64> {
        let mut frame = self.volts.clone();
        for drive in 0..ELECTRODES {
            let time = begin + part * drive as f64 / ELECTRODES as f64;
            let whole = self.frame(&[(at(time), 1e-5 * (time - 3.0).clamp(0.0, 4.0))], random);
            let own = (0..frame.len()).filter(|&i| self.drive[i] == drive);
            own.for_each(|i| frame[i] = whole[i]);
        }
        frame
    }

    /// Voltages under bells of 7 mm with strengths in m^2, with noise.
    fn frame(&self, touches: &[([f64; 2], f64)], random: &mut Random) -> Vec<f64> {
        let centroids = self.surface.centroids();
        let areas = self.surface.areas_m2();
        let mut frame: Vec<f64> = self.volts.clone();
        for (at, strength) in touches {
            let bell =
                |p: &[f64; 3]| (-((p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2)) / 4.9e-5).exp();
            let whole: f64 = centroids.iter().zip(areas).map(|(p, a)| a * bell(p)).sum();
            for (row, v) in frame.iter_mut().enumerate() {
                let sum: f64 = centroids
                    .iter()
                    .enumerate()
                    .map(|(e, p)| self.jacobian[(row, e)] * bell(p))
                    .sum();
                *v += strength * sum / whole;
            }
        }
        frame.iter_mut().for_each(|v| *v += 1e-5 * random.normal());
        frame
    }
}

fn touch_at(grid: &Grid, at_m: [f64; 2], strength_m2: f64) -> TouchState {
    let way = |k: &usize| {
        let p = grid.at[*k].position_m;
        (p[0] - at_m[0]).hypot(p[1] - at_m[1])
    };
    let place = (0..grid.at.len()).min_by(|a, b| way(a).total_cmp(&way(b))).unwrap();
    TouchState { strength_m2, ..TouchState::new(grid.moved(&grid.spot(place), [1e-3, -5e-4])) }
}

/// The model explains the magnitudes of voltages of both signs as well as the voltages.
#[test]
fn magnitudes_are_no_misfit() {
    let mut skin = Skin::new();
    let signed = |(k, v): (usize, &f64)| if k % 3 == 0 { -v } else { *v };
    // both halves of a pair have one sign
    let signs: Vec<usize> = (0..skin.volts.len()).map(|i| i.min(skin.reciprocal[i])).collect();
    let volts = signs.iter().copied().zip(&skin.volts).map(signed).collect();
    let sizes = std::mem::replace(&mut skin.volts, volts);
    let no_dents = Array2::zeros((skin.used.len(), 0));
    for reference_v in [&sizes, &skin.volts] {
        let whole = skin.model();
        let model = ScoreModel { skin: DetectorModel { reference_v, ..whole.skin }, ..whole };
        let made = Model::new(&model, &no_dents, &ScoreSettings::default()).unwrap();
        assert!(made.misfit < 1e-6, "{}", made.misfit);
    }
}

/// A touch of known place (0.2 mm) that moves by 0.2 mm a frame has slid, though no single step tells; one that moves as slowly
/// as errors of the model has not.
#[test]
fn slow_slides_are_slides() {
    let path_m = |step_m: f64| {
        let grid = Grid::new(&sheet(), 4e-3);
        let mut touch = touch_at(&grid, [0.1, 0.1], 4e-5);
        touch.covariance_m2 = [[2e-8, 0.0], [0.0, 2e-8]];
        for _ in 0..400 {
            touch.follow(20.0, 0.05);
            touch.before = Some(touch.remembered(1.0, 0.05));
            touch.spot.position_m[0] += step_m;
        }
        touch.path_m
    };
    // 80 mm, but for the way since it was known last: three standard deviations of 0.2 mm, and as much is forgotten of each
    let slid_m = path_m(2e-4);
    assert!((0.07..0.081).contains(&slid_m), "{slid_m}");
    assert_eq!(path_m(1e-6), 0.0);
}

/// A touch that is rather an error of the model than a finger is told, but not valid.
#[test]
fn below_even_odds_nothing_is_valid() {
    let skin = Skin::new();
    let settings = ScoreSettings::default();
    let model = skin.known(&settings);
    for above in [-1.0, 1.0] {
        let mut touch = touch_at(&model.grid, [0.1, 0.1], 4e-5);
        (touch.id, touch.odds) = (Some(1), settings.shown + above);
        touch.covariance_m2 = [[1e-8, 0.0], [0.0, 1e-8]];
        let mut report = Report::new(&skin.surface);
        let touches = Touches::none().with(touch);
        report.push(&model, &settings, &touches, &step_of(100, 100.0, 100.0), true, 0.05);
        let [told] = report.touches() else { panic!("{:?}", report.touches()) };
        assert_eq!((told.valid, told.confidence > 0.5), (above > 0.0, above > 0.0));
    }
}
