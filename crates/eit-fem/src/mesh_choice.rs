//! The coarsest mesh whose discretisation stays below a required accuracy, at least cost.
//!
//! Meshes of a family are solved from coarse to fine, each with linear and with quadratic elements,
//! on the homogeneous skin. The error of a trial is the largest difference of its voltages from
//! those of a better one, over the largest voltage:
//!
//! | trial | judged by | taken as its error |
//! |---|---|---|
//! | linear | quadratic elements of the same or a finer mesh | the difference |
//! | quadratic | quadratic elements, [`FINER`] times the nodes | [`SHARE`] times the difference |
//! | linear, where quadratic elements are not defined | linear elements, `FINER^2` times the nodes | [`SHARE`] times the difference |
//!
//! With errors of order two in the edge length, `n` times the nodes have `1 / n` of the error, and a
//! difference is `1 - 1 / n` of it: `SHARE = 2` is exact for `FINER = 2`, and cautious wherever
//! convergence is faster. Electrode ends hold elements of both orders to second order on even meshes.
//!
//! Of the trials that meet the requirement the cheapest is chosen; the search ends when no cheaper
//! one is left to be judged. So the finest mesh that is solved has at most `FINER` times (linear
//! elements alone: `FINER^2` times) the nodes of the chosen one or those of one that costs as much.
//! It is an estimate: meshes are irregular, and a difference can be small by chance (measured
//! against the mesh-free series in `tests/mesh_choice.rs`).
//!
//! Long, because question, answer and search are documented in one place.

use crate::element::ElementOrder;
use crate::error::FemError;
use crate::model::checks::check_accuracy;
use crate::model::{ForwardModel, ModelCost};
use crate::protocol::Protocol;
use eit_mesh::Mesh;
use ndarray::Array1;

/// Nodes of the mesh that judges over those of the one that is judged, at least.
const FINER: f64 = 2.0;

/// Error over the difference from the mesh that judges.
const SHARE: f64 = 2.0;

/// Edges of a mesh over those of the one before it: the fourth root of a half, about `sqrt(2)` times
/// the nodes.
const STEP: f64 = 0.840_896_415_253_714_6;

/// Where a search ends at the latest, should `mesh_of` not follow the scale.
const LEAST_SCALE: f64 = 1e-4;

/// What a stored byte of the Jacobian costs, in floating point operations of the factorisation:
/// 3 GB/s against 15 GFLOP/s on the machine of `docs/PERFORMANCE.md`.
const FLOPS_OF_A_BYTE: f64 = 5.0;

/// How exact voltages have to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RequiredAccuracy {
    /// Largest error of a voltage over the largest voltage.
    Relative(f64),
    /// Largest error of a voltage, volt: the standard deviation of the instrument's noise, for
    /// example.
    Volts(f64),
}

/// What a mesh is searched for.
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
    /// Stimulation and measurement.
    pub protocol: &'a Protocol,
    /// One value per electrode, as for [`ForwardModel::new`].
    pub contact_impedance: &'a [f64],
    /// Of the homogeneous skin, siemens.
    pub conductivity_s: f64,
    /// What the discretisation has to stay below.
    pub required: RequiredAccuracy,
    /// The order of the elements; `None`: the cheaper one.
    pub element_order: Option<ElementOrder>,
    /// No mesh of more nodes is solved.
    pub most_nodes: usize,
}

/// A mesh that was tried with elements of one order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshTrial {
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Order of its elements.
    pub element_order: ElementOrder,
    /// Size and work.
    pub cost: ModelCost,
    /// Estimated error of the voltages over the largest; `None` where no finer mesh judged it.
    pub error: Option<f64>,
}

impl MeshTrial {
    /// Cost of voltages and Jacobian in floating point operations of the factorisation, with what
    /// its stores take counted as such: an order of costs, not a time.
    fn work(&self, measurements: usize, triangles: usize) -> f64 {
        let cost = &self.cost;
        let fields = 2.0 * cost.factor_entries as f64 * cost.field_solves as f64;
        let stored_bytes = 8.0 * measurements as f64 * triangles as f64;
        cost.factor_flops + fields + cost.product_flops + FLOPS_OF_A_BYTE * stored_bytes
    }
}

/// The mesh that was found.
#[derive(Debug, Clone)]
pub struct ChosenMesh {
    /// Solve on this mesh,
    pub mesh: Mesh,
    /// with elements of this order.
    pub element_order: ElementOrder,
    /// Estimated error of the voltages over the largest one.
    pub error: f64,
    /// What was required, relative to the largest voltage.
    pub required: f64,
    /// The largest voltage, volt.
    pub largest_v: f64,
    /// Everything that was solved, in that order.
    pub trials: Vec<MeshTrial>,
}

/// An estimated error of the discretisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Of the voltages, over the largest one.
    pub error: f64,
    /// What was required, relative to the largest voltage.
    pub required: f64,
    /// The largest voltage, volt.
    pub largest_v: f64,
}

/// A mesh, its trials, and the voltages of each.
struct Level {
    mesh: Mesh,
    trials: Vec<(MeshTrial, Array1<f64>)>,
}

/// Where a trial stands: its level, and its place in that.
#[derive(Clone, Copy)]
struct Place {
    level: usize,
    trial: usize,
}

impl MeshSearch<'_> {
    /// Searches among the meshes of `mesh_of`: similar ones, whose edges are all in proportion to the
    /// scale that it is given, from 1 on downward ([`MeshSettings::similar`](eit_mesh::MeshSettings)
    /// makes such a family).
    ///
    /// # Errors
    /// Those of `mesh_of` and of [`ForwardModel::solve`]; a required accuracy that is not above
    /// zero, or not between `4 eps` and 1 of the largest voltage; [`FemError::NoMeshSuffices`].
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
            if nodes > self.most_nodes || scale < LEAST_SCALE {
                return Err(self.none(&levels).into());
            }
            scale *= STEP;
            // where corners hold a mesh fine, the next ones may be the same
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

    /// Estimates the error of linear elements by quadratic ones on the same mesh: for meshes that
    /// have no family, such as those of files.
    ///
    /// # Errors
    /// Those of [`ForwardModel::with_element_order`] and [`ForwardModel::solve`], and of
    /// [`MeshSearch::run`] for the required accuracy.
    pub fn of_linear(&self, mesh: &Mesh) -> Result<Estimate, FemError> {
        self.estimate(mesh, ElementOrder::Linear, mesh, 1.0)
    }

    /// Estimates the error of quadratic elements by those on a mesh of twice the nodes.
    ///
    /// # Errors
    /// As [`MeshSearch::of_linear`].
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

    /// Orders of elements that are solved, the best last.
    fn orders(&self) -> Result<&'static [ElementOrder], FemError> {
        let (quantity, value) = match self.required {
            RequiredAccuracy::Relative(value) => {
                check_accuracy(value)?;
                ("required_accuracy", value)
            }
            RequiredAccuracy::Volts(value) => ("required accuracy, volt", value),
        };
        if !(value.is_finite() && value > 0.0) {
            return Err(FemError::OutOfRange { quantity, value, must: "finite and above zero" });
        }
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

    /// Estimates errors by the finest mesh with the best elements.
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
            // meshes have about as many nodes as they were asked for: within a tenth
            if judge.nodes as f64 >= 0.9 * finer * trial.nodes as f64 {
                trial.error = Some(SHARE * difference(voltages, &best));
            }
        }
    }

    /// The requirement over the largest voltage, and the largest voltage.
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
        // that any mesh suffices is no error
        check_accuracy(required.min(0.5))?;
        Ok(required)
    }

    /// The cheapest trial that meets the requirement, once none that is cheaper waits to be judged.
    fn settled(&self, levels: &[Level], required: f64) -> Option<Place> {
        let allowed =
            |trial: &MeshTrial| self.element_order.is_none_or(|order| order == trial.element_order);
        let mut best: Option<(f64, Place)> = None;
        let mut waiting = f64::INFINITY;
        for (l, level) in levels.iter().enumerate() {
            let triangles = level.mesh.surface().triangles().len();
            for (t, (trial, _)) in level.trials.iter().enumerate().filter(|(_, t)| allowed(&t.0)) {
                let work = trial.work(self.protocol.measurements(), triangles);
                match trial.error {
                    None => waiting = waiting.min(work),
                    Some(error)
                        if error <= required && best.is_none_or(|(least, _)| work < least) =>
                    {
                        best = Some((work, Place { level: l, trial: t }));
                    }
                    Some(_) => {}
                }
            }
        }
        best.filter(|(work, _)| *work <= waiting).map(|(_, place)| place)
    }

    fn none(&self, levels: &[Level]) -> FemError {
        let allowed = |trial: &&MeshTrial| {
            self.element_order.is_none_or(|order| order == trial.element_order)
        };
        let trials = levels.iter().flat_map(|level| level.trials.iter().map(|(trial, _)| trial));
        let judged = trials.filter(allowed).filter_map(|trial| Some((trial.error?, trial.nodes)));
        let least = judged.min_by(|a, b| a.0.total_cmp(&b.0));
        let (reached, nodes) = least.unwrap_or((f64::INFINITY, 0));
        let required = self.relative(levels).map_or(f64::NAN, |(required, _)| required);
        FemError::NoMeshSuffices { reached, nodes, required, most_nodes: self.most_nodes }
    }
}

/// Takes the chosen mesh out of its level.
fn chosen(mut levels: Vec<Level>, place: Place, required: f64, largest_v: f64) -> ChosenMesh {
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

/// Largest difference over the largest value of the second.
fn difference(found: &Array1<f64>, wanted: &Array1<f64>) -> f64 {
    let pairs = found.iter().zip(wanted);
    pairs.fold(0.0_f64, |m, (f, w)| m.max((f - w).abs())) / largest(wanted)
}

fn largest(values: &Array1<f64>) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}
