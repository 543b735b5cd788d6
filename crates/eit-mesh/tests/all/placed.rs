//! Electrodes by position on surfaces in space.

use crate::surfaces::{area_m2, disc, half_sphere, moved, rectangle};
use eit_core::vector::distance;
use eit_mesh::MeshError::{
    BadPatch, ElectrodeSize, NoRim, OffSurface, OverlappingElectrodes, OverlappingPatches,
    PinchedRim, RefinementIncomplete,
};
use eit_mesh::{
    Electrode, Mesh, MeshSettings, PlacedElectrode, Quality, Repairs, Surface, place_electrodes,
};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// A saddle over the unit disc.
fn saddle() -> Surface {
    moved(&disc(8, 1.0), |[x, y, _]| [x, y, 0.4 * (x * x - y * y)])
}

/// Electrodes at equal angles around the saddle's rim.
fn around_saddle(start: f64, widths_m: &[f64]) -> Vec<PlacedElectrode> {
    let angle = |l: usize| start + TAU * l as f64 / widths_m.len() as f64;
    let at = |angle: f64| [angle.cos(), angle.sin(), 0.4 * (2.0 * angle).cos()];
    let rim = |(l, width_m): (usize, &f64)| PlacedElectrode::rim(at(angle(l)), *width_m);
    widths_m.iter().enumerate().map(rim).collect()
}

fn nodes_of(mesh: &Mesh, electrode: usize) -> Vec<[f64; 3]> {
    let surface = mesh.surface();
    let nodes: Vec<u32> = match &mesh.electrodes()[electrode] {
        Electrode::Rim(edges) => edges.iter().flatten().copied().collect(),
        Electrode::Patch(triangles) => {
            triangles.iter().flat_map(|&t| surface.triangles()[t as usize]).collect()
        }
    };
    nodes.into_iter().map(|n| surface.nodes()[n as usize]).collect()
}

/// To rounding, on a rim in space.
#[test]
fn rim_electrodes_have_their_width_and_the_surface_keeps_its_area() {
    let (saddle, electrodes) = (saddle(), around_saddle(0.3, &[0.2; 12]));
    let mesh = place_electrodes(&saddle, &electrodes, &MeshSettings::default()).unwrap();
    for (l, electrode) in electrodes.iter().enumerate() {
        // some ten sums of lengths
        assert!((mesh.electrode_measure(l).unwrap() - 0.2).abs() < 1e-13);
        let centre = mesh.electrode_centre_m(l).unwrap();
        // the rim's facets are 0.13 long
        assert!(distance(centre, electrode.position_m) < 0.01, "{centre:?}");
    }
    assert!((area_m2(mesh.surface()) / area_m2(&saddle) - 1.0).abs() < 1e-13);
    let edges = Quality::of(&mesh).elements_per_electrode;
    assert!(edges.iter().all(|&count| count >= 4), "a sixth of the width at the ends: {edges:?}");
}

/// A surface without the triangles whose centroids lie in a region.
fn without(surface: &Surface, region: impl Fn([f64; 2]) -> bool) -> (Surface, Repairs) {
    let triangles = surface.triangles().iter().zip(surface.centroids());
    let kept = triangles.filter(|(_, c)| !region([c[0], c[1]])).map(|(t, _)| *t);
    Surface::repaired(surface.nodes().to_vec(), kept.collect(), 0.0).unwrap()
}

#[test]
fn a_rim_electrode_runs_around_a_corner_and_around_a_hole() {
    // without the four squares in the middle: a hole of 0.2 x 0.2 around the centre
    let whole = rectangle(6, 6, 0.6, 0.6);
    let (ring, repairs) = without(&whole, |c| c.iter().all(|x| (0.2..0.4).contains(x)));
    assert_eq!(repairs.dropped_nodes, 1, "the node in the middle of the hole");
    let electrodes = [
        PlacedElectrode::rim([0.601, 0.6, 0.0], 0.1),
        PlacedElectrode::rim([0.3, 0.4, 0.0], 0.05),
        PlacedElectrode::patch([0.1, 0.1, 0.0], 0.05),
    ];
    let mesh = place_electrodes(&ring, &electrodes, &MeshSettings::default()).unwrap();
    let around = nodes_of(&mesh, 0);
    for end in [[0.6, 0.55, 0.0], [0.55, 0.6, 0.0]] {
        assert!(around.iter().any(|&p| distance(p, end) < 1e-12), "{around:?}");
    }
    assert!(nodes_of(&mesh, 1).iter().all(|p| (p[1] - 0.4).abs() < 1e-12));
    assert!((mesh.electrode_measure(1).unwrap() - 0.05).abs() < 1e-13);
    assert!(matches!(mesh.electrodes()[2], Electrode::Patch(_)), "in the order of the list");
}

/// The area missing from `pi r^2` is what the chords cut off.
#[test]
fn patches_have_their_area_and_the_rest_falls_with_the_square_of_the_edge() {
    let (radius_m, position_m) = (0.3, [0.93, 1.06, 0.0]);
    let mut missing = Vec::new();
    for edge_m in [0.1, 0.05, 0.025] {
        let settings = MeshSettings { electrode_edge_m: Some(edge_m), ..MeshSettings::default() };
        let patch = [PlacedElectrode::patch(position_m, radius_m)];
        let mesh = place_electrodes(&rectangle(7, 5, 2.0, 2.0), &patch, &settings).unwrap();
        missing.push(1.0 - mesh.electrode_measure(0).unwrap() / (PI * radius_m * radius_m));
        let whole = area_m2(mesh.surface()) / 4.0;
        assert!((whole - 1.0).abs() < 1e-12, "{whole}");
        let outmost = nodes_of(&mesh, 0).into_iter().map(|p| distance(p, position_m));
        let outmost = outmost.fold(0.0, f64::max);
        // nodes within 2 % of an edge of the circle count as on it
        assert!(outmost < radius_m + 0.02 * 4.0 / 3.0 * edge_m, "{outmost}");
    }
    println!("area missing {missing:.6?}");
    // chords of up to 4/3 of a third of the radius: 1 - sin(x) / x, x = 4/9
    assert!(missing[0] > 0.0 && missing[0] < 0.033, "{missing:?}");
    assert!(missing[2] < missing[0] / 6.0, "order 2 would be 16: {missing:?}");
}

/// The part of a sphere closer than `r` to one of its points has the area `pi r^2` (Archimedes).
#[test]
fn a_patch_on_a_sphere_has_its_area() {
    let patch = [PlacedElectrode::patch([0.48, 0.36, 0.8], 0.3)];
    let mesh = place_electrodes(&half_sphere(64, 1.0), &patch, &MeshSettings::default()).unwrap();
    let missing = 1.0 - mesh.electrode_measure(0).unwrap() / (PI * 0.09);
    // facets of 0.03 on a radius of 1, chords of 0.025 on one of 0.3: 1.2e-3 at most
    assert!(missing.abs() < 2e-3, "{missing:e}");
}

/// On a thin fold the sphere of a patch cuts both layers, but the patch covers only its own.
#[test]
fn a_patch_covers_one_sheet_of_a_fold() {
    // a strip folded at x = 1 into two layers 0.02 apart
    let folded = moved(&rectangle(40, 10, 2.0, 0.5), |[x, y, _]| {
        [1.0 - (x - 1.0).abs(), y, 0.01 * ((x - 1.0) / 0.02).tanh()]
    });
    let patch = [PlacedElectrode::patch([0.5, 0.25, 0.01], 0.1)];
    let mesh = place_electrodes(&folded, &patch, &MeshSettings::default()).unwrap();
    assert!(nodes_of(&mesh, 0).iter().all(|p| p[2] > 0.0));
    let found = mesh.electrode_measure(0).unwrap();
    assert!((found / (PI * 0.01) - 1.0).abs() < 0.033, "{found}");
}

#[test]
fn edge_length_is_kept_everywhere_when_asked_for() {
    let settings = MeshSettings { edge_m: Some(0.06), ..MeshSettings::default() };
    let coarse = saddle();
    let before = Quality::of(&Mesh::new(coarse.clone(), vec![]).unwrap());
    let quality = Quality::of(&place_electrodes(&coarse, &[], &settings).unwrap());
    assert!(before.longest_edge_m > 0.12);
    assert!(quality.longest_edge_m <= 0.06 * 4.0 / 3.0, "{quality}");
    // longest-edge bisection at worst halves the smallest angle
    assert!(quality.smallest_angle_deg > 0.5 * before.smallest_angle_deg, "{quality}");
    assert!((quality.area_m2 / before.area_m2 - 1.0).abs() < 1e-13);
}

#[test]
fn what_cannot_be_placed_is_refused_with_its_number() {
    let saddle = saddle();
    let settings = MeshSettings::default();
    let place = |electrodes: &[PlacedElectrode]| place_electrodes(&saddle, electrodes, &settings);
    let rim = PlacedElectrode::rim;
    let patch = |x: f64, r| PlacedElectrode::patch([x, 0.0, 0.4 * x * x], r);
    let good = rim([1.0, 0.0, 0.4], 0.1);
    let off = place(&[good, rim([1.1, 0.0, 0.4], 0.1)]);
    assert_error!(off, OffSurface { electrode: 2, what, .. } if what.contains("rim"));
    let above = place(&[good, PlacedElectrode::patch([0.0, 0.0, 0.1], 0.1)]);
    assert_error!(above, OffSurface { electrode: 2, distance_m, .. } if (distance_m - 0.1).abs() < 0.01);
    let near = place(&[good, rim([1.0, 0.05, 0.4], 0.1)]);
    assert_error!(near, OverlappingElectrodes { first: 1, second: 2, .. });
    // the place is where it runs over the rim
    let over = place(&[good, patch(0.8, 0.3)]);
    assert_error!(over, BadPatch { electrode: 2, position_m, .. } if position_m[0] > 0.9);
    let two = place(&[patch(0.1, 0.2), good, patch(-0.2, 0.15)]);
    assert_error!(two, OverlappingPatches { first: 1, second: 3, .. });
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-12] {
        for electrode in [rim([1.0, 0.0, 0.4], bad), patch(0.0, bad)] {
            assert_error!(place(&[electrode]), ElectrodeSize { electrode: 1, .. });
        }
    }
    assert_error!(place(&[rim([1.0, 0.0, 0.4], 10.0)]), ElectrodeSize { quantity: "width_m", .. });
    assert_error!(place(&[rim([f64::NAN, 0.0, 0.4], 0.1)]), OffSurface { electrode: 1, .. });
    let settings = MeshSettings { node_limit: 300, edge_m: Some(0.05), ..Default::default() };
    let small = place_electrodes(&saddle, &[good], &settings);
    assert_error!(small, RefinementIncomplete { limit: 300, .. });
}

#[test]
fn a_closed_surface_takes_patches_and_no_rim_electrodes() {
    let corners = vec![[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]];
    let faces = vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
    let link = Surface::new(corners, faces).unwrap();
    let settings = MeshSettings::default();
    let rim = [PlacedElectrode::rim([1., 1., 1.], 0.1)];
    assert_error!(place_electrodes(&link, &rim, &settings), NoRim { electrode: 1 });
    // the middle of the first face, and a corner, over which the patch is bent
    let third = 1.0 / 3.0;
    let patches = [
        PlacedElectrode::patch([third, third, -third], 0.2),
        PlacedElectrode::patch([-1., -1., 1.], 0.2),
    ];
    let mesh = place_electrodes(&link, &patches, &settings).unwrap();
    assert!((mesh.electrode_measure(0).unwrap() / (PI * 0.04) - 1.0).abs() < 0.033);
    // three faces meet, each with 60 degrees
    assert!((mesh.electrode_measure(1).unwrap() / (PI * 0.02) - 1.0).abs() < 0.033);
}

/// Nine squares without the middle one and one at a corner: two of the others touch in one node.
#[test]
fn a_rim_through_one_node_twice_is_refused() {
    let (surface, _) = without(&rectangle(3, 3, 3.0, 3.0), |c| {
        c.iter().all(|x| *x < 1.0) || c.iter().all(|x| (1.0..2.0).contains(x))
    });
    let rim = [PlacedElectrode::rim([3.0, 2.5, 0.0], 0.1)];
    let pinched = place_electrodes(&surface, &rim, &MeshSettings::default());
    assert_error!(pinched, PinchedRim { position_m, .. } if position_m == [1.0, 1.0, 0.0]);
}

proptest! {
    #![proptest_config(fixtures::cases(32))]

    #[test]
    fn widths_are_exact_wherever_electrodes_lie(
        start in 0.0..TAU,
        widths in prop::collection::vec(0.02..0.3f64, 1..9),
        edge in prop::option::of(0.02..0.3f64),
    ) {
        let saddle = saddle();
        let settings = MeshSettings { electrode_edge_m: edge, ..MeshSettings::default() };
        let mesh = place_electrodes(&saddle, &around_saddle(start, &widths), &settings).unwrap();
        for (l, &width) in widths.iter().enumerate() {
            let found = mesh.electrode_measure(l).unwrap();
            // an end may be taken for a node within 1e-4 of an edge of 0.13
            prop_assert!((found - width).abs() < 2e-4 * 0.14, "{found} for {width}");
        }
        prop_assert!((area_m2(mesh.surface()) / area_m2(&saddle) - 1.0).abs() < 1e-12);
    }
}
