//! From the scene's keys to the settings of the library crates.

use super::{DifferenceKind, Direction, Driven, OneOrMany, Order, Pair, Scene, Shape, plain};
use crate::error::CliError;
use eit_fem::{DrivenElectrodes, PairPattern, PairProtocol, Protocol};
use eit_mesh::{Mesh, MeshSettings, Placement, RimElectrodes, SkinShape};
use std::path::Path;

/// Drive current where the scene states none, ampere.
pub(super) const DEFAULT_CURRENT_A: f64 = 1e-4;

/// `protocol.drive` of currents on all electrodes at once.
const TRIGONOMETRIC: &str = "trigonometric";

/// How a scene's mesh comes about.
pub(crate) enum SceneMesh {
    /// Generated from a shape.
    Generated { shape: SkinShape, electrodes: RimElectrodes, settings: MeshSettings },
    /// Read from a Gmsh file.
    File(std::path::PathBuf),
}

impl SceneMesh {
    /// Number of electrodes, where it is known before meshing.
    pub fn electrodes(&self) -> Option<usize> {
        match self {
            Self::Generated { electrodes, .. } => Some(electrodes.count()),
            Self::File(_) => None,
        }
    }

    /// Generates or reads the mesh.
    pub fn build(&self) -> Result<Mesh, CliError> {
        match self {
            Self::Generated { shape, electrodes, settings } => {
                Ok(eit_mesh::generate(shape, electrodes, settings)?)
            }
            // a file that cannot be read is bad input, unlike one that cannot be written
            Self::File(path) => {
                eit_mesh::read_gmsh(path).map_err(|e| CliError::input(e.to_string()))
            }
        }
    }
}

impl Scene {
    /// The mesh this scene asks for, checked; `nodes` overrides its density.
    pub fn mesh(&self, nodes: Option<usize>) -> Result<SceneMesh, CliError> {
        if let Shape::Mesh = self.skin.shape {
            if nodes.is_some() {
                return Err(self.error("--nodes is for generated meshes, not for files".to_owned()));
            }
            let file = self.needed(self.skin.file.as_deref(), "skin.file", "shape = \"mesh\"")?;
            return Ok(SceneMesh::File(self.resolve(file)));
        }
        let shape = self.shape()?;
        let electrodes = self.rim_electrodes()?;
        electrodes.validate(&shape.outline()?)?;
        let default = MeshSettings::default();
        let mut settings = MeshSettings {
            edge_m: self.mesh.edge_m,
            electrode_edge_m: self.mesh.electrode_edge_m,
            grading: self.mesh.grading.unwrap_or(default.grading),
            node_limit: self.mesh.node_limit.unwrap_or(default.node_limit),
            ..default
        };
        settings.validate()?;
        if let Some(nodes) = nodes.or(self.mesh.nodes) {
            settings = settings.for_nodes(&shape, &electrodes, nodes)?;
        }
        Ok(SceneMesh::Generated { shape, electrodes, settings })
    }

    fn shape(&self) -> Result<SkinShape, CliError> {
        let skin = &self.skin;
        Ok(match skin.shape {
            Shape::Disc => {
                let radius_m = self.needed(skin.radius_m, "skin.radius_m", "a disc")?;
                SkinShape::Disc { radius_m }
            }
            Shape::Rectangle => SkinShape::Rectangle {
                width_m: self.needed(skin.width_m, "skin.width_m", "a rectangle")?,
                height_m: self.needed(skin.height_m, "skin.height_m", "a rectangle")?,
            },
            Shape::Polygon | Shape::Mesh => SkinShape::Polygon {
                outline_m: {
                    let outline = skin.outline.as_ref();
                    open_loop(self.needed(outline, "skin.outline", "a polygon")?)
                },
                holes_m: skin.holes.iter().map(|h| open_loop(h)).collect(),
            },
        })
    }

    /// The electrodes on the rim of a generated mesh.
    pub fn rim_electrodes(&self) -> Result<RimElectrodes, CliError> {
        let keys = &self.electrodes;
        let width_m = self.needed(keys.width_m, "electrodes.width_m", "electrodes")?;
        let placement = match (&keys.positions_m, keys.count) {
            (Some(positions), None) => Placement::At(plain(positions)),
            (Some(positions), Some(count)) if count == positions.len() => {
                Placement::At(plain(positions))
            }
            (Some(positions), Some(count)) => {
                return Err(self.error(format!(
                    "electrodes.count is {count}, but electrodes.positions_m has {} positions: \
                     leave one out",
                    positions.len()
                )));
            }
            (None, _) => Placement::EquallySpaced {
                count: self.needed(keys.count, "electrodes.count", "electrodes")?,
                first_angle_deg: keys.first_angle_deg.unwrap_or(0.0),
                direction: match keys.direction {
                    Direction::Counterclockwise => eit_mesh::Direction::Counterclockwise,
                    Direction::Clockwise => eit_mesh::Direction::Clockwise,
                },
            },
        };
        Ok(RimElectrodes { width_m, placement })
    }

    /// Contact impedance of each electrode.
    pub fn contact_impedance(&self, electrodes: usize) -> Result<Vec<f64>, CliError> {
        let key = "electrodes.contact_impedance_ohm_m";
        let keys = self.electrodes.contact_impedance_ohm_m.as_ref();
        match self.needed(keys, key, "the complete electrode model")? {
            OneOrMany::One(z) => Ok(vec![*z; electrodes]),
            OneOrMany::Many(values) if values.len() == electrodes => Ok(values.clone()),
            OneOrMany::Many(values) => Err(self.error(format!(
                "{key} has {} values for {electrodes} electrodes: give one number or one each",
                values.len()
            ))),
        }
    }

    /// The protocol for a number of electrodes.
    pub fn protocol(&self, electrodes: usize) -> Result<Protocol, CliError> {
        let keys = &self.protocol;
        let current_a = keys.current_a.unwrap_or(DEFAULT_CURRENT_A);
        let found = if let Some(file) = &keys.quadruples_file {
            let quadruples = self.quadruples(file)?;
            Protocol::from_quadruples(electrodes, &quadruples, current_a)
        } else if let Some(file) = &keys.stimulation_file {
            return self.pattern_protocol(file, electrodes, current_a);
        } else if keys.drive.as_deref() == Some(TRIGONOMETRIC) {
            if keys.driven_electrodes == Driven::Drop {
                return Err(self.error(format!(
                    "protocol.drive = \"{TRIGONOMETRIC}\" drives every electrode: set \
                     protocol.driven_electrodes = \"keep\""
                )));
            }
            let measure = self.pattern("protocol.measure", keys.measure.as_deref())?;
            Protocol::trigonometric(electrodes, &measure, current_a)
        } else {
            self.pair_protocol(electrodes)?.protocol()
        };
        found.map_err(|e| CliError::from(e).within(&self.place))
    }

    /// The scene's pair protocol, where it is one.
    pub fn pair_protocol(&self, electrodes: usize) -> Result<PairProtocol, CliError> {
        let keys = &self.protocol;
        let drive = match &keys.pairs {
            Some(pairs) => PairPattern::Pairs(plain(pairs)),
            None => self.pattern("protocol.drive", keys.drive.as_deref())?,
        };
        Ok(PairProtocol {
            electrodes,
            drive,
            measure: self.pattern("protocol.measure", keys.measure.as_deref())?,
            driven_electrodes: match keys.driven_electrodes {
                Driven::Drop => DrivenElectrodes::Drop,
                Driven::Keep => DrivenElectrodes::Keep,
            },
            order: match keys.order {
                Order::Rotated => eit_fem::Order::Rotated,
                Order::Ascending => eit_fem::Order::Ascending,
            },
            current_a: keys.current_a.unwrap_or(DEFAULT_CURRENT_A),
        })
    }

    fn pattern(&self, key: &str, text: Option<&str>) -> Result<PairPattern, CliError> {
        match text {
            None | Some("adjacent") => Ok(PairPattern::Adjacent),
            Some("opposite") => Ok(PairPattern::Opposite),
            Some(other) => match other.strip_prefix("skip-").map(str::parse) {
                Some(Ok(between)) => Ok(PairPattern::Skip(between)),
                _ => Err(self.error(format!(
                    "{key} = \"{other}\" is none of \"adjacent\", \"opposite\", \"skip-N\" \
                     (N electrodes between){}",
                    if key == "protocol.drive" { ", \"trigonometric\"" } else { "" }
                ))),
            },
        }
    }

    fn quadruples(&self, file: &Path) -> Result<Vec<[u32; 4]>, CliError> {
        let path = self.resolve(file);
        let table = eit_hw::csv::read(&path, &eit_hw::csv::CsvOptions::default())?.real;
        let index = |value: &f64| {
            let whole = value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(value);
            whole.then_some(*value as u32)
        };
        let rows = table.rows().into_iter().enumerate();
        rows.map(|(row, values)| {
            let numbers: Option<Vec<u32>> = values.iter().map(index).collect();
            numbers.and_then(|n| <[u32; 4]>::try_from(n).ok()).ok_or_else(|| {
                let found: Vec<f64> = values.to_vec();
                CliError::input(format!(
                    "{}: row {}: {found:?} is not four electrode indices a,b,m,n from 0",
                    path.display(),
                    row + 1
                ))
            })
        })
        .collect()
    }

    fn pattern_protocol(
        &self,
        stimulation: &Path,
        electrodes: usize,
        current_a: f64,
    ) -> Result<Protocol, CliError> {
        let measurement = self.needed(
            self.protocol.measurement_file.as_deref(),
            "protocol.measurement_file",
            "protocol.stimulation_file",
        )?;
        let mut stimulation_matrix = read_patterns(&self.resolve(stimulation), electrodes)?;
        let measurement_matrix = read_patterns(&self.resolve(measurement), electrodes)?;
        for (file, matrix) in
            [(stimulation, &stimulation_matrix), (measurement, &measurement_matrix)]
        {
            if matrix.nrows() != electrodes {
                return Err(CliError::input(format!(
                    "{}: shape {:?}, but it must be [electrode, pattern] with {electrodes} \
                     electrodes",
                    self.resolve(file).display(),
                    matrix.shape()
                )));
            }
        }
        stimulation_matrix *= current_a;
        Ok(Protocol::from_patterns(stimulation_matrix.view(), measurement_matrix.view())?)
    }

    /// Plain or normalised difference: pairs are normalised, which cancels gains per channel;
    /// general patterns have voltages near zero, which cannot be divided by.
    pub fn difference_kind(&self, protocol: &Protocol) -> DifferenceKind {
        self.reconstruction.difference.unwrap_or(match protocol.quadruples() {
            Some(_) => DifferenceKind::Normalised,
            None => DifferenceKind::Plain,
        })
    }

    fn needed<T>(&self, value: Option<T>, key: &str, why: &str) -> Result<T, CliError> {
        value.ok_or_else(|| self.error(format!("{key} is missing: {why} needs it")))
    }

    fn error(&self, message: String) -> CliError {
        CliError::input(message).within(&self.place)
    }
}

/// A pattern matrix [electrode, pattern] of any number type from an `.npy` file.
fn read_patterns(path: &Path, electrodes: usize) -> Result<ndarray::Array2<f64>, CliError> {
    let matrix = eit_hw::npy::read(path, &eit_hw::npy::NpyOptions::default())?.real;
    // the reader takes one column for one frame: here it is one pattern
    let one_pattern = matrix.dim() == (1, electrodes) && electrodes > 1;
    Ok(if one_pattern { matrix.reversed_axes() } else { matrix })
}

/// Corners of a loop; a first corner repeated at the end, as other tools write it, is dropped.
fn open_loop(corners: &[Pair<f64>]) -> Vec<[f64; 2]> {
    let mut corners = plain(corners);
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    corners
}
