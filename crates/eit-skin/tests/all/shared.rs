//! Skins and what is computed with them can be shared between threads; a sensor can be moved to one.

use eit_skin::touches::{TouchFinder, Touches};
use eit_skin::{FittedFrames, LinearisedSkin, LiveModel, LiveStream, Progress, Scene, Sensor};
use eit_skin::{Skin, SkinError, StopFlag, Touch};

#[test]
fn types_are_send_and_sync() {
    fn shared<T: Send + Sync + Clone + std::fmt::Debug>() {}
    shared::<(Scene, Skin, LinearisedSkin, FittedFrames, LiveModel, Touch, TouchFinder, Touches)>();
    shared::<StopFlag>();
    fn moves<T: Send + std::fmt::Debug>() {}
    moves::<(LiveStream, Sensor, Progress)>();
    fn error<T: Send + Sync + std::error::Error + 'static>() {}
    error::<SkinError>();
}
