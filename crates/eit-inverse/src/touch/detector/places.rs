//! Candidate positions of touches on a skin, and steps from them.

use crate::geometry::distance_m;
use crate::touch::skin::{Place, nearest_in, nearest_of, normal, tangents};
use eit_mesh::Surface;
use std::collections::HashMap;

type Point = [f64; 3];

/// Maximum number of positions; more cost time and find little.
const MOST_PLACES: f64 = 2000.0;

/// Radius of a position's neighbourhood, in spacings: a step of one spacing from the edge of a position's own
/// region ends nearest to a position inside it.
const AROUND: f64 = 3.5;

/// Evenly spread positions with the triangles around each.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    pub(crate) at: Vec<Place>,
    /// Triangles near each position, as corners: `near[starts[k]..starts[k + 1]]`.
    near: Vec<[Point; 3]>,
    starts: Vec<usize>,
    /// Positions within [`AROUND`] spacings of each, in order: `around[around_starts[k]..around_starts[k + 1]]`.
    around: Vec<usize>,
    around_starts: Vec<usize>,
    /// Least distance between positions, metres.
    pub(super) spacing_m: f64,
}

/// A position on the skin as a step from the nearest of the [`Places`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spot {
    pub(super) place: usize,
    /// Step along the place's tangents, metres.
    pub(super) step_m: [f64; 2],
    pub(super) position_m: Point,
    /// Covariance of the position, square metres, if the position comes from the touch's effect on
    /// electrodes; fits then keep it.
    pub(super) spread_m2: Option<[[f64; 3]; 3]>,
}

impl Places {
    /// Selects triangle centroids at least `spacing_m` apart, sparser on a large skin.
    pub(crate) fn new(surface: &Surface, spacing_m: f64) -> Self {
        let area: f64 = surface.areas_m2().iter().sum();
        let spacing_m = spacing_m.max((area / MOST_PLACES).sqrt());
        let centroids = surface.centroids();
        let cell = |p: Point| p.map(|x| (x / spacing_m).floor() as i64);
        let around = |c: [i64; 3]| {
            (0..27).map(move |k: i64| [c[0] + k % 3 - 1, c[1] + k / 3 % 3 - 1, c[2] + k / 9 - 1])
        };
        let mut taken: HashMap<[i64; 3], Vec<Point>> = HashMap::new();
        let mut at = Vec::new();
        for (triangle, &centroid) in centroids.iter().enumerate() {
            let home = cell(centroid);
            let is_free = around(home)
                .filter_map(|c| taken.get(&c))
                .flatten()
                .all(|other| distance_m(*other, centroid) >= spacing_m);
            if is_free {
                taken.entry(home).or_default().push(centroid);
                let tangents = tangents(surface.corners(triangle));
                at.push(Place { position_m: centroid, tangents });
            }
        }
        let mut of_cell: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (triangle, &centroid) in centroids.iter().enumerate() {
            of_cell.entry(cell(centroid)).or_default().push(triangle);
        }
        let (mut near, mut starts) = (Vec::new(), vec![0]);
        for place in &at {
            let triangles = around(cell(place.position_m)).filter_map(|c| of_cell.get(&c));
            near.extend(triangles.flatten().map(|&t| surface.corners(t)));
            starts.push(near.len());
        }
        let (mut neighbours, mut around_starts) = (Vec::new(), vec![0]);
        for place in &at {
            let way_m = |k: &usize| distance_m(at[*k].position_m, place.position_m);
            neighbours.extend((0..at.len()).filter(|k| way_m(k) <= AROUND * spacing_m));
            around_starts.push(neighbours.len());
        }
        Self { at, near, starts, around: neighbours, around_starts, spacing_m }
    }

    pub(super) fn len(&self) -> usize {
        self.at.len()
    }

    /// Least distance between positions, metres.
    pub(in crate::touch) fn spacing_m(&self) -> f64 {
        self.spacing_m
    }

    /// Returns the point of the skin nearest to a point close to it, and the unit normal there.
    pub(in crate::touch) fn on_skin(&self, point_m: Point) -> (Point, Point) {
        let spot = self.nearest(point_m);
        (spot.position_m, self.normal(&spot))
    }

    /// The position itself, without a step.
    pub(super) fn spot(&self, place: usize) -> Spot {
        Spot { place, step_m: [0.0; 2], position_m: self.at[place].position_m, spread_m2: None }
    }

    /// Returns the point of the skin nearest to a step along the tangents from a spot.
    pub(super) fn moved(&self, from: &Spot, step_m: [f64; 2]) -> Spot {
        let home = &self.at[from.place];
        let to = home.after([0, 1].map(|k| from.step_m[k] + step_m[k]));
        let around = self.around_starts[from.place]..self.around_starts[from.place + 1];
        let (place, way_m) = self.nearest_of_places(self.around[around].iter().copied(), to);
        // positions outside of the neighbourhood are at least this far away
        if way_m <= AROUND * self.spacing_m - distance_m(home.position_m, to) {
            self.spot_near(place, to)
        } else {
            self.nearest(to)
        }
    }

    /// Returns the unit normal of the skin at a spot, on the side from which the corners of its triangle run
    /// counter-clockwise.
    pub(super) fn normal(&self, spot: &Spot) -> Point {
        let squared = |corners: &[Point; 3]| {
            let nearest = nearest_in(*corners, spot.position_m);
            (0..3).map(|i| (nearest[i] - spot.position_m[i]).powi(2)).sum::<f64>()
        };
        let triangles = &self.near[self.starts[spot.place]..self.starts[spot.place + 1]];
        let at = triangles.iter().min_by(|a, b| squared(a).total_cmp(&squared(b)));
        at.map_or([0.0, 0.0, 1.0], |corners| normal(*corners))
    }

    /// Returns the point of the skin nearest to a point close to it.
    pub(super) fn nearest(&self, point_m: Point) -> Spot {
        let (place, _) = self.nearest_of_places(0..self.at.len(), point_m);
        self.spot_near(place, point_m)
    }

    /// Returns the first of the nearest positions and its distance, metres.
    fn nearest_of_places(
        &self,
        places: impl Iterator<Item = usize>,
        point_m: Point,
    ) -> (usize, f64) {
        let squared =
            |p: &Place| (0..3).map(|i| (p.position_m[i] - point_m[i]).powi(2)).sum::<f64>();
        let (mut place, mut least) = (0, f64::INFINITY);
        for k in places {
            let distance = squared(&self.at[k]);
            if distance < least {
                (place, least) = (k, distance);
            }
        }
        (place, least.sqrt())
    }

    /// Returns the point of the triangles near a position that is nearest to a point.
    fn spot_near(&self, place: usize, point_m: Point) -> Spot {
        let triangles = &self.near[self.starts[place]..self.starts[place + 1]];
        let position_m = nearest_of(triangles.iter().map(|c| nearest_in(*c, point_m)), point_m);
        Spot { place, step_m: self.at[place].step_to(position_m), position_m, spread_m2: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    /// A dome of 16 cm: triangles with edges of about 4 mm.
    fn dome() -> Surface {
        let node = |k: usize| {
            let [x, y] = [k % 41, k / 41].map(|i| 4e-3 * (i as f64 - 20.0));
            [x, y, -5.0 * (x * x + y * y)]
        };
        let corner = |i: usize, j: usize| (41 * j + i) as u32;
        let halves = |k: usize| {
            let (i, j) = (k % 40, k / 40);
            let first = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1)];
            [first, [corner(i, j), corner(i + 1, j + 1), corner(i, j + 1)]]
        };
        Surface::new((0..41 * 41).map(node).collect(), (0..1600).flat_map(halves).collect())
            .unwrap()
    }

    /// The neighbourhood gives what all positions give, bit for bit: steps of up to one spacing never leave
    /// it, longer ones may.
    #[test]
    fn a_step_ends_at_the_nearest_of_all_positions() {
        let mut random = Random::new(4);
        let places = Places::new(&dome(), 6e-3);
        let mut outside = 0;
        for k in 0..4000 {
            let (place, length_m) = (k % places.len(), if k % 2 == 0 { 6e-3 } else { 40e-3 });
            let (sin, cos) = (6.0 * random.normal()).sin_cos();
            // at the edge of the position's own region, or wherever an earlier step ended
            let from = Spot { step_m: [3e-3 * cos, -3e-3 * sin], ..places.spot(place) };
            let moved = places.moved(&from, [length_m * sin, length_m * cos]);
            let Place { position_m, tangents, .. } = &places.at[place];
            let step = [from.step_m[0] + length_m * sin, from.step_m[1] + length_m * cos];
            let to: Point = std::array::from_fn(|i| {
                position_m[i] + step[0] * tangents[0][i] + step[1] * tangents[1][i]
            });
            assert_eq!(moved, places.nearest(to));
            let around =
                &places.around[places.around_starts[place]..places.around_starts[place + 1]];
            outside += usize::from(!around.contains(&moved.place));
            assert!(length_m > 6e-3 || around.contains(&moved.place));
        }
        assert!(outside > 1000, "{outside}");
    }
}
