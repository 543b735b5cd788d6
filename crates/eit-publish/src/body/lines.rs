//! What a body reports, as JSON lines (docs/BODY.md).

use super::{Body, BodyNews, BodySettings, PlacedTouch};
use crate::publisher::clock_s;
use crate::ros::skin_state;
use eit_skin::TouchFields;
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
                let patches: Vec<Value> = self
                    .patches()
                    .iter()
                    .map(|patch| json!({ "patch": patch.name, "state": skin_state::of(patch.state).name() }))
                    .collect();
                json!({
                    "type": "touches", "time_s": list.time_s, "patches": patches, "touches": touches,
                })
            }
            BodyNews::Silent { patch, for_s, was_heard } => json!({
                "type": "event", "event": "silent", "patch": self.name(*patch), "for_s": for_s,
                "was_heard": was_heard, "time_s": clock_s(),
            }),
            BodyNews::Back { patch, after_s } => json!({
                "type": "event", "event": "back", "patch": self.name(*patch), "after_s": after_s,
                "time_s": clock_s(),
            }),
            BodyNews::State { patch, state } => json!({
                "type": "event", "event": "state", "patch": self.name(*patch),
                "state": state.name(), "time_s": clock_s(),
            }),
            BodyNews::TwoPublishers { patch } => json!({
                "type": "event", "event": "two_publishers", "patch": self.name(*patch),
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

    /// The fields that every output has, in the robot's frame, and those of the patch.
    fn touch(&self, placed: &PlacedTouch) -> Value {
        let fields = serde_json::to_value(TouchFields::from(&placed.touch)).unwrap_or_default();
        let mut touch = json!({
            "patch": self.name(placed.patch), "epoch": placed.epoch, "time_s": placed.time_s,
        });
        if let (Value::Object(touch), Value::Object(fields)) = (&mut touch, fields) {
            touch.extend(fields);
        }
        touch
    }
}
