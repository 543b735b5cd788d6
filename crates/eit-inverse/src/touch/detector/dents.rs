//! How a touch deforms the skin around it.
//!
//! A press pulls the fabric towards itself and stretches it in between. Only the part of the strain without a trace
//! changes the conductance of a sheet, and that part is the same as of a displacement in the plane, towards the touch,
//!
//! ```text
//! u(r) = K r / (r^2 + r_0^2)
//! ```
//!
//! whose far field is that of plane elasticity. Where the current is uneven, beside snaps and between electrodes, its
//! effect is a tenth of the touch's own. A finger that slides also drags the fabric along, by a distance that falls with
//! the logarithm (Kelvin's solution; Love, *A Treatise on the Mathematical Theory of Elasticity*, section 148).

use super::TouchDetector;
use super::dictionary::Dictionary;
use super::joint::Joint;
use super::places::Places;
use super::rows::Rows;
use super::vectors::dot;
use super::whitening::Whitening;
use crate::InverseError;
use crate::check::check_length;
use crate::geometry::distance_m;
use crate::touch::skin::Place;
use ndarray::ArrayRef2;

/// Spacing of the positions relative to that of the candidate positions: a dent is much wider than
/// a bell.
const SPARSER: f64 = 2.0;

/// Number of effects of a touch on the fabric around it: a dent, and a drag along each axis of the
/// skin.
pub(super) const EFFECTS: usize = 3;

/// A position at which the effects of a touch on the fabric around it are needed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DentPlace {
    /// Position on the skin, metres.
    pub position_m: [f64; 3],
    /// Orthonormal vectors along the skin.
    pub tangents: [[f64; 3]; 2],
}

/// Effect on the rows of a dent, and of a drag, at each of some positions.
#[derive(Debug, Clone)]
pub(super) struct Dents {
    rows: usize,
    /// Index of each position among the candidate positions.
    pub(super) at: Vec<usize>,
    /// Position that is nearest to each candidate position.
    nearest: Vec<usize>,
    /// Whitened, for one standard deviation, as if no row were lost: `[position][effect][row]`; empty before they are known.
    columns: Vec<f64>,
}

impl Dents {
    pub(super) fn new(places: &Places) -> Self {
        let apart_m = SPARSER * places.spacing_m;
        let mut at: Vec<usize> = Vec::new();
        let way = |a: usize, b: usize| distance_m(places.at[a].position_m, places.at[b].position_m);
        for place in 0..places.len() {
            if at.iter().all(|&other| way(place, other) >= apart_m) {
                at.push(place);
            }
        }
        let nearest = (0..places.len()).map(|place| {
            let ways = at.iter().enumerate().map(|(k, &other)| (k, way(place, other)));
            ways.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(k, _)| k)
        });
        Self { rows: 0, nearest: nearest.collect(), at, columns: Vec::new() }
    }

    /// Sets the effects, `[measurement, (position, effect)]`, volts of the model per standard
    /// deviation.
    pub(super) fn set(
        &mut self,
        dents: &ArrayRef2<f64>,
        rows: &Rows,
        whitening: &Whitening,
        dictionary: &Dictionary,
    ) {
        let n = rows.of.len();
        let (mut folded, mut whitened) = (vec![0.0; n], vec![0.0; n]);
        self.rows = n;
        self.columns.clear();
        for (k, &place) in self.at.iter().enumerate() {
            // a strength and a position that are a little off are no deformation
            let mut own = dictionary.own(place).map(<[f64]>::to_vec);
            for part in 0..own.len() {
                let (before, rest) = own.split_at_mut(part);
                let unit = &mut rest[0];
                before.iter().for_each(|other| remove(unit, other));
                let length = dot(unit, unit).sqrt().max(f64::MIN_POSITIVE);
                unit.iter_mut().for_each(|u| *u /= length);
            }
            for column in EFFECTS * k..EFFECTS * (k + 1) {
                for (row, folded) in folded.iter_mut().enumerate() {
                    *folded = rows.scaled_mean(row, |i| dents[(i, column)]);
                }
                whitening.apply(&folded, &mut whitened);
                own.iter().for_each(|unit| remove(&mut whitened, unit));
                self.columns.extend_from_slice(&whitened);
            }
        }
    }

    /// Effect of a dent at a candidate position; empty if dents are not known.
    pub(super) fn of(&self, place: usize) -> &[f64] {
        self.effects(place, 0..1)
    }

    /// Effects of a drag along each axis; empty if they are not known.
    pub(super) fn drags_of(&self, place: usize) -> &[f64] {
        self.effects(place, 1..EFFECTS)
    }

    fn effects(&self, place: usize, which: std::ops::Range<usize>) -> &[f64] {
        let first = EFFECTS * self.nearest[place];
        let range = (first + which.start) * self.rows..(first + which.end) * self.rows;
        self.columns.get(range).unwrap_or_default()
    }
}

impl TouchDetector {
    /// Returns the positions at which the effects of a touch on the fabric around it are needed,
    /// see [`with_dents`](Self::with_dents).
    pub fn dent_places(&self) -> Vec<DentPlace> {
        let of = |&place: &usize| {
            let Place { position_m, tangents, .. } = self.places.at[place];
            DentPlace { position_m, tangents }
        };
        self.dents.at.iter().map(of).collect()
    }

    /// Lets each touch pull the skin towards itself, and drag it along if it slides, as well as electrodes alone.
    ///
    /// `dents_v`: effects on the model's voltages, volts per standard deviation, `[measurement, effect]`, three for
    /// each of [`dent_places`](Self::dent_places) in turn: a pull towards its position, a drag along each of its
    /// tangents.
    ///
    /// # Errors
    /// Wrong lengths, values of used measurements that are not finite.
    pub fn with_dents(mut self, dents_v: &ArrayRef2<f64>) -> Result<Self, InverseError> {
        check_length("rows of the dents", dents_v.nrows(), self.is_missing.len())?;
        check_length("columns of the dents", dents_v.ncols(), EFFECTS * self.dents.at.len())?;
        self.rows.check_finite(dents_v)?;
        self.dents.set(dents_v, &self.rows, &self.whitening, &self.dictionary);
        let Self { dents, electrodes, places, dictionary, whitening, .. } = &self;
        self.joint = Some(Joint::new(dents, electrodes, places, dictionary, whitening));
        Ok(self)
    }
}

/// Removes the component along a unit vector.
fn remove(y: &mut [f64], unit: &[f64]) {
    let part = dot(unit, y);
    y.iter_mut().zip(unit).for_each(|(y, u)| *y -= part * u);
}
