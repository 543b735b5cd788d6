//! Mesh-free series for a scene's skin: reference voltages of a disc. A hemisphere with electrodes on its rim
//! has the same voltages: the stereographic projection preserves angles, and lengths on the rim.

use super::{ElectrodeSource, OneOrMany, Scene, Shape};
use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::analytic::DiscSeries;
use eit_mesh::Placement;
use ndarray::Array1;

/// The series needs `electrodes^2` sums of Bessel products: 0.1 s for 16, 0.5 s for 32.
const MOST_SERIES_ELECTRODES: usize = 32;
/// Number of harmonics of the disc per polynomial on an electrode.
const HARMONICS_OF_A_DEGREE: usize = 170;

impl Scene {
    /// Returns the series for a homogeneous disc or hemisphere, with degree 0. `None` if the skin is neither,
    /// its contacts differ or have no finite positive impedance, or it has too many electrodes for a quick
    /// answer.
    pub(crate) fn disc_series(&self, electrodes: usize) -> Result<Option<DiscSeries>, SkinError> {
        let is_scalar = self.skin.weave_ratio.is_none_or(|ratio| ratio == 1.0);
        if self.skin.shape == Shape::Mesh || !is_scalar || electrodes > MOST_SERIES_ELECTRODES {
            return Ok(None);
        }
        let ElectrodeSource::Rim(rim) = self.electrodes()? else { return Ok(None) };
        let round = matches!(self.skin.shape, Shape::Disc | Shape::Hemisphere);
        let (Some(radius_m), Placement::EquallySpaced { count, first_angle_deg, direction }) =
            (self.skin.radius_m.filter(|_| round), &rim.placement)
        else {
            return Ok(None);
        };
        let Some(OneOrMany::One(contact_impedance_ohm_m)) = self.electrodes.contact_impedance_ohm_m
        else {
            return Ok(None);
        };
        // the series does not cover shunts and ideal current sources
        if !(contact_impedance_ohm_m > 0.0 && contact_impedance_ohm_m.is_finite()) {
            return Ok(None);
        }
        let turn = match direction {
            eit_mesh::Direction::Counterclockwise => 1.0,
            eit_mesh::Direction::Clockwise => -1.0,
        };
        let step = turn * std::f64::consts::TAU / *count as f64;
        Ok(Some(DiscSeries {
            radius_m,
            conductivity_s: self.skin.conductivity_s,
            electrode_angles_rad: (0..*count)
                .map(|l| first_angle_deg.to_radians() + step * l as f64)
                .collect(),
            electrode_width_m: rim.width_m,
            contact_impedance_ohm_m,
            degree: 0,
            harmonics: 0,
        }))
    }
}

impl Skin {
    /// Returns the untouched skin's voltages in protocol order by the mesh-free series, volt; `None` if there
    /// is no series. `degree` is the number of polynomials per electrode; more of them give more digits.
    ///
    /// # Errors
    ///
    /// The errors of the series.
    pub fn series_voltages(&self, degree: usize) -> Result<Option<Array1<f64>>, SkinError> {
        let Some(series) = &self.series else { return Ok(None) };
        let harmonics = HARMONICS_OF_A_DEGREE * degree;
        let series = DiscSeries { degree, harmonics, ..series.clone() };
        let exact = series.electrode_potentials(self.protocol.stimulations_a())?;
        let patterns = self.protocol.measurement_patterns();
        let data = self.protocol.data().iter();
        let of = |&[s, m]: &[u32; 2]| exact.row(s as usize).dot(&patterns.row(m as usize));
        Ok(Some(data.map(of).collect()))
    }
}
