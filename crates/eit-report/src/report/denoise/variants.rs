//! Images of a held-out sequence: raw, by the paper's rule, through nets.

use super::super::named_net::NamedNet;
use super::held_out::{HeldOutSequence, QUIET_FRAMES};
use crate::error::ReportError;
use eit_denoise::ThresholdRule;
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::denoise::{Chained, Check};
use ndarray::{Array3, Axis};

/// Images of a sequence, made in one way.
pub(super) struct ImageVariant {
    /// "raw", "rule", a net, or a net that was checked.
    pub name: String,
    /// Siemens, [frame, row, column].
    pub images: Array3<f64>,
    /// Part of the frames in which a net was not believed; `None` for what is no checked net.
    pub put_aside: Option<f64>,
}

/// A sequence and its images, made in every way; the raw ones come first.
pub(super) struct ImagedSequence {
    pub sequence: HeldOutSequence,
    pub variants: Vec<ImageVariant>,
}

/// The raw images, those of the paper's rule, and those of each net without and with the check.
pub(super) fn variants(
    raster: &Raster,
    made: &Chained,
    nets: &[NamedNet],
) -> Result<Vec<ImageVariant>, ReportError> {
    let raw = &made.images;
    let mut rule = ThresholdRule::default().on(raster.mask().view())?;
    let mut kept = raw.clone();
    for (image, out) in raw.outer_iter().zip(kept.axis_iter_mut(Axis(0))) {
        rule.apply_into(image, out)?;
    }
    let plain =
        |name: &str, images| ImageVariant { name: name.to_owned(), images, put_aside: None };
    let mut variants = vec![plain("raw", raw.clone()), plain("rule", kept)];
    let check = Check::new(&made.fitted);
    for NamedNet { name, net } in nets {
        let mut silent = Progress::silent();
        let mut images = raw.clone();
        net.apply_unchecked(&mut images, raster, &check, &mut silent)?;
        variants.push(plain(name, images));
        let mut images = raw.clone();
        if let Some(checked) = net.apply(&mut images, raster, Some(&check), &mut silent)? {
            // quiet frames at the start count for nothing
            let aside = checked.put_aside().iter().filter(|f| **f >= QUIET_FRAMES).count();
            let put_aside = Some(aside as f64 / (raw.dim().0 - QUIET_FRAMES) as f64);
            variants.push(ImageVariant { name: format!("{name}, checked"), images, put_aside });
        }
    }
    Ok(variants)
}
