//! Ctrl-C ends live commands cleanly: what is written is complete and named.

use crate::error::CliError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set once the user wants an end.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// From now on Ctrl-C, and the wish of the system to end, set it; a second one kills.
    pub fn listen() -> Result<Self, CliError> {
        let interrupt = Self::default();
        let failed = |e| CliError::Failure(format!("signals cannot be taken: {e}"));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            // in this order: the first finds the flag unset
            let kill = signal_hook::flag::register_conditional_shutdown(
                signal,
                128 + signal,
                Arc::clone(&interrupt.0),
            );
            kill.map_err(failed)?;
            signal_hook::flag::register(signal, Arc::clone(&interrupt.0)).map_err(failed)?;
        }
        Ok(interrupt)
    }

    /// Whether it is set.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
