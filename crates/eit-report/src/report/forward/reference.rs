//! Reference voltages with an estimate of their own error: the mesh-free series if one exists (an
//! untouched disc or hemisphere with equal contacts), otherwise quadratic elements on a mesh much
//! finer than all others.

use super::problem::ForwardProblem;
use crate::error::ReportError;
use eit_fem::ElementOrder;
use eit_skin::Skin;
use ndarray::Array1;

/// Degrees of the series; the difference between the two estimates its error.
const SERIES_DEGREES: [usize; 2] = [18, 24];

/// Errors are reported only if they are at least this many times the reference's own.
const MARGIN: f64 = 10.0;

/// Voltages used as the truth.
pub(super) struct ReferenceVoltages {
    voltages: Array1<f64>,
    /// Largest voltage, volts.
    largest: f64,
    /// Description for the report.
    pub description: String,
    /// Its own error: the difference from the next coarser reference, divided by the largest
    /// voltage.
    pub error: f64,
}

impl ReferenceVoltages {
    /// Computes the series, or solves on two meshes of these scales
    /// ([`ForwardProblem::reference_mesh`]), the finer one last.
    pub(crate) fn of(problem: &ForwardProblem, scales: [f64; 2]) -> Result<Self, ReportError> {
        let skin = Skin::from_scene(problem.scene.clone())?;
        let of_degree = |degree| skin.series_voltages(degree);
        let [coarse, fine] = SERIES_DEGREES;
        if problem.is_even()
            && let (Some(coarse), Some(fine)) = (of_degree(coarse)?, of_degree(fine)?)
        {
            return Ok(Self::new(fine, &coarse, "the mesh-free series".to_owned()));
        }
        Self::of_meshes(problem, scales)
    }

    fn of_meshes(problem: &ForwardProblem, [coarse, fine]: [f64; 2]) -> Result<Self, ReportError> {
        let coarse = ReferenceSolution::new(problem, coarse)?;
        let ReferenceSolution { voltages, nodes } = ReferenceSolution::new(problem, fine)?;
        let description = format!("quadratic elements on {nodes} nodes");
        Ok(Self::new(voltages, &coarse.voltages, description))
    }

    fn new(voltages: Array1<f64>, coarser: &Array1<f64>, description: String) -> Self {
        let largest = voltages.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let mut reference = Self { voltages, largest, description, error: 0.0 };
        reference.error = reference.error_of(coarser);
        reference
    }

    /// Largest error of a voltage divided by the largest voltage.
    pub(crate) fn error_of(&self, voltages: &Array1<f64>) -> f64 {
        let pairs = voltages.iter().zip(&self.voltages);
        pairs.fold(0.0_f64, |most, (v, e)| most.max((v - e).abs())) / self.largest
    }

    /// Whether an error is large enough to be reported.
    pub(crate) fn can_tell(&self, error: f64) -> bool {
        error >= MARGIN * self.error
    }
}

/// Voltages of quadratic elements on a reference mesh, and its number of nodes.
struct ReferenceSolution {
    voltages: Array1<f64>,
    nodes: usize,
}

impl ReferenceSolution {
    fn new(problem: &ForwardProblem, scale: f64) -> Result<Self, ReportError> {
        let mesh = problem.reference_mesh(scale)?;
        let model = problem.model(&mesh, ElementOrder::Quadratic)?;
        let voltages = model.forward(&problem.conductivity_s(&mesh))?;
        Ok(Self { voltages, nodes: mesh.surface().nodes().len() })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::cases::Case;
    use super::*;

    /// Where a series exists, the reference meshes used elsewhere agree with it to within their
    /// estimated error, which is small.
    #[test]
    fn meshes_are_as_near_to_the_series_as_they_say() {
        let names = ["paper-disc-60", "hemisphere"];
        for case in Case::built_in().filter(|case| names.contains(&&*case.name)) {
            let problem = ForwardProblem::new(&case).unwrap();
            let scales = [2.0, 1.5];
            let series = ReferenceVoltages::of(&problem, scales).unwrap();
            assert_eq!(series.description, "the mesh-free series");
            let meshes = ReferenceVoltages::of_meshes(&problem, scales).unwrap();
            let error = series.error_of(&meshes.voltages);
            println!("{}: {error:.1e}, stated {:.1e}", case.scene, meshes.error);
            assert!(error <= meshes.error + series.error, "{error:e} against {:e}", meshes.error);
            assert!(meshes.error < 1e-4, "{:e}", meshes.error);
        }
    }

    #[test]
    fn errors_are_relative_to_the_largest_voltage_and_given_above_the_margin() {
        let exact = Array1::from(vec![1.0, -4.0, 2.0]);
        let coarser = Array1::from(vec![1.0, -4.0, 2.004]);
        let reference = ReferenceVoltages::new(exact, &coarser, String::new());
        assert!((reference.error - 0.001).abs() < 1e-12);
        let error = reference.error_of(&Array1::from(vec![1.2, -4.0, 2.0]));
        assert!((error - 0.05).abs() < 1e-12);
        assert!(reference.can_tell(0.0101) && !reference.can_tell(0.0099));
    }
}
