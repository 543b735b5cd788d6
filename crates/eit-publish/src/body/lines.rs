//! What a body reports, as JSON lines (docs/BODY.md).

use super::{Body, BodyNews, BodySettings, PlacedTouch};
use crate::publisher::clock_s;
use crate::ros::touch_state;
use serde_json::{Value, json};

/// Version of the lines.
const VERSION: u32 = 1;

impl Body {
    /// Returns the line that starts the stream.
    pub fn start_line(&self, settings: &BodySettings) -> Value {
        let patches: Vec<&str> = settings.patches.iter().map(|patch| patch.name.as_str()).collect();
        json!({
            "type": "start", "version": VERSION, "frame": settings.frame_id, "patches": patches,
            "time_s": clock_s(),
        })
    }

    /// Returns the line for an event.
    pub fn line(&self, news: &BodyNews) -> Value {
        match news {
            BodyNews::Touches(list) => {
                let touches: Vec<Value> =
                    list.touches.iter().map(|placed| self.touch(placed)).collect();
                json!({ "type": "touches", "time_s": list.time_s, "touches": touches })
            }
            BodyNews::Silent { patch, for_s, was_heard } => json!({
                "type": "event", "event": "silent", "patch": self.name(*patch), "for_s": for_s,
                "was_heard": was_heard, "time_s": clock_s(),
            }),
            BodyNews::Back { patch, after_s } => json!({
                "type": "event", "event": "back", "patch": self.name(*patch), "after_s": after_s,
                "time_s": clock_s(),
            }),
            BodyNews::Unreadable { patch, reason } => json!({
                "type": "event", "event": "unreadable", "patch": self.name(*patch),
                "reason": reason, "time_s": clock_s(),
            }),
        }
    }

    /// Returns the line that ends the stream.
    pub fn end_line(&self, lists: u64) -> Value {
        json!({ "type": "event", "event": "ended", "lists": lists, "time_s": clock_s() })
    }

    fn touch(&self, placed: &PlacedTouch) -> Value {
        let touch = &placed.touch;
        let state = match touch.state {
            touch_state::BEGIN => "begin",
            touch_state::END => "end",
            _ => "hold",
        };
        let std_m = [0, 4, 8].map(|index| touch.position_covariance[index].max(0.0).sqrt());
        json!({
            "patch": self.name(placed.patch),
            "epoch": placed.epoch,
            "id": touch.id,
            "state": state,
            "time_s": placed.time_s,
            "position_m": <[f64; 3]>::from(touch.position),
            "position_std_m": std_m,
            "velocity_m_s": <[f64; 3]>::from(touch.velocity),
            "intensity_s_m2": touch.intensity,
            "intensity_std_s_m2": touch.intensity_std,
            "force_n": touch.force,
            "force_std_n": touch.force_std,
            "confidence": touch.confidence,
            "valid": touch.valid,
            "whole": touch.whole,
            "age_s": touch.age,
        })
    }
}
