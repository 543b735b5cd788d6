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
    Ok(Times { cpu_s: middle(&mut cpu), wall_s: middle(&mut wall), least_cpu_s })
}

/// Median of a non-empty list; for an even number of values, the mean of the middle two.
fn middle(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    0.5 * (values[last / 2] + values[last.div_ceil(2)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_odd_and_even_counts() {
        assert_eq!(middle(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(middle(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
    }

    #[test]
    fn errors_end_the_timing() {
        assert!(median(3, || Err("no".into())).is_err());
    }
}
