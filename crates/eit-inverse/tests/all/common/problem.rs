//! Small sequence problems with an explicit evaluation of their objective.

use eit_inverse::{
    DifferenceFrames, Fidelity, Gradient, ImageSequence, InverseError, SequenceStatus, StTv,
    StTvSettings, Stop,
};
use fixtures::st_tv::StTvProblem;
use ndarray::{Array1, Array2, ArrayView1, Axis, aview1};

/// A rectangle of pixels of 1 m.
pub fn square(rows: usize, columns: usize) -> Gradient {
    Gradient::pixels(&Array2::from_elem((rows, columns), true), 1.0).unwrap()
}

pub fn gap(target_gap: f64) -> Stop {
    Stop { target_gap, ..Default::default() }
}

/// The reference problem of so many pixels a side and what is known of it.
pub fn reference(pixels: usize) -> Option<(StTvProblem, Problem)> {
    let reference = fixtures::st_tv::load(pixels).unwrap()?;
    let gradient = Gradient::pixels(&reference.mask, 1.0).unwrap();
    let problem = Problem::new(reference.jacobian.clone(), gradient, reference.values.clone())
        .with_weights(reference.lambda, reference.lambda);
    Some((reference, problem))
}

/// Complete input of a solve.
#[derive(Debug, Clone)]
pub struct Problem {
    /// `[measurement, unknown]`.
    pub jacobian: Array2<f64>,
    pub gradient: Gradient,
    pub settings: StTvSettings,
    /// `[frame, measurement]`.
    pub values: Array2<f64>,
    /// `[frame, measurement]`.
    pub good: Option<Array2<bool>>,
}

impl Problem {
    pub fn new(jacobian: Array2<f64>, gradient: Gradient, values: Array2<f64>) -> Self {
        Self { jacobian, gradient, settings: StTvSettings::default(), values, good: None }
    }

    pub fn with_weights(mut self, lambda_space: f64, lambda_time: f64) -> Self {
        (self.settings.lambda_space, self.settings.lambda_time) = (lambda_space, lambda_time);
        self
    }

    pub fn within(mut self, bounds: [f64; 2]) -> Self {
        [self.settings.lower_s, self.settings.upper_s] = bounds;
        self
    }

    pub fn constrained(mut self, delta: f64) -> Self {
        self.settings.fidelity = Fidelity::Constrained { delta };
        self
    }

    /// Makes this the only frame.
    pub fn set(&mut self, values: &[f64], good: &[bool]) {
        self.values = aview1(values).insert_axis(Axis(0)).to_owned();
        self.good = Some(aview1(good).insert_axis(Axis(0)).to_owned());
    }

    pub fn differences(&self) -> DifferenceFrames<'_> {
        let good = self.good.as_ref().map(|good| good.view());
        DifferenceFrames { values: self.values.view(), good }
    }

    pub fn solver(&self) -> Result<StTv, InverseError> {
        StTv::new(&self.jacobian, &self.gradient, self.settings.clone())
    }

    pub fn try_solve(&self, stop: &Stop) -> Result<ImageSequence, InverseError> {
        self.solver()?.solve(&self.differences(), stop)
    }

    pub fn solve(&self, stop: &Stop) -> ImageSequence {
        self.try_solve(stop).unwrap()
    }

    /// The result of a solve that reaches its gap.
    pub fn converged(&self, stop: &Stop) -> ImageSequence {
        let sequence = self.solve(stop);
        self.check(&sequence, stop);
        assert_eq!(sequence.report.status, SequenceStatus::Converged, "{:?}", sequence.report);
        sequence
    }

    pub fn frames(&self) -> usize {
        self.values.nrows()
    }

    /// `W^1/2` of the channels of a frame; 0 if unused or masked.
    pub fn root_weights(&self, frame: usize) -> Array1<f64> {
        let used = |i: usize| self.settings.used.as_ref().is_none_or(|used| used[i]);
        let good = |i: usize| self.good.as_ref().is_none_or(|good| good[(frame, i)]);
        let noise = |i: usize| self.settings.noise_std.as_ref().map_or(1.0, |std| std[i]);
        let weight = |i: usize| if used(i) && good(i) { 1.0 / noise(i) } else { 0.0 };
        Array1::from_shape_fn(self.values.ncols(), weight)
    }

    /// `W^1/2 dv` of a frame, 0 in unused and masked channels.
    pub fn whitened(&self, frame: usize) -> Array1<f64> {
        let mut data = self.root_weights(frame);
        // masked values may be NaN
        data.zip_mut_with(&self.values.row(frame), |w, v| *w *= if *w > 0.0 { *v } else { 0.0 });
        data
    }

    /// `delta` of a frame: `delta` times the root of the fraction of its good channels.
    pub fn radius(&self, frame: usize) -> Option<f64> {
        let Fidelity::Constrained { delta } = self.settings.fidelity else { return None };
        let good = self.root_weights(frame).iter().filter(|weight| **weight > 0.0).count();
        let used = self.settings.used.as_ref();
        let used = used.map_or(self.values.ncols(), |used| used.iter().filter(|u| **u).count());
        Some(delta * (good as f64 / used as f64).sqrt())
    }

    /// `|W^1/2 (J x_t - dv_t)|` of each frame.
    pub fn residuals(&self, images: &Array2<f64>) -> Vec<f64> {
        let one = |frame: usize| {
            let explained = self.jacobian.dot(&images.row(frame)) * self.root_weights(frame);
            (explained - self.whitened(frame)).pow2().sum().sqrt()
        };
        (0..self.frames()).map(one).collect()
    }

    /// The objective of a sequence within the bounds.
    pub fn objective(&self, images: &Array2<f64>) -> f64 {
        let StTvSettings { lambda_space, lambda_time, fidelity, .. } = self.settings;
        let data: f64 = match fidelity {
            Fidelity::Constrained { .. } => 0.0,
            _ => self.residuals(images).iter().map(|r| 0.5 * r * r).sum(),
        };
        let of = |x: ArrayView1<'_, f64>| self.gradient.total_variation(&x.to_vec()).unwrap();
        let space: f64 = images.outer_iter().map(of).sum();
        let changes = &images.slice_axis(Axis(0), (1..).into())
            - &images.slice_axis(Axis(0), (..self.frames() - 1).into());
        let time = changes.abs().dot(&aview1(self.gradient.areas_m2())).sum();
        data + lambda_space * space + lambda_time * time
    }

    /// Half the squared whitened data: the penalised objective of zero, and the scale of rounding errors.
    pub fn size(&self) -> f64 {
        (0..self.frames()).map(|t| 0.5 * self.whitened(t).pow2().sum()).sum()
    }

    /// Rounding error of the objective of a sequence, from residuals, which are differences of values as
    /// large as the data, and from differences of nearly equal image values.
    pub fn rounding(&self, images: &Array2<f64>) -> f64 {
        let StTvSettings { lambda_space, lambda_time, fidelity, .. } = self.settings;
        let data = match fidelity {
            Fidelity::Constrained { .. } => 0.0,
            _ => self.size(),
        };
        let mut weights = 2.0 * lambda_time * &aview1(self.gradient.areas_m2());
        for row in 0..self.gradient.rows() {
            let (columns, values) = self.gradient.row(row);
            let entries = columns.iter().zip(values);
            entries.for_each(|(&p, v)| weights[p as usize] += lambda_space * v.abs());
        }
        1e-13 * data + 1e-15 * images.abs().dot(&weights).sum()
    }

    /// Checks the properties of every result: images exactly within bounds, report and objective equal to
    /// those computed here, and a gap that is not negative and, if the status says so, within the target.
    pub fn check(&self, sequence: &ImageSequence, stop: &Stop) {
        let ImageSequence { images, report, .. } = sequence;
        let bounds = self.settings.lower_s..=self.settings.upper_s;
        assert!(images.iter().all(|x| x.is_finite() && bounds.contains(x)), "bounds");
        let certificate = report.certificate.unwrap();
        let is_converged = report.status == SequenceStatus::Converged;
        if certificate.primal == f64::INFINITY {
            // no feasible image was found in time, which can only happen with constraints
            assert!(!is_converged && self.radius(0).is_some(), "{report:?}");
            return;
        }
        let (found, wanted) = (certificate.primal, self.objective(images));
        // rounding of sums, and of residuals as differences of values as large as the data
        let floor = self.rounding(images);
        let off = (found - wanted).abs();
        assert!(off <= 1e-9 * wanted + floor, "primal value {found:e}, images have {wanted:e}");
        let root = (2.0 * self.size()).sqrt();
        for (t, (found, wanted)) in report.residual.iter().zip(self.residuals(images)).enumerate() {
            // a difference of squares of up to 26 terms: the root of their rounding error
            let off = (found - wanted).abs();
            assert!(off <= 1e-9 * wanted + 1e-7 * root, "frame {t}: {found:e}, not {wanted:e}");
            if let Some(delta) = self.radius(t) {
                let is_met = wanted <= delta * (1.0 + 1e-8) + 1e-13 * root;
                assert!(is_met, "frame {t}: {wanted:e} above {delta:e}");
            }
        }
        // a residual up to 1e-9 above its delta counts as feasible; this lowers the objective by that times
        // the multiplier times delta, which is at most a few times the objective
        let slack = if self.radius(0).is_some() { 1e-8 } else { 1e-12 };
        let highest = certificate.primal * (1.0 + slack) + floor;
        assert!(certificate.lower_bound <= highest, "bounds cross: {certificate:?}");
        assert!(!is_converged || certificate.relative_gap() <= stop.target_gap, "{certificate:?}");
    }
}
