//! Results and settings as JSON and back.

use eit_fem::{
    ElementOrder, ForwardModel, Order, PairPattern, PairProtocol, Protocol, RequiredAccuracy,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

fn again<T: Serialize + DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

fn same<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    assert_eq!(again(value), *value);
}

#[test]
fn protocols_and_reports_survive() {
    let (protocol, mesh) = (crate::common::adjacent(12), crate::common::ring_disc(4));
    let model = ForwardModel::new(&mesh, &protocol, &[1.0; 12]).unwrap();
    same(model.protocol());
    same(&PairProtocol { order: Order::Rotated, ..PairProtocol::default() });
    same(&model.cost());
    same(&ElementOrder::Quadratic);
    same(&RequiredAccuracy::Relative(1e-3));
    let mut workspace = model.workspace().unwrap();
    same(&model.solve(&vec![1.0; model.elements()], &mut workspace).unwrap().report());
    // patterns are balanced again, to rounding
    let protocol = Protocol::trigonometric(8, &PairPattern::Adjacent, 1e-3).unwrap();
    let read = again(&protocol);
    assert_eq!(read.data(), protocol.data());
    let difference = &read.stimulations_a() - &protocol.stimulations_a();
    assert!(difference.iter().all(|d| d.abs() < 1e-18), "{difference}");
}

#[test]
fn invalid_protocols_are_errors() {
    let read = |last: u32| {
        let text = format!(
            r#"{{"quadruples":{{"electrodes":4,"current_a":1e-3,"quadruples":[[0,1,2,{last}]]}}}}"#
        );
        serde_json::from_str::<Protocol>(&text)
    };
    assert!(read(9).is_err(), "electrode 9 of 4");
    assert_eq!(read(3).unwrap().measurements(), 1);
}
