//! Measurements that contradict their reciprocals or are dead, and the electrodes to blame for them.

use super::protocol::Wiring;

/// Part of an electrode's reciprocal pairs that must be wrong for it to be faulty.
const FAULTY: f64 = 0.5;
/// The same once another one is: with one fault the rest has next to nothing wrong, and chance makes one
/// in eight measurements of a floating electrode fit.
const FAULTY_TOO: f64 = 0.25;
/// A pair is wrong where its halves differ by so many standard deviations of the noise ...
const WRONG_STD: f64 = 10.0;
/// ... this part of their change, since gains of real channels are not equal, ...
const WRONG_PART: f64 = 0.25;
/// ... and this part of their reference, since real channels drift apart.
const WRONG_DRIFT: f64 = 1e-3;
/// A measurement below this part of its reference is dead.
const DEAD: f64 = 0.02;
/// With fewer measurements that are left, an electrode is not judged.
const LEAST: usize = 4;

/// A frame is a bad one where more than this part of the electrodes contradict: garbage blames every
/// second to third electrode, which leaves no measurement that could blame those between them; ...
const GARBAGE: f64 = 1.0 / 3.0;
/// ... or where this part of the measurements without those electrodes is wrong too.
const UNEXPLAINED: f64 = 0.2;

/// What is wrong in the frame at hand.
#[derive(Debug, Clone)]
pub(super) struct Contradictions {
    /// Whether each measurement contradicts its reciprocal, or is dead.
    pub is_wrong: Vec<bool>,
    /// Electrodes to blame, the worst first.
    accused: Vec<usize>,
    is_out: Vec<bool>,
    /// Part of their reference by which halves of a pair may differ.
    pub wrong_drift: f64,
}

impl Contradictions {
    pub fn new(measurements: usize, electrodes: usize) -> Self {
        Self {
            is_wrong: vec![false; measurements],
            accused: Vec::with_capacity(electrodes),
            is_out: vec![false; electrodes],
            wrong_drift: WRONG_DRIFT,
        }
    }

    /// Marks what contradicts its reciprocal, or is dead. `counts`: it is used and not missing.
    pub fn compare(
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

    /// Looks for [`accused`](Self::accused) electrodes: the one with the largest part of wrong measurements goes, until none has
    /// half of its own wrong, or, beside another one, a quarter. Those that are out already blame nobody.
    pub fn accuse(&mut self, wiring: &Wiring, is_missing: &[bool], is_out: impl Fn(usize) -> bool) {
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

    /// Electrodes to blame for what is wrong, the worst first.
    pub fn accused(&self) -> &[usize] {
        &self.accused
    }

    /// Whether the accused electrodes explain what is wrong among the measurements that count, without
    /// those of electrodes that are out: they are few, and leave little wrong.
    pub fn is_explained(
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

    /// Part of an electrode's measurements that are wrong, those of other electrodes that are out
    /// left aside; `None` where too few are left to tell.
    pub fn wrong_part(
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
