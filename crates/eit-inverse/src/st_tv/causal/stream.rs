//! Causal stream: all events of a running instrument, around the iterations of one frame.

mod solve;

use super::differences::Basis;
use super::fields::Setting;
use super::frame::Engine;
use super::seen::{Seen, Target};
use super::settings::{CausalDual, CausalSettings, CausalStep};
use super::value::{Coefficients, Record};
use crate::check::{check_length, check_positive, check_range};
use crate::st_tv::StTv;
use crate::st_tv::schedule::{MAP_EVERY, OUTGROWN};
use crate::st_tv::settings::Fidelity;
use crate::{Certificate, InverseError, SequenceStatus};
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
#[derive(Debug, Clone)]
pub struct CausalStream {
    solver: StTv,
    settings: CausalSettings,
    single_setting: Setting<f32>,
    double_setting: Setting<f64>,
    single: Engine<f32>,
    double: Engine<f64>,
    seen: Seen,
    target: Target,
    record: Record,
    /// `x^` over cells, and `V' x^`, in internal units.
    anchor: Vec<f64>,
    coefficients: Vec<f64>,
    beta: Vec<f64>,
    whitened: Vec<f64>,
    /// The last frame as pushed, for a change of reference; NaN in unused and masked channels.
    raw: Vec<f64>,
    image: Vec<f64>,
    /// Image of the previous frame, siemens.
    before: Vec<f64>,
    /// Norm of the data that corresponds to 1 internally; 0 before the first data.
    scale: f64,
    /// Scale of the image in internal units; 0 before the first image.
    image_scale: f64,
    /// Running mean of the innovation, iterations of the last two frames, frames since the last map.
    usual: f64,
    recent: [usize; 2],
    map_age: usize,
    pushed: usize,
    quiet_frames: usize,
}

impl CausalStream {
    /// Sets up a stream.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for settings out of range, and for a solver whose `lambda_time` is 0.
    /// Such frames are independent: use [`StTvStream`](crate::StTvStream).
    pub fn new(solver: StTv, settings: CausalSettings) -> Result<Self, InverseError> {
        settings.check()?;
        let lambda_time = solver.settings.lambda_time;
        check_positive("lambda_time of a causal stream", lambda_time)?;
        let constrained = solver.settings.fidelity != Fidelity::Penalised;
        let single_setting = Setting::new(&solver, &solver.single);
        let double_setting = Setting::new(&solver, &solver.double);
        let (rank, measurements) = (double_setting.padded, solver.measurements());
        let record = Record::new(&double_setting);
        let mut this = Self {
            single: Engine::new(&single_setting, constrained),
            double: Engine::new(&double_setting, constrained),
            seen: Seen::new(&solver.compression),
            target: Target {
                values: vec![0.0; rank],
                rest_squared: 0.0,
                rest: vec![0.0; measurements],
            },
            record,
            anchor: vec![0.0; double_setting.places.length],
            coefficients: vec![0.0; rank],
            beta: vec![0.0; rank],
            whitened: vec![0.0; measurements],
            raw: vec![f64::NAN; measurements],
            image: vec![0.0; solver.unknowns()],
            before: vec![0.0; solver.unknowns()],
            scale: 0.0,
            image_scale: 0.0,
            usual: 0.0,
            recent: [0; 2],
            map_age: MAP_EVERY,
            pushed: 0,
            quiet_frames: 0,
            single_setting,
            double_setting,
            solver,
            settings,
        };
        this.restart();
        Ok(this)
    }

    /// Discards the image. The next frame is treated as the first one, with an anchor of zero, or of the
    /// value nearest to zero within the bounds.
    pub fn restart(&mut self) {
        let [lower, upper] = self.bounds_s();
        self.image.fill(0.0_f64.clamp(lower, upper));
        self.single.clear();
        self.double.clear();
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
        let [lower, upper] = self.bounds_s();
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
            self.map_age = MAP_EVERY;
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
        let end = self.solve(start)?;
        self.report(end);
        Ok(self.step(end, start))
    }

    /// Records a dropped frame: the previous image is held.
    pub fn push_dropped(&mut self) -> CausalStep<'_> {
        let start = Instant::now();
        self.pushed += 1;
        self.before.copy_from_slice(&self.image);
        self.record.clear();
        CausalStep {
            image: &self.image,
            status: SequenceStatus::Direct,
            iterations: 0,
            // nothing was solved, so the bounds are trivial
            certificate: Certificate { primal: f64::INFINITY, lower_bound: 0.0 },
            residual: 0.0,
            quiet: false,
            in_double: false,
            seconds: start.elapsed().as_secs_f64(),
        }
    }

    /// Returns the image to which the last frame was linked, siemens, `[unknown]`.
    pub fn image_before(&self) -> &[f64] {
        &self.before
    }

    /// Returns the dual point of the last frame's lower bound; zero after a frame that needed no
    /// iteration. Allocates.
    pub fn dual(&self) -> CausalDual {
        let (one, rows) = (self.one(), self.seen.rows);
        let gradient = &self.solver.gradient;
        let dual = &self.record.dual[..rows];
        let (share, data_unit, flow_unit) = match self.ball() {
            None => (-1.0, one, self.solver.unit * one),
            Some(ball) => {
                let norm = dual.iter().map(|y| y * y).sum::<f64>().sqrt();
                let share = if ball > 0.0 { -norm / ball.sqrt() } else { 0.0 };
                let largest = self.largest_weight();
                (share, largest / self.solver.unit, largest)
            }
        };
        let mut data = vec![0.0; self.solver.measurements()];
        self.seen.spread(&self.solver.compression, dual, &self.target, share, &mut data);
        data.iter_mut().for_each(|y| *y *= data_unit);
        let mut flow = vec![0.0; gradient.rows()];
        let components = gradient.components();
        let places = self.single_setting.basis.group_places(
            gradient,
            &self.solver.single,
            &self.single_setting.places,
        );
        for (group, &place) in places.iter().enumerate() {
            let own = match &self.double_setting.basis {
                Basis::Grid(_) => None,
                Basis::Gathered(_) => Some(self.solver.double.radius[place]),
            };
            let size = own.unwrap_or_else(|| gradient.raster().map_or(1.0, |r| r.pixel_m));
            for component in 0..components {
                let q = match self.record.is_double {
                    true => self.double.proven[component][place],
                    false => f64::from(self.single.proven[component][place]),
                };
                flow[group * components + component] = self.record.scale * q * flow_unit / size;
            }
        }
        CausalDual { data, flow }
    }

    fn bounds_s(&self) -> [f64; 2] {
        [self.solver.settings.lower_s, self.solver.settings.upper_s]
    }

    /// Returns the internal unit of the data.
    fn one(&self) -> f64 {
        if self.scale > 0.0 { self.scale } else { 1.0 }
    }

    fn largest_weight(&self) -> f64 {
        let settings = &self.solver.settings;
        settings.lambda_space.max(settings.lambda_time * self.settings.time_share)
    }

    /// Returns the squared radius of the data constraint in the coordinates of the frame; `None` for
    /// penalised data.
    fn ball(&self) -> Option<f64> {
        let delta = self.delta()? / self.one();
        Some((delta * delta - self.target.rest_squared).max(0.0))
    }

    /// Returns the constraint radius of the current frame, in the unit of the data.
    fn delta(&self) -> Option<f64> {
        let Fidelity::Constrained { delta } = self.solver.settings.fidelity else { return None };
        Some(delta * (self.seen.count as f64 / self.solver.channels as f64).sqrt())
    }

    /// Transforms the data of a frame to internal units; may change the unit.
    fn take(&mut self, dv: &[f64]) -> Result<(), InverseError> {
        let compression = &self.solver.compression;
        for (i, value) in self.whitened.iter_mut().enumerate() {
            // masked values may be NaN
            *value = if self.seen.good[i] { compression.root_weights[i] * dv[i] } else { 0.0 };
        }
        let one = self.one();
        self.seen.take(compression, &self.whitened, one, &mut self.target);
        let along = self.target.values.iter().map(|t| t * t).sum::<f64>().sqrt();
        let least = self.target.rest_squared.sqrt() * one;
        if let Some(delta) = self.delta()
            // a tiny remainder is rounding error of an exact fit
            && least > delta
            && least > 1e-10 * (along * one + least)
        {
            return Err(InverseError::DeltaTooSmall { frame: self.pushed, delta, least });
        }
        let settings = &self.solver.settings;
        let noise =
            if settings.noise_std.is_some() { (self.seen.count as f64).sqrt() } else { 0.0 };
        let nearest = settings.lower_s.max(0.0).max(-settings.upper_s.min(0.0));
        let size = (along * one).max(noise).max(nearest * self.solver.unit);
        let must = "below 1e150 in units of the noise";
        check_range("norm of the data", size, size.is_finite(), must)?;
        if size > 0.0 && (self.scale == 0.0 || size > OUTGROWN * self.scale) {
            let grown = size / one;
            self.scale = size;
            self.target.values.iter_mut().for_each(|t| *t /= grown);
            self.target.rest.iter_mut().for_each(|t| *t /= grown);
            self.target.rest_squared /= grown * grown;
            self.image_scale /= grown;
            if self.ball().is_none() {
                self.single.scale_duals(1.0 / grown);
                self.double.scale_duals(1.0 / grown);
            }
            self.map_age = MAP_EVERY;
            self.set_anchor();
        }
        Ok(())
    }

    /// Computes the anchor and its coefficients from the image.
    fn set_anchor(&mut self) {
        let per_image = self.solver.unit / self.one();
        for (&cell, x) in self.double_setting.places.cells.iter().zip(&self.image) {
            self.anchor[cell] = x * per_image;
        }
        self.renew_coefficients();
        self.map_age = MAP_EVERY;
    }

    fn renew_coefficients(&mut self) {
        let (setting, change) = (&self.double_setting, self.anchor.as_slice());
        let (sums, out) = (&mut self.record.sums, &mut self.coefficients);
        self.solver.arch.dispatch(Coefficients { setting, change, sums, out });
    }
}
