//! Sizes of a U-net and the order of its parameters.

use crate::DenoiseError;

/// Size of a U-net (Ronneberger, Fischer and Brox, MICCAI 2015) with equal padding, so that images
/// keep their size, and up-sampling by repetition.
///
/// Inputs, in this order: for each of the last `history` frames, oldest first, its `images`; then
/// `conditions` planes, each filled with one number of the present frame; then the mask. With a `fold`
/// of 2 each plane of inputs becomes four planes of half the rows and columns (one for each place in
/// a block of 2 x 2 pixels), and the net's four outputs become one image in the same way
/// (sub-pixel convolution: Shi et al., CVPR 2016). All convolutions then run on a quarter of the pixels,
/// so that twice the width costs the same.
///
/// Level `l`, from 0, has `width * 2^l` channels and half the rows and columns of the level before:
/// two 3 x 3 convolutions, each followed by a ReLU, on the way down, then 2 x 2 maxima; on the way
/// up, values repeated 2 x 2 behind the channels of the same level on the way down, and two
/// convolutions again. A 1 x 1 convolution makes the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct UnetShape {
    /// Number of frames that the net takes, including the current one: 1 to 16.
    pub history: usize,
    /// Channels of the first level: 1 to 128. Ronneberger's net has 64; Duan, Taurand and Soleimani state no size.
    pub width: usize,
    /// Number of times that rows and columns are halved: 1 to 6. Ronneberger's net has 4.
    pub depth: usize,
    /// Images per frame: 1 to 4. The first sets the scale. A net of one image takes the one to be denoised.
    /// `eit-skin` gives nets of more images first the touches that it detected without any image, drawn as bells,
    /// then the image to be denoised, then one-step reconstructions of the same measurements.
    pub images: usize,
    /// Numbers per frame that condition the net, such as its signal-to-noise ratio: 0 to 4.
    pub conditions: usize,
    /// Side of the blocks of pixels that become channels: 1 (none) or 2.
    pub fold: usize,
}

impl Default for UnetShape {
    /// [`UnetShape::ONE_IMAGE`].
    fn default() -> Self {
        Self::ONE_IMAGE
    }
}

/// Shape of one convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Convolution {
    pub outputs: usize,
    pub inputs: usize,
    /// Side of the square kernel.
    pub side: usize,
}

impl Convolution {
    /// Weights without biases.
    pub(crate) fn weights(&self) -> usize {
        self.outputs * self.inputs * self.side * self.side
    }
}

impl UnetShape {
    /// One frame, one image, 4 channels, 3 halvings: 31 thousand weights, 11 million multiplications at
    /// 64 x 64.
    pub const ONE_IMAGE: Self =
        Self { history: 1, width: 4, depth: 3, images: 1, conditions: 0, fold: 1 };

    /// Rejects sizes outside the documented ranges.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        let sizes = [
            ("history", self.history, 1..=16, "1 to 16"),
            ("width", self.width, 1..=128, "1 to 128"),
            ("depth", self.depth, 1..=6, "1 to 6"),
            ("images", self.images, 1..=4, "1 to 4"),
            ("conditions", self.conditions, 0..=4, "0 to 4"),
            ("fold", self.fold, 1..=2, "1 or 2"),
        ];
        sizes.into_iter().try_for_each(|(quantity, value, range, must)| {
            DenoiseError::check_range(range.contains(&value), quantity, value as f64, must)
        })
    }

    /// Input planes before folding: images of all frames, conditions and mask.
    pub(crate) fn planes(&self) -> usize {
        self.history * self.images + self.conditions + 1
    }

    /// Channels of the first convolution.
    pub(crate) fn inputs(&self) -> usize {
        self.planes() * self.fold * self.fold
    }

    /// Channels of the last convolution: the pixels of a block.
    pub(crate) fn outputs(&self) -> usize {
        self.fold * self.fold
    }

    /// Returns the number of which rows and columns of an image must be multiples.
    pub(crate) fn multiple(&self) -> usize {
        self.fold << self.depth
    }

    /// Rows and columns of the first level.
    pub(crate) fn first_level(&self, size: [usize; 2]) -> [usize; 2] {
        self.padded(size).map(|n| n / self.fold)
    }

    /// Number of channels at a level of the net.
    pub(crate) fn channels(&self, level: usize) -> usize {
        self.width << level
    }

    /// All convolutions in the order in which they run: down, bottom (level `depth`), up, head.
    pub(crate) fn convolutions(&self) -> Vec<Convolution> {
        let three = |outputs, inputs| Convolution { outputs, inputs, side: 3 };
        let mut list = Vec::new();
        let mut inputs = self.inputs();
        for level in 0..=self.depth {
            let channels = self.channels(level);
            list.extend([three(channels, inputs), three(channels, channels)]);
            inputs = channels;
        }
        for level in (0..self.depth).rev() {
            let channels = self.channels(level);
            list.extend([three(channels, channels + self.channels(level + 1))]);
            list.extend([three(channels, channels)]);
        }
        list.push(Convolution { outputs: self.outputs(), inputs: self.channels(0), side: 1 });
        list
    }

    /// Names and shapes of the tensors in files, in the same order: weights and biases of each
    /// convolution.
    pub(crate) fn tensors(&self) -> impl Iterator<Item = (String, Vec<usize>)> {
        let down = (0..self.depth).map(|level| format!("down.{level}"));
        let up = (0..self.depth).rev().map(|level| format!("up.{level}"));
        let levels = down.chain(["bottom".to_owned()]).chain(up);
        let names = levels.flat_map(|level| [0, 1].map(|k| format!("{level}.{k}")));
        let names = names.chain(["head".to_owned()]);
        names.zip(self.convolutions()).flat_map(|(name, c)| {
            let weights = vec![c.outputs, c.inputs, c.side, c.side];
            [(format!("{name}.weight"), weights), (format!("{name}.bias"), vec![c.outputs])]
        })
    }

    /// Number of weights and biases.
    pub fn parameters(&self) -> usize {
        self.convolutions().iter().map(|c| c.weights() + c.outputs).sum()
    }

    /// Multiplications and additions for an image of this many rows and columns.
    pub fn multiply_adds(&self, rows: usize, columns: usize) -> f64 {
        let [rows, columns] = self.first_level([rows, columns]);
        let list = self.convolutions();
        let levels = (0..=self.depth).chain((0..self.depth).rev());
        let levels = levels.flat_map(|level| [level, level]).chain([0]);
        let cost = |(c, level): (&Convolution, usize)| {
            c.weights() as f64 * ((rows >> level) * (columns >> level)) as f64
        };
        list.iter().zip(levels).map(cost).sum()
    }

    /// Rows and columns, padded as folding and halving need.
    pub(crate) fn padded(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|n| n.next_multiple_of(self.multiple()))
    }
}
