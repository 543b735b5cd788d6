//! Stages of a plan: size, work, expected time.

use super::electrodes;
use super::machine::Machine;
use super::measured::Measured;
use super::rates::{
    ELEMENT_S, ELIMINATED_NODE_S, EXTENDED_NODE_S, FACTOR_FLOPS_PER_S, NODE_S, SWEEP_FLOPS_PER_S,
    USUAL_DIRECTIONS,
};
use super::sequence::Sequence;
use super::sizes::Sizes;
use super::stage::{Stage, scale, store_rate};
use crate::method::Method;
use crate::skin::Skin;
use eit_fem::{ElementOrder, SolvePath};
use eit_mesh::{Mesh, Quality};

/// Returns the stages of a method, in order.
pub(crate) fn of(
    skin: &Skin,
    method: Method,
    sequence: Sequence,
    machine: &Machine,
    measured: Option<&Measured>,
) -> Vec<Stage> {
    let cost = skin.model.cost();
    let (m, n) = (skin.protocol.measurements() as f64, skin.model.elements() as f64);
    let pixels = skin.pixels();
    let electrodes = skin.protocol.electrodes() as f64;
    // reciprocity leaves at most L (L - 1) / 2 independent measurements; smooth priors leave fewer
    let rank = m.min(cost.field_products as f64).min(n).min(0.5 * electrodes * (electrodes - 1.0));
    let sizes = Sizes {
        measured,
        machine,
        skin,
        measurements: m,
        elements: n,
        pixels,
        skin_pixels: (skin_share(skin) * (pixels * pixels) as f64).round(),
        rank,
        directions: rank.min(USUAL_DIRECTIONS),
    };
    let mut stages = sizes.model();
    if method != Method::GaussNewtonAbsolute {
        stages.extend(electrodes::of(skin));
    }
    match method {
        Method::StTv | Method::Tv => stages.extend(sizes.total_variation(sequence)),
        Method::GaussNewton => stages.extend([sizes.matrix(), sizes.frame()]),
        Method::TimePrior => {
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

/// Mesh, generated or read.
pub(super) fn mesh_stage(from_file: bool, mesh: &Mesh) -> Stage {
    let quality = Quality::of(mesh);
    Stage {
        name: "mesh",
        size: format!("{} nodes, {} triangles", quality.nodes, quality.triangles),
        flops: 0.0,
        bytes: 24.0 * quality.nodes as f64 + 12.0 * quality.triangles as f64,
        time_s: NODE_S * quality.nodes as f64,
        why: match from_file {
            true => "read from the scene's file".to_owned(),
            false => {
                format!("graded to the electrode ends, mean quality {:.3}", quality.mean_quality)
            }
        },
    }
}

/// Returns the solve at which images are linearised, if textbook assembly may lose too many digits.
pub(crate) fn linearisation(skin: &Skin, path: SolvePath, machine: &Machine) -> Option<Stage> {
    let (node_s, numbers) = match path {
        SolvePath::NodalAssembly => return None,
        SolvePath::ElectrodesEliminated => (ELIMINATED_NODE_S, "f64"),
        SolvePath::ExtendedPrecision => (EXTENDED_NODE_S, "twice the precision"),
    };
    let nodes = skin.mesh.surface().nodes().len() as f64;
    let mut stages = [Stage {
        name: "linearisation",
        size: format!("once, electrodes by their means, {numbers}"),
        flops: 0.0,
        bytes: 0.0,
        time_s: nodes * node_s,
        why: "contacts or contrast would cost nodal assembly too many digits".to_owned(),
    }];
    scale(&mut stages, machine);
    stages.into_iter().next()
}

impl Sizes<'_> {
    /// Mesh, forward solution and Jacobian, which all methods need.
    fn model(&self) -> Vec<Stage> {
        let skin = self.skin;
        let (m, n) = (self.measurements, self.elements);
        let cost = skin.model.cost();
        let entries = cost.factor_entries as f64;
        let solves = cost.field_solves as f64;
        let sweep = 2.0 * entries * solves;
        let kind = match skin.model.element_order() {
            ElementOrder::Linear => "",
            ElementOrder::Quadratic => "quadratic elements; ",
        };
        vec![
            mesh_stage(skin.source.is_file(), &skin.mesh),
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
                    skin.protocol.stimulations_a().nrows()
                        + skin.protocol.measurement_patterns().nrows()
                ),
            },
        ]
    }
}

/// Returns the fraction of the raster's square that is skin.
pub(crate) fn skin_share(skin: &Skin) -> f64 {
    let [low, high] = skin.mesh.surface().bounds_m();
    let side = (high[0] - low[0]).max(high[1] - low[1]);
    (skin.mesh.surface().areas_m2().iter().sum::<f64>() / (side * side)).min(1.0)
}
