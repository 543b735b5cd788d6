//! The skin and its electrodes as a network of weighted differences, and its variables.
//!
//! The energy is `sum_b w_b (e_b . y)^2` over branches `b`. Each triangle has three branches,
//! weighted by the conductivity times half the cotangent of the opposite angle. Each part of an
//! electrode has the quadratic form of the deviations from the electrode's mean, divided by `z`.
//! Every branch vanishes for constants, so before the factorisation no small conductance is lost by
//! adding it to a larger one.
//!
//! The variables `y` are the potentials of nodes on no electrode, and for each electrode the mean
//! `mu` of the skin's potential over it (which replaces one of its nodes, the pivot) and the
//! deviations `d` of its other nodes. A small `z` then affects the deviations only.

use crate::error::FemError;
use crate::model::contact::Contact;
use crate::model::{ForwardModel, Geometry, Grain};
use crate::sparse::real::Real;
use std::cmp::Ordering::Equal;

/// Sparse linear combination of variables, in ascending order.
pub(super) type Combination<T> = Vec<(u32, T)>;

/// One term of the energy: a weight times the square of a difference.
pub(super) struct Branch<T> {
    /// Difference whose square the weight multiplies.
    pub difference: Combination<T>,
    /// Conductance, siemens.
    pub weight: T,
    /// Magnitude that the rounding error of the weight is relative to; at least `|weight|`.
    pub size: f64,
}

/// Branches, and the meaning of the variables.
pub(super) struct Network<T> {
    pub branches: Vec<Branch<T>>,
    /// Potential of each node unknown, in terms of the variables.
    pub nodes: Vec<Combination<T>>,
    /// Variable of each electrode's mean.
    pub means: Vec<u32>,
    /// Length (rim) or area (patch) of each electrode.
    pub measures: Vec<T>,
    /// Variables fixed at zero by a contact without impedance.
    pub held: Vec<bool>,
    /// Factor by which conductances have been divided.
    scale: f64,
}

impl<T: Real> Network<T> {
    /// Builds the network from a geometry and validated conductivities that have been divided by
    /// `scale`.
    pub(crate) fn new(
        model: &ForwardModel,
        geometry: &Geometry,
        conductivity_s: &[f64],
        scale: f64,
    ) -> Result<Self, FemError> {
        let count = geometry.positions.len();
        let variable = |i: usize| vec![(i as u32, T::of(1.0))];
        let mut network = Self {
            branches: Vec::with_capacity(3 * conductivity_s.len()),
            nodes: (0..count).map(variable).collect(),
            means: Vec::new(),
            measures: Vec::new(),
            held: vec![false; count],
            scale,
        };
        let mut owners: Vec<Option<usize>> = vec![None; count];
        let memberships = memberships(&model.dofs.contacts, count);
        for (l, contact) in model.dofs.contacts.iter().enumerate() {
            network.add_electrode(l, contact, geometry, &memberships, &mut owners)?;
        }
        // this path supports linear elements only
        let (triangles, _) = model.dofs.element_nodes.as_chunks::<3>();
        for (index, (triangle, &sigma)) in triangles.iter().zip(conductivity_s).enumerate() {
            let grain = geometry.anisotropy.as_ref().map(|anisotropy| anisotropy.grains()[index]);
            network.add_triangle(*triangle, geometry, sigma, grain);
        }
        Ok(network)
    }

    /// Introduces the variables of electrode `l` and adds the branches of its contact.
    fn add_electrode(
        &mut self,
        l: usize,
        contact: &Contact,
        geometry: &Geometry,
        memberships: &[u32],
        owners: &mut [Option<usize>],
    ) -> Result<(), FemError> {
        let impedance = geometry.impedance[l];
        let parts: Vec<(&[u32], T)> = contact
            .parts()
            .iter()
            .map(|nodes| (nodes.as_slice(), measure(nodes, &geometry.positions)))
            .collect();
        let weights = mean_weights(&parts);
        let shared = |i: u32| memberships[i as usize] > 1;
        let taken = |i: u32, owners: &[Option<usize>]| owners[i as usize].is_some();
        // the mean replaces the heaviest node, preferably one of this electrode only
        let pivot = weights
            .iter()
            .filter(|(i, _)| !taken(*i, owners))
            .max_by(|a, b| {
                (!shared(a.0), a.1.high()).partial_cmp(&(!shared(b.0), b.1.high())).unwrap_or(Equal)
            })
            .map(|(i, _)| *i)
            .ok_or(FemError::NoNodeOfItsOwn { electrode: l + 1 })?;
        if impedance == 0.0 && weights.iter().any(|(i, _)| shared(*i)) {
            return Err(FemError::TouchingShunt { electrode: l + 1 });
        }
        let heaviest = weights.iter().find(|w| w.0 == pivot).map_or(T::of(1.0), |w| w.1);
        let mean = vec![(pivot, T::of(1.0))];
        let mut of_pivot = Vec::new();
        for &(i, weight) in weights.iter().filter(|w| w.0 != pivot) {
            let factor = -(weight / heaviest);
            if taken(i, owners) {
                let deviation = difference(&self.nodes[i as usize], &mean);
                of_pivot.extend(deviation.iter().map(|&(j, c)| (j, factor * c)));
            } else {
                owners[i as usize] = Some(l);
                self.held[i as usize] = impedance == 0.0;
                self.nodes[i as usize] = merge(vec![(pivot, T::of(1.0)), (i, T::of(1.0))]);
                of_pivot.push((i, factor));
            }
        }
        owners[pivot as usize] = Some(l);
        of_pivot.extend(&mean);
        self.nodes[pivot as usize] = merge(of_pivot);
        self.means.push(pivot);
        self.measures.push(parts.iter().fold(T::of(0.0), |sum, part| sum + part.1));
        if impedance > 0.0 && impedance.is_finite() {
            self.add_contact(&parts, &mean, impedance);
        }
        Ok(())
    }

    /// Adds the form `1/z integral of (u - mu)^2`. For hat functions on a part of measure `h` with
    /// `d` nodes it is `h / (d (d+1)) (sum of squares + square of the sum)`.
    fn add_contact(&mut self, parts: &[(&[u32], T)], mean: &Combination<T>, impedance: f64) {
        for (nodes, measure) in parts {
            let count = nodes.len() as f64;
            let admittance = *measure / (T::of(impedance) * T::of(self.scale));
            let weight = admittance / T::of(count * (count + 1.0));
            let deviations: Vec<Combination<T>> =
                nodes.iter().map(|&i| difference(&self.nodes[i as usize], mean)).collect();
            let sum = merge(deviations.iter().flatten().copied().collect());
            for difference in deviations.into_iter().chain([sum]) {
                self.branches.push(Branch { difference, weight, size: weight.high() });
            }
        }
    }

    /// Adds the three branches of a triangle, weighted by half the cotangent of the angle opposite
    /// each edge.
    fn add_triangle(
        &mut self,
        triangle: [u32; 3],
        geometry: &Geometry,
        sigma: f64,
        grain: Option<Grain>,
    ) {
        let corner = |k: usize| geometry.positions[triangle[k % 3] as usize];
        for k in 0..3 {
            let (a, b) = (edge(corner(k), corner(k + 1)), edge(corner(k), corner(k + 2)));
            let double_area = length(cross(a, b));
            let scale = T::of(sigma) / (T::of(2.0) * double_area);
            let (mut dot, mut product) = dot(a, b);
            if let Some(Grain { ratio, direction }) = grain {
                (dot, product) = along_and_across(a, b, (dot, product), ratio, direction);
            }
            // covers rounding of the edges' dot product and of the area of a flat triangle
            let flat = (length(a) * length(b) / double_area).high();
            let size = scale.high() * (product + dot.high().abs() * flat);
            let [i, j] = [triangle[(k + 1) % 3], triangle[(k + 2) % 3]];
            let difference = difference(&self.nodes[i as usize], &self.nodes[j as usize]);
            self.branches.push(Branch { difference, weight: scale * dot, size });
        }
    }
}

/// Number of electrodes that each node belongs to.
fn memberships(contacts: &[Contact], count: usize) -> Vec<u32> {
    let mut found = vec![0; count];
    for contact in contacts {
        let mut nodes: Vec<u32> = contact.parts().iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.iter().for_each(|&i| found[i as usize] += 1);
    }
    found
}

/// Integral of each node's hat function over the electrode, in ascending order of nodes.
fn mean_weights<T: Real>(parts: &[(&[u32], T)]) -> Combination<T> {
    let share = |(nodes, measure): &(&[u32], T)| -> Combination<T> {
        let each = *measure / T::of(nodes.len() as f64);
        nodes.iter().map(|&i| (i, each)).collect()
    };
    merge(parts.iter().flat_map(share).collect())
}

/// Adds up the terms of each variable and drops exact zeros.
fn merge<T: Real>(mut terms: Combination<T>) -> Combination<T> {
    terms.sort_by_key(|t| t.0);
    let mut merged: Combination<T> = Vec::with_capacity(terms.len());
    for (i, c) in terms {
        match merged.last_mut() {
            Some(last) if last.0 == i => last.1 += c,
            _ => merged.push((i, c)),
        }
    }
    merged.retain(|t| t.1.high() != 0.0);
    merged
}

fn difference<T: Real>(a: &Combination<T>, b: &Combination<T>) -> Combination<T> {
    merge(a.iter().copied().chain(b.iter().map(|&(i, c)| (i, -c))).collect())
}

type Vector<T> = [T; 3];

fn edge<T: Real>(from: [f64; 3], to: [f64; 3]) -> Vector<T> {
    std::array::from_fn(|k| T::of(to[k]) - T::of(from[k]))
}

fn cross<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    let minor = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    [minor(1, 2), minor(2, 0), minor(0, 1)]
}

fn length<T: Real>(a: Vector<T>) -> T {
    dot(a, a).0.sqrt()
}

/// Dot product, and the sum of the magnitudes of its terms.
fn dot<T: Real>(a: Vector<T>, b: Vector<T>) -> (T, f64) {
    let terms: [T; 3] = std::array::from_fn(|c| a[c] * b[c]);
    (terms[0] + terms[1] + terms[2], terms.iter().map(|t| t.high().abs()).sum())
}

/// Dot product of two edges in the plane where the element's conductivity is a scalar, and its size:
/// `sqrt(r) a . b + (1/sqrt(r) - sqrt(r)) (d . a) (d . b) / (d . d)` ([`Anisotropy`](crate::Anisotropy)).
fn along_and_across<T: Real>(
    a: Vector<T>,
    b: Vector<T>,
    (product, size): (T, f64),
    ratio: f64,
    direction: [f64; 3],
) -> (T, f64) {
    let normal = cross(a, b);
    let direction = direction.map(T::of);
    let out = dot(direction, normal).0;
    // square of the direction's part in the plane
    let square = dot(direction, direction).0 - out * out / dot(normal, normal).0;
    let across = T::of(ratio).sqrt();
    let factor = (T::of(1.0) / across - across) / square;
    let [(along_a, size_a), (along_b, size_b)] = [a, b].map(|edge| dot(direction, edge));
    let mapped = across * product + factor * along_a * along_b;
    let directed = size_a * along_b.high().abs() + size_b * along_a.high().abs();
    // covers the rounding of the part in the plane too
    let directed = directed * (dot(direction, direction).0 / square).high();
    (mapped, across.high() * size + factor.high().abs() * directed)
}

/// Computes the length of an edge or the area of a triangle.
fn measure<T: Real>(nodes: &[u32], positions: &[[f64; 3]]) -> T {
    let place = |k: usize| positions[nodes[k] as usize];
    match nodes.len() {
        2 => length(edge(place(0), place(1))),
        3 => T::of(0.5) * length(cross(edge(place(0), place(1)), edge(place(0), place(2)))),
        // parts are edges or triangles
        _ => T::of(0.0),
    }
}
