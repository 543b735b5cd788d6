//! Voltages of a disc without a mesh: what meshes are judged by. A hemisphere with electrodes on its
//! rim has the same: the stereographic projection keeps angles, and on the rim it keeps lengths.

use super::Setup;
use crate::error::SkinError;
use crate::scene::{OneOrMany, Scene, SceneElectrodes, Shape};
use eit_fem::analytic::DiscSeries;
use eit_mesh::Placement;
use ndarray::Array1;

/// The series costs `electrodes^2` sums of Bessel products: 0.1 s for 16, 0.5 s for 32.
const MOST_SERIES_ELECTRODES: usize = 32;
/// Harmonics of the disc for each polynomial on an electrode.
const HARMONICS_OF_A_DEGREE: usize = 170;

/// Voltages of the homogeneous disc or hemisphere in protocol order by the mesh-free series, volt;
/// `None` where the skin is neither, its contacts differ or have no finite impedance above zero, or
/// its electrodes are too many for a quick answer.
///
/// `degree` polynomials on each electrode; more of them are more digits.
pub fn disc_voltages(
    scene: &Scene,
    setup: &Setup,
    degree: usize,
) -> Result<Option<Array1<f64>>, SkinError> {
    if scene.skin.shape == Shape::Mesh || setup.protocol.electrodes() > MOST_SERIES_ELECTRODES {
        return Ok(None);
    }
    let SceneElectrodes::Rim(electrodes) = scene.electrodes()? else { return Ok(None) };
    let round = matches!(scene.skin.shape, Shape::Disc | Shape::Hemisphere);
    let (Some(radius_m), Placement::EquallySpaced { count, first_angle_deg, direction }) =
        (scene.skin.radius_m.filter(|_| round), &electrodes.placement)
    else {
        return Ok(None);
    };
    let Some(OneOrMany::One(contact_impedance_ohm_m)) = scene.electrodes.contact_impedance_ohm_m
    else {
        return Ok(None);
    };
    // shunts and ideal current sources are the mesh's alone
    if !(contact_impedance_ohm_m > 0.0 && contact_impedance_ohm_m.is_finite()) {
        return Ok(None);
    }
    let turn = match direction {
        eit_mesh::Direction::Counterclockwise => 1.0,
        eit_mesh::Direction::Clockwise => -1.0,
    };
    let step = turn * std::f64::consts::TAU / *count as f64;
    let series = DiscSeries {
        radius_m,
        conductivity_s: scene.skin.conductivity_s,
        electrode_angles_rad: (0..*count)
            .map(|l| first_angle_deg.to_radians() + step * l as f64)
            .collect(),
        electrode_width_m: electrodes.width_m,
        contact_impedance_ohm_m,
        degree,
        harmonics: HARMONICS_OF_A_DEGREE * degree,
    };
    let exact = series.electrode_potentials(setup.protocol.stimulations_a())?;
    let patterns = setup.protocol.measurement_patterns();
    let data = setup.protocol.data().iter();
    let of = |&[s, m]: &[u32; 2]| exact.row(s as usize).dot(&patterns.row(m as usize));
    Ok(Some(data.map(of).collect()))
}
