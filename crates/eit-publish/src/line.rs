//! Content of the lines. Fields are described in `schema/touches.schema.json` and docs/JSON_LINES.md.

use eit_skin::TouchFrame;
use serde::Serialize;

/// The first line: describes the skin and its source.
#[derive(Serialize)]
#[serde(tag = "type", rename = "start")]
pub(crate) struct StartLine<'a> {
    pub(crate) version: u32,
    pub(crate) skin: &'a str,
    pub(crate) instrument: &'a str,
    pub(crate) electrodes: usize,
    pub(crate) reference_frames: usize,
    pub(crate) epoch: u32,
    pub(crate) host_time_s: Option<f64>,
}

/// An event between frames.
#[derive(Serialize, Default)]
#[serde(tag = "type", rename = "event")]
pub(crate) struct EventLine<'a> {
    pub(crate) event: &'static str,
    pub(crate) text: &'a str,
    pub(crate) host_time_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) frames: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) for_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) epoch: Option<u32>,
}

/// The touches of one frame, with the fields that every output has.
#[derive(Serialize)]
#[serde(tag = "type", rename = "frame")]
pub(crate) struct FrameLine<'a> {
    #[serde(flatten)]
    pub(crate) frame: &'a TouchFrame<'a>,
}
