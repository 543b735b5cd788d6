//! Mean drive of each element and mean pressure of each pixel.
//!
//! The mean over an element is approximated by its value at the centroid, or by the mean of sixteen
//! points if the edge of a contact may cross the element. The mean over a pixel uses sixteen
//! points.

use super::contact::Dent;
use super::motion::Placed;
use super::piezo::PiezoLaw;
use super::pixels::pixel_mean;
use super::script::Touch;
use super::seat::Seat;
use super::settings::LinearResponse;
use eit_mesh::{Raster, Surface};

/// Triangles of the skin, prepared for evaluating drives.
#[derive(Debug, Clone)]
pub(super) struct Elements {
    /// Centroid of each triangle, and the largest distance of a corner from it.
    middles: Vec<([f64; 3], f64)>,
    /// Corners of each triangle.
    corners: Vec<[[f64; 3]; 3]>,
    reach_m: f64,
}

impl Elements {
    /// `length_m` is the characteristic length of the membrane.
    pub(crate) fn new(surface: &Surface, length_m: f64) -> Self {
        let corners: Vec<[[f64; 3]; 3]> =
            (0..surface.triangles().len()).map(|t| surface.corners(t)).collect();
        let middle = |c: &[[f64; 3]; 3]| {
            let m = [0, 1, 2].map(|k| (c[0][k] + c[1][k] + c[2][k]) / 3.0);
            let distance = |p: &[f64; 3]| (p[0] - m[0]).hypot(p[1] - m[1]).hypot(p[2] - m[2]);
            (m, c.iter().map(distance).fold(0.0, f64::max))
        };
        // beyond 20 membrane lengths from a contact, strains are below 1e-17 of their largest value
        Self { middles: corners.iter().map(middle).collect(), corners, reach_m: 20.0 * length_m }
    }

    /// Computes the relative conductivity change of each element of a linear skin, at its centroid.
    pub(crate) fn changes_into(
        &self,
        linear: &LinearResponse,
        touches: &[Touch],
        changes: &mut [f64],
    ) {
        for (change, ([x, y, _], _)) in changes.iter_mut().zip(&self.middles) {
            *change = linear.relative_change(touches, [*x, *y]);
        }
    }

    /// Elements that may hold a place, seen from +z.
    pub(crate) fn near(&self, [x, y]: [f64; 2]) -> impl Iterator<Item = usize> {
        let middles = self.middles.iter().enumerate();
        // twice as far as needed: rounding excludes none
        let is_near = move |(m, size): &([f64; 3], f64)| {
            (m[0] - x).abs() <= 2.0 * size && (m[1] - y).abs() <= 2.0 * size
        };
        middles.filter(move |(_, middle)| is_near(middle)).map(|(element, _)| element)
    }

    /// Centroid of an element, and the largest distance of a corner from it.
    pub(crate) fn middle(&self, element: usize) -> ([f64; 3], f64) {
        self.middles[element]
    }

    /// Computes the mean drive of each element under the touches.
    pub(crate) fn drives_into(&self, touches: &[Placed], law: &PiezoLaw, drives: &mut [f64]) {
        for ((drive, (middle, size)), corners) in
            drives.iter_mut().zip(&self.middles).zip(&self.corners)
        {
            *drive = 0.0;
            if touches.iter().all(|t| beyond(t, *middle) > self.reach_m + size * t.stretch) {
                continue;
            }
            let cut = touches.iter().any(|t| beyond(t, *middle).abs() <= size * t.stretch);
            let here = |place| {
                let rings = touches.iter().map(|t| t.ring_at(t.distance_m(place)));
                law.saturated(law.drive(&together(touches, place)) + rings.sum::<f64>())
            };
            *drive =
                if cut { sixteenths(corners).map(here).sum::<f64>() / 16.0 } else { here(*middle) };
        }
    }
}

/// Distance from the edge of a touch's contact area; negative inside.
fn beyond(touch: &Placed, place: [f64; 3]) -> f64 {
    touch.distance_m(place) - touch.dent.contact_radius_m
}

/// Sums the pressure and strain of all touches at a point.
fn together(touches: &[Placed], place: [f64; 3]) -> Dent {
    touches.iter().fold(Dent::default(), |mut sum, touch| {
        let dent = touch.dent.at(touch.distance_m(place));
        sum.pressure_pa += dent.pressure_pa;
        sum.areal_strain += dent.areal_strain;
        sum
    })
}

/// Centroids of the sixteen equal triangles that subdivide a triangle.
pub(super) fn sixteenths(corners: &[[f64; 3]; 3]) -> impl Iterator<Item = [f64; 3]> {
    let [a, b, c] = *corners;
    let place = move |i: usize, j: usize, third: f64| {
        let (u, v) = ((i as f64 + third) / 4.0, (j as f64 + third) / 4.0);
        [0, 1, 2].map(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
    };
    let upright = (0..4).flat_map(move |i| (0..4 - i).map(move |j| place(i, j, 1.0 / 3.0)));
    let turned = (0..3).flat_map(move |i| (0..3 - i).map(move |j| place(i, j, 2.0 / 3.0)));
    upright.chain(turned)
}

/// Where each masked pixel's centre is on the skin; `None` off the skin.
pub(super) fn pixel_seats(raster: &Raster, surface: &Surface) -> Vec<Option<Seat>> {
    let is_flat = surface.nodes().iter().all(|node| node[2] == 0.0);
    let seat = |&[row, column]: &[usize; 2]| {
        let [x, y] = raster.centre_m(row, column);
        match is_flat {
            true => Some(Seat { place_m: [x, y, 0.0], normal: [0.0, 0.0, 1.0] }),
            false => Seat::on(surface, [x, y]),
        }
    };
    raster.masked_pixels().iter().map(seat).collect()
}

/// Computes the mean contact pressure of each masked pixel, pascal.
pub(super) fn pressures_into(
    raster: &Raster,
    seats: &[Option<Seat>],
    touches: &[Placed],
    pressures_pa: &mut [f64],
) {
    let pixel_m = raster.pixel_m();
    for (pressure_pa, seat) in pressures_pa.iter_mut().zip(seats) {
        *pressure_pa = 0.0;
        let Some(seat) = seat else { continue };
        let [x, y, _] = seat.place_m;
        // a steep pixel is longer on the skin than seen from +z
        let reach_m = pixel_m / seat.normal[2];
        if touches.iter().all(|t| beyond(t, seat.place_m) > reach_m * t.stretch) {
            continue;
        }
        let at = |point| together(touches, seat.beside(point)).pressure_pa;
        *pressure_pa = pixel_mean([x, y], pixel_m, at);
    }
}
