//! Sections of a scene file, in the order of docs/SCENE.md.

pub(super) mod recording;

use super::FrameRange;
use eit_fem::{DrivenElectrodes, ElementOrder, Order};
use eit_inverse::metrics::ChangeSign;
use eit_mesh::Direction;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

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
    /// How much better the fabric conducts along `weave_angle_deg` than across; found from the reference frame if
    /// it is not set, and 1 for a sheet of scalar conductivity.
    pub weave_ratio: Option<f64>,
    /// Angle from x to the direction along, degrees counter-clockwise; 0 if it is not set.
    pub weave_angle_deg: Option<f64>,
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
            weave_ratio: None,
            weave_angle_deg: None,
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
pub(super) fn plain<T: Copy>(pairs: &[Pair<T>]) -> Vec<[T; 2]> {
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
    /// Pairs to measure: same values as `drive`; or "ground", potentials against a common electrode, such as the sink.
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
    pub driven_electrodes: DrivenElectrodes,
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
    pub elements: Option<ElementOrder>,
    /// Required accuracy of the voltages, for which the mesh is chosen.
    pub required_accuracy: Option<RequiredAccuracyKey>,
}

/// `mesh.required_accuracy`: a fraction of the largest voltage, or "noise".
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a fraction of the largest voltage, or \"noise\"")]
pub enum RequiredAccuracyKey {
    /// Fraction of the largest voltage.
    Relative(f64),
    /// Chosen by a rule.
    Rule(AccuracyRule),
}

/// Rules of `mesh.required_accuracy`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccuracyRule {
    /// The standard deviation of a voltage's noise.
    Noise,
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
    pub sign: ChangeSign,
    /// Number of frames that must show a faint touch before it is reported.
    pub birth_frames: Option<usize>,
    /// Number of frames that a touch may be missing from.
    pub forgiven_frames: Option<usize>,
    /// Time constant with which the reference follows drift, seconds; 0: it does not follow.
    pub drift_time_s: Option<f64>,
    /// File of `eit learn`: position and force of touches, learnt from presses at known places.
    pub learned: Option<PathBuf>,
    /// How touches are found.
    #[serde(default, skip_serializing_if = "TouchModel::is_default")]
    pub model: TouchModel,
}

/// How touches are found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TouchModel {
    /// By the search of bells and its rules.
    #[default]
    Search,
    /// By one model and one score.
    OneScore,
}

impl TouchModel {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// `[denoise]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DenoiseSettings {
    /// "default", or a file written by `eit net train`.
    pub weights: String,
    /// Set to true to allow the weights of another skin.
    #[serde(default)]
    pub any_skin: bool,
}
