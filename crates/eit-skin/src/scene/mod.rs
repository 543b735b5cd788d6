//! The scene file: the skin, its electrodes, how it is driven, and what to compute.
//!
//! TOML is parsed into plain structs, which are then converted to settings of the library crates. The whole
//! scene is checked before any work. Relative paths are relative to the scene file. The file is long because
//! the keys form one list, in the order of docs/SCENE.md.

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
mod series;
mod settings;
mod settings_file;

pub use builtin::NAMES as BUILT_IN;
pub use eit_inverse::DifferenceKind;
pub use instrument::{DriverKind, Instrument, InstrumentSettings};
pub use mesh::{BuiltMesh, ElectrodeSource, MeshSource};
pub use mesh_choice::{Accuracy, MeshChoice, element_words};
pub use parse::from_toml;
pub use range::FrameRange;
pub use reconstruction::{
    Delta, DeltaRule, DifferenceKey, Hyperparameter, PriorKind, ReconstructionSettings, Rule,
};
pub use settings::{FrameSettings, StageSettings, Symmetry};
pub use settings_file::read_settings;

use crate::error::SkinError;
use eit_fem::fabric::FabricSettings;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

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

/// `[skin]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SkinSettings {
    /// Outline.
    pub shape: Shape,
    /// Radius of a disc or hemisphere, metres.
    pub radius_m: Option<f64>,
    /// Extent of a rectangle along x, metres.
    pub width_m: Option<f64>,
    /// Extent of a rectangle along y, metres.
    pub height_m: Option<f64>,
    /// Corners of a polygon, metres.
    pub outline: Option<Vec<Pair<f64>>>,
    /// Corners of each hole of a polygon, metres.
    #[serde(default)]
    pub holes: Vec<Vec<Pair<f64>>>,
    /// Mesh file: Gmsh, STL or OBJ.
    pub file: Option<PathBuf>,
    /// Metres per unit of the file.
    pub scale_m: Option<f64>,
    /// Conductivity of the untouched sheet, siemens per square.
    pub conductivity_s: f64,
    /// Capacitance of the sheet, farad per square.
    pub sheet_capacitance_f: Option<f64>,
}

impl SkinSettings {
    fn of(shape: Shape, conductivity_s: f64) -> Self {
        Self {
            shape,
            radius_m: None,
            width_m: None,
            height_m: None,
            outline: None,
            holes: Vec::new(),
            file: None,
            scale_m: None,
            conductivity_s,
            sheet_capacitance_f: None,
        }
    }

    /// Creates a disc with this radius and sheet conductivity, siemens per square.
    pub fn disc(radius_m: f64, conductivity_s: f64) -> Self {
        Self { radius_m: Some(radius_m), ..Self::of(Shape::Disc, conductivity_s) }
    }

    /// Creates a dome with this radius.
    pub fn hemisphere(radius_m: f64, conductivity_s: f64) -> Self {
        Self { radius_m: Some(radius_m), ..Self::of(Shape::Hemisphere, conductivity_s) }
    }

    /// Creates a rectangle around the origin.
    pub fn rectangle(width_m: f64, height_m: f64, conductivity_s: f64) -> Self {
        Self {
            width_m: Some(width_m),
            height_m: Some(height_m),
            ..Self::of(Shape::Rectangle, conductivity_s)
        }
    }

    /// Creates a polygon; add holes as further loops.
    pub fn polygon(outline_m: &[[f64; 2]], conductivity_s: f64) -> Self {
        let outline = Some(outline_m.iter().map(|&corner| Pair(corner)).collect());
        Self { outline, ..Self::of(Shape::Polygon, conductivity_s) }
    }

    /// Creates a skin from a mesh file, in units of `scale_m` metres.
    pub fn mesh(file: impl Into<PathBuf>, scale_m: f64, conductivity_s: f64) -> Self {
        Self {
            file: Some(file.into()),
            scale_m: Some(scale_m),
            ..Self::of(Shape::Mesh, conductivity_s)
        }
    }
}

impl ElectrodeSettings {
    /// Creates `count` electrodes of equal width along the rim, the first at +x, counted counter-clockwise.
    /// The contact impedance is in ohm metre.
    pub fn equally_spaced(count: usize, width_m: f64, contact_impedance_ohm_m: f64) -> Self {
        Self {
            count: Some(count),
            width_m: Some(OneOrMany::One(width_m)),
            contact_impedance_ohm_m: Some(OneOrMany::One(contact_impedance_ohm_m)),
            ..Self::default()
        }
    }
}

/// Shape of the skin (`skin.shape`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A disc around the origin.
    Disc,
    /// A dome over the disc.
    Hemisphere,
    /// A rectangle around the origin.
    Rectangle,
    /// A polygon with holes.
    Polygon,
    /// A mesh file.
    Mesh,
}

/// `[electrodes]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ElectrodeSettings {
    /// Number of electrodes.
    pub count: Option<usize>,
    /// Length of rim covered, metres; 0 in a list if the electrode is a patch.
    pub width_m: Option<OneOrMany>,
    /// Radius of a patch, metres; 0 in a list if the electrode is on the rim.
    pub radius_m: Option<OneOrMany>,
    /// Angle of the centre of electrode 1, counter-clockwise from +x.
    pub first_angle_deg: Option<f64>,
    /// Direction in which electrodes are counted.
    #[serde(default)]
    pub direction: Direction,
    /// Contact impedance: ohm metre on the rim, ohm square metre for a patch.
    pub contact_impedance_ohm_m: Option<OneOrMany>,
    /// Capacitance in parallel with the contact impedance, farad per metre; for a patch, farad per square
    /// metre.
    pub contact_capacitance_f_per_m: Option<OneOrMany>,
    /// Centre of each electrode, metres, instead of equal spacing.
    pub positions_m: Option<Vec<Position>>,
}

/// Direction in which electrodes are counted (`electrodes.direction`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// With increasing angle.
    #[default]
    Counterclockwise,
    /// With decreasing angle.
    Clockwise,
}

/// Exactly two values; a plain array type would silently drop a third one.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "Vec<T>", into = "Vec<T>")]
#[serde(bound(deserialize = "T: Deserialize<'de> + Copy", serialize = "T: Serialize + Copy"))]
pub struct Pair<T: Copy>(pub [T; 2]);

impl<T: Copy> From<Pair<T>> for Vec<T> {
    fn from(pair: Pair<T>) -> Self {
        pair.0.to_vec()
    }
}

impl<T: Copy> From<[T; 2]> for Pair<T> {
    fn from(values: [T; 2]) -> Self {
        Self(values)
    }
}

impl<T: Copy> TryFrom<Vec<T>> for Pair<T> {
    type Error = String;

    fn try_from(values: Vec<T>) -> Result<Self, String> {
        let found = values.len();
        values.try_into().map(Self).map_err(|_| format!("{found} values instead of two"))
    }
}

/// A position, metres: [x, y], or [x, y, z] on a curved skin.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
pub struct Position(pub [f64; 3]);

impl From<Position> for Vec<f64> {
    fn from(position: Position) -> Self {
        position.0.to_vec()
    }
}

impl TryFrom<Vec<f64>> for Position {
    type Error = String;

    fn try_from(values: Vec<f64>) -> Result<Self, String> {
        match values[..] {
            [x, y] => Ok(Self([x, y, 0.0])),
            [x, y, z] => Ok(Self([x, y, z])),
            _ => Err(format!("{} values instead of two or three", values.len())),
        }
    }
}

/// The plain pairs of a list.
fn plain<T: Copy>(pairs: &[Pair<T>]) -> Vec<[T; 2]> {
    pairs.iter().map(|p| p.0).collect()
}

/// One value for all electrodes, or one per electrode.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a number, or a list with one number per electrode")]
pub enum OneOrMany {
    /// The same for all.
    One(f64),
    /// One per electrode.
    Many(Vec<f64>),
}

/// `[protocol]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ProtocolSettings {
    /// "adjacent", "opposite", "skip-N" or "trigonometric".
    pub drive: Option<String>,
    /// Pairs to measure; same values as `drive`.
    pub measure: Option<String>,
    /// Drive pairs of electrodes, counted from 0.
    pub pairs: Option<Vec<Pair<u32>>>,
    /// CSV file with columns a, b, m, n; electrodes counted from 0.
    pub quadruples_file: Option<PathBuf>,
    /// NPY file of currents [electrode, pattern], in units of `current_a`.
    pub stimulation_file: Option<PathBuf>,
    /// NPY file of weights [electrode, pattern].
    pub measurement_file: Option<PathBuf>,
    /// Whether current-carrying electrodes are measured.
    #[serde(default)]
    pub driven_electrodes: Driven,
    /// Order of the measurements within a drive.
    #[serde(default)]
    pub order: Order,
    /// Amplitude of the drive current, ampere; 1e-4 by default.
    pub current_a: Option<f64>,
    /// Frequency of the drive current, hertz; only needed with capacitances.
    pub frequency_hz: Option<f64>,
    /// Set to false to reconstruct even if the order of the data looks wrong.
    pub check_order: Option<bool>,
}

/// Whether driven electrodes are measured (`protocol.driven_electrodes`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Driven {
    /// Current-carrying electrodes are not measured.
    #[default]
    Drop,
    /// Current-carrying electrodes are measured.
    Keep,
}

/// Order of the measurements (`protocol.order`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Drive d = (d, d + 1): pairs (d + 2 + k, d + 3 + k), k ascending.
    #[default]
    Rotated,
    /// Pairs in ascending order of their first electrode.
    Ascending,
}

/// `[mesh]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MeshDensity {
    /// Edge length in the interior, metres.
    pub edge_m: Option<f64>,
    /// Edge length at the ends of electrodes, metres.
    pub electrode_edge_m: Option<f64>,
    /// How fast edges grow away from electrodes.
    pub grading: Option<f64>,
    /// Approximate number of nodes, instead of a length.
    pub nodes: Option<usize>,
    /// Maximum number of nodes of any mesh tried.
    pub node_limit: Option<usize>,
    /// Kind of elements; by default linear or, with `required_accuracy`, the cheaper kind.
    pub elements: Option<ElementKind>,
    /// Required accuracy of the voltages, for which the mesh is chosen.
    pub required_accuracy: Option<RequiredAccuracyKey>,
}

/// `mesh.required_accuracy`: a fraction of the largest voltage, or "noise".
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a fraction of the largest voltage, or \"noise\"")]
pub enum RequiredAccuracyKey {
    /// Fraction of the largest voltage.
    Relative(f64),
    /// By a rule.
    Rule(AccuracyRule),
}

/// Rules of `mesh.required_accuracy`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccuracyRule {
    /// The standard deviation of a voltage's noise.
    Noise,
}

/// Kind of finite elements (`mesh.elements`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ElementKind {
    /// Three nodes.
    Linear,
    /// Six nodes.
    Quadratic,
}

/// `[recording]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingSettings {
    /// Files with the frames.
    pub file: Option<OneOrManyFiles>,
    /// Name of the format, if the file name extension does not tell.
    pub format: Option<String>,
    /// How a table is arranged.
    pub frames_are: Option<FramesAre>,
    /// Whether a table holds complex numbers.
    #[serde(default)]
    pub complex: bool,
    /// Which real quantity is computed from complex data.
    #[serde(default)]
    pub component: Component,
    /// Row of the frequency in a Sciospec file.
    pub frequency_row: Option<usize>,
    /// The reference frame, which is subtracted.
    pub reference: Option<Reference>,
    /// Frames before this one are skipped.
    pub first_frame: Option<usize>,
    /// Frames per second, if the file does not tell.
    pub frame_rate_hz: Option<f64>,
    /// Factor for every value: -1 reverses the polarity, 1e-3 converts millivolts to volts.
    pub scale: Option<f64>,
}

/// One file, or several whose frames are concatenated.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a file name, or a list of them")]
pub enum OneOrManyFiles {
    /// One file.
    One(PathBuf),
    /// Several, in order.
    Many(Vec<PathBuf>),
}

/// `recording.frames_are`: how a table is arranged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FramesAre {
    /// One frame per row.
    Rows,
    /// One frame per column.
    Columns,
    /// The whole table is one frame, [measurement, pattern].
    Matrix,
}

/// `recording.component`: which real quantity is computed from complex data.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Component {
    /// Real part.
    #[default]
    Real,
    /// Imaginary part.
    Imaginary,
    /// Absolute value.
    Magnitude,
    /// Projection onto the axis that contains most of the signal.
    Phased,
}

/// `recording.reference` or `--reference`: a frame number, "mean", "N..M" or a file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a frame number, \"mean\", \"N..M\" or a file name")]
pub enum Reference {
    /// One frame, from 0.
    Frame(usize),
    /// "mean", "N..M" (frames N to M - 1) or a file.
    Text(String),
}

impl Reference {
    /// Number of frames if they are the first ones of the recording and enough for a reference of live frames.
    pub fn first_frames(&self) -> Option<usize> {
        let Self::Text(text) = self else { return None };
        let range: FrameRange = text.parse().ok()?;
        let is_enough = range.start == 0 && range.end >= crate::live::LEAST_REFERENCE_FRAMES;
        is_enough.then_some(range.end)
    }

    /// Returns whether a text names a file rather than frames.
    pub(crate) fn is_file(text: &str) -> bool {
        let is_range = text.parse::<FrameRange>().is_ok();
        text != "mean" && !is_range && text.parse::<usize>().is_err()
    }
}

/// `[noise]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseSettings {
    /// Standard deviation of a voltage, volt.
    pub additive_v: Option<f64>,
    /// Frames of the recording in which nothing touches the skin, such as "0..20".
    pub quiet_frames: Option<FrameRange>,
}

/// `[touch]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TouchSettings {
    /// Minimum strength of a touch, as an area of doubled conductivity, square metres.
    pub least_strength_m2: Option<f64>,
    /// Radius of a fingertip's footprint, metres.
    pub radius_m: Option<f64>,
    /// Minimum distance between two touches, metres.
    pub apart_m: Option<f64>,
    /// Maximum number of simultaneous touches.
    pub max_touches: Option<usize>,
    /// Sign of the conductivity change of a touch.
    #[serde(default)]
    pub sign: TouchSign,
    /// Number of frames that must show a faint touch before it is reported.
    pub birth_frames: Option<usize>,
    /// Number of frames that a touch may be missing from.
    pub forgiven_frames: Option<usize>,
    /// Time constant with which the reference follows drift, seconds; 0: it does not follow.
    pub drift_time_s: Option<f64>,
    /// File of `eit learn`: position and force of touches, learnt from presses at known places.
    pub learned: Option<PathBuf>,
}

/// `touch.sign`: sign of the conductivity change of a touch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TouchSign {
    /// A touch raises the conductivity.
    #[default]
    Increase,
    /// A touch lowers the conductivity.
    Decrease,
}

/// `[denoise]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DenoiseSettings {
    /// "default", or a file written by `eit train`.
    pub weights: String,
    /// Set to true to allow the weights of another skin.
    #[serde(default)]
    pub any_skin: bool,
}

/// Reads a whole file; rejects devices and pipes, which may have no end.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, SkinError> {
    use std::io::Read as _;
    let mut bytes = Vec::new();
    let mut file = eit_hw::regular_file(path)?;
    file.read_to_end(&mut bytes).map_err(|e| SkinError::at(path, e))?;
    Ok(bytes)
}

/// Reads a whole file; rejects files larger than a limit.
#[cfg(feature = "learn")]
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
        let mut scene = parse::parse(&text, name)?;
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
            let known = BUILT_IN.join(", ");
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
            && parse::parse(text, &self.place).is_ok_and(|written| self.has_settings_of(&written))
        {
            return Ok(text.clone());
        }
        toml::to_string(self).map_err(|e| self.not_writable(&e))
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
        let table = toml::Table::try_from(self).map_err(|e| self.not_writable(&e))?;
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
