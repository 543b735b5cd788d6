//! Frames, settings and results as JSON and back.

use eit_hw::driver::{Backoff, SessionSettings};
use eit_hw::{Endpoint, Frame, Layout, Quality, ReadOptions, Unit};

/// JSON has no NaN: it holds `null`, which a frame reads as NaN.
#[test]
fn a_missing_value_of_a_frame_survives() {
    let quality = vec![Quality::GOOD, Quality::NON_FINITE | Quality::MISSING];
    let device_time_s = Some(0.25);
    let values = vec![1.5e-3, f64::NAN];
    let frame = Frame { quality, epoch: 1, device_time_s, ..Frame::new(7, values) };
    let text = serde_json::to_string(&frame).unwrap();
    assert!(text.contains("[0.0015,null]") && text.contains("[0,48]"), "{text}");
    let mut read: Frame = serde_json::from_str(&text).unwrap();
    assert!(read.values[1].is_nan());
    read.values[1] = 0.0;
    assert_eq!(read, Frame { values: vec![1.5e-3, 0.0], ..frame });
}

#[test]
fn unknown_flags_are_an_error() {
    assert!(serde_json::from_str::<Quality>("64").is_err());
    assert_eq!(serde_json::from_str::<Quality>("5").unwrap(), Quality::SATURATED | Quality::OPEN);
}

#[test]
fn settings_survive() {
    fn same<T: serde::Serialize + serde::de::DeserializeOwned + PartialEq>(value: &T) {
        let text = serde_json::to_string(value).unwrap();
        assert!(serde_json::from_str::<T>(&text).unwrap() == *value, "{text}");
    }
    // infinite: never gives up
    same(&Backoff::default());
    same(&SessionSettings::default());
    same(&ReadOptions { complex: true, ..ReadOptions::default() });
    same(&Layout::Quadruples(vec![[0, 1, 2, 3]]));
    same(&Unit::Ohm);
    same(&Endpoint::Serial { path: "/dev/ttyACM0".into(), baud: 115_200, dtr: Some(true) });
    assert!(serde_json::from_str::<SessionSettings>(r#"{"capacity":3,"overflows":1}"#).is_err());
}
