//! What a net sees beside the raw image: touches that were detected without an image, one-step images, the
//! signal-to-noise ratio and the strength of the touches.

use super::DrawnTouch;
use super::drawn::Surroundings;
use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
#[cfg(feature = "base")]
use eit_denoise::{Beside, Shard, ShardTouches};
use eit_denoise::{DataMisfit, NetFrame, UnetShape};
use eit_inverse::{InverseError, OneStepGaussNewton, OneStepSettings, Reconstructor, Workspace};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView2, ArrayViewMut2};
#[cfg(feature = "base")]
use ndarray::{Array3, Axis};

/// Hyperparameters of the one-step images, dimensionless: the ratio of noise to expected signal. The
/// first is about that of noise figure 1 on the paper's skin; the second resolves more where the data is
/// good; the third is as smooth as data at 20 dB allow.
const HYPERPARAMETERS: [f64; 3] = [0.1, 0.01, 1.0];
/// Decades of the signal-to-noise ratio that a net distinguishes.
const DECADES: f64 = 3.0;
/// Decades of the strength of touches that a net distinguishes, the middle at one pixel of doubled conductivity: a
/// finger of 1 N on the paper's fabric at 64 pixels.
const STRENGTHS: f64 = 2.0;
/// Number of conditions that a net may take.
const CONDITIONS: usize = 2;

/// Computes the inputs of nets that take more than the raw image.
///
/// A net of one image takes the raw one. Nets of more take first the touches of the frame, drawn as bells of
/// their place and strength ([`DrawnTouch`]), second the raw image, then one-step Gauss-Newton images of the same
/// differences, unweighted, with the scene's prior and hyperparameters that are the same for every skin and noise.
/// The image of touches sets the scale: where none was detected the net's image is zero.
///
/// The first condition is `log10(rms) / 3`, clipped to 0 to 1, with the rms of the differences in units of their
/// noise; the second `(1 + log10(s)) / 2`, clipped alike, with the strongest touch `s` as the area of doubled
/// conductivity in pixels, which tells how wide it presses.
#[derive(Debug, Clone)]
pub(crate) struct NetInputs {
    pub(super) shape: UnetShape,
    makers: Vec<(Reconstructor, Workspace)>,
    raster: Raster,
    /// Protocol indices of the measurements that the reconstructions use.
    used: Vec<usize>,
    /// Area of a pixel times the conductivity of the skin, S m^2.
    pixel_s_m2: f64,
    /// Measurements of the current frame, zero where one is missing.
    differences: Vec<f64>,
    missing: Vec<usize>,
    pixels: Vec<f64>,
    images: Vec<Array2<f64>>,
    /// Surroundings of the touches of the current frame.
    surroundings: Surroundings,
    conditions: Vec<f64>,
}

impl NetInputs {
    /// Prepares the inputs of a net for a skin.
    ///
    /// # Errors
    ///
    /// A net that takes more inputs than this program computes; the errors of the reconstruction.
    pub(crate) fn new(linearised: &LinearisedSkin, shape: UnetShape) -> Result<Self, SkinError> {
        let UnetShape { images, conditions, .. } = shape;
        let most = 2 + HYPERPARAMETERS.len();
        if images > most || conditions > CONDITIONS {
            return Err(SkinError::input(format!(
                "a net of {images} images and {conditions} conditions a frame, but this program makes \
                 up to {most} and {CONDITIONS}"
            )));
        }
        let raster = linearised.raster(&mut Progress::silent())?.clone();
        let measurements = linearised.skin.protocol.measurements();
        let used = linearised.imaging_measurements();
        let mut makers = Vec::new();
        if images > 2 {
            let settings = OneStepSettings {
                data: linearised.difference_data(),
                used: Some(used.clone()),
                ..Default::default()
            };
            let prior = linearised.prior()?;
            let mut one_step =
                OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)?;
            for hyperparameter in HYPERPARAMETERS.into_iter().take(images - 2) {
                one_step.set_hyperparameter(hyperparameter)?;
                let maker = one_step.on_raster(raster.pixel_from_element())?;
                let workspace = maker.workspace();
                makers.push((maker, workspace));
            }
        }
        let used: Vec<usize> = (0..measurements).filter(|&i| used[i]).collect();
        Ok(Self {
            shape,
            makers,
            differences: vec![0.0; used.len()],
            missing: Vec::with_capacity(used.len()),
            used,
            pixels: vec![0.0; raster.masked_pixels().len()],
            images: vec![Array2::zeros(raster.mask().dim()); images],
            surroundings: Surroundings::new(raster.mask().dim()),
            conditions: vec![0.0; conditions],
            pixel_s_m2: linearised.skin.conductivity_s * raster.pixel_m().powi(2),
            raster,
        })
    }

    /// Takes the raw image [row, column] of a frame, its differences `[measurement]` (NaN where a
    /// value is missing), its touches, and its energy in units of the noise; images are multiplied by `sign`.
    ///
    /// # Errors
    ///
    /// The errors of the reconstruction.
    pub(crate) fn push(
        &mut self,
        raw: ArrayView2<'_, f64>,
        differences: &[f64],
        touches: impl IntoIterator<Item = DrawnTouch>,
        energy: Option<DataMisfit>,
        sign: f64,
    ) -> Result<(), SkinError> {
        let Self { images, raster, surroundings, .. } = self;
        let mut strongest_s_m2 = 0.0_f64;
        if let [drawn, _, ..] = &mut images[..] {
            drawn.fill(0.0);
            surroundings.clear();
            for touch in touches {
                surroundings.add(&touch, raster);
                strongest_s_m2 = strongest_s_m2.max(touch.intensity_s_m2.abs());
                let intensity_s_m2 = sign * touch.intensity_s_m2;
                DrawnTouch { intensity_s_m2, ..touch }.draw(raster, drawn);
            }
        }
        let place = images.len().min(2) - 1;
        images[place].zip_mut_with(&raw, |image, raw| *image = sign * raw);
        if let (Some(condition), Some(energy)) = (self.conditions.first_mut(), energy) {
            *condition = signal_to_noise(energy);
        }
        if let Some(condition) = self.conditions.get_mut(1) {
            *condition = strength(strongest_s_m2 / self.pixel_s_m2);
        }
        if self.makers.is_empty() {
            return Ok(());
        }
        self.missing.clear();
        for (difference, &i) in self.differences.iter_mut().zip(&self.used) {
            *difference = differences.get(i).copied().unwrap_or(f64::NAN);
            if !difference.is_finite() {
                *difference = 0.0;
                self.missing.push(i);
            }
        }
        let Self { makers, images, pixels, differences, missing, .. } = self;
        for ((maker, workspace), image) in makers.iter_mut().zip(&mut images[2..]) {
            match maker.reconstruct_masked_difference_into(differences, missing, workspace, pixels)
            {
                // too little is left for an image
                Err(InverseError::MaskedDominates { .. } | InverseError::NothingUsed { .. }) => {
                    pixels.fill(0.0);
                }
                made => {
                    made?;
                }
            }
            self.raster.image_from_pixels_into(pixels, image.view_mut())?;
            image.mapv_inplace(|value| sign * value);
        }
        Ok(())
    }

    /// Limits the image [row, column] of the last frame outside its touches: the net corrects their
    /// drawing and shows no other touch. Does nothing for nets that see no touches.
    pub(crate) fn limit(&mut self, image: ArrayViewMut2<'_, f64>) {
        if needs_touches(self.shape) {
            self.surroundings.limit(image);
        }
    }

    /// Passes the inputs of the last frame to a net.
    pub(crate) fn with_frame<T>(&self, work: impl FnOnce(NetFrame<'_>) -> T) -> T {
        let views: [ArrayView2<'_, f64>; 2 + HYPERPARAMETERS.len()] =
            std::array::from_fn(|k| self.images[k.min(self.images.len() - 1)].view());
        work(NetFrame { images: &views[..self.images.len()], conditions: &self.conditions })
    }

    /// Computes the further inputs of a net for a shard of a learning base.
    ///
    /// # Errors
    ///
    /// A shard without its measurements; the errors of the reconstruction.
    #[cfg(feature = "base")]
    pub(crate) fn complete(&mut self, shard: &mut Shard) -> Result<(), SkinError> {
        if !needs_data(self.shape) {
            return Ok(());
        }
        let touches = match (&shard.touches, needs_touches(self.shape)) {
            (Some(touches), _) => touches.clone(),
            (None, false) => ShardTouches::zeros((shard.raw.dim().0, 0, 3)),
            (None, true) => {
                return Err(SkinError::input(
                    "the learning base has no touches, and a net of several images sees them: make it \
                     again, with [noise], or train with images = 1",
                ));
            }
        };
        let Some(data) = &shard.data else {
            return Err(SkinError::input(
                "the noise of the learning base's frames is unknown, and a net that sees measurements \
                 needs it: set [noise], or train with images = 1",
            ));
        };
        let (frames, rows, columns) = shard.raw.dim();
        let mut images = vec![Array3::zeros((frames, rows, columns)); self.shape.images];
        let mut conditions = Array2::zeros((frames, self.shape.conditions));
        for (frame, differences) in data.differences.outer_iter().enumerate() {
            let raw = shard.raw.index_axis(Axis(0), frame).mapv(f64::from);
            let differences: Vec<f64> = differences.iter().map(|v| f64::from(*v)).collect();
            let energy = energy(&differences, data.noise_std.iter().map(|std| f64::from(*std)));
            let of_frame = touches.index_axis(Axis(0), frame);
            let of_frame = of_frame.rows().into_iter().filter(|touch| touch[0].is_finite());
            let drawn = of_frame.map(|touch| DrawnTouch {
                position_m: [f64::from(touch[0]), f64::from(touch[1])],
                intensity_s_m2: f64::from(touch[2]),
            });
            self.push(raw.view(), &differences, drawn, Some(energy), 1.0)?;
            for (images, made) in images.iter_mut().zip(&self.images) {
                let mut image = images.index_axis_mut(Axis(0), frame);
                let values = made.iter().zip(&shard.mask);
                for (value, (made, inside)) in image.iter_mut().zip(values) {
                    *value = if *inside { *made as f32 } else { 0.0 };
                }
            }
            for (value, made) in conditions.row_mut(frame).iter_mut().zip(&self.conditions) {
                *value = *made as f32;
            }
        }
        let conditions = (self.shape.conditions > 0).then_some(conditions);
        // the raw images are the shard's own
        let mut images = images.into_iter();
        let first = if needs_touches(self.shape) { images.next() } else { None };
        shard.beside = Beside { first, images: images.skip(1).collect(), conditions };
        Ok(())
    }
}

/// Returns whether nets of this shape take measurements, not only an image.
pub(crate) fn needs_data(shape: UnetShape) -> bool {
    shape.images > 1 || shape.conditions > 0
}

/// Returns whether nets of this shape take the touches of a frame.
pub(crate) fn needs_touches(shape: UnetShape) -> bool {
    shape.images > 1
}

/// Energy of differences in units of the noise; values that are not finite are missing.
#[cfg(feature = "base")]
fn energy(differences: &[f64], noise_std: impl Iterator<Item = f64>) -> DataMisfit {
    let mut found = DataMisfit { data: 0.0, residual: 0.0, measurements: 0 };
    for (difference, std) in differences.iter().zip(noise_std) {
        if difference.is_finite() && std.is_finite() {
            found.data += (difference / std).powi(2);
            found.measurements += 1;
        }
    }
    found
}

/// The condition of a net: 0 for noise, 1 for a signal a thousand times as large.
fn signal_to_noise(energy: DataMisfit) -> f64 {
    let mean = energy.data / energy.measurements.max(1) as f64;
    // zero has no logarithm
    (0.5 * mean.max(1.0).log10() / DECADES).min(1.0)
}

/// The second condition of a net: 0 for a tenth of a pixel of doubled conductivity, 1 for ten.
fn strength(pixels: f64) -> f64 {
    // zero has no logarithm
    (0.5 + pixels.max(1e-9).log10() / STRENGTHS).clamp(0.0, 1.0)
}
