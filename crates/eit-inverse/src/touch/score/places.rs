//! Places at which responses are known, and positions as steps from them along the skin.

use crate::geometry::distance_m;
use crate::touch::detector::{DentPlace, Places};
use crate::touch::skin::Place;
use eit_core::vector::{Vector as Point, along, dot, sub};
use eit_mesh::Surface;

/// Distance from the rim within which no place lies, metres: bells there have hardly any response, and would take on the
/// effects of contacts with ten times the strength.
const MARGIN_M: f64 = 6e-3;
/// Longest step from a place, relative to the distance of places: beyond the outermost ones it keeps touches on the skin.
const LONGEST: f64 = 0.9;
/// Radius of a place's neighbourhood, relative to the distance of places: a step ends inside it.
const AROUND: f64 = 3.5;
/// Distance of the places at which a new touch is sought, relative to that of all places.
const SPARSER: f64 = 1.5;
/// Distance of the places at which the deformation of the fabric is computed, relative to that of all places: it changes over
/// 15 mm and more.
const DENTS_SPARSER: f64 = 2.0;

/// Places on a skin, with tangents.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    pub(super) at: Vec<Place>,
    /// Places around each: `around[starts[k]..starts[k + 1]]`.
    around: Vec<usize>,
    starts: Vec<usize>,
    /// Places at which new touches are sought.
    pub(super) coarse: Vec<usize>,
    /// Places at which deformations are computed.
    pub(super) dents: Vec<usize>,
    /// Distance of places, metres.
    pub(super) pitch_m: f64,
}

/// A position as a step from a place.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Spot {
    pub(super) place: usize,
    /// Step along the place's tangents, metres.
    pub(super) step_m: [f64; 2],
    /// Position in the tangent plane of the place, metres.
    pub(super) position_m: Point,
}

impl Grid {
    /// Selects places at least `pitch_m` apart, sparser on a large skin.
    pub(super) fn new(surface: &Surface, pitch_m: f64) -> Self {
        let places = Places::new(surface, pitch_m);
        let pitch_m = places.spacing_m();
        let nodes = surface.nodes();
        let rim: Vec<[Point; 2]> =
            surface.rim_edges().iter().map(|e| e.map(|node| nodes[node as usize])).collect();
        let is_inside =
            |place: &&Place| rim.iter().all(|e| to_edge_m(place.position_m, *e) > MARGIN_M);
        let mut at: Vec<Place> = places.at.iter().filter(is_inside).copied().collect();
        if at.is_empty() {
            at = places.at;
        }
        let (mut around, mut starts) = (Vec::new(), vec![0]);
        for place in &at {
            let way_m = |k: &usize| distance_m(at[*k].position_m, place.position_m);
            around.extend((0..at.len()).filter(|k| way_m(k) <= AROUND * pitch_m));
            starts.push(around.len());
        }
        let coarse = apart(&at, SPARSER * pitch_m);
        let dents = apart(&at, DENTS_SPARSER * pitch_m);
        Self { at, around, starts, coarse, dents, pitch_m }
    }

    /// Places at which deformations are needed.
    pub(super) fn dent_places(&self) -> Vec<DentPlace> {
        let of = |&k: &usize| {
            let Place { position_m, tangents } = self.at[k];
            DentPlace { position_m, tangents }
        };
        self.dents.iter().map(of).collect()
    }

    /// The place itself.
    pub(super) fn spot(&self, place: usize) -> Spot {
        Spot { place, step_m: [0.0; 2], position_m: self.at[place].position_m }
    }

    /// Returns the spot a step further, from the nearest place there.
    pub(super) fn moved(&self, from: &Spot, step_m: [f64; 2]) -> Spot {
        let to = self.at[from.place].after([0, 1].map(|k| from.step_m[k] + step_m[k]));
        let squared = |k: &usize| {
            let way = sub(self.at[*k].position_m, to);
            dot(way, way)
        };
        let around = &self.around[self.starts[from.place]..self.starts[from.place + 1]];
        let nearest = around.iter().min_by(|a, b| squared(a).total_cmp(&squared(b)));
        let place = nearest.copied().unwrap_or(from.place);
        let mut step_m = self.at[place].step_to(to);
        let (length_m, most_m) = (step_m[0].hypot(step_m[1]), LONGEST * self.pitch_m);
        if length_m > most_m {
            step_m = step_m.map(|s| s * most_m / length_m);
        }
        Spot { place, step_m, position_m: self.at[place].after(step_m) }
    }

    /// Tangents of a place.
    pub(super) fn tangents(&self, place: usize) -> &[Point; 2] {
        &self.at[place].tangents
    }

    /// Turns directions along the tangents of one place into those of another.
    pub(super) fn turn(&self, from: usize, to: usize) -> [[f64; 2]; 2] {
        if from == to {
            return [[1.0, 0.0], [0.0, 1.0]];
        }
        let (a, b) = (&self.at[to].tangents, &self.at[from].tangents);
        a.map(|a| b.map(|b| dot(a, b)))
    }

    /// Components of a vector along the tangents of a place.
    pub(super) fn along(&self, place: usize, vector: Point) -> [f64; 2] {
        self.at[place].tangents.map(|t| dot(t, vector))
    }
}

/// Selects places at least a distance apart, in their order.
fn apart(at: &[Place], least_m: f64) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for (k, place) in at.iter().enumerate() {
        if chosen.iter().all(|&c| distance_m(at[c].position_m, place.position_m) >= least_m) {
            chosen.push(k);
        }
    }
    chosen
}

/// Distance of a point from an edge.
fn to_edge_m(p: Point, [a, b]: [Point; 2]) -> f64 {
    let (edge, way) = (sub(b, a), sub(p, a));
    let part = (dot(way, edge) / dot(edge, edge).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    distance_m(p, along(a, part, edge))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cylinder of 80 mm radius, a quarter of a turn, 100 mm high.
    fn bent() -> Surface {
        let node = |k: usize| {
            let (angle, z) = ((k % 33) as f64 / 32.0 * 1.5, (k / 33) as f64 * 4e-3);
            [0.08 * angle.cos(), 0.08 * angle.sin(), z]
        };
        let corner = |i: usize, j: usize| (33 * j + i) as u32;
        let halves = |k: usize| {
            let (i, j) = (k % 32, k / 32);
            let first = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1)];
            [first, [corner(i, j), corner(i + 1, j + 1), corner(i, j + 1)]]
        };
        Surface::new((0..33 * 26).map(node).collect(), (0..32 * 25).flat_map(halves).collect())
            .unwrap()
    }

    /// Steps of a millimetre around a curved skin stay within a sagitta of it, and lengths are kept.
    #[test]
    fn steps_follow_a_curved_skin() {
        let grid = Grid::new(&bent(), 4e-3);
        assert!(grid.coarse.len() < grid.at.len() && grid.dents.len() < grid.coarse.len());
        let middle = [0.08 * 0.75_f64.cos(), 0.08 * 0.75_f64.sin(), 0.05];
        let from = (0..grid.at.len())
            .min_by(|&a, &b| {
                let way = |k: usize| distance_m(grid.at[k].position_m, middle);
                way(a).total_cmp(&way(b))
            })
            .unwrap();
        let mut spot = grid.spot(from);
        for _ in 0..20 {
            let up = grid.along(spot.place, [0.0, 0.0, 1e-3]);
            spot = grid.moved(&spot, up);
        }
        let home = grid.at[from].position_m;
        assert!((spot.position_m[2] - home[2] - 20e-3).abs() < 1e-3, "{spot:?}");
        // chords of triangles of 4 mm are below the cylinder by 0.03 mm, tangent planes above by a step's square over 160 mm
        let radius = spot.position_m[0].hypot(spot.position_m[1]);
        assert!((radius - 0.08).abs() < 2e-4, "{radius}");
    }
}
