//! Results and settings as JSON and back; what is always valid stays so.
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

use eit_mesh::{
    Electrode, Mesh, MeshSettings, PlacedElectrode, Quality, RimElectrodes, SkinShape, Surface,
    generate,
};

fn disc() -> Mesh {
    let settings = MeshSettings { edge_m: Some(0.03), ..MeshSettings::default() };
    let electrodes = RimElectrodes::equally_spaced(8, 0.02);
    generate(&SkinShape::Disc { radius_m: 0.1 }, &electrodes, &settings).unwrap()
}

#[test]
fn results_and_settings_survive() {
    let mesh = disc();
    same(&mesh);
    same(mesh.surface());
    same(&Quality::of(&mesh));
    same(&MeshSettings { edge_m: Some(0.01), ..MeshSettings::default() });
    same(&RimElectrodes::equally_spaced(16, 0.01));
    same(&PlacedElectrode::patch([0.1, 0.2, 0.0], 0.01));
    let outline_m = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    same(&SkinShape::Polygon { outline_m, holes_m: Vec::new() });
    same(&Electrode::Patch(vec![3, 4]));
}

#[test]
fn curved_edges_survive_and_strange_ones_do_not() {
    let mesh = disc();
    let rim = mesh.surface().rim_edges()[0];
    assert!(again(&mesh).midpoint_m(rim).is_some(), "the disc's rim is curved");
    let mut json = serde_json::to_value(&mesh).unwrap();
    json["midpoints_m"]
        .as_array_mut()
        .unwrap()
        .push(serde_json::json!([[0, 900_000], [0.0, 0.0, 0.0]]));
    assert!(serde_json::from_value::<Mesh>(json).is_err());
}

#[test]
fn an_invalid_surface_is_an_error() {
    let overlapping = r#"{"nodes_m":[[0,0,0],[1,0,0],[0,1,0]],"triangles":[[0,1,1]]}"#;
    assert!(serde_json::from_str::<Surface>(overlapping).is_err());
    let unknown = r#"{"nodes_m":[[0,0,0],[1,0,0],[0,1,0]],"triangles":[[0,1,2]],"areas":[1]}"#;
    assert!(serde_json::from_str::<Surface>(unknown).is_err());
    let good = r#"{"nodes_m":[[0,0,0],[1,0,0],[0,1,0]],"triangles":[[0,1,2]]}"#;
    assert_eq!(serde_json::from_str::<Surface>(good).unwrap().areas_m2(), [0.5]);
}

#[test]
fn absent_settings_are_the_defaults_and_unknown_ones_errors() {
    assert_eq!(serde_json::from_str::<MeshSettings>("{}").unwrap(), MeshSettings::default());
    assert!(serde_json::from_str::<MeshSettings>(r#"{"edge":0.1}"#).is_err());
}
