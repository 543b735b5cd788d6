//! Scores, marginalisation and filter against dense closed forms, and a synthetic skin of sixteen electrodes.

use super::actions::{FIRST_ACTION, Features};
use super::estimate::{Estimator, Scene};
use super::linear::Symmetric;
use super::model::Model;
use super::places::Grid;
use super::state::{TouchState, Touches};
use super::whitened::Whitened;
use super::*;
use crate::touch::TouchState as Stage;
use crate::touch::detector::UnknownKind;
use eit_mesh::Surface;
use faer::Mat;
use faer::linalg::solvers::Solve;
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

/// A random covariance and frame of a skin's rows.
fn whitened(model: &Model) -> (Whitened, Mat<f64>, Vec<f64>) {
    let (n, mut random) = (model.n, Random::new(5));
    let mut base = Symmetric::zeros(n);
    let factors: Vec<f64> = (0..n * 8).map(|_| random.normal()).collect();
    base.add_product(1.0, &factors);
    base.add_diagonal(1.0);
    let y: Vec<f64> = (0..n).map(|_| 20.0 * random.normal()).collect();
    let mut frame = Whitened::default();
    frame.set(&base, &Symmetric::zeros(n), &y, |_| true);
    (frame, Mat::from_fn(n, n, |i, j| base.get(i, j)), y)
}

fn touch_at(grid: &Grid, at_m: [f64; 2], strength_m2: f64) -> TouchState {
    let way = |k: &usize| {
        let p = grid.at[*k].position_m;
        (p[0] - at_m[0]).hypot(p[1] - at_m[1])
    };
    let place = (0..grid.at.len()).min_by(|a, b| way(a).total_cmp(&way(b))).unwrap();
    TouchState { strength_m2, ..TouchState::new(grid.moved(&grid.spot(place), [1e-3, -5e-4])) }
}

fn log_determinant(matrix: &Mat<f64>) -> f64 {
    let factor = matrix.llt(faer::Side::Lower).unwrap();
    (0..matrix.nrows()).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum()
}

/// Without a step, the score of two touches is that of a dense normal density with the actions in its covariance (Woodbury), the
/// Hessian's determinant and the priors.
#[test]
fn a_score_is_that_of_a_dense_density() {
    let skin = Skin::new();
    let settings = ScoreSettings::default();
    let model = Model::new(&skin.model(), &Array2::zeros((skin.used.len(), 0)), &settings).unwrap();
    let scene = Scene { model: &model, settings: &settings, dt_s: 0.05 };
    let (mut frame, covariance, y) = whitened(&model);
    let list =
        [touch_at(&model.grid, [0.07, 0.1], 2e-5), touch_at(&model.grid, [0.13, 0.08], 4e-5)];
    let touches = list.iter().fold(Touches::none(), |touches, t| touches.with(*t));
    let found = Estimator::default().fit(&scene, &mut frame, &touches, 0, 0);

    let n = model.n;
    let (mut dense, mut left) = (covariance, y);
    let mut free = Mat::<f64>::zeros(n, 6);
    for (k, touch) in list.iter().enumerate() {
        let features = Features::new(touch, &settings);
        for f in 0..features.count {
            let mut column = vec![0.0; n];
            features.add_rows(f, 1.0, model.dictionary.of(touch.spot.place), &mut column);
            let column = Mat::from_fn(n, 1, |i, _| column[i]);
            if f >= FIRST_ACTION {
                dense += &column * column.transpose();
            } else {
                let at = if f == 0 { k } else { 2 + 2 * k + f - 1 };
                (0..n).for_each(|i| free[(i, at)] = column[(i, 0)]);
            }
            if f == 0 {
                (0..n).for_each(|i| left[i] -= touch.strength_m2 * column[(i, 0)]);
            }
        }
    }
    let left = Mat::from_fn(n, 1, |i, _| left[i]);
    let solver = dense.llt(faer::Side::Lower).unwrap();
    let chi_square = (left.transpose() * solver.solve(&left))[(0, 0)];
    let mut hessian = free.transpose() * solver.solve(&free);
    let mut cost = prior::of_pair(&list[0], &list[1], &settings);
    for (k, touch) in list.iter().enumerate() {
        let strength = prior::of_strength(touch.strength_m2, &settings);
        let place = prior::of_place(touch, &model.grid, &settings, 0.05, false);
        hessian[(k, k)] += strength.precision;
        (0..2).for_each(|a| hessian[(2 + 2 * k + a, 2 + 2 * k + a)] += place.precision[a][a]);
        cost += strength.cost + place.cost;
    }
    let curvature = log_determinant(&hessian) - 6.0 * TAU.ln();
    let score = chi_square + log_determinant(&dense) + curvature + cost;
    // the ridge of 1e-9 on the Hessian, and rounding
    assert!(
        (found.chi_square - chi_square).abs() < 1e-8 * chi_square,
        "{} {chi_square}",
        found.chi_square
    );
    assert!((found.score - score).abs() < 1e-6 * score.abs(), "{} {score}", found.score);
}

/// A frame without touches updates the reference, the shares of settling and their covariances as dense Kalman filters;
/// missing rows say nothing.
#[test]
fn the_reference_is_a_kalman_filter() {
    let skin = Skin::new();
    let settings = ScoreSettings::default();
    let model = Model::new(&skin.model(), &Array2::zeros((skin.used.len(), 0)), &settings).unwrap();
    let scene = Scene { model: &model, settings: &settings, dt_s: 0.05 };
    let (n, mut random) = (model.n, Random::new(7));
    let mut background = background::Background::new(&model, &settings);
    background.advance(&settings, 3.0);
    let before = Mat::from_fn(n, n, |i, j| background.covariance.get(i, j));
    let y: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    for settled in &mut background.settled {
        settled.iter_mut().for_each(|s| *s = 5.0 * random.normal());
    }
    let settled = Mat::from_fn(n, 3, |i, k| background.settled[k][i]);
    let mut total = Symmetric::default();
    background.sum(&model, &mut total);
    let mut frame = Whitened::default();
    frame.set(&total, &Symmetric::zeros(n), &y, |row| row % 5 != 0);
    background.learn(&scene, &frame, 1.0, &mut Touches::none(), &y);

    let present: Vec<usize> = (0..n).filter(|row| row % 5 != 0).collect();
    let sum = Mat::from_fn(present.len(), present.len(), |a, b| total.get(present[a], present[b]));
    let gain = Mat::from_fn(present.len(), n, |a, i| before[(present[a], i)]);
    let solved = sum.llt(faer::Side::Lower).unwrap().solve(&gain);
    let frame_y = Mat::from_fn(present.len(), 1, |a, _| y[present[a]]);
    let reference = solved.transpose() * &frame_y;
    let after = &before - gain.transpose() * &solved;
    // shares are subtracted: their columns are -settled
    let columns = Mat::from_fn(present.len(), 3, |a, k| -settled[(present[a], k)]);
    let variance = settings.settle * settings.settle / 3.0;
    let solved = sum.llt(faer::Side::Lower).unwrap().solve(&columns);
    let shares = faer::Scale(variance) * (solved.transpose() * &frame_y);
    let known = faer::Scale(variance * variance) * (columns.transpose() * &solved);
    for k in 0..3 {
        assert!((background.shares[k] - shares[(k, 0)]).abs() < 1e-9, "{k}");
        for l in 0..3 {
            let prior = if k == l { variance } else { 0.0 };
            let wanted = prior - known[(k, l)];
            let least = if k == l { settings.trail * settings.trail } else { wanted };
            let own = background.share_covariance[k][l];
            assert!((own - wanted.max(least)).abs() < 1e-9, "{k} {l}");
        }
    }
    for i in 0..n {
        assert!((background.reference[i] - reference[(i, 0)]).abs() < 1e-9, "{i}");
        for j in 0..=i {
            let own = background.covariance.get(i, j);
            assert!((own - after[(i, j)]).abs() < 1e-9 * (1.0 + before[(i, i)]), "{i} {j}");
        }
    }
}

/// Two touches begin, keep their ids while one moves, and end; nothing is shown without them.
#[test]
fn touches_begin_move_and_end() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(11);
    let mut push = |detector: &mut ScoreDetector, touches: &[([f64; 2], f64)]| {
        let frame = skin.frame(touches, &mut random);
        detector.push(&frame, |_| false, 0.05).unwrap();
        detector.touches().to_vec()
    };
    for _ in 0..10 {
        assert!(push(&mut detector, &[]).is_empty());
    }
    let mut ids = [0; 2];
    for k in 0..10 {
        let first = [0.06 + 1e-3 * f64::from(k), 0.08];
        let true_m = [first, [0.14, 0.12]];
        let touches = push(&mut detector, &[(true_m[0], 3e-5), (true_m[1], 4e-5)]);
        if k < 2 {
            continue;
        }
        assert_eq!(touches.len(), 2, "{k} {touches:?}");
        for (at, id) in true_m.iter().zip(&mut ids) {
            let near = |t: &&Touch| {
                let way_m = (t.position_m[0] - at[0]).hypot(t.position_m[1] - at[1]);
                // half a print: it follows a slow touch with a lag
                way_m < 4e-3
            };
            let touch = touches.iter().find(near);
            let touch = touch.unwrap();
            assert!(touch.valid && touch.confidence > 0.98 && (*id == 0 || *id == touch.id));
            *id = touch.id;
        }
    }
    assert!(ids[0] != ids[1]);
    let ended = push(&mut detector, &[]);
    assert!(ended.len() == 2 && ended.iter().all(|t| t.state == Stage::End && !t.valid));
    for _ in 0..10 {
        assert!(push(&mut detector, &[]).is_empty());
    }
}

/// An electrode whose halves disagree is named in its first frame and heals; touches are found without it.
#[test]
fn a_noisy_electrode_is_left_out_and_heals() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(13);
    for k in 0..60 {
        let is_bad = (10..20).contains(&k);
        let touch = [([0.08, 0.11], 3e-5)];
        let mut frame = skin.frame(if k > 14 { &touch } else { &[] }, &mut random);
        if is_bad {
            skin.of_electrode[4].iter().for_each(|&i| frame[i] += 0.02 * random.normal());
        }
        detector.push(&frame, |_| false, 0.05).unwrap();
        let expected = if is_bad { ElectrodeState::Noisy } else { ElectrodeState::Sound };
        if k < 30 {
            assert_eq!(detector.electrodes()[4], expected, "{k}");
        }
        assert_eq!(detector.is_missing(skin.of_electrode[4][0]), is_bad);
        let others = detector.electrodes().iter().filter(|s| **s != ElectrodeState::Sound).count();
        assert_eq!(others, usize::from(is_bad), "{k}");
        if k > 17 {
            assert_eq!(detector.touches().len(), 1, "{k}");
        }
    }
}

/// A frame of which nothing counts, or not a number, leaves touches as they are, not valid, and is no error.
#[test]
fn frames_without_values_say_nothing() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(17);
    for _ in 0..6 {
        let frame = skin.frame(&[([0.08, 0.11], 3e-5)], &mut random);
        detector.push(&frame, |_| false, 0.05).unwrap();
    }
    let id = detector.touches()[0].id;
    let nothing = vec![f64::NAN; skin.used.len()];
    detector.push(&nothing, |_| false, 0.05).unwrap();
    assert!(detector.touches().iter().all(|t| t.id == id && !t.valid));
    assert!(detector.push(&nothing[1..], |_| false, 0.05).is_err());
    assert!(detector.push(&nothing, |_| false, 0.0).is_err());
    let frame = skin.frame(&[([0.08, 0.11], 3e-5)], &mut random);
    let touches = detector.push(&frame, |_| false, 0.05).unwrap();
    assert!(touches.len() == 1 && touches[0].id == id && touches[0].valid);
}

/// Standard deviation of a touch's position.
fn std_m(touch: &Touch) -> f64 {
    let covariance = touch.position_covariance_m2;
    (covariance[0][0] + covariance[1][1]).sqrt()
}

/// What an amplifier adds to each drive moves no touch, and accuses no electrode.
#[test]
fn offsets_of_drives_are_no_touches() {
    let mut skin = Skin::new();
    skin.common.fill(1.0);
    let mut detector = skin.detector();
    let mut random = Random::new(19);
    let at = [0.08, 0.11];
    for k in 0..12 {
        let touch = [(at, 3e-5)];
        let mut frame = skin.frame(if k > 3 { &touch } else { &[] }, &mut random);
        let offsets_v: Vec<f64> = (0..ELECTRODES).map(|_| 1e-3 * random.normal()).collect();
        frame.iter_mut().zip(&skin.drive).for_each(|(v, drive)| *v += offsets_v[*drive]);
        let touches = detector.push(&frame, |_| false, 0.05).unwrap();
        assert_eq!(touches.len(), usize::from(k > 3), "{k} {touches:?}");
        // three standard deviations as stated in each frame
        let way_m = |t: &Touch| (t.position_m[0] - at[0]).hypot(t.position_m[1] - at[1]);
        assert!(touches.iter().all(|t| way_m(t) < 3.0 * std_m(t)), "{touches:?}");
        assert!(detector.electrodes().iter().all(|s| *s == ElectrodeState::Sound), "{k}");
    }
}

/// The time that a scan takes is found from a touch that moves, and its place is that at the first drive.
#[test]
fn the_time_of_a_scan_is_found() {
    let mut skin = Skin::new();
    // small voltages, so that halves are as equal as the noise allows
    skin.volts.iter_mut().for_each(|v| *v *= 0.03);
    for part in [0.0, 0.8] {
        let mut detector = skin.detector();
        let mut random = Random::new(23);
        let at = |time: f64| [0.06 + 4e-3 * time, 0.08 + 2e-3 * time];
        for k in 0..16 {
            let frame = skin.scan(f64::from(k), part, at, &mut random);
            let touches = detector.push(&frame, |_| false, 0.05).unwrap();
            if k > 8 {
                let [x, y] = at(f64::from(k));
                let way_m = |t: &Touch| (t.position_m[0] - x).hypot(t.position_m[1] - y);
                // three standard deviations as stated in each frame
                let is_near = |t: &Touch| way_m(t) < 3.0 * std_m(t);
                assert!(touches.len() == 1 && is_near(&touches[0]), "{part} {k} {touches:?}");
            }
        }
        // a tenth of a frame is 0.4 mm
        let found = detector.electrodes.scan.part();
        assert!((found - part).abs() < 0.1, "{found} {part}");
    }
}

/// A finger that has moved on during a gap in the frames is found where it is, and accuses no electrode.
#[test]
fn a_gap_in_the_frames_is_no_longer_scan() {
    let mut skin = Skin::new();
    skin.volts.iter_mut().for_each(|v| *v *= 0.03);
    let mut detector = skin.detector();
    let mut random = Random::new(29);
    let at = |time: f64| [0.06 + 2e-3 * time, 0.08 + 1e-3 * time];
    for k in 0..24 {
        let is_after = k >= 20;
        let frames = if k == 20 { 11.0 } else { 1.0 };
        let begin = f64::from(k) + if is_after { 10.0 } else { 0.0 };
        let frame = skin.scan(begin, 0.8, at, &mut random);
        let touches = detector.push(&frame, |_| false, 0.05 * frames).unwrap().to_vec();
        if k > 8 {
            let [x, y] = at(begin);
            // half a finger's width after the gap: what it knows of the motion is old
            let near_m = |t: &Touch| if is_after { 9e-3 } else { 3.0 * std_m(t) };
            let way_m = |t: &Touch| (t.position_m[0] - x).hypot(t.position_m[1] - y);
            let lasting: Vec<&Touch> = touches.iter().filter(|t| t.state != Stage::End).collect();
            assert!(
                lasting.len() == 1 && way_m(lasting[0]) < near_m(lasting[0]),
                "{k} {touches:?}"
            );
        }
        // how long a scan takes is known once something has moved
        let is_sound = |s: &ElectrodeState| *s == ElectrodeState::Sound;
        assert!(k <= 8 || detector.electrodes().iter().all(is_sound), "{k}");
    }
}

/// A damaged value is no jump of the skin where nothing else moves, and a frame that is damaged as a whole is not explained; a
/// touch outlives both.
#[test]
fn damage_ends_no_touch() {
    let mut skin = Skin::new();
    skin.volts.iter_mut().for_each(|v| *v *= 0.03);
    let mut detector = skin.detector();
    let mut random = Random::new(31);
    let at = |time: f64| [0.06 + 2e-3 * time.min(16.0), 0.08];
    for k in 0..40 {
        let mut frame = skin.scan(f64::from(k), 0.8, at, &mut random);
        let (is_torn, spike) = (k == 36, 3 * k as usize);
        match k {
            20 | 24 | 28 | 32 => frame[spike] += 0.2 * skin.volts[spike].abs(),
            36 => frame.iter_mut().for_each(|v| *v += 1e-2 * random.normal()),
            _ => {}
        }
        let touches = detector.push(&frame, |_| false, 0.05).unwrap();
        if k > 8 {
            assert_eq!(touches.len(), 1, "{k} {touches:?}");
            assert_eq!((touches[0].id, touches[0].valid), (1, !is_torn), "{k}");
        }
        if matches!(k, 20 | 24 | 28 | 32) {
            assert!(detector.electrodes.is_lost.iter().filter(|lost| **lost).count() == 1, "{k}");
        }
    }
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
    let model = Model::new(&skin.model(), &Array2::zeros((skin.used.len(), 0)), &settings).unwrap();
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

/// Touches, missing values and damage come and go: nothing is allocated once the largest numbers have occurred.
#[test]
fn push_allocates_nothing() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(37);
    let at = [[0.05, 0.06], [0.14, 0.07], [0.10, 0.15]];
    for k in 0..60 {
        let count = if k % 10 < 5 { 3 } else { k % 3 };
        let touches: Vec<([f64; 2], f64)> = at[..count].iter().map(|at| (*at, 4e-5)).collect();
        let mut frame = skin.frame(&touches, &mut random);
        match k % 7 {
            3 => frame[k] += 0.1,
            5 => frame.iter_mut().skip(k).step_by(9).for_each(|v| *v += 1e-2 * random.normal()),
            _ => {}
        }
        let missing = 11 * (k % 4);
        let info = allocation_counter::measure(|| {
            detector.push(&frame, |i| i < missing, 0.05).unwrap();
        });
        // the frame with the most places of all is among the first 36
        assert!(k < 36 || info.count_total == 0, "{k}: {info:?}");
    }
}
