//! How late messages are, in memory that does not grow.

/// Buckets from a microsecond upwards, each 5 % wider than the one before: up to 17 s.
const BUCKETS: usize = 342;
const RATIO: f64 = 1.05;
const FIRST_S: f64 = 1e-6;

/// Distribution of latencies, accurate to 5 %.
#[derive(Debug, Clone)]
pub struct Latency {
    counts: Vec<u64>,
    count: u64,
    largest_s: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { counts: vec![0; BUCKETS], count: 0, largest_s: 0.0 }
    }
}

impl Latency {
    /// Adds a latency, seconds; a negative one, possible because clocks differ, counts as zero.
    pub fn add(&mut self, latency_s: f64) {
        let bucket = ((latency_s / FIRST_S).max(1.0).ln() / RATIO.ln()) as usize;
        self.counts[bucket.min(BUCKETS - 1)] += 1;
        self.count += 1;
        self.largest_s = self.largest_s.max(latency_s);
    }

    /// Latencies added.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The largest, seconds.
    pub fn largest_s(&self) -> f64 {
        self.largest_s
    }

    /// Returns the latency that the fraction `share` (0 to 1) of messages does not exceed, seconds, rounded up
    /// to the end of its bucket; `None` without messages.
    pub fn quantile_s(&self, share: f64) -> Option<f64> {
        let wanted = (share * self.count as f64).ceil().max(1.0) as u64;
        let mut sum = 0;
        let bucket = self.counts.iter().position(|count| {
            sum += count;
            sum >= wanted
        });
        bucket.map(|bucket| FIRST_S * RATIO.powi(bucket as i32 + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_right_to_five_per_cent() {
        let mut latency = Latency::default();
        assert_eq!(latency.quantile_s(0.5), None);
        (1..=1000).for_each(|index| latency.add(1e-5 * f64::from(index)));
        for (share, wanted) in [(0.5, 5e-3), (0.99, 9.9e-3), (1.0, 1e-2)] {
            let found = latency.quantile_s(share).unwrap();
            assert!((1.0..1.06).contains(&(found / wanted)), "{share}: {found}");
        }
        assert_eq!((latency.count(), latency.largest_s()), (1000, 1e-2));
        latency.add(-1.0);
        latency.add(1e9);
        assert_eq!(latency.count(), 1002);
    }
}
