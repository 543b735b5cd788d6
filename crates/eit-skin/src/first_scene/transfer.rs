//! Voltages and press responses of any pair protocol in any numbering, from one solve.
//!
//! A voltage is bilinear in the pair that drives and the pair that measures. With `G[i][j]`, the voltage from place 0 to
//! place `j` while current flows from place 0 to place `i`, that of the quadruple `[a, b, m, n]` is
//!
//! ```text
//! G[b][n] - G[b][m] - G[a][n] + G[a][m]
//! ```
//!
//! and its response to a change of conductivity is the same combination of those of `G`.

use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::{ForwardModel, Protocol};
use ndarray::{Array1, Array2};

/// `G`, or its change, `[place, place]`; row and column 0 are zero.
pub(crate) struct PairMatrix(Array2<f64>);

impl PairMatrix {
    /// `G` of the untouched skin.
    pub(crate) fn untouched(skin: &Skin, current_a: f64) -> Result<Self, SkinError> {
        let model = of_all_pairs(skin, current_a)?;
        let voltages = model.forward(&skin.background_s())?;
        Ok(Self::new(skin.mesh.electrodes().len(), &voltages.to_vec()))
    }

    fn new(places: usize, pairs: &[f64]) -> Self {
        Self(Array2::from_shape_fn((places, places), |(i, j)| match pair(i.min(j), i.max(j)) {
            Some(pair) => pairs[pair],
            None => 0.0,
        }))
    }

    /// One value per quadruple of places.
    pub(crate) fn measured(&self, quadruples: &[[u32; 4]]) -> Array1<f64> {
        let value = |quadruple: &[u32; 4]| {
            let [a, b, m, n] = quadruple.map(|place| place as usize);
            self.0[[b, n]] - self.0[[b, m]] - self.0[[a, n]] + self.0[[a, m]]
        };
        quadruples.iter().map(value).collect()
    }
}

/// The model of all entries of `G` on or below its diagonal, but for row 0.
fn of_all_pairs(skin: &Skin, current_a: f64) -> Result<ForwardModel, SkinError> {
    let places = skin.mesh.electrodes().len();
    let quadruples: Vec<[u32; 4]> =
        (1..places as u32).flat_map(|high| (1..=high).map(move |low| [0, low, 0, high])).collect();
    let protocol = Protocol::from_quadruples(places, &quadruples, current_a)?;
    Ok(ForwardModel::new(&skin.mesh, &protocol, &skin.contact_impedance)?)
}

/// Number of the entry of `G` below or on its diagonal; `None` in row 0.
fn pair(low: usize, high: usize) -> Option<usize> {
    (low > 0).then(|| high * (high - 1) / 2 + low - 1)
}

/// The untouched skin, and how it responds to presses.
pub(super) struct Transfer {
    places: usize,
    voltages: Vec<f64>,
    /// `[pair, element]`
    jacobian: Array2<f64>,
}

impl Transfer {
    pub(crate) fn new(skin: &Skin, current_a: f64) -> Result<Self, SkinError> {
        let (places, model) = (skin.mesh.electrodes().len(), of_all_pairs(skin, current_a)?);
        let mut workspace = model.workspace()?;
        let mut solution = model.solve(&skin.background_s(), &mut workspace)?;
        let voltages = solution.measurements().to_vec();
        Ok(Self { places, voltages, jacobian: solution.jacobian() })
    }

    /// `G` of the untouched skin.
    pub(crate) fn untouched(&self) -> PairMatrix {
        PairMatrix::new(self.places, &self.voltages)
    }

    /// Change of `G` for a change of conductivity, one value per element.
    pub(crate) fn change(&self, conductivity: &Array1<f64>) -> PairMatrix {
        PairMatrix::new(self.places, &self.jacobian.dot(conductivity).to_vec())
    }
}

/// Where along the rim the electrodes of a board are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Placing {
    /// Place of electrode 0.
    pub start: usize,
    pub is_clockwise: bool,
    /// This electrode and the next have exchanged their places.
    pub swapped: Option<usize>,
}

impl Placing {
    /// Every first electrode in both directions, without exchanged wires.
    pub(crate) fn all(electrodes: usize) -> impl Iterator<Item = Self> {
        (0..electrodes).flat_map(|start| {
            [false, true].map(|is_clockwise| Self { start, is_clockwise, swapped: None })
        })
    }

    /// This placing with the wires of each two neighbours exchanged.
    pub(crate) fn swaps(self, electrodes: usize) -> impl Iterator<Item = Self> {
        (0..electrodes).map(move |electrode| Self { swapped: Some(electrode), ..self })
    }

    /// The exchanged electrodes.
    pub(crate) fn pair(self, electrodes: usize) -> Option<[usize; 2]> {
        self.swapped.map(|electrode| [electrode, (electrode + 1) % electrodes])
    }

    /// Quadruples of places, from those of electrodes.
    pub(crate) fn map(self, quadruples: &[[u32; 4]], electrodes: usize) -> Vec<[u32; 4]> {
        let pair = self.pair(electrodes);
        let place = |electrode: u32| {
            let mut electrode = electrode as usize % electrodes;
            if let Some([one, other]) = pair {
                electrode = match electrode {
                    e if e == one => other,
                    e if e == other => one,
                    e => e,
                };
            }
            let step = if self.is_clockwise { electrodes - electrode } else { electrode };
            ((self.start + step) % electrodes) as u32
        };
        quadruples.iter().map(|quadruple| quadruple.map(place)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::first_scene::{FirstScene, Outline};

    /// Combinations of one solve equal solves of the protocol itself, also where driven electrodes are measured.
    #[test]
    fn one_solve_stands_for_every_numbering() {
        let outline = Outline::Rectangle { width_m: 0.1, height_m: 0.06 };
        let mut scene = FirstScene::new(outline, 8).scene().unwrap();
        scene.mesh.nodes = Some(900);
        let skin = Skin::from_scene(scene).unwrap();
        let transfer = Transfer::new(&skin, 1e-3).unwrap();
        let quadruples = [[0, 1, 2, 3], [3, 7, 1, 5], [6, 2, 6, 4], [5, 4, 4, 5]];
        for swapped in [None, Some(7)] {
            let placing = Placing { start: 3, is_clockwise: true, swapped };
            let mapped = placing.map(&quadruples, 8);
            let protocol = Protocol::from_quadruples(8, &mapped, 1e-3).unwrap();
            let model = ForwardModel::new(&skin.mesh, &protocol, &skin.contact_impedance).unwrap();
            let mut workspace = model.workspace().unwrap();
            let mut solution = model.solve(&skin.background_s(), &mut workspace).unwrap();
            let bell = Array1::from_shape_fn(model.elements(), |e| 1e-6 * (e % 7) as f64);
            let found =
                [transfer.untouched().measured(&mapped), transfer.change(&bell).measured(&mapped)];
            let wanted = [solution.measurements(), solution.jacobian().dot(&bell)];
            for (found, wanted) in found.iter().zip(&wanted) {
                let largest = wanted.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
                let off = (found - wanted).iter().fold(0.0_f64, |most, v| most.max(v.abs()));
                assert!(off < 1e-8 * largest, "{found} {wanted}");
            }
        }
        assert_eq!(
            Placing { start: 0, is_clockwise: false, swapped: Some(7) }.pair(8),
            Some([7, 0])
        );
    }
}
