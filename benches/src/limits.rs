//! Measured limits of one thread on this machine, used as denominators of all floors.

use crate::Result;
use crate::stopwatch::median;
use faer::linalg::matmul::matmul;
use faer::{Accum, ColRef, Mat, Par};
use std::hint::black_box;

/// Repetitions of each measurement.
const REPEATS: usize = 41;

/// Order of the matrices in the timed product: 3 x 1.2 MB, mostly in the second-level cache.
const ORDER: usize = 384;

/// Number of independent sums in a read, so that the latency of additions does not hide the memory
/// rate.
const LANES: usize = 32;

/// Measures floating point operations per second of a dense matrix product in f64.
///
/// # Errors
/// None in practice.
pub fn matmul_flop_per_s() -> Result<f64> {
    let entry = |i: usize, j: usize| 1.0 / (1.0 + (i + 2 * j) as f64);
    let (a, b) = (Mat::from_fn(ORDER, ORDER, entry), Mat::from_fn(ORDER, ORDER, entry));
    let mut c = Mat::zeros(ORDER, ORDER);
    let times = median(REPEATS, || {
        matmul(c.as_mut(), Accum::Replace, black_box(&a), black_box(&b), 1.0, Par::Seq);
        black_box(&c);
        Ok(())
    })?;
    Ok(2.0 * (ORDER as f64).powi(3) / times.least_cpu_s)
}

/// Measures the same rate in f32.
///
/// # Errors
/// None in practice.
pub fn matmul_f32_flop_per_s() -> Result<f64> {
    let entry = |i: usize, j: usize| 1.0 / (1.0 + (i + 2 * j) as f32);
    let (a, b) = (Mat::from_fn(ORDER, ORDER, entry), Mat::from_fn(ORDER, ORDER, entry));
    let mut c = Mat::<f32>::zeros(ORDER, ORDER);
    let times = median(REPEATS, || {
        matmul(c.as_mut(), Accum::Replace, black_box(&a), black_box(&b), 1.0, Par::Seq);
        black_box(&c);
        Ok(())
    })?;
    Ok(2.0 * (ORDER as f64).powi(3) / times.least_cpu_s)
}

/// Measures bytes per second stored by a plain loop over `bytes` of memory, which is reused.
///
/// # Errors
/// None in practice.
pub fn store_byte_per_s(bytes: usize) -> Result<f64> {
    let mut values = vec![0.0_f64; bytes.div_ceil(8)];
    let mut number = 0.0;
    best_rate(bytes, || {
        number += 1.0;
        values.fill(black_box(number));
        black_box(&values);
    })
}

/// Measures bytes per second read by a sum over `bytes` of memory, which is read repeatedly: the
/// faster of a plain loop and faer's sum of squares (wider registers where the processor has them).
///
/// # Errors
/// None in practice.
pub fn read_byte_per_s(bytes: usize) -> Result<f64> {
    let values = vec![1.0_f64; bytes.div_ceil(8)];
    let plain = best_rate(bytes, || {
        let mut sums = [0.0; LANES];
        for chunk in black_box(&values).chunks_exact(LANES) {
            sums.iter_mut().zip(chunk).for_each(|(s, x)| *s += x);
        }
        black_box(sums);
    })?;
    let wide = best_rate(bytes, || {
        black_box(ColRef::from_slice(black_box(&values)).squared_norm_l2());
    })?;
    Ok(plain.max(wide))
}

/// Best rate of a pass over `bytes`, repeated for timing accuracy (at least 10 MB per timing).
fn best_rate(bytes: usize, mut pass: impl FnMut()) -> Result<f64> {
    let passes = (10_000_000 / bytes.max(1)).max(1);
    let times = median(REPEATS, || {
        (0..passes).for_each(|_| pass());
        Ok(())
    })?;
    Ok((bytes * passes) as f64 / times.least_cpu_s)
}
