//! The fabric's memory of touches: settling after a change of load, and hysteresis where it was pressed.

use super::dictionary::Dictionary;
use super::places::{Places, Spot};
use super::rows::Rows;
use super::settings::DetectorSettings;
use super::vectors::dot;
use super::whitening::Whitening;
use crate::geometry::distance_m;

/// Memory columns whose whitened squared length is below this are ignored.
const FAINT: f64 = 1.0;

/// A touch that has moved less than this counts as still, metres, ...
const STILL_M: f64 = 3e-3;

/// ... and so does one that has moved less than this many root mean square errors of its position:
/// two positions of a resting touch differ by more once in `exp(8)` frames. Otherwise noise would
/// create trails that explain the touch away.
const STILL_ERRORS: f64 = 4.0;

/// Width of the bell relative to its radius; a sliding touch lays down its strength once per width.
const WIDTH_RADII: f64 = 1.77;

/// Touches of successive frames within this distance are the same one, metres.
const SAME_M: f64 = 0.03;

/// Speed up to which a finger may have slid from one touch to the next, metres per second: that of a fast swipe.
const FASTEST_M_PER_S: f64 = 1.0;

/// Fraction of its initial size below which a trail is discarded.
const FORGOTTEN: f64 = 1e-3;

/// Columns of the fabric's memory in volts of the model's rows, with bounds on their shares.
///
/// Settling is the signal of the touches through a low-pass filter with each time constant; after a
/// lift, a small part of it remains with the opposite sign. A trail is the largest change that a
/// press or stroke can have caused; hysteresis leaves a small part of it.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    rows: usize,
    settling: [Vec<f64>; 2],
    trails: Vec<Vec<f64>>,
    /// Length or number of presses in each trail, in widths of the bell; 0: unused.
    laid: Vec<f64>,
    current: usize,
    /// Position at which each touch was last added to a trail, and its strength.
    pressed: Vec<(Spot, f64)>,
    next: Vec<(Spot, f64)>,
    /// Whitened columns as if no row were lost and nothing free, and the memory and bounds of each.
    all: Vec<f64>,
    known: Vec<(usize, [f64; 2])>,
    /// Whitened columns that are not faint, without lost rows.
    pub(super) whitened: Vec<f64>,
    /// Bounds of their shares.
    pub(super) bounds: Vec<[f64; 2]>,
    /// Index of the memory behind each column, settling first.
    kept: Vec<usize>,
    scaled: Vec<f64>,
}

impl Memory {
    pub(super) fn new(rows: usize, settings: &DetectorSettings) -> Self {
        let trails = if settings.trail_share > 0.0 { settings.trails } else { 0 };
        let most = 2 + trails;
        Self {
            rows,
            settling: [vec![0.0; rows], vec![0.0; rows]],
            trails: vec![vec![0.0; rows]; trails],
            laid: vec![0.0; trails],
            current: 0,
            pressed: Vec::with_capacity(settings.max_touches),
            next: Vec::with_capacity(settings.max_touches),
            all: Vec::with_capacity(most * rows),
            known: Vec::with_capacity(most),
            whitened: Vec::with_capacity(most * rows),
            bounds: Vec::with_capacity(most),
            kept: Vec::with_capacity(most),
            scaled: vec![0.0; rows],
        }
    }

    pub(super) fn columns(&self) -> usize {
        self.kept.len()
    }

    /// Whitens the memory columns for the next frame.
    pub(super) fn whiten(
        &mut self,
        rows: &Rows,
        whitening: &Whitening,
        settings: &DetectorSettings,
    ) {
        self.all.clear();
        self.known.clear();
        for k in 0..2 + self.trails.len() {
            let (column, bounds) = match k {
                0 | 1 if settings.settling_share == 0.0 => continue,
                0 | 1 => (&self.settling[k], [-settings.settling_share, SETTLING_AGAINST]),
                _ if self.laid[k - 2] == 0.0 => continue,
                _ => (&self.trails[k - 2], [0.0, settings.trail_share]),
            };
            for (row, scaled) in self.scaled.iter_mut().enumerate() {
                *scaled = rows.ratio_of_row(row) * column[row];
            }
            let from = self.all.len();
            self.all.resize(from + self.rows, 0.0);
            whitening.apply(&self.scaled, &mut self.all[from..]);
            self.known.push((k, bounds));
        }
    }

    /// Maps the whitened memory columns; those that become faint are omitted.
    pub(super) fn prepare(&mut self, whitening: &Whitening) {
        self.whitened.clear();
        self.bounds.clear();
        self.kept.clear();
        for ((k, bounds), column) in self.known.iter().zip(self.all.chunks_exact(self.rows)) {
            let from = self.whitened.len();
            self.whitened.extend_from_slice(column);
            let target = &mut self.whitened[from..];
            whitening.project(target);
            if dot(target, target) > FAINT {
                self.kept.push(*k);
                self.bounds.push(*bounds);
            } else {
                self.whitened.truncate(from);
            }
        }
    }

    /// Adds the memories with the given shares, in volts of the model's rows.
    pub(super) fn add_volts(&self, shares: &[f64], out: &mut [f64]) {
        for (&k, share) in self.kept.iter().zip(shares) {
            let column = if k < 2 { &self.settling[k] } else { &self.trails[k - 2] };
            out.iter_mut().zip(column).for_each(|(out, c)| *out += share * c);
        }
    }

    /// Records the touches of a frame, each with its strength and the root mean square error of its
    /// position in metres.
    ///
    /// `touch` is their signal in volts of the model's rows; `fade` is the fraction of the trails that the
    /// reference has absorbed.
    pub(super) fn take(
        &mut self,
        touch: &[f64],
        touches: impl Iterator<Item = (Spot, f64, f64)>,
        dt_s: f64,
        fade: f64,
        (places, dictionary): (&Places, &Dictionary),
        settings: &DetectorSettings,
    ) {
        for (memory, time_s) in self.settling.iter_mut().zip(settings.settling_s) {
            let weight = -(-dt_s / time_s).exp_m1();
            memory.iter_mut().zip(touch).for_each(|(m, t)| *m += weight * (t - *m));
        }
        for (trail, laid) in self.trails.iter_mut().zip(&mut self.laid) {
            if *laid == 0.0 || fade == 0.0 {
                continue;
            }
            trail.iter_mut().for_each(|v| *v *= 1.0 - fade);
            *laid *= 1.0 - fade;
            if *laid < FORGOTTEN {
                trail.fill(0.0);
                *laid = 0.0;
            }
        }
        self.next.clear();
        let mut touches = touches.peekable();
        while let Some(touch) = touches.next() {
            if self.next.is_empty() && touches.peek().is_none() {
                self.lay_way(touch, dt_s, (places, dictionary), settings);
            }
            self.lay(touch, dictionary, settings);
        }
        std::mem::swap(&mut self.pressed, &mut self.next);
    }

    /// Adds the only touch of a frame to the trails, once per width of the straight way from the only one of the frame
    /// before, if it is too far away to be the same: a finger may have slid from there. (Of several fingers it is not
    /// known which one did.)
    fn lay_way(
        &mut self,
        (spot, strength, _): (Spot, f64, f64),
        dt_s: f64,
        (places, dictionary): (&Places, &Dictionary),
        settings: &DetectorSettings,
    ) {
        let &[(from, before)] = self.pressed.as_slice() else { return };
        let [a, b] = [from.position_m, spot.position_m];
        let length_m = distance_m(a, b);
        if !(SAME_M..FASTEST_M_PER_S * dt_s).contains(&length_m) {
            return;
        }
        // no finer than the positions, however small the bell is
        let width_m = (WIDTH_RADII * settings.radius_m).max(places.spacing_m);
        let widths = (length_m / width_m).ceil();
        for k in 1..widths as usize {
            let at = [0, 1, 2].map(|i| a[i] + k as f64 / widths * (b[i] - a[i]));
            self.add(&places.nearest(at), before.min(strength), 1.0, dictionary, settings);
        }
    }

    /// Adds one touch to a trail: its peak strength where it rests, its strength once per width
    /// that it moves.
    fn lay(
        &mut self,
        (spot, strength, error_m): (Spot, f64, f64),
        dictionary: &Dictionary,
        settings: &DetectorSettings,
    ) {
        let way = |p: &(Spot, f64)| distance_m(p.0.position_m, spot.position_m);
        let nearest = self.pressed.iter().min_by(|a, b| way(a).total_cmp(&way(b)));
        let (from, before) = match nearest {
            Some(last) if way(last) < SAME_M => *last,
            _ => (spot, 0.0),
        };
        let moved = distance_m(from.position_m, spot.position_m);
        let width_m = WIDTH_RADII * settings.radius_m;
        let (part, kept) = if moved > STILL_M.max(STILL_ERRORS * error_m) {
            ((moved / width_m).min(1.0), (spot, strength))
        } else if strength > before {
            (1.0 - before / strength, (from, strength))
        } else {
            (0.0, (from, before))
        };
        self.next.push(kept);
        if part > 0.0 {
            self.add(&spot, strength, part, dictionary, settings);
        }
    }

    /// Adds a part of a touch to the current trail, or begins another one.
    fn add(
        &mut self,
        spot: &Spot,
        strength: f64,
        part: f64,
        dictionary: &Dictionary,
        settings: &DetectorSettings,
    ) {
        if self.trails.is_empty() {
            return;
        }
        if self.laid[self.current] >= settings.trail_widths && self.trails.len() > 1 {
            self.rotate();
        }
        let trail = &mut self.trails[self.current];
        dictionary.add_volts(spot, strength * part, trail);
        self.laid[self.current] += part;
    }

    /// Merges the oldest trail into the next oldest and reuses its slot for a new one.
    fn rotate(&mut self) {
        let count = self.trails.len();
        let next = (self.current + 1) % count;
        let oldest = std::mem::take(&mut self.trails[next]);
        if self.laid[next] > 0.0 {
            let heir = (next + 1) % count;
            self.trails[heir].iter_mut().zip(&oldest).for_each(|(h, o)| *h += o);
            self.laid[heir] += self.laid[next];
        }
        self.trails[next] = oldest;
        self.trails[next].fill(0.0);
        self.laid[next] = 0.0;
        self.current = next;
    }
}

/// Largest share of settling with the same sign as the touch.
const SETTLING_AGAINST: f64 = 0.02;
