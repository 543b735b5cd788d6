//! The mesh that a scene's required accuracy, or its noise, asks for.

use super::Setup;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::scene::{Scene, SceneMesh, Shape};
use eit_fem::{ElementOrder, MeshSearch, MeshTrial, Protocol, RequiredAccuracy};
use eit_mesh::Mesh;
use serde_json::{Value, json};

/// Most nodes of a mesh that is tried, unless the scene has a limit: quadratic elements on it have
/// 200 000 unknowns, 0.3 s a solve.
const MOST_NODES: usize = 50_000;

/// A mesh, its elements, and what is known of their error.
pub struct Choice {
    pub mesh: Mesh,
    pub elements: ElementOrder,
    /// What was mended in the mesh file.
    pub notes: Vec<String>,
    /// `None` where the scene requires nothing.
    pub accuracy: Option<Accuracy>,
}

/// What was required, and what was found.
#[derive(Debug, Clone)]
pub struct Accuracy {
    /// Largest error of a voltage over the largest voltage.
    pub required: f64,
    /// Estimate for the mesh that was chosen; `None` for quadratic elements on a mesh file.
    pub error: Option<f64>,
    /// Everything that was solved.
    pub trials: Vec<MeshTrial>,
}

impl Accuracy {
    /// Required and found.
    pub fn words(&self) -> String {
        let required = self.required;
        match self.error {
            Some(error) => format!(
                "estimated error of the voltages {error:.1e} of the largest, {required:.1e} required"
            ),
            None => format!(
                "{required:.1e} of the largest voltage required, which linear elements on this mesh \
                 miss; the error of quadratic ones on the mesh of a file is not known"
            ),
        }
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let one = |trial: &MeshTrial| {
            json!({
                "nodes": trial.nodes,
                "elements": words(trial.element_order),
                "unknowns": trial.cost.unknowns,
                "factor_flops": trial.cost.factor_flops,
                "estimated_error": trial.error,
            })
        };
        json!({
            "required": self.required,
            "estimated_error": self.error,
            "trials": self.trials.iter().map(one).collect::<Vec<_>>(),
        })
    }
}

/// Name of an element order.
pub fn words(elements: ElementOrder) -> &'static str {
    match elements {
        ElementOrder::Linear => "linear",
        ElementOrder::Quadratic => "quadratic",
    }
}

/// The mesh that is wanted of a scene; chosen where the scene requires an accuracy and nothing else
/// (`fixed`: a number of nodes on the command line) says how dense.
pub fn mesh(
    scene: &Scene,
    (wanted, fixed): (&SceneMesh, bool),
    progress: &mut Progress,
) -> Result<Choice, SkinError> {
    let required = scene.required_accuracy()?.filter(|_| !fixed);
    if let (Some(required), Some(electrodes), SceneMesh::Generated { .. }) =
        (required, wanted.electrodes(), wanted)
    {
        return progress.stage("choice of mesh", || searched(scene, electrodes, required));
    }
    let made = progress.stage("mesh", || wanted.build_noted());
    let (mesh, notes) = made.map_err(|e| e.within(&scene.place))?;
    notes.iter().for_each(|note| progress.note(note));
    let elements = scene.element_order().unwrap_or_default();
    let fixed = Choice { mesh, elements, notes, accuracy: None };
    match required.filter(|_| !fixed.mesh.electrodes().is_empty()) {
        Some(required) => progress.stage("choice of elements", || judged(scene, fixed, required)),
        None => Ok(fixed),
    }
}

/// Searches the family of the scene's mesh settings.
fn searched(
    scene: &Scene,
    electrodes: usize,
    required: RequiredAccuracy,
) -> Result<Choice, SkinError> {
    let protocol = scene.protocol(electrodes)?;
    let contact_impedance = scene.contact_impedance(electrodes)?;
    let search = search(scene, (&protocol, &contact_impedance), required);
    let found = search.run(|scale| scene.similar_mesh(scale));
    let found = found.map_err(|error: SkinError| error.within(&scene.place))?;
    Ok(Choice {
        mesh: found.mesh,
        elements: found.element_order,
        notes: Vec::new(),
        accuracy: Some(Accuracy {
            required: found.required,
            error: Some(found.error),
            trials: found.trials,
        }),
    })
}

/// Elements for a mesh that is what it is: linear ones where they suffice.
fn judged(scene: &Scene, fixed: Choice, required: RequiredAccuracy) -> Result<Choice, SkinError> {
    let count = fixed.mesh.electrodes().len();
    let protocol = scene.protocol(count)?;
    let contact_impedance = scene.contact_impedance(count)?;
    let search = search(scene, (&protocol, &contact_impedance), required);
    let found =
        search.of_linear(&fixed.mesh).map_err(|e| SkinError::from(e).within(&scene.place))?;
    let suffices = found.error <= found.required;
    if !suffices && scene.element_order() == Some(ElementOrder::Linear) {
        return Err(SkinError::input(format!(
            "linear elements on this mesh have an error of {:.1e} of the largest voltage, and \
             {:.1e} is required: take mesh.elements out, or a finer mesh",
            found.error, found.required
        ))
        .within(&scene.place));
    }
    let linear = suffices && scene.element_order() != Some(ElementOrder::Quadratic);
    let (elements, error) = if linear {
        (ElementOrder::Linear, Some(found.error))
    } else {
        (ElementOrder::Quadratic, None)
    };
    let accuracy = Accuracy { required: found.required, error, trials: Vec::new() };
    Ok(Choice { elements, accuracy: Some(accuracy), ..fixed })
}

/// The search that a scene asks for.
fn search<'a>(
    scene: &Scene,
    (protocol, contact_impedance): (&'a Protocol, &'a [f64]),
    required: RequiredAccuracy,
) -> MeshSearch<'a> {
    MeshSearch {
        protocol,
        contact_impedance,
        conductivity_s: scene.skin.conductivity_s,
        required,
        element_order: scene.element_order(),
        most_nodes: scene.mesh.node_limit.unwrap_or(MOST_NODES),
    }
}

/// Estimated error of the voltages on a mesh that nothing was required of, over the largest: linear
/// elements against quadratic ones on the same mesh, quadratic ones on a generated mesh against
/// those on twice the nodes. `None` where neither can be had: a shunt, an ideal source, quadratic
/// elements on the mesh of a file.
pub fn estimate(scene: &Scene, setup: &Setup) -> Result<Option<f64>, SkinError> {
    let impedance = scene.contact_impedance(setup.protocol.electrodes())?;
    if impedance.iter().any(|z| *z == 0.0 || z.is_infinite()) {
        return Ok(None);
    }
    let search = search(scene, (&setup.protocol, &impedance), RequiredAccuracy::Relative(0.5));
    let estimate = match setup.model.element_order() {
        ElementOrder::Linear => search.of_linear(&setup.mesh)?.error,
        ElementOrder::Quadratic if scene.skin.shape == Shape::Mesh => return Ok(None),
        ElementOrder::Quadratic => {
            let nodes = 2 * setup.mesh.surface().nodes().len();
            search.of_quadratic(&setup.mesh, &scene.mesh(Some(nodes))?.build()?)?.error
        }
    };
    Ok(Some(estimate))
}
