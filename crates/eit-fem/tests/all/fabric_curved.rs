//! The simulated fabric on skins that are not flat.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use eit_fem::fabric::{
    Fabric, FabricSettings, Finger, Interpolation, Key, PlayCircle, Simulation, SimulationSettings,
    Tip, TouchScript,
};
use eit_fem::{FemError, PairProtocol};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, Surface, generate};

/// Two frames without touch, then two fingers that move.
fn script(along: f64) -> TouchScript {
    let finger = |id, tip, from: [f64; 2], to: [f64; 2]| {
        let key = |time_s, [x, y]: [f64; 2]| Key {
            time_s,
            position_m: [x, along * y],
            force_n: 1.5,
            radius_m: 0.01,
        };
        let keys = vec![key(0.2, from), key(0.5, to)];
        Finger { id, tip, interpolation: Interpolation::Linear, keys }
    };
    TouchScript {
        name: "two".to_owned(),
        frame_rate_hz: 10.0,
        frames: 6,
        quiet_frames: 2,
        fingers: vec![
            finger(1, Tip::Round, [0.03, -0.02], [0.03, -0.02]),
            finger(2, Tip::Flat, [-0.05, 0.0], [-0.05, 0.03]),
        ],
    }
}

fn simulate(mesh: &Mesh, script: &TouchScript) -> Result<Simulation, FemError> {
    let mut settings = FabricSettings::default();
    // the weave is drawn as seen from +z, and the reach of friction follows from the extent along x and y
    settings.weave.amplitude = 0.0;
    settings.membrane.friction = 0.0;
    let protocol = PairProtocol::default().protocol()?;
    let fabric = Fabric::new(mesh, &protocol, 1e-5, &[1e3; 16], &settings)?;
    let raster = Raster::new(mesh.surface(), 64).unwrap();
    let how = SimulationSettings { keep_elements: true, ..Default::default() };
    fabric.simulate(script, &raster, &how, &mut |_| {})
}

fn generated(shape: SkinShape) -> Mesh {
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    generate(&shape, &electrodes, &MeshSettings::with_edge(0.012)).unwrap()
}

/// What happens on a disc does not depend on how it lies in space: dents, moving nodes, contacts and conductivities of a
/// disc that is tilted by 50 degrees are those of the disc.
#[test]
fn a_tilted_disc_is_a_disc() {
    let flat = generated(SkinShape::Disc { radius_m: 0.1 });
    let (sin, cos) = 50_f64.to_radians().sin_cos();
    let nodes = flat.surface().nodes().iter().map(|&[x, y, _]| [x, cos * y, sin * y]).collect();
    let surface = Surface::new(nodes, flat.surface().triangles().to_vec()).unwrap();
    let tilted = Mesh::new(surface, flat.electrodes().to_vec()).unwrap();
    let [wanted, found] =
        [(&flat, 1.0), (&tilted, cos)].map(|(mesh, along)| simulate(mesh, &script(along)).unwrap());
    let largest = wanted.exact_v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let touched = &wanted.exact_v.row(4) - &wanted.exact_v.row(0);
    let change = touched.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!(change > 1e-3 * largest, "{change} {largest}");
    // solves are accurate to 1e-10 of the largest voltage or better
    let off = (&found.exact_v - &wanted.exact_v).iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!(off < 1e-7 * change, "{off} {change}");
    let shifts = |made: &Simulation, f: usize, l: usize| {
        (0..3).map(|k| made.truth.electrode_shift_m[[f, l, k]].powi(2)).sum::<f64>().sqrt()
    };
    for l in 0..16 {
        let (one, other) = (shifts(&wanted, 4, l), shifts(&found, 4, l));
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
    let dome = generated(SkinShape::Hemisphere { radius_m: 0.1 });
    for name in TouchScript::BUILT_IN {
        let mut script = TouchScript::built_in(name, &PlayCircle::of(&dome), 3).unwrap();
        script.frames = script.frames.min(script.quiet_frames + 40);
        let made = simulate(&dome, &script).unwrap();
        assert!(made.report.least_area_ratio > 0.3, "{name}: {}", made.report.least_area_ratio);
        assert!(!made.truth.touches.is_empty(), "{name}");
    }
    let mut beside = script(1.0);
    beside.fingers[0].keys[0].position_m = [0.09, 0.09];
    assert!(matches!(simulate(&dome, &beside), Err(FemError::OutsideSkin { finger: 1, .. })));
}
