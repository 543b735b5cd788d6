//! A skin with complex admittivity and contacts.

use super::phases::Phases;
use crate::error::FemError;
use crate::model::{ForwardModel, ModelCost};
use crate::protocol::Protocol;
use eit_mesh::Mesh;
use num_complex::Complex64;

/// Admittivity `conductivity_s + 2 pi i frequency_hz capacitance_f` of a sheet, siemens per square.
///
/// ```
/// let gamma = eit_fem::admittivity(1e-5, 2e-10, 10e3);
/// assert!((gamma.im - 1.2566e-5).abs() < 1e-9);
/// ```
pub fn admittivity(conductivity_s: f64, capacitance_f: f64, frequency_hz: f64) -> Complex64 {
    Complex64::new(conductivity_s, std::f64::consts::TAU * frequency_hz * capacitance_f)
}

/// A skin with complex admittivity and contact impedances at one frequency, ready to solve.
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
#[derive(Debug)]
pub struct AdmittivityModel {
    /// Patterns, ordering and symbolic factor, with insulated electrodes: what contacts add to the
    /// matrix is complex.
    pub(super) real: ForwardModel,
    /// What contacts add, one value per entry of the matrix.
    pub(super) contacts: Vec<Complex64>,
    /// Phases of the contact admittances.
    pub(super) phases: Phases,
}

impl AdmittivityModel {
    /// Prepares the model: checks, ordering and symbolic factorisation.
    ///
    /// `contact_impedance` is one value per electrode of the mesh, ohm metre for rim electrodes and
    /// ohm square metre for patches; capacitive contacts have a negative imaginary part.
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`]; impedances that are zero, not finite, or negative in their
    /// real part. Shunts and ideal current sources are for the real model only.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[Complex64],
    ) -> Result<Self, FemError> {
        if let Some(l) = contact_impedance.iter().position(|z| !is_passive(*z)) {
            let value = contact_impedance[l];
            return Err(FemError::BadComplexImpedance { electrode: l + 1, value });
        }
        // an infinite impedance adds exactly zero
        let real =
            ForwardModel::new(mesh, protocol, &vec![f64::INFINITY; contact_impedance.len()])?;
        // `1/z` has the phase of the conjugate, which does not overflow
        let admittances: Vec<Complex64> = contact_impedance.iter().map(Complex64::conj).collect();
        let contacts = contact_values(&real, contact_impedance);
        Ok(Self { contacts, phases: Phases::of(&admittances), real })
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol {
        self.real.protocol()
    }

    /// Number of elements: the length of an admittivity.
    pub fn elements(&self) -> usize {
        self.real.elements()
    }

    /// What solves of this model cost, counted in complex numbers: 16 bytes an entry, four real
    /// flops for each one.
    pub fn cost(&self) -> ModelCost {
        self.real.cost()
    }

    pub(super) fn check_admittivity(&self, admittivity_s: &[Complex64]) -> Result<(), FemError> {
        if admittivity_s.len() != self.elements() {
            return Err(FemError::WrongLength {
                what: "admittivity (one per element)",
                found: admittivity_s.len(),
                wanted: self.elements(),
            });
        }
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

/// Whether an admittance or impedance is a number that takes power or stores it.
fn is_passive(value: Complex64) -> bool {
    value.is_finite() && value.re >= 0.0 && (value.re > 0.0 || value.im != 0.0)
}

/// Electrode part of the matrix values. A contact is a resistor and a reactance in parallel,
/// `1/z = 1/r + 1/(i x)`, and each of the two is filled as the impedance of a real model.
fn contact_values(real: &ForwardModel, contact_impedance: &[Complex64]) -> Vec<Complex64> {
    // without reactance `r` is `z` to the last bit, and `x` infinite
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
