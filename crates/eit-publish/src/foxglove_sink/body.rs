//! Many patches in Foxglove.

use super::draw::{Painter, pose};
use super::{OUTLINE_EVERY, SCENE_EVERY, serve, timestamp, write};
use crate::body::{Body, BodyNews, BodySettings};
use crate::error::PublishError;
use eit_skin::TouchFields;
use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, Quaternion, SceneUpdate, Timestamp, log,
};
use foxglove::{Channel, Context, WebSocketServerHandle};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

/// Shows the touches of a body in the robot's frame, the frames of its patches, and what happens to them (features `foxglove`, `zenoh`):
/// topics `/body/scene`, `/tf` and `/body/log`. Access is that of [`FoxgloveSink`](crate::FoxgloveSink).
#[derive(Debug)]
pub struct FoxgloveBody {
    scene: Channel<SceneUpdate>,
    frames: Channel<FrameTransforms>,
    log: Channel<Log>,
    /// Channels are closed when it is dropped.
    _context: Arc<Context>,
    server: Option<WebSocketServerHandle>,
    address: SocketAddr,
    painter: Painter,
    /// Robot's frame, and name and pose of each patch in it.
    patches: Vec<FrameTransform>,
    told: Option<Instant>,
    last_scene: Option<Instant>,
}

impl FoxgloveBody {
    /// Starts a server at HOST:PORT (port 0: any free port).
    ///
    /// # Errors
    ///
    /// An address that cannot be used.
    pub fn new(place: &str, settings: &BodySettings) -> Result<Self, PublishError> {
        let context = Context::new();
        let (server, address) = serve(&context, place)?;
        let patch = |patch: &crate::body::PatchSettings| {
            let at = patch.placement.pose();
            let [x, y, z] = at.position.into();
            let crate::ros::Quaternion { x: qx, y: qy, z: qz, w } = at.orientation;
            FrameTransform {
                timestamp: None,
                parent_frame_id: settings.frame_id.clone(),
                child_frame_id: patch.name.clone(),
                translation: pose([x, y, z]).position,
                rotation: Some(Quaternion { x: qx, y: qy, z: qz, w }),
            }
        };
        Ok(Self {
            scene: context.channel_builder("/body/scene").build(),
            frames: context.channel_builder("/tf").build(),
            log: context.channel_builder("/body/log").build(),
            _context: context,
            server: Some(server),
            address,
            painter: Painter::new(&settings.frame_id),
            patches: settings.patches.iter().map(patch).collect(),
            told: None,
            last_scene: None,
        })
    }

    /// Address of the server.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Shows what a body reports.
    pub fn show(&mut self, body: &Body, news: &BodyNews) {
        let BodyNews::Touches(list) = news else {
            let level = match news {
                BodyNews::Back { .. } => log::Level::Info,
                _ => log::Level::Warning,
            };
            let line = body.line(news);
            let word = |key: &str| line[key].as_str().unwrap_or_default().to_owned();
            let text = format!("{}: {} {}", word("patch"), word("event"), word("state"));
            write(&self.log, level, timestamp(None), text.trim_end().to_owned());
            return;
        };
        let time = timestamp(Some(list.time_s));
        self.tell_frames(time);
        let has_end =
            list.touches.iter().any(|placed| placed.touch.state == crate::ros::touch_state::END);
        if !has_end && self.last_scene.is_some_and(|last| last.elapsed() < SCENE_EVERY) {
            return;
        }
        self.last_scene = Some(Instant::now());
        let touches = list.touches.iter().map(|placed| TouchFields::from(&placed.touch));
        let entity = self.painter.touched(touches, body.not_known(), time);
        let update = SceneUpdate { deletions: Vec::new(), entities: vec![entity] };
        self.scene.log_with_time(&update, time);
    }

    /// Repeats the poses of the patches: a new client is shown only what is sent from then on.
    fn tell_frames(&mut self, time: Timestamp) {
        if self.told.is_some_and(|last| last.elapsed() < OUTLINE_EVERY) {
            return;
        }
        self.told = Some(Instant::now());
        self.patches.iter_mut().for_each(|patch| patch.timestamp = Some(time));
        let transforms = FrameTransforms { transforms: self.patches.clone() };
        self.frames.log_with_time(&transforms, time);
    }
}

impl Drop for FoxgloveBody {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
    }
}
