//! Gains of electrodes: a contact that gets better or worse is not a touch.

use super::DetectorModel;
use super::joint::remove_all;
use super::rows::Rows;
use super::search::Search;
use super::step::MOST_PER_ROW;
use super::vectors::dot;
use super::whitening::Whitening;

/// Largest fraction of the residual that one electrode's gain may leave for the electrode to be
/// reported: of a frame without touches, of what touches leave, and of the frame without its
/// touches. On three fresh seeds of ten scripts with sound electrodes the best gain left at least
/// 0.18 of the first and 0.33 of the second.
const BLAME: [f64; 3] = [0.13, 0.2, 0.1];

/// Largest part of the residual of a frame without touches, and of what noise leaves, that a gain
/// may leave to explain the frame, so that a drift that begins as a finger lands is found before
/// the finger hides it. One of 1 % a second left 0.21 and 0.26, 2.1 and 1.8 in its first two
/// frames; in 50 recordings with sound electrodes none was named.
const EXPLAINED_BY: [f64; 2] = [0.35, 3.0];

/// Residual chi^2 per row above which such frames are checked; noise leaves up to 0.7.
const EXPLAINED_FROM: f64 = 3.0;

/// Minimum fraction of the frame that remains after the fabric's memory: what remains of a large
/// settling, as after a slide to the rim, is the memory model's own error. A sound electrode was
/// named where it left 0.10.
const LEFT_BY_MEMORY: f64 = 0.2;

/// Largest fraction that a gain may leave of the residual of an earlier frame's touches in an
/// unexplained frame. A step of 1 to 2.5 % under a finger leaves 0.001 to 0.02.
const BESIDE_KNOWN: f64 = 0.1;

/// Residual chi^2 per row above which electrodes are checked.
pub(super) const BLAME_FROM: f64 = 5.0;

/// Noise chi^2 of a frame above which the fractions above apply; below, they fall with its square,
/// because with few electrodes a gain fits much of any frame.
const ENOUGH: f64 = 30.0;

/// Returns the factor, at most 1, by which small frames reduce the fractions above.
pub(super) fn share(whitening: &Whitening) -> f64 {
    (whitening.expected() / ENOUGH).min(1.0).powi(2)
}

/// The effect of a gain of each electrode.
#[derive(Debug, Clone)]
pub(super) struct Gains {
    /// The reference values of its measurements, whitened and scaled to length 1, `[electrode][row]`.
    columns: Vec<f64>,
    /// One of the columns, without lost rows and free unknowns.
    projected: Vec<f64>,
}

impl Gains {
    pub(super) fn new(model: &DetectorModel<'_>, rows: &Rows, whitening: &Whitening) -> Self {
        let n = rows.of.len();
        let mut columns = vec![0.0; model.of_electrode.len() * n];
        let mut values = vec![0.0; model.used.len()];
        let mut folded = vec![0.0; n];
        for (measurements, gain) in model.of_electrode.iter().zip(columns.chunks_exact_mut(n)) {
            values.fill(0.0);
            let used = measurements.iter().filter(|&&i| model.used[i]);
            used.for_each(|&i| values[i] = model.reference_v[i]);
            rows.fold(&values, &mut folded);
            whitening.apply(&folded, gain);
            let length = dot(gain, gain).sqrt().max(f64::MIN_POSITIVE);
            gain.iter_mut().for_each(|g| *g /= length);
        }
        Self { columns, projected: vec![0.0; n] }
    }

    /// Returns the electrode whose gain explains most of a residual, and the chi^2 that it leaves.
    pub(super) fn best(&mut self, whitening: &Whitening, residual: &[f64]) -> Option<(usize, f64)> {
        self.best_beside(whitening, residual, &[])
    }

    /// The same, for a residual without its components along orthonormal vectors.
    fn best_beside(
        &mut self,
        whitening: &Whitening,
        residual: &[f64],
        basis: &[f64],
    ) -> Option<(usize, f64)> {
        let Self { columns, projected } = self;
        let whole = dot(residual, residual);
        let mut best = None;
        for (electrode, gain) in columns.chunks_exact(residual.len().max(1)).enumerate() {
            projected.copy_from_slice(gain);
            whitening.project(projected);
            remove_all(projected, basis);
            let square = dot(projected, projected);
            if square < 1e-6 {
                continue;
            }
            let rest = whole - dot(projected, residual).powi(2) / square;
            if best.is_none_or(|(_, least)| rest < least) {
                best = Some((electrode, rest));
            }
        }
        best
    }

    /// Returns the electrode whose gain explains a frame together with earlier touches, whatever
    /// their strengths are now. `residual` is the frame without the span of these touches, `basis`.
    pub(super) fn beside_known(
        &mut self,
        whitening: &Whitening,
        residual: &[f64],
        basis: &[f64],
    ) -> Option<usize> {
        let bar = share(whitening) * BESIDE_KNOWN * dot(residual, residual);
        let bar = bar.min(MOST_PER_ROW * whitening.present() as f64);
        let found = self.best_beside(whitening, residual, basis);
        found.filter(|(_, rest)| *rest < bar).map(|(electrode, _)| electrode)
    }

    /// Returns the electrode whose gain explains the frame, before or after touches, far better than they do.
    /// `whole`: squared length of the whitened frame.
    pub(super) fn blamed(
        &mut self,
        search: &Search,
        whitening: &Whitening,
        whole: f64,
    ) -> Option<usize> {
        let (left, rows) = (search.best.rest, whitening.present() as f64);
        let share = share(whitening);
        let is_touched = !search.best.spots.is_empty();
        if !is_touched && left > (EXPLAINED_FROM * rows).max(LEFT_BY_MEMORY * whole) {
            let [part, times] = EXPLAINED_BY;
            let bar = (share * part * left).min(times * whitening.expected());
            let found = self.best(whitening, &search.residual);
            if let Some((electrode, _)) = found.filter(|(_, rest)| *rest < bar) {
                return Some(electrode);
            }
        }
        if left <= BLAME_FROM * rows {
            return None;
        }
        let [of_untouched, of_rest, of_whole] = BLAME;
        let of_rest = if is_touched { of_rest } else { of_untouched };
        let (mut blamed, mut least) = (None, 0.5 * left);
        for (residual, part) in [(&search.residual_without, of_whole), (&search.residual, of_rest)]
        {
            let bar = least.min(share * part * dot(residual, residual));
            let found = self.best(whitening, residual);
            if let Some((electrode, rest)) = found.filter(|(_, rest)| *rest < bar) {
                (least, blamed) = (rest, Some(electrode));
            }
        }
        blamed
    }
}
