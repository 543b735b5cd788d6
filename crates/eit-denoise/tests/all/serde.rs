//! Results and settings as JSON and back.

use serde::Serialize;
use serde::de::DeserializeOwned;

fn same<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    let again: T = serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap();
    assert_eq!(again, *value);
}

use eit_denoise::{DiscSymmetry, ModelError, ThresholdRule, TrainSettings, UnetShape, Verdict};
use ndarray::arr2;

#[test]
fn results_and_settings_survive() {
    same(&ThresholdRule::default());
    same(&TrainSettings::default());
    same(&UnetShape::ONE_IMAGE);
    same(&Verdict::Raw);
    same(&DiscSymmetry { steps: 3, mirrored: true });
    same(&ModelError { directions: arr2(&[[0.1, 0.2]]), floor: 0.5, limit: 2.0 });
    assert!(serde_json::from_str::<TrainSettings>(r#"{"epoch":3}"#).is_err());
}
