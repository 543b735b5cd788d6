//! Describes what determines total variation on a scene: noise, bounds, frames.

use super::sequence::Sequence;
use crate::method::Method;
use crate::scene::Delta;
use crate::skin::Skin;

/// Returns lines for the plan; none for methods with a hyperparameter.
pub(crate) fn of(skin: &Skin, method: Method, sequence: Sequence) -> Vec<String> {
    if !method.is_tv() {
        return Vec::new();
    }
    let mut lines = vec![noise(skin), weights(skin)];
    let keys = &skin.settings.reconstruction;
    if keys.lower_s.is_some() || keys.upper_s.is_some() {
        let bound = |value: Option<f64>, none| {
            value.map_or_else(|| String::from(none), |value| format!("{value:e} S"))
        };
        lines.push(format!(
            "bounds: changes of conductivity from {} to {}",
            bound(keys.lower_s, "any"),
            bound(keys.upper_s, "any")
        ));
    }
    let known =
        skin.settings.noise.additive_v.is_some() || skin.settings.noise.quiet_frames.is_some();
    if known {
        lines.push(
            "frames that do not differ from the reference beyond noise are not solved: image zero"
                .to_owned(),
        );
    }
    lines.push(coupling(skin, method, sequence, known));
    lines
}

fn noise(skin: &Skin) -> String {
    match (skin.settings.noise.additive_v, skin.settings.noise.quiet_frames) {
        (Some(additive_v), _) => format!("noise: {additive_v:e} V in a voltage, from the scene"),
        (_, Some(range)) => {
            let last = range.end.saturating_sub(1);
            format!("noise: measured on quiet frames {} to {last}", range.start)
        }
        _ => "noise: measured on the reference frames if there are several, else the model error \
              alone"
            .to_owned(),
    }
}

fn weights(skin: &Skin) -> String {
    let keys = &skin.settings.reconstruction;
    match (keys.delta, keys.lambda_space) {
        (Some(Delta::Value(delta)), _) => {
            format!("data: each frame within delta = {delta:e}, from the scene")
        }
        (Some(Delta::Rule(_)), _) => "data: each frame within its noise".to_owned(),
        (None, Some(weight)) => format!("weights: lambda_space {weight:e}, from the scene"),
        (None, None) => {
            "weights: by the discrepancy principle from the noise; from the model error if \
                         that is larger"
                .to_owned()
        }
    }
}

/// Describes whether the time term is used.
fn coupling(skin: &Skin, method: Method, sequence: Sequence, known: bool) -> String {
    let none = method == Method::Tv || skin.settings.reconstruction.lambda_time == Some(0.0);
    let couples = match sequence {
        Sequence::Frames(1) => {
            return "time term: dropped, one frame is plain total variation".to_owned();
        }
        Sequence::Still(count) => {
            return format!(
                "time term: dropped, the {count} frames do not differ from each other beyond noise \
                 (a static scene): one image of their mean by plain total variation"
            );
        }
        _ if none => return "time term: none, plain total variation of each frame".to_owned(),
        Sequence::Frames(count) => format!("time term: couples {count} frames"),
        Sequence::Unknown => {
            "time term: couples the frames; dropped for a single one (plain total \
                              variation)"
                .to_owned()
        }
    };
    // frames outside the quiet range may still be equal, which the plan does not check
    let still = "dropped, with one image of the mean, if the frames do not differ from each other \
                 beyond noise (a static scene)";
    if known { format!("{couples}; {still}") } else { couples }
}
