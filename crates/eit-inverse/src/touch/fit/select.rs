//! Choice of the number of touches.

use super::{FitResult, TouchFit};
use crate::InverseError;
use crate::touch::bell::Bell;

/// A split puts two bells this many radii to either side of the old one, each with this fraction of its
/// radius and amplitude: together they look like the old one.
const SPLIT: f64 = 0.7;

impl TouchFit<'_> {
    /// Adds touches, up to `most`, as long as the data justify another one.
    ///
    /// The next touch is the next of `starts` (in order, the strongest first) or one of the fitted touches
    /// split in two along either tangent, whichever fits best. It is kept if Schwarz's criterion decreases:
    ///
    /// ```text
    /// (chi^2 before - chi^2 after) / s > (parameters of a touch) log m,   s = max(1, chi^2 after / n)
    /// ```
    ///
    /// with `m` used measurements and `n` degrees of freedom. `s` keeps model errors from being fitted with
    /// touches. The result may contain no touch at all. The second value is the best fit with one more
    /// touch, if it was rejected. Time and forward solves are the totals of all fits.
    ///
    /// Source: Schwarz, *Ann. Stat.* 6 (1978), 461-464.
    ///
    /// # Errors
    /// As [`TouchFit::fit`].
    pub fn fit_number(
        &mut self,
        frame: &[f64],
        reference_frame: &[f64],
        starts: &[Bell],
        most: usize,
    ) -> Result<(FitResult, Option<FitResult>), InverseError> {
        let data = self.problem.whitened(frame, reference_frame)?;
        let mut waiting = self.check_starts(starts)?;
        waiting.reverse();
        let mut best = self.fit_whitened(&data, &[])?;
        let [mut seconds, mut solves] = [best.seconds, best.forward_solves as f64];
        let each = self.parameters().count();
        let mut rejected = None;
        while best.touches.len() < most && data.len() > each * (best.touches.len() + 1) {
            let mut found: Option<(FitResult, bool)> = None;
            for (bells, is_start) in self.candidates(&best, waiting.last()) {
                // bells that leave no conductivity are not candidates
                let Ok(fit) = self.fit_whitened(&data, &bells) else { continue };
                seconds += fit.seconds;
                solves += fit.forward_solves as f64;
                if found.as_ref().is_none_or(|(old, _)| fit.chi_square < old.chi_square) {
                    found = Some((fit, is_start));
                }
            }
            let Some((more, is_start)) = found else { break };
            let scale = more.reduced_chi_square().max(1.0);
            let gain = (best.chi_square - more.chi_square) / scale;
            if gain <= each as f64 * (data.len() as f64).ln() {
                rejected = Some(more);
                break;
            }
            if is_start {
                waiting.pop();
            }
            best = more;
        }
        (best.seconds, best.forward_solves) = (seconds, solves as usize);
        Ok((best, rejected))
    }

    /// Lists the ways to add one bell, each with whether it uses the next start.
    fn candidates(&self, fit: &FitResult, start: Option<&Bell>) -> Vec<(Vec<Bell>, bool)> {
        let bells: Vec<Bell> = fit.touches.iter().map(|touch| touch.bell).collect();
        let mut ways = Vec::new();
        if let Some(start) = start {
            ways.push((bells.iter().chain([start]).copied().collect(), true));
        }
        for (k, bell) in bells.iter().enumerate() {
            for tangent in self.problem.place(bell.position_m).tangents {
                let half = |sign: f64| {
                    let to = std::array::from_fn(|i| {
                        bell.position_m[i] + sign * SPLIT * bell.radius_m * tangent[i]
                    });
                    let [least, largest] = self.settings.radius_range_m;
                    Bell {
                        position_m: self.problem.place(to).position_m,
                        amplitude: SPLIT * bell.amplitude,
                        radius_m: (SPLIT * bell.radius_m).clamp(least, largest),
                    }
                };
                let mut split = bells.clone();
                split[k] = half(1.0);
                split.push(half(-1.0));
                ways.push((split, false));
            }
        }
        ways
    }
}
