//! Displacements of the nodes when an electrode moves.
//!
//! There are two kinds of motion. An electrode that **slides** changes its position on a fixed
//! skin: only the ends of its support move. Rim nodes then move along the rim, interior nodes
//! follow, and the domain does not change (on a polygonal rim, to second order in the edge length).
//! An electrode that is **carried** moves with the skin: its nodes and those around it are shifted,
//! as in stretched fabric, and the rim bends.
//!
//! The displacement extends about one electrode width into the skin instead of moving only the end
//! node. Both are exact derivatives of the discrete model. But moving a single node changes the
//! size of the triangles at the singular electrode end, and with it the discretisation error of the
//! voltages, so it approximates the derivative of the continuous model poorly; `docs/DESIGN.md` has
//! the numbers. (Volume and boundary forms of shape derivatives: Hiptmair, Paganini, Sargheini,
//! *BIT* 55 (2015), 459-485; the boundary form for electrodes: Darde, Hakula, Hyvonen, Staboulis,
//! *Inverse Probl. Imaging* 6 (2012), 399-421.)

use super::displacement::Displacement;
use super::places::{Bounds, to_segment, unit};
use crate::error::FemError;
use eit_core::vector::{Vector, along, cross, dot, norm, normal, scaled, sub};
use eit_mesh::{Electrode, Mesh};
use std::collections::HashMap;

/// Cosine of 35 degrees. A rim node where the rim turns by more than this is a corner; the coarsest
/// arcs of the mesher turn by 30 degrees per node.
const CORNER_COSINE: f64 = 0.819;

/// Largest extension of a displacement into the skin, as a fraction of the square root of the
/// skin's area.
const DEEPEST: f64 = 0.25;

/// How an electrode moves, per metre of its parameter.
///
/// The positive direction along the rim has the skin on the left; on the outer rim of a flat skin
/// this is counter-clockwise. Conductivities stay with their triangles. A sliding electrode
/// therefore shifts conductivities that vary within one electrode width of it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ElectrodeMotion {
    /// Both ends slide along the rim over a fixed skin.
    Slide,
    /// The ends slide apart over a fixed skin, each by half, so the width grows by the parameter.
    Widen,
    /// The skin carries the electrode along the electrode's chord.
    CarriedAlong,
    /// The skin carries the electrode outward in the skin's plane.
    CarriedOutward,
    /// The skin carries the electrode (rim or patch) along a vector.
    Carried([f64; 3]),
    /// The electrode is stretched with the skin along its chord, so the width grows by the
    /// parameter.
    Stretched,
}

impl ElectrodeMotion {
    /// Returns the displacement for one electrode (index from 0).
    ///
    /// # Errors
    /// [`FemError::NoSuchElectrode`]. [`FemError::Immovable`] for any motion but
    /// [`ElectrodeMotion::Carried`] of a patch, an electrode that is not one piece of rim, or a
    /// ring whose ends meet; and for sliding or widening with an end at a corner or on another
    /// electrode.
    pub fn displacement(&self, mesh: &Mesh, electrode: usize) -> Result<Displacement, FemError> {
        let electrodes = mesh.electrodes().len();
        if electrode >= electrodes {
            let what = "electrode motion";
            return Err(FemError::NoSuchElectrode { what, number: electrode + 1, electrodes });
        }
        Skin::new(mesh).displacement(*self, electrode)
    }

    /// Returns the displacements of all electrodes, electrode 1 first.
    ///
    /// # Errors
    /// Those of [`ElectrodeMotion::displacement`].
    pub fn displacements(&self, mesh: &Mesh) -> Result<Vec<Displacement>, FemError> {
        let skin = Skin::new(mesh);
        (0..mesh.electrodes().len()).map(|l| skin.displacement(*self, l)).collect()
    }
}

/// Smooth weight that falls from 1 at `x = 0` to 0 at `x = 1`, with zero slope at both ends.
fn fade(x: f64) -> f64 {
    if x < 1.0 { (1.0 - x) * (1.0 - x) * (1.0 + 2.0 * x) } else { 0.0 }
}

/// A mesh with the rim topology and normals that movement needs.
struct Skin<'a> {
    mesh: &'a Mesh,
    nodes: &'a [Vector],
    /// Next and previous rim node of each rim node.
    next: HashMap<u32, u32>,
    before: HashMap<u32, u32>,
    /// Rim nodes shared by two pieces of rim. Nothing moves past them.
    pinched: Vec<u32>,
    /// For each electrode node: its first electrode, and whether it belongs to others too.
    owner: HashMap<u32, (usize, bool)>,
    /// Normal of the skin at each node, not normalised.
    normals: Vec<Vector>,
    depth_m: f64,
}

/// A node on the path along the rim, and its displacement.
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
            let normal = normal(surface.corners(index));
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

    /// Nodes of a rim electrode, in rim order.
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

    /// Tangent of the rim at a node, exact on a circle; `None` at a corner.
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
        // the angles between the tangent and chords of lengths h and k are proportional to h and k
        unit(along(scaled(k / h, into), h / k, out))
    }

    /// Displacement that moves the two ends of an electrode by `ends` along the rim.
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

    /// Displacements of the electrode's nodes, and its width. Corners are fixed; the movement is
    /// interpolated between corners and ends, or between both ends if there are no corners.
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

    /// Displacements of the rim nodes beyond an end. They decay to zero over one electrode width,
    /// or up to the nearest corner or other electrode. The last node does not move.
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

    /// Displacement of the nodes on the path `way` and of the interior nodes that follow it. An
    /// interior node moves by the mean of the path's vectors, weighted by the inverse fourth power
    /// of the distance. (The vector at the nearest point of the path would jump from one chord to
    /// the next, because a polygonal rim has a kink at every node.)
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

    /// Displacement that moves the nodes of an electrode by `field`, surrounding nodes by a
    /// decaying fraction of it, and other electrodes not at all.
    fn carry(&self, l: usize, field: impl Fn(Vector) -> Vector) -> Displacement {
        let segments = self.segments(l);
        let others = self.owner.iter().filter(|(_, (first, more))| *first != l || *more);
        let distance = |place: Vector| {
            let distances = segments.iter().map(|[a, b]| to_segment(place, *a, *b));
            distances.fold(f64::INFINITY, f64::min)
        };
        // if another electrode touches this one, no surrounding node moves
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

    /// Sides of an electrode's edges or triangles.
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

    /// Projects a vector onto the tangent plane of the skin.
    fn in_plane(&self, node: u32, vector: Vector) -> Vector {
        match unit(self.normals[node as usize]) {
            Some(normal) => along(vector, -dot(vector, normal), normal),
            None => vector,
        }
    }
}

/// Chord between the ends of an electrode.
struct Chord {
    direction: Vector,
    outward: Vector,
    centre: Vector,
    width_m: f64,
}

fn nodes_of(mesh: &Mesh, electrode: &Electrode) -> Vec<u32> {
    let triangles = mesh.surface().triangles();
    match electrode {
        Electrode::Rim(edges) => edges.iter().flatten().copied().collect(),
        Electrode::Patch(patch) => patch.iter().flat_map(|&t| triangles[t as usize]).collect(),
    }
}
