//! Frames, recordings, settings and reports can be shared between threads; sessions can be moved to one.

use eit_hw::{Frame, FrameMap, HealthReport, HwError, MeasuredFrames, Recording, codec, driver};

#[test]
fn types_are_send_and_sync() {
    fn shared<T: Send + Sync + std::fmt::Debug>() {}
    shared::<(Frame, Recording, MeasuredFrames, FrameMap, HealthReport, HwError)>();
    shared::<(driver::SessionSettings, codec::eits1::Decoder)>();
    shared::<(codec::sciospec::Decoder, codec::text::Decoder)>();
    fn moves<T: Send + std::fmt::Debug>() {}
    moves::<(driver::Session, driver::Replay, eit_hw::capture::CaptureWriter, eit_hw::Link)>();
}
