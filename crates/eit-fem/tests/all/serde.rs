//! Results and settings as JSON and back.
#![allow(clippy::unwrap_used, reason = "a panic is a failed test")]

use serde::Serialize;
use serde::de::DeserializeOwned;

fn again<T: Serialize + DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

/// Types that compare equal after JSON.
fn same<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    assert_eq!(again(value), *value);
}

use eit_fem::{
    ElementOrder, ForwardModel, Order, PairPattern, PairProtocol, Protocol, RequiredAccuracy,
};
use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};

fn model() -> ForwardModel {
    let settings = MeshSettings { edge_m: Some(0.03), ..MeshSettings::default() };
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&skin, &RimElectrodes::equally_spaced(8, 0.02), &settings).unwrap();
    let pairs = PairProtocol { electrodes: 8, current_a: 1e-3, ..PairProtocol::default() };
    let protocol = pairs.protocol().unwrap();
    ForwardModel::new(&mesh, &protocol, &[1.0; 8]).unwrap()
}

#[test]
fn protocols_survive() {
    let model = model();
    same(model.protocol());
    // patterns are balanced again, to rounding
    let protocol = Protocol::trigonometric(8, &PairPattern::Adjacent, 1e-3).unwrap();
    let read = again(&protocol);
    assert_eq!(read.data(), protocol.data());
    let difference = &read.stimulations_a() - &protocol.stimulations_a();
    assert!(difference.iter().all(|d| d.abs() < 1e-18), "{difference}");
    same(&PairProtocol { order: Order::Rotated, ..PairProtocol::default() });
}

#[test]
fn invalid_protocols_are_errors() {
    let text = r#"{"quadruples":{"electrodes":4,"current_a":1e-3,"quadruples":[[0,1,2,9]]}}"#;
    assert!(serde_json::from_str::<Protocol>(text).is_err(), "electrode 9 of 4");
    let text = r#"{"quadruples":{"electrodes":4,"current_a":1e-3,"quadruples":[[0,1,2,3]]}}"#;
    assert_eq!(serde_json::from_str::<Protocol>(text).unwrap().measurements(), 1);
}

#[test]
fn reports_survive() {
    let model = model();
    let mut workspace = model.workspace().unwrap();
    let conductivity_s = vec![1.0; model.elements()];
    let mut solution = model.solve(&conductivity_s, &mut workspace).unwrap();
    same(&solution.report());
    same(&model.cost());
    same(&ElementOrder::Quadratic);
    same(&RequiredAccuracy::Relative(1e-3));
}

/// A copy is a model of its own: it gives the same voltages, bit for bit.
#[test]
fn a_copied_model_gives_the_same_voltages() {
    let model = model();
    let copy = model.clone();
    let conductivity_s = vec![0.3; model.elements()];
    let voltages = |model: &ForwardModel| {
        let mut workspace = model.workspace().unwrap();
        let solution = model.solve(&conductivity_s, &mut workspace).unwrap();
        solution.measurements().to_vec()
    };
    assert_eq!(voltages(&model), voltages(&copy));
}
