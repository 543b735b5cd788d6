//! Determines whether a scene is reactive, with its complex admittivity and contacts.

use super::{ElementOrder, Must, OneOrMany, Scene, check_numbers};
use crate::error::SkinError;
#[cfg(feature = "complex")]
use eit_fem::{Complex64, admittivity};

const CONTACT: &str = "electrodes.contact_capacitance_f_per_m";

impl Scene {
    /// Returns whether a capacitance of the scene carries current at its frequency. If none does, nothing
    /// complex is built or computed.
    pub fn is_reactive(&self) -> bool {
        let mut capacitances =
            self.skin.sheet_capacitance_f.into_iter().chain(self.contact_capacitances());
        self.frequency_hz() > 0.0 && capacitances.any(|c| c > 0.0)
    }

    /// Returns why the scene needs no complex numbers, if [`Scene::is_reactive`] is false.
    pub(crate) fn why_real(&self) -> &'static str {
        let keys = (&self.skin.sheet_capacitance_f, &self.electrodes.contact_capacitance_f_per_m);
        match keys {
            (None, None) => "the scene has no reactive part",
            _ => "the capacitances or the frequency are zero: no current flows through them",
        }
    }

    /// Returns the frequency in hertz; zero if the scene states none.
    pub fn frequency_hz(&self) -> f64 {
        self.protocol.frequency_hz.unwrap_or(0.0)
    }

    /// Returns the admittivity of a sheet with this conductivity and the scene's capacitance, siemens per
    /// square.
    #[cfg(feature = "complex")]
    pub fn admittivity_of(&self, conductivity_s: f64) -> Complex64 {
        admittivity(
            conductivity_s,
            self.skin.sheet_capacitance_f.unwrap_or(0.0),
            self.frequency_hz(),
        )
    }

    /// Returns the contact impedance of each electrode: resistance and capacitance in parallel.
    ///
    /// # Errors
    ///
    /// A wrong number of values, and a resistance that is not above zero, or infinite without a capacitance.
    #[cfg(feature = "complex")]
    pub(crate) fn complex_contact_impedance(
        &self,
        electrodes: usize,
    ) -> Result<Vec<Complex64>, SkinError> {
        let resistances = self.contact_impedance(electrodes)?;
        let keys = self.electrodes.contact_capacitance_f_per_m.as_ref();
        let capacitances_f = self.each(CONTACT, keys, electrodes)?;
        let contact = |(l, (r, c)): (usize, (&f64, f64))| {
            let susceptance = admittivity(0.0, c, self.frequency_hz()).im;
            if r.is_nan() || *r <= 0.0 || (r.is_infinite() && susceptance == 0.0) {
                return Err(self.error(format!(
                    "electrodes.contact_impedance_ohm_m is {r} at electrode {}: on a skin with \
                     capacitances it must be above zero, and finite if the contact has no capacitance",
                    l + 1
                )));
            }
            if susceptance == 0.0 {
                return Ok(Complex64::from(*r));
            }
            Ok(Complex64::new(1.0 / r, susceptance).inv())
        };
        resistances.iter().zip(capacitances_f).enumerate().map(contact).collect()
    }

    /// Rejects contacts that no model can be built with, before meshing.
    ///
    /// # Errors
    ///
    /// Those of [`Scene::contact_impedance`] or [`Scene::complex_contact_impedance`].
    pub(crate) fn check_contacts(&self, electrodes: usize) -> Result<(), SkinError> {
        #[cfg(feature = "complex")]
        if self.is_reactive() {
            return self.complex_contact_impedance(electrodes).map(drop);
        }
        self.contact_impedance(electrodes).map(drop)
    }

    /// Rejects a reactive scene, for commands that only support conductivity.
    ///
    /// # Errors
    ///
    /// [`SkinError::Input`] if capacitances of the scene carry current.
    pub fn refuse_reactive(&self) -> Result<(), SkinError> {
        if !self.is_reactive() {
            return Ok(());
        }
        Err(self.error(format!(
            "the scene stores charge at {} Hz (sheet_capacitance_f, contact_capacitance_f_per_m): only \
             `eit forward`, `eit jacobian`, `eit plan` and `eit mesh` support complex admittivity; for \
             this command remove protocol.frequency_hz and the capacitances",
            self.frequency_hz()
        )))
    }

    /// Checks the ranges of capacitances and frequency, and that mesh settings support reactive skins.
    ///
    /// # Errors
    ///
    /// A value out of range, and mesh settings that only support conductivities.
    pub(crate) fn check_reactive(&self) -> Result<(), SkinError> {
        let contacts = self.contact_capacitances().map(|c| (CONTACT, Some(c), Must::NotNegative));
        check_numbers(contacts.chain([
            ("skin.sheet_capacitance_f", self.skin.sheet_capacitance_f, Must::NotNegative),
            ("protocol.frequency_hz", self.protocol.frequency_hz, Must::NotNegative),
        ]))?;
        #[cfg(not(feature = "complex"))]
        if self.is_reactive() {
            return Err(SkinError::input(format!(
                "the scene stores charge at {} Hz (sheet_capacitance_f, contact_capacitance_f_per_m): this program \
                 was built without complex admittivity (feature `complex` of eit-skin)",
                self.frequency_hz()
            )));
        }
        if self.is_reactive() && self.mesh.required_accuracy.is_some() {
            return Err(SkinError::input(
                "mesh.required_accuracy is only supported for conductivities: for a skin that stores charge \
                 use mesh.nodes or edge_m",
            ));
        }
        if self.is_reactive() && self.skin.weave_ratio.is_some_and(|ratio| ratio != 1.0) {
            return Err(SkinError::input(
                "skin.weave_ratio is only supported for conductivities, not for a skin that stores charge",
            ));
        }
        if self.is_reactive() && self.mesh.elements == Some(ElementOrder::Quadratic) {
            return Err(SkinError::input(
                "mesh.elements is \"quadratic\": skins that store charge are only solved on linear \
                 elements",
            ));
        }
        Ok(())
    }

    fn contact_capacitances(&self) -> impl Iterator<Item = f64> {
        let values: &[f64] = match &self.electrodes.contact_capacitance_f_per_m {
            None => &[],
            Some(OneOrMany::One(c)) => std::slice::from_ref(c),
            Some(OneOrMany::Many(list)) => list,
        };
        values.iter().copied()
    }
}
