//! How the values are shown and what is written around them.

use crate::ColorMap;

/// What stands under each image.
#[derive(Clone, Debug, Default)]
pub enum FrameLabels {
    /// "frame 12", counting from 0 as the array does.
    #[default]
    Number,
    /// "frame 12 · 1.20 s", with the frame's time at this rate in hertz; frame 0 is at 0 s.
    Time {
        /// Frames per second of the data.
        rate_hz: f64,
    },
    /// One text per frame, such as the name of the method.
    Text(Vec<String>),
}

/// How the values are shown and what is written around them.
#[derive(Clone, Debug)]
pub struct PictureSettings {
    /// Headline; may be empty.
    pub title: String,
    /// Small print below: method, hyperparameter. What was left out or clipped is added to it.
    pub footnote: String,
    /// Symbol over the colour bar.
    pub quantity: String,
    /// Unit of the values without prefix; the bar adds one (µS).
    pub unit: String,
    /// Colours.
    pub map: ColorMap,
    /// Values at the two ends of the bar, made symmetric for a diverging map. Left out: all
    /// finite values fit, without percentiles.
    pub range: Option<[f64; 2]>,
    /// What stands under each image.
    pub labels: FrameLabels,
    /// Places that are marked in each frame, metres; empty, or one list for each frame.
    pub marks_m: Vec<Vec<[f64; 2]>>,
    /// Images to a row of a sheet (left out: near the shape of a page); in an animation, images
    /// side by side, which are taken in groups of so many.
    pub columns: Option<usize>,
    /// Bilinear between pixel centres, which also fills half a pixel of NaN at the rim of the
    /// skin and of holes in the data; false shows each pixel as the square it is.
    pub smooth: bool,
    /// Pixels to a point (1 to 4); an animation always has 1.
    pub zoom: usize,
}

impl Default for PictureSettings {
    /// Changes of conductivity in siemens on the diverging map.
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
            columns: None,
            smooth: true,
            zoom: 2,
        }
    }
}
