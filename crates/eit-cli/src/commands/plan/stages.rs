//! Stages of a plan: sizes, work, expected time.

use super::electrodes;
use super::sequence::Sequence;
use crate::machine::Machine;
use crate::measured::Measured;
use crate::method::Method;
use crate::pipeline::reactive::ReactiveSetup;
use crate::pipeline::tv::DEFAULT_TARGET_GAP;
use crate::pipeline::{DEFAULT_NOISE_FIGURE, DEFAULT_PIXELS, Setup};
use crate::scene::{DifferenceKind, Hyperparameter, Rule, Scene, Shape};
use eit_fem::{Elements, SolvePath};
use eit_mesh::{Mesh, Quality};

/// Dense product in double precision where the rates below were fitted: times are scaled by it to
/// the machine at hand.
const FITTED_FLOPS_PER_S: f64 = 4e10;
/// Rates behind the predicted times, fitted by hand on one core of the machine of
/// `docs/PERFORMANCE.md` with 16 electrodes at 2 000 and 20 000 nodes: sparse factorisation with
/// its overhead per element, backward sweeps, priors per entry of the Jacobian, dense products and
/// factorisations, stores to memory, reads from cache. Elsewhere they are a guide, not a promise.
const FACTOR_FLOPS_PER_S: f64 = 1.5e10;
const ELEMENT_S: f64 = 3.8e-8;
pub(super) const SWEEP_FLOPS_PER_S: f64 = 1e10;
const PRIOR_ENTRY_S: f64 = 2.5e-8;
pub(super) const PRODUCT_FLOPS_PER_S: f64 = 3.3e10;
const DECOMPOSITION_FLOPS_PER_S: f64 = 1.5e10;
/// Between memory that is used again (5 and more) and memory whose pages are touched for the first
/// time (2), as those of the one Jacobian of a command: either is within a factor of two.
const STORE_BYTES_PER_S: f64 = 3.2e9;
/// Beyond the caches, where every page is new: between 1.3 and 3.
const NEW_BYTES_PER_S: f64 = 2e9;
const CACHED_BYTES: f64 = 1.6e7;
/// Directions of the data that a smooth prior or rounding leave in practice, however many
/// electrodes: 261 of 32 with trigonometric currents.
const USUAL_DIRECTIONS: f64 = 250.0;
const READ_BYTES_PER_S: f64 = 4.5e10;
/// Solves of a bounded error, seconds a node (2 000 and 20 000 nodes): electrodes eliminated
/// analytically in `f64`, and in twice the precision.
const STABLE_NODE_S: f64 = 6e-6;
const ACCURATE_NODE_S: f64 = 3.5e-5;
/// Real multiplications and additions of a complex one.
const COMPLEX_FLOPS: f64 = 4.0;
/// Meshing, seconds a node.
const NODE_S: f64 = 5.5e-6;
/// Total variation, effective: an iteration of 64 x 64 pixels and 20 frames in single precision.
const TV_FLOPS_PER_S: f64 = 5e10;
/// Frames that its kernels take together.
const TV_LANES: usize = 8;
/// Iterations of total variation where none were measured.
const TV_ITERATIONS: f64 = 260.0;
/// Passes over the values of a movie, single precision, in an iteration.
const TV_PASSES: f64 = 14.0;
/// Trial solves that choose the weights, and their frames.
const TV_TRIALS: f64 = 10.0;
const TV_TRIAL_FRAMES: usize = 12;
/// Steps of the absolute method, a frame.
const ABSOLUTE_STEPS: f64 = 2.0;

/// Frames of a plan whose recording is not known.
pub(super) const ASSUMED_FRAMES: usize = 20;

/// One stage of the plan.
pub(crate) struct Stage {
    pub name: &'static str,
    pub size: String,
    pub flops: f64,
    pub bytes: f64,
    pub time_s: f64,
    pub why: String,
}

/// Numbers that all stages come from.
struct Sizes<'a> {
    scene: &'a Scene,
    setup: &'a Setup,
    measurements: f64,
    elements: f64,
    /// Pixels of the raster's side, and those on the skin.
    pixels: usize,
    skin_pixels: f64,
    /// Independent measurements at most.
    rank: f64,
    /// Those of them that time is counted for.
    directions: f64,
    /// The method on the built-in scene most like this one.
    measured: Option<&'a Measured>,
    machine: &'a Machine,
}

/// The stages of a method, in the order of the work.
pub(crate) fn of(
    scene: &Scene,
    setup: &Setup,
    (method, sequence): (Method, Sequence),
    (machine, measured): (&Machine, Option<&Measured>),
) -> Vec<Stage> {
    let cost = setup.model.cost();
    let (m, n) = (setup.protocol.measurements() as f64, setup.model.elements() as f64);
    let pixels = scene.reconstruction.pixels.unwrap_or(DEFAULT_PIXELS);
    let electrodes = setup.protocol.electrodes() as f64;
    // reciprocity leaves L (L - 1) / 2 independent measurements at most; smooth priors fewer
    let rank = m.min(cost.field_products as f64).min(n).min(0.5 * electrodes * (electrodes - 1.0));
    let sizes = Sizes {
        measured,
        machine,
        scene,
        setup,
        measurements: m,
        elements: n,
        pixels,
        skin_pixels: (skin_share(setup) * (pixels * pixels) as f64).round(),
        rank,
        directions: rank.min(USUAL_DIRECTIONS),
    };
    let mut stages = sizes.model();
    if method != Method::GaussNewtonAbsolute {
        stages.extend(electrodes::of(scene, setup));
    }
    match method {
        Method::StTv | Method::Tv => stages.extend(sizes.total_variation(sequence)),
        Method::GaussNewton => stages.extend([sizes.matrix(), sizes.frame()]),
        Method::TimePrior | Method::Kalman => {
            stages.extend([sizes.matrix(), sizes.sequence_frame()]);
        }
        Method::GaussNewtonAbsolute => {
            let step = sizes.absolute_step(&stages);
            stages.extend([sizes.matrix(), step]);
        }
    }
    scale(&mut stages, machine);
    stages
}

/// The stages of a scene that stores charge. A complex product is four real ones, a matrix is assembled
/// twice, for real and imaginary parts.
pub(super) fn of_reactive(scene: &Scene, setup: &ReactiveSetup, machine: &Machine) -> Vec<Stage> {
    let model = &setup.model;
    let cost = model.cost();
    let (m, n) = (model.protocol().measurements() as f64, model.elements() as f64);
    let (entries, solves) = (cost.factor_entries as f64, cost.field_solves as f64);
    let factor = COMPLEX_FLOPS * cost.factor_flops;
    let sweep = COMPLEX_FLOPS * 2.0 * entries * solves;
    let bytes = 16.0 * m * n;
    let mut stages = vec![
        mesh_stage(scene, &setup.mesh),
        Stage {
            name: "forward, complex",
            size: format!("{} unknowns, factor {} entries", cost.unknowns, cost.factor_entries),
            flops: factor,
            bytes: 16.0 * entries,
            time_s: factor / FACTOR_FLOPS_PER_S + 2.0 * ELEMENT_S * n,
            why: "one symmetric factorisation gives all voltages: electrodes are eliminated last"
                .to_owned(),
        },
        Stage {
            name: "Jacobian, complex",
            size: format!("[{m}, {n}], {solves} fields, {} products", cost.field_products),
            // a product of two gradients: 16 flops, real ones 3
            flops: sweep + 16.0 / 3.0 * cost.product_flops,
            bytes,
            time_s: sweep / SWEEP_FLOPS_PER_S + bytes / store_rate(bytes),
            why: "only `eit jacobian` asks for it: the derivative by complex admittivity"
                .to_owned(),
        },
    ];
    scale(&mut stages, machine);
    stages
}

/// From the machine that the rates are of to this one.
fn scale(stages: &mut [Stage], machine: &Machine) {
    let slowness = FITTED_FLOPS_PER_S / machine.double_flops_per_s;
    stages.iter_mut().for_each(|stage| stage.time_s *= slowness);
}

/// Bytes a second at which an array of this size is stored.
pub(super) fn store_rate(bytes: f64) -> f64 {
    if bytes > CACHED_BYTES { NEW_BYTES_PER_S } else { STORE_BYTES_PER_S }
}

/// Generated or read.
fn mesh_stage(scene: &Scene, mesh: &Mesh) -> Stage {
    let quality = Quality::of(mesh);
    Stage {
        name: "mesh",
        size: format!("{} nodes, {} triangles", quality.nodes, quality.triangles),
        flops: 0.0,
        bytes: 24.0 * quality.nodes as f64 + 12.0 * quality.triangles as f64,
        time_s: NODE_S * quality.nodes as f64,
        why: match scene.skin.shape {
            Shape::Mesh => "read from the scene's file".to_owned(),
            _ => format!("graded to the electrode ends, mean quality {:.3}", quality.mean_quality),
        },
    }
}

/// The one solve that images are linearised at, where textbook assembly may lose too many digits.
pub(super) fn linearisation(setup: &Setup, path: SolvePath, machine: &Machine) -> Option<Stage> {
    let (node_s, numbers) = match path {
        SolvePath::Plain => return None,
        SolvePath::Stable => (STABLE_NODE_S, "f64"),
        SolvePath::Accurate => (ACCURATE_NODE_S, "twice the precision"),
    };
    let nodes = setup.mesh.surface().nodes().len() as f64;
    let mut stages = [Stage {
        name: "linearisation",
        size: format!("once, electrodes by their means, {numbers}"),
        flops: 0.0,
        bytes: 0.0,
        time_s: nodes * node_s,
        why: "contacts or contrast would cost textbook assembly too many digits".to_owned(),
    }];
    scale(&mut stages, machine);
    stages.into_iter().next()
}

impl Sizes<'_> {
    /// Mesh, forward solution and Jacobian, which all methods need.
    fn model(&self) -> Vec<Stage> {
        let (scene, setup) = (self.scene, self.setup);
        let (m, n) = (self.measurements, self.elements);
        let cost = setup.model.cost();
        let entries = cost.factor_entries as f64;
        let solves = cost.field_solves as f64;
        let sweep = 2.0 * entries * solves;
        let kind = match setup.model.element_kind() {
            Elements::Linear => "",
            Elements::Quadratic => "quadratic elements; ",
        };
        vec![
            mesh_stage(scene, &setup.mesh),
            Stage {
                name: "forward",
                size: format!("{} unknowns, factor {} entries", cost.unknowns, cost.factor_entries),
                flops: cost.factor_flops,
                bytes: 8.0 * entries,
                time_s: cost.factor_flops / FACTOR_FLOPS_PER_S + ELEMENT_S * n,
                why: format!(
                    "{kind}one factorisation gives all voltages: electrodes are eliminated last"
                ),
            },
            Stage {
                name: "Jacobian",
                size: format!("[{m}, {n}], {} fields, {} products", solves, cost.field_products),
                flops: sweep + cost.product_flops,
                bytes: 8.0 * m * n,
                time_s: sweep / SWEEP_FLOPS_PER_S + 8.0 * m * n / store_rate(8.0 * m * n),
                why: format!(
                    "{} patterns span {solves} fields; reciprocal measurements share a product",
                    setup.protocol.stimulations_a().nrows()
                        + setup.protocol.measurement_patterns().nrows()
                ),
            },
        ]
    }

    /// The one-step matrix and its hyperparameter.
    fn matrix(&self) -> Stage {
        let (m, n, rank) = (self.measurements, self.elements, self.directions);
        let scene = self.scene;
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
            why: hyperparameter_words(scene),
        }
    }

    /// One image.
    fn frame(&self) -> Stage {
        let (pixels, rank) = (self.pixels, self.rank);
        let image = 2.0 * self.directions * (self.measurements + self.skin_pixels);
        let (scene, setup) = (self.scene, self.setup);
        Stage {
            name: "each frame",
            size: format!("{pixels} x {pixels} pixels, rank {rank} at most"),
            flops: image,
            bytes: 4.0 * image,
            time_s: 4.0 * image / READ_BYTES_PER_S,
            why: match scene.difference_kind(&setup.protocol) {
                DifferenceKind::Normalised => {
                    "normalised difference: gains of channels cancel".to_owned()
                }
                DifferenceKind::Plain => {
                    "plain difference: some patterns give voltages near zero".to_owned()
                }
            },
        }
    }

    /// One image of a method that couples frames: on elements.
    fn sequence_frame(&self) -> Stage {
        let (m, n, rank) = (self.measurements, self.elements, self.rank);
        let flops = self.directions * (2.0 * (m + n) + 10.0);
        Stage {
            name: "each frame",
            size: format!("{n} elements, rank {rank} at most"),
            flops,
            bytes: 4.0 * flops,
            time_s: 4.0 * flops / READ_BYTES_PER_S,
            why: format!("{rank} scalar smoothers: the problem falls apart into its eigenvectors"),
        }
    }

    /// One frame of the absolute method: each step solves and linearises again.
    fn absolute_step(&self, model: &[Stage]) -> Stage {
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
    fn total_variation(&self, sequence: Sequence) -> Vec<Stage> {
        let (m, n, rank) = (self.measurements, self.skin_pixels, self.directions);
        let count = sequence.solved().unwrap_or(ASSUMED_FRAMES);
        // the kernels work on eight frames at once
        let iteration = |frames: usize| 4.0 * n * rank * frames.next_multiple_of(TV_LANES) as f64;
        let gap = self.scene.reconstruction.target_gap.unwrap_or(DEFAULT_TARGET_GAP);
        let (iterations, whence) = match self.measured {
            Some(row) => (row.iterations, format!("as on {}", row.scene)),
            None => (TV_ITERATIONS, "a guess".to_owned()),
        };
        let set_up = 2.0 * m * 4.0 * self.elements + 4.0 * m * m * n;
        let trials = TV_TRIALS * iterations * iteration(count.min(TV_TRIAL_FRAMES));
        let weights_s = match self.measured {
            // in proportion to the frames that it looks at; other machines are counted in below
            Some(row) if row.choice_s > 0.0 => {
                let frames = |count: usize| count.min(TV_TRIAL_FRAMES).next_multiple_of(TV_LANES);
                let part = frames(count) as f64 / frames(row.frames) as f64;
                row.choice_s * part * 1e9 * row.machine_gflops / FITTED_FLOPS_PER_S
            }
            _ => trials / TV_FLOPS_PER_S,
        };
        let slowness = FITTED_FLOPS_PER_S / self.machine.double_flops_per_s;
        let told = match sequence {
            Sequence::Unknown => format!("{count} frames assumed"),
            Sequence::Frames(1) => "one frame".to_owned(),
            Sequence::Frames(count) => format!("{count} frames"),
            Sequence::Still(count) => format!("the mean of {count} frames"),
        };
        let keys = &self.scene.reconstruction;
        let mut stages = vec![Stage {
            name: "Jacobian of pixels",
            size: format!("[{m}, {n}], rank {} at most", self.rank),
            flops: set_up,
            bytes: 8.0 * m * n,
            time_s: set_up / DECOMPOSITION_FLOPS_PER_S,
            why: "rotated to its independent directions: an iteration works on those".to_owned(),
        }];
        if keys.lambda_space.is_none() && keys.delta.is_none() {
            stages.push(Stage {
                name: "weights",
                size: format!("about {TV_TRIALS} coarse solves"),
                flops: trials,
                bytes: 0.0,
                time_s: weights_s,
                why: format!("on the {TV_TRIAL_FRAMES} frames with the most signal at most"),
            });
        }
        stages.push(Stage {
            name: "iteration",
            size: format!("{n} pixels, {told}"),
            flops: iteration(count),
            bytes: TV_PASSES * 4.0 * n * count as f64,
            time_s: iteration(count) / TV_FLOPS_PER_S,
            why: format!(
                "4 flops a pixel, direction and frame; {TV_PASSES} passes over the movie of 4 bytes \
                 a value"
            ),
        });
        stages.push(Stage {
            name: "solve",
            size: format!("about {iterations:.0} iterations to gap {gap:e}"),
            flops: iterations * iteration(count),
            bytes: iterations * TV_PASSES * 4.0 * n * count as f64,
            time_s: iterations * iteration(count) / TV_FLOPS_PER_S,
            why: format!(
                "iterations {whence}: they vary with touches and noise; {:.0} Gflop/s effective",
                1e-9 * TV_FLOPS_PER_S / slowness
            ),
        });
        stages
    }
}

/// Part of the raster's square that is skin.
pub(super) fn skin_share(setup: &Setup) -> f64 {
    let [low, high] = setup.mesh.surface().bounds_m();
    let side = (high[0] - low[0]).max(high[1] - low[1]);
    (setup.mesh.surface().areas_m2().iter().sum::<f64>() / (side * side)).min(1.0)
}

fn hyperparameter_words(scene: &Scene) -> String {
    let keys = &scene.reconstruction;
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
