//! Elements of the untouched skin: how they strain, and which electrodes they stretch.

use super::profile::{Felt, From};
use crate::fabric::fabric_model::Fabric;
use crate::fabric::motion::Placed;
use eit_core::vector::{Vector, along, cross, dot, norm, normal, scaled, sub, unit};
use eit_mesh::{Electrode, Mesh};

/// Strain of an element in its frame: 11, 22, 12, and its rotation from 1 to 2, on which an anisotropic sheet depends.
pub(super) type Strain = [f64; 4];

/// One element.
pub(super) struct Tile {
    pub(super) middle_m: Vector,
    /// Largest distance of a corner from the middle, metres.
    pub(super) size_m: f64,
    /// Unit vectors in its plane, and its normal.
    pub(super) frame: [Vector; 3],
    /// Fraction of the free displacement by which it moves, and its gradient, 1/m.
    pub(super) follows: f64,
    pub(super) rise: [f64; 2],
    /// `S22 - S11` and `-2 S12` of [`crate::derivatives::movement`] for each component of the strain.
    pub(super) shears: [Strain; 2],
}

/// Displacement of the free fabric at an element, along its frame and its normal, and the gradient in its plane.
#[derive(Default)]
pub(super) struct Moved {
    along_m: [f64; 3],
    /// `[i][j]`: component `i` along `j`.
    gradient: [[f64; 2]; 3],
}

impl Moved {
    /// Adds the displacement by a touch, of which `felt` is what the element feels; friction drags up to `end_m`.
    #[inline(always)]
    pub(super) fn add(&mut self, tile: &Tile, touch: &Placed, from: &From, felt: Felt, end_m: f64) {
        let within = |v: Vector| tile.frame.map(|axis| dot(axis, v));
        let Felt { slope, across, areal_strain, deflection_m, .. } = felt;
        let (r, [x, y, _]) = (from.distance_m, within(from.outward));
        let (outward, normal) = ([x, y], within(touch.seat.normal));
        let bend = from.per_m * (areal_strain - 0.5 * slope * slope - 2.0 * across);
        self.shift(within(from.offset_m), across, bend, outward);
        for (i, row) in self.gradient.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry += across * (if i == j { 1.0 } else { 0.0 } - normal[i] * normal[j]);
            }
        }
        self.shift(normal, -deflection_m, -slope, outward);
        if touch.drag_m != [0.0; 3] && r < end_m {
            let fall = if r > touch.dent.contact_radius_m { -from.per_m } else { 0.0 };
            self.shift(within(touch.drag_m), felt.dragged, fall, outward);
        }
    }

    /// Adds a displacement along a vector, whose amount has the gradient `rise` along `outward`.
    #[inline(always)]
    fn shift(&mut self, along_m: [f64; 3], amount: f64, rise: f64, outward: [f64; 2]) {
        for (i, part_m) in along_m.into_iter().enumerate() {
            self.along_m[i] += amount * part_m;
            self.gradient[i] = [0, 1].map(|j| self.gradient[i][j] + rise * part_m * outward[j]);
        }
    }

    /// Strain of an element as far as it follows the free fabric.
    #[inline(always)]
    pub(super) fn strain(&self, tile: &Tile) -> Strain {
        let Tile { follows, rise, .. } = tile;
        let d: [[f64; 2]; 3] = std::array::from_fn(|i| {
            [0, 1].map(|j| follows * self.gradient[i][j] + self.along_m[i] * rise[j])
        });
        let twice_green = |i: usize, j: usize| {
            d[i][j] + d[j][i] + d.iter().map(|row| row[i] * row[j]).sum::<f64>()
        };
        let [c11, c22, c12] = [1.0 + twice_green(0, 0), 1.0 + twice_green(1, 1), twice_green(0, 1)];
        // half the logarithm of a symmetric matrix, by its eigenvalues
        let (mean, half) = (0.5 * (c11 + c22), 0.5 * (c11 - c22));
        let square = (half * half + c12 * c12) / (mean * mean);
        let dilation = 0.25 * (mean * mean * (1.0 - square)).ln();
        // atanh(x) / x, by its series up to x = 0.3, to 1e-5
        let ratio = match square < 0.09 {
            true => 1.0 + square * (1.0 / 3.0 + square * (0.2 + square / 7.0)),
            false => square.sqrt().atanh() / square.sqrt(),
        };
        let part = 0.5 * ratio / mean;
        let turn = 0.5 * (d[1][0] - d[0][1]);
        [dilation + part * half, dilation - part * half, part * c12, turn]
    }
}

/// Where the elements are, and how they follow and act.
pub(super) fn tiles(fabric: &Fabric) -> Vec<Tile> {
    let surface = fabric.mesh.surface();
    let grains = fabric.model.anisotropy().map(|a| a.grains());
    let tile = |(t, nodes): (usize, &[u32; 3])| {
        let corners = surface.corners(t);
        let (middle_m, size_m) = fabric.elements.middle(t);
        let up = unit(normal(corners));
        let first = unit(sub(corners[1], corners[0]));
        let frame = [first, cross(up, first), up];
        let follows = nodes.map(|n| fabric.motion.follows(n));
        // gradient of the linear function of its corners
        let (e1, e2) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let (f1, f2) = (follows[1] - follows[0], follows[2] - follows[0]);
        let double_area = norm(cross(e1, e2));
        let gradient =
            scaled(1.0 / double_area, along(scaled(f1, cross(e2, up)), f2, cross(up, e1)));
        let shear = |strain: Strain| {
            let pull = |v: Vector| {
                let [x, y, _] = frame.map(|axis| dot(axis, v));
                let [s11, s22, s12, turn] = strain;
                let pulled = scaled(s11 * x + (s12 - turn) * y, frame[0]);
                along(pulled, (s12 + turn) * x + s22 * y, frame[1])
            };
            let vectors = corners.map(|corner| pull(sub(corner, corners[0])));
            crate::derivatives::movement::strain(corners, vectors, grains.map(|grains| &grains[t]))
        };
        let unit = |k: usize| std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
        let units: [[f64; 2]; 4] = std::array::from_fn(|k| shear(unit(k)));
        Tile {
            middle_m,
            size_m,
            frame,
            follows: follows.iter().sum::<f64>() / 3.0,
            rise: [0, 1].map(|k| dot(frame[k], gradient)),
            shears: [0, 1].map(|k| units.map(|unit| unit[k])),
        }
    };
    surface.triangles().iter().enumerate().map(tile).collect()
}

/// Weights of the strains of elements in the relative stretch of each electrode.
pub(super) fn stretches(mesh: &Mesh, tiles: &[Tile]) -> Vec<Vec<(usize, Strain)>> {
    let surface = mesh.surface();
    let place = |n: u32| surface.nodes()[n as usize];
    let of_edge = |[a, b]: &[u32; 2]| {
        let beside = surface.triangles().iter().position(|t| t.contains(a) && t.contains(b))?;
        let edge = sub(place(*b), place(*a));
        let [x, y, _] = tiles[beside].frame.map(|axis| dot(axis, unit(edge)));
        Some((beside, norm(edge), [x * x, y * y, 2.0 * x * y, 0.0]))
    };
    let of_electrode = |electrode: &Electrode| {
        let parts: Vec<(usize, f64, Strain)> = match electrode {
            Electrode::Rim(edges) => edges.iter().filter_map(of_edge).collect(),
            Electrode::Patch(triangles) => {
                let part =
                    |&t: &u32| (t as usize, surface.areas_m2()[t as usize], [1.0, 1.0, 0.0, 0.0]);
                triangles.iter().map(part).collect()
            }
        };
        let whole: f64 = parts.iter().map(|part| part.1).sum();
        let weighted = |(e, measure, weights): (usize, f64, Strain)| {
            (e, weights.map(|weight| weight * measure / whole))
        };
        parts.into_iter().map(weighted).collect()
    };
    mesh.electrodes().iter().map(of_electrode).collect()
}
