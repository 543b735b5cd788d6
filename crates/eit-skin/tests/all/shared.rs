//! Skins and what is computed with them can be shared between threads; a sensor can be moved to one.

#[test]
fn types_are_send_and_sync() {
    fn shared<T: Send + Sync + Clone + std::fmt::Debug>() {}
    shared::<eit_skin::Scene>();
    shared::<eit_skin::Skin>();
    shared::<eit_skin::LinearisedSkin>();
    shared::<eit_skin::FittedFrames>();
    shared::<eit_skin::LiveModel>();
    shared::<eit_skin::Touch>();
    shared::<eit_skin::touches::TouchFinder>();
    shared::<eit_skin::touches::Touches>();
    shared::<eit_skin::StopFlag>();
    fn moves<T: Send + std::fmt::Debug>() {}
    moves::<eit_skin::LiveStream>();
    moves::<eit_skin::Sensor>();
    moves::<eit_skin::Progress>();
    fn error<T: Send + Sync + std::error::Error + 'static>() {}
    error::<eit_skin::SkinError>();
}
