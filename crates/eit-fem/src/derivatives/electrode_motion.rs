//! How nodes move when an electrode does.
//!
//! Two kinds. An electrode that **slides** changes its place on a skin that stays: only the ends of
//! its support move. Nodes of the rim then move along the rim, nodes inside follow, and the domain
//! stays what it is (on a rim of chords to the second order in their length). An electrode that is
//! **carried** goes with the skin: its nodes and those around it are shifted, as stretched fabric
//! does, and the rim bends.
//!
//! The displacement reaches about one width of the electrode into the skin instead of moving the
//! end's node alone. For the discrete model either is exact. But as a derivative of the skin's
//! voltages, moving one node changes the size of the triangles at the singular end and with it the
//! error of the voltages: `docs/DESIGN.md` has the numbers. (Volume and boundary forms of shape
//! derivatives: Hiptmair, Paganini, Sargheini, *BIT* 55 (2015), 459-485; the boundary form for
//! electrodes: Darde, Hakula, Hyvonen, Staboulis, *Inverse Probl. Imaging* 6 (2012), 399-421.)
//!
//! Long, because the way along the rim, its corners and the reach into the skin are one thing.

use super::displacement::Displacement;
use crate::error::FemError;
use crate::vector::{Vector, along, cross, dot, norm, scaled, sub, unit};
use eit_mesh::{Electrode, Mesh};
use std::collections::HashMap;

/// Rim that turns by more than this in one node has a corner there: the mesher's coarsest arcs turn
/// by 30 degrees. Its cosine is that of 35 degrees.
const CORNER_COSINE: f64 = 0.819;

/// A displacement reaches no farther into the skin than this part of the root of its area.
const DEEPEST: f64 = 0.25;

/// How an electrode moves, for each metre of its parameter.
///
/// Along the rim means with the skin on the left, on the outer rim of a flat skin
/// counter-clockwise. Conductivities stay with their triangles, so where they vary within a width of
/// the electrode, a sliding electrode takes them along.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ElectrodeMotion {
    /// Both ends slide along the rim, over a skin that stays.
    Slide,
    /// The ends slide apart, each by half, over a skin that stays: the width grows by the
    /// parameter.
    Widen,
    /// The electrode is carried by the skin, along its own chord.
    CarriedAlong,
    /// The electrode is carried by the skin, outward in the skin's plane.
    CarriedOutward,
    /// The electrode, rim or patch, is carried by the skin along a vector.
    Carried([f64; 3]),
    /// The electrode is stretched with the skin along its chord: the width grows by the parameter.
    Stretched,
}

impl ElectrodeMotion {
    /// The displacement of one electrode (index from 0), in node order of the mesh.
    ///
    /// # Errors
    /// [`FemError::NoSuchElectrode`]; [`FemError::Immovable`] for a patch along the rim, an end at a
    /// corner or on another electrode, an electrode that is not one piece of rim.
    pub fn displacement(&self, mesh: &Mesh, electrode: usize) -> Result<Displacement, FemError> {
        let electrodes = mesh.electrodes().len();
        if electrode >= electrodes {
            let what = "electrode motion";
            return Err(FemError::NoSuchElectrode { what, number: electrode + 1, electrodes });
        }
        Skin::new(mesh).displacement(*self, electrode)
    }

    /// The displacements of all electrodes, electrode 1 first.
    ///
    /// # Errors
    /// Those of [`ElectrodeMotion::displacement`].
    pub fn displacements(&self, mesh: &Mesh) -> Result<Vec<Displacement>, FemError> {
        let skin = Skin::new(mesh);
        (0..mesh.electrodes().len()).map(|l| skin.displacement(*self, l)).collect()
    }
}

/// Of a node at `x` reaches from where it is all: 1 and then down to 0, both without slope.
fn fade(x: f64) -> f64 {
    if x < 1.0 { (1.0 - x) * (1.0 - x) * (1.0 + 2.0 * x) } else { 0.0 }
}

/// A mesh with what moving along its rim needs.
struct Skin<'a> {
    mesh: &'a Mesh,
    nodes: &'a [Vector],
    /// Node after and before each rim node.
    next: HashMap<u32, u32>,
    before: HashMap<u32, u32>,
    /// Rim nodes that two pieces of rim share: nothing moves past them.
    pinched: Vec<u32>,
    /// Electrodes of each node, at most two counted: the first, and whether there are others.
    owner: HashMap<u32, (usize, bool)>,
    /// Normal of the skin at each node, not of unit length.
    normals: Vec<Vector>,
    depth_m: f64,
}

/// An end of a step on the way along the rim: a node and what it moves by.
type Stop = (u32, Vector);

impl<'a> Skin<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let surface = mesh.surface();
        let (mut next, mut before) = (HashMap::new(), HashMap::new());
        let mut pinched = Vec::new();
        for &[a, b] in surface.rim_edges() {
            pinched.extend(next.insert(a, b).map(|_| a));
            before.insert(b, a);
        }
        let mut owner: HashMap<u32, (usize, bool)> = HashMap::new();
        for (l, electrode) in mesh.electrodes().iter().enumerate() {
            for node in nodes_of(mesh, electrode) {
                owner
                    .entry(node)
                    .and_modify(|(first, others)| *others |= *first != l)
                    .or_insert((l, false));
            }
        }
        let mut normals = vec![[0.0; 3]; surface.nodes().len()];
        for (index, triangle) in surface.triangles().iter().enumerate() {
            let [a, b, c] = surface.corners(index);
            let normal = cross(sub(b, a), sub(c, a));
            for &node in triangle {
                normals[node as usize] = along(normals[node as usize], 1.0, normal);
            }
        }
        let depth_m = DEEPEST * surface.areas_m2().iter().sum::<f64>().sqrt();
        let nodes = surface.nodes();
        Self { mesh, nodes, next, before, pinched, owner, normals, depth_m }
    }

    fn displacement(&self, motion: ElectrodeMotion, l: usize) -> Result<Displacement, FemError> {
        match motion {
            ElectrodeMotion::Slide => self.slide(l, [1.0, 1.0]),
            ElectrodeMotion::Widen => self.slide(l, [-0.5, 0.5]),
            ElectrodeMotion::Carried(vector) => Ok(self.carry(l, |_| vector)),
            ElectrodeMotion::CarriedAlong => {
                let chord = self.chord(l)?;
                Ok(self.carry(l, |_| chord.direction))
            }
            ElectrodeMotion::CarriedOutward => {
                let chord = self.chord(l)?;
                Ok(self.carry(l, |_| chord.outward))
            }
            ElectrodeMotion::Stretched => {
                let Chord { direction, centre, width_m, .. } = self.chord(l)?;
                let part = |p: Vector| dot(sub(p, centre), direction) / width_m;
                Ok(self.carry(l, |p| scaled(part(p), direction)))
            }
        }
    }

    fn place(&self, node: u32) -> Vector {
        self.nodes[node as usize]
    }

    fn distance(&self, a: u32, b: u32) -> f64 {
        norm(sub(self.place(b), self.place(a)))
    }

    /// Nodes of a rim electrode in the order of the rim.
    fn path(&self, l: usize) -> Result<Vec<u32>, FemError> {
        let immovable = |why| FemError::Immovable { electrode: l + 1, why };
        let Electrode::Rim(edges) = &self.mesh.electrodes()[l] else {
            return Err(immovable("it is a patch, which has no ends on the rim"));
        };
        let pieces = immovable("its edges are not one piece of rim with two ends");
        let step = |&[a, b]: &[u32; 2]| if self.next.get(&a) == Some(&b) { (a, b) } else { (b, a) };
        let steps: HashMap<u32, u32> = edges.iter().map(step).collect();
        let is_start = |node: &&u32| {
            self.before.get(*node).is_none_or(|before| steps.get(before) != Some(*node))
        };
        let mut starts = steps.keys().filter(is_start);
        let (Some(&start), None) = (starts.next(), starts.next()) else { return Err(pieces) };
        let mut path = vec![start];
        let mut at = start;
        while let Some(&to) = steps.get(&at) {
            path.push(to);
            at = to;
        }
        if path.len() == edges.len() + 1 { Ok(path) } else { Err(pieces) }
    }

    /// Direction of the rim at a node, exact on a circle; `None` at a corner.
    fn tangent(&self, node: u32) -> Option<Vector> {
        if self.pinched.contains(&node) {
            return None;
        }
        let (before, next) = (*self.before.get(&node)?, *self.next.get(&node)?);
        let [into, out] =
            [(before, node), (node, next)].map(|(a, b)| sub(self.place(b), self.place(a)));
        let (h, k) = (norm(into), norm(out));
        if dot(into, out) < CORNER_COSINE * h * k {
            return None;
        }
        // chords of h and k leave the tangent by angles in proportion to their lengths
        unit(along(scaled(k / h, into), h / k, out))
    }

    /// What both ends of an electrode, by `ends` along the rim, move.
    fn slide(&self, l: usize, ends: [f64; 2]) -> Result<Displacement, FemError> {
        let immovable = |why| FemError::Immovable { electrode: l + 1, why };
        let path = self.path(l)?;
        let (first, last) = (path[0], path[path.len() - 1]);
        for end in [first, last] {
            if self.owner.get(&end).is_some_and(|(_, others)| *others) {
                return Err(immovable("it touches another electrode"));
            }
            self.tangent(end).ok_or(immovable("an end is at a corner of the skin"))?;
        }
        let (inside, width_m) = self.inside(&path, ends);
        let mut way = self.outside(&self.before, first, ends[0], width_m);
        way.reverse();
        way.extend(inside);
        way.extend(self.outside(&self.next, last, ends[1], width_m));
        Ok(self.follow(l, &way, width_m.min(self.depth_m)))
    }

    /// The nodes of the electrode, and its width. Corners stay; between them and the ends, or
    /// between both ends, the movement is shared out.
    fn inside(&self, path: &[u32], [a, b]: [f64; 2]) -> (Vec<Stop>, f64) {
        let mut arcs = vec![0.0];
        for step in path.windows(2) {
            arcs.push(arcs[arcs.len() - 1] + self.distance(step[0], step[1]));
        }
        let width_m = arcs[arcs.len() - 1];
        let tangents: Vec<Option<Vector>> = path.iter().map(|&n| self.tangent(n)).collect();
        let corners = || arcs.iter().zip(&tangents).filter(|c| c.1.is_none()).map(|c| *c.0);
        let amount = |s: f64| match (corners().next(), corners().next_back()) {
            (Some(low), _) if s <= low => a * fade(s / low),
            (_, Some(high)) if s >= high => b * fade((width_m - s) / (width_m - high)),
            (Some(_), _) => 0.0,
            _ => a + (b - a) * s / width_m,
        };
        let stops = path.iter().zip(&arcs).zip(&tangents).map(|((&node, &s), tangent)| {
            (node, tangent.map_or([0.0; 3], |t| scaled(amount(s), t)))
        });
        (stops.collect(), width_m)
    }

    /// The nodes beyond an end, fading out over a width or up to what stays: a corner, another
    /// electrode. The last one stays.
    fn outside(&self, way: &HashMap<u32, u32>, end: u32, amount: f64, width_m: f64) -> Vec<Stop> {
        let mut nodes: Vec<(u32, f64, Option<Vector>)> = Vec::new();
        let (mut at, mut arc) = (end, 0.0);
        while let Some(&to) = way.get(&at) {
            arc += self.distance(at, to);
            at = to;
            let tangent = self.tangent(to).filter(|_| !self.owner.contains_key(&to));
            nodes.push((to, arc, tangent));
            if tangent.is_none() || arc >= width_m {
                break;
            }
        }
        let reach = arc.min(width_m);
        let amount = |s: f64| amount * fade(s / reach);
        let stop = |(node, s, tangent): (u32, f64, Option<Vector>)| {
            (node, tangent.map_or([0.0; 3], |t| scaled(amount(s), t)))
        };
        nodes.into_iter().map(stop).collect()
    }

    /// A way along the rim, and the nodes inside the skin that follow it: each the mean of the way's
    /// vectors by the inverse fourth power of the distance. (The nearest place of the way would jump
    /// from one chord to the next: seen from inside, a rim of chords has an edge at every node.)
    fn follow(&self, l: usize, way: &[Stop], depth_m: f64) -> Displacement {
        let mut moved: Vec<Stop> = way.iter().copied().filter(|s| s.1 != [0.0; 3]).collect();
        let segments: Vec<[Vector; 2]> =
            way.windows(2).map(|s| [s[0], s[1]].map(|(n, _)| self.place(n))).collect();
        let lengths: Vec<f64> = segments.iter().map(|[a, b]| norm(sub(*b, *a))).collect();
        let share = |k: usize| {
            let before = k.checked_sub(1).and_then(|k| lengths.get(k)).unwrap_or(&0.0);
            before + lengths.get(k).unwrap_or(&0.0)
        };
        let bounds = Bounds::around(way.iter().map(|s| self.place(s.0)), depth_m);
        for (node, &place) in (0u32..).zip(self.nodes) {
            let stays = self.next.contains_key(&node) || self.is_of_another(node, l);
            if stays || !bounds.holds(place) {
                continue;
            }
            let distances = segments.iter().map(|[a, b]| to_segment(place, *a, *b));
            let fading = fade(distances.fold(f64::INFINITY, f64::min) / depth_m);
            if fading == 0.0 {
                continue;
            }
            let (mut sum, mut weights) = ([0.0; 3], 0.0);
            for (k, &(at, vector)) in way.iter().enumerate() {
                let step = sub(place, self.place(at));
                let weight = share(k) / dot(step, step).powi(2);
                sum = along(sum, weight, vector);
                weights += weight;
            }
            let vector = scaled(fading / weights, sum);
            moved.push((node, self.in_plane(node, vector)));
        }
        Displacement::new(moved)
    }

    /// Nodes of an electrode moved by a field, those around it by less, other electrodes not.
    fn carry(&self, l: usize, field: impl Fn(Vector) -> Vector) -> Displacement {
        let segments = self.segments(l);
        let others = self.owner.iter().filter(|(_, (first, more))| *first != l || *more);
        let distance = |place: Vector| {
            let distances = segments.iter().map(|[a, b]| to_segment(place, *a, *b));
            distances.fold(f64::INFINITY, f64::min)
        };
        // touching electrodes leave no room: then nothing around moves
        let clear = others.map(|(&node, _)| distance(self.place(node)));
        let size =
            self.mesh.electrode_measure(l).map_or(0.0, |measure| match self.mesh.electrodes()[l] {
                Electrode::Rim(_) => measure,
                Electrode::Patch(_) => measure.sqrt(),
            });
        let reach_m = clear.fold(size.min(self.depth_m), f64::min);
        let ends = segments.iter().flatten().copied();
        let bounds = Bounds::around(ends, reach_m);
        let mut moved = Vec::new();
        for (node, &place) in (0u32..).zip(self.nodes) {
            if self.is_of_another(node, l) || !bounds.holds(place) {
                continue;
            }
            let own = self.owner.get(&node).is_some_and(|(first, _)| *first == l);
            let part = if own { 1.0 } else { fade(distance(place) / reach_m) };
            let vector = scaled(part, field(place));
            if vector != [0.0; 3] {
                moved.push((node, vector));
            }
        }
        Displacement::new(moved)
    }

    /// Sides of the parts of an electrode.
    fn segments(&self, l: usize) -> Vec<[Vector; 2]> {
        match &self.mesh.electrodes()[l] {
            Electrode::Rim(edges) => edges.iter().map(|e| e.map(|n| self.place(n))).collect(),
            Electrode::Patch(triangles) => triangles
                .iter()
                .flat_map(|&t| {
                    let [a, b, c] = self.mesh.surface().corners(t as usize);
                    [[a, b], [b, c], [c, a]]
                })
                .collect(),
        }
    }

    fn is_of_another(&self, node: u32, l: usize) -> bool {
        self.owner.get(&node).is_some_and(|(first, _)| *first != l)
    }

    fn chord(&self, l: usize) -> Result<Chord, FemError> {
        let path = self.path(l)?;
        let (first, last) = (self.place(path[0]), self.place(path[path.len() - 1]));
        let round = FemError::Immovable { electrode: l + 1, why: "its ends meet" };
        let direction = unit(sub(last, first)).ok_or(round)?;
        let sum = |sum: Vector, n: &u32| along(sum, 1.0, self.normals[*n as usize]);
        let normal = path.iter().fold([0.0; 3], sum);
        let outward = unit(cross(direction, normal)).unwrap_or([0.0; 3]);
        let centre = along(first, 0.5, sub(last, first));
        let width_m = path.windows(2).map(|s| self.distance(s[0], s[1])).sum();
        Ok(Chord { direction, outward, centre, width_m })
    }

    /// A vector without its part across the skin.
    fn in_plane(&self, node: u32, vector: Vector) -> Vector {
        match unit(self.normals[node as usize]) {
            Some(normal) => along(vector, -dot(vector, normal), normal),
            None => vector,
        }
    }
}

/// The line between the ends of an electrode.
struct Chord {
    direction: Vector,
    outward: Vector,
    centre: Vector,
    width_m: f64,
}

/// A box.
struct Bounds([Vector; 2]);

impl Bounds {
    fn around(places: impl Iterator<Item = Vector>, margin: f64) -> Self {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for place in places {
            for k in 0..3 {
                bounds[0][k] = bounds[0][k].min(place[k] - margin);
                bounds[1][k] = bounds[1][k].max(place[k] + margin);
            }
        }
        Self(bounds)
    }

    fn holds(&self, place: Vector) -> bool {
        (0..3).all(|k| (self.0[0][k]..=self.0[1][k]).contains(&place[k]))
    }
}

/// Distance of a point to a segment.
fn to_segment(point: Vector, a: Vector, b: Vector) -> f64 {
    let side = sub(b, a);
    let t = (dot(sub(point, a), side) / dot(side, side)).clamp(0.0, 1.0);
    norm(sub(point, along(a, t, side)))
}

fn nodes_of(mesh: &Mesh, electrode: &Electrode) -> Vec<u32> {
    let triangles = mesh.surface().triangles();
    match electrode {
        Electrode::Rim(edges) => edges.iter().flatten().copied().collect(),
        Electrode::Patch(patch) => patch.iter().flat_map(|&t| triangles[t as usize]).collect(),
    }
}
