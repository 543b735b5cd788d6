//! Frames of one finger on the simulated fabric, with ground truth; no instrument is needed.
//!
//! Run with `cargo run --release -p eit-fem --features fabric --example fabric`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::PairProtocol;
use eit_fem::fabric::{Fabric, FabricSettings, PlayCircle, SimulationSettings, TouchScript};
use eit_mesh::{MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use std::error::Error;

/// Returns the root mean square change of the voltages, as a fraction of the largest voltage, in
/// the last frame without touch and in the last frame.
pub fn run() -> Result<[f64; 2], Box<dyn Error>> {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.01))?;
    let protocol = PairProtocol { current_a: 1e-4, ..Default::default() }.protocol()?;
    let fabric = Fabric::new(&mesh, &protocol, 1e-5, &[1e3; 16], &FabricSettings::default())?;
    let mut script = TouchScript::built_in("one-finger", &PlayCircle::of(&mesh), 1)?;
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
    println!("{} frames of {} values, first touch in frame {first}", script.frames, before.len());
    println!("relative change: {:.1e} untouched, {:.1e} touched", changes[0], changes[1]);
    Ok(changes)
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
