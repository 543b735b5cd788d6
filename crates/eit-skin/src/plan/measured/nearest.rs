//! Finds the built-in scene most similar to another.

use crate::method::Method;
use crate::skin::Skin;

/// Ratio of contact impedances above which a scene resembles `stiff-contact`.
const STIFF: f64 = 1e4;
/// Possible rise of conductivity, relative to itself, from which a scene resembles `high-contrast`.
const HIGH: f64 = 3.0;
/// Number of electrodes from which a scene resembles `general-32`, as do those with general currents.
const MANY: usize = 24;
/// Halfway between the paper's skin with a poor and with a good instrument, decibel.
const POOR_DB: f64 = 50.0;

/// The most similar built-in scene, and the reason.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub(crate) struct Nearest {
    /// Its name.
    #[serde(rename = "measured_on")]
    pub scene: &'static str,
    /// Why it is the most similar.
    #[serde(rename = "because")]
    pub why: String,
}

/// Finds the built-in scene most similar to this one. `voltages` are those of the untouched skin.
pub(crate) fn nearest(skin: &Skin, frames: Option<usize>, voltages: &[f64]) -> Nearest {
    let found = |scene, why: &str| Nearest { scene, why: why.to_owned() };
    let electrodes = skin.protocol.electrodes();
    if skin.protocol.quadruples().is_none() {
        return found("general-32", "currents on more than two electrodes");
    }
    if electrodes >= MANY {
        return found("general-32", &format!("{electrodes} electrodes"));
    }
    let impedances = &skin.contact_impedance;
    let least = impedances.iter().copied().fold(f64::INFINITY, f64::min);
    if impedances.iter().any(|z| *z > STIFF * least) {
        return found("stiff-contact", "widely different contact impedances");
    }
    // nets are trained on the fabric; its noise does not tell how its electrodes move
    if skin.settings.denoise.is_some() {
        return found("paper-fabric", "it has [denoise]");
    }
    let keys = &skin.settings.reconstruction;
    if keys.upper_s.is_some_and(|upper| upper >= HIGH * skin.conductivity_s) {
        return found("high-contrast", "upper_s allows a multiple of the conductivity");
    }
    let frame_by_frame = keys.method.as_deref() == Some(Method::Tv.name());
    match frames {
        Some(1) => return found("single-frame", "one frame"),
        None if frame_by_frame => return found("single-frame", "method \"tv\", no recording"),
        _ => {}
    }
    let rms = (voltages.iter().map(|v| v * v).sum::<f64>() / voltages.len() as f64).sqrt();
    match skin.settings.noise.additive_v.map(|noise| 20.0 * (rms / noise).log10()) {
        Some(db) if db < POOR_DB => found("paper-disc-40", &format!("noise at {db:.0} dB")),
        Some(db) => found("paper-disc-60", &format!("noise at {db:.0} dB")),
        None => found("paper-disc-60", "its noise is not stated in volt"),
    }
}
