//! Proven lower bound of a frame.
//!
//! For any `y` and any `q` with `|q_g| <= lambda_space radius_g`, and `r = -(A' y + D' q)`,
//!
//! ```text
//! penalised:    objective >= rest^2 / 2 - y.beta - |y|^2 / 2 + q.D x^ - sum h(r)
//! constrained:  objective >= -y.beta - radius |y| + q.D x^ - sum h(r)
//! h(r) = (r - lambda_time a) (upper - x^)    where r >  lambda_time a
//!        (-r - lambda_time a) (x^ - lower)   where r < -lambda_time a,   else 0
//! ```
//!
//! with `a` the area of the unknown; `h` is infinite if there is no bound on that side. The equation
//! holds exactly, because `r` is computed from it. Duals that violate their limits are scaled down:
//! `(s y, s q, s r)` is feasible for `s <= 1 / kappa`.
//!
//! # Rounding
//! `y` and its products with the data are in `f64`. The force `f = V F y` and `D' q` may be in `f32`.
//! Both are sums of known terms, so that their rounding error is bounded by the sizes of these terms
//! (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., 3.1), and that bound is added
//! to every `|r|`.

use super::differences::{Basis, Differences};
use super::fields::Setting;
use super::frame::{Engine, Problem};
use super::lanes::{Lane, Project, each, largest, load, splat, total};
use super::proof::{Expand, FlowSteps, Seek};
use super::value::Record;
use pulp::{Simd, WithSimd};

/// Steps of the flow search, and how many of them are shifted.
const STEPS: usize = 40;
const SHIFTED: usize = 10;

/// A lower bound and the scale of its duals.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Proof {
    pub(crate) bound: f64,
    pub(crate) scale: f64,
    /// Rounding error relative to the smallest radius of the change.
    pub(crate) rounding: f64,
}

/// Computes a lower bound from the duals of the last iteration. During the flow search the limits of the
/// duals are enlarged by `share` times the target gap.
pub(crate) fn prove<T: Project>(
    engine: &mut Engine<T>,
    setting: &Setting<T>,
    problem: &Problem<'_>,
    record: &Record,
    share: f64,
) -> Proof {
    engine.set_dual(setting, problem);
    let rounding = set_force(engine, setting, problem);
    let larger = 1.0 + share * problem.target_gap;
    let weights = problem.weights;
    for &cell in &setting.places.cells {
        engine.proof.change[cell] = T::from_f64(record.change[cell]);
    }
    let how = FlowSteps {
        steps: STEPS,
        shifted: SHIFTED,
        lambda_space: larger * weights.lambda_space,
        lambda_time: larger * weights.lambda_time,
        mu: weights.lambda_space * setting.mean_radius / weights.image,
        bounded: problem.bounds.is_some(),
    };
    let (fields, start) = (&mut engine.proof, &engine.fields.flow);
    let (anchor, room) = (engine.fields.anchor.as_slice(), &engine.fields.room);
    let arch = problem.arch;
    let ratio = match &setting.basis {
        Basis::Grid(differences) => {
            arch.dispatch(Seek { setting, differences, fields, start, anchor, room, how })
        }
        Basis::Gathered(differences) => arch.dispatch(Seek {
            setting,
            differences: differences.as_ref(),
            fields,
            start,
            anchor,
            room,
            how,
        }),
    };
    // allows for the rounding of norm, division and radius
    let ratio = larger * ratio * (1.0 + 8.0 * T::EPSILON);
    let parts = Parts { ratio, rounding, problem };
    match &problem.exact.basis {
        Basis::Grid(differences) => parts.best(engine, differences),
        Basis::Gathered(differences) => parts.best(engine, differences.as_ref()),
    }
}

/// Computes the force of the data dual; returns a bound on the rounding error of it and of `D' q`.
fn set_force<T: Project>(
    engine: &mut Engine<T>,
    setting: &Setting<T>,
    problem: &Problem<'_>,
) -> f64 {
    let (rank, rows) = (setting.rank, problem.seen.rows);
    let z = &mut engine.columns[0];
    z.fill(0.0);
    if problem.seen.is_whole {
        for (k, y) in engine.dual.iter().enumerate().take(rank) {
            z[k] = problem.seen.transposed[k * (rank + 1)] * y;
        }
    } else {
        for (row, y) in problem.seen.transposed.chunks_exact(rank).zip(&engine.dual).take(rows) {
            z.iter_mut().zip(row).for_each(|(z, f)| *z += f * y);
        }
    }
    let norm = z.iter().map(|z| z * z).sum::<f64>().sqrt();
    for (out, z) in engine.ranks.iter_mut().zip(z.iter()) {
        *out = T::from_f64(*z);
    }
    let (z, out) = (&engine.ranks, &mut engine.proof.force);
    problem.arch.dispatch(Expand { setting, ranks: 0..setting.padded, z, out });
    let unit = 0.5 * T::EPSILON;
    // both factors are rounded, then summed over the ranks
    let products = (setting.padded as f64 + 3.0) * unit * 1.01;
    let [terms, sum] = setting.adjoint_terms;
    // the flow is at most twice its radius; the weights are rounded too
    let adjoint = (terms + 4.0) * unit * 1.01 * 2.0 * sum * problem.weights.lambda_space;
    // the final sum of the two
    let last = unit * (setting.longest_row * norm + sum * 2.0 * problem.weights.lambda_space);
    products * setting.longest_row * norm + adjoint + last
}

/// Terms of the bound.
struct Parts<'a> {
    ratio: f64,
    rounding: f64,
    problem: &'a Problem<'a>,
}

impl Parts<'_> {
    /// Returns the best bound over the candidate scales.
    fn best<T: Project, D: Differences<f64>>(&self, engine: &Engine<T>, differences: &D) -> Proof {
        let Self { ratio, rounding, problem } = self;
        let weights = problem.weights;
        let rows = problem.seen.rows;
        let dual = &engine.dual[..rows];
        let mut linear = -super::iterate::dot(dual, &problem.beta[..rows]);
        let mut square = super::iterate::dot(dual, dual);
        if let Some(ball) = problem.ball {
            linear -= (ball * square).sqrt();
            square = 0.0;
        }
        let (mut kappa, mut hard) = (*ratio, *ratio);
        let mut least_radius = f64::INFINITY;
        let bounded = problem.bounds.is_some();
        if bounded {
            self.for_lanes(engine, differences, |e, room, radius| {
                let radius = weights.lambda_time * radius;
                least_radius = least_radius.min(radius);
                let own = (e.abs() + rounding) / radius;
                hard = hard.max(own);
                if !(if e > 0.0 { room[0] } else { room[1] }).is_finite() {
                    kappa = kappa.max(own);
                }
            });
        } else {
            let own = problem.arch.dispatch(Hardest { parts: self, engine, differences });
            (kappa, least_radius) = (kappa.max(own[0]), own[1]);
        }
        linear += problem.arch.dispatch(Along { problem, engine, differences });
        let constant = if problem.ball.is_some() { 0.0 } else { 0.5 * problem.target.rest_squared };
        let mut best = Proof { bound: constant, scale: 0.0, rounding: rounding / least_radius };
        if !(linear > 0.0 && kappa.is_finite()) {
            return best;
        }
        let parabola = if square > 0.0 { linear / square } else { f64::INFINITY };
        for kappa in &[kappa, hard, kappa.max(1.0)][..if bounded { 3 } else { 1 }] {
            let scale = (1.0 / kappa).min(parabola);
            let mut bound = constant + scale * linear - 0.5 * scale * scale * square;
            if bounded {
                self.for_lanes(engine, differences, |e, room, radius| {
                    let over = scale * (e.abs() + rounding) - weights.lambda_time * radius;
                    let room = if e > 0.0 { -room[0] } else { room[1] };
                    if over > 0.0 && room > 0.0 && room.is_finite() {
                        bound -= over * room;
                    }
                });
            }
            if bound > best.bound {
                (best.bound, best.scale) = (bound, scale);
            }
        }
        best
    }

    /// Calls `call` for each unknown with `e = f + D' q`, the distances `lower - x^` and `upper - x^` to the
    /// bounds, and the radius.
    fn for_lanes<T: Project, D: Differences<f64>>(
        &self,
        engine: &Engine<T>,
        differences: &D,
        mut call: impl FnMut(f64, [f64; 2], f64),
    ) {
        let Self { problem, .. } = self;
        let [lower, upper] = problem.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        for &at in &problem.exact.places.blocks {
            let radius = differences.cell_radius(at);
            for (l, radius) in radius.iter().enumerate() {
                let x = problem.anchor[at + l];
                if problem.exact.inside[at + l] > 0.0 {
                    let e = engine.proof.error[at + l].to_f64();
                    call(e, [lower - x, upper - x], *radius);
                }
            }
        }
    }
}

/// Computes the largest `(|e| + rounding) / radius` of any unknown and the smallest radius, for problems
/// without bounds.
struct Hardest<'a, T: Project, D> {
    parts: &'a Parts<'a>,
    engine: &'a Engine<T>,
    differences: &'a D,
}

impl<T: Project, D: Differences<f64>> WithSimd for Hardest<'_, T, D> {
    type Output = [f64; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f64; 2] {
        let Parts { rounding, problem, .. } = self.parts;
        let time = problem.weights.lambda_time;
        let (mut most, mut least) = (splat(0.0), splat(f64::INFINITY));
        for &at in &problem.exact.places.blocks {
            let radius = self.differences.cell_radius(at);
            let inside = load(&problem.exact.inside, at);
            let error = load(&self.engine.proof.error, at);
            let own: Lane<f64> = each(|l| time * radius[l]);
            let ratio: Lane<f64> =
                each(|l| inside[l] * (error[l].to_f64().abs() + rounding) / own[l]);
            most = each(|l| if ratio[l] > most[l] { ratio[l] } else { most[l] });
            least = each(|l| {
                let is_less = inside[l] > 0.0 && own[l] < least[l];
                if is_less { own[l] } else { least[l] }
            });
        }
        [largest(&most), -largest(&each(|l| -least[l]))]
    }
}

/// Computes `q.D x^`.
struct Along<'a, T: Project, D> {
    problem: &'a Problem<'a>,
    engine: &'a Engine<T>,
    differences: &'a D,
}

impl<T: Project, D: Differences<f64>> WithSimd for Along<'_, T, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let mut sum: Lane<f64> = splat(0.0);
        let [first, second] = &self.engine.proof.flow;
        for &at in self.differences.group_blocks() {
            let [a, b] = self.differences.difference(self.problem.anchor, at);
            let (qa, qb) = (load(first, at), load(second, at));
            sum = each(|l| qa[l].to_f64() * a[l] + qb[l].to_f64() * b[l] + sum[l]);
        }
        total(&sum)
    }
}
