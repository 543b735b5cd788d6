//! Frames, settings and results as JSON and back.
use serde::Serialize;
use serde::de::DeserializeOwned;

fn again<T: Serialize + DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

/// Types that compare equal after JSON.
fn same<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    assert_eq!(again(value), *value);
}

use eit_hw::driver::{Backoff, SessionSettings};
use eit_hw::{Endpoint, Frame, Layout, Quality, ReadOptions, Unit};

fn frame() -> Frame {
    Frame {
        values: vec![1.5e-3, f64::NAN],
        imaginary: None,
        quality: vec![Quality::GOOD, Quality::NON_FINITE | Quality::MISSING],
        sequence: 7,
        epoch: 1,
        device_time_s: Some(0.25),
        host_time_s: None,
    }
}

/// JSON has no NaN: it holds `null`, which a frame reads as NaN.
#[test]
fn a_missing_value_of_a_frame_survives() {
    let text = serde_json::to_string(&frame()).unwrap();
    assert!(text.contains("[0.0015,null]") && text.contains("[0,48]"), "{text}");
    let read: Frame = serde_json::from_str(&text).unwrap();
    assert_eq!(read.values[0], 1.5e-3);
    assert!(read.values[1].is_nan());
    assert_eq!(read.quality, frame().quality);
    assert_eq!((read.sequence, read.epoch, read.device_time_s), (7, 1, Some(0.25)));
}

#[test]
fn unknown_flags_are_an_error() {
    assert!(serde_json::from_str::<Quality>("64").is_err());
    assert_eq!(serde_json::from_str::<Quality>("5").unwrap(), Quality::SATURATED | Quality::OPEN);
}

#[test]
fn settings_survive() {
    // infinite: never gives up
    same(&Backoff::default());
    same(&SessionSettings::default());
    same(&ReadOptions { complex: true, ..ReadOptions::default() });
    same(&Layout::Quadruples(vec![[0, 1, 2, 3]]));
    same(&Unit::Ohm);
    same(&Endpoint::Serial { path: "/dev/ttyACM0".into(), baud: 115_200, dtr: Some(true) });
    assert!(serde_json::from_str::<SessionSettings>(r#"{"capacity":3,"overflows":1}"#).is_err());
}
