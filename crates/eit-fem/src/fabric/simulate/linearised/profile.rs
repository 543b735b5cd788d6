//! Dents by their distance, from a table.

use crate::fabric::bessel::KTable;
use crate::fabric::contact::Dent;
use crate::fabric::motion::{Motion, Placed};
use eit_core::vector::{Vector, along, dot, scaled, sub};

/// Intervals of a dent's table: a touch's voltages change by 0.3 % at most against exact profiles (measured).
const INTERVALS: usize = 64;

/// A dent, tabulated over `c / (c + r)` with half a membrane length `c`, and how large the sheet around it looks.
///
/// A round stretch acts only together with a change of conductivity: currents see the stretched sheet as a flat one on
/// which the circle of radius `r` has the radius `rho`, where `d ln rho / d ln r` is the ratio `q` of the radial to the
/// tangential stretch. A piece of the sheet looks `q (rho / r)^2` times as large, with
/// `ln(rho / r) = - integral from r to infinity of (q - 1) dr / r`.
pub(super) struct Profile<'a> {
    pub(super) touch: &'a Placed,
    half_m: f64,
    table: [Felt; INTERVALS + 1],
}

/// What a dent does at a distance.
#[derive(Clone, Copy, Default)]
pub(super) struct Felt {
    pub(super) deflection_m: f64,
    pub(super) slope: f64,
    pub(super) areal_strain: f64,
    /// Displacement over distance.
    pub(super) across: f64,
    /// How many times as large the sheet looks.
    pub(super) looks: f64,
    /// How far friction drags, over [`Placed::drag_m`].
    pub(super) dragged: f64,
}

/// A place seen from a touch.
pub(super) struct From {
    /// Along the tangent plane, metres.
    pub(super) offset_m: Vector,
    /// [`Placed::distance_m`], its inverse and its gradient; the last two zero at the centre.
    pub(super) distance_m: f64,
    pub(super) per_m: f64,
    pub(super) outward: Vector,
}

impl<'a> Profile<'a> {
    /// Tabulates a touch.
    pub(super) fn new(touch: &'a Placed, motion: &Motion, bessel: &KTable) -> Self {
        let half_m = 0.5 * touch.dent.length_m();
        // far away all is flat
        let mut table = [Felt { looks: 1.0, ..Default::default() }; INTERVALS + 1];
        let (mut integral, mut former): (f64, Option<[f64; 2]>) = (0.0, None);
        for (k, entry) in table.iter_mut().enumerate().skip(1) {
            let r = half_m * (INTERVALS as f64 / k as f64 - 1.0);
            let dent = touch.dent.at_by(r, &|x| bessel.at(x));
            // at the centre all directions are alike: half of the areal strain each
            let across = if r > 0.0 { dent.displacement_m / r } else { 0.5 * dent.areal_strain };
            let along = dent.areal_strain - 0.5 * dent.slope.powi(2) - across;
            let ratio = (1.0 + along).hypot(dent.slope) / (1.0 + across);
            let rate = if r > 0.0 { (ratio - 1.0) / r } else { 0.0 };
            integral += former.map_or(0.0, |[far, before]| 0.5 * (far - r) * (rate + before));
            former = Some([r, rate]);
            let looks = ratio * (-2.0 * integral).exp();
            let Dent { deflection_m, slope, areal_strain, .. } = dent;
            let near_m = r.max(touch.dent.contact_radius_m);
            let dragged = (motion.half_m / near_m).ln().max(0.0);
            *entry = Felt { deflection_m, slope, areal_strain, across, looks, dragged };
        }
        Self { touch, half_m, table }
    }

    /// Looks at a place.
    #[inline(always)]
    pub(super) fn from(&self, place_m: Vector) -> From {
        let Placed { seat, axis, stretch, .. } = self.touch;
        let to = sub(place_m, seat.place_m);
        let offset_m = along(to, -dot(to, seat.normal), seat.normal);
        let (square, ratio) = (dot(to, to), stretch * stretch);
        let (square, gradient) = match ratio == 1.0 {
            true => (square, to),
            false => {
                let x = dot(to, *axis);
                let across = scaled(ratio, along(to, -x, *axis));
                let square = x * x / ratio + (square - x * x).max(0.0) * ratio;
                (square, along(across, x / ratio, *axis))
            }
        };
        let distance_m = square.sqrt();
        let per_m = if square > 0.0 { 1.0 / distance_m } else { 0.0 };
        From { offset_m, distance_m, per_m, outward: scaled(per_m, gradient) }
    }

    /// What is felt at a distance, between the entries of the table.
    #[inline(always)]
    pub(super) fn at(&self, distance_m: f64) -> Felt {
        let place = INTERVALS as f64 * self.half_m / (self.half_m + distance_m);
        let k = (place as usize).min(INTERVALS - 1);
        let (part, [a, b]) = (place - k as f64, [&self.table[k], &self.table[k + 1]]);
        let mix = |a: f64, b: f64| a + part * (b - a);
        Felt {
            deflection_m: mix(a.deflection_m, b.deflection_m),
            slope: mix(a.slope, b.slope),
            areal_strain: mix(a.areal_strain, b.areal_strain),
            across: mix(a.across, b.across),
            looks: mix(a.looks, b.looks),
            dragged: mix(a.dragged, b.dragged),
        }
    }

    /// Pressure under the touch at a distance.
    #[inline(always)]
    pub(super) fn pressure_pa(&self, distance_m: f64) -> f64 {
        self.touch.dent.pressure_pa(distance_m, self.at(distance_m).deflection_m)
    }
}
