//! What the data cannot tell is said, and no touch that depends on it is valid.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::Bench;
use crate::common::score::acted_on;
use crate::common::script::Drawn;
use eit_skin::plan::Plan;
use eit_skin::scene::Scene;
use eit_skin::touches::Touches;
use eit_skin::{Progress, Skin};

const MODELS: [&str; 2] = ["search", "one-score"];

fn scene(text: &str, touch: &str) -> Scene {
    Scene::parse(&format!("{text}\n[touch]\n{touch}\n"), "scene").unwrap()
}

fn valid(touches: &Touches) -> usize {
    (0..touches.frames).map(|frame| acted_on(touches, frame).len()).sum()
}

/// Driven and measured across a disc, a touch and the one opposite it have the same voltages. Half of them were shown at the
/// wrong place, with confidence 0.998.
#[test]
fn places_that_a_protocol_cannot_tell_apart() {
    let text = Scene::text("paper-disc").unwrap();
    let ([found, twice], mut shares) = ([Drawn::new(11, 1), Drawn::new(12, 1)], Vec::new());
    for (pattern, mut drawn) in [("adjacent", found), ("opposite", twice)] {
        let text = text
            .replace("drive = \"adjacent\"", &format!("drive = \"{pattern}\""))
            .replace("measure = \"adjacent\"", &format!("measure = \"{pattern}\""));
        (0..3).for_each(|_| _ = drawn.press(0.7..2.0));
        let skin = Skin::from_scene(Scene::parse(&text, "scene").unwrap()).unwrap();
        let plan = Plan::of(skin, None, &mut Progress::silent()).unwrap();
        let is_alike = pattern == "opposite";
        assert_eq!(plan.text().contains("give the same voltages"), is_alike, "{}", plan.text());
        for model in MODELS {
            let scene = || scene(&text, &format!("model = \"{model}\""));
            let bench = Bench::believing(scene(), scene());
            let touches = bench.touches(&bench.simulate(&drawn.script(), 11));
            let told = touches.choices.warnings().join(" ").contains("give the same voltages");
            println!("{pattern}, {model}: twins {}, {}", touches.choices.twins, valid(&touches));
            assert_eq!(told, is_alike, "{pattern} {model}");
            shares.push((touches.choices.twins, valid(&touches), touches.rows.len()));
        }
    }
    // measured 0 and 0.74; every touch is listed, none is valid
    assert!(shares[..2].iter().all(|(twins, valid, _)| *twins == 0.0 && *valid > 30), "{shares:?}");
    assert!(
        shares[2..].iter().all(|(twins, valid, rows)| *twins > 0.4 && *valid == 0 && *rows > 30)
    );
}
