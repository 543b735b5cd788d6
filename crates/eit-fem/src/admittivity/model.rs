//! Forward model with complex admittivity and contact impedances.

use super::phases::Phases;
use crate::error::FemError;
use crate::model::{ForwardModel, ModelCost};
use crate::protocol::Protocol;
use eit_mesh::Mesh;
use num_complex::Complex64;

/// Returns the admittivity of a sheet, `conductivity_s + 2 pi i frequency_hz capacitance_f`,
/// siemens per square.
///
/// ```
/// let gamma = eit_fem::admittivity(1e-5, 2e-10, 10e3);
/// assert!((gamma.im - 1.2566e-5).abs() < 1e-9);
/// ```
pub fn admittivity(conductivity_s: f64, capacitance_f: f64, frequency_hz: f64) -> Complex64 {
    Complex64::new(conductivity_s, std::f64::consts::TAU * frequency_hz * capacitance_f)
}

/// Forward model of a skin with complex admittivity and contact impedances at one frequency.
///
/// ```
/// use eit_fem::{AdmittivityModel, Complex64, PairProtocol, admittivity};
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let skin = SkinShape::Disc { radius_m: 0.1 };
/// let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.02))?;
/// let protocol = PairProtocol::default().protocol()?;
/// let model = AdmittivityModel::new(&mesh, &protocol, &[Complex64::new(1e3, -2e2); 16])?;
/// let gamma = vec![admittivity(1e-5, 2e-10, 10e3); model.elements()];
/// let mut workspace = model.workspace()?;
/// let mut solution = model.solve(&gamma, &mut workspace)?;
/// // the voltage lags behind the current, as on every capacitor
/// let voltage = solution.measurements()[0];
/// assert!((voltage / voltage.re).im < 0.0);
/// assert!(solution.report().growth < 3.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct AdmittivityModel {
    /// Patterns, ordering and symbolic factorisation. Its electrodes are insulated; the complex
    /// contact terms are added separately.
    pub(super) real: ForwardModel,
    /// Contact terms, one value per matrix entry.
    pub(super) contacts: Vec<Complex64>,
    /// Phases of the contact admittances.
    pub(super) phases: Phases,
}

impl AdmittivityModel {
    /// Creates a model: validates the input, orders the unknowns and factorises symbolically.
    ///
    /// `contact_impedance` holds one value per electrode of the mesh, ohm metre for rim electrodes
    /// and ohm square metre for patches. Capacitive contacts have a negative imaginary part.
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`]; impedances that are zero, not finite, or have a negative
    /// real part. Only the real model supports shunts and ideal current sources.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[Complex64],
    ) -> Result<Self, FemError> {
        if let Some(l) = contact_impedance.iter().position(|z| !is_passive(*z)) {
            let value = contact_impedance[l];
            return Err(FemError::BadComplexImpedance { electrode: l + 1, value });
        }
        // an infinite impedance contributes exactly zero
        let real =
            ForwardModel::new(mesh, protocol, &vec![f64::INFINITY; contact_impedance.len()])?;
        // the conjugate of `z` has the phase of `1/z` and cannot overflow
        let admittances: Vec<Complex64> = contact_impedance.iter().map(Complex64::conj).collect();
        let contacts = contact_values(&real, contact_impedance);
        Ok(Self { contacts, phases: Phases::of(&admittances), real })
    }

    /// Returns the protocol whose voltages the model computes.
    pub fn protocol(&self) -> &Protocol {
        self.real.protocol()
    }

    /// Number of elements, which is the length of an admittivity vector.
    pub fn elements(&self) -> usize {
        self.real.elements()
    }

    /// Returns the size of the model and the cost of its solves, counted in complex numbers: 16
    /// bytes per entry, four real flops per counted flop.
    pub fn cost(&self) -> ModelCost {
        self.real.cost()
    }

    pub(super) fn check_admittivity(&self, admittivity_s: &[Complex64]) -> Result<(), FemError> {
        let what = "admittivity (one per element)";
        FemError::check_length(what, admittivity_s.len(), self.elements())?;
        match admittivity_s.iter().position(|y| !is_passive(*y)) {
            None => Ok(()),
            Some(element) => {
                let count = admittivity_s.iter().filter(|y| !is_passive(**y)).count();
                let value_s = admittivity_s[element];
                Err(FemError::BadAdmittivity { element, value_s, count })
            }
        }
    }
}

/// Whether an admittance or impedance is finite, non-zero and does not generate power.
fn is_passive(value: Complex64) -> bool {
    value.is_finite() && value.re >= 0.0 && (value.re > 0.0 || value.im != 0.0)
}

/// Computes the electrode part of the matrix values. A contact is a resistor in parallel with a
/// reactance, `1/z = 1/r + 1/(i x)`; each is filled in as the impedance of a real model.
fn contact_values(real: &ForwardModel, contact_impedance: &[Complex64]) -> Vec<Complex64> {
    // without a reactive part, `r` equals `z` exactly and `x` is infinite
    let parallel = |a: f64, b: f64| if b == 0.0 { a } else { a + b * (b / a) };
    let resistances: Vec<f64> = contact_impedance.iter().map(|z| parallel(z.re, z.im)).collect();
    let reactances: Vec<f64> = contact_impedance.iter().map(|z| -parallel(z.im, z.re)).collect();
    let filled = |impedance: &[f64]| {
        let mut values = vec![0.0; real.assembly.pattern.entries()];
        let (contacts, positions) = (&real.dofs.contacts, &real.geometry.positions);
        real.assembly.fill_contacts(contacts, positions, impedance, &mut values);
        values
    };
    let (conductances, susceptances) = (filled(&resistances), filled(&reactances));
    conductances.iter().zip(&susceptances).map(|(&g, &b)| Complex64::new(g, b)).collect()
}
