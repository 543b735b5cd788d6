//! Images of a held-out sequence: raw, by the paper's rule, and through networks.

use crate::held_out::{HeldOutSequence, QUIET_FRAMES};
use benches::Result;
use eit_denoise::{DenoiseError, ThresholdRule};
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::denoise::{Chained, Check, Net};
use eit_skin::touches::touches;
use ndarray::{Array3, Axis};

/// Images of a sequence, computed in one way.
pub(crate) struct ImageVariant {
    /// "raw", "rule", a network, or a network with the consistency check.
    pub name: String,
    /// Siemens, [frame, row, column].
    pub images: Array3<f64>,
    /// Frames in which the network's image was rejected, after the quiet ones; `None` for variants
    /// without the check. The variant before has the network's own images.
    pub put_aside: Option<Vec<usize>>,
}

impl ImageVariant {
    /// Fraction of the frames after the quiet ones in which the network's image was rejected.
    pub(crate) fn aside_share(&self) -> Option<f64> {
        let all = self.images.dim().0 - QUIET_FRAMES;
        self.put_aside.as_ref().map(|frames| frames.len() as f64 / all as f64)
    }
}

/// A sequence with all variants of its images; the raw ones come first.
pub(crate) struct ImagedSequence {
    pub sequence: HeldOutSequence,
    pub variants: Vec<ImageVariant>,
}

/// Computes the raw images, those by the paper's rule, and those of each network without and with
/// the check.
pub(crate) fn variants(
    raster: &Raster,
    made: &Chained,
    nets: &[(String, Net)],
) -> Result<Vec<ImageVariant>> {
    let raw = &made.images;
    let mut rule = ThresholdRule::default().on(raster.mask().view())?;
    let mut kept = raw.clone();
    for (image, out) in raw.outer_iter().zip(kept.axis_iter_mut(Axis(0))) {
        match rule.apply_into(image, out) {
            // total variation may leave the inner pixels of a noisy frame equal: nothing is kept
            Ok(()) | Err(DenoiseError::ConstantImage { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    let plain =
        |name: &str, images| ImageVariant { name: name.to_owned(), images, put_aside: None };
    let mut variants = vec![plain("raw", raw.clone()), plain("rule", kept)];
    // once for all nets
    let check = match touches(&made.fitted, &mut Progress::silent())? {
        Some(found) => Check::new(&made.fitted).with_touches(&found),
        None => Check::new(&made.fitted),
    };
    for (name, net) in nets {
        let mut silent = Progress::silent();
        let mut images = raw.clone();
        net.apply_unchecked(&mut images, &check, &mut silent)?;
        variants.push(plain(name, images));
        let mut images = raw.clone();
        if let Some(checked) = net.apply(&mut images, raster, Some(&check), &mut silent)? {
            // quiet frames at the start are not counted
            let aside = checked.raw_frames.into_iter().filter(|f| *f >= QUIET_FRAMES);
            let put_aside = Some(aside.collect());
            variants.push(ImageVariant { name: format!("{name}, checked"), images, put_aside });
        }
    }
    Ok(variants)
}
