//! One-step images where the noise figure falls, rises and falls again: its first crossing is the right one.

use crate::common::*;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::eit_inverse::{
    ChosenHyperparameter, HyperparameterChoice, NoiseTarget, OneStepGaussNewton,
};
use eit_skin::ndarray::{Array1, Array2};
use eit_skin::scene::{ElectrodeSettings, Reference, Scene, SkinSettings};
use eit_skin::{FittedFrames, Progress, Skin};
use std::sync::Arc;

/// Voltages of a skin at rest and with a finger that doubles the conductivity within 7 mm, on a mesh of its own.
fn simulated(scene: &Scene, [x, y]: [f64; 2]) -> [Array1<f64>; 2] {
    let skin = meshed(scene, 4000);
    let quiet_s = skin.background_s();
    let mut touched_s = quiet_s.clone();
    for (s, c) in touched_s.iter_mut().zip(skin.mesh.surface().centroids()) {
        let d_m = (c[0] - x).hypot(c[1] - y);
        *s += skin.conductivity_s * (-(d_m / 7e-3).powi(2)).exp();
    }
    [quiet_s, touched_s].map(|conductivity_s| skin.model.forward(&conductivity_s).unwrap())
}

/// Quiet frames and a touched one, noisy and rounded to steps, both relative to the largest voltage; and the noise.
fn frames([quiet_v, touched_v]: &[Array1<f64>; 2], noise: f64, step: f64) -> (Array2<f64>, f64) {
    let largest = quiet_v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let (noise_v, step_v) = (noise * largest, step * largest);
    let mut random = Random::new(0);
    let values = Array2::from_shape_fn((QUIET_FRAMES + 1, quiet_v.len()), |(frame, i)| {
        let v = if frame == QUIET_FRAMES { touched_v[i] } else { quiet_v[i] };
        step_v * ((v + noise_v * random.normal()) / step_v).round()
    });
    (values, noise_v)
}

fn fitted(scene: &Scene, values: &Array2<f64>, additive_v: Option<f64>) -> FittedFrames {
    let mut skin = Skin::from_scene(scene.clone()).unwrap();
    skin.settings.noise.additive_v = additive_v;
    skin.settings.recording.reference = Some(Reference::Text(format!("0..{QUIET_FRAMES}")));
    fit(&Arc::new(skin.linearise(&mut Progress::silent()).unwrap()), values)
}

/// Images are those of the first crossing; that where the noise figure falls below 1 for the last time gives none.
fn check(
    fitted: &FittedFrames,
    values: &Array2<f64>,
    mut difference: OneStepGaussNewton,
    chosen: &ChosenHyperparameter,
    at: [f64; 2],
) {
    let mut pairs = chosen.curve.windows(2);
    let last = pairs.rfind(|w| w[0].criterion > 1.0 && w[1].criterion <= 1.0).unwrap();
    let centroids = fitted.skin.skin.mesh.surface().centroids();
    // an unused value may be any finite number
    let finite = |v: &f64| if v.is_finite() { *v } else { 0.0 };
    let frame: Vec<f64> = values.row(QUIET_FRAMES).iter().map(finite).collect();
    // degrees of freedom, and the distance from the largest value to the finger, metres
    let [first, last] = [chosen.hyperparameter, last[1].hyperparameter].map(|hyperparameter| {
        difference.set_hyperparameter(hyperparameter).unwrap();
        let image = difference.reconstruct(&frame, &fitted.frames.reference).unwrap();
        let peak = (0..image.len()).max_by(|a, b| image[*a].total_cmp(&image[*b])).unwrap();
        let [x, y, _] = centroids[peak];
        (difference.report().degrees_of_freedom, (x - at[0]).hypot(y - at[1]))
    });
    println!("{first:?}, at the last crossing {last:?}");
    // the case has several crossings
    assert!(last.0 < 2.0 && last.1 > 20e-3, "{last:?}");
    // of 104 or 78 rows, at least a third
    assert!(first.0 > 25.0, "{first:?}");
    // half of a finger's width
    assert!(first.1 < 6e-3, "{first:?}");
}

/// 12 x 8 cm with stated noise, by the path of every one-step image.
#[test]
fn a_small_rectangle() {
    let electrodes = ElectrodeSettings::equally_spaced(16, 0.0125, 1e3);
    let scene = Scene::new(SkinSettings::rectangle(0.12, 0.08, 1e-5), electrodes);
    let at = [0.03, 0.02];
    let (values, noise_v) = frames(&simulated(&scene, at), 1e-3, 1e-6);
    let fitted = fitted(&scene, &values, Some(noise_v));
    let imaging = fitted.one_step(&mut Progress::silent()).unwrap();
    check(&fitted, &values, imaging.difference, &imaging.chosen, at);
}

/// Without electrode 5, with weights that take rounding for silence: a third of the channels never change and get a tenth
/// of the others' noise, as a robot's own estimate may have it.
#[test]
fn without_an_electrode() {
    let scene = Scene::load("paper-disc").unwrap();
    let at = [0.03, 0.04];
    let (mut values, _) = frames(&simulated(&scene, at), 10.0_f64.powf(-4.5), 1.0 / 4096.0);
    PAPER.measurements_of(4).iter().for_each(|i| values.column_mut(*i).fill(f64::NAN));
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
    check(&fitted, &values, difference, &chosen, at);
}

/// Deviations from one quiet frame to the next relative to the reference, at least a tenth of the median that change.
fn noise_without_rounding(fitted: &FittedFrames, values: &Array2<f64>) -> Vec<f64> {
    let used = &fitted.frames.used;
    let deviation = |i: usize| {
        let channel = values.column(i);
        let squares = (1..QUIET_FRAMES).map(|k| (channel[k] - channel[k - 1]).powi(2));
        (0.5 * squares.sum::<f64>() / (QUIET_FRAMES - 1) as f64).sqrt()
    };
    let std_v: Vec<f64> = (0..used.len()).map(deviation).collect();
    let least_v = 0.1 * eit_core::median(std_v.iter().copied().filter(|e| *e > 0.0)).unwrap();
    let relative = |i: usize| std_v[i].max(least_v) / fitted.frames.reference[i].abs();
    (0..used.len()).map(|i| if used[i] { relative(i) } else { 1.0 }).collect()
}
