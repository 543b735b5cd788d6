//! Frames without an instrument: a finger on the simulated fabric, with the truth beside them.
//!
//! Run with `cargo run --release -p eit-fem --features fabric --example fabric`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::PairProtocol;
use eit_fem::fabric::{Fabric, FabricSettings, PlayCircle, SimulationSettings, TouchScript};
use eit_mesh::{MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use std::error::Error;

/// Root mean square of the change of a voltage, as a part of the largest voltage: in the last frame
/// without a touch, and in the last of all.
pub fn run() -> Result<[f64; 2], Box<dyn Error>> {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.01))?;
    let protocol = PairProtocol { current_a: 1e-4, ..Default::default() }.protocol()?;
    let fabric = Fabric::new(&mesh, &protocol, 1e-5, &[1e3; 16], &FabricSettings::default())?;
    let mut script = TouchScript::built_in("paper-one-finger", &PlayCircle::of(&mesh), 1)?;
    script.frames = 30;
    let raster = Raster::new(mesh.surface(), 32)?;
    let settings = SimulationSettings::default();
    let made = fabric.simulate(&script, &raster, &settings, &mut |_| {})?;

    let first = made.truth.touches.iter().map(|touch| touch.frame).min().ok_or("no touch")?;
    let before = made.frames_v.row(0);
    let largest = before.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let change = |frame: usize| {
        let change = &made.frames_v.row(frame) - &before;
        (change.dot(&change) / before.len() as f64).sqrt() / largest
    };
    let changes = [change(first - 1), change(made.frames_v.nrows() - 1)];
    println!("{} frames of {} values, touched from frame {first} on", script.frames, before.len());
    println!("changes by {:.1e} untouched and {:.1e} touched", changes[0], changes[1]);
    Ok(changes)
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
