//! Results and settings as JSON and back; what is always valid stays so.

use eit_mesh::{
    Electrode, Mesh, MeshSettings, PlacedElectrode, Quality, RimElectrodes, SkinShape, Surface,
    generate,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

fn same<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    assert_eq!(serde_json::from_str::<T>(&serde_json::to_string(value).unwrap()).unwrap(), *value);
}

#[test]
fn results_and_settings_survive() {
    let electrodes = RimElectrodes::equally_spaced(8, 0.02);
    let disc = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&disc, &electrodes, &MeshSettings::with_edge(0.03)).unwrap();
    let rim = mesh.surface().rim_edges()[0];
    assert!(mesh.midpoint_m(rim).is_some(), "the disc's rim is curved");
    same(&mesh);
    same(mesh.surface());
    same(&Quality::of(&mesh));
    same(&MeshSettings::with_edge(0.01));
    same(&electrodes);
    same(&PlacedElectrode::patch([0.1, 0.2, 0.0], 0.01));
    let outline_m = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    same(&SkinShape::Polygon { outline_m, holes_m: Vec::new() });
    same(&Electrode::Patch(vec![3, 4]));

    let mut json = serde_json::to_value(&mesh).unwrap();
    let far = serde_json::json!([[0, 900_000], [0.0, 0.0, 0.0]]);
    json["midpoints_m"].as_array_mut().unwrap().push(far);
    assert!(serde_json::from_value::<Mesh>(json).is_err(), "a midpoint of no edge");
}

#[test]
fn invalid_surfaces_and_unknown_settings_are_errors() {
    let surface = |rest: &str| {
        let nodes = r#"{"nodes_m":[[0,0,0],[1,0,0],[0,1,0]],"#;
        serde_json::from_str::<Surface>(&format!("{nodes}{rest}"))
    };
    assert!(surface(r#""triangles":[[0,1,1]]}"#).is_err());
    assert!(surface(r#""triangles":[[0,1,2]],"areas":[1]}"#).is_err());
    assert_eq!(surface(r#""triangles":[[0,1,2]]}"#).unwrap().areas_m2(), [0.5]);
    assert_eq!(serde_json::from_str::<MeshSettings>("{}").unwrap(), MeshSettings::default());
    assert!(serde_json::from_str::<MeshSettings>(r#"{"edge":0.1}"#).is_err());
}
