//! The examples run, and show what they promise.
#![allow(dead_code, reason = "the examples' own `main` is not called")]

#[path = "../../examples/image_stack.rs"]
mod image_stack;

/// A number divided by itself is one exactly.
#[test]
fn image_stack_example() {
    assert_eq!(image_stack::run().unwrap(), 1.0);
}

#[cfg(feature = "unet")]
#[path = "../../examples/clean.rs"]
mod clean;

/// Frames that the net has not seen. Measured: 0.06 to 0.08 of the raw images' error; a fifth is what
/// `weights/README.md` promises for nine frames of ten with one finger.
#[cfg(feature = "unet")]
#[test]
fn clean_example() {
    let parts = clean::run().unwrap();
    assert_eq!(parts.len(), 3);
    assert!(parts.iter().all(|part| *part < 0.2), "{parts:?}");
}

#[cfg(feature = "unet")]
#[path = "../../examples/frame_time.rs"]
mod frame_time;

/// The count of operations is right: each multiply-add of the 1 x 1 head and of the first
/// convolution by hand, and a net of twice the width costs about four times as much.
#[cfg(feature = "unet")]
#[test]
fn frame_time_example() {
    let costs = frame_time::run().unwrap();
    let of = |width| {
        let shape = eit_denoise::UnetShape { width, ..Default::default() };
        costs.iter().find(|cost| cost.shape == shape).unwrap()
    };
    let [four, eight] = [of(4), of(8)];
    // per pixel: level 0 (2 4 + 4 4 + 12 4 + 4 4) 9 + 4, level 1 (4 8 + 8 8 + 24 8 + 8 8) 9 / 4,
    // level 2 (8 16 + 16 16 + 48 16 + 16 16) 9 / 16, bottom (16 32 + 32 32) 9 / 64
    let by_hand = 88.0 * 9.0 + 4.0 + 352.0 * 9.0 / 4.0 + 1408.0 * 9.0 / 16.0 + 1536.0 * 9.0 / 64.0;
    assert_eq!(four.multiply_adds, 4096.0 * by_hand);
    let ratio = eight.multiply_adds / four.multiply_adds;
    assert!((3.5..4.0).contains(&ratio), "{ratio}");
    assert!(costs.iter().all(|cost| cost.time_s > 0.0 && cost.parameters > 0));
}

#[cfg(feature = "train")]
#[path = "../../examples/step_time.rs"]
mod step_time;

/// All is timed, and what others compare with is written.
#[cfg(feature = "train")]
#[test]
fn step_time_example() {
    let folder = tempfile::tempdir().unwrap();
    let shape = eit_denoise::UnetShape { width: 2, depth: 2, ..Default::default() };
    let cost = step_time::run(shape, 0.0, Some(folder.path())).unwrap();
    assert!(cost.step_s > 0.0 && cost.image_s > 0.0 && cost.burn_image_s > 0.0);
    assert_eq!(cost.gradient.len(), shape.parameters());
    assert!(cost.gradient.iter().any(|d| *d != 0.0));
    let bytes = std::fs::read(folder.path().join("parameters.f32")).unwrap();
    assert_eq!(bytes.len(), 4 * shape.parameters());
}
