//! Medians of CPU time and wall time over repeated runs.

use crate::Result;
use cpu_time::ProcessTime;
use std::time::Instant;

/// Medians of repeated runs, seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// CPU time of the process, user and system, which other processes hardly affect.
    pub cpu_s: f64,
    /// Wall time.
    pub wall_s: f64,
    /// Minimum CPU time, an estimate of the undisturbed time.
    pub least_cpu_s: f64,
}

/// Returns median times of `repeats` runs, after a warm-up run.
///
/// # Errors
/// Those of `run`.
pub fn median(repeats: usize, mut run: impl FnMut() -> Result<()>) -> Result<Times> {
    run()?;
    let (mut cpu, mut wall) = (Vec::new(), Vec::new());
    for _ in 0..repeats.max(1) {
        let (cpu_start, wall_start) = (ProcessTime::now(), Instant::now());
        run()?;
        cpu.push(cpu_start.elapsed().as_secs_f64());
        wall.push(wall_start.elapsed().as_secs_f64());
    }
    let least_cpu_s = cpu.iter().copied().fold(f64::INFINITY, f64::min);
    let [cpu_s, wall_s] = [cpu, wall].map(|times_s| eit_core::median(times_s).unwrap_or(f64::NAN));
    Ok(Times { cpu_s, wall_s, least_cpu_s })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_end_the_timing() {
        assert!(median(3, || Err("no".into())).is_err());
    }
}
