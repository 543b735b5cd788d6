//! Movement of the mesh nodes under touches, and the resulting change of contact impedances.
//!
//! Near the rim, the rim's stiffness reduces the displacement of the free fabric, both in the plane
//! and downwards. With the distance `D` to the rim and the membrane's length `l`, a node moves by
//!
//! ```text
//! (1 - (1 - compliance) exp(-D / l)) times the sum over touches of (u(r) away from it, -w(r))
//! ```
//!
//! so the rim itself moves by the fraction `compliance`. A fabric that is pulled down beside an
//! electrode presses on it: `ln(z / z_0) = -contact_gain w / l`, with the free deflection `w` at
//! the electrode.
//!
//! A moving finger drags the fabric with the friction force `mu F`. Around an in-plane force, an
//! elastic sheet of stiffness `Y` moves by (the isotropic part of Kelvin's solution in plane
//! stress; Love, A Treatise on the Mathematical Theory of Elasticity, section 148)
//!
//! ```text
//! mu F (1 + nu)(3 - nu) / (4 pi Y) ln(L / max(r, a)),   none beyond r = L
//! ```
//!
//! in the direction of the movement, where `a` is the contact radius and `L`, half the skin's
//! longer side, is the distance at which the rim holds the fabric.

use super::contact::Indentation;
use super::piezo::PiezoLaw;
use super::seat::Seat;
use super::settings::{FabricSettings, Piezoresistance, Rim};
use eit_core::vector::{along, distance, dot, norm, sub};
use eit_mesh::{Electrode, Mesh};
use std::f64::consts::{E, PI, TAU};

/// A dent and its position, metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub seat: Seat,
    pub dent: Indentation,
    /// Displacement by friction at the distance where the logarithm is one, metres.
    pub drag_m: [f64; 3],
    /// Height of the ring around it, as a drive, and the radius at which it is highest, metres.
    pub ring: [f64; 2],
    /// Unit vector along the long axis of the print, and the square root of the ratio of its axes.
    pub axis: [f64; 3],
    pub stretch: f64,
}

impl Placed {
    /// Distance at which the round dent is what this elliptic one is at a place, metres.
    pub(crate) fn distance_m(&self, place_m: [f64; 3]) -> f64 {
        let distance_m = self.seat.distance_m(place_m);
        if self.stretch == 1.0 {
            return distance_m;
        }
        let x = dot(sub(place_m, self.seat.place_m), self.axis);
        let y = (distance_m.powi(2) - x * x).max(0.0).sqrt();
        (x / self.stretch).hypot(y * self.stretch)
    }

    /// Height `a x^2 exp(1 - x^2)` of the ring at `x` radii from the centre.
    pub(crate) fn ring_at(&self, distance_m: f64) -> f64 {
        let [height, radius_m] = self.ring;
        if height == 0.0 {
            return 0.0;
        }
        let square = (distance_m / radius_m).powi(2);
        height * square * (1.0 - square).exp()
    }
}

/// Height of a ring whose integral over the sheet, `e pi radius^2 height`, is minus a share of that of a dent's drive.
pub(super) fn ring(piezo: &Piezoresistance, dent: &Indentation, length_m: f64) -> [f64; 2] {
    /// Midpoints of the integral over the radius.
    const POINTS: usize = 400;
    let Piezoresistance { ring, ring_radius_m, .. } = *piezo;
    if ring == 0.0 {
        return [0.0, ring_radius_m];
    }
    let law = PiezoLaw::new(piezo, 1.0);
    // strains fall with K1^2, to e^-20 of their value ten lengths away
    let step_m = (dent.contact_radius_m + 10.0 * length_m) / POINTS as f64;
    let radii_m = (0..POINTS).map(|k| (k as f64 + 0.5) * step_m);
    let integral: f64 = radii_m.map(|r| TAU * r * step_m * law.drive(&dent.at(r))).sum();
    [-ring * integral / (E * PI * ring_radius_m.powi(2)), ring_radius_m]
}

/// Data for node movement that does not change between frames.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    rim: Rim,
    length_m: f64,
    /// Whether touches move the nodes.
    pub moves: bool,
    /// Half of the skin's longer side, metres.
    pub half_m: f64,
    nodes_m: Vec<[f64; 3]>,
    /// Fraction of the free displacement by which each node moves.
    follows: Vec<f64>,
    /// Nodes of each electrode, with weights that sum to one.
    electrodes: Vec<Vec<(u32, f64)>>,
}

impl Motion {
    pub(crate) fn new(mesh: &Mesh, settings: &FabricSettings) -> Self {
        let surface = mesh.surface();
        let nodes_m = surface.nodes().to_vec();
        let membrane = &settings.membrane;
        let length_m = membrane.length_m();
        let rim: Vec<[[f64; 3]; 2]> =
            surface.rim_edges().iter().map(|e| e.map(|n| nodes_m[n as usize])).collect();
        let follows = |p: &[f64; 3]| {
            let distance = |[a, b]: &[[f64; 3]; 2]| segment_distance_m(*p, *a, *b);
            let nearest = rim.iter().map(distance).fold(f64::INFINITY, f64::min);
            1.0 - (1.0 - settings.rim.compliance) * (-nearest / length_m).exp()
        };
        Self {
            rim: settings.rim,
            length_m,
            moves: membrane.moves_nodes,
            half_m: {
                let [low, high] = surface.bounds_m();
                0.5 * (high[0] - low[0]).max(high[1] - low[1])
            },
            follows: nodes_m.iter().map(follows).collect(),
            electrodes: mesh.electrodes().iter().map(|e| weights(mesh, e)).collect(),
            nodes_m,
        }
    }

    /// Fraction of the free displacement by which a node moves.
    pub(crate) fn follows(&self, node: u32) -> f64 {
        self.follows[node as usize]
    }

    /// Computes the node positions under touches, metres.
    pub(crate) fn nodes_into(&self, touches: &[Placed], nodes_m: &mut [[f64; 3]]) {
        let places = self.nodes_m.iter().zip(&self.follows);
        for (moved, (place, follows)) in nodes_m.iter_mut().zip(places) {
            *moved = *place;
            for touch in touches {
                let (r, along) = (touch.distance_m(*place), touch.seat.offset(*place));
                let dent = touch.dent.at(r);
                let outward = if r > 0.0 { dent.displacement_m / r } else { 0.0 };
                let near = r.max(touch.dent.contact_radius_m);
                let dragged = (self.half_m / near).ln().max(0.0);
                for k in 0..3 {
                    moved[k] += follows * (outward * along[k] + dragged * touch.drag_m[k]);
                    moved[k] -= follows * dent.deflection_m * touch.seat.normal[k];
                }
            }
        }
    }

    /// Computes the mean displacement of each electrode, metres.
    pub(crate) fn shifts_into(&self, nodes_m: &[[f64; 3]], shifts_m: &mut [[f64; 3]]) {
        for (shift, nodes) in shifts_m.iter_mut().zip(&self.electrodes) {
            *shift = std::array::from_fn(|k| {
                let part = |&(n, weight): &(u32, f64)| {
                    weight * (nodes_m[n as usize][k] - self.nodes_m[n as usize][k])
                };
                nodes.iter().map(part).sum()
            });
        }
    }

    /// Adds the change of ln(contact impedance) of each electrode to `logs`, where dents make a deflection, metres.
    pub(crate) fn add_contacts(&self, deflection_m: impl Fn([f64; 3]) -> f64, logs: &mut [f64]) {
        if self.rim.contact_gain == 0.0 {
            return;
        }
        for (log, nodes) in logs.iter_mut().zip(&self.electrodes) {
            for &(n, weight) in nodes {
                let deflection_m = deflection_m(self.nodes_m[n as usize]);
                *log -= self.rim.contact_gain * weight * deflection_m / self.length_m;
            }
        }
    }
}

/// Nodes of an electrode, weighted by length or area; the weights sum to one.
fn weights(mesh: &Mesh, electrode: &Electrode) -> Vec<(u32, f64)> {
    let surface = mesh.surface();
    let mut weights: Vec<(u32, f64)> = match electrode {
        Electrode::Rim(edges) => {
            let place = |n: u32| surface.nodes()[n as usize];
            let half = |[a, b]: [u32; 2]| 0.5 * distance(place(a), place(b));
            edges.iter().flat_map(|e| e.map(|n| (n, half(*e)))).collect()
        }
        Electrode::Patch(triangles) => triangles
            .iter()
            .flat_map(|&t| {
                let third = surface.areas_m2()[t as usize] / 3.0;
                surface.triangles()[t as usize].map(|n| (n, third))
            })
            .collect(),
    };
    weights.sort_unstable_by_key(|w| w.0);
    weights.dedup_by(|next, first| {
        let same = next.0 == first.0;
        if same {
            first.1 += next.1;
        }
        same
    });
    let total: f64 = weights.iter().map(|w| w.1).sum();
    weights.iter_mut().for_each(|w| w.1 /= total);
    weights
}

/// Distance from a point to a segment, metres.
pub(super) fn segment_distance_m(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let (segment, to) = (sub(b, a), sub(p, a));
    let square = dot(segment, segment);
    let s = if square > 0.0 { (dot(to, segment) / square).clamp(0.0, 1.0) } else { 0.0 };
    norm(along(to, -s, segment))
}
