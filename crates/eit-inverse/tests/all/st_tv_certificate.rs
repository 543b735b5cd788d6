//! Primal values and lower bounds against certified optima and an interior-point solver.

use crate::common::{grid, uniforms};
use crate::problem::{Problem, gap, reference};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
    SupportedConeT, ZeroConeT,
};
use eit_inverse::{
    Certificate, Gradient, ImageSequence, SequenceReport, SequenceStatus, StTv, StTvSettings, Stop,
};
use fixtures::Random;
use fixtures::st_tv::StTvProblem;
use ndarray::{Array2, Axis};
use proptest::{option, prelude::*};
use std::time::Duration;

/// Accuracy of the interior-point solver, which may stop at residuals of 1e-8; the error of the objective is that
/// times the norm of the multipliers, up to about 100 for these problems.
const INTERIOR_POINT: f64 = 1e-6;

/// Largest unknown of a trusted interior-point solution. Its residuals are relative to the unknowns: one that
/// had reached 2.6e4 (one measurement with a sensitivity of 1e-5) stopped as solved 0.28 above an optimum of 0.
const LARGEST: f64 = 1e3;

/// `A x + s = b` with `s` in cones, row by row.
#[derive(Default)]
struct Rows {
    entries: (Vec<usize>, Vec<usize>, Vec<f64>),
    right: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Rows {
    /// `s = b - sum value x_column`.
    fn push(&mut self, b: f64, row: impl IntoIterator<Item = (usize, f64)>) {
        for (column, value) in row {
            self.entries.0.push(self.right.len());
            self.entries.1.push(column);
            self.entries.2.push(value);
        }
        self.right.push(b);
    }
}

/// Computes the optimum by an interior-point method, as a second-order cone program:
///
/// ```text
/// min  sum_t |z_t|^2 / 2 + lambda_space sum s_tg + lambda_time sum area_p r_tp
/// z_t = W^1/2 (J x_t - dv_t),   |D_g x_t| <= s_tg,   |x_{t+1} - x_t| <= r_t,   bounds
/// ```
///
/// with `|z_t| <= delta_t` instead of its square for constrained data. Returns `None` if the method fails
/// because of rounding, about once in a hundred problems, or its result cannot be trusted.
fn optimum(problem: &Problem) -> Option<f64> {
    let Problem { jacobian, gradient, settings, .. } = problem;
    let (frames, n, groups) = (problem.frames(), gradient.unknowns(), gradient.groups());
    let m = jacobian.nrows();
    let links = if settings.lambda_time > 0.0 { frames - 1 } else { 0 };
    let x = |t: usize, p: usize| t * n + p;
    let z = |t: usize, i: usize| frames * n + t * m + i;
    let s = |t: usize, g: usize| frames * (n + m) + t * groups + g;
    let r = |t: usize, p: usize| frames * (n + m + groups) + t * n + p;
    let unknowns = frames * (n + m + groups) + links * n;

    let mut rows = Rows::default();
    for t in 0..frames {
        let (data, weights) = (problem.whitened(t), problem.root_weights(t));
        for i in 0..m {
            let explained = (0..n).map(|p| (x(t, p), -weights[i] * jacobian[(i, p)]));
            rows.push(-data[i], explained.chain([(z(t, i), 1.0)]));
        }
    }
    rows.cones.push(ZeroConeT(frames * m));
    let before = rows.right.len();
    for (t, p) in (0..links).flat_map(|t| (0..n).map(move |p| (t, p))) {
        for sign in [1.0, -1.0] {
            rows.push(0.0, [(r(t, p), -1.0), (x(t + 1, p), sign), (x(t, p), -sign)]);
        }
    }
    for at in 0..frames * n {
        if settings.lower_s.is_finite() {
            rows.push(-settings.lower_s, [(at, -1.0)]);
        }
        if settings.upper_s.is_finite() {
            rows.push(settings.upper_s, [(at, 1.0)]);
        }
    }
    if rows.right.len() > before {
        rows.cones.push(NonnegativeConeT(rows.right.len() - before));
    }
    let components = gradient.components();
    for t in 0..frames {
        for g in 0..groups {
            rows.push(0.0, [(s(t, g), -1.0)]);
            for row in g * components..(g + 1) * components {
                let (columns, values) = gradient.row(row);
                rows.push(0.0, columns.iter().zip(values).map(|(&p, v)| (x(t, p as usize), -v)));
            }
            rows.cones.push(SecondOrderConeT(components + 1));
        }
        if let Some(delta) = problem.radius(t) {
            rows.push(delta, []);
            (0..m).for_each(|i| rows.push(0.0, [(z(t, i), -1.0)]));
            rows.cones.push(SecondOrderConeT(m + 1));
        }
    }

    let mut linear = vec![0.0; unknowns];
    linear[s(0, 0)..s(frames, 0)].fill(settings.lambda_space);
    let areas = gradient.areas_m2().iter().cycle();
    for (linear, area) in linear[r(0, 0)..].iter_mut().zip(areas) {
        *linear = settings.lambda_time * area;
    }
    let squared = if problem.radius(0).is_some() { 0 } else { frames * m };
    let (diagonal, ones) = (Vec::from_iter(z(0, 0)..z(0, squared)), vec![1.0; squared]);
    let square = CscMatrix::new_from_triplets(unknowns, unknowns, diagonal.clone(), diagonal, ones);
    let (is, js, values) = rows.entries;
    let matrix = CscMatrix::new_from_triplets(rows.right.len(), unknowns, is, js, values);
    // the tightest tolerance that succeeds
    [1e-12, 1e-10, 1e-8].into_iter().find_map(|accuracy| {
        let how = DefaultSettings {
            verbose: false,
            tol_gap_abs: accuracy,
            tol_gap_rel: accuracy,
            tol_feas: accuracy,
            reduced_tol_gap_abs: 1e-8,
            reduced_tol_gap_rel: 1e-8,
            reduced_tol_feas: 1e-8,
            ..Default::default()
        };
        let (right, cones) = (&rows.right, &rows.cones);
        let mut solver = DefaultSolver::new(&square, &linear, &matrix, right, cones, how).unwrap();
        solver.solve();
        let solution = &solver.solution;
        let solved = matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        let largest = solution.x.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        (solved && largest < LARGEST).then_some(solution.obj_val)
    })
}

/// Basis of a skin with 1 to 36 unknowns.
#[derive(Debug, Clone, Copy)]
enum Basis {
    /// Pixels that are inside with this probability, which gives holes and separate parts.
    Pixels(f64),
    Nodes,
    Elements,
}

/// Parameters of a random problem.
#[derive(Debug, Clone)]
struct Recipe {
    basis: Basis,
    /// Side, measurements, frames.
    sizes: [usize; 3],
    /// Weights in space and in time.
    lambda: [f64; 2],
    bounds: [f64; 2],
    /// Ratio of the largest noise to the smallest; `None`: no `noise_std`.
    noise: Option<f64>,
    /// Noise in the data, in standard deviations.
    noise_level: f64,
    masked: f64,
    /// Radius relative to that of an image known to be feasible; `None`: penalised.
    radius: Option<f64>,
    seed: u64,
}

fn recipes() -> impl Strategy<Value = Recipe> {
    let basis = prop_oneof![
        (0.4..1.0_f64).prop_map(Basis::Pixels),
        Just(Basis::Nodes),
        Just(Basis::Elements)
    ];
    let decades = |range: std::ops::Range<f64>| range.prop_map(|e| 10_f64.powf(e));
    let infinite = f64::INFINITY;
    let bounds = prop_oneof![
        Just([-infinite, infinite]),
        Just([0.0, infinite]),
        Just([-infinite, 0.0]),
        Just([-0.3, 0.8]),
        // bounds that exclude zero
        Just([0.2, infinite]),
        Just([-1.0, -0.1]),
    ];
    let lambda_time = prop_oneof![Just(0.0), decades(-3.0..1.0)];
    let (noise, noise_level) = (option::of(1.0..30.0_f64), prop_oneof![Just(0.0), Just(0.3)]);
    let (masked, radius) = (prop_oneof![Just(0.0), 0.0..0.5_f64], option::of(1.001..3.0_f64));
    let sizes = (1_usize..7, 1_usize..13, 1_usize..6);
    let lambda = (decades(-3.0..1.0), lambda_time);
    (basis, sizes, lambda, bounds, noise, noise_level, masked, radius, any::<u64>()).prop_map(
        |(basis, sizes, lambda, bounds, noise, noise_level, masked, radius, seed)| {
            let (sizes, lambda) = (sizes.into(), lambda.into());
            Recipe { basis, sizes, lambda, bounds, noise, noise_level, masked, radius, seed }
        },
    )
}

fn gradient(basis: Basis, side: usize, random: &mut Random) -> Gradient {
    let cells = side.div_ceil(2);
    // cells of about 1 m, on a curved surface
    let surface = || {
        let shifts = uniforms(&mut Random::new(side as u64), (cells + 1).pow(2), -0.5);
        grid(cells, |i, j| {
            let shift = 0.5 * shifts[j * (cells + 1) + i];
            [i as f64 + shift, j as f64 - 0.5 * shift, (0.4 * i as f64).sin()]
        })
    };
    match basis {
        Basis::Pixels(inside) => {
            let shape = (side, 1 + (side * 5) % 6);
            let mut mask = Array2::from_shape_simple_fn(shape, || random.uniform() < inside);
            mask[(0, 0)] = true;
            Gradient::pixels(&mask, 1.0).unwrap()
        }
        Basis::Nodes => Gradient::nodal(&surface()).unwrap(),
        Basis::Elements => Gradient::elements(&surface()).unwrap(),
    }
}

impl Recipe {
    fn problem(&self) -> Problem {
        let mut random = Random::new(self.seed);
        let [side, measurements, frames] = self.sizes;
        let gradient = gradient(self.basis, side, &mut random);
        let n = gradient.unknowns();
        let jacobian = random.normals(measurements, n) / (measurements as f64).sqrt();
        let mut noise = |ratio: f64| 0.2 * ratio.powf(random.uniform());
        let noise_std: Option<Vec<f64>> =
            self.noise.map(|ratio| (0..measurements).map(|_| noise(ratio)).collect());
        let [lower_s, upper_s] = self.bounds;
        // some unknowns keep their value from frame to frame, some equal the first value
        let mut truth = Array2::zeros((frames, n));
        let first = random.normal();
        for (t, p) in (0..frames).flat_map(|t| (0..n).map(move |p| (t, p))) {
            truth[(t, p)] = match random.uniform() {
                u if u < 0.4 && t > 0 => truth[(t - 1, p)],
                u if u < 0.7 => first,
                _ => random.normal(),
            };
        }
        truth.mapv_inplace(|x| x.clamp(lower_s, upper_s));
        let mut values = truth.dot(&jacobian.t());
        for ((_, i), value) in values.indexed_iter_mut() {
            let std = noise_std.as_ref().map_or(1.0, |std| std[i]);
            *value += self.noise_level * std * random.normal();
        }
        let shape = values.dim();
        let good = (self.masked > 0.0)
            .then(|| Array2::from_shape_simple_fn(shape, || random.uniform() >= self.masked));
        if let Some(good) = &good {
            // masked values are never read
            values.zip_mut_with(good, |value, good| *value = if *good { *value } else { f64::NAN });
        }
        let settings = StTvSettings { lower_s, upper_s, noise_std, ..Default::default() };
        let mut problem = Problem { jacobian, gradient, settings, values, good };
        if let Some(factor) = self.radius {
            // chosen so that the true image is feasible
            let unit = problem.clone().constrained(1.0);
            let residuals = unit.residuals(&truth).into_iter().enumerate();
            // a frame without channels has the radius 0, and its share is no number
            let shares = residuals.map(|(t, residual)| residual / unit.radius(t).unwrap());
            let least = shares.fold(0.0, f64::max);
            let size = (2.0 * problem.size() / frames as f64).sqrt();
            problem = problem.constrained(factor * least.max(0.02 * size));
        }
        problem.with_weights(self.lambda[0], self.lambda[1])
    }
}

/// Checks that the interior-point optimum lies between the bounds of a result.
fn holds_the_optimum(sequence: &ImageSequence, optimum: f64) {
    let certificate = sequence.report.certificate.unwrap();
    // an optimum of 0 is known to the absolute accuracy of the interior-point solver
    let slack = INTERIOR_POINT * optimum.abs() + 1e-8;
    assert!(certificate.lower_bound <= optimum + slack, "above {optimum:e}: {certificate:?}");
    assert!(certificate.primal >= optimum - slack, "below {optimum:e}: {certificate:?}");
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// For any problem, wherever the solver stops.
    #[test]
    fn the_optimum_always_lies_between_the_bounds(
        recipe in recipes(),
        gap in (-5.0..-1.5_f64).prop_map(|e| 10_f64.powf(e)),
        cap in 0_usize..200,
    ) {
        let problem = recipe.problem();
        let optimum = optimum(&problem).ok_or_else(|| TestCaseError::reject("no reference"))?;
        for stop in [
            Stop { target_gap: gap, max_iterations: 4000, ..Default::default() },
            Stop { target_gap: 1e-12, max_iterations: cap, ..Default::default() },
        ] {
            let sequence = problem.solve(&stop);
            problem.check(&sequence, &stop);
            holds_the_optimum(&sequence, optimum);
        }
    }

    /// For realistic weights, noise and masks, the default settings converge.
    #[test]
    fn the_asked_gap_is_reached_on_any_basis_with_any_bounds(
        recipe in recipes(),
        (space, time) in (0.03..1.0_f64, 0.1..10.0_f64),
        gap in 1e-3..1e-1_f64,
    ) {
        let [side, measurements, frames] = recipe.sizes;
        let recipe = Recipe {
            lambda: [space, if recipe.lambda[1] > 0.0 { space * time } else { 0.0 }],
            noise: recipe.noise.map(|ratio| ratio.min(4.0)),
            noise_level: 0.3,
            sizes: [side, measurements.max(6), frames],
            masked: 0.4 * recipe.masked,
            radius: recipe.radius.map(|factor| factor.max(1.05)),
            ..recipe
        };
        let problem = recipe.problem();
        let optimum = optimum(&problem).ok_or_else(|| TestCaseError::reject("no reference"))?;
        let sequence = problem.solve(&self::gap(gap));
        holds_the_optimum(&sequence, optimum);
        // an optimum of zero has no relative gap
        let certificate = sequence.report.certificate.unwrap();
        let nothing = optimum < 1e-8 && certificate.primal < 1e-5 * problem.size().max(1.0);
        let converged = sequence.report.status == SequenceStatus::Converged;
        prop_assert!(converged || nothing, "optimum {:e}; {:?}", optimum, sequence.report);
    }
}

/// Constrained problems of which little is left to image: their images have far to go under small forces.
#[test]
fn images_with_far_to_go_are_certified() {
    let pixels = Basis::Pixels(0.9793078025824272);
    let (both, negative) = ([-0.3, 0.8], [-f64::INFINITY, 0.0]);
    let drawn = [
        [0.43420402607050845, 1.6322003254073072, 0.0, 2.830603604203395],
        [0.2559255847447009, 1.6448039120925528, 0.1110706422564825, 1.6407603107682598],
        [0.8247252565001257, 0.0, 0.18268998063394892, 1.896880293282835],
    ];
    for ((target_gap, basis, sizes, bounds, noise, seed), [space, time, masked, radius]) in [
        (5e-2, pixels, [2, 9, 5], both, Some(4.0), 551574727839645778),
        (7e-2, Basis::Nodes, [6, 6, 5], both, None, 10593747594888443713),
        (2e-2, Basis::Nodes, [6, 6, 3], negative, Some(4.0), 10930720304832433383),
    ]
    .into_iter()
    .zip(drawn)
    {
        let (noise_level, lambda, radius) = (0.3, [space, time], Some(radius));
        let recipe =
            Recipe { basis, sizes, lambda, bounds, noise, noise_level, masked, radius, seed };
        let problem = recipe.problem();
        let sequence = problem.converged(&Stop { max_iterations: 6000, ..gap(target_gap) });
        holds_the_optimum(&sequence, optimum(&problem).unwrap());
    }
}

/// Solves a reference problem and checks the result, whose bounds are consistent with the known optimum.
fn solved(known: &StTvProblem, problem: &Problem, solver: &StTv, stop: &Stop) -> SequenceReport {
    let sequence = solver.solve(&problem.differences(), stop).unwrap();
    problem.check(&sequence, stop);
    let certificate = sequence.report.certificate.unwrap();
    assert!(certificate.lower_bound <= known.objective, "{certificate:?}");
    assert!(certificate.primal >= known.lower_bound, "{certificate:?}");
    sequence.report
}

#[test]
fn the_references_are_certified_within_500_iterations() {
    for (pixels, gaps, most) in [(32, &[1e-1, 1e-2, 1e-3, 1e-4][..], 350), (64, &[1e-3], 500)] {
        let Some((known, problem)) = reference(pixels) else { return };
        // the same sums in another order
        let off = problem.objective(&known.images) / known.objective - 1.0;
        assert!(off.abs() < 1e-10, "{off:e}");
        let solver = problem.solver().unwrap();
        // half of the measurements, by reciprocity
        assert_eq!(solver.rank(), 104);
        for &target_gap in gaps {
            let report = solved(&known, &problem, &solver, &gap(target_gap));
            assert_eq!(report.status, SequenceStatus::Converged);
            // the objective of the smaller reference is known to 1.1e-6
            let excess = report.certificate.unwrap().primal / known.objective - 1.0;
            assert!(excess <= target_gap + 1.2e-6, "{excess:e}");
            let iterations = report.iterations;
            assert!(target_gap < 1e-3 || iterations <= most, "{pixels}: {iterations} iterations");
        }
    }
}

#[test]
fn a_cap_is_kept_and_its_result_certified() {
    let Some((known, problem)) = reference(32) else { return };
    let solver = problem.solver().unwrap();
    let mut last = f64::INFINITY;
    for max_iterations in [0, 1, 2, 3, 5, 8, 13, 50, 100, 200] {
        let stop = Stop { max_iterations, ..gap(1e-9) };
        let report = solved(&known, &problem, &solver, &stop);
        assert_eq!(report.status, SequenceStatus::IterationCap);
        // limits are checked every 4 iterations, plus one iteration each for image and bound
        assert!(report.iterations <= max_iterations.max(6), "{}", report.iterations);
        let primal = report.certificate.unwrap().primal;
        // with over-relaxation the objective need not decrease at every evaluation
        assert!(primal <= 1.05 * last, "{primal:e} after {last:e}");
        last = primal;
    }
    assert!(last < 1.05 * known.objective, "{last:e} after 200 iterations");
}

#[test]
fn a_deadline_returns_the_best_so_far_with_its_certificate() {
    let Some((known, problem)) = reference(32) else { return };
    let solver = problem.solver().unwrap();
    for milliseconds in [0, 1, 20] {
        let deadline = Some(Duration::from_millis(milliseconds));
        // 1e-9 takes minutes
        let stop = Stop { target_gap: 1e-9, max_iterations: usize::MAX, deadline };
        let report = solved(&known, &problem, &solver, &stop);
        assert_eq!(report.status, SequenceStatus::Deadline);
        assert!(report.seconds >= 1e-3 * milliseconds as f64);
    }
    // a distant deadline has no effect
    let stop = Stop { deadline: Some(Duration::from_secs(36_000)), ..Default::default() };
    assert_eq!(solved(&known, &problem, &solver, &stop).status, SequenceStatus::Converged);
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let Some((_, problem)) = reference(32) else { return };
    // in f32 and in f64
    for target_gap in [1e-3, 1e-6] {
        let stop = Stop { max_iterations: 300, ..gap(target_gap) };
        let bytes = || {
            let ImageSequence { images, report, .. } = problem.solve(&stop);
            let Certificate { primal, lower_bound, .. } = report.certificate.unwrap();
            let values = images.iter().chain(&report.residual).chain([&primal, &lower_bound]);
            (values.map(|v| v.to_bits()).collect::<Vec<_>>(), report.iterations)
        };
        // including set-up
        assert_eq!(bytes(), bytes());
    }
}

#[test]
fn one_constrained_frame_of_the_reference_agrees_with_an_interior_point_solver() {
    let Some((known, mut problem)) = reference(32) else { return };
    problem.values = problem.values.select(Axis(0), &[7]);
    let channels = problem.values.ncols();
    let noise_std = known.noise_norm / ((20 * channels) as f64).sqrt();
    problem.settings.noise_std = Some(vec![noise_std; channels]);
    // expected norm of the noise, times 1.1 so that images within the bounds are feasible
    let mut problem = problem.constrained(1.1 * (channels as f64).sqrt()).with_weights(1.0, 0.0);
    // the finite bound is active: without it, images reach lower values
    for lower_s in [f64::NEG_INFINITY, -0.15] {
        problem.settings.lower_s = lower_s;
        let optimum = optimum(&problem).unwrap();
        for target_gap in [1e-2, 1e-3] {
            holds_the_optimum(&problem.converged(&gap(target_gap)), optimum);
        }
    }
}
