//! Choice of the hyperparameter of one-step images by the noise figure if the figure falls, rises and falls
//! again: its first crossing is the right one.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use eit_skin::eit_fem::fabric::Random;
use eit_skin::eit_inverse::{
    ChosenHyperparameter, HyperparameterChoice, NoiseTarget, OneStepGaussNewton,
};
use eit_skin::ndarray::Array2;
use eit_skin::scene::{ElectrodeSettings, Reference, Scene, SkinSettings};
use eit_skin::{FittedFrames, MeshOverride, Progress, Skin};
use std::sync::Arc;

const QUIET_FRAMES: usize = 40;

/// Nodes of the simulation mesh; that of the reconstruction is the scene's own.
const NODES: usize = 4000;

/// Voltages of a skin at rest and with one finger, which doubles the conductivity within 7 mm.
struct Simulated {
    quiet_v: Vec<f64>,
    touched_v: Vec<f64>,
    quadruples: Vec<[u32; 4]>,
}

impl Simulated {
    fn new(scene: &Scene, [x, y]: [f64; 2]) -> Self {
        let mesh = MeshOverride { nodes: Some(NODES), ..Default::default() };
        let skin = Skin::set_up(scene, &mesh, &mut Progress::silent()).unwrap();
        let volts = |conductivity_s: &[f64]| {
            let mut workspace = skin.model.workspace().unwrap();
            skin.solve(conductivity_s, &mut workspace).unwrap().measurements().to_vec()
        };
        let mut touched_s = skin.background_s();
        for (s, c) in touched_s.iter_mut().zip(skin.mesh.surface().centroids()) {
            let d_m = (c[0] - x).hypot(c[1] - y);
            *s += skin.conductivity_s * (-(d_m / 7e-3).powi(2)).exp();
        }
        Self {
            quiet_v: volts(&skin.background_s()),
            touched_v: volts(&touched_s),
            quadruples: skin.protocol.quadruples().unwrap().to_vec(),
        }
    }

    fn largest_v(&self) -> f64 {
        self.quiet_v.iter().fold(0.0, |most, v| most.max(v.abs()))
    }

    /// Quiet frames followed by a touched one, noisy and rounded to whole steps.
    fn frames(&self, noise_v: f64, step_v: f64) -> Array2<f64> {
        let mut random = Random::new(0);
        Array2::from_shape_fn((QUIET_FRAMES + 1, self.quiet_v.len()), |(frame, i)| {
            let v = if frame == QUIET_FRAMES { self.touched_v[i] } else { self.quiet_v[i] };
            step_v * ((v + noise_v * random.normal()) / step_v).round()
        })
    }
}

fn fitted(scene: &Scene, values: &Array2<f64>, additive_v: Option<f64>) -> FittedFrames {
    let mut skin = Skin::from_scene(scene.clone()).unwrap();
    skin.settings.noise.additive_v = additive_v;
    skin.settings.recording.reference = Some(Reference::Text(format!("0..{QUIET_FRAMES}")));
    let linearised = Arc::new(skin.linearise(&mut Progress::silent()).unwrap());
    let frames = linearised.skin.frames_of_values(values).unwrap();
    linearised.fit(frames).unwrap()
}

/// Quality of an image at a hyperparameter.
#[derive(Debug)]
struct NetQuality {
    degrees_of_freedom: f64,
    /// Distance from the largest value to the finger, metres.
    off_m: f64,
}

/// At the chosen hyperparameter, and where the noise figure falls below 1 for the last time.
fn worths(
    fitted: &FittedFrames,
    values: &Array2<f64>,
    mut difference: OneStepGaussNewton,
    chosen: &ChosenHyperparameter,
    at: [f64; 2],
) -> [NetQuality; 2] {
    let mut pairs = chosen.curve.windows(2);
    let last = pairs.rfind(|w| w[0].criterion > 1.0 && w[1].criterion <= 1.0).unwrap();
    let skin = &fitted.skin.skin;
    let centroids = skin.mesh.surface().centroids();
    // an unused value may be any finite number
    let finite = |v: &f64| if v.is_finite() { *v } else { 0.0 };
    let frame: Vec<f64> = values.row(QUIET_FRAMES).iter().map(finite).collect();
    [chosen.hyperparameter, last[1].hyperparameter].map(|hyperparameter| {
        difference.set_hyperparameter(hyperparameter).unwrap();
        let image = difference.reconstruct(&frame, &fitted.frames.reference).unwrap();
        let peak = (0..image.len()).max_by(|a, b| image[*a].total_cmp(&image[*b])).unwrap();
        NetQuality {
            degrees_of_freedom: difference.report().degrees_of_freedom,
            off_m: (centroids[peak][0] - at[0]).hypot(centroids[peak][1] - at[1]),
        }
    })
}

/// Images are those of the first crossing; the last one, which was used before, gives no image.
fn check(name: &str, [first, last]: &[NetQuality; 2]) {
    println!("{name}: {first:?}, at the last crossing {last:?}");
    // the case has several crossings
    assert!(last.degrees_of_freedom < 2.0 && last.off_m > 20e-3, "{last:?}");
    // of 104 or 78 rows, at least a third
    assert!(first.degrees_of_freedom > 25.0, "{first:?}");
    // half of a finger's width
    assert!(first.off_m < 6e-3, "{first:?}");
}

/// 12 x 8 cm with stated noise, by the path of every one-step image.
#[test]
fn a_small_rectangle() {
    let electrodes = ElectrodeSettings::equally_spaced(16, 0.0125, 1e3);
    let scene = Scene::new(SkinSettings::rectangle(0.12, 0.08, 1e-5), electrodes);
    let at = [0.03, 0.02];
    let simulated = Simulated::new(&scene, at);
    let noise_v = 1e-3 * simulated.largest_v();
    let values = simulated.frames(noise_v, 1e-3 * noise_v);
    let fitted = fitted(&scene, &values, Some(noise_v));
    let imaging = fitted.one_step(&mut Progress::silent()).unwrap();
    let worths = worths(&fitted, &values, imaging.difference, &imaging.chosen, at);
    check("rectangle", &worths);
}

/// The paper's disc without electrode 5, with weights that take rounding for silence: a third of the channels
/// never change and get a tenth of the others' noise, as a robot's own estimate may have it.
#[test]
fn without_an_electrode() {
    let scene = Scene::load("paper-disc").unwrap();
    let at = [0.03, 0.04];
    let simulated = Simulated::new(&scene, at);
    let mut values = simulated
        .frames(10.0_f64.powf(-4.5) * simulated.largest_v(), simulated.largest_v() / 4096.0);
    for (i, quadruple) in simulated.quadruples.iter().enumerate() {
        if quadruple.contains(&4) {
            values.column_mut(i).fill(f64::NAN);
        }
    }
    let fitted = fitted(&scene, &values, None);
    let mut settings = fitted.one_step_settings().unwrap();
    settings.noise_std = Some(noise_without_rounding(&fitted, &values));
    let linearised = &fitted.skin;
    let prior = linearised.prior().unwrap();
    let mut difference =
        OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings).unwrap();
    let surface = linearised.skin.mesh.surface();
    let target = NoiseTarget::central(surface, &linearised.jacobian).unwrap();
    let choice = HyperparameterChoice::NoiseFigure { figure: 1.0, target: &target };
    let chosen = difference.choose_hyperparameter(&choice).unwrap();
    let worths = worths(&fitted, &values, difference, &chosen, at);
    check("without electrode 5", &worths);
}

/// Deviation of each measurement from one quiet frame to the next, at least a tenth of the median of those
/// that change, relative to the reference; 1 where it is not used.
fn noise_without_rounding(fitted: &FittedFrames, values: &Array2<f64>) -> Vec<f64> {
    let used = &fitted.frames.used;
    let deviation = |i: usize| {
        let channel = values.column(i);
        let squares = (1..QUIET_FRAMES).map(|k| (channel[k] - channel[k - 1]).powi(2));
        (0.5 * squares.sum::<f64>() / (QUIET_FRAMES - 1) as f64).sqrt()
    };
    let std_v: Vec<f64> = (0..used.len()).map(deviation).collect();
    let mut moving: Vec<f64> = std_v.iter().copied().filter(|e| *e > 0.0).collect();
    moving.sort_by(f64::total_cmp);
    let least_v = 0.1 * moving[moving.len() / 2];
    let relative = |i: usize| std_v[i].max(least_v) / fitted.frames.reference[i].abs();
    (0..used.len()).map(|i| if used[i] { relative(i) } else { 1.0 }).collect()
}
