//! A page with the skin, its touches and images: a small HTTP server with two paths, the page and its server-sent
//! events.

mod connection;
mod request;
mod server;

pub use server::WebServer;

use eit_skin::ndarray::ArrayView2;
use serde::Serialize;

/// The page, which loads no other file.
const PAGE: &str = include_str!("web/page.html");

/// An image on the page.
#[derive(Serialize)]
#[serde(tag = "type", rename = "image")]
pub(crate) struct ImageEvent {
    pub rows: usize,
    pub columns: usize,
    /// Conductivity change at the ends of the colour scale, siemens.
    pub range_s: f64,
    /// One byte per pixel in row-major order from the top: 0 outside the skin, else 1 to 255 with 128 for no change;
    /// base64.
    pub pixels: String,
}

impl ImageEvent {
    pub fn new(image: ArrayView2<'_, f64>) -> Self {
        use base64::Engine as _;
        let finite = image.iter().filter(|value| value.is_finite());
        let range_s = finite.fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
        let byte = |&value: &f64| match value.is_finite() {
            true => (128.0 + (127.0 * value / range_s).round()) as u8,
            false => 0,
        };
        let bytes: Vec<u8> = image.iter().map(byte).collect();
        let (rows, columns) = image.dim();
        let pixels = base64::engine::general_purpose::STANDARD.encode(bytes);
        Self { rows, columns, range_s, pixels }
    }
}
