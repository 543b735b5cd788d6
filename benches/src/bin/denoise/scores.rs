//! Figures of merit of denoised sequences.

use crate::held_out::{HeldOutSequence, QUIET_FRAMES};
use crate::variants::{ImageVariant, ImagedSequence};
use benches::Result;
use benches::table::{Cell, quantile};
use eit_inverse::metrics::{
    Cells, TouchErrors, TouchSettings, correlation_coefficient, structural_similarity,
    touch_position_errors_m,
};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView2, ArrayView3, Axis};
use std::collections::BTreeMap;

/// A finger with less force is still arriving or leaving, and its frame is not counted, newtons.
pub(crate) const FULL_N: f64 = 0.2;
/// Minimum peak of a blob relative to the variant's usual maximum in the touched frames of the
/// sequence or, for a sequence without truth, of those with truth.
pub(crate) const FLOOR: f64 = 0.25;
/// Maximum distance of a blob from its finger, metres.
pub(crate) const WITHIN_M: f64 = 0.025;

/// Criteria shared by all sequences.
pub(crate) struct Evaluation<'a> {
    raster: &'a Raster,
    cells: Cells<2>,
    /// Minimum peak of a blob, by sequence and variant.
    floors: BTreeMap<&'static str, BTreeMap<String, f64>>,
}

/// Figures of one variant of a sequence, with one entry per counted frame.
#[derive(Default)]
pub(crate) struct VariantScores {
    /// The counted frames with truth.
    frames: Vec<usize>,
    /// Mean squared error; relative to the raw image's after [`VariantScores::relative_to`].
    pub over_raw: Vec<f64>,
    /// Squared distance from the image of the paper's rule, over that of the raw image.
    over_raw_by_rule: Vec<f64>,
    /// Norm of the error over the truth's.
    relative: Vec<f64>,
    psnr_db: Vec<f64>,
    similarity: Vec<f64>,
    correlation: Vec<f64>,
    errors_m: Vec<f64>,
    fingers: usize,
    invented: usize,
    /// Fingers of each frame that were found, and blobs that are no finger's.
    found: Vec<(Vec<bool>, usize)>,
    /// Fingers that the raw images show and these do not; blobs that only these invent, in frames in
    /// which the raw image invents none.
    against_raw: Option<[usize; 2]>,
    /// Part of the frames whose error is larger than the raw image's.
    worse: f64,
    /// What the check did.
    judged: Option<Judged>,
    /// Number of frames without a finger after the quiet ones, and of their blobs.
    idle: usize,
    idle_blobs: usize,
}

/// Counted frames by what the check did to the network's image.
#[derive(Default)]
struct Judged {
    /// Rejected, and it was worse than the raw image.
    rightly: usize,
    /// Rejected, and it was better.
    wrongly: usize,
    /// Shown, and it was worse.
    let_through: usize,
}

/// Errors and touches of the raw images of a sequence.
pub(crate) struct Raw {
    errors: Vec<f64>,
    found: Vec<(Vec<bool>, usize)>,
}

/// The fingers in a frame.
enum Present {
    Nothing,
    /// At least one finger is arriving or leaving.
    Unclear,
    Fingers(Vec<[f64; 2]>),
}

fn present(sequence: &HeldOutSequence, frame: usize) -> Present {
    let touches = &sequence.touches[frame];
    if touches.is_empty() {
        return Present::Nothing;
    }
    match touches.iter().all(|touch| touch.force_n >= FULL_N) {
        true => Present::Fingers(touches.iter().map(|touch| touch.position_m).collect()),
        false => Present::Unclear,
    }
}

impl<'a> Evaluation<'a> {
    /// Determines the minimum peaks from touched frames.
    pub(crate) fn new(raster: &'a Raster, imaged: &[ImagedSequence]) -> Result<Self> {
        let mut floors: BTreeMap<&str, BTreeMap<String, f64>> = BTreeMap::new();
        let mut all: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        let (known, others): (Vec<_>, Vec<_>) =
            imaged.iter().partition(|imaged| imaged.sequence.truth.is_some());
        for ImagedSequence { sequence, variants } in known {
            for variant in variants {
                let touched = |f: &usize| matches!(present(sequence, *f), Present::Fingers(_));
                let frames = (QUIET_FRAMES..sequence.touches.len()).filter(touched);
                let peaks: Vec<f64> =
                    frames.map(|f| peak(variant.images.index_axis(Axis(0), f))).collect();
                let floor = FLOOR * quantile(&peaks, 0.5);
                floors.entry(sequence.name).or_default().insert(variant.name.clone(), floor);
                all.entry(variant.name.as_str()).or_default().push(floor);
            }
        }
        for ImagedSequence { sequence, variants } in others {
            for variant in variants {
                let floor = quantile(&all[variant.name.as_str()], 0.5);
                floors.entry(sequence.name).or_default().insert(variant.name.clone(), floor);
            }
        }
        Ok(Self { raster, cells: Cells::of_raster(raster), floors })
    }

    /// Evaluates a variant of a sequence.
    pub(crate) fn scores(
        &self,
        imaged: &ImagedSequence,
        variant: &ImageVariant,
    ) -> Result<VariantScores> {
        let ImagedSequence { sequence, variants } = imaged;
        let mut scores = VariantScores::default();
        let floor = self.floor(sequence, variant);
        let truth = sequence.truth.as_ref().map(|truth| truth.view());
        let most = truth.map_or(0.0, |truth| truth.iter().copied().fold(0.0, f64::max));
        for frame in QUIET_FRAMES..sequence.touches.len() {
            let image = variant.images.index_axis(Axis(0), frame);
            match present(sequence, frame) {
                Present::Unclear => {}
                Present::Nothing => {
                    scores.idle += 1;
                    scores.idle_blobs += self.blobs(image, &[], floor)?.extra;
                }
                Present::Fingers(places) => {
                    let found = self.blobs(image, &places, floor)?;
                    scores.fingers += places.len();
                    scores.invented += found.extra;
                    scores.errors_m.extend(found.errors_m.iter().flatten());
                    let each = found.errors_m.iter().map(Option::is_some).collect();
                    scores.found.push((each, found.extra));
                    if let [raw, rule, ..] = &variants[..] {
                        let of = |variant: &'_ ImageVariant| {
                            variant.images.index_axis(Axis(0), frame).to_owned()
                        };
                        let (raw, rule) = (of(raw), of(rule));
                        let off = |image: ArrayView2<'_, f64>| {
                            let off = image.iter().zip(&rule).map(|(v, t)| (v - t).powi(2));
                            off.filter(|v| v.is_finite()).sum::<f64>()
                        };
                        scores.over_raw_by_rule.push(off(image) / off(raw.view()));
                    }
                    if let Some(truth) = truth {
                        scores.frames.push(frame);
                        scores.compare(
                            image,
                            truth.index_axis(Axis(0), frame),
                            self.raster,
                            most,
                        )?;
                    }
                }
            }
        }
        Ok(scores)
    }

    /// Minimum peak of a blob.
    fn floor(&self, sequence: &HeldOutSequence, variant: &ImageVariant) -> f64 {
        let of_sequence = self.floors.get(sequence.name);
        of_sequence.and_then(|floors| floors.get(&variant.name)).copied().unwrap_or(0.0)
    }

    /// Compares the blobs of an image with the fingers.
    fn blobs(
        &self,
        image: ArrayView2<'_, f64>,
        places: &[[f64; 2]],
        floor: f64,
    ) -> Result<TouchErrors<2>> {
        let mut pixels = vec![0.0; self.raster.masked_pixels().len()];
        self.raster.pixels_from_image_into(image, &mut pixels)?;
        if peak(image) < floor {
            pixels.fill(0.0);
        }
        let settings = TouchSettings { within_m: WITHIN_M, ..Default::default() };
        Ok(touch_position_errors_m(&pixels, &self.cells, places, &settings)?)
    }
}

/// Largest value of an image.
fn peak(image: ArrayView2<'_, f64>) -> f64 {
    image.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max)
}

impl VariantScores {
    fn compare(
        &mut self,
        image: ArrayView2<'_, f64>,
        truth: ArrayView2<'_, f64>,
        raster: &Raster,
        most: f64,
    ) -> Result<()> {
        // the rims of the meshes differ by a pixel in places
        let mask = Array2::from_shape_fn(image.dim(), |at| {
            raster.mask()[at] && truth[at].is_finite() && image[at].is_finite()
        });
        let inside = |image: ArrayView2<'_, f64>| -> Vec<f64> {
            image.iter().zip(&mask).filter(|(_, inside)| **inside).map(|(v, _)| *v).collect()
        };
        let (x, t) = (inside(image), inside(truth));
        let error = x.iter().zip(&t).map(|(x, t)| (x - t).powi(2)).sum::<f64>() / x.len() as f64;
        self.over_raw.push(error);
        let of_truth = t.iter().map(|t| t * t).sum::<f64>() / t.len() as f64;
        self.relative.push((error / of_truth).sqrt());
        self.psnr_db.push(10.0 * (most * most / error).log10());
        let equal = vec![1.0; x.len()];
        self.correlation.push(correlation_coefficient(&x, &t, &equal)?);
        let similarity = structural_similarity(image, truth, mask.view(), Some(most))?;
        self.similarity.push(similarity.unwrap_or(f64::NAN));
        Ok(())
    }

    /// Divides the errors by those of the raw images, and compares touches with theirs.
    pub(crate) fn relative_to(mut self, raw: &Raw) -> Self {
        for (error, raw) in self.over_raw.iter_mut().zip(&raw.errors) {
            *error /= raw;
        }
        let worse = self.over_raw.iter().filter(|ratio| **ratio > 1.0).count();
        self.worse = worse as f64 / self.over_raw.len() as f64;
        let mut against = [0, 0];
        for ((own, extra), (raw, raw_extra)) in self.found.iter().zip(&raw.found) {
            against[0] += raw.iter().zip(own).filter(|(raw, own)| **raw && !**own).count();
            against[1] += if *raw_extra == 0 { *extra } else { 0 };
        }
        self.against_raw = Some(against);
        self
    }

    /// Compares the rejected frames of a checked variant with the network's own images, both relative to
    /// the raw ones.
    pub(crate) fn judged_by(mut self, variant: &ImageVariant, net: Option<&Self>) -> Self {
        if let (Some(aside), Some(net)) = (&variant.put_aside, net) {
            let mut judged = Judged::default();
            for (frame, ratio) in self.frames.iter().zip(&net.over_raw) {
                match (aside.contains(frame), *ratio > 1.0) {
                    (true, true) => judged.rightly += 1,
                    (true, false) => judged.wrongly += 1,
                    (false, true) => judged.let_through += 1,
                    (false, false) => {}
                }
            }
            self.judged = Some(judged);
        }
        self
    }

    /// What others are compared with.
    pub(crate) fn as_raw(&self) -> Raw {
        Raw { errors: self.over_raw.clone(), found: self.found.clone() }
    }

    /// A row of the table of touched frames.
    pub(crate) fn touched_row(&self, name: &str, variant: &ImageVariant) -> Vec<Cell> {
        let frames = self.over_raw.len() as f64;
        let judged =
            |of: fn(&Judged) -> usize| self.judged.as_ref().map_or(f64::NAN, |j| of(j) as f64);
        vec![
            Cell::text(name),
            Cell::text(&variant.name),
            Cell::Number(frames, 0),
            Cell::Number(quantile(&self.over_raw, 0.5), 3),
            Cell::Number(quantile(&self.over_raw, 0.9), 3),
            Cell::Number(quantile(&self.over_raw_by_rule, 0.5), 3),
            Cell::Number(quantile(&self.relative, 0.5), 3),
            Cell::Number(self.worse, 3),
            Cell::Number(quantile(&self.psnr_db, 0.5), 1),
            Cell::Number(quantile(&self.similarity, 0.5), 3),
            Cell::Number(quantile(&self.correlation, 0.5), 3),
            Cell::Number(self.errors_m.len() as f64 / self.fingers as f64, 3),
            Cell::Number(self.invented as f64 / frames, 3),
            Cell::Number(1e3 * quantile(&self.errors_m, 0.5), 2),
            Cell::Number(self.against_raw.map_or(f64::NAN, |[lost, _]| lost as f64), 0),
            Cell::Number(self.against_raw.map_or(f64::NAN, |[_, more]| more as f64), 0),
            Cell::Number(variant.aside_share().unwrap_or(f64::NAN), 3),
            Cell::Number(judged(|j| j.rightly), 0),
            Cell::Number(judged(|j| j.wrongly), 0),
            Cell::Number(judged(|j| j.let_through), 0),
        ]
    }

    /// A row of the table of other frames; `None` if the script has too few of them.
    pub(crate) fn foreign_row(
        &self,
        sequence: &HeldOutSequence,
        variant: &ImageVariant,
    ) -> Option<Vec<Cell>> {
        let scripted = sequence.truth.is_some();
        // a palm is always present, except while it moves
        let palm = !scripted && self.fingers > 0;
        let (frames, blobs) = match palm {
            true => (self.fingers, self.errors_m.len() + self.invented),
            false => (self.idle, self.idle_blobs),
        };
        let name = match scripted {
            true => format!("{}, between touches", sequence.name),
            false => sequence.name.to_owned(),
        };
        let aside = if scripted { f64::NAN } else { variant.aside_share().unwrap_or(f64::NAN) };
        (frames >= 10).then(|| {
            vec![
                Cell::text(name),
                Cell::text(&variant.name),
                Cell::Number(frames as f64, 0),
                Cell::Number(blobs as f64 / frames as f64, 3),
                Cell::Number(aside, 3),
            ]
        })
    }
}

/// Mean squared error of each frame after the quiet ones, siemens squared.
pub(crate) fn errors(images: ArrayView3<'_, f64>, truth: ArrayView3<'_, f64>) -> Vec<f64> {
    let frames = images.outer_iter().zip(truth.outer_iter()).skip(QUIET_FRAMES);
    frames
        .map(|(image, truth)| {
            let off = image.iter().zip(truth).map(|(v, t)| (v - t).powi(2));
            let off: Vec<f64> = off.filter(|v| v.is_finite()).collect();
            off.iter().sum::<f64>() / off.len() as f64
        })
        .collect()
}
