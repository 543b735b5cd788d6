//! What a plan omits, and why.

use super::sequence::Sequence;
use crate::method::Method;
use crate::skin::Skin;

/// Something that is omitted, and the reason.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct LeftOut {
    /// What is omitted.
    pub what: &'static str,
    /// Reason.
    pub why: String,
}

impl LeftOut {
    /// Returns a line for the plan.
    pub(crate) fn line(&self) -> String {
        format!("  {:<22} {}", self.what, self.why)
    }
}

/// Converts pairs of what and why.
pub(super) fn listed(list: Vec<(&'static str, String)>) -> Vec<LeftOut> {
    list.into_iter().map(|(what, why)| LeftOut { what, why }).collect()
}

/// Lists what the scene does not use, and why.
pub fn of(skin: &Skin, method: Method, sequence: Sequence, noise_is_known: bool) -> Vec<LeftOut> {
    let cost = skin.model.cost();
    let patterns =
        skin.protocol.stimulations_a().nrows() + skin.protocol.measurement_patterns().nrows();
    let (m, products) = (skin.protocol.measurements(), cost.field_products);
    let mut list = vec![
        ("complex arithmetic", skin.why_real.to_owned()),
        (
            "forward sweeps",
            "currents enter at electrodes only, which are eliminated last".to_owned(),
        ),
        (
            "field solves",
            format!(
                "{} of {patterns} patterns: the others are combinations",
                patterns.saturating_sub(cost.field_solves)
            ),
        ),
    ];
    if skin.weave.is_none() {
        let why = "no skin.weave_ratio, and no reference frame yet that shows the fabric to conduct better along than across";
        list.push(("weave", why.to_owned()));
    }
    if m > products {
        let why = format!("{} of {m} rows are multiples of others (reciprocity)", m - products);
        list.push(("Jacobian products", why));
    }
    list.extend(of_method(skin, method, sequence));
    if skin.settings.reconstruction.electrode_movement_m.is_none()
        && method != Method::GaussNewtonAbsolute
    {
        let why = "no reconstruction.electrode_movement_m: images assume fixed electrodes; where \
                   the rim of a \
                   fabric gives way, they show spots at electrodes (touches allow for 0.2 mm)";
        list.push(("electrode movement", why.to_owned()));
    }
    if !noise_is_known {
        let why = "the recording shows no noise, from which they are distinguished: set [noise], or use a \
             reference of 8 frames";
        list.push(("touches", why.to_owned()));
    }
    if skin.settings.denoise.is_none() {
        list.push(("U-net", "the scene has no [denoise]".to_owned()));
    }
    if skin.instrument.is_none() {
        list.push(("instrument", "the scene has no [instrument]: recorded frames only".to_owned()));
    }
    listed(list)
}

/// What the method omits on this scene.
fn of_method(skin: &Skin, method: Method, sequence: Sequence) -> Vec<(&'static str, String)> {
    let keys = &skin.settings.reconstruction;
    let mut list = Vec::new();
    let by_itself = match method {
        Method::GaussNewton => Some("one-step Gauss-Newton treats each frame on its own"),
        Method::GaussNewtonAbsolute => {
            Some("each frame on its own, starting from the image of the last one")
        }
        Method::StTv | Method::Tv if sequence == Sequence::Frames(1) => {
            Some("a recording of one frame: plain total variation in space")
        }
        Method::StTv | Method::Tv if matches!(sequence, Sequence::Still(_)) => {
            Some("a static scene: one image of the mean, by plain total variation in space")
        }
        Method::Tv => Some("method \"tv\" treats each frame on its own"),
        Method::StTv if keys.lambda_time == Some(0.0) => Some("lambda_time = 0"),
        _ => None,
    };
    list.extend(by_itself.map(|why| ("time coupling", why.to_owned())));
    if method.is_tv() {
        if keys.lower_s.is_none() && keys.upper_s.is_none() {
            let why = "no lower_s or upper_s: where a touch only raises the conductivity, \
                       lower_s = 0 improves images";
            list.push(("bounds", why.to_owned()));
        }
        list.push(("prior, hyperparameter", "total variation has weights instead".to_owned()));
    } else {
        list.push(("total variation", format!("method \"{}\" has none", method.name())));
    }
    list
}
