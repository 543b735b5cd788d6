//! The one error type of this crate.

/// What can be wrong with images, weights, a learning base or a training.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// Images and mask have different sizes.
    #[error(
        "the images have {} rows and {} columns, but the mask has {} and {}: draw both on one raster",
        images[0], images[1], mask[0], mask[1]
    )]
    ShapeMismatch {
        /// Rows and columns of each image.
        images: [usize; 2],
        /// Rows and columns of the mask.
        mask: [usize; 2],
    },
    /// No pixel lies inside the mask.
    #[error(
        "the mask of {rows} rows and {columns} columns has no pixel inside the skin: use more pixels"
    )]
    EmptyMask {
        /// Rows of the mask.
        rows: usize,
        /// Columns of the mask.
        columns: usize,
    },
    /// A pixel inside the mask is NaN or infinite.
    #[error(
        "frame {frame} holds {value} at row {row}, column {column}, inside the skin: leave the frame \
         out or mend the reconstruction"
    )]
    NonFinitePixel {
        /// Frame index.
        frame: usize,
        /// Row index, 0 at the top.
        row: usize,
        /// Column index.
        column: usize,
        /// The value.
        value: f64,
    },
    /// A frame that is not in the stack.
    #[error("frame {frame} was asked for, but the stack has {frames}, counted from 0")]
    UnknownFrame {
        /// Index asked for.
        frame: usize,
        /// Frames there are.
        frames: usize,
    },
    /// A setting outside what it may be.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The setting.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A list of the wrong length.
    #[error("{found} {what} where {wanted} are wanted")]
    WrongLength {
        /// What the list holds.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The right length.
        wanted: usize,
    },
    /// One value other than zero all over the skin: no touch, and nothing to denoise.
    #[error("the image is {value} all over the skin: a reconstruction does not look like this")]
    ConstantImage {
        /// The value.
        value: f64,
    },
    /// Something is wrong in one frame of a sequence.
    #[error("frame {frame}: {error}")]
    InFrame {
        /// Frame index.
        frame: usize,
        /// What is wrong.
        error: Box<DenoiseError>,
    },
    /// Images on other pixels than those prepared for.
    #[error(
        "{differing} of {pixels} pixels lie inside one mask and outside the other: these are images \
         of another skin"
    )]
    MaskMismatch {
        /// Pixels that differ.
        differing: usize,
        /// Pixels of an image.
        pixels: usize,
    },
    /// A weight that is NaN or infinite.
    #[error("weight {index} is {value}: the training failed or the file is damaged")]
    NonFiniteWeight {
        /// Its index in file order.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// Weights of another skin.
    #[error(
        "the weights are for skin {trained} at {} x {} pixels, these images are of skin {asked} at \
         {} x {}: train anew, or allow it",
        trained_pixels[0], trained_pixels[1], asked_pixels[0], asked_pixels[1]
    )]
    OtherSkin {
        /// Fingerprint of the skin of the training.
        trained: String,
        /// Rows and columns there.
        trained_pixels: [usize; 2],
        /// Fingerprint of the skin asked for.
        asked: String,
        /// Rows and columns here.
        asked_pixels: [usize; 2],
    },
    /// A file that is damaged or of another kind.
    #[error("damaged, or not a file of this program: {what}")]
    Format {
        /// What was found.
        what: String,
    },
    /// Something is wrong with a file.
    #[error("{path}: {error}")]
    InFile {
        /// The file.
        path: String,
        /// What is wrong.
        error: Box<DenoiseError>,
    },
    /// The system refused to read or write.
    #[error("{path}: {kind}")]
    Io {
        /// The file.
        path: String,
        /// Why.
        kind: std::io::ErrorKind,
    },
    /// A shard that is not there or not what the manifest says.
    #[error("{path}: {found}: make the base again, whole shards are kept")]
    DamagedShard {
        /// The file.
        path: String,
        /// What was found.
        found: String,
    },
    /// Training pairs without a touch.
    #[error("{what} holds no image that differs from zero: nothing can be learnt from it")]
    NothingToLearn {
        /// A shard or a learning base.
        what: String,
    },
    /// A learning base or checkpoint that was made with other settings.
    #[error(
        "{what} is {found} there, but {wanted} here: take another folder, or the same settings"
    )]
    OtherSettings {
        /// What differs.
        what: &'static str,
        /// As stored.
        found: String,
        /// As asked for.
        wanted: String,
    },
    /// No device of training has this name.
    #[error("no device is called \"{found}\": there are flex (the processor), cuda and wgpu")]
    UnknownDevice {
        /// What was asked for.
        found: String,
    },
    /// A device that this program was built without.
    #[error(
        "this program was built without the device {device}: build it with --features {device}, or \
         take flex, which is the processor"
    )]
    NotBuilt {
        /// Its name, which is that of its feature.
        device: &'static str,
    },
    /// A device that this machine does not have.
    #[error(
        "no device for {device} on this machine: install its driver, or take flex, which is the \
         processor"
    )]
    NoDevice {
        /// The name that was asked for.
        device: &'static str,
    },
    /// burn refused, or a device broke off.
    #[error("burn failed: {what}")]
    Burn {
        /// What it says.
        what: String,
    },
    /// A net whose images have another shape than those it was given.
    #[error(
        "the net made {found:?} of images [example, channel, row, column] {wanted:?}: it must keep \
         their rows and columns, and make one channel"
    )]
    NetShape {
        /// What came out.
        found: [usize; 4],
        /// What should have.
        wanted: [usize; 4],
    },
}

impl DenoiseError {
    /// The same error with its file.
    #[cfg(feature = "base")]
    pub(crate) fn in_file(self, path: &std::path::Path) -> Self {
        Self::InFile { path: path.display().to_string(), error: Box::new(self) }
    }

    /// A refusal of the system.
    #[cfg(feature = "base")]
    pub(crate) fn io(path: &std::path::Path, error: &std::io::Error) -> Self {
        Self::Io { path: path.display().to_string(), kind: error.kind() }
    }

    /// What burn says.
    #[cfg(feature = "burn")]
    pub(crate) fn burn(error: &dyn std::fmt::Display) -> Self {
        Self::Burn { what: error.to_string() }
    }

    /// The same error with its frame.
    pub(crate) fn in_frame(self, frame: usize) -> Self {
        Self::InFrame { frame, error: Box::new(self) }
    }
}
