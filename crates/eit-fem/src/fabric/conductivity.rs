//! Drives of elements and pressures of pixels, as means over their areas.
//!
//! Away from the edges of contacts the value in the middle stands for the mean; where an edge may
//! cut an element or pixel, the mean of sixteen points does.

use super::contact::Dent;
use super::motion::Placed;
use super::piezo::PiezoLaw;
use super::pixels::pixel_mean;
use super::script::Touch;
use super::settings::LinearResponse;
use eit_mesh::{Raster, Surface};

/// Beyond so many lengths of the membrane from a contact, strains are below 1e-17 of their largest.
const REACH: f64 = 20.0;

/// Triangles of the skin as the law sees them.
#[derive(Debug)]
pub(super) struct Elements {
    /// Middle, and longest distance of a corner from it.
    middles: Vec<([f64; 2], f64)>,
    /// Corners.
    corners: Vec<[[f64; 2]; 3]>,
    reach_m: f64,
}

impl Elements {
    /// `length_m`: length of the membrane.
    pub fn new(surface: &Surface, length_m: f64) -> Self {
        let corners: Vec<[[f64; 2]; 3]> = (0..surface.triangles().len())
            .map(|t| surface.corners(t).map(|p| [p[0], p[1]]))
            .collect();
        let middle = |c: &[[f64; 2]; 3]| {
            let m = [0, 1].map(|k| (c[0][k] + c[1][k] + c[2][k]) / 3.0);
            (m, c.iter().map(|p| (p[0] - m[0]).hypot(p[1] - m[1])).fold(0.0, f64::max))
        };
        Self { middles: corners.iter().map(middle).collect(), corners, reach_m: REACH * length_m }
    }

    /// Relative change of the conductivity of each element of a linear skin: that at its middle.
    pub fn changes_into(&self, linear: &LinearResponse, touches: &[Touch], changes: &mut [f64]) {
        for (change, (middle, _)) in changes.iter_mut().zip(&self.middles) {
            *change = linear.relative_change(touches, *middle);
        }
    }

    /// Mean drive of each element under touches.
    pub fn drives_into(&self, touches: &[Placed], law: &PiezoLaw, drives: &mut [f64]) {
        for ((drive, (middle, size)), corners) in
            drives.iter_mut().zip(&self.middles).zip(&self.corners)
        {
            *drive = 0.0;
            if touches.iter().all(|t| beyond(t, *middle) > self.reach_m + size) {
                continue;
            }
            let cut = touches.iter().any(|t| beyond(t, *middle).abs() <= *size);
            let here = |place| law.drive(&together(touches, place));
            *drive =
                if cut { sixteenths(corners).map(here).sum::<f64>() / 16.0 } else { here(*middle) };
        }
    }
}

/// Distance from the edge of a touch's contact, negative inside.
fn beyond(touch: &Placed, place: [f64; 2]) -> f64 {
    let [x, y] = touch.position_m;
    (place[0] - x).hypot(place[1] - y) - touch.dent.contact_radius_m
}

/// Pressure and strain of all touches at a place.
fn together(touches: &[Placed], place: [f64; 2]) -> Dent {
    touches.iter().fold(Dent::default(), |mut sum, touch| {
        let [x, y] = touch.position_m;
        let dent = touch.dent.at((place[0] - x).hypot(place[1] - y));
        sum.pressure_pa += dent.pressure_pa;
        sum.areal_strain += dent.areal_strain;
        sum
    })
}

/// Middles of the sixteen equal triangles that a triangle is cut into.
fn sixteenths(corners: &[[f64; 2]; 3]) -> impl Iterator<Item = [f64; 2]> {
    let [a, b, c] = *corners;
    let place = move |i: usize, j: usize, third: f64| {
        let (u, v) = ((i as f64 + third) / 4.0, (j as f64 + third) / 4.0);
        [0, 1].map(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
    };
    let upright = (0..4).flat_map(move |i| (0..4 - i).map(move |j| place(i, j, 1.0 / 3.0)));
    let turned = (0..3).flat_map(move |i| (0..3 - i).map(move |j| place(i, j, 2.0 / 3.0)));
    upright.chain(turned)
}

/// Mean contact pressure of each masked pixel, pascal.
pub(super) fn pressures_into(raster: &Raster, touches: &[Placed], pressures_pa: &mut [f64]) {
    let pixel_m = raster.pixel_m();
    for (pressure_pa, &[row, column]) in pressures_pa.iter_mut().zip(raster.masked_pixels()) {
        let [x, y] = raster.centre_m(row, column);
        *pressure_pa = 0.0;
        if touches.iter().all(|t| beyond(t, [x, y]) > pixel_m) {
            continue;
        }
        *pressure_pa = pixel_mean([x, y], pixel_m, |point| together(touches, point).pressure_pa);
    }
}
