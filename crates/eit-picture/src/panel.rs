//! One image of the skin: values, outline, electrodes and their numbers. One file because all
//! layers share the same scale from metres to pixels.

use ndarray::ArrayView2;
use plotters::style::text_anchor::HPos;

use crate::{
    Extent, PictureError, PointOf, SkinDrawing,
    canvas::{Canvas, INK, LINE, PALE, WHITE},
    numbers::{NUMBER_EM, NUMBER_GAP, NUMBER_HEIGHT, Number, crossings, place_numbers, trimmed},
    scale::Scale,
    text::Font,
};

/// Half the length of a marker's strokes, in points.
const MARK_ARM: f64 = 5.0;
/// Arrows of this length and shorter ones are left out, in points.
const LEAST_ARROW: f64 = 2.0;
/// Length of an arrow's head, in points.
const HEAD: f64 = 6.0;
/// Width of an electrode's arc, in points.
const ELECTRODE_WIDTH: f64 = 4.0;
/// Minimum side of the drawn skin, in points, however narrow the skin.
const LEAST_SIDE: f64 = 2.0;

/// A skin laid out on a rectangle of the page whose corner is the origin.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    /// Size including the electrode numbers, in points.
    pub(crate) size: [f64; 2],
    outlines: Vec<Vec<[f64; 2]>>,
    electrodes: Vec<Vec<[f64; 2]>>,
    numbers: Vec<Number>,
    extent: Extent,
    view: View,
    /// Pixels of the page inside the skin, in row-major order.
    inside: Vec<bool>,
    pixels: [usize; 2],
}

/// Metres to points: `(x - x_m) scale + margin`, with y flipped.
#[derive(Clone, Copy, Debug)]
struct View {
    scale: f64,
    left_m: f64,
    top_m: f64,
    margin: f64,
}

impl View {
    fn to_page(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.margin + (x - self.left_m) * self.scale, self.margin + (self.top_m - y) * self.scale]
    }

    fn to_metres(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.left_m + (x - self.margin) / self.scale, self.top_m - (y - self.margin) / self.scale]
    }
}

/// Pixels of an image along one axis of which a position of the panel takes its value, with weights.
struct Sample {
    own: usize,
    weights: [(usize, f64); 2],
}

impl Sample {
    /// The sample at a position in pixels of an image that has `count` of them.
    fn new(at: f64, count: usize, smooth: bool) -> Option<Self> {
        // allow half a pixel, because the outline may lie just outside the raster
        if !(-0.5..=count as f64 + 0.5).contains(&at) {
            return None;
        }
        let own = (at.max(0.0) as usize).min(count - 1);
        if !smooth {
            return Some(Self { own, weights: [(own, 1.0), (own, 0.0)] });
        }
        let at = (at - 0.5).clamp(0.0, (count - 1) as f64);
        let below = at as usize;
        let share = at - below as f64;
        let weights = [(below, 1.0 - share), ((below + 1).min(count - 1), share)];
        Some(Self { own, weights })
    }
}

impl Panel {
    /// Fits the skin, including electrode numbers, into a square of `side` points.
    ///
    /// # Errors
    /// Coordinates that are not finite; a raster without area.
    pub(crate) fn new(
        skin: &SkinDrawing,
        side: f64,
        zoom: usize,
        font: &Font,
    ) -> Result<Self, PictureError> {
        let bounds = bounds_m(skin)?;
        let shown = || skin.electrodes.iter().filter(|e| e.drawn);
        let widest = shown().map(|e| font.width(&e.number.to_string(), NUMBER_EM));
        let margin = widest.fold(0.0, f64::max).max(NUMBER_EM * NUMBER_HEIGHT) + NUMBER_GAP + 3.0;
        let spans = [bounds.x_max_m - bounds.x_min_m, bounds.y_max_m - bounds.y_min_m];
        let scale = (side - 2.0 * margin).max(LEAST_SIDE) / spans[0].max(spans[1]);
        let size = spans.map(|span| (span * scale).max(LEAST_SIDE) + 2.0 * margin).map(f64::ceil);
        let view = View { scale, left_m: bounds.x_min_m, top_m: bounds.y_max_m, margin };

        let on_page = |curve: &[[f64; 2]]| -> Vec<_> {
            curve.iter().map(|point| view.to_page(*point)).collect()
        };
        let close = |mut curve: Vec<[f64; 2]>| {
            curve.extend(curve.first().copied());
            curve
        };
        let outlines: Vec<_> = skin.outlines_m.iter().map(|o| close(on_page(o))).collect();
        // the round ends of the stroke reach beyond its points, but the electrode must not
        let electrodes: Vec<_> =
            shown().map(|e| trimmed(on_page(&e.rim_m), ELECTRODE_WIDTH / 2.0)).collect();
        let numbers = place_numbers(shown(), &electrodes, &outlines, size, font);
        let pixels = size.map(|length| length as usize * zoom);
        let inside = inside(&outlines, pixels, zoom as f64);
        Ok(Self { size, outlines, electrodes, numbers, extent: skin.extent, view, inside, pixels })
    }

    /// Converts a point of the skin to a position on the panel at the origin.
    pub(crate) fn to_page(&self, point_m: [f64; 2]) -> [f64; 2] {
        self.view.to_page(point_m)
    }

    /// Draws the values [row, column]; hatched where the skin has none (NaN).
    ///
    /// `corner` is the position of the panel on the page, in whole points; `smooth` as in
    /// [`crate::PictureSettings`].
    pub(crate) fn draw_image(
        &self,
        canvas: &mut Canvas,
        corner: [f64; 2],
        image: ArrayView2<'_, f64>,
        scale: &Scale,
        smooth: bool,
    ) {
        let zoom = canvas.zoom();
        let first = corner.map(|at| at as usize * zoom);
        let [across, down] = self.samples(image.dim(), zoom, smooth);
        for (row, down) in down.iter().enumerate() {
            for (column, across) in across.iter().enumerate() {
                if !self.inside[row * self.pixels[0] + column] {
                    continue;
                }
                let samples = down.as_ref().zip(across.as_ref());
                let value =
                    samples.and_then(|(down, across)| self.value_at([down, across], image, scale));
                let color = match value {
                    Some(value) => scale.color(value),
                    None if self.outlines.is_empty() => continue,
                    None if ((row + column) / zoom).is_multiple_of(5) => PALE,
                    None => WHITE,
                };
                canvas.blend((first[0] + column) as i64, (first[1] + row) as i64, color, 1.0);
            }
        }
    }

    /// Samples of an image [row, column] for each column and each row of the panel's pixels; none beyond the image.
    fn samples(
        &self,
        (rows, columns): (usize, usize),
        zoom: usize,
        smooth: bool,
    ) -> [Vec<Option<Sample>>; 2] {
        let Extent { x_min_m, x_max_m, y_min_m, y_max_m } = self.extent;
        let middle_m = |k: usize| self.view.to_metres([(k as f64 + 0.5) / zoom as f64; 2]);
        let across = |k| (middle_m(k)[0] - x_min_m) / (x_max_m - x_min_m) * columns as f64;
        let down = |k| (y_max_m - middle_m(k)[1]) / (y_max_m - y_min_m) * rows as f64;
        [
            (0..self.pixels[0]).map(|k| Sample::new(across(k), columns, smooth)).collect(),
            (0..self.pixels[1]).map(|k| Sample::new(down(k), rows, smooth)).collect(),
        ]
    }

    /// Value at a row and a column: bilinear between the finite pixel centres around it, or that of the pixel itself.
    fn value_at(
        &self,
        [down, across]: [&Sample; 2],
        image: ArrayView2<'_, f64>,
        scale: &Scale,
    ) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        for (row, row_weight) in down.weights {
            for (column, column_weight) in across.weights {
                let (value, weight) = (image[[row, column]], row_weight * column_weight);
                if !value.is_nan() && weight > 0.0 {
                    sum += weight * scale.bounded(value);
                    total += weight;
                }
            }
        }
        // without an outline, the NaN of the pixel itself marks the border
        let blank = self.outlines.is_empty() && image[[down.own, across.own]].is_nan();
        (total > 0.0 && !blank).then(|| sum / total)
    }

    /// Draws outline, electrodes and numbers, with the panel's corner at `corner`.
    pub(crate) fn draw_skin(&self, canvas: &mut Canvas, corner: [f64; 2]) {
        let place = |curve: &[[f64; 2]]| -> Vec<[f64; 2]> {
            curve.iter().map(|p| [corner[0] + p[0], corner[1] + p[1]]).collect()
        };
        for outline in &self.outlines {
            canvas.stroke(&place(outline), 1.2, LINE, 1.0);
        }
        for electrode in &self.electrodes {
            canvas.stroke(&place(electrode), ELECTRODE_WIDTH, INK, 1.0);
        }
        for Number { number, middle, width, on_skin } in &self.numbers {
            let [x, y] = [corner[0] + middle[0], corner[1] + middle[1]];
            if *on_skin {
                let label = [[x - width / 2.0, y], [x + width / 2.0, y]];
                canvas.stroke(&label, NUMBER_EM * NUMBER_HEIGHT + 3.0, WHITE, 0.8);
            }
            canvas.text(&number.to_string(), NUMBER_EM, [x, y], HPos::Center, INK);
        }
    }

    /// Draws a small cross at each position on the panel, dark on a light ground.
    pub(crate) fn draw_marks(&self, canvas: &mut Canvas, corner: [f64; 2], marks_m: &[[f64; 2]]) {
        let on_panel = |p: &[f64; 2]| (0..2).all(|i| (0.0..=self.size[i]).contains(&p[i]));
        for [x, y] in marks_m.iter().map(|mark| self.to_page(*mark)).filter(on_panel) {
            let [x, y] = [corner[0] + x, corner[1] + y];
            for (width, colour) in [(3.0, WHITE), (1.2, INK)] {
                canvas.stroke(&[[x - MARK_ARM, y], [x + MARK_ARM, y]], width, colour, 1.0);
                canvas.stroke(&[[x, y - MARK_ARM], [x, y + MARK_ARM]], width, colour, 1.0);
            }
        }
    }

    /// Draws arrows on the panel, dark on a light ground.
    pub(crate) fn draw_arrows(
        &self,
        canvas: &mut Canvas,
        corner: [f64; 2],
        arrows_m: &[[[f64; 2]; 2]],
    ) {
        for arrow in arrows_m {
            let [from, to] = arrow.map(|point| {
                let [x, y] = self.to_page(point);
                [corner[0] + x, corner[1] + y]
            });
            let way = [to[0] - from[0], to[1] - from[1]];
            let length = way[0].hypot(way[1]);
            // also false for coordinates that are not finite
            if !(length > LEAST_ARROW && length < self.size[0].hypot(self.size[1])) {
                continue;
            }
            let head = HEAD.min(length / 2.0) / length;
            let side = |turn: f64| {
                [
                    to[0] - head * (way[0] - turn * way[1] / 2.0),
                    to[1] - head * (way[1] + turn * way[0] / 2.0),
                ]
            };
            for (width, colour) in [(3.4, WHITE), (1.6, INK)] {
                canvas.stroke(&[from, to], width, colour, 1.0);
                canvas.stroke(&[side(1.0), to, side(-1.0)], width, colour, 1.0);
            }
        }
    }
}

/// Bounding box of everything drawn; a skin without curves is as large as its raster.
fn bounds_m(skin: &SkinDrawing) -> Result<Extent, PictureError> {
    let Extent { x_min_m, x_max_m, y_min_m, y_max_m } = skin.extent;
    let spans = [x_max_m - x_min_m, y_max_m - y_min_m];
    if !spans.iter().all(|span| span.is_finite() && *span > 0.0) {
        return Err(PictureError::Extent(skin.extent));
    }
    let outlines =
        skin.outlines_m.iter().enumerate().map(|(i, curve)| (PointOf::Outline, i, curve));
    let electrodes =
        skin.electrodes.iter().enumerate().map(|(i, e)| (PointOf::Electrode, i, &e.rim_m));
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for (what, index, curve) in outlines.chain(electrodes) {
        for &[x_m, y_m] in curve {
            // 1e150, so that spans and their squares stay finite
            if !(x_m.abs() < 1e150 && y_m.abs() < 1e150) {
                return Err(PictureError::Coordinates { what, index, x_m, y_m });
            }
            low = [low[0].min(x_m), low[1].min(y_m)];
            high = [high[0].max(x_m), high[1].max(y_m)];
        }
    }
    if low[0].max(low[1]) == f64::INFINITY || (low == high) {
        return Ok(skin.extent);
    }
    Ok(Extent { x_min_m: low[0], x_max_m: high[0], y_min_m: low[1], y_max_m: high[1] })
}

/// Marks the pixels whose centres are inside the curves (even-odd rule); all of them if there are
/// no curves.
fn inside(outlines: &[Vec<[f64; 2]>], [columns, rows]: [usize; 2], zoom: f64) -> Vec<bool> {
    let mut inside = vec![outlines.is_empty(); columns * rows];
    for (row, line) in inside.chunks_exact_mut(columns.max(1)).enumerate() {
        let mut crossings = crossings(outlines, (row as f64 + 0.5) / zoom);
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            // first and one past the last centre between the two crossings
            let [from, to] = [pair[0], pair[1]].map(|x| (x * zoom - 0.5).ceil().max(0.0) as usize);
            line[from.min(columns)..to.min(columns).max(from.min(columns))].fill(true);
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ElectrodeDrawing;
    use crate::fixtures_for_tests::{disc, inner_box};

    #[test]
    fn numbers_stand_outside_a_disc_and_inside_its_panel() {
        for electrodes in [1, 4, 16, 48, 256] {
            let panel = Panel::new(&disc(electrodes), 200.0, 1, &Font::load().unwrap()).unwrap();
            let middle = panel.to_page([0.0; 2]);
            let radius = panel.to_page([0.1, 0.0])[0] - middle[0];
            for number in &panel.numbers {
                let [x, y] = number.middle;
                let half = [number.width / 2.0, NUMBER_EM * NUMBER_HEIGHT / 2.0];
                assert!((x - middle[0]).hypot(y - middle[1]) > radius + half[1], "{number:?}");
                assert!(x > half[0] && x + half[0] < panel.size[0], "{number:?}");
                assert!(y > half[1] && y + half[1] < panel.size[1], "{number:?}");
                assert!(!number.on_skin);
            }
            assert_eq!(panel.numbers[0].number, 1);
            for (k, number) in panel.numbers.iter().enumerate() {
                assert!(panel.numbers[..k].iter().all(|other| !number.overlaps(other)));
            }
        }
    }

    #[test]
    fn electrodes_inside_the_skin_are_numbered_on_it_or_in_its_hole() {
        let mut skin = disc(0);
        skin.electrodes.push(inner_box(1, [0.05, 0.0], 0.005));
        skin.outlines_m.push(inner_box(0, [-0.05, 0.0], 0.02).rim_m);
        let in_hole = vec![[-0.06, 0.02], [-0.04, 0.02]];
        skin.electrodes.push(ElectrodeDrawing { number: 2, rim_m: in_hole, drawn: true });
        skin.electrodes.push(ElectrodeDrawing { drawn: false, ..inner_box(3, [0.0; 2], 0.01) });
        let panel = Panel::new(&skin, 300.0, 1, &Font::load().unwrap()).unwrap();
        let [patch, hole] = &panel.numbers[..] else { panic!("{:?}", panel.numbers) };
        assert!(patch.on_skin && !hole.on_skin);
        assert!(hole.middle[1] > panel.to_page([-0.05, 0.02])[1], "below the hole's upper rim");
        let [low, high] = [[0.045, -0.005], [0.055, 0.005]].map(|p| panel.to_page(p));
        let [x, y] = patch.middle;
        assert!(x < low[0] || x > high[0] || y > low[1] || y < high[1], "outside its own patch");
    }

    #[test]
    fn the_mask_is_as_large_as_the_skin() {
        let zoom = 2;
        let panel = Panel::new(&disc(16), 200.0, zoom, &Font::load().unwrap()).unwrap();
        let radius_px = panel.view.scale * 0.1 * zoom as f64;
        let area_px = panel.inside.iter().filter(|inside| **inside).count() as f64;
        // each of the 1000 rim pixels is off by half a pixel at random: 0.1 % is ten sigma
        assert!((area_px / (std::f64::consts::PI * radius_px.powi(2)) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn trimming_takes_the_length_it_says() {
        let curve = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 10.0], [4.0, 10.0]];
        assert_eq!(trimmed(curve.clone(), 2.0), [[1.0, 1.0], [1.0, 10.0], [2.0, 10.0]]);
        // a quarter of the length of 14 is removed at either end, and half remains
        assert_eq!(trimmed(curve, 99.0), [[1.0, 2.5], [1.0, 9.5]]);
        assert_eq!(trimmed(vec![[1.0, 1.0]; 3], 2.0), vec![[1.0, 1.0]; 3]);
        assert!(trimmed(Vec::new(), 2.0).is_empty());
    }

    #[test]
    fn curves_without_place_are_refused() {
        let mut skin = disc(4);
        skin.electrodes[2].rim_m[1][0] = f64::NAN;
        let error = Panel::new(&skin, 200.0, 1, &Font::load().unwrap()).unwrap_err();
        assert!(error.to_string().starts_with("electrode 2 has the coordinates (NaN,"), "{error}");
        let mut skin = disc(4);
        skin.extent.x_max_m = skin.extent.x_min_m;
        let error = Panel::new(&skin, 200.0, 1, &Font::load().unwrap()).unwrap_err();
        assert!(matches!(error, PictureError::Extent(_)));
    }
}
