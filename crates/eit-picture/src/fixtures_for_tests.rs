//! Skins and images for the unit tests of this crate.

use std::f64::consts::TAU;

use ndarray::Array3;

use crate::{ElectrodeDrawing, Extent, SkinDrawing};

/// Radius of [`disc`].
pub(crate) const RADIUS_M: f64 = 0.1;

fn arc(from: f64, to: f64, points: usize) -> Vec<[f64; 2]> {
    (0..points)
        .map(|k| from + (to - from) * k as f64 / (points - 1) as f64)
        .map(|angle| [RADIUS_M * angle.cos(), RADIUS_M * angle.sin()])
        .collect()
}

/// A disc of 0.1 m radius whose electrodes cover half of the rim, the first at the top.
pub(crate) fn disc(electrodes: usize) -> SkinDrawing {
    let each = TAU / electrodes.max(1) as f64;
    let electrode = |k: usize| {
        let centre = TAU / 4.0 + k as f64 * each;
        let rim_m = arc(centre - each / 4.0, centre + each / 4.0, 9);
        ElectrodeDrawing { number: k + 1, rim_m, drawn: true }
    };
    let (low, high) = (-RADIUS_M, RADIUS_M);
    SkinDrawing {
        outlines_m: vec![arc(0.0, TAU, 361)],
        electrodes: (0..electrodes).map(electrode).collect(),
        extent: Extent { x_min_m: low, x_max_m: high, y_min_m: low, y_max_m: high },
    }
}

/// A square patch electrode.
pub(crate) fn inner_box(number: usize, [x, y]: [f64; 2], half_side_m: f64) -> ElectrodeDrawing {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let rim_m = corners.map(|c| [x + c[0] * half_side_m, y + c[1] * half_side_m]).to_vec();
    ElectrodeDrawing { number, rim_m, drawn: true }
}

/// A bump of 2 microsiemens that moves around the disc once.
pub(crate) fn walk(frames: usize, pixels: usize) -> Array3<f64> {
    let centre = |k: usize| (k as f64 + 0.5) * 2.0 * RADIUS_M / pixels as f64 - RADIUS_M;
    Array3::from_shape_fn((frames, pixels, pixels), |(frame, row, column)| {
        let (x, y) = (centre(column), -centre(row));
        if x.hypot(y) > RADIUS_M {
            return f64::NAN;
        }
        let angle = TAU * frame as f64 / frames as f64;
        let squared = (x - 0.05 * angle.cos()).powi(2) + (y - 0.05 * angle.sin()).powi(2);
        2e-6 * (-squared / (2.0 * 0.02_f64.powi(2))).exp()
    })
}
