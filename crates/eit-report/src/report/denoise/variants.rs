//! Images of a held-out sequence: raw, by the paper's rule, and through networks.

use super::super::named_net::NamedNet;
use super::held_out::{HeldOutSequence, QUIET_FRAMES};
use crate::error::ReportError;
use eit_denoise::ThresholdRule;
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::denoise::{Chained, Check};
use ndarray::{Array3, Axis};

/// Images of a sequence, computed in one way.
pub(super) struct ImageVariant {
    /// "raw", "rule", a network, or a network with the consistency check.
    pub name: String,
    /// Siemens, [frame, row, column].
    pub images: Array3<f64>,
    /// Fraction of frames in which the network's image was rejected; `None` for variants without
    /// the check.
    pub put_aside: Option<f64>,
}

/// A sequence with all variants of its images; the raw ones come first.
pub(super) struct ImagedSequence {
    pub sequence: HeldOutSequence,
    pub variants: Vec<ImageVariant>,
}

/// Computes the raw images, those by the paper's rule, and those of each network without and with
/// the check.
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
    let mut check = Check::new(&made.fitted)?;
    for NamedNet { name, net } in nets {
        let mut silent = Progress::silent();
        let mut images = raw.clone();
        net.apply(&mut images, raster, None, &mut silent)?;
        variants.push(plain(name, images));
        let mut images = raw.clone();
        if let Some(checked) = net.apply(&mut images, raster, Some(&mut check), &mut silent)? {
            // quiet frames at the start are not counted
            let aside = checked.put_aside().iter().filter(|f| **f >= QUIET_FRAMES).count();
            let put_aside = Some(aside as f64 / (raw.dim().0 - QUIET_FRAMES) as f64);
            variants.push(ImageVariant { name: format!("{name}, checked"), images, put_aside });
        }
    }
    Ok(variants)
}
