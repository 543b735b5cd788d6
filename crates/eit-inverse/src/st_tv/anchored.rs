//! Best bound of a frame that is linked to an anchor, whose dual takes what other duals leave.

use super::bound::{Bound, of_data};
use super::differences::Differences;
use super::flow::Flow;
use super::lanes::{Lane, Project, each, largest, load, splat, total};
use super::problem::{Anchor, Problem};

/// Bound of an anchored frame from these duals.
pub(super) struct Best<'a, T: Project, D> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) anchor: Anchor<'a>,
    pub(super) differences: &'a D,
    pub(super) flow: &'a Flow<T>,
    pub(super) dual: &'a [f64],
    pub(super) ratio: f64,
    pub(super) rounding: f64,
}

impl<T: Project, D: Differences<f64>> Best<'_, T, D> {
    /// Returns the best bound over the candidate scales.
    #[inline(always)]
    pub(super) fn bound(&self) -> Bound {
        let Self { problem, anchor, ratio, rounding, .. } = *self;
        let [constant, linear, square] = of_data(problem, self.dual);
        let linear = linear + self.along();
        let bounded = problem.bounds.is_some();
        let (mut kappa, mut hard) = (ratio, ratio);
        let [own, least_radius] = self.hardest();
        if bounded {
            hard = hard.max(own);
            self.for_lanes(|e, room, radius| {
                if !(if e > 0.0 { room[0] } else { room[1] }).is_finite() {
                    kappa = kappa.max((e.abs() + rounding) / (anchor.lambda * radius));
                }
            });
        } else {
            kappa = kappa.max(own);
        }
        let rounding = rounding / least_radius;
        let mut best = Bound { value: constant, scale: 0.0, rounding };
        if !(linear > 0.0 && kappa.is_finite()) {
            return best;
        }
        for kappa in &[kappa, hard, kappa.max(1.0)][..if bounded { 3 } else { 1 }] {
            let mut bound = Bound::scaled(constant, linear, square, 1.0 / kappa);
            if bounded {
                self.for_lanes(|e, room, radius| {
                    let over = bound.scale * (e.abs() + self.rounding) - anchor.lambda * radius;
                    let room = if e > 0.0 { -room[0] } else { room[1] };
                    if over > 0.0 && room > 0.0 && room.is_finite() {
                        bound.value -= over * room;
                    }
                });
            }
            if bound.value > best.value {
                best = Bound { rounding, ..bound };
            }
        }
        best
    }

    /// Calls `call` for each unknown with `e = f + D' q`, the distances `lower - x^` and `upper - x^` to the
    /// bounds, and the radius.
    #[inline(always)]
    fn for_lanes(&self, mut call: impl FnMut(f64, [f64; 2], f64)) {
        let [lower, upper] = self.problem.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let exact = &self.problem.skin.operators;
        for &at in &exact.places.blocks {
            let radius = self.differences.cell_radius(at);
            for (l, radius) in radius.iter().enumerate() {
                let x = self.anchor.image[at + l];
                if exact.inside[at + l] > 0.0 {
                    let e = self.flow.error[at + l].to_f64();
                    call(e, [lower - x, upper - x], *radius);
                }
            }
        }
    }

    /// Returns the largest `(|e| + rounding) / radius` of any unknown and the smallest radius.
    #[inline(always)]
    fn hardest(&self) -> [f64; 2] {
        let (mut most, mut least) = (splat(0.0), splat(f64::INFINITY));
        let exact = &self.problem.skin.operators;
        for &at in &exact.places.blocks {
            let radius = self.differences.cell_radius(at);
            let (inside, error) = (load(&exact.inside, at), load(&self.flow.error, at));
            let own: Lane<f64> = each!(|l| self.anchor.lambda * radius[l]);
            let ratio: Lane<f64> =
                each!(|l| inside[l] * (error[l].to_f64().abs() + self.rounding) / own[l]);
            most = each!(|l| if ratio[l] > most[l] { ratio[l] } else { most[l] });
            least = each!(|l| {
                let is_less = inside[l] > 0.0 && own[l] < least[l];
                if is_less { own[l] } else { least[l] }
            });
        }
        [largest(&most), -largest(&each!(|l| -least[l]))]
    }

    /// Computes `q.D x^`.
    #[inline(always)]
    fn along(&self) -> f64 {
        let mut sum: Lane<f64> = splat(0.0);
        let [first, second] = &self.flow.duals.flow;
        for &at in self.differences.group_blocks() {
            let [a, b] = self.differences.difference(self.anchor.image, at);
            let (qa, qb) = (load(first, at), load(second, at));
            sum = each!(|l| qa[l].to_f64() * a[l] + qb[l].to_f64() * b[l] + sum[l]);
        }
        total(&sum)
    }
}
