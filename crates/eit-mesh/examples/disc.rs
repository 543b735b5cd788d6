//! A disc of 0.1 m radius with 16 electrodes, meshed at three resolutions.
//!
//! Run with `cargo run --release -p eit-mesh --example disc`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_mesh::{
    Direction, MeshError, MeshSettings, Placement, Quality, RimElectrodes, SkinShape, generate,
};
use std::time::Instant;

/// Meshes the disc at three resolutions and returns the quality of each mesh.
pub(crate) fn run() -> Result<Vec<Quality>, MeshError> {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    // electrode 1 at the top, numbers increasing counter-clockwise
    let electrodes = RimElectrodes {
        width_m: 0.0196,
        placement: Placement::EquallySpaced {
            count: 16,
            first_angle_deg: 90.0,
            direction: Direction::Counterclockwise,
        },
    };
    let mut figures = Vec::new();
    for edge_m in [0.01, 0.005, 0.0014] {
        let settings = MeshSettings { edge_m: Some(edge_m), ..Default::default() };
        let start = Instant::now();
        let mesh = generate(&skin, &electrodes, &settings)?;
        let time_ms = 1e3 * start.elapsed().as_secs_f64();
        let quality = Quality::of(&mesh);
        println!("edge_m = {edge_m}, meshed in {time_ms:.1} ms\n{quality}\n");
        figures.push(quality);
    }
    Ok(figures)
}

fn main() -> Result<(), MeshError> {
    run().map(|_| ())
}
