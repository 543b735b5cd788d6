//! Places that a protocol cannot tell apart.
//!
//! With drive and measurement both across a disc, a touch at `p` and one at `-p` have the same voltages. Such pairs are found from
//! the model: places whose responses point the same way, with places between them whose responses do not. Places near each other
//! are alike, too, but that is resolution and no ambiguity.

use super::detector::Places;
use crate::InverseError;
use crate::check::check_length;
use crate::geometry::distance_m;
use eit_mesh::Surface;
use ndarray::ArrayRef2;

/// Part of a response in which another one must differ to be told from it: responses of fingers on fabric differ by a tenth from the
/// model's.
const DIFFERENT: f64 = 0.1;
/// The same while only places are compared: the nearest to a mirror image is up to half a spacing off, which is a tenth as well.
const DIFFERENT_PLACES: f64 = 2.0 * DIFFERENT;
/// Number of places that are compared, at most.
const MOST_PLACES: f64 = 400.0;
/// Radii of a bell beyond which it is left out; it is 2e-3 of its peak there.
const REACH_RADII: f64 = 2.5;
/// Distance in spacings up to which places are neighbours: each point of a skin has a place within one.
const NEIGHBOURS: f64 = 2.0;

/// For each of some places of a skin, another one that the measurements cannot tell from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Twins {
    /// Place, and its twin if it has one, metres.
    places: Vec<([f64; 3], Option<[f64; 3]>)>,
}

impl Twins {
    /// Compares the responses of bells of this radius, at places about as far apart, in the measurements that are used.
    /// `jacobian` is `[measurement, triangle]`, volts per siemens. Costs `measurements * places * (places / 2 + triangles of a bell)`
    /// multiplications, and for each twin those of a bell around every triangle within a spacing of it.
    ///
    /// # Errors
    ///
    /// A Jacobian of another shape.
    pub fn find(
        surface: &Surface,
        jacobian: &ArrayRef2<f64>,
        used: &[bool],
        radius_m: f64,
    ) -> Result<Self, InverseError> {
        let centroids = surface.centroids();
        check_length("Jacobian columns", jacobian.ncols(), centroids.len())?;
        check_length("used", used.len(), jacobian.nrows())?;
        let area_m2: f64 = surface.areas_m2().iter().sum();
        let spaced = Places::new(surface, radius_m.max((area_m2 / MOST_PLACES).sqrt()));
        let spacing_m = spaced.spacing_m();
        let bell_m = radius_m.max(0.5 * spacing_m);
        let response = |p: &[f64; 3]| -> Vec<f64> {
            let away = centroids.iter().map(|c| distance_m(*c, *p)).enumerate();
            let near = away.filter(|(_, d)| *d <= REACH_RADII * bell_m);
            let bell: Vec<_> = near.map(|(e, d)| (e, (-(d / bell_m).powi(2)).exp())).collect();
            let rows = jacobian.rows().into_iter().zip(used).filter(|(_, used)| **used);
            let voltages = rows.map(|(row, _)| bell.iter().map(|(e, w)| w * row[*e]).sum());
            let mut unit: Vec<f64> = voltages.collect();
            let size = dot(&unit, &unit).sqrt().max(1e-300);
            unit.iter_mut().for_each(|v| *v /= size);
            unit
        };
        let at: Vec<[f64; 3]> = spaced.at.iter().map(|place| place.position_m).collect();
        let responses: Vec<Vec<f64>> = at.iter().map(response).collect();
        let neighbour_m = NEIGHBOURS * spacing_m;
        let twin = |k: usize| {
            let of_k = &responses[k];
            let alike = |j: &usize| is_alike(dot(of_k, &responses[*j]), DIFFERENT_PLACES);
            let apart = apart(&at, k, (0..at.len()).filter(alike).collect(), neighbour_m);
            let like_k = |j: &usize| dot(of_k, &responses[*j]);
            let place = at[apart.into_iter().max_by(|i, j| like_k(i).total_cmp(&like_k(j)))?];
            // a finer look around that place, at what is not near
            let about = centroids.iter().filter(|c| {
                distance_m(**c, place) <= spacing_m && distance_m(**c, at[k]) > neighbour_m
            });
            let likes = about.map(|c| (*c, dot(of_k, &response(c))));
            let (point, like) = likes.max_by(|(_, a), (_, b)| a.total_cmp(b))?;
            is_alike(like, DIFFERENT).then_some(point)
        };
        let twins: Vec<Option<[f64; 3]>> = (0..at.len()).map(twin).collect();
        // neighbours of twins are twins; a single one, such as in a corner, is an accident of the mesh
        let is_one_of_more = |k: usize| {
            let near = |j: &usize| *j != k && distance_m(at[k], at[*j]) <= neighbour_m;
            (0..at.len()).filter(near).any(|j| twins[j].is_some())
        };
        let places = (0..at.len()).map(|k| (at[k], twins[k].filter(|_| is_one_of_more(k))));
        let places = places.collect();
        Ok(Self { places })
    }

    /// Returns the share of the skin that has a twin.
    pub fn share(&self) -> f64 {
        let with = self.places.iter().filter(|(_, twin)| twin.is_some()).count();
        with as f64 / self.places.len().max(1) as f64
    }

    /// Returns the place that cannot be told from a point of the skin, metres; `None` if there is none.
    pub fn of(&self, point_m: [f64; 3]) -> Option<[f64; 3]> {
        let away = |place: &[f64; 3]| distance_m(*place, point_m);
        self.places.iter().min_by(|(a, _), (b, _)| away(a).total_cmp(&away(b)))?.1
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Whether two responses differ in less than this part: the sine of the angle between them is what one leaves of the other.
fn is_alike(cosine: f64, different: f64) -> bool {
    cosine > (1.0 - different * different).sqrt()
}

/// Those of `alike` that are not connected with place `k` by neighbours among them.
fn apart(at: &[[f64; 3]], k: usize, mut alike: Vec<usize>, neighbour_m: f64) -> Vec<usize> {
    let mut open = vec![k];
    while let Some(from) = open.pop() {
        alike.retain(|&j| {
            let is_near = distance_m(at[from], at[j]) <= neighbour_m;
            if is_near {
                open.push(j);
            }
            !is_near
        });
    }
    alike
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// A strip of squares, 1 m wide and `length` long, in two triangles each.
    fn strip(length: u32) -> Surface {
        let nodes = (0..=length).flat_map(|i| [[f64::from(i), 0.0, 0.0], [f64::from(i), 1.0, 0.0]]);
        let squares = (0..length).map(|i| 2 * i);
        let triangles = squares.flat_map(|i| [[i, i + 2, i + 3], [i, i + 3, i + 1]]);
        Surface::new(nodes.collect(), triangles.collect()).unwrap()
    }

    /// Responses that depend on `angle(x)`: places of one angle are not told apart.
    fn jacobian(surface: &Surface, angle: impl Fn(f64) -> f64) -> Array2<f64> {
        let centroids = surface.centroids();
        let angles: Vec<f64> = centroids.iter().map(|c| angle(c[0])).collect();
        Array2::from_shape_fn((2, angles.len()), |(row, e)| match row {
            0 => angles[e].cos(),
            _ => angles[e].sin(),
        })
    }

    #[test]
    fn mirrored_places_are_twins_and_near_ones_are_not() {
        let surface = strip(40);
        let both = vec![true; 2];
        let folded = jacobian(&surface, |x| 0.05 * (x - 20.0).abs());
        let twins = Twins::find(&surface, &folded, &both, 1.0).unwrap();
        // all but the fold itself
        assert!(twins.share() > 0.7 && twins.share() < 1.0, "{}", twins.share());
        let twin = twins.of([5.0, 0.5, 0.0]).unwrap();
        // places are 1 m apart, and those within 2 m of each other alike
        assert!((twin[0] - 35.0).abs() < 3.0, "{twin:?}");
        assert_eq!(twins.of([20.0, 0.5, 0.0]), None);
        // along an arc without a fold, neighbours are alike and nothing else is
        let arc = jacobian(&surface, |x| 0.05 * x);
        assert_eq!(Twins::find(&surface, &arc, &both, 1.0).unwrap().share(), 0.0);
        // a row that is not used tells nothing apart: with the sign of the first alone, all places are one
        let one = Twins::find(&surface, &folded, &[true, false], 1.0).unwrap();
        assert_eq!(one.share(), 0.0);
    }
}
