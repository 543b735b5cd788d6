//! From the scene's keys to the settings of the library crates.

use super::{
    AccuracyKeys, AccuracyRule, DifferenceKind, Direction, Driven, ElementKeys, OneOrMany, Order,
    Pair, Position, Scene, Shape, plain,
};
use crate::error::CliError;
use eit_fem::{DrivenElectrodes, Elements, PairPattern, PairProtocol, Protocol, RequiredAccuracy};
use eit_mesh::{Mesh, MeshSettings, PlacedElectrode, Placement, RimElectrodes, SkinShape};
use std::path::{Path, PathBuf};

/// Drive current where the scene states none, ampere.
pub(super) const DEFAULT_CURRENT_A: f64 = 1e-4;

/// `protocol.drive` of currents on all electrodes at once.
const TRIGONOMETRIC: &str = "trigonometric";

/// How a scene's mesh comes about.
pub(crate) enum SceneMesh {
    /// Generated from a shape.
    Generated { shape: SkinShape, electrodes: SceneElectrodes, settings: MeshSettings },
    /// Read from a file, in units of `scale_m` metres; with electrodes put on it where it has none.
    File { path: PathBuf, scale_m: f64, electrodes: Vec<PlacedElectrode>, settings: MeshSettings },
}

/// The electrodes that a scene describes.
pub(crate) enum SceneElectrodes {
    /// All on the rim and of one width.
    Rim(RimElectrodes),
    /// Each at its place and of its size.
    Placed(Vec<PlacedElectrode>),
}

impl SceneElectrodes {
    fn count(&self) -> usize {
        match self {
            Self::Rim(electrodes) => electrodes.count(),
            Self::Placed(electrodes) => electrodes.len(),
        }
    }
}

impl SceneMesh {
    /// A mesh file that brings its electrodes.
    pub fn file(path: &Path) -> Self {
        let (electrodes, settings) = (Vec::new(), MeshSettings::default());
        Self::File { path: path.to_path_buf(), scale_m: 1.0, electrodes, settings }
    }

    /// Number of electrodes, where it is known before meshing.
    pub fn electrodes(&self) -> Option<usize> {
        match self {
            Self::Generated { electrodes, .. } => Some(electrodes.count()),
            Self::File { electrodes, .. } if electrodes.is_empty() => None,
            Self::File { electrodes, .. } => Some(electrodes.len()),
        }
    }

    /// Generates or reads the mesh.
    pub fn build(&self) -> Result<Mesh, CliError> {
        self.build_noted().map(|(mesh, _)| mesh)
    }

    /// The mesh, and what was mended in the file that it came from.
    pub fn build_noted(&self) -> Result<(Mesh, Vec<String>), CliError> {
        let (path, scale_m, electrodes, settings) = match self {
            Self::Generated { shape, electrodes: SceneElectrodes::Rim(rim), settings } => {
                return Ok((eit_mesh::generate(shape, rim, settings)?, Vec::new()));
            }
            Self::Generated { shape, electrodes: SceneElectrodes::Placed(placed), settings } => {
                return Ok((eit_mesh::generate_placed(shape, placed, settings)?, Vec::new()));
            }
            Self::File { path, scale_m, electrodes, settings } => {
                (path, *scale_m, electrodes, settings)
            }
        };
        // a file that cannot be read is bad input, unlike one that cannot be written
        let (mesh, repairs) =
            eit_mesh::read_mesh(path, scale_m).map_err(|e| CliError::input(e.to_string()))?;
        let notes = repairs.notes().into_iter().map(|n| format!("{}: {n}", path.display()));
        let notes = notes.collect();
        if electrodes.is_empty() {
            return Ok((mesh, notes));
        }
        let own = mesh.electrodes().len();
        if own > 0 {
            return Err(CliError::input(format!(
                "{} brings {own} electrodes and the scene has electrodes.positions_m: keep one",
                path.display()
            )));
        }
        Ok((eit_mesh::place_electrodes(mesh.surface(), electrodes, settings)?, notes))
    }
}

impl Scene {
    /// The kind of finite elements that the scene names, or needs: derivatives along displacements of
    /// electrodes are those of linear ones.
    pub fn elements(&self) -> Option<Elements> {
        let moves = self.reconstruction.electrode_movement_m.is_some();
        match self.mesh.elements {
            Some(ElementKeys::Linear) => Some(Elements::Linear),
            Some(ElementKeys::Quadratic) => Some(Elements::Quadratic),
            None => moves.then_some(Elements::Linear),
        }
    }

    /// The accuracy that the mesh is chosen for, if the scene requires one.
    pub fn required_accuracy(&self) -> Result<Option<RequiredAccuracy>, CliError> {
        let key = "noise.additive_v";
        Ok(match &self.mesh.required_accuracy {
            None => None,
            Some(AccuracyKeys::Relative(value)) => Some(RequiredAccuracy::Relative(*value)),
            Some(AccuracyKeys::Rule(AccuracyRule::Noise)) => {
                let why = "mesh.required_accuracy = \"noise\"";
                Some(RequiredAccuracy::Volts(self.needed(self.noise.additive_v, key, why)?))
            }
        })
    }

    /// The mesh this scene asks for, checked; `nodes` overrides its density.
    pub fn mesh(&self, nodes: Option<usize>) -> Result<SceneMesh, CliError> {
        let mut settings = self.mesh_settings()?;
        if let Shape::Mesh = self.skin.shape {
            if nodes.is_some() {
                return Err(self.error("--nodes is for generated meshes, not for files".to_owned()));
            }
            let file = self.needed(self.skin.file.as_deref(), "skin.file", "shape = \"mesh\"")?;
            let electrodes = match self.electrodes.positions_m {
                Some(_) => self.placed()?,
                None => Vec::new(),
            };
            let (path, scale_m) = (self.resolve(file), self.skin.scale_m.unwrap_or(1.0));
            return Ok(SceneMesh::File { path, scale_m, electrodes, settings });
        }
        let shape = self.shape()?;
        let electrodes = self.electrodes()?;
        let nodes = nodes.or(self.mesh.nodes);
        match &electrodes {
            SceneElectrodes::Rim(rim) => {
                rim.validate(&shape.outline()?)?;
                if let Some(nodes) = nodes {
                    settings = settings.for_nodes(&shape, rim, nodes)?;
                }
            }
            SceneElectrodes::Placed(placed) => {
                PlacedElectrode::validate(placed, &shape)?;
                if let Some(nodes) = nodes {
                    settings = settings.for_nodes_placed(&shape, placed, nodes)?;
                }
            }
        }
        Ok(SceneMesh::Generated { shape, electrodes, settings })
    }

    /// A mesh of the family that the scene's mesh is chosen from ([`MeshSettings::similar`]).
    pub fn similar_mesh(&self, scale: f64) -> Result<Mesh, CliError> {
        let shape = self.shape()?;
        // the search has a limit of its own
        let node_limit = MeshSettings::default().node_limit;
        let settings = MeshSettings { node_limit, ..self.mesh_settings()? };
        Ok(match self.electrodes()? {
            SceneElectrodes::Rim(rim) => {
                let settings = settings.similar(&shape, rim.width_m, scale)?;
                eit_mesh::generate(&shape, &rim, &settings)?
            }
            SceneElectrodes::Placed(placed) => {
                let widths = placed.iter().map(PlacedElectrode::width_m);
                let narrowest_m = widths.fold(f64::INFINITY, f64::min);
                let settings = settings.similar(&shape, narrowest_m, scale)?;
                eit_mesh::generate_placed(&shape, &placed, &settings)?
            }
        })
    }

    fn mesh_settings(&self) -> Result<MeshSettings, CliError> {
        let default = MeshSettings::default();
        let settings = MeshSettings {
            edge_m: self.mesh.edge_m,
            electrode_edge_m: self.mesh.electrode_edge_m,
            grading: self.mesh.grading.unwrap_or(default.grading),
            node_limit: self.mesh.node_limit.unwrap_or(default.node_limit),
            ..default
        };
        settings.validate()?;
        Ok(settings)
    }

    fn shape(&self) -> Result<SkinShape, CliError> {
        let skin = &self.skin;
        Ok(match skin.shape {
            Shape::Disc => {
                let radius_m = self.needed(skin.radius_m, "skin.radius_m", "a disc")?;
                SkinShape::Disc { radius_m }
            }
            Shape::Hemisphere => {
                let radius_m = self.needed(skin.radius_m, "skin.radius_m", "a hemisphere")?;
                SkinShape::Hemisphere { radius_m }
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

    /// The electrodes of a generated mesh.
    pub fn electrodes(&self) -> Result<SceneElectrodes, CliError> {
        let keys = &self.electrodes;
        if let Some(positions) = &keys.positions_m {
            // equal widths on a flat rim are one setting
            let flat = positions.iter().all(|p| p.0[2] == 0.0);
            if let (Some(OneOrMany::One(width_m)), None, true) =
                (&keys.width_m, &keys.radius_m, flat)
            {
                self.same_count(positions.len())?;
                let placement = Placement::At(positions.iter().map(|p| [p.0[0], p.0[1]]).collect());
                return Ok(SceneElectrodes::Rim(RimElectrodes { width_m: *width_m, placement }));
            }
            return Ok(SceneElectrodes::Placed(self.placed()?));
        }
        let placement = Placement::EquallySpaced {
            count: self.needed(keys.count, "electrodes.count", "electrodes")?,
            first_angle_deg: keys.first_angle_deg.unwrap_or(0.0),
            direction: match keys.direction {
                Direction::Counterclockwise => eit_mesh::Direction::Counterclockwise,
                Direction::Clockwise => eit_mesh::Direction::Clockwise,
            },
        };
        let widths = self.needed(keys.width_m.as_ref(), "electrodes.width_m", "electrodes")?;
        if let OneOrMany::One(width_m) = *widths {
            return Ok(SceneElectrodes::Rim(RimElectrodes { width_m, placement }));
        }
        // any one width will do for the centres, so none is given that could be refused
        let centres = RimElectrodes { width_m: 0.0, placement };
        let centres_m = centres.centres_m(&self.shape()?.outline()?)?;
        let widths = self.each("electrodes.width_m", Some(widths), centres_m.len())?;
        let placed = centres_m.iter().zip(widths);
        Ok(SceneElectrodes::Placed(
            placed.map(|(&[x, y], width_m)| PlacedElectrode::rim([x, y, 0.0], width_m)).collect(),
        ))
    }

    /// The electrodes at `positions_m`, each with a width or a radius.
    fn placed(&self) -> Result<Vec<PlacedElectrode>, CliError> {
        let keys = &self.electrodes;
        let key = "electrodes.positions_m";
        let positions = self.needed(keys.positions_m.as_ref(), key, "electrodes by position")?;
        let count = positions.len();
        self.same_count(count)?;
        if keys.width_m.is_none() && keys.radius_m.is_none() {
            return Err(self.error(
                "electrodes.width_m is missing: electrodes need it (on the rim), or \
                 electrodes.radius_m (patches)"
                    .to_owned(),
            ));
        }
        let widths = self.each("electrodes.width_m", keys.width_m.as_ref(), count)?;
        let radii = self.each("electrodes.radius_m", keys.radius_m.as_ref(), count)?;
        let one = |(k, ((at, width_m), radius_m)): (usize, ((&Position, f64), f64))| match (
            width_m == 0.0,
            radius_m == 0.0,
        ) {
            (false, true) => Ok(PlacedElectrode::rim(at.0, width_m)),
            (true, false) => Ok(PlacedElectrode::patch(at.0, radius_m)),
            _ => Err(self.error(format!(
                "electrode {}: width_m {width_m} and radius_m {radius_m}: an electrode on the \
                     rim has a width, a patch a radius, the other is 0 in its list",
                k + 1
            ))),
        };
        positions.iter().zip(widths).zip(radii).enumerate().map(one).collect()
    }

    /// One value for each electrode; zeros where the key is not there.
    pub(super) fn each(
        &self,
        key: &str,
        values: Option<&OneOrMany>,
        electrodes: usize,
    ) -> Result<Vec<f64>, CliError> {
        match values {
            None => Ok(vec![0.0; electrodes]),
            Some(OneOrMany::One(value)) => Ok(vec![*value; electrodes]),
            Some(OneOrMany::Many(values)) if values.len() == electrodes => Ok(values.clone()),
            Some(OneOrMany::Many(values)) => Err(self.error(format!(
                "{key} has {} values for {electrodes} electrodes: give one number or one each",
                values.len()
            ))),
        }
    }

    /// Refuses a count that is not that of the positions.
    fn same_count(&self, positions: usize) -> Result<(), CliError> {
        match self.electrodes.count {
            Some(count) if count != positions => Err(self.error(format!(
                "electrodes.count is {count}, but electrodes.positions_m has {positions} \
                 positions: leave one out"
            ))),
            _ => Ok(()),
        }
    }

    /// Contact impedance of each electrode.
    pub fn contact_impedance(&self, electrodes: usize) -> Result<Vec<f64>, CliError> {
        let key = "electrodes.contact_impedance_ohm_m";
        let keys = self.electrodes.contact_impedance_ohm_m.as_ref();
        let values = self.needed(keys, key, "the complete electrode model")?;
        self.each(key, Some(values), electrodes)
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

    pub(super) fn error(&self, message: String) -> CliError {
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
