//! Reads a recording of any format, checks its order by reciprocity and prints the result.
//!
//! `cargo run --release --example read_recording -- FILE_OR_FOLDER`; without an argument it writes
//! a small CSV file of its own.

use std::error::Error;
use std::path::{Path, PathBuf};

use eit_hw::{Component, OrderVerdict, Quadruple, ReadOptions, read_recording, recognise_order};

const ELECTRODES: u32 = 16;

fn main() -> Result<(), Box<dyn Error>> {
    match std::env::args_os().nth(1) {
        Some(path) => show(&PathBuf::from(path)).map(|_| ()),
        None => run().map(|_| ()),
    }
}

/// Writes 208 values of a homogeneous half-plane in "ascending" order, reads them back for a scene
/// in "rotated" order and returns the verdict.
pub fn run() -> Result<OrderVerdict, Box<dyn Error>> {
    let path = std::env::temp_dir().join(format!("eit-hw-example-{}.csv", std::process::id()));
    let row: Vec<_> = adjacent(true).into_iter().map(|q| half_plane(q).to_string()).collect();
    std::fs::write(&path, row.join(","))?;
    let verdict = show(&path);
    std::fs::remove_file(&path)?;
    verdict
}

#[allow(clippy::print_stdout, reason = "an example shows what it does")]
fn show(path: &Path) -> Result<OrderVerdict, Box<dyn Error>> {
    let recording = read_recording(path, None, &ReadOptions::default())?;
    println!("{}: {} frame(s)", recording.format, recording.frame_count());
    for note in &recording.notes {
        println!("note: {note}");
    }
    for skipped in &recording.skipped.first {
        println!("skipped: {skipped}");
    }
    let scene = adjacent(false);
    let frames = recording.frames_for(Some(&scene), scene.len(), Component::Real)?;
    println!("first value: {:.3e} ({:?})", frames.values[[0, 0]], frames.unit);
    let alternatives = [("[protocol] order = \"ascending\"", adjacent(true))];
    let verdict = recognise_order(&frames.mean_frame(), &scene, &alternatives);
    match &verdict {
        OrderVerdict::Consistent { error } => println!("reciprocity error {error:.3}"),
        OrderVerdict::Other { better, ours } => {
            println!("reciprocity error {ours:.3}, but {:.3} with", better[0].error);
            println!("{}", better[0].setting);
        }
        OrderVerdict::Unclear { .. } => println!("reciprocity says nothing"),
    }
    Ok(verdict)
}

/// Returns the quadruples of adjacent drive and measurement without driven electrodes.
fn adjacent(ascending: bool) -> Vec<Quadruple> {
    let pairs = |drive: u32| {
        let first = if ascending { 0 } else { drive };
        (0..ELECTRODES)
            .map(move |step| (first + step) % ELECTRODES)
            .filter(move |m| (m + ELECTRODES - drive + 1) % ELECTRODES > 2)
            .map(move |m| [drive, (drive + 1) % ELECTRODES, m, (m + 1) % ELECTRODES])
    };
    (0..ELECTRODES).flat_map(pairs).collect()
}

/// Returns the value of a measurement with point electrodes on the rim of a homogeneous disc, whose
/// potential is that of a half-plane: -ln(distance) / pi for 1 A and 1 S.
fn half_plane([a, b, m, n]: Quadruple) -> f64 {
    let distance = |i: u32, j: u32| {
        let half_angle = std::f64::consts::PI * f64::from(i.abs_diff(j)) / f64::from(ELECTRODES);
        2.0 * half_angle.sin()
    };
    let potential = |at: u32| (distance(at, b) / distance(at, a)).ln() / std::f64::consts::PI;
    potential(m) - potential(n)
}
