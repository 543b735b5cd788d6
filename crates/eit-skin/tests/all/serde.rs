//! Touches, faults and settings as JSON and back, and positions as points of `mint`.

use eit_skin::mint::{Point3, Vector3};
use eit_skin::scene::StageSettings;
use eit_skin::touches::Touches;
use eit_skin::{Scene, Skin, Touch, TouchState};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

/// A value after JSON, checked to be the same.
fn again<T: Serialize + DeserializeOwned + std::fmt::Debug>(value: &T) -> T {
    let again = serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap();
    assert_eq!(format!("{again:?}"), format!("{value:?}"));
    again
}

fn touch() -> serde_json::Value {
    json!({
        "id": 3, "state": "Hold", "position_m": [0.01, -0.02, 0.0], "normal": [0.0, 0.0, 1.0],
        "position_covariance_m2": [[1e-7, 0.0, 0.0], [0.0, 1e-7, 0.0], [0.0, 0.0, 0.0]],
        "velocity_m_s": [0.1, 0.0, 0.0], "intensity_s_m2": 1e-9,
        "intensity_std_s_m2": 1e-11, "peak_s": 2e-6,
        "learnt": {"force_n": [1.5, 0.1], "is_unlike": false},
        "confidence": 0.99, "age_frames": 12, "age_s": 0.6, "valid": true, "whole": true,
        "split_from": null, "merged_into": 2
    })
}

#[test]
fn a_touch_survives_and_has_points_of_mint() {
    let read: Touch = serde_json::from_value(touch()).unwrap();
    assert_eq!(again(&read), read);
    assert_eq!((read.state, read.force_n()), (TouchState::Hold, Some(1.5)));
    assert_eq!(read.position(), Point3 { x: 0.01, y: -0.02, z: 0.0 });
    assert_eq!(read.normal_vector(), Some(Vector3 { x: 0.0, y: 0.0, z: 1.0 }));
    assert_eq!(read.velocity(), Vector3 { x: 0.1, y: 0.0, z: 0.0 });
}

#[test]
fn touches_of_a_recording_survive() {
    let text = json!({
        "rows": [{"frame": 4, "time_s": 0.2, "touch": touch()}], "frames": 5, "first_frame": 0, "rate_hz": 20.0, "level_s": 1e-7,
        "choices": {
            "noise": "stated", "sheet": null, "rows": 104, "places": 300, "blind_places": 0, "radius_m": 0.01,
            "least_s_m2": 1e-10
        },
        "faults": [{"electrode": 2, "kind": "Stuck", "since_s": 0.1}],
        "steps": [{
            "rows": 104, "chi_square": 5e3, "chi_square_without": 4.9e3, "chi_square_rest": 110.0, "blamed": null,
            "is_explained": true
        }],
        "not_explained": [3], "frozen": [],
        "is_missing": {"v": 1, "dim": [1, 2], "data": [true, false]}
    });
    let read: Touches = serde_json::from_value(text).unwrap();
    assert!(again(&read).steps[0].is_explained);
}

#[test]
fn settings_of_a_scene_survive() {
    let skin = Skin::from_scene(Scene::load("paper-disc").unwrap()).unwrap();
    let _: StageSettings = again(&skin.settings);
}
