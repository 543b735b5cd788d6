//! The scene file: the skin, its electrodes, how it is driven, and what to compute.
//!
//! TOML is parsed into plain structs, which are then converted to settings of the library crates. The whole
//! scene is checked before any work. Relative paths are relative to the scene file.

mod build;
mod builtin;
mod check;
mod instrument;
mod mesh;
mod mesh_choice;
mod parse;
mod protocol;
mod range;
mod reactive;
mod reconstruction;
mod sections;
mod series;
mod settings;
mod settings_file;

pub(crate) use check::{Must, check_numbers};
#[cfg(feature = "fabric")]
pub use eit_fem::fabric::FabricSettings;
pub use eit_fem::{DrivenElectrodes, ElementOrder, Order};
pub use eit_hw::{Component, FrameOrientation};
pub use eit_inverse::DifferenceKind;
pub use eit_inverse::metrics::ChangeSign;
pub use eit_mesh::Direction;
pub use instrument::{DriverKind, Instrument, InstrumentSettings};
pub use mesh::{BuiltMesh, ElectrodeSource, MeshSource};
#[cfg(feature = "plan")]
pub(crate) use mesh_choice::MESH_NODES;
pub use mesh_choice::{Accuracy, MeshChoice, element_text};
pub use parse::from_toml;
pub use range::FrameRange;
pub(crate) use reconstruction::DEFAULT_PIXELS;
pub use reconstruction::{
    Delta, DeltaRule, Hyperparameter, PriorKind, ReconstructionSettings, Rule,
};
use sections::plain;
pub(crate) use sections::recording::LEAST_REFERENCE_FRAMES;
pub use sections::{
    AccuracyRule, DenoiseSettings, ElectrodeSettings, MeshDensity, NoiseSettings, OneOrMany, Pair,
    Position, ProtocolSettings, RequiredAccuracyKey, Shape, SkinSettings, TouchModel,
    TouchSettings,
    recording::{OneOrManyFiles, RecordingSettings, Reference, ValueKind},
};
pub use settings::StageSettings;
pub(crate) use settings::Symmetry;
pub use settings_file::read_settings;

use crate::error::SkinError;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Without feature `fabric` the section is neither checked nor used.
#[cfg(not(feature = "fabric"))]
pub type FabricSettings = toml::Table;

/// A scene as written; `docs/SCENE.md` explains every key.
///
/// ```
/// use eit_skin::Scene;
///
/// let mut scene = Scene::load("paper-disc")?; // or the path of a file
/// scene.reconstruction.pixels = Some(32);
/// let text = scene.to_toml()?;
/// assert_eq!(Scene::parse(&text, "mine")?.reconstruction.pixels, Some(32));
/// # Ok::<(), eit_skin::SkinError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Shape and background of the skin.
    pub skin: SkinSettings,
    /// Electrodes on the rim; a mesh file may contain its own.
    #[serde(default)]
    pub electrodes: ElectrodeSettings,
    /// Stimulation and measurement.
    #[serde(default)]
    pub protocol: ProtocolSettings,
    /// Mesh density.
    #[serde(default)]
    pub mesh: MeshDensity,
    /// Recorded frames.
    #[serde(default)]
    pub recording: RecordingSettings,
    /// Image reconstruction.
    #[serde(default)]
    pub reconstruction: ReconstructionSettings,
    /// Noise of the instrument.
    #[serde(default)]
    pub noise: NoiseSettings,
    /// The simulated fabric of `eit simulate`.
    pub fabric: Option<FabricSettings>,
    /// Detection of touches.
    #[serde(default)]
    pub touch: TouchSettings,
    /// U-net.
    pub denoise: Option<DenoiseSettings>,
    /// Live instrument.
    pub instrument: Option<InstrumentSettings>,
    /// Name for titles: the file's stem or the built-in name.
    #[serde(skip)]
    pub name: String,
    /// The file or built-in name as given, for messages.
    #[serde(skip)]
    pub place: String,
    /// Folder to which relative paths refer.
    #[serde(skip)]
    pub folder: PathBuf,
    /// The text that the scene was read from.
    #[serde(skip)]
    pub(crate) source: Option<String>,
}

/// Reads a whole file; rejects devices and pipes, which may have no end.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, SkinError> {
    read_file_of(path, u64::MAX >> 1)
}

/// Reads a whole file; rejects files larger than a limit.
pub(crate) fn read_file_of(path: &Path, most_bytes: u64) -> Result<Vec<u8>, SkinError> {
    use std::io::Read as _;
    let mut bytes = Vec::new();
    // one extra byte reveals a larger file; the size stated by the system may be wrong
    let file = eit_hw::regular_file(path)?;
    file.take(most_bytes + 1).read_to_end(&mut bytes).map_err(|e| SkinError::at(path, e))?;
    if bytes.len() as u64 > most_bytes {
        let (path, most) = (path.display(), most_bytes >> 20);
        return Err(SkinError::input(format!(
            "{path}: longer than {most} MiB: not a file of this kind"
        )));
    }
    Ok(bytes)
}

impl Scene {
    /// Reads and checks a scene file, or a built-in scene by name.
    ///
    /// # Errors
    ///
    /// [`SkinError::Input`] if there is neither such a file nor such a built-in scene, for text that is not
    /// TOML, an unknown key (with the nearest known one), and settings that contradict each other.
    pub fn load(name_or_path: impl AsRef<Path>) -> Result<Self, SkinError> {
        let name_or_path = &*name_or_path.as_ref().to_string_lossy();
        let mut scene = Self::read(Self::text(name_or_path)?, name_or_path)?;
        if builtin::text(name_or_path).is_none() {
            let path = Path::new(name_or_path);
            scene.name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
            scene.folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        }
        scene.check()?;
        Ok(scene)
    }

    /// Parses and checks the text of a scene; files that it names are relative to the working directory.
    ///
    /// # Errors
    ///
    /// As for [`load`](Self::load); `name` is the location in messages.
    pub fn parse(text: &str, name: &str) -> Result<Self, SkinError> {
        let scene = Self::read(text.to_owned(), name)?;
        scene.check()?;
        Ok(scene)
    }

    /// Parses a scene without checking it.
    fn read(text: String, name: &str) -> Result<Self, SkinError> {
        let mut scene: Self = from_toml(&text, name)?;
        scene.source = Some(text);
        scene.place = name.to_owned();
        scene.name = name.to_owned();
        Ok(scene)
    }

    /// Returns the text of a scene file or built-in scene.
    ///
    /// # Errors
    ///
    /// Text that is neither the path of a readable file nor the name of a built-in scene; the message suggests
    /// the nearest name.
    pub fn text(name_or_path: &str) -> Result<String, SkinError> {
        if let Some(text) = builtin::text(name_or_path) {
            return Ok(text.to_owned());
        }
        let refused = |why: String| {
            let known = builtin::SCENES.map(|scene| scene.0).join(", ");
            let give = "give a scene file (TOML) or a built-in scene";
            SkinError::input(format!("{name_or_path}: {why}; {give}: {known}"))
        };
        let path = Path::new(name_or_path);
        let data = std::fs::metadata(path).map_err(|e| refused(e.to_string()))?;
        if !data.is_file() || data.len() > settings_file::MOST_BYTES {
            let most_kb = settings_file::MOST_BYTES >> 10;
            return Err(refused(format!("not a file of at most {most_kb} kB")));
        }
        read_settings(path)
    }

    /// Creates a scene in code; all other settings have their defaults until set.
    ///
    /// ```
    /// use eit_skin::scene::{ElectrodeSettings, Scene, SkinSettings};
    /// let electrodes = ElectrodeSettings::equally_spaced(16, 0.0196, 1e3);
    /// let mut scene = Scene::new(SkinSettings::disc(0.1, 1e-5), electrodes);
    /// scene.noise.additive_v = Some(1e-6);
    /// let skin = eit_skin::Skin::from_scene(scene)?;
    /// assert_eq!(skin.mesh.electrodes().len(), 16);
    /// # Ok::<(), eit_skin::SkinError>(())
    /// ```
    pub fn new(skin: SkinSettings, electrodes: ElectrodeSettings) -> Self {
        Self {
            skin,
            electrodes,
            protocol: ProtocolSettings::default(),
            mesh: MeshDensity::default(),
            recording: RecordingSettings::default(),
            reconstruction: ReconstructionSettings::default(),
            noise: NoiseSettings::default(),
            fabric: None,
            touch: TouchSettings::default(),
            denoise: None,
            instrument: None,
            name: "skin".to_owned(),
            place: "scene".to_owned(),
            folder: PathBuf::new(),
            source: None,
        }
    }

    /// Returns the scene as TOML: the original text if it was read from a file and not changed since.
    ///
    /// # Errors
    ///
    /// Settings that TOML cannot represent, such as integers beyond 63 bits.
    pub fn to_toml(&self) -> Result<String, SkinError> {
        if let Some(text) = &self.source
            && from_toml(text, &self.place).is_ok_and(|written| self.has_settings_of(&written))
        {
            return Ok(text.clone());
        }
        toml::to_string(self).map_err(|e| self.not_writable(&e))
    }

    fn to_table(&self) -> Result<toml::Table, SkinError> {
        toml::Table::try_from(self).map_err(|e| self.not_writable(&e))
    }

    fn not_writable(&self, error: &toml::ser::Error) -> SkinError {
        SkinError::Failure(format!("{}: not writable as TOML: {error}", self.place))
    }

    /// Whether the settings equal those of another scene, regardless of its origin.
    fn has_settings_of(&self, other: &Self) -> bool {
        let Self { name, place, folder, source, .. } = self.clone();
        *self == Self { name, place, folder, source, ..other.clone() }
    }

    /// Returns the fingerprint to which a trained net belongs: a checksum of the settings of skin, electrodes and
    /// protocol, however they are written, with the content of the files that they name.
    ///
    /// # Errors
    ///
    /// A file that cannot be read.
    pub fn skin_fingerprint(&self) -> Result<String, SkinError> {
        let table = self.to_table()?;
        let mut hash = crc32fast::Hasher::new();
        for section in ["skin", "electrodes", "protocol"] {
            let Some(toml::Value::Table(keys)) = table.get(section) else { continue };
            // tables are sorted by key
            for (key, value) in keys {
                // a list without entries is as good as none
                if value.as_array().is_some_and(Vec::is_empty) {
                    continue;
                }
                let file = key == "file" || key.ends_with("_file");
                let (toml::Value::String(name), true) = (value, file) else {
                    hash.update(format!("{section}.{key} = {value}\n").as_bytes());
                    continue;
                };
                let path = self.resolve(Path::new(name));
                hash.update(&read_file(&path)?);
            }
        }
        Ok(format!("{:08x}", hash.finalize()))
    }

    /// Returns a path of the scene relative to the working directory.
    pub fn resolve(&self, path: impl AsRef<Path>) -> PathBuf {
        let path = path.as_ref();
        self.folder.join(path)
    }
}
