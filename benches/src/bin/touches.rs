//! Accuracy of the touches that `eit reconstruct` lists: calibration of their confidence, position
//! error, and the effect of removing electrode movement from the data, which is copied into
//! `docs/PERFORMANCE.md`.
//!
//! Usage: `touches [--quick]`; prints the tables. `--quick` takes fewer scripts and frames and leaves
//! the document alone.
#![allow(clippy::print_stdout, reason = "the tables are this program's output")]

use benches::{Result, document, touches};

fn main() -> Result<()> {
    let quick = match std::env::args().nth(1).as_deref() {
        None => false,
        Some("--quick") => true,
        Some(other) => return Err(format!("'{other}': only --quick is known").into()),
    };
    let tables = touches::measure(quick)?;
    println!("{}\n{}\n{}", tables.reliability, tables.position, tables.movement);
    match quick {
        true => Ok(()),
        false => document::write("electrodes", &tables.movement.body()),
    }
}
