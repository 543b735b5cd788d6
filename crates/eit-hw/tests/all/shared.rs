//! Frames, recordings, settings and reports can be shared between threads; sessions can be moved to one.

#[test]
fn types_are_send_and_sync() {
    fn shared<T: Send + Sync + std::fmt::Debug>() {}
    shared::<eit_hw::Frame>();
    shared::<eit_hw::Recording>();
    shared::<eit_hw::MeasuredFrames>();
    shared::<eit_hw::FrameMap>();
    shared::<eit_hw::HealthReport>();
    shared::<eit_hw::HwError>();
    shared::<eit_hw::driver::SessionSettings>();
    shared::<eit_hw::codec::eits1::Decoder>();
    shared::<eit_hw::codec::sciospec::Decoder>();
    shared::<eit_hw::codec::text::Decoder>();
    fn moves<T: Send + std::fmt::Debug>() {}
    moves::<eit_hw::driver::Session>();
    moves::<eit_hw::driver::Replay>();
    moves::<eit_hw::capture::CaptureWriter>();
    moves::<eit_hw::Link>();
}
