//! Contact of a fingertip with a stretched fabric on a soft layer, in closed form.
//!
//! The fabric is a membrane of tension `T` on an elastic (Winkler) foundation of stiffness `k`, and
//! is much wider than `l = sqrt(T/k)`. Its deflection `w` (positive where pushed in) under a
//! pressure `p` obeys `k w - T laplacian(w) = p`; away from the load it decays like `K0(r/l)`.
//! (Selvadurai, Elastic Analysis of Soil-Foundation Interaction, 1979: the Filonenko-Borodich
//! foundation; Johnson, Contact Mechanics, 1985, section 4.3, for the foundation alone.)
//!
//! *Flat tip*, radius `a`, uniform pressure `p = F / (pi a^2)`:
//!
//! ```text
//! r < a: w = p/k (1 - A K1(A) I0(r/l)),   r > a: w = p/k A I1(A) K0(r/l),   A = a/l
//! ```
//!
//! *Round tip*, radius `R`: in the contact area, `w = d - r^2/2R`. A membrane has no bending
//! stiffness, so there is no line load at the contact edge `r = a`, and the slope is continuous
//! there:
//!
//! ```text
//! w(a) = (a l / R) K0(A)/K1(A),    d = w(a) + a^2/2R,    p = k w + 2 T/R  (r < a)
//! F = pi a^2 (k d + 2 T/R) - pi k a^4 / 4R
//! ```
//!
//! Limits: without tension `F = pi k a^4 / 4R`; without foundation `F = 2 pi T a^2 / R`.
//!
//! *In the plane*, the fabric stretches as it follows the dent (Foeppl-von Karman strains for a
//! given deflection; linear elastic sheet with Poisson's ratio `nu`). With `f = w'^2 / 2` and `g(r)
//! = integral from r to infinity of f/s ds`, the equilibrium `(r N_r)' = N_theta` gives
//!
//! ```text
//! u(r) = (1 - nu)/2 r g(r) - (1 + nu)/2 (1/r) integral from 0 to r of s f ds
//! areal strain = u' + f + u/r = (1 - nu) g(r)
//! ```
//!
//! Far from the touch, the fabric is drawn towards it with a displacement that falls like `1/r`.
//! All integrals have closed forms: `integral of x K1^2 = x^2/2 (K1^2 - K0 K2)`, `integral of
//! K1^2/x = (K0^2 - K1^2)/2`, and the same for I up to sign.
//!
//! Slopes above one are rejected, because the strains assume small slopes (at a slope of 0.5, a
//! rotation of 27 degrees, they are 6 % too large). Several touches are added. This is exact for
//! the deflection of flat tips; for everything else it is accurate if touches are several `l`
//! apart.

use super::bessel::{i_scaled, k_scaled};
use super::settings::Membrane;
use std::f64::consts::PI;

/// Shape of a fingertip.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Tip {
    /// A sphere. The radius is its radius of curvature; the contact area grows with the force.
    #[default]
    Round,
    /// A soft pad. The radius is that of the contact area; the pressure is uniform.
    Flat,
}

/// Dent made by one touch, as a whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Indentation {
    /// Radius of the contact area, metres.
    pub contact_radius_m: f64,
    /// Deflection at the centre, metres.
    pub depth_m: f64,
    /// Largest slope, which is at the contact edge.
    pub slope: f64,
    tip: Tip,
    /// Radius of the tip.
    tip_radius_m: f64,
    /// Pressure of a flat tip; for a round tip, the part in addition to the foundation's pressure.
    pressure_pa: f64,
    foundation_pa_per_m: f64,
    length_m: f64,
    poisson_ratio: f64,
    /// Deflection at the contact edge.
    edge_m: f64,
    /// Integral of s f over the contact area, square metres, and g at its edge.
    inner_m2: f64,
    edge_g: f64,
    /// exp(A) [K0(A), K1(A)].
    edge_k: [f64; 2],
}

/// Local effect of a touch at a distance from its centre.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Dent {
    /// Contact pressure, pascal; zero outside the contact area.
    pub pressure_pa: f64,
    /// Deflection, metres, positive where pushed in.
    pub deflection_m: f64,
    /// Derivative of the deflection with respect to the distance; never positive.
    pub slope: f64,
    /// In-plane displacement away from the centre of the touch, metres.
    pub displacement_m: f64,
    /// Relative change of area.
    pub areal_strain: f64,
}

impl Indentation {
    /// Computes the dent of a force in newton; the meaning of `radius_m` depends on [`Tip`].
    /// Returns `None` if the force is too large for the model, i.e. if the slope at the contact
    /// edge would exceed one.
    ///
    /// Force, radius and membrane must be finite and above zero.
    pub fn new(membrane: &Membrane, tip: Tip, radius_m: f64, force_n: f64) -> Option<Self> {
        let Membrane { tension_n_per_m, foundation_pa_per_m, poisson_ratio, .. } = *membrane;
        let length_m = membrane.length_m();
        let contact_radius_m = match tip {
            Tip::Flat => radius_m,
            Tip::Round => round_contact(membrane, radius_m, force_n)?,
        };
        let at = contact_radius_m / length_m;
        let ([i0, i1], edge_k) = (i_scaled(at), k_scaled(at));
        let pressure_pa = match tip {
            Tip::Flat => force_n / (PI * radius_m * radius_m),
            Tip::Round => 2.0 * tension_n_per_m / radius_m,
        };
        let scale_m = pressure_pa / foundation_pa_per_m;
        let (edge_m, depth_m, slope) = match tip {
            Tip::Flat => (
                scale_m * at * i1 * edge_k[0],
                scale_m * (1.0 - at * edge_k[1] * (-at).exp()),
                scale_m * at * i1 * edge_k[1] / length_m,
            ),
            Tip::Round => {
                let slope = contact_radius_m / radius_m;
                let edge_m = slope * length_m * edge_k[0] / edge_k[1];
                (edge_m, edge_m + 0.5 * contact_radius_m * slope, slope)
            }
        };
        let inner_m2 = match tip {
            // slope B I1(r/l): integral of s f = B^2 l^2 / 2 * A^2/2 (I1^2 - I0 I2)
            Tip::Flat => {
                let i2 = i0 - 2.0 * i1 / at;
                0.25 * (slope * contact_radius_m).powi(2) * (1.0 - i0 * i2 / (i1 * i1))
            }
            Tip::Round => 0.125 * (slope * contact_radius_m).powi(2),
        };
        let ratio = edge_k[0] / edge_k[1];
        // slope K1(r/l)/K1(A): g at the edge = slope^2 / 4 (1 - K0^2/K1^2)
        let edge_g = 0.25 * slope * slope * (1.0 - ratio * ratio);
        let dent = Self {
            contact_radius_m,
            depth_m,
            slope,
            tip,
            tip_radius_m: radius_m,
            pressure_pa,
            foundation_pa_per_m,
            length_m,
            poisson_ratio,
            edge_m,
            inner_m2,
            edge_g,
            edge_k,
        };
        (slope <= 1.0).then_some(dent)
    }

    /// Length over which the dent decays, metres.
    pub(super) fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Returns the local effect at a distance from the centre, metres.
    pub fn at(&self, distance_m: f64) -> Dent {
        self.at_by(distance_m, &k_scaled)
    }

    /// Like [`Indentation::at`], with functions `exp(x) [K0(x), K1(x)]` of the caller's.
    #[inline]
    pub(super) fn at_by(&self, distance_m: f64, k: &impl Fn(f64) -> [f64; 2]) -> Dent {
        let inside = distance_m <= self.contact_radius_m;
        let (deflection_m, slope, area_m2, g) = match (inside, self.tip) {
            (false, _) => self.outside(distance_m, k),
            (true, Tip::Round) => self.under_round(distance_m),
            (true, Tip::Flat) => self.under_flat(distance_m),
        };
        let pressure_pa = self.pressure_pa(distance_m, deflection_m);
        let nu = self.poisson_ratio;
        let inward = if distance_m > 0.0 { area_m2 / distance_m } else { 0.0 };
        Dent {
            pressure_pa,
            deflection_m,
            slope,
            displacement_m: 0.5 * (1.0 - nu) * distance_m * g - 0.5 * (1.0 + nu) * inward,
            areal_strain: (1.0 - nu) * g,
        }
    }

    /// Pressure at a distance where the deflection is this.
    pub(super) fn pressure_pa(&self, distance_m: f64, deflection_m: f64) -> f64 {
        match (distance_m <= self.contact_radius_m, self.tip) {
            (false, _) => 0.0,
            (true, Tip::Flat) => self.pressure_pa,
            (true, Tip::Round) => self.pressure_pa + self.foundation_pa_per_m * deflection_m,
        }
    }

    /// Outside the contact area: deflection, slope, integral of s f from the centre, g.
    #[inline]
    fn outside(&self, r: f64, k: &impl Fn(f64) -> [f64; 2]) -> (f64, f64, f64, f64) {
        let (a, l) = (self.contact_radius_m, self.length_m);
        let (at, x) = (a / l, r / l);
        let ([e0, e1], [k0, k1]) = (self.edge_k, k(x));
        let fall = (at - x).exp();
        // relative to the edge: K0(x)/K0(A), K1(x)/K1(A)
        let (w, s) = (self.edge_m * fall * k0 / e0, self.slope * fall * k1 / e1);
        // integral of x K1^2 between A and x: x^2/2 (K1^2 - K0 K2), K2 = K0 + 2 K1 / x
        let part = |x: f64, q: f64| 0.5 * x * x * (1.0 - q * q - 2.0 * q / x);
        let (edge, here) = (part(at, e0 / e1), part(x, k0 / k1));
        let outer = 0.5 * (self.slope * l).powi(2) * ((fall * k1 / e1).powi(2) * here - edge);
        let ratio = k0 / k1;
        (w, -s, self.inner_m2 + outer, 0.25 * s * s * (1.0 - ratio * ratio))
    }

    fn under_round(&self, r: f64) -> (f64, f64, f64, f64) {
        let (a, big) = (self.contact_radius_m, self.tip_radius_m);
        let slope = r / big;
        let g = self.edge_g + 0.25 * (a - r) * (a + r) / (big * big);
        (self.depth_m - 0.5 * r * slope, -slope, 0.125 * (slope * r).powi(2), g)
    }

    fn under_flat(&self, r: f64) -> (f64, f64, f64, f64) {
        let (at, x) = (self.contact_radius_m / self.length_m, r / self.length_m);
        let ([j0, j1], [i0, i1]) = (i_scaled(at), i_scaled(x));
        // I(x)/I(A) without overflow
        let rise = (x - at).exp();
        let scale_m = self.pressure_pa / self.foundation_pa_per_m;
        let w = scale_m * (1.0 - at * self.edge_k[1] * i0 * rise);
        let s = self.slope * rise * i1 / j1;
        let unit = self.slope / j1;
        let (area, at_middle) = if x > 0.0 {
            let i2 = i0 - 2.0 * i1 / x;
            let rest = i1 * i1 - i0 * i2;
            (0.25 * (unit * rise * r).powi(2) * rest, (i0 * i0 - i1 * i1) * rise * rise)
        } else {
            (0.0, (-2.0 * at).exp())
        };
        // integral of I1^2/x = (I0^2 - I1^2)/2 between r and the edge
        let g = self.edge_g + 0.25 * unit * unit * (j0 * j0 - j1 * j1 - at_middle);
        (w, -s, area, g)
    }
}

/// Computes the contact radius of a round tip: the root of F(a) = force, where F increases with a.
fn round_contact(membrane: &Membrane, radius_m: f64, force_n: f64) -> Option<f64> {
    let Membrane { tension_n_per_m: t, foundation_pa_per_m: k, .. } = *membrane;
    let l = membrane.length_m();
    let force = |a: f64| {
        let [k0, k1] = k_scaled(a / l);
        let depth = a * l / radius_m * k0 / k1 + 0.5 * a * a / radius_m;
        PI * a * a * (k * depth + 2.0 * t / radius_m - 0.25 * k * a * a / radius_m)
    };
    if force(radius_m) < force_n {
        return None;
    }
    let (mut low, mut high) = (0.0, radius_m);
    // bisection to the last bit
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return Some(high);
        }
        if force(middle) < force_n {
            low = middle;
        } else {
            high = middle;
        }
    }
}
