//! Electrodes and triangles of a mesh with quantities computed by hand.

use eit_mesh::{
    CsrMatrix, Electrode, Mesh, MeshError, MeshSettings, Outline, Quality, Raster, Repairs, Surface,
};

/// Two right triangles that form an upright 3 m x 4 m rectangle (x = 1, y across), with an
/// equilateral triangle above its upper side.
fn upright() -> Surface {
    let nodes = vec![
        [1.0, 0.0, 0.0],
        [1.0, 3.0, 0.0],
        [1.0, 3.0, 4.0],
        [1.0, 0.0, 4.0],
        [1.0, 1.5, 4.0 + 1.5 * 3f64.sqrt()],
    ];
    Surface::new(nodes, vec![[0, 1, 2], [0, 2, 3], [3, 2, 4]]).unwrap()
}

/// Meshes, rasters and errors can be shared between threads.
const _: () = {
    const fn shared<T: Send + Sync + Clone + std::fmt::Debug>() {}
    shared::<(Mesh, Surface, Raster, CsrMatrix, Outline, MeshSettings, Repairs, MeshError)>();
};

fn close(a: [f64; 3], b: [f64; 3]) -> bool {
    // a few sums and products of numbers below 10
    a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-14)
}

#[test]
fn measure_and_centre_of_rim_and_patch_electrodes() {
    // the lower and the right side (an L of 3 m and 4 m), and the whole rectangle
    let (rim, patch) = (Electrode::Rim(vec![[0, 1], [1, 2]]), Electrode::Patch(vec![1, 0]));
    let mesh = Mesh::new(upright(), vec![rim, patch]).unwrap();
    assert_eq!((mesh.electrode_measure(0), mesh.electrode_measure(1)), (Some(7.0), Some(12.0)));
    // (3 * (1.5, 0) + 4 * (3, 2)) / 7
    let centre = mesh.electrode_centre_m(0).unwrap();
    assert!(close(centre, [1.0, 16.5 / 7.0, 8.0 / 7.0]), "{centre:?}");
    let centre = mesh.electrode_centre_m(1).unwrap();
    assert!(close(centre, [1.0, 1.5, 2.0]), "the middle of the rectangle: {centre:?}");
    assert_eq!((mesh.electrode_measure(2), mesh.electrode_centre_m(usize::MAX)), (None, None));
}

#[test]
fn quality_of_known_triangles() {
    let surface = upright();
    // A = 6, squares 9 + 16 + 25: 4 sqrt(3) 6 / 50
    let right_angled = 24.0 * 3f64.sqrt() / 50.0;
    for (triangle, wanted) in [(0, right_angled), (1, right_angled), (2, 1.0)] {
        let found = surface.triangle_quality(triangle);
        assert!((found - wanted).abs() < 1e-14, "triangle {triangle}: {found}");
    }
    assert!(surface.triangle_quality(3).is_nan());
    let report = Quality::of(&Mesh::new(surface, vec![]).unwrap());
    assert!((report.smallest_quality - right_angled).abs() < 1e-14);
    assert!((report.mean_quality - (2.0 * right_angled + 1.0) / 3.0).abs() < 1e-14);
}

#[test]
fn midpoints_are_kept_for_edges_that_bend() {
    let mesh = Mesh::new(upright(), vec![Electrode::Rim(vec![[0, 1]])]).unwrap();
    let mut asked = Vec::new();
    let straight = |edge: [u32; 2], middle: [f64; 3]| {
        asked.push((edge, middle));
        middle
    };
    let same = mesh.clone().with_midpoints(straight).unwrap();
    assert_eq!(same, mesh, "straight edges are not kept");
    let edges: Vec<[u32; 2]> = asked.iter().map(|(edge, _)| *edge).collect();
    assert_eq!(edges, [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3], [2, 4], [3, 4]]);
    assert!(close(asked[1].1, [1.0, 1.5, 2.0]));

    let bulge = |off: f64| {
        mesh.clone()
            .with_midpoints(|edge, [x, y, z]| [x + if edge == [0, 2] { off } else { 0.0 }, y, z])
    };
    let bent = bulge(0.3).unwrap();
    let both = [[0, 2], [2, 0]].map(|edge| bent.midpoint_m(edge).unwrap());
    assert!(both.iter().all(|middle| close(*middle, [1.3, 1.5, 2.0])), "{both:?}");
    assert_eq!((bent.midpoint_m([0, 1]), bent.midpoint_m([7, 9])), (None, None));

    // the diagonal is 5 m long, so 2.5 m is a semicircle
    for (off, fits) in [(2.5, true), (2.6, false), (f64::NAN, false), (f64::INFINITY, false)] {
        let found = bulge(off).map(drop).map_err(|error| error.to_string());
        assert_eq!(found.is_ok(), fits, "{off}");
        assert!(found.err().is_none_or(|text| text.contains("between nodes 0 and 2")), "{off}");
    }
}
