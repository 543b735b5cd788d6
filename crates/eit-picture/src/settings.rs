//! Settings for displaying values and for the surrounding text.

use crate::ColorMap;

/// The label under each image.
#[derive(Clone, Debug, Default)]
pub enum FrameLabels {
    /// "frame 12", counting from 0 like the array.
    #[default]
    Number,
    /// "frame 12 · 1.20 s", with the frame's time at this rate in hertz; frame 0 is at 0 s.
    Time {
        /// Frames per second of the data.
        rate_hz: f64,
    },
    /// One text per frame, for example the name of the method.
    Text(Vec<String>),
}

/// Settings for displaying values and for the surrounding text.
#[derive(Clone, Debug)]
pub struct PictureSettings {
    /// Title; may be empty.
    pub title: String,
    /// Footnote, for example method and hyperparameter. Notes on omitted frames and clipped values
    /// are appended.
    pub footnote: String,
    /// Symbol above the colour bar.
    pub quantity: String,
    /// Unit of the values without a prefix; the bar adds one (µS).
    pub unit: String,
    /// Colour map.
    pub map: ColorMap,
    /// Values at the two ends of the bar, made symmetric for a diverging map. `None`: the range of
    /// all finite values.
    pub range: Option<[f64; 2]>,
    /// Labels under the images.
    pub labels: FrameLabels,
    /// Positions to mark in each frame, metres; empty, or one list per frame.
    pub marks_m: Vec<Vec<[f64; 2]>>,
    /// Arrows over each frame, from and to, metres; empty, or one list per frame.
    pub arrows_m: Vec<Vec<[[f64; 2]; 2]>>,
    /// Images per row of a sheet (`None`: chosen for a page-like shape); in an animation, images
    /// per frame, shown side by side and taken in groups of this size.
    pub columns: Option<usize>,
    /// Whether to interpolate bilinearly between pixel centres, which also fills half a pixel of
    /// NaN at the rim of the skin and around holes in the data; otherwise each pixel is drawn as a
    /// square.
    pub smooth: bool,
    /// Pixels per point (1 to 4); an animation always has 1.
    pub zoom: usize,
}

impl Default for PictureSettings {
    /// Conductivity changes in siemens with the diverging map.
    fn default() -> Self {
        Self {
            title: String::new(),
            footnote: String::new(),
            quantity: "Δσ".to_owned(),
            unit: "S".to_owned(),
            map: ColorMap::CoolWarm,
            range: None,
            labels: FrameLabels::Number,
            marks_m: Vec::new(),
            arrows_m: Vec::new(),
            columns: None,
            smooth: true,
            zoom: 2,
        }
    }
}
