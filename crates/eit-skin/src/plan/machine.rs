//! Describes this machine and the best rates of one of its threads: the basis of lower bounds on time, and of
//! scaling a plan's times.

use ndarray::{Array2, LinalgScalar};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Order of the matrices in the timed product: 3 x 0.5 MB in double precision.
const ORDER: usize = 256;
/// Sizes, in bytes, of arrays that are read repeatedly: they fit the first and second cache of most
/// processors, and about match the factors of a one-step reconstruction.
const READ_BYTES: [usize; 3] = [16 << 10, 256 << 10, 3 << 20];
/// Minimum number of bytes per timing, to exceed the clock's resolution.
const LEAST_BYTES: usize = 3 << 20;
/// Number of timings, of which the best counts: other programs can only slow one down.
const REPEATS: usize = 9;
/// Number of independent sums, so that the latency of addition does not hide the memory's rate.
const LANES: usize = 32;

/// A machine, as measured now.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Machine {
    /// Model of the processor, as reported by the system.
    pub processor: String,
    /// Number of threads that run at once.
    pub threads: usize,
    /// Operating system and architecture.
    pub system: String,
    /// Load average over the last minute, if the system reports it: 1 is one busy thread.
    pub load: Option<f64>,
    /// Dense matrix product in double precision, one thread, operations per second.
    pub double_flops_per_s: f64,
    /// The same in single precision.
    pub single_flops_per_s: f64,
    /// Plain sum, one thread, bytes per second, over 16 KiB, 256 KiB and 3 MiB.
    pub read_bytes_per_s: [f64; 3],
}

impl Machine {
    /// Identifies and measures the machine; takes about 50 ms.
    pub fn measure() -> Self {
        let file = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let processors = file("/proc/cpuinfo");
        let model = processors.lines().find_map(|line| line.strip_prefix("model name"));
        let model = model.map(|rest| rest.trim_start_matches(['\t', ' ', ':']).trim().to_owned());
        Self {
            processor: model.unwrap_or_else(|| "unknown processor".to_owned()),
            threads: std::thread::available_parallelism().map_or(1, Into::into),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load: file("/proc/loadavg").split(' ').next().and_then(|word| word.parse().ok()),
            double_flops_per_s: product_flops_per_s::<f64>(|i, j| 1.0 / (1.0 + (i + 2 * j) as f64)),
            single_flops_per_s: product_flops_per_s::<f32>(|i, j| 1.0 / (1.0 + (i + 2 * j) as f32)),
            read_bytes_per_s: READ_BYTES.map(read_bytes_per_s),
        }
    }

    /// Describes the machine, for tables.
    pub fn description(&self) -> String {
        let load = self.load.map_or_else(String::new, |load| format!(", load average {load}"));
        format!(
            "{}, {} threads, {}{load}; one thread: dense product {:.0} GFLOP/s in f64, {:.0} in \
             f32, read {:.0}, {:.0} and {:.0} GB/s from 16 and 256 KiB and 3 MiB",
            self.processor,
            self.threads,
            self.system,
            1e-9 * self.double_flops_per_s,
            1e-9 * self.single_flops_per_s,
            1e-9 * self.read_bytes_per_s[0],
            1e-9 * self.read_bytes_per_s[1],
            1e-9 * self.read_bytes_per_s[2],
        )
    }

    /// Returns the minimum time for this work in double precision: that of the slower of computing and
    /// reading.
    pub fn floor_s(&self, flops: f64, bytes: f64) -> f64 {
        (flops / self.double_flops_per_s).max(self.read_s(bytes))
    }

    /// Returns the same in single precision.
    pub fn single_floor_s(&self, flops: f64, bytes: f64) -> f64 {
        (flops / self.single_flops_per_s).max(self.read_s(bytes))
    }

    /// Minimum time for reading this many bytes from the cache that holds them.
    fn read_s(&self, bytes: f64) -> f64 {
        let rates = READ_BYTES.iter().zip(self.read_bytes_per_s);
        let fitting = rates.filter(|(size, _)| bytes <= **size as f64).map(|(_, rate)| rate);
        // a larger cache cannot be faster than a smaller one was measured to be
        bytes / fitting.fold(self.read_bytes_per_s[2], f64::max)
    }
}

/// Best time of several runs, seconds.
fn best_s(mut run: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        run();
        least = least.min(start.elapsed().as_secs_f64());
    }
    least
}

fn product_flops_per_s<T: LinalgScalar>(entry: impl Fn(usize, usize) -> T) -> f64 {
    let matrix = Array2::from_shape_fn((ORDER, ORDER), |(i, j)| entry(i, j));
    let time_s = best_s(|| {
        black_box(black_box(&matrix).dot(black_box(&matrix)));
    });
    2.0 * (ORDER as f64).powi(3) / time_s
}

fn read_bytes_per_s(bytes: usize) -> f64 {
    let values = vec![1.0_f64; bytes / 8];
    let passes = (LEAST_BYTES / bytes).max(1);
    let time_s = best_s(|| {
        for _ in 0..passes {
            // the widest registers available, as our kernels use them
            pulp::Arch::new().dispatch(|| {
                let mut sums = [0.0; LANES];
                for chunk in black_box(&values).chunks_exact(LANES) {
                    for lane in 0..LANES {
                        sums[lane] += chunk[lane];
                    }
                }
                black_box(sums);
            });
        }
    });
    (bytes * passes) as f64 / time_s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rates are plausible for current machines, and lower bounds follow from them.
    #[test]
    fn rates_are_plausible_and_floors_take_the_larger() {
        let machine = Machine::measure();
        let [first, second, third] = machine.read_bytes_per_s;
        let products = [machine.double_flops_per_s, machine.single_flops_per_s];
        for rate in [first, second, third].into_iter().chain(products) {
            assert!((1e7..1e14).contains(&rate), "{machine:?}");
        }
        let (flops, bytes) = (machine.double_flops_per_s, third);
        // a product and a quotient may each round
        assert!((machine.floor_s(2.0 * flops, bytes) - 2.0).abs() < 1e-12);
        assert!((machine.floor_s(flops, 3.0 * bytes) - 3.0).abs() < 1e-12);
        assert!(machine.floor_s(0.0, 1e4) <= 1e4 / third);
        assert!(machine.description().contains("GFLOP/s"));
    }
}
