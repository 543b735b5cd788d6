//! The optimiser.

/// Decay of the mean and of the mean square, and what keeps the division finite: the values of the
/// paper.
const DECAY: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;

/// Adam (Kingma and Ba, ICLR 2015, algorithm 1).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Adam {
    pub mean: Vec<f32>,
    pub square: Vec<f32>,
    pub steps: u64,
}

impl Adam {
    pub fn new(parameters: usize) -> Self {
        Self { mean: vec![0.0; parameters], square: vec![0.0; parameters], steps: 0 }
    }

    /// One step against the gradient.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], rate: f64) {
        self.steps += 1;
        let [of_mean, of_square] = DECAY.map(|decay| 1.0 - decay.powf(self.steps as f64));
        let memory = self.mean.iter_mut().zip(&mut self.square);
        for ((parameter, gradient), (mean, square)) in
            parameters.iter_mut().zip(gradient).zip(memory)
        {
            let g = f64::from(*gradient);
            let m = DECAY[0] * f64::from(*mean) + (1.0 - DECAY[0]) * g;
            let v = DECAY[1] * f64::from(*square) + (1.0 - DECAY[1]) * g * g;
            (*mean, *square) = (m as f32, v as f32);
            let step = rate * (m / of_mean) / ((v / of_square).sqrt() + EPSILON);
            *parameter = (f64::from(*parameter) - step) as f32;
        }
    }
}
