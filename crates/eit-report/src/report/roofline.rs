//! The roofline of this machine: the minimum time for each solver's work.
//!
//! It is the larger of operations divided by the rate of a dense product and bytes divided by the
//! rate of a plain read ([`Machine`]); time above it is overhead, latency and waiting.

use crate::comparison::ReconstructionModel;
use eit_denoise::UnetShape;
use eit_skin::plan::machine::Machine;

/// Number of arrays of the size of the sequence that an iteration of total variation reads or
/// writes (image, dual variables and their extrapolation; docs/PERFORMANCE.md).
const TV_ARRAYS: f64 = 9.0;

/// Computes minimum times on a machine.
pub(super) struct Roofline {
    pub machine: Machine,
}

/// Upper bound on the number of independent measurements, given reciprocity.
fn rank(model: &ReconstructionModel) -> f64 {
    let skin = model.skin();
    let electrodes = skin.protocol.electrodes() as f64;
    let products = skin.model.cost().field_products as f64;
    let measurements = skin.protocol.measurements() as f64;
    measurements.min(products).min(0.5 * electrodes * (electrodes - 1.0))
}

impl Roofline {
    /// Factorisation, voltages and Jacobian, seconds.
    pub(crate) fn forward(&self, cost: &eit_fem::ModelCost, sizes: [usize; 2]) -> f64 {
        let [measurements, elements] = sizes.map(|n| n as f64);
        let entries = cost.factor_entries as f64;
        let sweep = 2.0 * entries * cost.field_solves as f64;
        let bytes = 8.0 * (entries + measurements * elements);
        self.machine.floor_s(cost.factor_flops + sweep + cost.product_flops, bytes)
    }

    /// Factorisation and voltages, seconds.
    pub(crate) fn voltages(&self, cost: &eit_fem::ModelCost) -> f64 {
        self.machine.floor_s(cost.factor_flops, 8.0 * cost.factor_entries as f64)
    }

    /// One image by two thin factors of the reconstruction matrix, of the given rank.
    pub(crate) fn one_step(&self, model: &ReconstructionModel, rank: usize) -> f64 {
        let pixels = model.raster.masked_pixels().len() as f64;
        let entries = rank as f64 * (model.skin().protocol.measurements() as f64 + pixels);
        self.machine.floor_s(2.0 * entries, 8.0 * entries)
    }

    /// The same on mesh elements, per frame, with `frames` frames processed at once.
    pub(crate) fn on_elements(
        &self,
        model: &ReconstructionModel,
        rank: usize,
        frames: usize,
    ) -> f64 {
        let elements = model.skin().model.elements() as f64;
        let entries = rank as f64 * (model.skin().protocol.measurements() as f64 + elements);
        self.machine.floor_s(2.0 * entries, 8.0 * entries / frames as f64)
    }

    /// Steps of the absolute method: model, Jacobian and normal equations.
    pub(crate) fn absolute(&self, model: &ReconstructionModel, steps: f64) -> f64 {
        let (m, n) = (model.skin().protocol.measurements(), model.skin().model.elements());
        let solve = self.forward(&model.skin().model.cost(), [m, n]);
        let [m, n] = [m, n].map(|count| count as f64);
        steps * (solve + self.machine.floor_s(m * m * n + m * m * m / 3.0, 8.0 * m * n))
    }

    /// Iterations of total variation on `frames` frames at once, in single precision.
    pub(crate) fn total_variation(
        &self,
        model: &ReconstructionModel,
        frames: usize,
        iterations: f64,
    ) -> f64 {
        let (rank, pixels) = (rank(model), model.raster.masked_pixels().len() as f64);
        let values = pixels * frames as f64;
        let bytes = 4.0 * (rank * pixels + TV_ARRAYS * values);
        iterations * self.machine.single_floor_s(4.0 * rank * values, bytes)
    }

    /// One image through a network.
    pub(crate) fn net(&self, shape: UnetShape, model: &ReconstructionModel) -> f64 {
        let side = model.raster.pixels();
        let flops = 2.0 * shape.multiply_adds(side, side);
        self.machine.single_floor_s(flops, 4.0 * shape.parameters() as f64)
    }
}
