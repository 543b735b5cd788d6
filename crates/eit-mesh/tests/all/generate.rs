//! Meshes of discs, rectangles and polygons: validity, electrodes, quality, errors. One file
//! because all tests share its shapes and checks.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]
#![allow(missing_docs, reason = "tests are described where their names do not suffice")]

use eit_mesh::{
    Direction, Electrode, Mesh, MeshError, MeshSettings, Placement, Quality, RimElectrodes,
    SkinShape, generate,
};
use proptest::prelude::*;
use std::f64::consts::TAU;

const RADIUS_M: f64 = 0.1;
const DISC: SkinShape = SkinShape::Disc { radius_m: RADIUS_M };

/// Delaunay refinement stops at 28 degrees. Smoothing improves the mean at the expense of angles
/// but preserves the worst quality, which costs a few degrees at worst.
const LEAST_ANGLE_DEG: f64 = 25.0;

/// The same for gradings from 0.3 to 0.5.
const STEEP_ANGLE_DEG: f64 = 15.0;

fn everyday() -> RimElectrodes {
    RimElectrodes::equally_spaced(16, 0.0196)
}

fn l_shape() -> SkinShape {
    SkinShape::Polygon {
        outline_m: vec![[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.1, 0.1], [0.1, 0.2], [0.0, 0.2]],
        holes_m: vec![vec![[0.03, 0.03], [0.07, 0.03], [0.07, 0.07], [0.03, 0.07]]],
    }
}

fn square_with_hole() -> SkinShape {
    SkinShape::Polygon {
        outline_m: vec![[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]],
        holes_m: vec![vec![[0.05, 0.05], [0.05, 0.15], [0.15, 0.15], [0.15, 0.05]]],
    }
}

fn rim_edges(electrode: &Electrode) -> &[[u32; 2]] {
    match electrode {
        Electrode::Rim(edges) => edges,
        Electrode::Patch(_) => panic!("generate makes rim electrodes"),
    }
}

fn position(mesh: &Mesh, node: u32) -> [f64; 2] {
    let [x, y, z] = mesh.surface().nodes()[node as usize];
    assert_eq!(z, 0.0);
    [x, y]
}

/// First and last node of an electrode, whose edges must form a chain.
fn ends(mesh: &Mesh, electrode: usize) -> [[f64; 2]; 2] {
    let edges = rim_edges(&mesh.electrodes()[electrode]);
    assert!(edges.windows(2).all(|pair| pair[0][1] == pair[1][0]), "{edges:?}");
    [position(mesh, edges[0][0]), position(mesh, edges[edges.len() - 1][1])]
}

/// Area inside the rim edges by the shoelace formula.
fn rim_area(mesh: &Mesh) -> f64 {
    let edge = |e: &[u32; 2]| {
        let [a, b] = e.map(|n| position(mesh, n));
        0.5 * (a[0] * b[1] - a[1] * b[0])
    };
    mesh.surface().rim_edges().iter().map(edge).sum()
}

/// The triangles fill the rim without overlap or gap, to the rounding of some thousand sums.
fn assert_fills_rim(mesh: &Mesh) {
    let area: f64 = mesh.surface().areas_m2().iter().sum();
    assert!((area / rim_area(mesh) - 1.0).abs() < 1e-12);
}

/// Electrode lengths on a disc: chords of at most `h` fall short of their arcs by at most h^2 / (24
/// R^2), up to fourth order; coordinates are rounded at 1e-16 R.
fn assert_chord_lengths(mesh: &Mesh, width_m: f64) {
    for (index, electrode) in mesh.electrodes().iter().enumerate() {
        let chord = |e: &[u32; 2]| {
            let [a, b] = e.map(|n| position(mesh, n));
            (b[0] - a[0]).hypot(b[1] - a[1])
        };
        let h = rim_edges(electrode).iter().map(chord).fold(0.0, f64::max);
        let short = 1.0 - mesh.electrode_measure(index).unwrap() / width_m;
        let bound = (h / RADIUS_M).powi(2) / 24.0;
        let rounding = 1e-14 * RADIUS_M / width_m;
        assert!(short > -rounding && short < 1.1 * bound + rounding, "{short} against {bound}");
    }
}

/// Angle counter-clockwise from +x in turns, taking the branch nearest to `wanted`.
fn turns_off(point: [f64; 2], wanted_deg: f64) -> f64 {
    let off = point[1].atan2(point[0]) / TAU - wanted_deg / 360.0;
    (off - off.round()).abs()
}

#[test]
fn everyday_disc() {
    let mesh = generate(&DISC, &everyday(), &MeshSettings::default()).unwrap();
    let quality = Quality::of(&mesh);
    assert!((1800..2300).contains(&quality.nodes), "{quality}");
    assert!(quality.smallest_angle_deg > 30.0, "{quality}");
    assert!(quality.mean_quality > 0.97, "{quality}");
    assert_fills_rim(&mesh);
    assert_chord_lengths(&mesh, 0.0196);
}

/// Ends are nodes on the circle at the requested angles, to rounding: angle, cosine and radius are
/// each rounded once or twice.
#[test]
fn electrode_ends_are_nodes_at_their_angles() {
    let half_deg = 0.5 * (0.0196 / RADIUS_M).to_degrees();
    for (direction, sense) in [(Direction::Counterclockwise, 1.0), (Direction::Clockwise, -1.0)] {
        let placement = Placement::EquallySpaced { count: 16, first_angle_deg: 90.0, direction };
        let electrodes = RimElectrodes { width_m: 0.0196, placement };
        let mesh = generate(&DISC, &electrodes, &MeshSettings::default()).unwrap();
        for k in 0..16 {
            let centre_deg = 90.0 + sense * k as f64 * 22.5;
            let [from, to] = ends(&mesh, k);
            assert!(turns_off(from, centre_deg - half_deg) < 1e-15);
            assert!(turns_off(to, centre_deg + half_deg) < 1e-15);
            for end in [from, to] {
                assert!((end[0].hypot(end[1]) / RADIUS_M - 1.0).abs() < 1e-15);
            }
        }
    }
}

#[test]
fn extreme_electrodes_on_a_disc() {
    let pitch_m = TAU * RADIUS_M / 16.0;
    let gap_m = 1e-6 * RADIUS_M;
    for (count, width_m) in [
        (32, 0.01),
        (1, 0.0196),
        (1, 1e-4 * RADIUS_M),
        (2, 0.99 * TAU * RADIUS_M / 2.0),
        (16, 1e-4 * RADIUS_M),
        (16, pitch_m - gap_m),
        (256, 0.001),
    ] {
        let electrodes = RimElectrodes::equally_spaced(count, width_m);
        let mesh = generate(&DISC, &electrodes, &MeshSettings::default()).unwrap();
        let quality = Quality::of(&mesh);
        assert!(quality.smallest_angle_deg > LEAST_ANGLE_DEG, "{count} x {width_m}: {quality}");
        assert!(quality.mean_quality > 0.95, "{count} x {width_m}: {quality}");
        assert_eq!(mesh.electrodes().len(), count);
        assert!(quality.elements_per_electrode.iter().all(|&n| n >= 2));
        assert_fills_rim(&mesh);
        assert_chord_lengths(&mesh, width_m);
    }
}

#[test]
fn straight_electrodes_have_their_exact_length() {
    let rectangle = SkinShape::Rectangle { width_m: 0.3, height_m: 0.1 };
    for shape in [rectangle, l_shape()] {
        let mesh = generate(&shape, &everyday(), &MeshSettings::default()).unwrap();
        let quality = Quality::of(&mesh);
        assert!(quality.smallest_angle_deg > LEAST_ANGLE_DEG, "{quality}");
        assert!(quality.mean_quality > 0.96, "{quality}");
        assert_fills_rim(&mesh);
        let outline = shape.outline().unwrap();
        assert!((quality.area_m2 / outline.area_m2() - 1.0).abs() < 1e-12);
        for electrode in 0..mesh.electrodes().len() {
            // sums of a few edges around 0.2 m coordinates; corners within an electrode too
            assert!((mesh.electrode_measure(electrode).unwrap() / 0.0196 - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn given_positions_mean_the_same_as_equal_spacing() {
    let settings = MeshSettings::default();
    let equal = generate(&DISC, &everyday(), &settings).unwrap();
    // 0.5 % of the radius off the rim, within the tolerance of 1e-3 of its length
    let positions = (0..16)
        .map(|k| (TAU * f64::from(k) / 16.0).sin_cos())
        .map(|(sin, cos)| [1.005 * RADIUS_M * cos, 1.005 * RADIUS_M * sin])
        .collect();
    let given = RimElectrodes { width_m: 0.0196, placement: Placement::At(positions) };
    let given = generate(&DISC, &given, &settings).unwrap();
    for k in 0..16 {
        for (a, b) in ends(&equal, k).iter().zip(ends(&given, k)) {
            // both are roundings of the same point
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-15);
        }
    }
}

#[test]
fn electrodes_on_the_rim_of_a_hole() {
    let placement = Placement::At(vec![[0.1, 0.05], [0.2, 0.1], [0.15, 0.15]]);
    let electrodes = RimElectrodes { width_m: 0.02, placement };
    let mesh = generate(&square_with_hole(), &electrodes, &MeshSettings::default()).unwrap();
    assert_fills_rim(&mesh);
    let [from, to] = ends(&mesh, 0);
    assert!((from[1] - 0.05).abs() < 1e-16 && (to[1] - 0.05).abs() < 1e-16);
    assert!(((from[0] - to[0]).abs() - 0.02).abs() < 1e-15);
    // the third lies around a corner of the hole
    let [from, to] = ends(&mesh, 2);
    assert!(((from[0] - to[0]).abs() - 0.01).abs() < 1e-15);
    assert!(((from[1] - to[1]).abs() - 0.01).abs() < 1e-15);
}

#[test]
fn bare_skins_and_coarse_edges() {
    for shape in [DISC, l_shape(), SkinShape::Rectangle { width_m: 1.0, height_m: 1e-3 }] {
        for edge_m in [1e-2, 1.0, 1e6] {
            let settings = MeshSettings::with_edge(edge_m);
            let mesh = generate(&shape, &RimElectrodes::none(), &settings).unwrap();
            assert_fills_rim(&mesh);
            // a disc keeps at least twelve rim edges: regular dodecagon, 3 R^2
            let area_m2 = shape.outline().unwrap().area_m2();
            assert!(rim_area(&mesh) > 3.0 / (TAU / 2.0) * area_m2 * (1.0 - 1e-12));
        }
    }
}

/// A sharp corner keeps its angle, which is the smallest, and refinement still terminates.
#[test]
fn sharp_corners() {
    for corner_deg in [1.5f64, 5.0, 20.0] {
        let y = 0.2 * corner_deg.to_radians().tan();
        let outline_m = vec![[0.0, 0.0], [0.2, 0.0], [0.2, y]];
        let shape = SkinShape::Polygon { outline_m, holes_m: vec![] };
        let electrodes = RimElectrodes::equally_spaced(3, 0.004);
        let mesh = generate(&shape, &electrodes, &MeshSettings::default()).unwrap();
        let quality = Quality::of(&mesh);
        assert!(quality.smallest_angle_deg > 0.9 * corner_deg, "{corner_deg}: {quality}");
        assert!(quality.mean_quality > 0.95, "{corner_deg}: {quality}");
        assert_fills_rim(&mesh);
    }
}

/// Strips between hole and rim that are far narrower than the requested edge are resolved. At
/// re-entrant corners (of a hole or an L) edges are as short as at electrode ends; at other corners
/// and around an octagonal hole they are not.
#[test]
fn corners_that_reach_into_the_skin_are_graded() {
    let positions = vec![[0.15, 0.0], [0.0, 0.15]];
    let electrodes = RimElectrodes { width_m: 0.02, placement: Placement::At(positions) };
    let settings =
        MeshSettings { edge_m: Some(0.02), electrode_edge_m: Some(0.001), ..Default::default() };
    let longest_at = |mesh: &Mesh, at: [f64; 2]| {
        let sides = mesh.surface().rim_edges().iter().map(|e| e.map(|node| position(mesh, node)));
        let length = |[a, b]: [[f64; 2]; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let meeting = sides.filter(|ends| ends.iter().any(|end| length([*end, at]) < 1e-12));
        meeting.map(length).fold(0.0, f64::max)
    };
    let mesh = generate(&l_shape(), &electrodes, &settings).unwrap();
    assert_fills_rim(&mesh);
    for corner in [[0.1, 0.1], [0.03, 0.03], [0.07, 0.03], [0.07, 0.07], [0.03, 0.07]] {
        let longest_m = longest_at(&mesh, corner);
        assert!((1e-4..1.3e-3).contains(&longest_m), "{corner:?}: {longest_m}");
    }
    for corner in [[0.0, 0.0], [0.2, 0.1], [0.1, 0.2]] {
        let longest_m = longest_at(&mesh, corner);
        assert!(longest_m > 4e-3, "{corner:?}: {longest_m}");
    }
    let octagon: Vec<[f64; 2]> = (0..8)
        .map(|k| (TAU * f64::from(k) / 8.0).sin_cos())
        .map(|(sin, cos)| [0.1 + 0.04 * cos, 0.1 + 0.04 * sin])
        .collect();
    let square = vec![[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]];
    let shape = SkinShape::Polygon { outline_m: square, holes_m: vec![octagon.clone()] };
    let mesh = generate(&shape, &electrodes, &settings).unwrap();
    for corner in octagon {
        let longest_m = longest_at(&mesh, corner);
        assert!(longest_m > 4e-3, "{corner:?}: {longest_m}");
    }
}

#[test]
fn narrow_strips() {
    for strip_m in [1e-2, 1e-3, 1e-4] {
        let y = strip_m;
        let hole = vec![[0.05, y], [0.15, y], [0.15, 0.1], [0.05, 0.1]];
        let outline_m = vec![[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]];
        let shape = SkinShape::Polygon { outline_m, holes_m: vec![hole] };
        let mesh = generate(&shape, &RimElectrodes::none(), &MeshSettings::default()).unwrap();
        let quality = Quality::of(&mesh);
        assert!(quality.smallest_angle_deg > LEAST_ANGLE_DEG, "{strip_m}: {quality}");
        assert_fills_rim(&mesh);
    }
}

#[test]
fn same_input_same_mesh() {
    let mesh = || generate(&l_shape(), &everyday(), &MeshSettings::default()).unwrap();
    assert_eq!(mesh(), mesh());
}

#[test]
fn scale_does_not_matter() {
    let node_count = |scale: f64| {
        let shape = SkinShape::Disc { radius_m: scale };
        let electrodes = RimElectrodes::equally_spaced(16, 0.196 * scale);
        Quality::of(&generate(&shape, &electrodes, &MeshSettings::default()).unwrap()).nodes
    };
    // powers of two scale exactly, so every decision is the same
    assert_eq!(node_count(1.0), node_count(2f64.powi(-29)));
    assert_eq!(node_count(1.0), node_count(2f64.powi(29)));
}

#[test]
fn wanted_numbers_of_nodes() {
    for nodes in [1000, 2047, 20_368] {
        let settings = MeshSettings::default().for_nodes(&DISC, &everyday(), nodes).unwrap();
        let mesh = generate(&DISC, &everyday(), &settings).unwrap();
        let found = mesh.surface().nodes().len();
        let miss = (found as f64 / nodes as f64 - 1.0).abs();
        // the documented 2 %, and 10 % for the coarse mesh
        assert!(miss < if nodes < 2000 { 0.1 } else { 0.02 }, "{found} for {nodes}");
    }
    let tiny = RimElectrodes::equally_spaced(16, 1e-5);
    let error = MeshSettings::default().for_nodes(&DISC, &tiny, 100).unwrap_err();
    assert!(matches!(error, MeshError::OutOfRange { quantity: "number of nodes", .. }), "{error}");
}

/// All edges of a family scale together; electrode ends and hole corners are finer than the
/// interior, convex corners are not.
#[test]
fn similar_meshes_are_graded_to_ends_and_inner_corners() {
    let skin = SkinShape::Polygon {
        outline_m: vec![[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]],
        holes_m: vec![vec![[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]]],
    };
    let placement = Placement::At(vec![[0.0, -0.1], [0.1, 0.0], [0.0, 0.1]]);
    let electrodes = RimElectrodes { width_m: 0.04, placement };
    let shortest_at = |mesh: &Mesh, place: [f64; 2]| {
        let nodes = mesh.surface().nodes();
        let near = |n: u32| {
            let p = nodes[n as usize];
            (p[0] - place[0]).hypot(p[1] - place[1]) < 1e-9
        };
        let length = |[a, b]: [u32; 2]| {
            let (a, b) = (nodes[a as usize], nodes[b as usize]);
            (a[0] - b[0]).hypot(a[1] - b[1])
        };
        let edges = mesh.surface().rim_edges().iter().copied();
        let at_place = edges.filter(|e| e.iter().any(|n| near(*n))).map(length);
        at_place.fold(f64::INFINITY, f64::min)
    };
    let area_m2: f64 = 0.04 - 0.0016;
    for scale in [1.0, 0.5, 0.25] {
        let settings = MeshSettings::default().similar(&skin, 0.04, scale).unwrap();
        let mesh = generate(&skin, &electrodes, &settings).unwrap();
        let edge_m = scale * area_m2.sqrt() / 9.0;
        for place in [[-0.02, -0.02], [0.02, 0.02], [0.02, -0.1], [0.1, 0.02]] {
            let ratio = shortest_at(&mesh, place) / (0.25 * edge_m);
            // edges divide the rim between two breakpoints evenly
            assert!((0.5..1.3).contains(&ratio), "{place:?} at scale {scale}: {ratio}");
        }
        assert!(shortest_at(&mesh, [0.1, 0.1]) > 0.4 * edge_m, "{scale}");
        let quality = Quality::of(&mesh);
        assert!(quality.smallest_angle_deg > LEAST_ANGLE_DEG, "{quality}");
    }
    for (electrode_m, scale) in [(0.0, 1.0), (f64::NAN, 1.0), (0.01, 0.0), (0.01, f64::INFINITY)] {
        let error = MeshSettings::default().similar(&skin, electrode_m, scale).unwrap_err();
        assert!(matches!(error, MeshError::OutOfRange { .. }), "{error}");
    }
}

#[test]
fn bad_sizes_are_refused() {
    let settings = MeshSettings::default();
    for bad in [0.0, -0.1, f64::NAN, f64::INFINITY, 1e-10, 1e10] {
        let shapes = [
            SkinShape::Disc { radius_m: bad },
            SkinShape::Rectangle { width_m: bad, height_m: 0.1 },
            SkinShape::Rectangle { width_m: 0.1, height_m: bad },
        ];
        for shape in shapes {
            let error = generate(&shape, &everyday(), &settings).unwrap_err();
            assert!(matches!(error, MeshError::OutOfRange { .. }), "{error}");
        }
    }
    for width_m in [0.0, -0.1, f64::NAN, f64::INFINITY, 1e-12, 1.0] {
        let electrodes = RimElectrodes::equally_spaced(1, width_m);
        let error = generate(&DISC, &electrodes, &settings).unwrap_err();
        assert!(matches!(error, MeshError::OutOfRange { .. }), "{error}");
    }
    let nan = f64::NAN;
    for bad in [
        MeshSettings::with_edge(0.0),
        MeshSettings::with_edge(nan),
        MeshSettings::with_edge(1e-15),
        MeshSettings { electrode_edge_m: Some(-1.0), ..settings.clone() },
        MeshSettings { electrode_edge_m: Some(1e-300), ..settings.clone() },
        MeshSettings { grading: 0.0, ..settings.clone() },
        MeshSettings { grading: nan, ..settings.clone() },
        MeshSettings { node_limit: 0, ..settings.clone() },
    ] {
        let error = generate(&DISC, &everyday(), &bad).unwrap_err();
        assert!(matches!(error, MeshError::OutOfRange { .. }), "{bad:?}: {error}");
    }
}

#[test]
fn overlapping_and_touching_electrodes_are_refused() {
    let settings = MeshSettings::default();
    let pitch_m = TAU * RADIUS_M / 16.0;
    let error = generate(&DISC, &RimElectrodes::equally_spaced(16, 0.05), &settings).unwrap_err();
    let MeshError::OverlappingElectrodes { first, second, overlap_m, distance_m, width_m } = error
    else {
        panic!("{error}")
    };
    assert_eq!((first, second, width_m), (1, 2, 0.05));
    assert!((distance_m - pitch_m).abs() < 1e-15 && (overlap_m - (0.05 - pitch_m)).abs() < 1e-15);
    let error =
        generate(&DISC, &RimElectrodes::equally_spaced(16, pitch_m), &settings).unwrap_err();
    assert!(matches!(error, MeshError::TouchingElectrodes { .. }), "{error}");
    // given positions in any order, overlapping across the start of the loop
    let placement = Placement::At(vec![[-0.1, 0.0], [0.0999, -0.004], [0.0, 0.1], [0.0999, 0.004]]);
    let error =
        generate(&DISC, &RimElectrodes { width_m: 0.01, placement }, &settings).unwrap_err();
    assert!(
        matches!(error, MeshError::OverlappingElectrodes { first: 2, second: 4, .. }),
        "{error}"
    );
}

#[test]
fn bad_positions_are_refused() {
    let settings = MeshSettings::default();
    for position_m in [[0.0, 0.0], [0.11, 0.0], [f64::NAN, 0.0], [f64::INFINITY, 0.0]] {
        let placement = Placement::At(vec![[-0.1, 0.0], position_m]);
        let electrodes = RimElectrodes { width_m: 0.01, placement };
        let error = generate(&DISC, &electrodes, &settings).unwrap_err();
        assert!(matches!(error, MeshError::OffRim { electrode: 2, .. }), "{error}");
    }
    let placement = Placement::EquallySpaced {
        count: 4,
        first_angle_deg: f64::NAN,
        direction: Direction::Clockwise,
    };
    let error =
        generate(&DISC, &RimElectrodes { width_m: 0.01, placement }, &settings).unwrap_err();
    assert!(matches!(error, MeshError::OutOfRange { quantity: "first_angle_deg", .. }), "{error}");
}

#[test]
fn bad_outlines_are_refused_with_the_place() {
    type Corners = Vec<[f64; 2]>;
    let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let small = |x: f64, y: f64, s: f64| vec![[x, y], [x + s, y], [x + s, y + s], [x, y + s]];
    let cases: Vec<(Corners, Vec<Corners>, [f64; 2])> = vec![
        // bow tie: crosses in the middle
        (vec![[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], vec![], [0.5, 0.5]),
        // first corner repeated at the end
        (vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]], vec![], [0.0, 0.0]),
        // spike
        (vec![[0.0, 0.0], [1.0, 0.0], [0.5, 0.0], [0.5, 1.0]], vec![], [1.0, 0.0]),
        // two corners
        (vec![[0.3, 0.0], [1.0, 0.0]], vec![], [0.3, 0.0]),
        // hole outside, hole across, hole touching, hole in hole
        (square.clone(), vec![small(2.0, 0.0, 0.5)], [2.0, 0.0]),
        (square.clone(), vec![small(0.75, 0.25, 0.5)], [1.0, 0.25]),
        (square.clone(), vec![small(0.0, 0.25, 0.5)], [0.0, 0.25]),
        (square.clone(), vec![small(0.25, 0.25, 0.5), small(0.375, 0.375, 0.25)], [0.375, 0.375]),
    ];
    for (outline_m, holes_m, place) in cases {
        let shape = SkinShape::Polygon { outline_m, holes_m };
        let error = shape.outline().unwrap_err();
        let MeshError::BadOutline { x_m, y_m, .. } = error else { panic!("{error}") };
        assert_eq!([x_m, y_m], place, "{error}");
    }
    let outline_m = vec![[0.0, 0.0], [1.0, 0.0], [f64::NAN, 1.0]];
    let shape = SkinShape::Polygon { outline_m, holes_m: vec![] };
    assert!(matches!(shape.outline(), Err(MeshError::BadOutline { .. })));
}

#[test]
fn node_limit_is_kept() {
    // far beyond: refused before any work
    let fine = MeshSettings::with_edge(1e-6);
    let error = generate(&DISC, &everyday(), &fine).unwrap_err();
    assert!(matches!(error, MeshError::TooManyNodes { limit: 1_000_000, .. }), "{error}");
    // close to the limit: detected during meshing, on the rim or inside
    for node_limit in [50, 500, 1500] {
        let settings = MeshSettings { node_limit, edge_m: Some(0.005), ..Default::default() };
        let error = generate(&DISC, &everyday(), &settings).unwrap_err();
        let (MeshError::TooManyNodes { limit, .. } | MeshError::RefinementIncomplete { limit, .. }) =
            error
        else {
            panic!("{error}")
        };
        assert_eq!(limit, node_limit);
    }
}

#[test]
fn smoothing_never_makes_it_worse() {
    let mesh = |smoothing_rounds| {
        let settings = MeshSettings { smoothing_rounds, ..Default::default() };
        Quality::of(&generate(&l_shape(), &everyday(), &settings).unwrap())
    };
    let (rough, smooth) = (mesh(0), mesh(3));
    assert_eq!(rough.nodes, smooth.nodes);
    assert!(smooth.mean_quality > rough.mean_quality + 0.01);
    assert!(smooth.smallest_quality > rough.smallest_quality);
}

proptest! {
    #![proptest_config(fixtures::cases(32))]

    /// Any layout that respects the gaps gives a mesh that fills the rim with good triangles and
    /// electrodes of the requested width.
    #[test]
    fn random_layouts_on_a_disc(
        count in 1usize..40,
        log_cover in -3.0..0.0f64,
        gap in 1e-5..0.9f64,
        first_angle_deg in -720.0..720.0f64,
        clockwise: bool,
        edge_m in 0.004..0.2f64,
        grading in 0.05..0.5f64,
    ) {
        let width_m = TAU * RADIUS_M / count as f64 * (1.0 - gap) * 10f64.powf(log_cover);
        let direction = if clockwise { Direction::Clockwise } else { Direction::Counterclockwise };
        let placement = Placement::EquallySpaced { count, first_angle_deg, direction };
        let settings = MeshSettings { edge_m: Some(edge_m), grading, ..Default::default() };
        let mesh = generate(&DISC, &RimElectrodes { width_m, placement }, &settings).unwrap();
        let quality = Quality::of(&mesh);
        // neighbouring rim edges differ by the grading and are never split, which refinement cannot
        // compensate: steep fields cost some degrees (smallest seen in 400 layouts: 29 below 0.3,
        // 19 above)
        let least_deg = if grading < 0.3 { LEAST_ANGLE_DEG } else { STEEP_ANGLE_DEG };
        prop_assert!(quality.smallest_angle_deg > least_deg, "{}", quality);
        prop_assert_eq!(mesh.electrodes().len(), count);
        assert_fills_rim(&mesh);
        assert_chord_lengths(&mesh, width_m);
    }

    /// Star-shaped polygons with random corners: meshed unchanged, or rejected as outlines.
    #[test]
    fn random_polygons(
        radii in prop::collection::vec(0.02..0.1f64, 3..12),
        count in 0usize..6,
        edge_m in 0.003..0.1f64,
    ) {
        let corners = radii.len();
        let corner = |(k, r): (usize, &f64)| {
            let (sin, cos) = (TAU * k as f64 / corners as f64).sin_cos();
            [r * cos, r * sin]
        };
        let outline_m: Vec<[f64; 2]> = radii.iter().enumerate().map(corner).collect();
        let shape = SkinShape::Polygon { outline_m, holes_m: vec![] };
        let electrodes = RimElectrodes::equally_spaced(count, 0.004);
        match generate(&shape, &electrodes, &MeshSettings::with_edge(edge_m)) {
            Ok(mesh) => {
                assert_fills_rim(&mesh);
                let area_m2 = shape.outline().unwrap().area_m2();
                prop_assert!((rim_area(&mesh) / area_m2 - 1.0).abs() < 1e-12);
                for electrode in 0..mesh.electrodes().len() {
                    let length_m = mesh.electrode_measure(electrode).unwrap();
                    prop_assert!((length_m / 0.004 - 1.0).abs() < 1e-12);
                }
            }
            Err(error) => prop_assert!(matches!(error, MeshError::BadOutline { .. }), "{}", error),
        }
    }
}

/// Rim edges on a disc store the midpoints of their arcs; every other edge is straight.
#[test]
fn arcs_are_known_by_their_midpoints() {
    let settings = MeshSettings::with_edge(0.02);
    let mesh = generate(&DISC, &everyday(), &settings).unwrap();
    let node = |n: u32| mesh.surface().nodes()[n as usize];
    let bent = |edge: &[u32; 2]| mesh.midpoint_m(*edge).is_some();
    let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let bends = mesh.surface().triangles().iter().flat_map(sides).filter(bent).count();
    assert_eq!(bends, mesh.surface().rim_edges().len());
    for &edge in mesh.surface().rim_edges() {
        let [x, y, z] = mesh.midpoint_m(edge).unwrap();
        let apart = edge.map(node).map(|p| (p[0] - x).hypot(p[1] - y));
        // rounding of sines and arc lengths
        assert!((x.hypot(y) - RADIUS_M).abs() < 1e-14 && z == 0.0);
        assert!((apart[0] - apart[1]).abs() < 1e-13, "{apart:?}");
    }
    let square = generate(&square_with_hole(), &RimElectrodes::equally_spaced(4, 0.05), &settings);
    let square = square.unwrap();
    assert!(square.surface().rim_edges().iter().all(|e| square.midpoint_m(*e).is_none()));
}
