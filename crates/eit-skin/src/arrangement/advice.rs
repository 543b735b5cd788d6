//! What to set for frames with another number of values than the scene's protocol.

use super::{Arrangement, against_ground, arrangements};
use crate::first_scene::{PairMatrix, likeness};
use crate::frames::ALIKE;
use crate::skin::Skin;
use eit_fem::{DrivenElectrodes, PairPattern, PairProtocol};
use eit_hw::{Frame, FrameMap, Quality, Recording};
use ndarray::Axis;

impl Arrangement {
    /// The values of a frame in the order of the protocol.
    pub(crate) fn values(&self, frame: &[f64]) -> Vec<f64> {
        let (count, wanted) = (self.quadruples.len(), Some(&self.quadruples[..]));
        let mut mapped = Frame::new(0, Vec::new());
        let map = FrameMap::new(&self.layout(), frame.len(), wanted, count, "frame");
        let good = vec![Quality::GOOD; frame.len()];
        match map.and_then(|map| map.apply(frame, None, &good, &mut mapped)) {
            Ok(()) => mapped.values,
            // one of another length
            Err(_) => vec![f64::NAN; count],
        }
    }
}

/// Compares arrangements of frames with the untouched skin.
pub(crate) struct Judge<'a> {
    skin: &'a Skin,
    scene: &'a PairProtocol,
    untouched: PairMatrix,
}

/// What to set for a frame that zeros show to be of potentials; solves nothing for others.
pub(crate) fn of_zeros(skin: &Skin, frame: &[f64]) -> Option<String> {
    drives_of_zeros(skin.mesh.electrodes().len(), frame)?;
    let judge = Judge::new(skin)?;
    judge.judged_zeros(frame)?.words(judge.scene, frame.len())
}

/// An arrangement, how well it explains a frame, and whether zeros in the frame told the driven pairs.
struct Judged {
    arrangement: Arrangement,
    correlation: f64,
    is_of_zeros: bool,
}

impl<'a> Judge<'a> {
    /// Solves for the untouched skin; `None` if the scene's protocol is not one of pairs, or the skin cannot be solved.
    pub(crate) fn new(skin: &'a Skin) -> Option<Self> {
        let scene = skin.pairs.as_ref()?;
        let untouched = PairMatrix::untouched(skin, skin.current_a).ok()?;
        Some(Self { skin, scene, untouched })
    }

    /// Correlation of a frame in an arrangement with the model, without measurements on current-carrying electrodes.
    pub(crate) fn correlation(&self, arrangement: &Arrangement, frame: &[f64]) -> f64 {
        let model = self.untouched.measured(&arrangement.quadruples).to_vec();
        likeness(&arrangement.quadruples, &arrangement.values(frame), &model)
    }

    fn judged(&self, arrangement: Arrangement, is_of_zeros: bool, frame: &[f64]) -> Judged {
        let correlation = self.correlation(&arrangement, frame);
        Judged { arrangement, correlation, is_of_zeros }
    }

    /// Potentials of the drives that zeros in a frame tell.
    fn judged_zeros(&self, frame: &[f64]) -> Option<Judged> {
        let electrodes = self.skin.mesh.electrodes().len();
        let drives = drives_of_zeros(electrodes, frame)?;
        let directed = directed(&self.untouched, electrodes, frame, drives);
        let keep = DrivenElectrodes::Keep;
        Some(self.judged(against_ground(electrodes, frame.len(), directed, keep)?, true, frame))
    }

    /// The arrangement that explains a frame best; of equals the most usual. Zeros where current flows are no chance.
    fn best(&self, frame: &[f64]) -> Option<Judged> {
        let electrodes = self.skin.mesh.electrodes().len();
        let all = || arrangements(electrodes, frame.len(), Some(&self.scene.drive)).into_iter();
        self.judged_zeros(frame).or_else(|| {
            all()
                .map(|arrangement| self.judged(arrangement, false, frame))
                .rev()
                .max_by(|one, other| one.correlation.total_cmp(&other.correlation))
        })
    }

    /// What to set for a recording with another number of values than the scene's protocol; `None` if no arrangement has as many.
    pub(crate) fn advice(&self, recording: &Recording) -> Option<String> {
        let (electrodes, (lines, columns)) =
            (self.skin.mesh.electrodes().len(), recording.real.dim());
        let counts = [0, 2, 3, 4].map(|fewer| electrodes * electrodes.saturating_sub(fewer));
        let is_frame = |count: &usize| {
            *count > 0 && count.is_multiple_of(columns) && (lines * columns).is_multiple_of(*count)
        };
        let mean = |count: usize| {
            let frames = recording.real.to_shape((lines * columns / count, count)).ok()?;
            Some(frames.mean_axis(Axis(0))?.to_vec())
        };
        // also as many as each line holds, for drives of which there are more or fewer than electrodes
        let counts = counts.into_iter().chain([columns]);
        let all = counts.filter(is_frame).filter_map(|count| self.best(&mean(count)?));
        let order = |judged: &Judged| (judged.is_of_zeros, judged.correlation);
        let best = all.max_by(|one, other| {
            order(one).partial_cmp(&order(other)).unwrap_or(std::cmp::Ordering::Equal)
        })?;
        best.words(self.scene, columns)
    }
}

impl Judged {
    /// What to set in the scene, for lines of this many values.
    fn words(&self, scene: &PairProtocol, columns: usize) -> Option<String> {
        let keys = self.arrangement.keys(scene)?;
        let count = self.arrangement.layout().value_count();
        let count = count.unwrap_or(self.arrangement.quadruples.len());
        let of_lines = match count / columns {
            1 => String::new(),
            lines => format!(" (frames of {count} values in {lines} lines)"),
        };
        let correlation = format!("correlation with the model {:.3}", self.correlation);
        Some(match (self.correlation >= ALIKE, self.is_of_zeros) {
            (true, _) => format!("set {keys}{of_lines} ({correlation})"),
            (false, true) => format!(
                "two values of each drive are zero, as potentials are where current flows: set {keys}{of_lines}, and check \
                 [electrodes], which do not explain them ({correlation})"
            ),
            (false, false) => format!(
                "{keys}{of_lines} would give this number, but does not explain the values ({correlation}): check [electrodes], and \
                 state which pairs are driven and measured ([protocol] pairs, measure, quadruples_file)"
            ),
        })
    }
}

/// Driven pairs with the direction of current in which the model agrees with the potentials.
fn directed(
    untouched: &PairMatrix,
    electrodes: usize,
    frame: &[f64],
    drives: PairPattern,
) -> PairPattern {
    let PairPattern::Pairs(mut pairs) = drives else { return drives };
    let new = against_ground(
        electrodes,
        frame.len(),
        PairPattern::Pairs(pairs.clone()),
        DrivenElectrodes::Keep,
    );
    let Some(new) = new else { return PairPattern::Pairs(pairs) };
    let (values, model) = (new.values(frame), untouched.measured(&new.quadruples));
    let both: Vec<_> = new.quadruples.iter().zip(values.iter().zip(&model)).collect();
    for (pair, of_drive) in pairs.iter_mut().zip(both.chunk_by(|p, q| p.0[..2] == q.0[..2])) {
        if of_drive.iter().map(|(_, (value, model))| *value * *model).sum::<f64>() < 0.0 {
            pair.reverse();
        }
    }
    PairPattern::Pairs(pairs)
}

/// Potentials against a common electrode whose frames are zero where current flows, which tells the driven pairs: `drives` lines
/// of one value per electrode, two of them zero. Current enters at the electrode of the line's number, or the lower one.
fn drives_of_zeros(electrodes: usize, frame: &[f64]) -> Option<PairPattern> {
    let of_line = |(line, values): (usize, &[f64])| {
        let zeros: Vec<u32> =
            (0_u32..).zip(values).filter(|(_, value)| **value == 0.0).map(|(e, _)| e).collect();
        let &[a, b] = &zeros[..] else { return None };
        Some(if b as usize == line { [b, a] } else { [a, b] })
    };
    let lines = frame.chunks_exact(electrodes);
    let is_whole = lines.remainder().is_empty() && !frame.is_empty();
    is_whole.then(|| lines.enumerate().map(of_line).collect::<Option<_>>())?.map(PairPattern::Pairs)
}
