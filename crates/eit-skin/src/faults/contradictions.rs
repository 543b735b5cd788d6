//! Measurements that violate reciprocity or are dead, and the electrodes to blame for them.

use super::protocol::Wiring;

/// Fraction of an electrode's reciprocal pairs that must be wrong for it to be faulty.
const FAULTY: f64 = 0.5;
/// The same once another electrode is faulty: a single fault leaves almost no other violation, and
/// one in eight measurements of a floating electrode looks right by chance.
const FAULTY_TOO: f64 = 0.25;
/// A pair is wrong if its halves differ by more than this many standard deviations of the noise ...
const WRONG_STD: f64 = 10.0;
/// ... plus this fraction of their change, because the gains of real channels differ, ...
const WRONG_PART: f64 = 0.25;
/// ... plus this fraction of their reference, because real channels drift apart.
const WRONG_DRIFT: f64 = 1e-3;
/// A measurement has jumped if it has changed by more than this fraction of its reference, ... In
/// nine recordings of four and six fingers on three skins, which change single voltages by up to a
/// quarter of the root mean square, none has jumped.
const JUMPED: f64 = 0.2;
/// ... and of the root mean square reference.
const JUMPED_OF_ALL: f64 = 0.02;
/// A measurement below this fraction of its reference is dead.
const DEAD: f64 = 0.02;
/// An electrode with fewer remaining measurements is not judged.
const LEAST: usize = 4;

/// A frame is bad if more than this fraction of the electrodes seems faulty (in a garbage frame
/// every second or third does, which leaves no measurement for those between them), ...
const GARBAGE: f64 = 1.0 / 3.0;
/// ... or if more than this fraction of the measurements without those electrodes is wrong too.
const UNEXPLAINED: f64 = 0.2;

/// Violations in the current frame.
#[derive(Debug, Clone)]
pub(super) struct Contradictions {
    /// Whether each measurement violates reciprocity or is dead.
    pub is_wrong: Vec<bool>,
    /// Electrodes to blame, worst first.
    accused: Vec<usize>,
    is_out: Vec<bool>,
    /// Fraction of their reference by which the halves of a pair may differ.
    pub wrong_drift: f64,
}

impl Contradictions {
    pub(crate) fn new(measurements: usize, electrodes: usize) -> Self {
        Self {
            is_wrong: vec![false; measurements],
            accused: Vec::with_capacity(electrodes),
            is_out: vec![false; electrodes],
            wrong_drift: WRONG_DRIFT,
        }
    }

    /// Marks measurements that violate reciprocity or are dead. `counts`: the measurement is used and not
    /// missing.
    pub(crate) fn compare(
        &mut self,
        reciprocal: &[usize],
        std_v: &[f64],
        [values, reference]: [&[f64]; 2],
        counts: impl Fn(usize) -> bool,
    ) {
        let is_dead = |k: usize| {
            let floor = WRONG_STD * std_v[k];
            reference[k].abs() > 3.0 * floor
                && values[k].abs() < (DEAD * reference[k].abs()).max(floor)
        };
        for (i, &twin) in reciprocal.iter().enumerate() {
            self.is_wrong[i] = false;
            if !counts(i) {
                continue;
            }
            let mut wrong = is_dead(i);
            if twin != i && counts(twin) {
                let [a, b] = [i, twin].map(|k| values[k] - reference[k]);
                let noise = std_v[i].hypot(std_v[twin]);
                let size = reference[i].abs().max(reference[twin].abs());
                let allowed =
                    WRONG_STD * noise + WRONG_PART * a.abs().max(b.abs()) + self.wrong_drift * size;
                wrong |= (a - b).abs() > allowed || is_dead(twin);
            }
            self.is_wrong[i] = wrong;
        }
    }

    /// Marks measurements that have changed by more than touches could. `counts` as in
    /// [`compare`](Self::compare).
    pub(crate) fn compare_jumps(
        &mut self,
        std_v: &[f64],
        [values, reference]: [&[f64]; 2],
        counts: impl Fn(usize) -> bool,
    ) {
        let (mut squares, mut all) = (0.0, 0.0_f64);
        for (_, v) in reference.iter().enumerate().filter(|(i, _)| counts(*i)) {
            squares += v * v;
            all += 1.0;
        }
        let typical = (squares / all.max(1.0)).sqrt();
        for (i, wrong) in self.is_wrong.iter_mut().enumerate() {
            let allowed =
                JUMPED * reference[i].abs() + JUMPED_OF_ALL * typical + WRONG_STD * std_v[i];
            *wrong = counts(i) && (values[i] - reference[i]).abs() > allowed;
        }
    }

    /// Returns the fraction of the counted measurements that are wrong; 0 if none is counted.
    pub(crate) fn part_wrong(&self, counts: impl Fn(usize) -> bool) -> f64 {
        let (mut wrong, mut all) = (0_u32, 0_u32);
        for (_, is_wrong) in self.is_wrong.iter().enumerate().filter(|(i, _)| counts(*i)) {
            all += 1;
            wrong += u32::from(*is_wrong);
        }
        f64::from(wrong) / f64::from(all.max(1))
    }

    /// Finds the [`accused`](Self::accused) electrodes: repeatedly takes the one with the largest
    /// fraction of wrong measurements, until none has at least half of them wrong or, after the
    /// first, a quarter. Electrodes that are already excluded, and their measurements, are ignored.
    pub(crate) fn accuse(
        &mut self,
        wiring: &Wiring,
        is_missing: &[bool],
        is_out: impl Fn(usize) -> bool,
    ) {
        self.accused.clear();
        for (e, out) in self.is_out.iter_mut().enumerate() {
            *out = is_out(e);
        }
        loop {
            let mut worst = None;
            let mut most = if self.accused.is_empty() { FAULTY } else { FAULTY_TOO };
            for e in (0..self.is_out.len()).filter(|&e| !self.is_out[e]) {
                let part = self.wrong_part(wiring, e, is_missing, |e| self.is_out[e]);
                if part.is_some_and(|part| part >= most) {
                    (worst, most) = (Some(e), part.unwrap_or(most).next_up());
                }
            }
            let Some(e) = worst else { return };
            self.is_out[e] = true;
            self.accused.push(e);
        }
    }

    /// Returns the electrodes to blame for what is wrong, worst first.
    pub(crate) fn accused(&self) -> &[usize] {
        &self.accused
    }

    /// Returns whether the accused electrodes explain what is wrong among the measurements that count,
    /// ignoring those of excluded electrodes: the accused are few, and little is wrong without them.
    pub(crate) fn is_explained(
        &self,
        wiring: &Wiring,
        counts: impl Fn(usize) -> bool,
        is_out: impl Fn(usize) -> bool,
    ) -> bool {
        let (mut left, mut wrong) = (0_usize, 0_usize);
        for (i, electrodes) in wiring.of_measurement.iter().enumerate() {
            let is_gone = |e: &usize| is_out(*e) || self.accused.contains(e);
            if counts(i) && !electrodes.iter().any(is_gone) {
                left += 1;
                wrong += usize::from(self.is_wrong[i]);
            }
        }
        let of_electrode = wiring.of_electrode.iter().enumerate();
        let judged = of_electrode.filter(|(e, of_e)| !of_e.is_empty() && !is_out(*e)).count();
        let is_few = self.accused.len() as f64 <= GARBAGE * judged as f64;
        self.accused.is_empty() || (is_few && wrong as f64 <= UNEXPLAINED * left as f64)
    }

    /// Fraction of an electrode's measurements that are wrong, ignoring those of other excluded electrodes;
    /// `None` if too few are left to tell.
    pub(crate) fn wrong_part(
        &self,
        wiring: &Wiring,
        electrode: usize,
        is_missing: &[bool],
        is_out: impl Fn(usize) -> bool,
    ) -> Option<f64> {
        let (mut wrong, mut all) = (0, 0);
        for &i in &wiring.of_electrode[electrode] {
            let is_other = |e: &usize| *e != electrode && is_out(*e);
            if is_missing[i] || wiring.of_measurement[i].iter().any(is_other) {
                continue;
            }
            all += 1;
            wrong += usize::from(self.is_wrong[i]);
        }
        (all >= LEAST).then(|| wrong as f64 / all as f64)
    }
}
