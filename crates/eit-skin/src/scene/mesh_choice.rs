//! Chooses the mesh for a scene's required accuracy or noise.

use crate::error::SkinError;
use crate::progress::Progress;
use crate::scene::{BuiltMesh, MeshSource, RequiredAccuracyKey, Scene};
use eit_fem::{ElementOrder, MeshSearch, MeshTrial, Protocol, RequiredAccuracy};
use eit_mesh::Mesh;

/// Default maximum number of nodes of a tried mesh: quadratic elements on it have 200 000 unknowns, 0.3 s per
/// solve.
pub(crate) const MESH_NODES: usize = 50_000;

/// A mesh, its element order, and the estimated error.
#[derive(Debug)]
pub struct MeshChoice {
    /// The mesh that was chosen.
    pub mesh: Mesh,
    /// Linear or quadratic elements, chosen together with the mesh.
    pub element_order: ElementOrder,
    /// Repairs made to the mesh file.
    pub notes: Vec<String>,
    /// Accuracy; `None` if the scene requires none.
    pub accuracy: Option<Accuracy>,
}

/// Required and estimated accuracy.
#[derive(Debug, Clone, serde::Serialize)]
#[non_exhaustive]
pub struct Accuracy {
    /// Whether the noise determined the requirement.
    #[serde(skip)]
    pub by_noise: bool,
    /// Required accuracy: largest error of a voltage relative to the largest voltage.
    pub required: f64,
    /// Estimated error of the chosen mesh; `None` for quadratic elements on a mesh file.
    #[serde(rename = "estimated_error")]
    pub error: Option<f64>,
    /// All trials that were solved.
    pub(crate) trials: Vec<Trial>,
}

/// A mesh that was tried.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct Trial {
    pub nodes: usize,
    elements: &'static str,
    unknowns: usize,
    factor_flops: f64,
    estimated_error: Option<f64>,
}

impl From<&MeshTrial> for Trial {
    fn from(trial: &MeshTrial) -> Self {
        Self {
            nodes: trial.nodes,
            elements: element_text(trial.element_order),
            unknowns: trial.cost.unknowns,
            factor_flops: trial.cost.factor_flops,
            estimated_error: trial.error,
        }
    }
}

impl Accuracy {
    /// Describes required and estimated accuracy.
    pub fn description(&self) -> String {
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
}

/// Returns the name of an element order.
pub fn element_text(element_order: ElementOrder) -> &'static str {
    match element_order {
        ElementOrder::Linear => "linear",
        ElementOrder::Quadratic => "quadratic",
    }
}

impl Scene {
    /// Returns the mesh of a scene. Chooses its density if the scene requires an accuracy and nothing else
    /// determines it (`is_fixed`: a number of nodes on the command line).
    ///
    /// # Errors
    ///
    /// Those of meshing and of the forward solution, and an accuracy that no mesh within the limits reaches.
    pub fn choose_mesh(
        &self,
        source: &MeshSource,
        is_fixed: bool,
        progress: &mut Progress,
    ) -> Result<MeshChoice, SkinError> {
        let required = self.required_accuracy()?.filter(|_| !is_fixed);
        if let (Some(required), Some(electrodes), MeshSource::Generated { .. }) =
            (required, source.electrodes(), source)
        {
            return progress
                .stage("choice of mesh", || self.searched(source, electrodes, required));
        }
        let made = progress.stage("mesh", || source.build());
        let BuiltMesh { mesh, notes } = made.map_err(|e| e.within(&self.place))?;
        notes.iter().for_each(|note| progress.note(note));
        let element_order = self.element_order().unwrap_or_default();
        let fixed = MeshChoice { mesh, element_order, notes, accuracy: None };
        match required.filter(|_| !fixed.mesh.electrodes().is_empty()) {
            Some(required) => progress.stage("choice of elements", || self.judged(fixed, required)),
            None => Ok(fixed),
        }
    }

    /// Searches the family of meshes of the scene's settings.
    fn searched(
        &self,
        source: &MeshSource,
        electrodes: usize,
        required: RequiredAccuracy,
    ) -> Result<MeshChoice, SkinError> {
        let protocol = self.protocol(electrodes)?;
        let contact_impedance = self.contact_impedance(electrodes)?;
        let search = self.search(&protocol, &contact_impedance, required);
        let found = search.run(|scale| source.similar(scale));
        let found = found.map_err(|error: SkinError| error.within(&self.place))?;
        Ok(MeshChoice {
            mesh: found.mesh,
            element_order: found.element_order,
            notes: Vec::new(),
            accuracy: Some(Accuracy {
                by_noise: self.is_by_noise(),
                required: found.required,
                error: Some(found.error),
                trials: found.trials.iter().map(Trial::from).collect(),
            }),
        })
    }

    /// Chooses the element order for a given mesh: linear if that suffices.
    fn judged(
        &self,
        fixed: MeshChoice,
        required: RequiredAccuracy,
    ) -> Result<MeshChoice, SkinError> {
        let count = fixed.mesh.electrodes().len();
        let protocol = self.protocol(count)?;
        let contact_impedance = self.contact_impedance(count)?;
        let search = self.search(&protocol, &contact_impedance, required);
        let found =
            search.of_linear(&fixed.mesh).map_err(|e| SkinError::from(e).within(&self.place))?;
        let suffices = found.error <= found.required;
        if !suffices && self.element_order() == Some(ElementOrder::Linear) {
            return Err(SkinError::input(format!(
                "linear elements on this mesh have an error of {:.1e} of the largest voltage, but \
                 {:.1e} is required: remove mesh.elements, or use a finer mesh",
                found.error, found.required
            ))
            .within(&self.place));
        }
        let linear = suffices && self.element_order() != Some(ElementOrder::Quadratic);
        let (element_order, error) = if linear {
            (ElementOrder::Linear, Some(found.error))
        } else {
            (ElementOrder::Quadratic, None)
        };
        let by_noise = self.is_by_noise();
        let required = found.required;
        let accuracy = Some(Accuracy { by_noise, required, error, trials: Vec::new() });
        Ok(MeshChoice { element_order, accuracy, ..fixed })
    }

    /// The search that the scene specifies.
    fn search<'a>(
        &self,
        protocol: &'a Protocol,
        contact_impedance: &'a [f64],
        required: RequiredAccuracy,
    ) -> MeshSearch<'a> {
        MeshSearch {
            protocol,
            contact_impedance,
            conductivity_s: self.skin.conductivity_s,
            required,
            element_order: self.element_order(),
            most_nodes: self.mesh.node_limit.unwrap_or(MESH_NODES),
        }
    }

    fn is_by_noise(&self) -> bool {
        matches!(self.mesh.required_accuracy, Some(RequiredAccuracyKey::Rule(_)))
    }
}
