//! The one error type of this crate.

/// An error in images, weights, a learning base or training.
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
        /// Value that was rejected.
        value: f64,
    },
    /// The stack has no such frame.
    #[error("frame {frame} does not exist: the stack has {frames} frames, counted from 0")]
    UnknownFrame {
        /// Requested index.
        frame: usize,
        /// Number of frames.
        frames: usize,
    },
    /// A value outside its range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// Name of the setting, with its unit.
        quantity: &'static str,
        /// Value that was rejected.
        value: f64,
        /// Accepted range, in words.
        must: &'static str,
    },
    /// A list of the wrong length.
    #[error("{found} {what} where {wanted} are wanted")]
    WrongLength {
        /// Content of the list, in words.
        what: &'static str,
        /// Length of the list.
        found: usize,
        /// Required length.
        wanted: usize,
    },
    /// Every pixel of the image has the same non-zero value, which no touch produces.
    #[error("the image is {value} everywhere on the skin, which no touch gives")]
    ConstantImage {
        /// Value that was rejected.
        value: f64,
    },
    /// An error in one frame of a sequence.
    #[error("frame {frame}: {error}")]
    InFrame {
        /// Frame index.
        frame: usize,
        /// Error without its location.
        error: Box<DenoiseError>,
    },
    /// Two masks differ.
    #[error(
        "{differing} of {pixels} pixels lie inside one mask and outside the other: these are images \
         of another skin"
    )]
    MaskMismatch {
        /// Number of pixels that differ.
        differing: usize,
        /// Number of pixels of an image.
        pixels: usize,
    },
    /// A weight that is NaN or infinite.
    #[error("weight {index} is {value}: the training failed or the file is damaged")]
    NonFiniteWeight {
        /// Its index in file order.
        index: usize,
        /// Value that was rejected.
        value: f32,
    },
    /// Weights of another skin.
    #[error(
        "the weights are for skin {trained} at {} x {} pixels, these images are of skin {asked} at \
         {} x {}: train anew, or allow it",
        trained_pixels[0], trained_pixels[1], asked_pixels[0], asked_pixels[1]
    )]
    OtherSkin {
        /// Fingerprint of the skin that the weights were trained for.
        trained: String,
        /// Rows and columns of the training images.
        trained_pixels: [usize; 2],
        /// Fingerprint of the current skin.
        asked: String,
        /// Rows and columns of its images.
        asked_pixels: [usize; 2],
    },
    /// A file that is damaged or of another kind.
    #[error("damaged, or not a file of this program: {what}")]
    Format {
        /// Description of the problem.
        what: String,
    },
    /// Another error, with the file that caused it.
    #[error("{path}: {error}")]
    InFile {
        /// Path of the file.
        path: String,
        /// Error without its location.
        error: Box<DenoiseError>,
    },
    /// Reading or writing failed.
    #[error("{path}: {kind}")]
    Io {
        /// Path of the file.
        path: String,
        /// Kind of the error of the operating system.
        kind: std::io::ErrorKind,
    },
    /// A shard is missing or differs from its manifest.
    #[error("{path}: {found}: make the base again; complete shards are kept")]
    DamagedShard {
        /// Path of the file.
        path: String,
        /// Description of what was found instead.
        found: String,
    },
    /// All training images are zero.
    #[error("{what} holds zero images only: there is nothing to learn from")]
    NothingToLearn {
        /// A shard or a learning base.
        what: String,
    },
    /// A learning base or checkpoint was made with other settings.
    #[error(
        "{what} is {found} there, but {wanted} here: take another folder, or the same settings"
    )]
    OtherSettings {
        /// Name of the setting that differs.
        what: &'static str,
        /// Stored value.
        found: String,
        /// Requested value.
        wanted: String,
    },
    /// No training device has this name.
    #[error("no device is called \"{found}\": there are flex (the processor), cuda and wgpu")]
    UnknownDevice {
        /// Requested name.
        found: String,
    },
    /// The program was built without this device.
    #[error(
        "this program was built without the device {device}: build it with --features {device}, or \
         take flex, which is the processor"
    )]
    NotBuilt {
        /// Its name, which is that of its feature.
        device: &'static str,
    },
    /// The machine does not have this device.
    #[error(
        "no device for {device} on this machine: install its driver, or take flex, which is the \
         processor"
    )]
    NoDevice {
        /// Requested name.
        device: &'static str,
    },
    /// burn or its device failed.
    #[error("burn failed: {what}")]
    Burn {
        /// Message of burn.
        what: String,
    },
    /// A net returned images of another shape than its inputs.
    #[error(
        "the net made {found:?} of images [example, channel, row, column] {wanted:?}: it must keep \
         their rows and columns, and make one channel"
    )]
    NetShape {
        /// Returned shape.
        found: [usize; 4],
        /// Expected shape.
        wanted: [usize; 4],
    },
}

impl DenoiseError {
    pub(crate) fn check_length(
        what: &'static str,
        found: usize,
        wanted: usize,
    ) -> Result<(), Self> {
        if found == wanted { Ok(()) } else { Err(Self::WrongLength { what, found, wanted }) }
    }

    pub(crate) fn check_range(
        is_valid: bool,
        quantity: &'static str,
        value: f64,
        must: &'static str,
    ) -> Result<(), Self> {
        if is_valid { Ok(()) } else { Err(Self::OutOfRange { quantity, value, must }) }
    }

    /// Rejects images of another size than the mask.
    pub(crate) fn check_size(found: (usize, usize), mask: (usize, usize)) -> Result<(), Self> {
        if found == mask {
            return Ok(());
        }
        Err(Self::ShapeMismatch { images: found.into(), mask: mask.into() })
    }

    /// Rejects images of another skin.
    #[cfg(feature = "unet")]
    pub(crate) fn check_mask(
        found: ndarray::ArrayView2<'_, bool>,
        wanted: ndarray::ArrayView2<'_, bool>,
    ) -> Result<(), Self> {
        if found == wanted {
            return Ok(());
        }
        let pixels = wanted.len();
        let differing = match found.dim() == wanted.dim() {
            true => found.iter().zip(wanted).filter(|(a, b)| a != b).count(),
            false => pixels,
        };
        Err(Self::MaskMismatch { differing, pixels })
    }

    #[cfg(feature = "unet")]
    pub(crate) fn format(what: impl Into<String>) -> Self {
        Self::Format { what: what.into() }
    }

    /// The same error with its file.
    #[cfg(feature = "base")]
    pub(crate) fn in_file(self, path: &std::path::Path) -> Self {
        Self::InFile { path: path.display().to_string(), error: Box::new(self) }
    }

    /// An error of the operating system.
    #[cfg(feature = "base")]
    pub(crate) fn io(path: &std::path::Path, error: &std::io::Error) -> Self {
        Self::Io { path: path.display().to_string(), kind: error.kind() }
    }

    /// An error of burn.
    #[cfg(feature = "burn")]
    pub(crate) fn burn(error: &dyn std::fmt::Display) -> Self {
        Self::Burn { what: error.to_string() }
    }

    /// The same error with its frame.
    pub(crate) fn in_frame(self, frame: usize) -> Self {
        Self::InFrame { frame, error: Box::new(self) }
    }
}
