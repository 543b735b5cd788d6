//! Results and settings as JSON and back.

use eit_inverse::metrics::TouchSettings;
use eit_inverse::sequence::{AbsoluteSettings, TimePriorSettings};
use eit_inverse::touch::{DetectorSettings, TouchState, TrackerSettings};
use eit_inverse::{CausalSettings, Certificate, OneStepSettings, StTvSettings};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Types that compare equal after JSON.
fn same<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    let again: T = serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap();
    assert_eq!(again, *value);
}

/// JSON has no infinity: it holds `null`, which bounds and certificates read as what they are without one.
#[test]
fn settings_and_certificates_survive() {
    same(&OneStepSettings { used: Some(vec![true, false]), ..OneStepSettings::default() });
    same(&AbsoluteSettings::default());
    same(&TimePriorSettings::default());
    same(&CausalSettings::default());
    same(&DetectorSettings::with_least(2e-11));
    same(&TrackerSettings::with_strong(6e-11));
    same(&TouchSettings::default());
    same(&TouchState::Hold);
    assert!(serde_json::from_str::<StTvSettings>(r#"{"lambda":1}"#).is_err());
    let text = serde_json::to_string(&StTvSettings::default()).unwrap();
    assert!(text.contains(r#""lower_s":null,"upper_s":null"#), "{text}");
    same(&StTvSettings::default());
    same(&StTvSettings { lower_s: 0.0, ..StTvSettings::default() });
    let none: Certificate = serde_json::from_str(r#"{"primal":null,"lower_bound":0.0}"#).unwrap();
    assert!(none.relative_gap().is_infinite());
    same(&none);
}
