//! What the data cannot tell is said, and no touch that depends on it is valid.

use crate::common::*;
use eit_skin::plan::Plan;
use eit_skin::scene::Scene;
use eit_skin::{Progress, Skin};

/// Driven and measured across a disc, a touch and the one opposite it have the same voltages.
#[test]
fn places_that_a_protocol_cannot_tell_apart() {
    for (pattern, seed) in [("adjacent", 11), ("opposite", 12)] {
        let measure = format!("measure = \"{pattern}\"");
        let text = with_drive(pattern).replace("measure = \"adjacent\"", &measure);
        let skin = Skin::from_scene(Scene::parse(&text, "scene").unwrap()).unwrap();
        let plan = Plan::of(skin, None, &mut Progress::silent()).unwrap();
        let is_alike = pattern == "opposite";
        assert_eq!(plan.text().contains("give the same voltages"), is_alike, "{}", plan.text());
        let [search, one_score] = ["search", "one-score"]
            .map(|model| Bench::of_text(&format!("{text}\n[touch]\nmodel = \"{model}\"\n")));
        let [recording] = search.draw([seed], 1, |drawn, _| drawn.presses(3, 0.7..2.0));
        for bench in [&search, &one_score] {
            let touches = bench.touches(&recording);
            let told = touches.choices.warnings().join(" ").contains("give the same voltages");
            let frames = 0..touches.frames;
            let valid: usize = frames.map(|frame| acted_on(&touches, frame).len()).sum();
            let (twins, listed) = (touches.choices.twins, touches.rows.len());
            assert_eq!(told, is_alike, "{pattern}");
            // measured 0 and 0.74; every touch is listed, none is valid
            let is_right = [twins == 0.0 && valid > 30, twins > 0.4 && valid == 0 && listed > 30];
            assert!(is_right[usize::from(is_alike)], "{pattern}: {twins}, {valid} of {listed}");
        }
    }
}
