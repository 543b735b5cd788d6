//! Voltages of a touched skin by the derivatives of the untouched one.
//!
//! With the change `c` of ln(conductivity) of each element, its strain `E` and the change of ln(contact impedance) of each
//! electrode, a voltage is
//!
//! ```text
//! v = v_0 + sum over elements of  J sigma c + A (E22 - E11) - 2 B E12  + sum over electrodes of  Z z (d ln z - stretch)
//! ```
//!
//! with the derivatives of [`crate::derivatives`]; only the part of the strain without dilation matters in two dimensions.
//! The strain is Hencky's, so that the slope of a dent counts and large strains have the effect of small ones one after the
//! other: with the gradient `D` of the displacement `U`, as far as the rim lets it, and `P` the part of `U` in the plane,
//!
//! ```text
//! E = ln(1 + grad P + grad P' + D' D) / 2
//! ```
//!
//! It is evaluated at centroids, from the closed forms of the dents with tabulated Bessel functions. Second order in
//! `c` is left out: a disc whose conductivity changes by the factor `e^c` acts like `2 tanh(c/2) = c - c^3/12`.
//!
//! Cost of a frame: for 104 different voltages and `e` elements 312 multiplications of f32 per element, 1.2 kB of the
//! matrix read, and about 120 flops per element and touch.

mod profile;
mod tile;

use super::instant::Instant;
use super::plan::Plan;
use crate::error::FemError;
use crate::fabric::bessel::KTable;
use crate::fabric::conductivity::sixteenths;
use crate::fabric::contact::Dent;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::settings::Instrument;
use faer::linalg::matmul::matmul;
use faer::{Accum, Col, Mat, Par};
use profile::Profile;
use pulp::Arch;
use tile::{Moved, Strain, Tile, stretches, tiles};

/// Derivatives of the voltages of an untouched skin, and where its elements are.
pub(super) struct Linearised {
    untouched_v: Vec<f64>,
    /// Measurements that are multiples of each other.
    sets: Vec<Vec<(usize, f64)>>,
    /// [input, set], each set's in one piece: three inputs per element, then one per electrode.
    derivatives: Mat<f32>,
    tiles: Vec<Tile>,
    /// Elements under each electrode, and the weights of their strain in its stretch.
    stretches: Vec<Vec<(usize, Strain)>>,
    strains: Vec<Strain>,
    /// How many times as large each element looks to currents, by [`Profile`].
    sizes: Vec<f64>,
    inputs: Col<f32>,
    outputs: Col<f32>,
    bessel: KTable,
}

impl Linearised {
    /// Refuses what is not linear.
    pub(super) fn check(fabric: &Fabric) -> Result<(), FemError> {
        let Instrument { loose, compliance_v, common_mode_db, .. } = &fabric.settings.instrument;
        let given = |value: &Option<f64>| value.unwrap_or(0.0);
        let (volts, decibels) = (given(compliance_v), given(common_mode_db));
        let must = "left out where the skin is linearised";
        FemError::require("number of loose contacts", loose.len() as f64, loose.is_empty(), must)?;
        FemError::require("compliance_v", volts, compliance_v.is_none(), must)?;
        FemError::require("common_mode_db", decibels, common_mode_db.is_none(), must)
    }

    /// Solves the untouched skin, with its derivatives.
    pub(super) fn new(fabric: &Fabric, plan: &Plan) -> Result<Self, FemError> {
        let (model, mesh) = (&fabric.model, &fabric.mesh);
        let (mut geometry, mut workspace) = (model.geometry(), model.workspace()?);
        let instrument = &fabric.settings.instrument;
        let contact = |(l, z): (usize, &f64)| {
            z * if instrument.lost.contains(&(l + 1)) { instrument.open_factor } else { 1.0 }
        };
        let impedance: Vec<f64> =
            fabric.contact_impedance.iter().enumerate().map(contact).collect();
        model.change_contacts(&impedance, &mut geometry)?;
        let mut solution = model.solve_deformed(&geometry, &plan.untouched_s, &mut workspace)?;
        let untouched_v = solution.measurements().to_vec();
        let contacts = solution.contact_jacobian()?;
        let (sheet, shears) = (solution.unique_jacobian::<f64>(), solution.shear_jacobian()?);
        let sets = model.unique_measurements();
        let (elements, electrodes) = (model.elements(), impedance.len());
        let derivatives = Mat::from_fn(3 * elements + electrodes, sets.len(), |input, set| {
            let value = match input.checked_sub(3 * elements) {
                Some(l) => contacts[[sets[set][0].0, l]] * impedance[l],
                None if input % 3 == 0 => sheet[[set, input / 3]] * plan.untouched_s[input / 3],
                None => shears[[set, input / 3 * 2 + input % 3 - 1]],
            };
            value as f32
        });
        let tiles = tiles(fabric);
        Ok(Self {
            untouched_v,
            inputs: Col::zeros(derivatives.nrows()),
            outputs: Col::zeros(derivatives.ncols()),
            derivatives,
            sets,
            strains: vec![[0.0; 4]; tiles.len()],
            sizes: vec![1.0; tiles.len()],
            stretches: stretches(mesh, &tiles),
            tiles,
            bessel: KTable::new(),
        })
    }

    /// Computes the voltages of an instant from its touches, and the memory of each element.
    pub(super) fn voltages(
        &mut self,
        fabric: &Fabric,
        plan: &Plan,
        instant: &mut Instant,
        memory: &mut [f64],
    ) {
        for (log, drift) in instant.contact_impedance.iter_mut().zip(&plan.contact_drift) {
            *log = drift.at(instant.time_s);
        }
        if let Some(linear) = &fabric.settings.linear {
            fabric.elements.changes_into(linear, &instant.touches, &mut instant.elements);
            let drift = plan.sheet_drift.at(instant.time_s);
            instant.elements.iter_mut().for_each(|change| *change = change.ln_1p() + drift);
        } else {
            let profiles: Vec<Profile<'_>> = instant
                .dents
                .iter()
                .map(|touch| Profile::new(touch, &fabric.motion, &self.bessel))
                .collect();
            // with the widest registers
            Arch::new().dispatch(|| self.feel(fabric, plan, &profiles, &mut instant.elements));
            let at = |profile: &Profile<'_>, place| {
                profile.at(profile.from(place).distance_m).deflection_m
            };
            let sum = |place| profiles.iter().map(|profile| at(profile, place)).sum();
            fabric.motion.add_contacts(sum, &mut instant.contact_impedance);
            plan.remember(instant, memory);
        }
        let warmth = plan.warmth(instant.time);
        instant.elements.iter_mut().zip(warmth).for_each(|(change, warmth)| *change += warmth);
        let weighted = |weights: &Strain, strain: &Strain| -> f64 {
            weights.iter().zip(strain).map(|(weight, part)| weight * part).sum()
        };
        let elements = self.tiles.iter().zip(&self.strains).zip(&instant.elements).enumerate();
        for (e, ((tile, strain), change)) in elements {
            self.inputs[3 * e] = (self.sizes[e] * change) as f32;
            self.inputs[3 * e + 1] = weighted(&tile.shears[0], strain) as f32;
            self.inputs[3 * e + 2] = weighted(&tile.shears[1], strain) as f32;
        }
        let electrodes = self.stretches.iter().zip(&instant.contact_impedance).enumerate();
        for (l, (parts, log)) in electrodes {
            let stretch = parts.iter().map(|(e, weights)| weighted(weights, &self.strains[*e]));
            self.inputs[3 * self.tiles.len() + l] = (log - stretch.sum::<f64>()) as f32;
        }
        let (outputs, inputs) = (self.outputs.as_mat_mut(), self.inputs.as_mat());
        matmul(outputs, Accum::Replace, self.derivatives.transpose(), inputs, 1.0, Par::Seq);
        for (set, change) in self.sets.iter().zip(self.outputs.iter()) {
            for (k, factor) in set {
                instant.voltages_v[*k] = self.untouched_v[*k] + factor * f64::from(*change);
            }
        }
    }

    /// Computes the drive and the strain of each element under dents.
    #[inline(always)]
    fn feel(&mut self, fabric: &Fabric, plan: &Plan, profiles: &[Profile<'_>], drives: &mut [f64]) {
        let law = &plan.law;
        for (e, tile) in self.tiles.iter().enumerate() {
            let (mut sum, mut ring, mut cut) = (Dent::default(), 0.0, None);
            let (mut moved, mut size) = (Moved::default(), 1.0);
            for profile in profiles {
                let touch = profile.touch;
                let from = profile.from(tile.middle_m);
                let felt = profile.at(from.distance_m);
                let here_pa = touch.dent.pressure_pa(from.distance_m, felt.deflection_m);
                sum.pressure_pa += here_pa;
                sum.areal_strain += felt.areal_strain;
                ring += touch.ring_at(from.distance_m);
                let edge_m = (from.distance_m - touch.dent.contact_radius_m).abs();
                if edge_m <= tile.size_m * touch.stretch {
                    cut = Some((profile, here_pa));
                }
                if fabric.motion.moves {
                    moved.add(tile, touch, &from, felt, fabric.motion.half_m);
                    size *= 1.0 + tile.follows * tile.follows * (felt.looks - 1.0);
                }
            }
            let drive = |pressure_pa| law.saturated(law.drive(&Dent { pressure_pa, ..sum }) + ring);
            drives[e] = match cut {
                // other touches press alike on all of the element
                Some((profile, here_pa)) => {
                    let rest_pa = sum.pressure_pa - here_pa;
                    let at = |place| profile.pressure_pa(profile.from(place).distance_m);
                    let corners = fabric.mesh.surface().corners(e);
                    let points = sixteenths(&corners).map(|place| drive(rest_pa + at(place)));
                    points.sum::<f64>() / 16.0
                }
                None => drive(sum.pressure_pa),
            };
            (self.strains[e], self.sizes[e]) = (moved.strain(tile), size);
        }
    }
}
