//! Accuracy of touches as `eit reconstruct` lists them, on the simulated fabric.

mod movement;
mod position;
mod reliability;

use crate::Result;
use crate::recording::Simulator;
use crate::table::Table;

/// Nodes of the simulation mesh.
const NODES: usize = 9000;

/// Tables of the touches' accuracy.
pub struct TouchTables {
    /// Confidence against the fraction of true touches.
    pub reliability: Table,
    /// Position error of a held touch.
    pub position: Table,
    /// Effect of removing electrode movement from the data.
    pub movement: Table,
}

/// Measures all tables; `quick` takes fewer scripts, frames and pixels, in about a minute.
///
/// # Errors
/// Those of simulation and reconstruction.
pub fn measure(quick: bool) -> Result<TouchTables> {
    let simulator = Simulator::paper_disc(if quick { 32 } else { 64 }, NODES)?;
    Ok(TouchTables {
        reliability: reliability::table(&simulator, quick)?,
        position: position::table(&simulator, quick)?,
        movement: movement::table(&simulator, quick)?,
    })
}
