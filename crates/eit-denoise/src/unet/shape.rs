//! What a U-net looks like, and in which order its numbers stand.

use crate::DenoiseError;

/// Size of a U-net (Ronneberger, Fischer and Brox, MICCAI 2015), with equal padding, so that images
/// keep their size, and up-sampling by repetition.
///
/// Level `l` from 0 has `width * 2^l` channels and half the pixels of the level before: two 3 x 3
/// convolutions, each followed by the positive part, on the way down, then 2 x 2 maxima; on the way
/// up, values repeated 2 x 2 behind the channels of the same level on the way down, and two
/// convolutions again. A 1 x 1 convolution makes the image. Its inputs are `history` frames, oldest
/// first, and the mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnetShape {
    /// Last frames that it sees, the present one included: 1 to 16.
    pub history: usize,
    /// Channels of the first level: 1 to 128. The paper's net has 64.
    pub width: usize,
    /// Times that pixels are halved: 1 to 6. The paper's net has 4.
    pub depth: usize,
}

impl Default for UnetShape {
    /// One frame, 4 channels, 3 halvings: 31 thousand weights, 11 million multiplications at 64 x 64.
    /// Over their first five epochs nets of 8 channels, or with three frames, were no better on
    /// the simulated fabric.
    fn default() -> Self {
        Self { history: 1, width: 4, depth: 3 }
    }
}

/// One convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Convolution {
    pub outputs: usize,
    pub inputs: usize,
    /// Side of the square kernel.
    pub side: usize,
}

impl Convolution {
    /// Weights without biases.
    pub fn weights(&self) -> usize {
        self.outputs * self.inputs * self.side * self.side
    }
}

impl UnetShape {
    /// Refuses sizes beyond those documented.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        let sizes = [
            ("history", self.history, 16, "1 to 16"),
            ("width", self.width, 128, "1 to 128"),
            ("depth", self.depth, 6, "1 to 6"),
        ];
        match sizes.into_iter().find(|(_, value, most, _)| !(1..=*most).contains(value)) {
            None => Ok(()),
            Some((quantity, value, _, must)) => {
                Err(DenoiseError::OutOfRange { quantity, value: value as f64, must })
            }
        }
    }

    /// Channels that go in: frames and mask.
    pub(crate) fn inputs(&self) -> usize {
        self.history + 1
    }

    /// Channels of a level.
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
        list.push(Convolution { outputs: 1, inputs: self.channels(0), side: 1 });
        list
    }

    /// Names of the convolutions in files, in the same order.
    pub(crate) fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for level in 0..self.depth {
            names.extend([format!("down.{level}.0"), format!("down.{level}.1")]);
        }
        names.extend(["bottom.0".to_owned(), "bottom.1".to_owned()]);
        for level in (0..self.depth).rev() {
            names.extend([format!("up.{level}.0"), format!("up.{level}.1")]);
        }
        names.push("head".to_owned());
        names
    }

    /// Number of weights and biases.
    pub fn parameters(&self) -> usize {
        self.convolutions().iter().map(|c| c.weights() + c.outputs).sum()
    }

    /// Multiplications and additions for an image of so many rows and columns.
    pub fn multiply_adds(&self, rows: usize, columns: usize) -> f64 {
        let [rows, columns] = self.padded([rows, columns]);
        let list = self.convolutions();
        let levels = (0..=self.depth).chain((0..self.depth).rev());
        let levels = levels.flat_map(|level| [level, level]).chain([0]);
        let cost = |(c, level): (&Convolution, usize)| {
            c.weights() as f64 * ((rows >> level) * (columns >> level)) as f64
        };
        list.iter().zip(levels).map(cost).sum()
    }

    /// Rows and columns with those added that halving needs.
    pub(crate) fn padded(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|n| n.next_multiple_of(1 << self.depth))
    }
}
