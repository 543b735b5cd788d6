//! What voltages are judged by: the mesh-free series where there is one (an untouched disc or
//! hemisphere with equal contacts), else quadratic elements on a mesh much finer than all others; and
//! how far that itself may be from the truth.

use super::sheet::Sheet;
use crate::error::ReportError;
use eit_fem::ElementOrder;
use eit_skin::Skin;
use ndarray::Array1;

/// Degrees of the series; what it changes by from one to the other is taken for its error.
const SERIES_DEGREES: [usize; 2] = [18, 24];

/// An error is told only where it is so many times the reference's own.
const MARGIN: f64 = 10.0;

/// Voltages that stand for the truth.
pub(super) struct Reference {
    voltages: Array1<f64>,
    /// Volt.
    largest: f64,
    /// What it is.
    pub words: String,
    /// Its own error: change from the next coarser one, over the largest voltage.
    pub error: f64,
}

impl Reference {
    /// The series, or two meshes of these scales ([`Sheet::reference_mesh`]), the finer one last.
    pub fn of(sheet: &Sheet, scales: [f64; 2]) -> Result<Self, ReportError> {
        let skin = Skin::from_scene(sheet.scene.clone())?;
        let of_degree = |degree| skin.series_voltages(degree);
        let [coarse, fine] = SERIES_DEGREES;
        if sheet.is_even()
            && let (Some(coarse), Some(fine)) = (of_degree(coarse)?, of_degree(fine)?)
        {
            return Ok(Self::new(fine, &coarse, "the mesh-free series".to_owned()));
        }
        Self::of_meshes(sheet, scales)
    }

    fn of_meshes(sheet: &Sheet, [coarse, fine]: [f64; 2]) -> Result<Self, ReportError> {
        let (coarse, _) = meshed(sheet, coarse)?;
        let (fine, nodes) = meshed(sheet, fine)?;
        Ok(Self::new(fine, &coarse, format!("quadratic elements on {nodes} nodes")))
    }

    fn new(voltages: Array1<f64>, coarser: &Array1<f64>, words: String) -> Self {
        let largest = voltages.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let mut reference = Self { voltages, largest, words, error: 0.0 };
        reference.error = reference.error_of(coarser);
        reference
    }

    /// Largest error of a voltage over the largest voltage.
    pub fn error_of(&self, voltages: &Array1<f64>) -> f64 {
        let pairs = voltages.iter().zip(&self.voltages);
        pairs.fold(0.0_f64, |most, (v, e)| most.max((v - e).abs())) / self.largest
    }

    /// Whether an error is large enough to be told.
    pub fn can_tell(&self, error: f64) -> bool {
        error >= MARGIN * self.error
    }
}

/// Voltages of quadratic elements on a reference mesh, and its nodes.
fn meshed(sheet: &Sheet, scale: f64) -> Result<(Array1<f64>, usize), ReportError> {
    let mesh = sheet.reference_mesh(scale)?;
    let model = sheet.model(&mesh, ElementOrder::Quadratic)?;
    let voltages = model.forward(&sheet.conductivity_s(&mesh))?;
    Ok((voltages, mesh.surface().nodes().len()))
}

#[cfg(test)]
mod tests {
    use super::super::super::skins::{HEMISPHERE, PAPER_DISC};
    use super::*;

    /// Where there is a series, the meshes that stand for the truth elsewhere are within the error that
    /// they state of it, and that is small.
    #[test]
    fn meshes_are_as_near_to_the_series_as_they_say() {
        for skin in [PAPER_DISC, HEMISPHERE] {
            let sheet = Sheet::new(&skin).unwrap();
            let scales = [2.0, 1.5];
            let series = Reference::of(&sheet, scales).unwrap();
            assert_eq!(series.words, "the mesh-free series");
            let meshes = Reference::of_meshes(&sheet, scales).unwrap();
            let error = series.error_of(&meshes.voltages);
            println!("{}: {error:.1e}, stated {:.1e}", skin.scene, meshes.error);
            assert!(error <= meshes.error + series.error, "{error:e} against {:e}", meshes.error);
            assert!(meshes.error < 1e-4, "{:e}", meshes.error);
        }
    }

    #[test]
    fn errors_are_over_the_largest_voltage_and_told_above_the_margin() {
        let exact = Array1::from(vec![1.0, -4.0, 2.0]);
        let coarser = Array1::from(vec![1.0, -4.0, 2.004]);
        let reference = Reference::new(exact, &coarser, String::new());
        assert!((reference.error - 0.001).abs() < 1e-12);
        let error = reference.error_of(&Array1::from(vec![1.2, -4.0, 2.0]));
        assert!((error - 0.05).abs() < 1e-12);
        assert!(reference.can_tell(0.0101) && !reference.can_tell(0.0099));
    }
}
