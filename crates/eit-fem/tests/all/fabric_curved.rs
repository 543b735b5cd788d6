//! The simulated fabric on skins that are not flat.

use crate::common::skins::{changed, disc, dome, finger, key, script, try_fabric, try_simulate};
use crate::common::{largest, moved};
use eit_core::vector::norm;
use eit_fem::FemError;
use eit_fem::fabric::{FabricSettings, PlayCircle, Simulation, Tip, TouchScript};
use eit_mesh::{Mesh, Raster};

/// Two frames without touch, then two fingers, one of which moves.
fn fingers(along: f64) -> TouchScript {
    let strokes = |id, tip, places: [[f64; 2]; 2]| {
        let [from, to] = places.map(|[x, y]| [x, along * y]);
        finger(id, tip, vec![key(0.2, from, 1.5), key(0.5, to, 1.5)])
    };
    let rests = strokes(1, Tip::Round, [[0.03, -0.02]; 2]);
    script(6, 2, vec![rests, strokes(2, Tip::Flat, [[-0.05, 0.0], [-0.05, 0.03]])])
}

fn simulate(mesh: &Mesh, script: &TouchScript, pixels: usize) -> Result<Simulation, FemError> {
    // the weave is drawn as seen from +z, and the reach of friction follows from the extent along x and y
    let settings = changed(FabricSettings::default(), |s| {
        (s.weave.amplitude, s.membrane.friction) = (0.0, 0.0)
    });
    try_simulate(mesh, &try_fabric(mesh, &settings)?, script, pixels)
}

/// What happens on a disc does not depend on how it lies in space: dents, moving nodes, contacts and conductivities of a
/// disc that is tilted by 50 degrees are those of the disc.
#[test]
fn a_tilted_disc_is_a_disc() {
    let flat = disc(0.012);
    let (sin, cos) = 50_f64.to_radians().sin_cos();
    let tilted = moved(&flat, |[x, y, _]| [x, cos * y, sin * y]);
    let [wanted, found] = [(&flat, 1.0), (&tilted, cos)]
        .map(|(mesh, along)| simulate(mesh, &fingers(along), 64).unwrap());
    let change = largest(&(&wanted.exact_v.row(4) - &wanted.exact_v.row(0)));
    assert!(change > 1e-3 * largest(&wanted.exact_v), "{change}");
    // solves are accurate to 1e-10 of the largest voltage or better
    let off = largest(&(&found.exact_v - &wanted.exact_v));
    assert!(off < 1e-7 * change, "{off} {change}");
    for l in 0..16 {
        let shift_m =
            |made: &Simulation| norm([0, 1, 2].map(|k| made.truth.electrode_shift_m[[4, l, k]]));
        let (one, other) = (shift_m(&wanted), shift_m(&found));
        assert!((one - other).abs() < 1e-12, "{l}: {one} {other}");
    }
    // forces: pressures integrate to them over the skin, whose pixels are longer than they look
    let force_n = |made: &Simulation, mesh: &Mesh, long: f64| {
        let pixel_m = Raster::new(mesh.surface(), 64).unwrap().pixel_m();
        let frame = made.truth.pressure_pa.index_axis(ndarray::Axis(0), 4);
        frame.iter().filter(|p| p.is_finite()).sum::<f64>() * pixel_m.powi(2) / long
    };
    let forces_n = [force_n(&wanted, &flat, 1.0), force_n(&found, &tilted, cos)];
    assert!((forces_n[0] - forces_n[1]).abs() < 0.05 * forces_n[0], "{forces_n:?}");
}

/// Every built-in script runs on a dome, and a place beside it is refused.
#[test]
fn a_dome_is_pressed() {
    let dome = dome(0.02);
    for name in TouchScript::BUILT_IN {
        let mut script = TouchScript::built_in(name, &PlayCircle::of(&dome), 3).unwrap();
        script.frames = script.frames.min(script.quiet_frames + 40);
        let made = simulate(&dome, &script, 16).unwrap();
        assert!(made.report.least_area_ratio > 0.3, "{name}: {}", made.report.least_area_ratio);
        assert!(!made.truth.touches.is_empty(), "{name}");
    }
    let beside = changed(fingers(1.0), |s| s.fingers[0].keys[0].position_m = [0.09, 0.09]);
    assert!(matches!(simulate(&dome, &beside, 16), Err(FemError::OutsideSkin { finger: 1, .. })));
}
