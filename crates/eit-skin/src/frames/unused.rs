//! Which measurements are left out of all frames, and why.

use super::load::Loaded;
use super::on_driven_electrodes;
use super::quiet::QuietFrames;
use super::reference::ReferenceFrame;
use crate::error::SkinError;
use crate::faults::{self, ElectrodeFault, FaultKind};
use crate::scene::DifferenceKind;
use crate::skin::Skin;
use crate::text::counted;
use eit_inverse::noise_std_of_quiet_frames;
use std::fmt;

/// An electrode with fewer measurements is not judged.
const LEAST_OF_ELECTRODE: usize = 4;

/// Threshold for almost zero, relative to the largest value of the reference frame: changes divided by less
/// are noise of any instrument (120 dB).
const ALMOST_ZERO: f64 = 1e-6;

/// Why a measurement is excluded from all frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unused {
    Driven,
    Zero,
    BadReference,
    MostlyBad,
}

impl fmt::Display for Unused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Driven => "on current-carrying electrodes",
            Self::Zero => "zero, or almost, in the reference frame",
            Self::BadReference => "flagged bad in the reference",
            Self::MostlyBad => "flagged bad in more than half of the frames",
        })
    }
}

impl Unused {
    /// How many measurements are left out for each reason, in words.
    pub(super) fn notes(reasons: &[Option<Self>]) -> impl Iterator<Item = String> {
        [Self::Driven, Self::Zero, Self::BadReference, Self::MostlyBad].into_iter().filter_map(
            |why| {
                let count = reasons.iter().flatten().filter(|reason| **reason == why).count();
                let number = counted(count, "measurement", "measurements");
                (count > 0).then(|| format!("{number} left out: {why}"))
            },
        )
    }
}

/// Why each measurement is excluded from all frames; `None` if it is used. A measurement that is bad in some
/// frames only is excluded from those frames.
pub(super) fn reasons(skin: &Skin, loaded: &Loaded, found: &ReferenceFrame) -> Vec<Option<Unused>> {
    let (reference, reference_good) = (&found.values, &found.good);
    let driven = on_driven_electrodes(&skin.protocol);
    let use_driven = skin.settings.reconstruction.use_driven_electrodes;
    let normalised = skin.difference_kind() == DifferenceKind::Normalised;
    let finite = reference.iter().filter(|v| v.is_finite());
    let largest = finite.fold(0.0_f64, |m, v| m.max(v.abs()));
    let frames = loaded.frames.quality.nrows();
    let bad = |i: usize| loaded.frames.quality.column(i).iter().filter(|q| !q.is_good()).count();
    (0..skin.protocol.measurements())
        .map(|i| match i {
            _ if driven[i] && !use_driven => Some(Unused::Driven),
            _ if !reference_good[i] || !reference[i].is_finite() => Some(Unused::BadReference),
            _ if 2 * bad(i) > frames => Some(Unused::MostlyBad),
            _ if normalised && reference[i].abs() <= ALMOST_ZERO * largest => Some(Unused::Zero),
            _ => None,
        })
        .collect()
}

/// Leaves out electrodes of which nothing can be used from the start, and returns them: those whose measurements are
/// all zero or bad, and those whose measurements all have the same value, as at full scale.
pub(super) fn leave_out_lost(
    skin: &Skin,
    reasons: &[Option<Unused>],
    reference: &[f64],
    used: &mut [bool],
) -> Vec<ElectrodeFault> {
    let measured: Vec<bool> =
        reasons.iter().map(|reason| *reason != Some(Unused::Driven)).collect();
    let of_electrode = faults::of_electrode(&skin.protocol, &measured);
    let kind_of = |of_e: &Vec<usize>| {
        if of_e.len() < LEAST_OF_ELECTRODE {
            return None;
        }
        if of_e.iter().all(|&i| reasons[i].is_some()) {
            let is_flagged = of_e.iter().any(|&i| reasons[i] != Some(Unused::Zero));
            return Some(if is_flagged { FaultKind::Flagged } else { FaultKind::Contradicts });
        }
        let size = reference[of_e[0]].abs();
        let is_same = of_e.iter().all(|&i| reasons[i].is_none() && reference[i].abs() == size);
        (size > 0.0 && is_same).then_some(FaultKind::Stuck)
    };
    let kinds: Vec<Option<FaultKind>> = of_electrode.iter().map(kind_of).collect();
    let found = kinds.iter().flatten().count();
    // more than that is another kind of file
    if 3 * found > of_electrode.len() {
        return Vec::new();
    }
    let lost = kinds.iter().enumerate().filter_map(|(e, kind)| Some((e, (*kind)?)));
    lost.map(|(electrode, kind)| {
        of_electrode[electrode].iter().for_each(|&i| used[i] = false);
        ElectrodeFault { electrode, kind, since_s: 0.0 }
    })
    .collect()
}

/// Excludes the measurements of electrodes that float in the quiet frames, and returns these electrodes.
pub(super) fn leave_out_floating(
    skin: &Skin,
    reference: &[f64],
    quiet: Option<&QuietFrames>,
    used: &mut [bool],
) -> Result<Vec<ElectrodeFault>, SkinError> {
    let noise = quiet.map(|quiet| noise_std_of_quiet_frames(quiet.values.view()));
    let Some(Ok(std_v)) = noise else { return Ok(Vec::new()) };
    let (found, left_out) = faults::of_reference(&skin.protocol, used, &std_v, reference)?;
    left_out.into_iter().for_each(|i| used[i] = false);
    Ok(found)
}

/// Rejects frames of which nothing can be used.
pub(super) fn check_any(
    reasons: &[Option<Unused>],
    used: &[bool],
    notes: &[String],
) -> Result<(), SkinError> {
    if reasons.iter().all(|reason| *reason == Some(Unused::Driven)) {
        return Err(SkinError::input(
            "no measurement is usable: all are on current-carrying electrodes. If values are potentials against the sink, give \
             [protocol] pairs and measure = \"ground\", which need no contact impedance; or set [reconstruction] \
             use_driven_electrodes = true",
        ));
    }
    match used.contains(&true) {
        true => Ok(()),
        false => Err(SkinError::input(format!("no measurement is usable: {}", notes.join("; ")))),
    }
}
