//! A page with the skin, its touches and images: a small HTTP server with the page, its server-sent events, and two
//! requests that start and stop a recording.

mod connection;
mod recorder;
mod request;
mod server;

pub use recorder::Recording;
pub use server::WebServer;

use crate::image::{SkinImage, robust_largest};
use eit_skin::ndarray::ArrayView2;
use serde::Serialize;

/// The page, which loads no other file: its parts are joined here.
const PAGE: &str = concat!(
    include_str!("web/head.html"),
    "<style>\n",
    include_str!("web/page.css"),
    "</style>\n",
    include_str!("web/page.html"),
    "<script>\n",
    include_str!("web/history.js"),
    include_str!("web/skin.js"),
    include_str!("web/charts.js"),
    include_str!("web/page.js"),
    "</script>\n</html>\n",
);

/// An image on the page.
#[derive(Serialize)]
#[serde(tag = "type", rename = "image")]
pub(crate) struct ImageEvent {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    /// Pixels of the image, packed.
    #[serde(flatten)]
    pub(crate) image: Pixels,
    /// The image before the net.
    pub(crate) raw: Option<Pixels>,
    pub(crate) faintest_s: f64,
    pub(crate) gap: Option<f64>,
}

/// Values as bytes.
#[derive(Serialize)]
pub(crate) struct Pixels {
    /// Conductivity changes that the bytes 1 and 255 represent, siemens; values beyond are clipped.
    pub(crate) range_s: f64,
    /// One byte per pixel in row-major order from the top: 0 outside the skin, else 1 to 255 with 128 for no change;
    /// base64.
    pub(crate) pixels: String,
}

impl ImageEvent {
    pub(crate) fn new(image: &SkinImage<'_>) -> Self {
        let (rows, columns) = image.change_s.dim();
        Self {
            rows,
            columns,
            image: Pixels::new(image.change_s),
            raw: image.before_net_s.map(Pixels::new),
            faintest_s: image.faintest_s,
            gap: image.gap,
        }
    }
}

impl Pixels {
    fn new(image: ArrayView2<'_, f64>) -> Self {
        use base64::Engine as _;
        let range_s = robust_largest(image).max(f64::MIN_POSITIVE);
        let byte = |&value: &f64| match value.is_finite() {
            true => (128.0 + (127.0 * value / range_s).clamp(-127.0, 127.0).round()) as u8,
            false => 0,
        };
        let bytes: Vec<u8> = image.iter().map(byte).collect();
        Self { range_s, pixels: base64::engine::general_purpose::STANDARD.encode(bytes) }
    }
}
