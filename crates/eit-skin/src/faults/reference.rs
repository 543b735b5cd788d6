//! Electrodes that are faulty while the reference is taken, found from the noise alone or without a model.

use super::contradictions::Contradictions;
use super::protocol::Wiring;
use super::{ElectrodeFault, FaultKind};
use crate::error::SkinError;
use eit_fem::Protocol;

/// An electrode is faulty from the start if its measurements' noise is above this multiple of the median
/// noise and ...
const NOISY_TIMES: f64 = 30.0;
/// ... above this fraction of the median voltage.
const NOISY_PART: f64 = 0.01;
/// A mean below this fraction of the median voltage is dead.
const DEAD: f64 = 0.02;

/// Finds electrodes that float while the reference is taken, from the noise of its frames; they stay excluded
/// until a new reference is taken. Also returns their measurements, in ascending order.
///
/// `used`, `std_v` and `reference_v` are `[measurement]`, volts.
///
/// # Errors
///
/// A list with the wrong length for the protocol.
pub(crate) fn of_reference(
    protocol: &Protocol,
    used: &[bool],
    std_v: &[f64],
    reference_v: &[f64],
) -> Result<(Vec<ElectrodeFault>, Vec<usize>), SkinError> {
    let measurements = protocol.measurements();
    let lists = [("used", used.len()), ("std_v", std_v.len()), ("reference_v", reference_v.len())];
    for (what, found) in lists {
        SkinError::check_measurements(what, found, measurements)?;
    }
    let limit = noise_limit(std_v, reference_v, used);
    let wiring = Wiring::new(protocol, used);
    let mut contradictions = Contradictions::new(measurements, wiring.of_electrode.len());
    for (i, wrong) in contradictions.is_wrong.iter_mut().enumerate() {
        *wrong = used[i] && std_v[i] > limit;
    }
    contradictions.accuse(&wiring, &vec![false; measurements], |_| false);
    let mut found = contradictions.accused().to_vec();
    found.sort_unstable();
    let of_found = |i: &usize| wiring.of_measurement[*i].iter().any(|e| found.contains(e));
    let left_out = (0..measurements).filter(of_found).collect();
    let fault =
        |&electrode| ElectrodeFault { electrode, kind: FaultKind::Contradicts, since_s: 0.0 };
    Ok((found.iter().map(fault).collect(), left_out))
}

/// Finds electrodes that are faulty in the first frames of a stream, in ascending order. Without a
/// model it uses the frames alone: noise as in [`of_reference`], voltages that violate reciprocity,
/// or almost no voltage. Returns none if there are more violations than faults of a third of the
/// electrodes explain, which means that the order of the measurements is wrong.
///
/// `std_v` is the noise of one frame; the mean `mean_v` of `frames` frames has the noise `std_v /
/// sqrt(frames)`.
pub(super) fn of_start(
    wiring: &Wiring,
    used: &[bool],
    std_v: &[f64],
    mean_v: &[f64],
    frames: usize,
) -> Vec<usize> {
    let limit = noise_limit(std_v, mean_v, used);
    let typical_v = median(mean_v, used);
    let root = (frames.max(1) as f64).sqrt();
    let mean_std_v: Vec<f64> = std_v.iter().map(|std| std / root).collect();
    let zeros = vec![0.0; used.len()];
    let mut contradictions = Contradictions::new(used.len(), wiring.of_electrode.len());
    contradictions.compare(&wiring.reciprocal, &mean_std_v, [mean_v, &zeros], |i| used[i]);
    for (i, wrong) in contradictions.is_wrong.iter_mut().enumerate() {
        *wrong |= used[i] && (std_v[i] > limit || mean_v[i].abs() < DEAD * typical_v);
    }
    let nothing = vec![false; used.len()];
    contradictions.accuse(wiring, &nothing, |_| false);
    if !contradictions.is_explained(wiring, |i| used[i], |_| false) {
        return Vec::new();
    }
    let mut found = contradictions.accused().to_vec();
    found.sort_unstable();
    found
}

/// Noise above which a measurement counts as floating, volts.
fn noise_limit(std_v: &[f64], mean_v: &[f64], used: &[bool]) -> f64 {
    (NOISY_TIMES * median(std_v, used)).max(NOISY_PART * median(mean_v, used))
}

/// Median magnitude of the finite values that are used; 0 if there are none.
pub(super) fn median(values: &[f64], used: &[bool]) -> f64 {
    let of_used = values.iter().zip(used).filter(|(_, used)| **used);
    let sizes = of_used.map(|(value, _)| value.abs()).filter(|value| value.is_finite());
    eit_core::median(sizes).unwrap_or(0.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is a failed test")]
mod tests {
    use super::*;
    use eit_core::Random;
    use eit_fem::PairProtocol;
    use eit_inverse::noise_std_of_quiet_frames;
    use ndarray::Array2;

    /// Volts; voltages are 3 mV to 0.25 V.
    const NOISE_V: f64 = 2e-5;
    const QUIET_FRAMES: usize = 50;

    struct Quiet {
        protocol: Protocol,
        reference_v: Vec<f64>,
        /// `[frame, measurement]`
        values: Array2<f64>,
        random: Random,
    }

    impl Quiet {
        fn new(noise_v: f64) -> Self {
            let protocol = PairProtocol::default().protocol().unwrap();
            let voltage = |&[a, _, m, _]: &[u32; 4]| {
                let way = (a as f64 - m as f64).abs();
                way.min(16.0 - way).powi(-2)
            };
            let reference_v: Vec<f64> =
                protocol.quadruples().unwrap().iter().map(voltage).collect();
            let mut random = Random::new(1);
            let shape = (QUIET_FRAMES, reference_v.len());
            let values =
                Array2::from_shape_fn(shape, |(_, i)| reference_v[i] + noise_v * random.normal());
            Self { protocol, reference_v, values, random }
        }

        fn of(&self, electrode: u32) -> Vec<usize> {
            let quadruples = self.protocol.quadruples().unwrap();
            (0..quadruples.len()).filter(|&i| quadruples[i].contains(&electrode)).collect()
        }

        fn found(&self) -> (Vec<usize>, Vec<usize>) {
            let std_v = noise_std_of_quiet_frames(self.values.view()).unwrap();
            let used = vec![true; std_v.len()];
            let (faults, left_out) =
                of_reference(&self.protocol, &used, &std_v, &self.reference_v).unwrap();
            (faults.iter().map(|fault| fault.electrode).collect(), left_out)
        }
    }

    #[test]
    fn electrodes_that_float_are_found() {
        for floating in [vec![0], vec![5], vec![2, 9]] {
            let mut quiet = Quiet::new(NOISE_V);
            let mut lost: Vec<usize> = floating.iter().flat_map(|&e| quiet.of(e as u32)).collect();
            lost.sort_unstable();
            lost.dedup();
            for &i in &lost {
                for frame in 0..QUIET_FRAMES {
                    quiet.values[[frame, i]] = 0.025 * quiet.random.normal();
                }
            }
            assert_eq!(quiet.found(), (floating, lost));
        }
    }

    #[test]
    fn a_clean_skin_names_nobody() {
        assert_eq!(Quiet::new(NOISE_V).found(), (vec![], vec![]));
    }

    /// An electrode with a bad contact is noisy but not open: ten times the others' noise, 0.02 to 7 % of a
    /// voltage.
    #[test]
    fn some_noise_is_no_fault() {
        let mut quiet = Quiet::new(NOISE_V);
        for i in quiet.of(5) {
            for frame in 0..QUIET_FRAMES {
                quiet.values[[frame, i]] += 10.0 * NOISE_V * quiet.random.normal();
            }
        }
        assert_eq!(quiet.found(), (vec![], vec![]));
    }

    /// With a coarse converter most measurements never change, but those of one electrode sit on
    /// the edge of a step and jump.
    #[test]
    fn rounding_names_nobody() {
        let step_v = 1e-3;
        let mut quiet = Quiet::new(0.0);
        for i in 0..quiet.reference_v.len() {
            let on_edge = quiet.of(5).contains(&i);
            for frame in 0..QUIET_FRAMES {
                let value = (quiet.values[[frame, i]] / step_v).round();
                let hop = on_edge && quiet.random.uniform() < 0.5;
                quiet.values[[frame, i]] = step_v * (value + f64::from(u8::from(hop)));
            }
        }
        let constant = |i: usize| quiet.values.column(i).iter().all(|v| *v == quiet.values[[0, i]]);
        assert!((0..208).filter(|&i| constant(i)).count() > 150);
        assert_eq!(quiet.found(), (vec![], vec![]));
    }

    #[test]
    fn wrong_lengths_are_refused() {
        let Quiet { protocol, reference_v, .. } = Quiet::new(NOISE_V);
        let (used, std_v) = (vec![true; 208], vec![NOISE_V; 208]);
        for [u, s, r] in [[207, 208, 208], [208, 0, 208], [208, 208, 1]] {
            let refused = of_reference(&protocol, &used[..u], &std_v[..s], &reference_v[..r]);
            assert!(matches!(
                refused,
                Err(SkinError::MeasurementCount { found, measurements: 208, .. })
                    if found == u.min(s).min(r)
            ));
        }
    }
}
