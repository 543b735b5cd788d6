//! A pixel canvas and its three drawing primitives: rectangles, strokes and text.

use std::io::Write;

use plotters::style::text_anchor::HPos;

use crate::{
    PictureError,
    text::{CAP_HEIGHT_EM, Font},
};

/// Red, green, blue (sRGB).
pub(crate) type Rgb = [u8; 3];
/// Colour of the page.
pub(crate) const WHITE: Rgb = [255; 3];
/// Colour of text and electrodes.
pub(crate) const INK: Rgb = [32; 3];
/// Colour of outlines and axes.
pub(crate) const LINE: Rgb = [96; 3];
/// Colour of the hatching where the skin has no value.
pub(crate) const PALE: Rgb = [196; 3];

/// A white page to draw on. Positions are in points from the top left, x to the right and y down.
#[derive(Clone, Debug)]
pub struct Canvas {
    size_px: [usize; 2],
    /// Row-major from the top.
    pixels: Vec<Rgb>,
    zoom: usize,
    font: Font,
}

impl Canvas {
    /// Creates an empty page of `width` by `height` points with `zoom` pixels per point.
    pub(crate) fn new(width: f64, height: f64, zoom: usize, font: Font) -> Self {
        let size_px = [width, height].map(|s| s.ceil().max(1.0) as usize * zoom);
        Self { size_px, pixels: vec![WHITE; size_px[0] * size_px[1]], zoom, font }
    }

    /// Width and height in pixels.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// Pixels in row-major order from the top, three bytes each.
    pub fn rgb(&self) -> &[u8] {
        self.pixels.as_flattened()
    }

    /// Pixels per point.
    pub(crate) fn zoom(&self) -> usize {
        self.zoom
    }

    /// The font of the page.
    pub(crate) fn font(&self) -> &Font {
        &self.font
    }

    /// Writes the page as PNG.
    ///
    /// # Errors
    /// [`PictureError::Png`] if writing to `out` fails.
    pub fn write_png(&self, out: impl Write) -> Result<(), PictureError> {
        let [width, height] = self.size_px.map(|size| size as u32);
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_filter(png::Filter::Adaptive);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.rgb())?;
        writer.finish()?;
        Ok(())
    }

    /// Blends `color` into a pixel with `opacity` from 0 to 1; does nothing outside the page.
    pub(crate) fn blend(&mut self, x: i64, y: i64, color: Rgb, opacity: f64) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        let [width, height] = self.size_px;
        if x >= width || y >= height {
            return;
        }
        if opacity == 1.0 {
            self.pixels[y * width + x] = color;
            return;
        }
        for (old, new) in self.pixels[y * width + x].iter_mut().zip(color) {
            let mixed = f64::from(*old) + opacity * (f64::from(new) - f64::from(*old));
            *old = mixed.round() as u8;
        }
    }

    /// Fills a rectangle whose borders are rounded to whole pixels.
    pub(crate) fn fill_rect(&mut self, [left, top]: [f64; 2], size: [f64; 2], color: Rgb) {
        let px = |at: f64| (at * self.zoom as f64).round() as i64;
        let (columns, rows) = (px(left)..px(left + size[0]), px(top)..px(top + size[1]));
        for y in rows {
            columns.clone().for_each(|x| self.blend(x, y, color, 1.0));
        }
    }

    /// Draws a polyline with round ends and joints, anti-aliased. A single point is a dot.
    pub(crate) fn stroke(&mut self, points: &[[f64; 2]], width: f64, color: Rgb, opacity: f64) {
        let zoom = self.zoom as f64;
        let points: Vec<_> = points.iter().map(|p| [p[0] * zoom, p[1] * zoom]).collect();
        self.stroke_px(&points, width * zoom, color, opacity);
    }

    /// Does the same as [`Self::stroke`] in pixels.
    ///
    /// Each pixel takes the coverage of the nearest segment, so joints are not darker.
    pub(crate) fn stroke_px(&mut self, points: &[[f64; 2]], width: f64, color: Rgb, opacity: f64) {
        let finite = points.iter().flatten().all(|v| v.is_finite());
        let Some(last) = points.last().copied().filter(|_| finite) else { return };
        let reach = width / 2.0 + 1.0;
        let pixels = |axis: usize, size: usize| {
            let low = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - reach;
            let high = points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) + reach;
            (low.max(0.0) as usize).min(size)..(high.max(0.0).ceil() as usize).min(size)
        };
        let (columns, rows) = (pixels(0, self.size_px()[0]), pixels(1, self.size_px()[1]));
        let mut coverage = vec![0.0_f64; columns.len() * rows.len()];
        let ends = points.iter().skip(1).copied().chain([last]);
        for (start, end) in points.iter().copied().zip(ends) {
            let part = |axis: usize, within: &std::ops::Range<usize>| {
                let low = (start[axis].min(end[axis]) - reach).max(within.start as f64) as usize;
                let high = (start[axis].max(end[axis]) + reach).ceil().max(0.0) as usize;
                low..high.min(within.end)
            };
            for y in part(1, &rows) {
                for x in part(0, &columns) {
                    let centre = [x as f64 + 0.5, y as f64 + 0.5];
                    let inside = width / 2.0 + 0.5 - distance(centre, start, end);
                    let at = (y - rows.start) * columns.len() + (x - columns.start);
                    coverage[at] = coverage[at].max(inside.clamp(0.0, width.min(1.0)));
                }
            }
        }
        for (at, &covered) in coverage.iter().enumerate().filter(|(_, covered)| **covered > 0.0) {
            let (x, y) = (columns.start + at % columns.len(), rows.start + at / columns.len());
            self.blend(x as i64, y as i64, color, covered * opacity);
        }
    }

    /// Writes one line; `y` is the middle of the capitals. Letters stand on whole pixels.
    pub(crate) fn text(&mut self, text: &str, em: f64, at: [f64; 2], align: HPos, color: Rgb) {
        let (zoom, font) = (self.zoom as f64, self.font.clone());
        let em = em * zoom;
        let x = (at[0] * zoom + font.left_of(text, em, align)).round();
        let baseline = (at[1] * zoom + CAP_HEIGHT_EM * em / 2.0).round();
        font.raster(text, em, [x, baseline], |x, y, covered| self.blend(x, y, color, covered));
    }
}

/// The middle of a pixel near a coordinate, on which a line one point wide is sharp.
pub(crate) fn crisp(at: f64) -> f64 {
    at.floor() + 0.5
}

/// A closed rectangle of sharp lines.
pub(crate) fn crisp_frame([left, top]: [f64; 2], [width, height]: [f64; 2]) -> [[f64; 2]; 5] {
    let ([left, right], [top, bottom]) =
        ([left, left + width].map(crisp), [top, top + height].map(crisp));
    [[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]
}

/// Distance of a point from a segment.
fn distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length_squared = along[0].powi(2) + along[1].powi(2);
    let t = (to[0] * along[0] + to[1] * along[1]) / length_squared.max(f64::MIN_POSITIVE);
    let t = t.clamp(0.0, 1.0);
    (to[0] - t * along[0]).hypot(to[1] - t * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> Canvas {
        Canvas::new(40.0, 30.0, 1, Font::load().unwrap())
    }

    /// Ink on the page, in fully covered black pixels.
    fn ink(canvas: &Canvas) -> f64 {
        canvas.rgb().iter().step_by(3).map(|&red| 1.0 - f64::from(red) / 255.0).sum()
    }

    #[test]
    fn a_stroke_covers_its_area() {
        let mut canvas = page();
        canvas.stroke(&[[5.0, 15.3], [20.0, 15.3], [35.0, 15.3]], 3.0, [0; 3], 1.0);
        // length times width plus the two round ends; 2 % for the sampled edge and 8-bit colour
        let area = 30.0 * 3.0 + std::f64::consts::PI * 1.5 * 1.5;
        assert!((ink(&canvas) / area - 1.0).abs() < 0.02, "{} {area}", ink(&canvas));
    }

    #[test]
    fn marks_off_the_page_or_without_place_change_nothing() {
        let mut canvas = page();
        canvas.stroke(&[[f64::NAN, 3.0], [9.0, 9.0]], 2.0, [0; 3], 1.0);
        canvas.stroke(&[[-1e300, -1e300], [-1e9, -5.0]], 2.0, [0; 3], 1.0);
        canvas.stroke(&[[1e12, 5.0], [1e15, 9.0]], 2.0, [0; 3], 1.0);
        canvas.stroke(&[], 2.0, [0; 3], 1.0);
        canvas.text("off", 10.0, [-500.0, 1e9], HPos::Center, [0; 3]);
        canvas.fill_rect([50.0, 50.0], [5.0, 5.0], [0; 3]);
        assert_eq!(canvas.rgb(), page().rgb());
    }
}
