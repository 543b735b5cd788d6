//! Stages of the reconstruction methods.

use super::rates::{
    ABSOLUTE_STEPS, ASSUMED_FRAMES, DECOMPOSITION_FLOPS_PER_S, FITTED_FLOPS_PER_S, PRIOR_ENTRY_S,
    PRODUCT_FLOPS_PER_S, READ_BYTES_PER_S, TV_FLOPS_PER_S, TV_ITERATIONS, TV_LANES, TV_PASSES,
    TV_TRIAL_FRAMES, TV_TRIALS,
};
use super::sequence::Sequence;
use super::sizes::Sizes;
use super::stage::Stage;
use crate::one_step::DEFAULT_NOISE_FIGURE;
use crate::scene::{DifferenceKind, Hyperparameter, Rule};
use crate::skin::Skin;
use crate::total_variation::DEFAULT_TARGET_GAP;

impl Sizes<'_> {
    /// The one-step matrix and its hyperparameter.
    pub(crate) fn matrix(&self) -> Stage {
        let (m, n, rank) = (self.measurements, self.elements, self.directions);
        let skin = self.skin;
        let products_flops = m * m * n + 2.0 * m * n * rank;
        let decomposition = 4.0 * m * rank * rank;
        Stage {
            name: "reconstruction matrix",
            size: format!("{m} x {m} in measurement space"),
            flops: products_flops + decomposition,
            bytes: 8.0 * (m * n + m * m),
            time_s: PRIOR_ENTRY_S * m * n
                + products_flops / PRODUCT_FLOPS_PER_S
                + decomposition / DECOMPOSITION_FLOPS_PER_S,
            why: hyperparameter_text(skin),
        }
    }

    /// One image.
    pub(crate) fn frame(&self) -> Stage {
        let (pixels, rank) = (self.pixels, self.rank);
        let image = 2.0 * self.directions * (self.measurements + self.skin_pixels);
        let skin = self.skin;
        Stage {
            name: "each frame",
            size: format!("{pixels} x {pixels} pixels, rank {rank} at most"),
            flops: image,
            bytes: 4.0 * image,
            time_s: 4.0 * image / READ_BYTES_PER_S,
            why: match skin.difference_kind() {
                DifferenceKind::Normalised => {
                    "normalised difference: gains of channels cancel".to_owned()
                }
                DifferenceKind::Plain => {
                    "plain difference: some patterns give voltages near zero".to_owned()
                }
            },
        }
    }

    /// One image of a method that couples frames, on elements.
    pub(crate) fn sequence_frame(&self) -> Stage {
        let (m, n, rank) = (self.measurements, self.elements, self.rank);
        let flops = self.directions * (2.0 * (m + n) + 10.0);
        Stage {
            name: "each frame",
            size: format!("{n} elements, rank {rank} at most"),
            flops,
            bytes: 4.0 * flops,
            time_s: 4.0 * flops / READ_BYTES_PER_S,
            why: format!("{rank} scalar smoothers: the problem decouples into its eigenvectors"),
        }
    }

    /// One frame of the absolute method, in which each step solves and linearises again.
    pub(crate) fn absolute_step(&self, model: &[Stage]) -> Stage {
        let (m, n) = (self.measurements, self.elements);
        let again = model.iter().filter(|stage| stage.name != "mesh");
        let (solve, time_s) = again.fold((0.0, 0.0), |sum, s| (sum.0 + s.flops, sum.1 + s.time_s));
        let products = m * m * n + m * m * m / 3.0;
        Stage {
            name: "each frame",
            size: format!("about {ABSOLUTE_STEPS} steps of [{m}, {n}]"),
            flops: ABSOLUTE_STEPS * (solve + products),
            bytes: 8.0 * m * n,
            time_s: ABSOLUTE_STEPS
                * (time_s + PRIOR_ENTRY_S * m * n + products / PRODUCT_FLOPS_PER_S),
            why: "each step solves the model and its Jacobian again".to_owned(),
        }
    }

    /// Set-up, choice of weights, and the iteration.
    pub(crate) fn total_variation(&self, sequence: Sequence) -> Vec<Stage> {
        let (m, n) = (self.measurements, self.skin_pixels);
        let count = sequence.solved().unwrap_or(ASSUMED_FRAMES);
        let keys = &self.skin.settings.reconstruction;
        let gap = keys.target_gap.unwrap_or(DEFAULT_TARGET_GAP);
        let (iterations, whence) = self.iterations();
        let set_up = 2.0 * m * 4.0 * self.elements + 4.0 * m * m * n;
        let slowness = FITTED_FLOPS_PER_S / self.machine.double_flops_per_s;
        let frames = match sequence {
            Sequence::Unknown => format!("{count} frames assumed"),
            Sequence::Frames(1) => "one frame".to_owned(),
            Sequence::Frames(count) => format!("{count} frames"),
            Sequence::Still(count) => format!("the mean of {count} frames"),
        };
        let mut stages = vec![Stage {
            name: "Jacobian of pixels",
            size: format!("[{m}, {n}], rank {} at most", self.rank),
            flops: set_up,
            bytes: 8.0 * m * n,
            time_s: set_up / DECOMPOSITION_FLOPS_PER_S,
            why: "rotated to its independent directions: an iteration works on those".to_owned(),
        }];
        if keys.lambda_space.is_none() && keys.delta.is_none() {
            stages.push(self.weights(count));
        }
        let iteration = Stage {
            name: "iteration",
            size: format!("{n} pixels, {frames}"),
            flops: self.iteration_flops(count),
            bytes: TV_PASSES * 4.0 * n * count as f64,
            time_s: self.iteration_flops(count) / TV_FLOPS_PER_S,
            why: format!(
                "4 flops a pixel, direction and frame; {TV_PASSES} passes over the movie of 4 bytes \
                 a value"
            ),
        };
        let solve = Stage {
            name: "solve",
            size: format!("about {iterations:.0} iterations to gap {gap:e}"),
            flops: iterations * iteration.flops,
            bytes: iterations * TV_PASSES * 4.0 * n * count as f64,
            time_s: iterations * iteration.flops / TV_FLOPS_PER_S,
            why: format!(
                "iterations {whence}: they vary with touches and noise; {:.0} Gflop/s effective",
                1e-9 * TV_FLOPS_PER_S / slowness
            ),
        };
        stages.extend([iteration, solve]);
        stages
    }

    /// Operations of an iteration of total variation; the kernels process eight frames at once.
    fn iteration_flops(&self, frames: usize) -> f64 {
        4.0 * self.skin_pixels * self.directions * frames.next_multiple_of(TV_LANES) as f64
    }

    /// Number of iterations of total variation, and where it is known from.
    fn iterations(&self) -> (f64, String) {
        match self.measured {
            Some(row) => (row.iterations, format!("as on {}", row.scene)),
            None => (TV_ITERATIONS, "a guess".to_owned()),
        }
    }

    /// Choice of the weights of total variation for so many frames.
    fn weights(&self, count: usize) -> Stage {
        let flops =
            TV_TRIALS * self.iterations().0 * self.iteration_flops(count.min(TV_TRIAL_FRAMES));
        let time_s = match self.measured {
            // proportional to the frames used; `scale` accounts for other machines
            Some(row) if row.choice_s > 0.0 => {
                let frames = |count: usize| count.min(TV_TRIAL_FRAMES).next_multiple_of(TV_LANES);
                let part = frames(count) as f64 / frames(row.frames) as f64;
                row.choice_s * part * 1e9 * row.machine_gflops / FITTED_FLOPS_PER_S
            }
            _ => flops / TV_FLOPS_PER_S,
        };
        Stage {
            name: "weights",
            size: format!("about {TV_TRIALS} coarse solves"),
            flops,
            bytes: 0.0,
            time_s,
            why: format!("on at most the {TV_TRIAL_FRAMES} frames with the most signal"),
        }
    }
}

fn hyperparameter_text(skin: &Skin) -> String {
    let keys = &skin.settings.reconstruction;
    match &keys.hyperparameter {
        None | Some(Hyperparameter::Rule(Rule::NoiseFigure)) => {
            let figure = keys.noise_figure.unwrap_or(DEFAULT_NOISE_FIGURE);
            format!("hyperparameter by noise figure {figure}: needs no data")
        }
        Some(Hyperparameter::Value(value)) => format!("hyperparameter {value}, from the scene"),
        Some(Hyperparameter::Rule(Rule::LCurve)) => "hyperparameter by L-curve".to_owned(),
        Some(Hyperparameter::Rule(Rule::Gcv)) => "hyperparameter by cross-validation".to_owned(),
    }
}
