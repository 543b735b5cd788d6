//! Nets as burn modules: the trait for custom nets, and the U-net of this crate.

#[cfg(feature = "base")]
mod device;
mod exchange;
mod through;
mod unet;

pub use through::images_through;
#[cfg(feature = "base")]
pub use through::shard_through;
pub use unet::Unet;

#[cfg(feature = "train")]
pub(crate) use through::{device_of, padded, read, same_shape};

use burn::module::Module;
use burn::tensor::Tensor;

/// A burn module that denoises images: [`crate::Trainer`] trains it and [`images_through`] runs it. Implement
/// it for your own architecture.
///
/// Images are divided by the largest magnitude among the inputs and zero outside the mask, as
/// in [`crate::Denoiser`].
///
/// # Example
///
/// Two convolutions trained on a learning base of one sequence:
#[cfg_attr(feature = "train", doc = "```")]
#[cfg_attr(not(feature = "train"), doc = "```ignore")]
/// use eit_denoise::burn::module::Module;
/// use eit_denoise::burn::nn::PaddingConfig2d;
/// use eit_denoise::burn::nn::conv::{Conv2d, Conv2dConfig};
/// use eit_denoise::burn::tensor::{Device, Tensor, activation::relu};
/// use eit_denoise::burn;
/// use eit_denoise::{
///     Examples, ImageNet, ImageStack, Shard, TrainDevice, TrainSettings, Trainer, images_through,
/// };
/// use ndarray::{Array2, Array3};
///
/// #[derive(Module, Debug)]
/// struct TwoConvolutions {
///     first: Conv2d,
///     second: Conv2d,
/// }
///
/// impl TwoConvolutions {
///     fn new(device: &Device) -> Self {
///         let of = |channels| {
///             let padding = PaddingConfig2d::Explicit(2, 2, 2, 2);
///             Conv2dConfig::new(channels, [5, 5]).with_padding(padding).init(device)
///         };
///         // one frame and the mask
///         Self { first: of([2, 8]), second: of([8, 1]) }
///     }
/// }
///
/// impl ImageNet for TwoConvolutions {
///     fn forward(&self, inputs: Tensor<4>) -> Tensor<4> {
///         self.second.forward(relu(self.first.forward(inputs)))
///     }
///     fn history(&self) -> usize {
///         1
///     }
///     fn name(&self) -> String {
///         "two convolutions of 5 x 5".to_owned()
///     }
/// }
///
/// // a bell that moves, under stripes and alone
/// let mask = Array2::from_elem((16, 16), true);
/// let bell = |stripes: f64| {
///     Array3::from_shape_fn((8, 16, 16), |(f, r, c)| {
///         let [y, x] = [r as f64 - 4.0 - f as f64, c as f64 - 8.0];
///         (-0.1 * (x * x + y * y)).exp() + stripes * (1.3 * c as f64).sin()
///     })
/// };
/// let raw = ImageStack::new(bell(0.3), mask.clone())?;
/// let wanted = ImageStack::new(bell(0.0), mask)?;
/// let examples = Examples::new(&[Shard::new(&raw, &wanted)?], 1)?;
///
/// let device = TrainDevice::Flex.open()?;
/// device.seed(3);
/// let settings = TrainSettings { epochs: 20, batch: 4, rate: 1e-2, ..Default::default() };
/// let mut trainer = Trainer::new(TwoConvolutions::new(&device), &settings, "bells")?;
/// for _ in 0..settings.epochs {
///     trainer.epoch(&examples, &examples, 1, &mut |_, _| std::ops::ControlFlow::Continue(()))?;
/// }
/// // of the raw images' own error less than half is left
/// assert!(trainer.best().is_some_and(|epoch| epoch.held_out_error < 0.5));
/// let clean = images_through(trainer.best_net(), &raw)?;
/// assert_eq!(clean.values().dim(), (8, 16, 16));
/// # Ok::<(), eit_denoise::DenoiseError>(())
/// ```
pub trait ImageNet: Module {
    /// Maps inputs [example, input, row, column] to images [example, 1, row, column]. Inputs, in this
    /// order: the images of each of the last frames, oldest frame first; the conditions of the last frame,
    /// each a plane of one value inside the mask and zero outside; the mask as zeros and ones.
    fn forward(&self, inputs: Tensor<4>) -> Tensor<4>;

    /// Images per frame: the raw one among those of [`crate::Beside`]. Default: 1.
    fn images(&self) -> usize {
        1
    }

    /// Conditions per frame ([`crate::Beside`]). Default: 0.
    fn conditions(&self) -> usize {
        0
    }

    /// Number of frames that it takes, including the current one: at least 1.
    fn history(&self) -> usize;

    /// Rows and columns are padded with zeros to a multiple of this. Default: 1.
    fn multiple(&self) -> usize {
        1
    }

    /// Architecture and size in words. A checkpoint of a net with another name is rejected.
    fn name(&self) -> String;
}
