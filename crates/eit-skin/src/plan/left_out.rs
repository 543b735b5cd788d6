//! What a plan leaves out, and why.

use super::sequence::Sequence;
use crate::method::Method;
use crate::pipeline::Setup;
use crate::scene::Scene;

/// What the scene does not use, and why.
pub fn of(
    scene: &Scene,
    setup: &Setup,
    method: Method,
    sequence: Sequence,
) -> Vec<(&'static str, String)> {
    let cost = setup.model.cost();
    let patterns = setup.protocol.stimulations_a().nrows();
    let (m, products) = (setup.protocol.measurements(), cost.field_products);
    let mut list = vec![
        ("complex arithmetic", scene.why_real().to_owned()),
        (
            "forward sweeps",
            "currents enter at electrodes only, which are eliminated last".to_owned(),
        ),
        (
            "field solves",
            format!(
                "{} of {} patterns: the others are combinations",
                {
                    (patterns + setup.protocol.measurement_patterns().nrows())
                        .saturating_sub(cost.field_solves)
                },
                patterns + setup.protocol.measurement_patterns().nrows()
            ),
        ),
    ];
    if m > products {
        let why = format!("{} of {m} rows are multiples of others (reciprocity)", m - products);
        list.push(("Jacobian products", why));
    }
    list.extend(of_method(scene, method, sequence));
    if scene.reconstruction.electrode_movement_m.is_none() && method != Method::GaussNewtonAbsolute
    {
        let why = "no reconstruction.electrode_movement_m: electrodes are taken to stay; where the rim of \
                   a fabric gives way, touches come with spots at electrodes";
        list.push(("electrode movement", why.to_owned()));
    }
    if scene.denoise.is_none() {
        list.push(("U-net", "the scene has no [denoise]".to_owned()));
    }
    if scene.instrument.is_none() {
        list.push(("instrument", "the scene has no [instrument]: recorded frames only".to_owned()));
    }
    list
}

/// What the method leaves out on this scene.
fn of_method(scene: &Scene, method: Method, sequence: Sequence) -> Vec<(&'static str, String)> {
    let keys = &scene.reconstruction;
    let mut list = Vec::new();
    let by_itself = match method {
        Method::GaussNewton => Some("one-step Gauss-Newton takes each frame by itself"),
        Method::GaussNewtonAbsolute => Some("each frame by itself, from the image of the last one"),
        Method::StTv | Method::Tv if sequence == Sequence::Frames(1) => {
            Some("a recording of one frame: plain total variation in space")
        }
        Method::StTv | Method::Tv if matches!(sequence, Sequence::Still(_)) => {
            Some("a static scene: one image of the mean, by plain total variation in space")
        }
        Method::Tv => Some("method \"tv\" takes each frame by itself"),
        Method::StTv if keys.lambda_time == Some(0.0) => Some("lambda_time = 0"),
        _ => None,
    };
    list.extend(by_itself.map(|why| ("time coupling", why.to_owned())));
    if method.is_tv() {
        if keys.lower_s.is_none() && keys.upper_s.is_none() {
            let why = "no lower_s or upper_s: where a touch only raises the conductivity, lower_s = \
                       0 makes images better";
            list.push(("bounds", why.to_owned()));
        }
        list.push(("prior, hyperparameter", "total variation has weights instead".to_owned()));
    } else {
        list.push(("total variation", format!("method \"{}\" has none", method.name())));
    }
    list
}
