//! How much a residual says for or against a touch.

/// Floor of the residual's excess over the noise per row, as a fraction of a row's noise.
const FLOOR: f64 = 0.3;

/// Weighs changes of the residual chi^2 of a frame.
///
/// What a residual has beyond the noise is the model's own error, which is not white: it looks like touches.
/// One unit of evidence is therefore this excess, and a constant where noise alone is left:
///
/// ```text
/// unit(r) = max(r - expected, 0) + floor,    cost(r) = integral dr / unit(r)
/// ```
///
/// Where the model's error dominates, the cost is the logarithm of the residual and a touch must lower the
/// residual by a factor. Where noise dominates, the cost is chi^2 over the floor and a touch must lower chi^2
/// by a number.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evidence {
    /// Residual that the noise leaves.
    expected: f64,
    floor: f64,
}

impl Evidence {
    /// `expected`: chi^2 of the noise alone; `rows`: number of rows present.
    pub(super) fn new(expected: f64, rows: usize) -> Self {
        Self { expected, floor: FLOOR * rows as f64 }
    }

    /// Unit of evidence at a residual.
    pub(super) fn unit(&self, rest: f64) -> f64 {
        (rest - self.expected).max(0.0) + self.floor
    }

    /// Cost of a residual; 0 at the expected one.
    pub(super) fn cost(&self, rest: f64) -> f64 {
        match rest > self.expected {
            true => (self.unit(rest) / self.floor).ln(),
            false => (rest - self.expected) / self.floor,
        }
    }

    /// Evidence ratio of a component that lowers the residual from `without` to `rest`: the factor
    /// by which the residual would grow without it, where the model's error dominates.
    pub(super) fn worth(&self, without: f64, rest: f64) -> f64 {
        1.0 + (without - rest) / self.unit(rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cost is the integral of `1 / unit`, by the midpoint rule; its error here is below 1e-4.
    #[test]
    fn the_cost_is_the_integral_of_the_unit() {
        let evidence = Evidence::new(80.0, 100);
        let (mut sum, mut rest) = (0.0, 80.0);
        for _ in 0..40_000 {
            sum += 0.01 / evidence.unit(rest + 0.005);
            rest += 0.01;
        }
        assert!((evidence.cost(480.0) - sum).abs() < 1e-4, "{sum}");
        assert!((evidence.cost(20.0) + 2.0).abs() < 1e-12);
    }

    /// Where noise dominates, a fall of chi^2 is worth the same at any residual; where the model's error
    /// dominates, the same factor is.
    #[test]
    fn noise_counts_by_number_and_model_error_by_factor() {
        let evidence = Evidence::new(80.0, 100);
        assert!((evidence.worth(70.0, 40.0) - 2.0).abs() < 1e-12);
        assert!((evidence.worth(60.0, 30.0) - 2.0).abs() < 1e-12);
        assert!((evidence.worth(2e6, 1e6) - 2.0).abs() < 1e-3);
        // thirty of chi^2 are much below the error of such a model
        assert!(evidence.worth(10_030.0, 10_000.0) < 1.01);
    }
}
