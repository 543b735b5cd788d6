//! The file of a body.

use super::Placement;
use crate::error::PublishError;
use crate::ros::check_topic;
use crate::zenoh_sink::SessionSettings;
use eit_skin::scene::from_toml;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The patches of a robot, and how to reach them.
#[derive(Debug, Clone, PartialEq)]
pub struct BodySettings {
    /// Name of the robot's frame, in which touches are given.
    pub frame_id: String,
    /// The joined list is published under this topic followed by `/touches`; `None` publishes nothing.
    pub topic: Option<String>,
    /// Domain of ROS 2.
    pub domain: u32,
    /// Time without a message after which a patch counts as silent.
    pub silent_after: Duration,
    /// Shortest time between two lists.
    pub period: Duration,
    /// The zenoh session.
    pub session: SessionSettings,
    /// Skins that make up the body.
    pub patches: Vec<PatchSettings>,
}

/// A skin on the body: where its touches come from and where it lies.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSettings {
    /// Name in the joined list.
    pub name: String,
    /// Topic of the patch, such as `skin/left_arm`.
    pub topic: String,
    /// Where it is on the robot.
    pub placement: Placement,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default = "robot")]
    frame: String,
    topic: Option<String>,
    #[serde(default)]
    domain: u32,
    #[serde(default = "silence")]
    silent_after_s: f64,
    #[serde(default = "rate")]
    max_rate_hz: f64,
    #[serde(default)]
    zenoh: Zenoh,
    patch: Vec<Patch>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Zenoh {
    connect: Vec<String>,
    listen: Vec<String>,
    config: Option<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Patch {
    name: String,
    topic: String,
    #[serde(default)]
    position_m: [f64; 3],
    quaternion: Option<[f64; 4]>,
    rpy_deg: Option<[f64; 3]>,
}

fn robot() -> String {
    "base_link".to_owned()
}

/// By default, three heartbeats may be lost.
fn silence() -> f64 {
    0.35
}

fn rate() -> f64 {
    100.0
}

impl BodySettings {
    /// Reads a file. A zenoh configuration that it names is relative to its folder.
    ///
    /// # Errors
    ///
    /// [`PublishError::Body`], which names the wrong line, key or patch.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, PublishError> {
        let path = path.as_ref();
        let refuse =
            |message: String| PublishError::Body { path: path.display().to_string(), message };
        // the error names the file, too
        let begin = format!("{}: ", path.display());
        let text = eit_skin::scene::read_settings(path).map_err(|error| {
            let message = error.to_string();
            refuse(message.strip_prefix(&begin).map_or(message.clone(), str::to_owned))
        })?;
        let mut settings = Self::parse(&text).map_err(refuse)?;
        if let (Some(config), Some(folder)) = (&mut settings.session.config, path.parent()) {
            *config = folder.join(&*config);
        }
        Ok(settings)
    }

    /// Parses the text of such a file.
    ///
    /// # Errors
    ///
    /// A sentence that names the wrong line, key or patch.
    pub fn parse(text: &str) -> Result<Self, String> {
        let file: File = from_toml(text, "body").map_err(|error| error.to_string())?;
        let in_range = |name: &str, value: f64, least: f64, most: f64| {
            let message = format!("{name} = {value}: it must be {least} to {most}");
            if (least..=most).contains(&value) { Ok(value) } else { Err(message) }
        };
        let silent_after_s = in_range("silent_after_s", file.silent_after_s, 0.05, 60.0)?;
        let rate_hz = in_range("max_rate_hz", file.max_rate_hz, 0.1, 10_000.0)?;
        if file.patch.is_empty() {
            return Err("no patch: add a table [[patch]] with name and topic".to_owned());
        }
        let (mut names, mut topics) = (BTreeSet::new(), BTreeSet::new());
        for patch in &file.patch {
            if !names.insert(&patch.name) {
                return Err(format!("two patches are named {}", patch.name));
            }
            if !topics.insert(patch.topic.trim_start_matches('/')) {
                return Err(format!("two patches share the topic {}", patch.topic));
            }
        }
        if let Some(topic) = &file.topic {
            check_topic(topic).map_err(|error| format!("topic: {error}"))?;
        }
        Ok(Self {
            frame_id: file.frame,
            topic: file.topic,
            domain: file.domain,
            silent_after: Duration::from_secs_f64(silent_after_s),
            period: Duration::from_secs_f64(1.0 / rate_hz),
            session: SessionSettings {
                connect: file.zenoh.connect,
                listen: file.zenoh.listen,
                config: file.zenoh.config,
                is_hub: true,
            },
            patches: file.patch.into_iter().map(PatchSettings::new).collect::<Result<_, _>>()?,
        })
    }
}

impl PatchSettings {
    fn new(patch: Patch) -> Result<Self, String> {
        let name = patch.name;
        let within = |message: String| format!("patch {name}: {message}");
        check_topic(&patch.topic).map_err(|error| within(format!("topic: {error}")))?;
        let numbers = patch.position_m.iter().chain(patch.quaternion.iter().flatten());
        if numbers.chain(patch.rpy_deg.iter().flatten()).any(|number| !number.is_finite()) {
            return Err(within("position_m, quaternion and rpy_deg must be finite".to_owned()));
        }
        let placement = match (patch.quaternion, patch.rpy_deg) {
            (Some(_), Some(_)) => {
                return Err(within("give quaternion or rpy_deg, not both".to_owned()));
            }
            (Some(quaternion), None) => {
                let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
                if (length - 1.0).abs() > 1e-3 {
                    let message = format!("quaternion has length {length}: it must be 1 to 0.1 %");
                    return Err(within(message));
                }
                Placement::new(patch.position_m, quaternion)
            }
            (None, angles) => {
                let angles = angles.unwrap_or_default().map(f64::to_radians);
                Placement::from_angles(patch.position_m, angles)
            }
        };
        Ok(Self { topic: patch.topic.trim_start_matches('/').to_owned(), placement, name })
    }
}
