//! Patches inside generated skins, rim electrodes of different widths, hemispheres.

use crate::surfaces::{LEAST_ANGLE_DEG, area_m2, box_m, polygon};
use eit_core::vector::{distance, norm};
use eit_mesh::{
    Electrode, MeshError, MeshSettings, PlacedElectrode, Quality, RimElectrodes, SkinShape,
    generate, generate_placed,
};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

const DISC: SkinShape = SkinShape::Disc { radius_m: 0.1 };

fn plate_with_hole() -> SkinShape {
    polygon(box_m([0.0, 0.0], [0.3, 0.2]), vec![box_m([0.1, 0.08], [0.14, 0.12])])
}

#[test]
fn every_electrode_has_its_place_and_measure() {
    let electrodes = [
        PlacedElectrode::patch([0.05, 0.05, 0.0], 0.01),
        PlacedElectrode::rim([0.0, 0.15, 0.0], 0.02),
        PlacedElectrode::patch([0.25, 0.1, 0.0], 0.02),
        PlacedElectrode::rim([0.14, 0.1, 0.0], 0.01),
        PlacedElectrode::patch([0.08, 0.1, 0.0], 0.004),
        PlacedElectrode::rim([0.3, 0.2, 0.0], 0.06),
    ];
    let mesh = generate_placed(&plate_with_hole(), &electrodes, &MeshSettings::default()).unwrap();
    for (l, wanted) in [PI * 1e-4, 0.02, PI * 4e-4, 0.01, PI * 1.6e-5, 0.06].iter().enumerate() {
        // sums of some hundred areas, factors of rounding
        let found = mesh.electrode_measure(l).unwrap();
        assert!((found / wanted - 1.0).abs() < 1e-11, "{l}: {found} for {wanted}");
        let is_patch = matches!(mesh.electrodes()[l], Electrode::Patch(_));
        assert_eq!(is_patch, l % 2 == 0, "in the order of the list");
        let off = distance(mesh.electrode_centre_m(l).unwrap(), electrodes[l].position_m);
        // equal sides except where another part of the outline is near
        assert!(!is_patch || off < 1e-4, "{l}: {off:e}");
    }
    assert!((area_m2(mesh.surface()) / (0.06 - 0.0016) - 1.0).abs() < 1e-12);
    let quality = Quality::of(&mesh);
    assert!(quality.smallest_angle_deg > LEAST_ANGLE_DEG, "{quality}");
    assert_eq!(mesh.surface().rim_edges().len(), quality.rim_edges);
    // patches count for a wanted number of nodes
    let settings = MeshSettings::default();
    let settings = settings.for_nodes_placed(&plate_with_hole(), &electrodes, 4000).unwrap();
    let mesh = generate_placed(&plate_with_hole(), &electrodes, &settings).unwrap();
    let nodes = mesh.surface().nodes().len() as f64;
    assert!((nodes / 4000.0 - 1.0).abs() < 0.1, "{nodes}");
}

/// The triangles of a patch are exactly those inside its outline.
#[test]
fn a_patch_is_a_disc() {
    let patch = [PlacedElectrode::patch([0.02, 0.01, 0.0], 0.03)];
    let mesh = generate_placed(&DISC, &patch, &MeshSettings::with_edge(0.01)).unwrap();
    let Electrode::Patch(triangles) = &mesh.electrodes()[0] else { panic!("a patch") };
    let far = |p: &[f64; 3]| (p[0] - 0.02).hypot(p[1] - 0.01) / 0.03;
    for (t, c) in mesh.surface().centroids().iter().enumerate() {
        assert_eq!(far(c) < 1.0, triangles.contains(&(t as u32)), "{c:?}");
    }
    let on_outline = mesh.surface().nodes().iter().filter(|n| (far(n) - 1.0).abs() < 0.01).count();
    // 19 chords, at the square root of (pi / 19) / (sin cos) = 1.0092 of the radius
    assert_eq!(on_outline, 19);
}

#[test]
fn electrodes_that_are_not_on_the_skin_are_refused_with_their_number() {
    let place = |patches: &[PlacedElectrode]| {
        generate_placed(&plate_with_hole(), patches, &MeshSettings::default())
    };
    let good = PlacedElectrode::patch([0.2, 0.05, 0.0], 0.02);
    for (position_m, radius_m, says) in [
        ([0.12, 0.1, 0.0], 0.005, "in a hole"),
        ([0.4, 0.1, 0.0], 0.01, "outside"),
        ([0.29, 0.1, 0.0], 0.02, "beyond the rim"),
        ([0.08, 0.1, 0.0], 0.0199, "twentieth"),
    ] {
        let error = place(&[good, PlacedElectrode::patch(position_m, radius_m)]).unwrap_err();
        let MeshError::BadPatch { electrode: 2, position_m: at, problem } = error else {
            panic!("{error}")
        };
        assert!(at == position_m && problem.contains(says), "{at:?} {problem}");
    }
    let near = place(&[good, PlacedElectrode::patch([0.24, 0.05, 0.0], 0.0195)]);
    assert_error!(near, MeshError::OverlappingPatches { first: 1, second: 2, .. });
    let above = place(&[good, PlacedElectrode::patch([0.05, 0.05, 0.1], 0.01)]);
    assert_error!(above, MeshError::OffSurface { electrode: 2, .. });
    let rim = |[x, y]: [f64; 2], width_m| PlacedElectrode::rim([x, y, 0.0], width_m);
    assert_error!(place(&[rim([0.15, 0.05], 0.01)]), MeshError::OffRim { electrode: 1, .. });
    let wide = place(&[rim([0.1, 0.0], 0.05), rim([0.14, 0.0], 0.03001)]);
    assert_error!(wide, MeshError::OverlappingElectrodes { .. });
    let dome = SkinShape::Hemisphere { radius_m: 0.1 };
    let patch = [PlacedElectrode::patch([0.0, 0.0, 0.0], 0.01)];
    let inside = generate_placed(&dome, &patch, &MeshSettings::default());
    assert_error!(inside, MeshError::BadPatch { electrode: 1, .. });
}

/// All nodes and edge midpoints lie on the sphere and the rim at z = 0. Area and electrode lengths
/// are exact up to the chords; angles are those of the flat mesh up to the effect of curvature.
#[test]
fn a_hemisphere_is_half_a_sphere() {
    let dome = SkinShape::Hemisphere { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&dome, &electrodes, &MeshSettings::with_edge(0.008)).unwrap();
    let (nodes, triangles) = (mesh.surface().nodes(), mesh.surface().triangles());
    // quadratic elements follow the sphere
    let sides = triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]]]);
    let middles = sides.map(|edge| mesh.midpoint_m(edge).unwrap());
    for p in nodes.iter().copied().chain(middles) {
        assert!((norm(p) / 0.1 - 1.0).abs() < 1e-15 * 8.0 && p[2] >= 0.0, "{p:?}");
    }
    assert_eq!(nodes.iter().filter(|p| p[2] == 0.0).count(), mesh.surface().rim_edges().len());
    // a facet with edges h is smaller by the fraction h^2 / (12 R^2) of its area: 5e-4
    let missing = 1.0 - area_m2(mesh.surface()) / (TAU * 0.01);
    assert!((0.0..2e-3).contains(&missing), "{missing:e}");
    for l in 0..16 {
        let missing = 1.0 - mesh.electrode_measure(l).unwrap() / 0.0196;
        assert!((0.0..1e-4).contains(&missing), "{missing:e}");
    }
    let quality = Quality::of(&mesh);
    assert!(quality.longest_edge_m < 1.5 * 0.008, "{quality}");
    assert!(quality.smallest_angle_deg > LEAST_ANGLE_DEG - 2.0, "{quality}");
    let settings = MeshSettings::default().for_nodes(&dome, &electrodes, 3000).unwrap();
    let nodes = generate(&dome, &electrodes, &settings).unwrap().surface().nodes().len();
    assert!((nodes as f64 / 3000.0 - 1.0).abs() < 0.03, "{nodes}");
}

proptest! {
    #![proptest_config(fixtures::cases(24))]

    /// Any patch that fits, down to the smallest gap to the rim, has its exact area.
    #[test]
    fn any_patch_that_fits_is_meshed(
        angle in 0.0..TAU, from_centre in 0.0..0.9f64, size in 0.01..1.0f64,
    ) {
        let room = 0.1 * (1.0 - from_centre);
        let radius_m = size * room / 1.0501;
        prop_assume!(radius_m > 5e-4);
        let at = [0.1 * from_centre * angle.cos(), 0.1 * from_centre * angle.sin(), 0.0];
        let electrodes =
            [PlacedElectrode::patch(at, radius_m), PlacedElectrode::rim([0.1, 0.0, 0.0], 0.02)];
        let mesh = generate_placed(&DISC, &electrodes, &MeshSettings::default()).unwrap();
        let found = mesh.electrode_measure(0).unwrap();
        prop_assert!((found / (PI * radius_m * radius_m) - 1.0).abs() < 1e-11);
        let quality = Quality::of(&mesh);
        // a gap of a twentieth is narrow: angles as for steep gradings
        prop_assert!(quality.smallest_angle_deg > 15.0, "{}", quality);
    }
}
