//! From a scene to its stages: mesh, linearised forward model, reconstruction, raster.
//!
//! Each stage is built only where a command needs it.

mod expected;
pub mod imaging;
pub mod mesh_choice;
pub mod movement;
pub mod noise;
mod part;
pub mod reactive;
pub mod sequence;
pub mod series;
pub mod touches;
pub mod tv;

pub use imaging::{Imaging, imaging};

use crate::error::SkinError;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Scene};
use eit_fem::{ElementOrder, ForwardModel, Protocol, Solution, SolveReport, Workspace};
use eit_inverse::DifferenceData;
use eit_mesh::{Mesh, Raster};
use mesh_choice::{Accuracy, Choice};
use ndarray::{Array1, Array2};

/// Pixels along the longer side where the scene states none: a disc of 64 has 3 200 pixels, ten
/// times more than 208 measurements can tell apart.
pub const DEFAULT_PIXELS: usize = 64;

/// Noise figure where the scene states nothing: the image is as noisy as the data.
pub const DEFAULT_NOISE_FIGURE: f64 = 1.0;

/// Largest array that is tried, bytes.
const MOST_BYTES: f64 = 8e9;

/// Bytes of a real number.
const REAL_BYTES: f64 = 8.0;

/// Mesh and protocol of a scene.
pub struct Setup {
    /// The skin.
    pub mesh: Mesh,
    /// Patterns, in data order.
    pub protocol: Protocol,
    /// Ready to solve.
    pub model: ForwardModel,
    /// What was mended in the mesh file.
    pub notes: Vec<String>,
    /// What the scene requires of the mesh, and what was found.
    pub accuracy: Option<Accuracy>,
}

impl Setup {
    /// What rounding may cost the voltages, of the largest: a tenth of the required accuracy.
    fn rounding(&self) -> f64 {
        let required = self.accuracy.as_ref().map_or(1.0, |accuracy| accuracy.required);
        // f64 results have no more
        (0.1 * required).clamp(4.0 * f64::EPSILON, WARN_LOSS)
    }

    /// One solve whose rounding is known to be small: by nodal assembly where that suffices,
    /// else with electrodes eliminated analytically ([`ForwardModel::solve_to`]). Quadratic elements have the first path only.
    pub fn solve<'a>(
        &'a self,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, SkinError> {
        Ok(match self.model.element_order() {
            ElementOrder::Linear => {
                self.model.solve_to(conductivity_s, self.rounding(), workspace)?
            }
            ElementOrder::Quadratic => self.model.solve(conductivity_s, workspace)?,
        })
    }
}

/// The model linearised at the homogeneous background.
pub struct Linearised {
    /// Voltages of the background, volt.
    pub voltages: Array1<f64>,
    /// [measurement, element], volt per siemens.
    pub jacobian: Array2<f64>,
    /// Where electrodes move: [measurement, displacement], volt per metre.
    pub movement: Option<Array2<f64>>,
    /// How the solve went.
    pub report: SolveReport,
    /// What rounding may have cost, where that is worth saying.
    pub warning: Option<String>,
}

/// Mesh, protocol and forward model of a scene; `mesh_file` and `nodes` override the scene's mesh.
pub fn setup(
    scene: &Scene,
    mesh_file: Option<&std::path::Path>,
    nodes: Option<usize>,
    progress: &mut Progress,
) -> Result<Setup, SkinError> {
    scene.refuse_reactive()?;
    let (choice, protocol) = skin(scene, (mesh_file, nodes), REAL_BYTES, progress)?;
    let Choice { mesh, elements, notes, accuracy } = choice;
    let impedance = scene.contact_impedance(mesh.electrodes().len())?;
    let model = progress.stage("forward model", || {
        ForwardModel::with_element_order(&mesh, &protocol, &impedance, elements)
    });
    let model = model.map_err(|e| SkinError::from(e).within(&scene.place))?;
    Ok(Setup { mesh, protocol, model, notes, accuracy })
}

/// Mesh and protocol of a scene. Refuses a Jacobian, of values of
/// `value_bytes`, beyond memory.
fn skin(
    scene: &Scene,
    (mesh_file, nodes): (Option<&std::path::Path>, Option<usize>),
    value_bytes: f64,
    progress: &mut Progress,
) -> Result<(Choice, Protocol), SkinError> {
    let wanted = match mesh_file {
        Some(file) => crate::scene::SceneMesh::file(file),
        None => scene.mesh(nodes)?,
    };
    // what needs no mesh is checked before one is made
    if let Some(electrodes) = wanted.electrodes() {
        scene.protocol(electrodes)?;
        scene.check_contacts(electrodes)?;
    }
    let Choice { mesh, elements, notes, accuracy } =
        mesh_choice::mesh(scene, (&wanted, nodes.is_some()), progress)?;
    let electrodes = mesh.electrodes().len();
    if electrodes == 0 {
        return Err(SkinError::input(
            "the mesh has no electrode: name physical lines electrode_1 .. in a Gmsh file, or set \
             electrodes.positions_m",
        ));
    }
    let protocol = scene.protocol(electrodes)?;
    let values = protocol.measurements() as f64 * mesh.surface().triangles().len() as f64;
    let bytes = value_bytes * values;
    if bytes > MOST_BYTES {
        return Err(SkinError::input(format!(
            "{} measurements on {} elements make a Jacobian of {:.0} GB: use a coarser [mesh] or \
             fewer measurements",
            protocol.measurements(),
            mesh.surface().triangles().len(),
            1e-9 * bytes
        )));
    }
    Ok((Choice { mesh, elements, notes, accuracy }, protocol))
}

/// Voltages and Jacobian of the homogeneous background, and what movement of electrodes does to them
/// where the scene lets them move.
pub fn linearise(
    scene: &Scene,
    setup: &Setup,
    progress: &mut Progress,
) -> Result<Linearised, SkinError> {
    let background = vec![scene.skin.conductivity_s; setup.model.elements()];
    let mut linearised = progress.stage("forward and Jacobian", || {
        let mut workspace = setup.model.workspace()?;
        let mut solution = setup.solve(&background, &mut workspace)?;
        let report = solution.report();
        let warning = certain(&report)?;
        let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
        Ok::<_, SkinError>(Linearised { voltages, jacobian, movement: None, report, warning })
    })?;
    if scene.reconstruction.electrode_movement_m.is_some() {
        linearised.movement = Some(movement::jacobian(&background, setup, progress)?);
    }
    Ok(linearised)
}

/// Losses worth a warning, and losses that leave nothing to report.
const WARN_LOSS: f64 = 1e-6;
const REFUSE_LOSS: f64 = 0.1;

/// Refuses voltages that rounding may have made worthless; warns where it may have cost digits.
pub fn certain(report: &SolveReport) -> Result<Option<String>, SkinError> {
    certain_but_for(report.expected_loss)
}

/// [`certain`] of an expected loss.
fn certain_but_for(loss: f64) -> Result<Option<String>, SkinError> {
    if loss.is_nan() || loss > REFUSE_LOSS {
        return Err(SkinError::Failure(format!(
            "no digit of the voltages is certain: conductances on this skin span {:.0} decades \
             (contact impedances times conductivity against element size, or contrast); bring them \
             nearer to each other",
            (loss / (1000.0 * f64::EPSILON)).log10()
        )));
    }
    Ok((loss > WARN_LOSS).then(|| {
        format!(
            "rounding may have cost up to {loss:.0e} of the largest voltage (a cautious estimate)"
        )
    }))
}

/// What is subtracted and divided by, for the methods that take the Jacobian of elements.
pub fn difference_data(kind: DifferenceKind, linearised: &Linearised) -> DifferenceData {
    match kind {
        DifferenceKind::Plain => DifferenceData::Plain,
        DifferenceKind::Normalised => {
            DifferenceData::Normalised { model_voltages_v: linearised.voltages.to_vec() }
        }
    }
}

/// The pixels of the scene's pictures.
pub fn raster(scene: &Scene, setup: &Setup, progress: &mut Progress) -> Result<Raster, SkinError> {
    let pixels = scene.reconstruction.pixels.unwrap_or(DEFAULT_PIXELS);
    Ok(progress.stage("raster", || Raster::new(setup.mesh.surface(), pixels))?)
}

/// Refuses more images than memory holds.
pub fn check_images(count: usize, raster: &Raster) -> Result<(), SkinError> {
    let bytes = 8.0 * count as f64 * (raster.pixels() as f64).powi(2);
    if bytes > MOST_BYTES {
        return Err(SkinError::input(format!(
            "{count} images of {0} x {0} pixels take {1:.0} GB: use fewer [reconstruction] \
             pixels or fewer frames",
            raster.pixels(),
            1e-9 * bytes
        )));
    }
    Ok(())
}
