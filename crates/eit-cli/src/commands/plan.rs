//! `eit plan`: what a scene needs, what is left out and why.

use super::Answer;
use crate::cli::PlanArgs;
use crate::error::CliError;
use crate::pipeline::{self, DEFAULT_NOISE_FIGURE, DEFAULT_PIXELS, Setup};
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Hyperparameter, OneOrMany, Rule, Scene, Shape};
use eit_fem::analytic::DiscSeries;
use eit_mesh::{Placement, Quality};
use serde_json::{Value, json};

/// Rates behind the predicted times, fitted by hand on one core of the machine of
/// `docs/PERFORMANCE.md` with 16 electrodes at 2 000 and 20 000 nodes: sparse factorisation with
/// its overhead per element, backward sweeps, priors per entry of the Jacobian, dense products and
/// factorisations, stores to memory, reads from cache. Elsewhere they are a guide, not a promise.
const FACTOR_FLOPS_PER_S: f64 = 8e9;
const ELEMENT_S: f64 = 1.5e-7;
const SWEEP_FLOPS_PER_S: f64 = 4e9;
const PRIOR_ENTRY_S: f64 = 5e-8;
const PRODUCT_FLOPS_PER_S: f64 = 2e10;
const DECOMPOSITION_FLOPS_PER_S: f64 = 1e10;
const STORE_BYTES_PER_S: f64 = 6e9;
const READ_BYTES_PER_S: f64 = 1.5e10;
/// Meshing, seconds a node.
const NODE_S: f64 = 1e-5;

/// The mesh-free series costs `electrodes^2` sums of Bessel products: 0.1 s for 16, 0.5 s for 32.
const MOST_SERIES_ELECTRODES: usize = 32;

/// One stage of the plan.
struct Stage {
    name: &'static str,
    size: String,
    flops: f64,
    bytes: f64,
    time_s: f64,
    why: String,
}

/// Builds what sizes need (mesh and symbolic factorisation), predicts the rest.
pub(crate) fn run(args: &PlanArgs) -> Result<Answer, CliError> {
    if args.print_scene {
        let text = Scene::text(&args.scene)?;
        let json = json!({ "scene": text });
        return Ok(Answer { text: text.trim_end().to_owned(), json });
    }
    let scene = Scene::load(&args.scene)?;
    let mut progress = Progress::default();
    let setup = pipeline::setup(&scene, None, None, &mut progress)?;
    let stages = stages(&scene, &setup);
    let left_out = left_out(&scene, &setup);
    let voltage_error = progress.stage("mesh-free comparison", || voltage_error(&scene, &setup))?;
    let json = json!({
        "scene": scene.name,
        "stages": stages.iter().map(stage_json).collect::<Vec<_>>(),
        "left_out": left_out.iter().map(|(what, why)| json!({"what": what, "why": why}))
            .collect::<Vec<_>>(),
        "expected_voltage_error": voltage_error,
        "built": progress.times(),
    });
    let mut lines = vec![format!("{}: what is done", scene.name)];
    for s in &stages {
        lines.push(format!(
            "  {:<22} {:<44} {:>9} flop {:>9} B {:>9} s",
            s.name,
            s.size,
            short(s.flops),
            short(s.bytes),
            short(s.time_s)
        ));
        lines.push(format!("  {:<22} {}", "", s.why));
    }
    lines.push(match voltage_error {
        Some(error) => format!(
            "expected error of the voltages on this mesh: {:.1e} of the largest (homogeneous \
             skin, against the mesh-free series)",
            error
        ),
        None => {
            "expected error of the voltages: not computed (the mesh-free series is for discs of \
                 at most 32 equal electrodes); compare with a finer [mesh]"
                .to_owned()
        }
    });
    lines.push("left out".to_owned());
    lines.extend(left_out.iter().map(|(what, why)| format!("  {what:<22} {why}")));
    Ok(Answer { text: lines.join("\n"), json })
}

fn stages(scene: &Scene, setup: &Setup) -> Vec<Stage> {
    let cost = setup.model.cost();
    let quality = Quality::of(&setup.mesh);
    let (m, n) = (setup.protocol.measurements() as f64, setup.model.elements() as f64);
    let entries = cost.factor_entries as f64;
    let solves = cost.field_solves as f64;
    let sweep = 2.0 * entries * solves;
    let products = 3.0 * cost.field_products as f64 * n;
    let pixels = scene.reconstruction.pixels.unwrap_or(DEFAULT_PIXELS);
    let electrodes = setup.protocol.electrodes() as f64;
    // reciprocity leaves L (L - 1) / 2 independent measurements at most; smooth priors fewer
    let rank = m.min(cost.field_products as f64).min(n).min(0.5 * electrodes * (electrodes - 1.0));
    let products_flops = m * m * n + 2.0 * m * n * rank;
    let decomposition = 4.0 * m * rank * rank;
    let skin_pixels = skin_share(setup) * (pixels * pixels) as f64;
    let image = 2.0 * rank * (m + skin_pixels);
    vec![
        Stage {
            name: "mesh",
            size: format!("{} nodes, {} triangles", quality.nodes, quality.triangles),
            flops: 0.0,
            bytes: 24.0 * quality.nodes as f64 + 12.0 * n,
            time_s: NODE_S * quality.nodes as f64,
            why: match scene.skin.shape {
                Shape::Mesh => "read from the scene's file".to_owned(),
                _ => format!(
                    "graded to the electrode ends, mean quality {:.3}",
                    quality.mean_quality
                ),
            },
        },
        Stage {
            name: "forward",
            size: format!("{} unknowns, factor {} entries", cost.unknowns, cost.factor_entries),
            flops: cost.factor_flops,
            bytes: 8.0 * entries,
            time_s: cost.factor_flops / FACTOR_FLOPS_PER_S + ELEMENT_S * n,
            why: "one factorisation gives all voltages: electrodes are eliminated last".to_owned(),
        },
        Stage {
            name: "Jacobian",
            size: format!("[{m}, {n}], {} fields, {} products", solves, cost.field_products),
            flops: sweep + products,
            bytes: 8.0 * m * n,
            time_s: sweep / SWEEP_FLOPS_PER_S + 8.0 * m * n / STORE_BYTES_PER_S,
            why: format!(
                "{} patterns span {solves} fields; reciprocal measurements share a product",
                setup.protocol.stimulations_a().nrows()
                    + setup.protocol.measurement_patterns().nrows()
            ),
        },
        Stage {
            name: "reconstruction matrix",
            size: format!("{m} x {m} in measurement space"),
            flops: products_flops + decomposition,
            bytes: 8.0 * (m * n + m * m),
            time_s: PRIOR_ENTRY_S * m * n
                + products_flops / PRODUCT_FLOPS_PER_S
                + decomposition / DECOMPOSITION_FLOPS_PER_S,
            why: hyperparameter_words(scene),
        },
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
        },
    ]
}

/// Part of the raster's square that is skin.
fn skin_share(setup: &Setup) -> f64 {
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

/// What the scene does not use, and why.
fn left_out(scene: &Scene, setup: &Setup) -> Vec<(&'static str, String)> {
    let cost = setup.model.cost();
    let patterns = setup.protocol.stimulations_a().nrows();
    let (m, products) = (setup.protocol.measurements(), cost.field_products);
    let mut list = vec![
        ("complex arithmetic", "the scene has no reactive part".to_owned()),
        (
            "forward sweeps",
            "currents enter at electrodes only, which are eliminated last".to_owned(),
        ),
        (
            "field solves",
            format!(
                "{} of {} patterns: the others are combinations",
                {
                    (patterns + setup.protocol.measurement_patterns().nrows())
                        .saturating_sub(cost.field_solves)
                },
                patterns + setup.protocol.measurement_patterns().nrows()
            ),
        ),
    ];
    if m > products {
        let why = format!("{} of {m} rows are multiples of others (reciprocity)", m - products);
        list.push(("Jacobian products", why));
    }
    list.push(("time coupling", "one-step Gauss-Newton takes each frame by itself".to_owned()));
    if scene.denoise.is_none() {
        list.push(("U-net", "the scene has no [denoise]".to_owned()));
    }
    if scene.instrument.is_none() {
        list.push(("instrument", "the scene has no [instrument]: recorded frames only".to_owned()));
    }
    list
}

/// Error of this mesh on the homogeneous disc, relative to the largest voltage.
fn voltage_error(scene: &Scene, setup: &Setup) -> Result<Option<f64>, CliError> {
    if scene.skin.shape == Shape::Mesh || setup.protocol.electrodes() > MOST_SERIES_ELECTRODES {
        return Ok(None);
    }
    let electrodes = scene.rim_electrodes()?;
    let (Some(radius_m), Placement::EquallySpaced { count, first_angle_deg, direction }) =
        (scene.skin.radius_m.filter(|_| scene.skin.shape == Shape::Disc), &electrodes.placement)
    else {
        return Ok(None);
    };
    let Some(OneOrMany::One(contact_impedance_ohm_m)) = scene.electrodes.contact_impedance_ohm_m
    else {
        return Ok(None);
    };
    let turn = match direction {
        eit_mesh::Direction::Counterclockwise => 1.0,
        eit_mesh::Direction::Clockwise => -1.0,
    };
    let step = turn * std::f64::consts::TAU / *count as f64;
    let series = DiscSeries {
        radius_m,
        conductivity_s: scene.skin.conductivity_s,
        electrode_angles_rad: (0..*count)
            .map(|l| first_angle_deg.to_radians() + step * l as f64)
            .collect(),
        electrode_width_m: electrodes.width_m,
        contact_impedance_ohm_m,
        // the two digits printed do not change from degree 8 to 24 on the paper-disc
        degree: 12,
        harmonics: 2000,
    };
    let exact = series.electrode_potentials(setup.protocol.stimulations_a())?;
    let background = vec![scene.skin.conductivity_s; setup.model.elements()];
    let mut workspace = setup.model.workspace()?;
    let found = setup.model.solve(&background, &mut workspace)?.measurements();
    let patterns = setup.protocol.measurement_patterns();
    let exact = setup
        .protocol
        .data()
        .iter()
        .map(|&[s, m]| exact.row(s as usize).dot(&patterns.row(m as usize)));
    let (mut largest, mut error) = (0.0_f64, 0.0_f64);
    for (exact, found) in exact.zip(&found) {
        largest = largest.max(exact.abs());
        error = error.max((exact - found).abs());
    }
    Ok(Some(error / largest))
}

fn stage_json(stage: &Stage) -> Value {
    json!({
        "stage": stage.name,
        "size": stage.size,
        "flops": stage.flops,
        "bytes": stage.bytes,
        "expected_time_s": stage.time_s,
        "why": stage.why,
    })
}

/// Three digits and a power of ten.
fn short(value: f64) -> String {
    if value == 0.0 { "-".to_owned() } else { format!("{value:.1e}") }
}
