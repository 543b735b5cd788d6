//! The touches of a frame as Foxglove draws them (schema `foxglove.SceneUpdate`), so that a recording shows them as it is.

use super::record::TouchesRecord;
use serde::Deserialize;
use serde_json::{Value, json};

/// Topic of the scenes. Readers of recordings pass over it: it follows from the touches.
pub(super) const TOPIC: &str = "/eit/scene";
pub(super) const SCHEMA: (&str, &str) = ("foxglove.SceneUpdate", include_str!("scene.schema.json"));

/// Frame in which touches are drawn.
const FRAME_ID: &str = "skin";
/// Width of a fingertip, metres.
const TIP_M: f64 = 12e-3;
/// Touches vanish when nothing follows for so long, nanoseconds.
const LIFETIME_NS: u32 = 500_000_000;

#[derive(Deserialize)]
struct Frame {
    #[serde(default)]
    state: Option<String>,
    touches: Vec<Touch>,
}

#[derive(Deserialize)]
struct Touch {
    id: u64,
    #[serde(default)]
    state: Option<String>,
    position_m: [f64; 3],
    #[serde(default)]
    valid: Option<bool>,
    #[serde(default)]
    force_n: Option<f64>,
}

/// Returns the scene of a frame, and whether it shows anything; `None` if the touches cannot be drawn.
pub(super) fn of(touches: &TouchesRecord, time_ns: u64) -> Option<(Value, bool)> {
    let frame: Frame = serde_json::from_str(touches.json()).ok()?;
    let (mut spheres, mut texts) = (Vec::new(), Vec::new());
    for touch in &frame.touches {
        if touch.state.as_deref() == Some("end") {
            continue;
        }
        let [x, y, z] = touch.position_m;
        let alpha = if touch.valid.unwrap_or(true) { 0.9 } else { 0.35 };
        spheres.push(json!({
            "pose": pose([x, y, z]), "size": { "x": TIP_M, "y": TIP_M, "z": TIP_M }, "color": red(alpha),
        }));
        let label = match touch.force_n {
            Some(force_n) => format!("{} {force_n:.1} N", touch.id),
            None => touch.id.to_string(),
        };
        texts.push(text([x, y, z + TIP_M], &label));
    }
    if let Some(state) = frame.state.filter(|state| state != "sound") {
        texts.push(text([0.0; 3], &format!("not known: {}", state.replace('_', " "))));
    }
    let is_seen = !texts.is_empty();
    let time = json!({ "sec": time_ns / 1_000_000_000, "nsec": time_ns % 1_000_000_000 });
    let entity = json!({
        "timestamp": time, "frame_id": FRAME_ID, "id": "touches",
        "lifetime": { "sec": 0, "nsec": LIFETIME_NS }, "frame_locked": true, "metadata": [],
        "arrows": [], "cubes": [], "spheres": spheres, "cylinders": [], "lines": [], "triangles": [],
        "texts": texts, "models": [],
    });
    Some((json!({ "deletions": [], "entities": [entity] }), is_seen))
}

fn red(alpha: f64) -> Value {
    json!({ "r": 0.9, "g": 0.15, "b": 0.2, "a": alpha })
}

fn pose([x, y, z]: [f64; 3]) -> Value {
    json!({
        "position": { "x": x, "y": y, "z": z }, "orientation": { "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 },
    })
}

fn text(at: [f64; 3], text: &str) -> Value {
    json!({
        "pose": pose(at), "billboard": true, "font_size": 14.0, "scale_invariant": true, "color": red(1.0),
        "text": text,
    })
}
