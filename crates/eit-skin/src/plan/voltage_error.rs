//! Error of the voltages due to the mesh, compared with the instrument's noise.

use crate::error::SkinError;
use crate::scene::{Accuracy, MESH_NODES, element_text};
use crate::skin::Skin;
use eit_fem::{ElementOrder, MeshSearch, ModelCost, RequiredAccuracy};
use serde::Serialize;

/// Degree of the mesh-free series: on the paper-disc, the two printed digits are the same for degrees 8 to
/// 24.
const PLAN_DEGREE: usize = 12;

/// Errors of the untouched skin's voltages, relative to the largest voltage.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct VoltageError {
    /// Discretisation error; `None` if it cannot be estimated.
    pub of_mesh: Option<f64>,
    /// What it was estimated against.
    against: &'static str,
    /// Standard deviation of the instrument's noise, if the scene states it.
    noise: Option<f64>,
    /// Whether the mesh was chosen for the noise.
    #[serde(skip)]
    by_noise: bool,
    #[serde(rename = "choice")]
    accuracy: Option<Accuracy>,
    #[serde(skip)]
    elements: ElementOrder,
    #[serde(skip)]
    cost: ModelCost,
}

impl VoltageError {
    /// Estimates the error by the mesh-free series if there is one, else by better elements or a finer mesh.
    pub(crate) fn of(skin: &Skin, found: &[f64]) -> Result<Self, SkinError> {
        let largest = found.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let elements = skin.model.element_order();
        let chosen = skin.accuracy.as_ref().map(|accuracy| accuracy.error);
        let (of_mesh, against) = match (skin.series_voltages(PLAN_DEGREE)?, chosen) {
            (Some(exact), _) => {
                let pairs = exact.iter().zip(found);
                let error = pairs.fold(0.0_f64, |m, (exact, found)| m.max((exact - found).abs()));
                (Some(error / largest), "the mesh-free series")
            }
            (None, Some(estimate)) => (estimate, "the meshes that it was chosen among"),
            (None, None) => (
                mesh_error(skin)?,
                match elements {
                    ElementOrder::Linear => "quadratic elements on the same mesh",
                    ElementOrder::Quadratic => "quadratic elements on twice the nodes",
                },
            ),
        };
        Ok(Self {
            of_mesh,
            against,
            noise: skin.settings.noise.additive_v.map(|noise_v| noise_v / largest),
            by_noise: skin.accuracy.as_ref().is_some_and(|accuracy| accuracy.by_noise),
            accuracy: skin.accuracy.clone(),
            elements,
            cost: skin.model.cost(),
        })
    }

    /// Returns lines for the plan.
    pub(crate) fn description(&self) -> Vec<String> {
        let mut lines = vec![match self.of_mesh {
            Some(error) => format!(
                "expected error of the voltages on this mesh: {error:.1e} of the largest \
                 (homogeneous skin, against {})",
                self.against
            ),
            None => {
                "expected error of the voltages: unknown (these elements cannot be judged here \
                     on the mesh of \
                     a file, or with shunts and ideal sources); compare with a finer mesh"
                    .to_owned()
            }
        }];
        lines.push(match (self.noise, self.of_mesh) {
            (Some(noise), Some(error)) => format!(
                "noise of the instrument: {noise:.1e} of the largest voltage, {}",
                if error <= noise {
                    format!("{:.1} times the error of the mesh", noise / error)
                } else if self.accuracy.is_some() {
                    format!("{:.1} times less than the error of the mesh", error / noise)
                } else {
                    format!(
                        "{:.1} times less than the error of the mesh, which differences from a \
                         reference frame cancel in part; required_accuracy = \"noise\" in [mesh] \
                         chooses a mesh below the noise",
                        error / noise
                    )
                }
            ),
            (Some(noise), None) => {
                format!("noise of the instrument: {noise:.1e} of the largest voltage")
            }
            (None, _) => "noise of the instrument: not stated; with noise.additive_v and \
                          required_accuracy = \"noise\" in [mesh] the mesh is chosen for it"
                .to_owned(),
        });
        lines.extend(self.accuracy.as_ref().map(|accuracy| self.choice(accuracy)));
        lines
    }

    /// Describes how the mesh was chosen.
    fn choice(&self, accuracy: &Accuracy) -> String {
        let finest = accuracy.trials.iter().map(|trial| trial.nodes).max();
        format!(
            "mesh chosen for {}: {} elements with {} unknowns; {}{}",
            if self.by_noise { "the noise" } else { "the required accuracy" },
            element_text(self.elements),
            self.cost.unknowns,
            accuracy.description(),
            finest.map_or_else(String::new, |nodes| format!(
                " (judged once, by {} solves on meshes of up to {nodes} nodes)",
                accuracy.trials.len()
            ))
        )
    }
}

/// Estimates the error of the voltages, relative to the largest, on a mesh without a required accuracy:
/// linear elements are compared with quadratic ones on the same mesh, quadratic ones on a generated mesh
/// with those on twice the nodes. `None` if neither is possible: a shunt, an ideal source, or quadratic
/// elements on the mesh of a file.
fn mesh_error(skin: &Skin) -> Result<Option<f64>, SkinError> {
    let impedance = &skin.contact_impedance;
    if impedance.iter().any(|z| *z == 0.0 || z.is_infinite()) {
        return Ok(None);
    }
    let search = MeshSearch {
        protocol: &skin.protocol,
        contact_impedance: impedance,
        conductivity_s: skin.conductivity_s,
        required: RequiredAccuracy::Relative(0.5),
        element_order: None,
        most_nodes: MESH_NODES,
    };
    let estimate = match skin.model.element_order() {
        ElementOrder::Linear => search.of_linear(&skin.mesh)?.error,
        ElementOrder::Quadratic if skin.source.is_file() => return Ok(None),
        ElementOrder::Quadratic => {
            let nodes = 2 * skin.mesh.surface().nodes().len();
            let finer = skin.source.with_nodes(nodes)?.build()?;
            search.of_quadratic(&skin.mesh, &finer.mesh)?.error
        }
    };
    Ok(Some(estimate))
}
