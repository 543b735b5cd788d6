//! Search for the cheapest mesh whose discretisation error meets a required accuracy.
//!
//! A family of meshes is solved from coarse to fine on the homogeneous skin, each mesh with linear
//! and with quadratic elements. The error of a trial is estimated from the largest difference
//! between its voltages and those of a more accurate trial, divided by the largest voltage:
//!
//! | trial | compared with | error estimate |
//! |---|---|---|
//! | linear | quadratic elements of the same or a finer mesh | the difference |
//! | quadratic | quadratic elements, [`FINER`] times the nodes | [`SHARE`] times the difference |
//! | linear, where quadratic elements are not available | linear elements, `FINER^2` times the nodes | [`SHARE`] times the difference |
//!
//! If the error is of second order in the edge length, `n` times the nodes have `1 / n` of the
//! error, and the difference is `1 - 1 / n` of the error. `SHARE = 2` is then exact for `FINER =
//! 2`, and cautious wherever convergence is faster. On meshes of uniform size, the electrode ends
//! limit elements of both orders to second-order convergence.
//!
//! The search returns the cheapest trial that meets the requirement. It ends when every cheaper
//! trial has an error estimate. So the finest mesh that is solved has at most `FINER` times (linear
//! elements alone: `FINER^2` times) the nodes of the chosen mesh, or of a mesh that costs as much.
//! The error is an estimate: meshes are irregular, and a difference can be small by chance
//! (`tests/all/mesh_choice.rs` measures it against the mesh-free series).
//!
//! The file is long because it documents the request, the result and the search in one place.

use crate::element::ElementOrder;
use crate::error::FemError;
use crate::model::checks::check_accuracy;
use crate::model::{ForwardModel, ModelCost};
use crate::protocol::Protocol;
use eit_mesh::Mesh;
use ndarray::Array1;

/// Smallest ratio of the nodes of the finer mesh to those of the mesh whose error it estimates.
const FINER: f64 = 2.0;

/// Ratio of the error to the difference from the finer mesh.
const SHARE: f64 = 2.0;

/// Ratio of edge lengths between successive meshes: the fourth root of one half, which gives about
/// `sqrt(2)` times the nodes.
const STEP: f64 = 0.840_896_415_253_714_6;

/// Cost of storing one byte of the Jacobian, in floating-point operations of the factorisation: 3
/// GB/s against 15 GFLOP/s on the machine of `docs/PERFORMANCE.md`.
const FLOPS_OF_A_BYTE: f64 = 5.0;

/// Required accuracy of the voltages.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum RequiredAccuracy {
    /// Largest error of any voltage, relative to the largest voltage.
    Relative(f64),
    /// Largest error of any voltage, volt; for example the standard deviation of the instrument's
    /// noise.
    Volts(f64),
}

/// Settings of a search for the cheapest mesh that meets a required accuracy.
///
/// ```
/// use eit_fem::{MeshSearch, PairProtocol, RequiredAccuracy};
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// let skin = SkinShape::Disc { radius_m: 0.1 };
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let protocol = PairProtocol::default().protocol()?;
/// let search = MeshSearch {
///     protocol: &protocol,
///     contact_impedance: &[1e3; 16],
///     conductivity_s: 1e-5,
///     required: RequiredAccuracy::Relative(1e-3),
///     element_order: None,
///     most_nodes: 50_000,
/// };
/// let chosen = search.run(|scale| {
///     let settings = MeshSettings::default().similar(&skin, 0.0196, scale)?;
///     Ok::<_, Box<dyn std::error::Error>>(generate(&skin, &electrodes, &settings)?)
/// })?;
/// assert!(chosen.error <= 1e-3 && chosen.mesh.surface().nodes().len() < 1000);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct MeshSearch<'a> {
    /// Stimulation and measurement protocol.
    pub protocol: &'a Protocol,
    /// Contact impedance of each electrode, as for [`ForwardModel::new`].
    pub contact_impedance: &'a [f64],
    /// Conductivity of the homogeneous skin, siemens.
    pub conductivity_s: f64,
    /// Required accuracy of the voltages.
    pub required: RequiredAccuracy,
    /// Order of the elements; `None` chooses the cheaper one.
    pub element_order: Option<ElementOrder>,
    /// Largest number of nodes of a mesh that is solved.
    pub most_nodes: usize,
}

/// One trial of a search: a mesh with elements of one order.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct MeshTrial {
    /// Number of nodes of the mesh.
    pub nodes: usize,
    /// Order of the elements.
    pub element_order: ElementOrder,
    /// Size and cost of the model.
    pub cost: ModelCost,
    /// Estimated error of the voltages, relative to the largest; `None` if no finer mesh was solved
    /// to estimate it.
    pub error: Option<f64>,
}

impl MeshTrial {
    /// Cost of voltages and Jacobian, in floating-point operations of the factorisation; stores of
    /// the Jacobian are converted by [`FLOPS_OF_A_BYTE`]. It ranks trials and does not predict a
    /// time.
    fn work(&self, measurements: usize, triangles: usize) -> f64 {
        let cost = &self.cost;
        let fields = 2.0 * cost.factor_entries as f64 * cost.field_solves as f64;
        let stored_bytes = 8.0 * measurements as f64 * triangles as f64;
        cost.factor_flops + fields + cost.product_flops + FLOPS_OF_A_BYTE * stored_bytes
    }
}

/// Result of a mesh search.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ChosenMesh {
    /// Mesh that the search ended with.
    pub mesh: Mesh,
    /// Order of the elements to use on it.
    pub element_order: ElementOrder,
    /// Estimated error of the voltages, relative to the largest.
    pub error: f64,
    /// Required accuracy, relative to the largest voltage.
    pub required: f64,
    /// Largest voltage, volt.
    pub largest_v: f64,
    /// All trials, in the order in which they were solved.
    pub trials: Vec<MeshTrial>,
}

/// Estimated discretisation error of one mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Estimate {
    /// Error of the voltages, relative to the largest.
    pub error: f64,
    /// Required accuracy, relative to the largest voltage.
    pub required: f64,
    /// Largest voltage, volt.
    pub largest_v: f64,
}

/// A mesh with its trials and their voltages.
struct Level {
    mesh: Mesh,
    trials: Vec<(MeshTrial, Array1<f64>)>,
}

/// Position of a trial: its level and its index within the level.
#[derive(Clone, Copy)]
struct TrialIndex {
    level: usize,
    trial: usize,
}

impl MeshSearch<'_> {
    /// Searches the family of meshes made by `mesh_of`. It is called with a scale, from 1 downward,
    /// and must return similar meshes whose edge lengths are proportional to it
    /// ([`MeshSettings::similar`](eit_mesh::MeshSettings) makes such a family).
    ///
    /// # Errors
    /// Those of `mesh_of` and of [`ForwardModel::solve`]; a required accuracy that is not above
    /// zero, or is outside `4 eps` to 1 relative to the largest voltage;
    /// [`FemError::NoMeshSuffices`].
    pub fn run<E: From<FemError>>(
        &self,
        mut mesh_of: impl FnMut(f64) -> Result<Mesh, E>,
    ) -> Result<ChosenMesh, E> {
        let orders = self.orders()?;
        let mut levels: Vec<Level> = Vec::new();
        let mut scale = 1.0;
        loop {
            let mesh = mesh_of(scale)?;
            let nodes = mesh.surface().nodes().len();
            // the smallest scale ends the search if `mesh_of` does not follow the scale
            if nodes > self.most_nodes || scale < 1e-4 {
                return Err(self.none(&levels).into());
            }
            scale *= STEP;
            // where corners keep a mesh fine, the next scale may give the same mesh
            if levels.last().is_some_and(|level| level.mesh.surface().nodes().len() >= nodes) {
                continue;
            }
            levels.push(self.solved(mesh, orders)?);
            self.judge(&mut levels);
            let (required, largest_v) = self.relative(&levels)?;
            if let Some(place) = self.settled(&levels, required) {
                return Ok(chosen(levels, place, required, largest_v));
            }
        }
    }

    /// Estimates the error of linear elements from quadratic elements on the same mesh. Use it for
    /// a single mesh, such as one read from a file.
    ///
    /// # Errors
    /// Those of [`ForwardModel::with_element_order`] and [`ForwardModel::solve`], and of
    /// [`MeshSearch::run`] for the required accuracy.
    pub fn of_linear(&self, mesh: &Mesh) -> Result<Estimate, FemError> {
        self.estimate(mesh, ElementOrder::Linear, mesh, 1.0)
    }

    /// Estimates the error of quadratic elements from quadratic elements on a mesh with twice the
    /// nodes.
    ///
    /// # Errors
    /// Those of [`MeshSearch::of_linear`].
    pub fn of_quadratic(&self, mesh: &Mesh, finer: &Mesh) -> Result<Estimate, FemError> {
        self.estimate(mesh, ElementOrder::Quadratic, finer, SHARE)
    }

    fn estimate(
        &self,
        mesh: &Mesh,
        order: ElementOrder,
        judge: &Mesh,
        share: f64,
    ) -> Result<Estimate, FemError> {
        self.orders()?;
        let (_, found) = self.trial(mesh, order)?;
        let (_, best) = self.trial(judge, ElementOrder::Quadratic)?;
        let largest_v = largest(&best);
        let required = self.required_of(largest_v)?;
        Ok(Estimate { error: share * difference(&found, &best), required, largest_v })
    }

    /// Element orders to solve with, the most accurate last.
    fn orders(&self) -> Result<&'static [ElementOrder], FemError> {
        let (quantity, value) = match self.required {
            RequiredAccuracy::Relative(value) => {
                check_accuracy(value)?;
                ("required_accuracy", value)
            }
            RequiredAccuracy::Volts(value) => ("required accuracy, volt", value),
        };
        FemError::require(quantity, value, value > 0.0, "finite and above zero")?;
        let limit = self.contact_impedance.iter().any(|z| *z == 0.0 || z.is_infinite());
        Ok(if limit && self.element_order != Some(ElementOrder::Quadratic) {
            &[ElementOrder::Linear]
        } else {
            &[ElementOrder::Linear, ElementOrder::Quadratic]
        })
    }

    fn trial(
        &self,
        mesh: &Mesh,
        order: ElementOrder,
    ) -> Result<(MeshTrial, Array1<f64>), FemError> {
        let model =
            ForwardModel::with_element_order(mesh, self.protocol, self.contact_impedance, order)?;
        let voltages = model.forward(&vec![self.conductivity_s; model.elements()])?;
        let nodes = mesh.surface().nodes().len();
        Ok((MeshTrial { nodes, element_order: order, cost: model.cost(), error: None }, voltages))
    }

    fn solved(&self, mesh: Mesh, orders: &[ElementOrder]) -> Result<Level, FemError> {
        let trials: Result<_, _> = orders.iter().map(|&order| self.trial(&mesh, order)).collect();
        Ok(Level { trials: trials?, mesh })
    }

    /// Estimates errors from the finest mesh with the most accurate elements.
    fn judge(&self, levels: &mut [Level]) {
        let Some((judge, best)) = levels.last().and_then(|level| level.trials.last()).cloned()
        else {
            return;
        };
        for (trial, voltages) in levels.iter_mut().flat_map(|level| &mut level.trials) {
            let finer = match (trial.element_order, judge.element_order) {
                (ElementOrder::Linear, ElementOrder::Quadratic) => {
                    trial.error = Some(difference(voltages, &best));
                    continue;
                }
                (ElementOrder::Quadratic, _) => FINER,
                (ElementOrder::Linear, ElementOrder::Linear) => FINER * FINER,
            };
            // meshes meet the requested number of nodes only to within a tenth
            if judge.nodes as f64 >= 0.9 * finer * trial.nodes as f64 {
                trial.error = Some(SHARE * difference(voltages, &best));
            }
        }
    }

    /// Required accuracy relative to the largest voltage, and the largest voltage.
    fn relative(&self, levels: &[Level]) -> Result<(f64, f64), FemError> {
        let finest = levels.last().and_then(|level| level.trials.last());
        let largest_v = finest.map_or(0.0, |(_, voltages)| largest(voltages));
        Ok((self.required_of(largest_v)?, largest_v))
    }

    fn required_of(&self, largest_v: f64) -> Result<f64, FemError> {
        let required = match self.required {
            RequiredAccuracy::Relative(value) => value,
            RequiredAccuracy::Volts(value) => value / largest_v,
        };
        // a requirement above 1 is valid: every mesh meets it
        check_accuracy(required.min(0.5))?;
        Ok(required)
    }

    /// The cheapest trial that meets the requirement, once every cheaper trial has an error
    /// estimate.
    fn settled(&self, levels: &[Level], required: f64) -> Option<TrialIndex> {
        let mut best: Option<(f64, TrialIndex)> = None;
        let mut waiting = f64::INFINITY;
        for (l, level) in levels.iter().enumerate() {
            let triangles = level.mesh.surface().triangles().len();
            for (t, (trial, _)) in
                level.trials.iter().enumerate().filter(|(_, t)| self.allows(&t.0))
            {
                let work = trial.work(self.protocol.measurements(), triangles);
                match trial.error {
                    None => waiting = waiting.min(work),
                    Some(error)
                        if error <= required && best.is_none_or(|(least, _)| work < least) =>
                    {
                        best = Some((work, TrialIndex { level: l, trial: t }));
                    }
                    Some(_) => {}
                }
            }
        }
        best.filter(|(work, _)| *work <= waiting).map(|(_, place)| place)
    }

    fn allows(&self, trial: &MeshTrial) -> bool {
        self.element_order.is_none_or(|order| order == trial.element_order)
    }

    fn none(&self, levels: &[Level]) -> FemError {
        let trials = levels.iter().flat_map(|level| level.trials.iter().map(|(trial, _)| trial));
        let allowed = trials.filter(|trial| self.allows(trial));
        let judged = allowed.filter_map(|trial| Some((trial.error?, trial.nodes)));
        let least = judged.min_by(|a, b| a.0.total_cmp(&b.0));
        let (reached, nodes) = least.unwrap_or((f64::INFINITY, 0));
        let required = self.relative(levels).map_or(f64::NAN, |(required, _)| required);
        FemError::NoMeshSuffices { reached, nodes, required, most_nodes: self.most_nodes }
    }
}

/// Moves the chosen mesh out of its level and assembles the result.
fn chosen(mut levels: Vec<Level>, place: TrialIndex, required: f64, largest_v: f64) -> ChosenMesh {
    let found = levels[place.level].trials[place.trial].0;
    let trials = levels.iter().flat_map(|l| l.trials.iter().map(|(trial, _)| *trial)).collect();
    ChosenMesh {
        mesh: levels.swap_remove(place.level).mesh,
        element_order: found.element_order,
        error: found.error.unwrap_or(f64::INFINITY),
        required,
        largest_v,
        trials,
    }
}

/// Largest difference, relative to the largest value of `wanted`.
fn difference(found: &Array1<f64>, wanted: &Array1<f64>) -> f64 {
    let pairs = found.iter().zip(wanted);
    pairs.fold(0.0_f64, |m, (f, w)| m.max((f - w).abs())) / largest(wanted)
}

fn largest(values: &Array1<f64>) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}
