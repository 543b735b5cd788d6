//! A skin: mesh, protocol and forward model, with the settings of all later stages.

use crate::error::SkinError;
use crate::limits::{MOST_BYTES, WARN_LOSS};
use crate::progress::Progress;
use crate::scene::{
    Accuracy, BuiltMesh, DEFAULT_PIXELS, DifferenceKind, FabricSettings, Instrument,
    InstrumentSettings, MeshChoice, MeshSource, Scene, StageSettings, Symmetry,
};
use crate::weave::Weave;
use eit_fem::analytic::DiscSeries;
#[cfg(feature = "fabric")]
use eit_fem::fabric::Fabric;
use eit_fem::{ElementOrder, ForwardModel, PairProtocol, Protocol, Solution, Workspace};
use eit_hw::Layout;
use eit_mesh::{Mesh, Raster};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Size of a real number, bytes.
pub(crate) const REAL_BYTES: f64 = 8.0;

/// The parts of a skin that do not depend on how its frames are processed.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SkinModel {
    /// Name for titles: the scene file's stem or the built-in name.
    pub name: String,
    /// The scene as named by the user, for messages.
    pub place: String,
    /// The skin's surface with its electrodes.
    pub mesh: Mesh,
    /// Stimulation and measurement patterns, in data order.
    pub protocol: Protocol,
    /// Forward model, ready to solve.
    pub model: ForwardModel,
    /// Conductivity of the untouched sheet, siemens per square.
    pub conductivity_s: f64,
    /// Ratio and direction of its conductivity, if the scene states them or a reference frame showed them.
    pub weave: Option<Weave>,
    /// Contact impedance per electrode: ohm metre on the rim, ohm square metre for a patch.
    pub contact_impedance: Vec<f64>,
    /// File or generator that the mesh came from.
    pub source: MeshSource,
    /// Repairs made to the mesh file.
    pub notes: Vec<String>,
    /// Required and estimated accuracy of the mesh, if the scene requires one.
    pub accuracy: Option<Accuracy>,
    /// The pair protocol behind the patterns, if the order of data can be compared with others.
    pub pairs: Option<PairProtocol>,
    /// What a frame holds where its source does not name electrodes.
    pub layout: Layout,
    /// Whether data in another order than the protocol's is rejected.
    pub check_order: bool,
    /// The mesh-free series for this skin, if there is one.
    pub series: Option<DiscSeries>,
    /// Rotations and reflections that map a disc with its electrodes onto itself.
    #[cfg_attr(
        not(feature = "base"),
        expect(dead_code, reason = "turns pairs of a learning base")
    )]
    pub(crate) symmetry: Option<Symmetry>,
    /// Settings of the simulated fabric.
    pub fabric: FabricSettings,
    /// Settings of the instrument, if the scene has one.
    pub instrument: Option<InstrumentSettings>,
    /// Amplitude of the drive current, ampere.
    pub current_a: f64,
    /// Checksum of shape, electrodes and protocol, to which a trained net belongs.
    pub fingerprint: String,
    /// The scene as TOML, for recordings.
    pub scene_toml: String,
    /// Why the skin needs no complex numbers.
    pub why_real: &'static str,
}

/// Overrides of the scene's mesh.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct MeshOverride {
    /// A mesh file that contains its electrodes.
    pub file: Option<PathBuf>,
    /// About this many nodes instead of the scene's density.
    pub nodes: Option<usize>,
}

/// A skin, from which everything else is built. Clones share mesh and model.
///
/// ```
/// use eit_skin::{Scene, Skin};
/// # fn main() -> Result<(), eit_skin::SkinError> {
/// let skin = Skin::from_scene(Scene::load("paper-disc")?)?;
/// assert_eq!(skin.protocol.measurements(), 208);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Skin {
    parts: Arc<SkinModel>,
    /// Settings of the stages after the model.
    pub settings: StageSettings,
}

impl Deref for Skin {
    type Target = SkinModel;

    fn deref(&self) -> &SkinModel {
        &self.parts
    }
}

impl Skin {
    /// Reads a scene file, or a built-in scene by name, and sets up the skin.
    ///
    /// # Errors
    ///
    /// A scene that cannot be read or built; the message names key, value and location.
    pub fn load(name_or_path: impl AsRef<Path>) -> Result<Self, SkinError> {
        Self::from_scene(Scene::load(name_or_path)?)
    }

    /// Sets up a skin: generates the mesh, and builds protocol and forward model.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::load`].
    pub fn from_scene(scene: Scene) -> Result<Self, SkinError> {
        Self::set_up(&scene, &MeshOverride::default(), &mut Progress::silent())
    }

    /// Like [`Skin::from_scene`], with an override of the mesh and progress reports.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::load`].
    pub fn set_up(
        scene: &Scene,
        mesh: &MeshOverride,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        scene.check()?;
        scene.refuse_reactive()?;
        let Body { choice, protocol, source } = Body::of(scene, mesh, REAL_BYTES, progress)?;
        let MeshChoice { mesh, element_order, notes, accuracy } = choice;
        let electrodes = mesh.electrodes().len();
        let contact_impedance = scene.contact_impedance(electrodes)?;
        let model = progress.stage("forward model", || {
            ForwardModel::with_element_order(&mesh, &protocol, &contact_impedance, element_order)
        });
        let model = model.map_err(|e| SkinError::from(e).within(&scene.place))?;
        let has_pairs = protocol.quadruples().is_some() && !scene.has_quadruples_file();
        let pairs = has_pairs.then(|| scene.pair_protocol(electrodes)).transpose()?;
        let model = SkinModel {
            name: scene.name.clone(),
            place: scene.place.clone(),
            series: scene.disc_series(electrodes)?,
            symmetry: scene.symmetry(),
            pairs,
            layout: scene.frame_layout(&protocol),
            check_order: scene.protocol.check_order != Some(false),
            conductivity_s: scene.skin.conductivity_s,
            weave: None,
            fabric: scene.fabric.clone().unwrap_or_default(),
            fingerprint: scene.skin_fingerprint()?,
            scene_toml: scene.to_toml()?,
            why_real: scene.why_real(),
            instrument: scene.instrument.clone(),
            current_a: scene.current_a(),
            mesh,
            protocol,
            model,
            contact_impedance,
            source,
            notes,
            accuracy,
        };
        let skin = Self { parts: Arc::new(model), settings: scene.stage_settings() };
        match scene.weave() {
            Some(weave) => skin.with_weave(weave).map_err(|e| e.within(&scene.place)),
            None => Ok(skin),
        }
    }

    /// Returns the same skin on another mesh with about this many nodes, for simulation.
    ///
    /// # Errors
    ///
    /// A mesh file, which is fixed; a mesh that cannot be generated.
    pub fn with_nodes(&self, nodes: usize, progress: &mut Progress) -> Result<Self, SkinError> {
        let source = self.source.with_nodes(nodes)?;
        let BuiltMesh { mesh, notes } = progress.stage("mesh", || source.build())?;
        let (contacts, order) = (&self.contact_impedance, self.model.element_order());
        let model = progress.stage("forward model", || {
            ForwardModel::with_element_order(&mesh, &self.protocol, contacts, order)
        })?;
        let parts =
            SkinModel { mesh, model, source, notes, accuracy: None, ..self.parts.as_ref().clone() };
        let skin = Self { parts: Arc::new(parts), settings: self.settings.clone() };
        self.weave.map_or(Ok(skin.clone()), |weave| skin.with_weave(weave))
    }

    /// Returns the same skin with a model of a weave.
    pub(crate) fn of_weave(&self, weave: Weave, model: ForwardModel) -> Self {
        let parts = SkinModel { model, weave: Some(weave), ..self.parts.as_ref().clone() };
        Self { parts: Arc::new(parts), settings: self.settings.clone() }
    }

    /// Returns whether differences are plain or normalised. Pair protocols are normalised, which cancels
    /// channel gains; general patterns have voltages near zero, by which one cannot divide.
    pub fn difference_kind(&self) -> DifferenceKind {
        let default = match self.protocol.quadruples() {
            Some(_) => DifferenceKind::Normalised,
            None => DifferenceKind::Plain,
        };
        self.settings.reconstruction.difference.unwrap_or(default)
    }

    /// Returns the conductivity of the untouched skin for each element, siemens per square.
    pub fn background_s(&self) -> Vec<f64> {
        vec![self.conductivity_s; self.model.elements()]
    }

    /// Returns the number of pixels along the longer side of the skin's images.
    pub fn pixels(&self) -> usize {
        self.settings.reconstruction.pixels.unwrap_or(DEFAULT_PIXELS)
    }

    /// Creates the pixel raster of the skin's images.
    ///
    /// # Errors
    ///
    /// The errors of [`Raster::new`].
    pub fn raster(&self, progress: &mut Progress) -> Result<Raster, SkinError> {
        Ok(progress.stage("raster", || Raster::new(self.mesh.surface(), self.pixels()))?)
    }

    /// Returns the simulated fabric of this skin, which computes the effect of touches on the voltages, with
    /// the truth for every frame.
    ///
    /// # Errors
    ///
    /// Invalid settings of the fabric.
    #[cfg(feature = "fabric")]
    pub fn simulated_fabric(&self) -> Result<Fabric, SkinError> {
        self.fabric_with(&self.fabric)
    }

    /// Returns the simulated fabric with other settings than the scene's; of the scene's weave, unless they have one.
    ///
    /// # Errors
    ///
    /// The errors of [`Fabric::new`].
    #[cfg(feature = "fabric")]
    pub fn fabric_with(&self, settings: &FabricSettings) -> Result<Fabric, SkinError> {
        let (sheet_s, impedance) = (self.conductivity_s, &self.contact_impedance);
        let mut settings = settings.clone();
        if let (Some(weave), 1.0) = (self.weave, settings.weave.ratio) {
            (settings.weave.ratio, settings.weave.angle_deg) = (weave.ratio, weave.angle_deg);
        }
        let fabric = Fabric::new(&self.mesh, &self.protocol, sheet_s, impedance, &settings);
        fabric.map_err(|e| SkinError::from(e).within(&self.place))
    }

    /// Returns the instrument that the scene names, for this skin's protocol.
    ///
    /// # Errors
    ///
    /// No `[instrument]`, or settings that its driver does not support.
    pub fn instrument(&self) -> Result<Instrument, SkinError> {
        let settings = self.instrument.as_ref().ok_or_else(|| {
            SkinError::input("has no [instrument]: nothing to open").within(&self.place)
        })?;
        let built = settings.build(&self.protocol, &self.layout, self.current_a, &self.place);
        built.map_err(|e| e.within(&self.place))
    }

    /// Allowed rounding error of the voltages, relative to the largest: a tenth of the required accuracy.
    fn rounding(&self) -> f64 {
        let required = self.accuracy.as_ref().map_or(1.0, |accuracy| accuracy.required);
        // the limit of f64 results
        (0.1 * required).clamp(4.0 * f64::EPSILON, WARN_LOSS)
    }

    /// Solves with a small, known rounding error: by textbook assembly if that suffices, else with electrodes
    /// eliminated analytically ([`ForwardModel::solve_to`]). Quadratic elements only support the former.
    ///
    /// # Errors
    ///
    /// Errors of the model: conductivities that are not above zero, or voltages without a certain digit.
    pub fn solve<'a>(
        &'a self,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, SkinError> {
        self.solve_to(conductivity_s, self.rounding(), workspace)
    }

    /// Like [`Skin::solve`], with a given rounding error relative to the largest voltage.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::solve`].
    pub fn solve_to<'a>(
        &'a self,
        conductivity_s: &[f64],
        rounding: f64,
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, SkinError> {
        let model = &self.model;
        Ok(match model.element_order() {
            ElementOrder::Linear => model.solve_to(conductivity_s, rounding, workspace)?,
            ElementOrder::Quadratic => model.solve(conductivity_s, workspace)?,
        })
    }
}

/// Mesh and protocol of a scene, for real or complex models.
pub(crate) struct Body {
    pub choice: MeshChoice,
    pub protocol: Protocol,
    pub source: MeshSource,
}

impl Body {
    /// Builds mesh and protocol; rejects a Jacobian too large for memory, with `value_bytes` per value.
    pub(crate) fn of(
        scene: &Scene,
        mesh: &MeshOverride,
        value_bytes: f64,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let source = match &mesh.file {
            Some(file) => MeshSource::file(file),
            None => scene.mesh(mesh.nodes)?,
        };
        // check everything that needs no mesh before generating one
        if let Some(electrodes) = source.electrodes() {
            scene.protocol(electrodes)?;
            scene.check_contacts(electrodes)?;
        }
        let choice = scene.choose_mesh(&source, mesh.nodes.is_some(), progress)?;
        let electrodes = choice.mesh.electrodes().len();
        if electrodes == 0 {
            let of_file = match &source {
                MeshSource::File { path, .. } => format!("{}: ", path.display()),
                MeshSource::Generated { .. } => String::new(),
            };
            return Err(SkinError::input(format!(
                "{of_file}the mesh has no electrode: name physical curves of a Gmsh file electrode_1, \
                 electrode_2 and so on, as in Physical Curve(\"electrode_1\") = {{1}}, or set \
                 electrodes.positions_m"
            )));
        }
        let protocol = scene.protocol(electrodes)?;
        let elements = choice.mesh.surface().triangles().len();
        let bytes = value_bytes * protocol.measurements() as f64 * elements as f64;
        if bytes > MOST_BYTES {
            return Err(SkinError::input(format!(
                "{} measurements on {elements} elements make a Jacobian of {:.0} GB: use a coarser \
                 [mesh] or fewer measurements",
                protocol.measurements(),
                1e-9 * bytes
            )));
        }
        Ok(Self { choice, protocol, source })
    }
}
