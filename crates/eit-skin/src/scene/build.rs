//! Converts the scene's keys to settings of the library crates.

use super::mesh::{ElectrodeSource, MeshSource};
use super::{AccuracyRule, OneOrMany, Pair, Position, RequiredAccuracyKey, Scene, Shape, plain};
use crate::error::SkinError;
use eit_fem::{ElementOrder, RequiredAccuracy};
use eit_mesh::{MeshSettings, PlacedElectrode, Placement, RimElectrodes, SkinShape};

impl Scene {
    /// Returns the order of the finite elements that the scene states or implies: derivatives with respect to
    /// electrode movement require linear ones.
    pub(crate) fn element_order(&self) -> Option<ElementOrder> {
        let implied = self.reconstruction.electrode_movement_m.map(|_| ElementOrder::Linear);
        self.mesh.elements.or(implied)
    }

    /// Returns the accuracy for which the mesh is chosen, if the scene requires one.
    ///
    /// # Errors
    ///
    /// [`SkinError::Missing`] for an accuracy relative to noise that the scene does not state.
    pub(crate) fn required_accuracy(&self) -> Result<Option<RequiredAccuracy>, SkinError> {
        let key = "noise.additive_v";
        Ok(match &self.mesh.required_accuracy {
            None => None,
            Some(RequiredAccuracyKey::Relative(value)) => Some(RequiredAccuracy::Relative(*value)),
            Some(RequiredAccuracyKey::Rule(AccuracyRule::Noise)) => {
                let why = "mesh.required_accuracy = \"noise\"";
                Some(RequiredAccuracy::Volts(self.needed(self.noise.additive_v, key, why)?))
            }
        })
    }

    /// Returns the source of the scene's mesh, checked; `nodes` overrides its density.
    ///
    /// # Errors
    ///
    /// Settings of skin, electrodes or mesh that contradict each other or are out of range, and a mesh file that
    /// cannot be read.
    pub fn mesh(&self, nodes: Option<usize>) -> Result<MeshSource, SkinError> {
        let base = self.mesh_settings()?;
        if let Shape::Mesh = self.skin.shape {
            if nodes.is_some() {
                let error = SkinError::argument("nodes", "a mesh file has the nodes that it has");
                return Err(error.within(&self.place));
            }
            let file = self.needed(self.skin.file.as_deref(), "skin.file", "shape = \"mesh\"")?;
            let electrodes = match self.electrodes.positions_m {
                Some(_) => self.placed()?,
                None => Vec::new(),
            };
            let (path, scale_m) = (self.resolve(file), self.skin.scale_m.unwrap_or(1.0));
            return Ok(MeshSource::File { path, scale_m, electrodes, settings: base });
        }
        let shape = self.shape()?;
        let electrodes = self.electrodes()?;
        let checked = match &electrodes {
            ElectrodeSource::Rim(rim) => shape.outline().and_then(|outline| rim.validate(&outline)),
            ElectrodeSource::Placed(placed) => PlacedElectrode::validate(placed, &shape),
        };
        checked.map_err(|error| SkinError::from(error).within(&self.place))?;
        let settings = base.clone();
        let source = MeshSource::Generated { shape, electrodes, settings, base };
        match nodes.or(self.mesh.nodes) {
            Some(nodes) => source.with_nodes(nodes),
            None => Ok(source),
        }
    }

    fn mesh_settings(&self) -> Result<MeshSettings, SkinError> {
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

    fn shape(&self) -> Result<SkinShape, SkinError> {
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

    /// Returns the electrodes of a generated mesh.
    ///
    /// # Errors
    ///
    /// Missing, contradictory or wrongly counted keys of `[electrodes]`.
    pub fn electrodes(&self) -> Result<ElectrodeSource, SkinError> {
        let keys = &self.electrodes;
        if let Some(positions) = &keys.positions_m {
            // equal widths on a flat rim need only one setting
            let flat = positions.iter().all(|p| p.0[2] == 0.0);
            if let (Some(OneOrMany::One(width_m)), None, true) =
                (&keys.width_m, &keys.radius_m, flat)
            {
                self.same_count(positions.len())?;
                let placement = Placement::At(positions.iter().map(|p| [p.0[0], p.0[1]]).collect());
                return Ok(ElectrodeSource::Rim(RimElectrodes { width_m: *width_m, placement }));
            }
            return Ok(ElectrodeSource::Placed(self.placed()?));
        }
        let placement = Placement::EquallySpaced {
            count: self.needed(keys.count, "electrodes.count", "electrodes")?,
            first_angle_deg: keys.first_angle_deg.unwrap_or(0.0),
            direction: keys.direction,
        };
        let widths = self.needed(keys.width_m.as_ref(), "electrodes.width_m", "electrodes")?;
        if let OneOrMany::One(width_m) = *widths {
            return Ok(ElectrodeSource::Rim(RimElectrodes { width_m, placement }));
        }
        // the centres do not depend on the width, so use one that passes every check
        let centres = RimElectrodes { width_m: 0.0, placement };
        let centres_m = centres.centres_m(&self.shape()?.outline()?)?;
        let widths = self.each("electrodes.width_m", Some(widths), centres_m.len())?;
        let placed = centres_m.iter().zip(widths);
        Ok(ElectrodeSource::Placed(
            placed.map(|(&[x, y], width_m)| PlacedElectrode::rim([x, y, 0.0], width_m)).collect(),
        ))
    }

    /// The electrodes at `positions_m`, each with a width or a radius.
    fn placed(&self) -> Result<Vec<PlacedElectrode>, SkinError> {
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
                     rim has a width, a patch a radius; the value in the other list is 0",
                k + 1
            ))),
        };
        positions.iter().zip(widths).zip(radii).enumerate().map(one).collect()
    }

    /// Returns one value per electrode; zeros if the key is absent.
    ///
    /// # Errors
    ///
    /// [`SkinError::WrongCount`] unless there is one value, or one per electrode.
    pub fn each(
        &self,
        key: &str,
        values: Option<&OneOrMany>,
        electrodes: usize,
    ) -> Result<Vec<f64>, SkinError> {
        match values {
            None => Ok(vec![0.0; electrodes]),
            Some(OneOrMany::One(value)) => Ok(vec![*value; electrodes]),
            Some(OneOrMany::Many(values)) if values.len() == electrodes => Ok(values.clone()),
            Some(OneOrMany::Many(values)) => {
                let (key, found) = (key.to_owned(), values.len());
                Err(SkinError::WrongCount { key, found, electrodes }.within(&self.place))
            }
        }
    }

    /// Rejects a count that differs from the number of positions.
    fn same_count(&self, positions: usize) -> Result<(), SkinError> {
        match self.electrodes.count {
            Some(count) if count != positions => Err(self.error(format!(
                "electrodes.count is {count}, but electrodes.positions_m has {positions} \
                 positions: remove one of the keys"
            ))),
            _ => Ok(()),
        }
    }

    /// Returns the contact impedance of each electrode.
    ///
    /// # Errors
    ///
    /// A wrong number of values.
    pub fn contact_impedance(&self, electrodes: usize) -> Result<Vec<f64>, SkinError> {
        let key = "electrodes.contact_impedance_ohm_m";
        let keys = self.electrodes.contact_impedance_ohm_m.as_ref();
        let values = self.needed(keys, key, "the complete electrode model")?;
        self.each(key, Some(values), electrodes)
    }

    /// Returns the number of electrodes; reads the mesh file if necessary.
    ///
    /// # Errors
    ///
    /// Missing keys of `[electrodes]`, and a mesh file that cannot be read.
    pub fn electrode_count(&self) -> Result<usize, SkinError> {
        let source = self.mesh(None)?;
        match source.electrodes() {
            Some(count) => Ok(count),
            None => Ok(source.build()?.mesh.electrodes().len()),
        }
    }

    /// Returns whether the protocol is given by a file of quadruples.
    pub(crate) fn has_quadruples_file(&self) -> bool {
        self.protocol.quadruples_file.is_some()
    }

    pub(crate) fn needed<T>(&self, value: Option<T>, key: &str, why: &str) -> Result<T, SkinError> {
        value.ok_or_else(|| {
            SkinError::Missing { key: key.to_owned(), why: why.to_owned() }.within(&self.place)
        })
    }

    pub(crate) fn error(&self, message: String) -> SkinError {
        SkinError::input(message).within(&self.place)
    }
}

/// Corners of a closed loop; drops a first corner repeated at the end, as other tools write it.
fn open_loop(corners: &[Pair<f64>]) -> Vec<[f64; 2]> {
    let mut corners = plain(corners);
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    corners
}
