//! Causal stream: all events of a running instrument, around the solution of one frame.

mod anchor;
mod data;
mod frame;
mod frames;
mod proof;
mod settings;

use super::StTv;
use super::data::{Seen, Target};
use super::lanes::{LANES, Lane};
use super::problem::{Anchor, Problem};
use super::settings::{Fidelity, StTvSettings, Weights};
use super::units::Units;
use crate::check::{check_length, check_range};
use crate::{Certificate, InverseError, SequenceStatus};
use frames::Frames;
pub use settings::{CausalDual, CausalSettings, CausalStep};
use std::slice::from_ref;
use std::time::Instant;

/// Total variation of single frames, each linked to the previously reported image, without lag.
///
/// ```text
/// penalised:    x = argmin |W^1/2 (J x - dv)|^2 / 2 + lambda_space |grad x|_{2,1}
///                          + time_share lambda_time integral |x - x^| dA
/// constrained:  the same without the first term, with |W^1/2 (J x - dv)| <= delta
/// both:         lower <= x <= upper
/// ```
///
/// `x^` is the image of the frame before, which is fixed: each frame is a small convex problem, and
/// reported images are never revised. Every push returns bounds on the optimum of its own problem,
/// which are valid wherever the iteration stopped. After set-up nothing is allocated.
///
/// * Masked channels change the rows of the data term; a new set of them costs
///   `O(measurements rank^2)` once.
/// * A dropped frame ([`push_dropped`](Self::push_dropped)), or one without a good channel, holds
///   the previous image.
/// * If [`StTvSettings::noise_std`](crate::StTvSettings::noise_std) is given, eight consecutive frames
///   of pure noise put the stream at rest: the image is zero, and nothing is computed until a frame
///   differs from the reference by more than noise.
/// * With a `lambda_time` of 0 each frame is on its own, exactly the problem of [`StTv::solve`] on that one frame: the
///   image before is only where the iteration starts, a dropped frame has the image nearest to zero within the
///   bounds, and a single frame of noise is at rest.
#[derive(Debug, Clone)]
pub struct CausalStream {
    solver: StTv,
    settings: CausalSettings,
    frames: Frames,
    seen: Seen,
    target: Target,
    /// Constraint radius of the frame in internal units.
    delta: f64,
    /// `x^` over cells, `V' x^`, and `t - F' V' x^`, in internal units.
    anchor: Vec<f64>,
    coefficients: Vec<f64>,
    beta: Vec<f64>,
    whitened: Vec<f64>,
    /// `V'` times the change of a frame.
    moved: Vec<f64>,
    sums: Vec<Lane<f64>>,
    /// The last frame as pushed, for a change of reference; NaN in unused and masked channels.
    raw: Vec<f64>,
    image: Vec<f64>,
    /// Image of the previous frame, siemens.
    before: Vec<f64>,
    /// Norm of the data that corresponds to 1 internally; 0 before the first data.
    scale: f64,
    pushed: usize,
    quiet_frames: usize,
}

impl CausalStream {
    /// Sets up a stream.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for settings out of range.
    pub fn new(solver: StTv, settings: CausalSettings) -> Result<Self, InverseError> {
        settings.check()?;
        let operators = &solver.skin.operators;
        let (rank, cells) = (operators.padded, operators.cells());
        let (measurements, zeros) = (solver.measurements(), |count: usize| vec![0.0; count]);
        let seen = Seen::new(&solver.compression);
        let target = Target::zero(&solver.compression);
        let (anchor, beta) = (zeros(cells), zeros(rank));
        let shape = problem(&solver, &settings, (&seen, &target, &0.0), (&anchor, &beta), 1.0);
        let frames = Frames::new(&shape, &solver.single);
        let mut this = Self {
            frames,
            delta: 0.0,
            coefficients: zeros(rank),
            whitened: zeros(measurements),
            moved: zeros(rank),
            sums: vec![[0.0; LANES]; rank],
            raw: vec![f64::NAN; measurements],
            image: zeros(solver.unknowns()),
            before: zeros(solver.unknowns()),
            scale: 0.0,
            pushed: 0,
            quiet_frames: 0,
            seen,
            target,
            anchor,
            beta,
            solver,
            settings,
        };
        this.restart();
        Ok(this)
    }

    /// Discards the image. The next frame is treated as the first one, with an anchor of zero, or of the
    /// value nearest to zero within the bounds.
    pub fn restart(&mut self) {
        self.image.fill(self.solver.settings.nearest_zero_s());
        self.frames.clear();
        self.set_anchor();
    }

    /// Sets the image to which the next frame is linked, siemens, `[unknown]`; it is clipped to the
    /// bounds.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`]; [`InverseError::OutOfRange`] for a value that is not finite.
    pub fn anchor(&mut self, image: &[f64]) -> Result<(), InverseError> {
        check_length("image", image.len(), self.image.len())?;
        for value in image {
            check_range("a value of the anchor, siemens", *value, value.is_finite(), "finite")?;
        }
        let [lower, upper] = self.solver.settings.bounds_s();
        for (own, x) in self.image.iter_mut().zip(image) {
            *own = x.clamp(lower, upper);
        }
        self.set_anchor();
        Ok(())
    }

    /// Changes the reference frame by `change = v_ref_new - v_ref_old`, `[measurement]`.
    ///
    /// Data pushed from now on must be relative to the new reference. If the new reference is closer to
    /// the last frame than the old one was, the previous image is reset as in
    /// [`restart`](Self::restart), since it is then part of the reference.
    ///
    /// # Errors
    /// Returns an error for a wrong length and for a value that is not finite. The stream is then
    /// unchanged.
    pub fn change_reference(&mut self, change: &[f64]) -> Result<(), InverseError> {
        check_length("change of reference", change.len(), self.solver.measurements())?;
        if let Some(measurement) = change.iter().position(|v| !v.is_finite()) {
            let value = change[measurement];
            return Err(InverseError::NonFiniteReference { measurement, value });
        }
        let (mut before, mut after) = (0.0, 0.0);
        let weights = self.solver.compression.root_weights.iter();
        for ((raw, change), weight) in self.raw.iter_mut().zip(change).zip(weights) {
            if raw.is_finite() {
                before += (weight * *raw).powi(2);
                *raw -= change;
                after += (weight * *raw).powi(2);
            }
        }
        if after < before {
            self.restart();
        }
        Ok(())
    }

    /// Reconstructs a frame of difference data `[measurement]` with its good channels (`None`: all).
    ///
    /// # Errors
    /// Returns an error for wrong lengths, a non-finite value of a good channel (the frame index counts
    /// pushes from 0), and a `delta` that no image can satisfy. The image is then unchanged.
    pub fn push(
        &mut self,
        dv: &[f64],
        good: Option<&[bool]>,
    ) -> Result<CausalStep<'_>, InverseError> {
        let start = Instant::now();
        let measurements = self.solver.measurements();
        check_length("frame", dv.len(), measurements)?;
        if let Some(good) = good {
            check_length("good", good.len(), measurements)?;
        }
        let is_good = |i: usize| good.is_none_or(|good| good[i]);
        for (measurement, &value) in dv.iter().enumerate() {
            let counts = is_good(measurement);
            if !value.is_finite() && counts {
                let frame = self.pushed;
                return Err(InverseError::NonFiniteData { frame, measurement, value });
            }
        }
        let is_new = !self.seen.fits(&self.solver.compression, is_good);
        if is_new {
            self.seen.set(&self.solver.compression, is_good);
            self.frames.renew_map();
        }
        if self.seen.count == 0 {
            return Ok(self.push_dropped());
        }
        self.take(dv)?;
        self.pushed += 1;
        for (i, (raw, dv)) in self.raw.iter_mut().zip(dv).enumerate() {
            *raw = if self.seen.good[i] { *dv } else { f64::NAN };
        }
        self.before.copy_from_slice(&self.image);
        if self.is_quiet() {
            return Ok(self.rest(start));
        }
        self.innovate();
        let one = self.one();
        let Self { solver, settings, seen, target, delta, anchor, beta, frames, .. } = self;
        let problem = problem(solver, settings, (seen, target, delta), (anchor, beta), one);
        let status = frames.solve(&problem, &solver.single, settings, start)?;
        self.report(status);
        let (record, units) = (&self.frames.record, self.units());
        let (primal, lower_bound) =
            (record.primal * units.objective, record.lower_bound * units.objective);
        Ok(CausalStep {
            status,
            iterations: record.iterations,
            residual: record.misfit[0] * units.one,
            quiet: false,
            in_double: self.frames.proof.is_double,
            ..self.step_without(Certificate { primal, lower_bound }, start)
        })
    }

    /// Records a dropped frame: the previous image is held, or is that of no data if frames are not linked.
    pub fn push_dropped(&mut self) -> CausalStep<'_> {
        let start = Instant::now();
        self.pushed += 1;
        self.before.copy_from_slice(&self.image);
        self.frames.clear_result();
        let is_linked = self.is_linked();
        if !is_linked {
            self.restart();
        }
        // a held image solves nothing, so that its bounds are trivial; without data the objective is zero
        let primal = if is_linked { f64::INFINITY } else { 0.0 };
        let step = self.step_without(Certificate { primal, lower_bound: 0.0 }, start);
        CausalStep { quiet: !is_linked, ..step }
    }

    /// Returns the image to which the last frame was linked, siemens, `[unknown]`.
    pub fn image_before(&self) -> &[f64] {
        &self.before
    }

    /// Returns the dual point of the last frame's lower bound; zero after a frame that needed no
    /// iteration. Allocates.
    pub fn dual(&self) -> CausalDual {
        let (units, proof) = (self.units(), &self.frames.proof);
        let gradient = &self.solver.gradient;
        let dual = &proof.dual[..self.seen.rows];
        let share = self.ball().map_or(-1.0, |ball| {
            let norm = dual.iter().map(|y| y * y).sum::<f64>().sqrt();
            if ball > 0.0 { -norm / ball.sqrt() } else { 0.0 }
        });
        let mut data = vec![0.0; self.solver.measurements()];
        self.seen.spread(&self.solver.compression, dual, &self.target, share, &mut data);
        data.iter_mut().for_each(|y| *y /= units.weight * self.solver.unit);
        let mut flow = vec![0.0; gradient.rows()];
        let (components, operators) = (gradient.components(), &self.solver.skin.operators);
        for (group, own) in flow.chunks_exact_mut(components).enumerate() {
            let place = operators.basis.group_place(gradient, &operators.places, group);
            let size = operators.basis.group_size(place);
            for (q, proven) in own.iter_mut().zip(&proof.flow) {
                *q = proof.scale * proven[place] / (units.weight * size);
            }
        }
        CausalDual { data, flow }
    }

    fn is_linked(&self) -> bool {
        self.solver.settings.lambda_time > 0.0
    }

    /// Returns the internal unit of the data.
    fn one(&self) -> f64 {
        if self.scale > 0.0 { self.scale } else { 1.0 }
    }

    fn units(&self) -> Units {
        Units::new(&self.solver, weights(&self.solver, &self.settings), self.one())
    }

    /// Returns the zero image of a skin at rest.
    fn rest(&mut self, start: Instant) -> CausalStep<'_> {
        self.frames.clear_result();
        if self.image.iter().any(|x| *x != 0.0) {
            self.restart();
        }
        let square = self.square();
        // the zero image is not proven optimal, but the data agrees with it to within the noise
        let primal = if self.ball().is_some() { 0.0 } else { 0.5 * square };
        let step = self.step_without(Certificate { primal, lower_bound: 0.0 }, start);
        CausalStep { residual: square.sqrt(), quiet: true, ..step }
    }

    /// Returns the result of a push without iterations.
    fn step_without(&self, certificate: Certificate, start: Instant) -> CausalStep<'_> {
        CausalStep {
            image: &self.image,
            status: SequenceStatus::Direct,
            iterations: 0,
            certificate,
            residual: 0.0,
            quiet: false,
            in_double: false,
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}

/// Returns the weights of a frame.
fn weights(solver: &StTv, settings: &CausalSettings) -> Weights {
    let StTvSettings { lambda_space, lambda_time, fidelity, .. } = solver.settings;
    Weights { lambda_space, lambda_time: lambda_time * settings.time_share, fidelity }
}

/// Returns the problem of a frame with its channels, data and radius, linked to an image with its innovation, where
/// data of norm `one` is 1.
fn problem<'a>(
    solver: &'a StTv,
    settings: &CausalSettings,
    (seen, target, delta): (&'a Seen, &'a Target, &'a f64),
    (image, beta): (&'a [f64], &'a [f64]),
    one: f64,
) -> Problem<'a> {
    let weights = weights(solver, settings);
    let units = Units::new(solver, weights, one);
    let is_penalised = weights.fidelity == Fidelity::Penalised;
    Problem {
        skin: &solver.skin,
        modes: from_ref(seen),
        mode_of: &[0],
        targets: from_ref(target),
        delta: (!is_penalised).then_some(from_ref(delta)),
        lambda_space: weights.lambda_space * units.weight,
        lambda_time: 0.0,
        anchor: Some(Anchor { lambda: weights.lambda_time * units.weight, image, beta }),
        bounds: units.bounds,
        target_gap: settings.target_gap,
    }
}
