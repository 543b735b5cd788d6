//! Draws curves over an axis: L-curves, convergence, error against run time. One file because
//! layout, axes and curves share one coordinate system.

use std::{cell::RefCell, convert::Infallible, rc::Rc};

use plotters::{
    chart::ChartBuilder,
    coord::Shift,
    drawing::{DrawingArea, DrawingAreaErrorKind},
    element::{Circle, PathElement},
    style::{
        FontDesc, FontFamily, FontStyle, RGBColor, ShapeStyle, TextStyle,
        text_anchor::{HPos, Pos, VPos},
    },
};
use plotters_backend::BackendColor;

use crate::{
    PictureError,
    axis::Axis,
    backend::Backend,
    canvas::{Canvas, INK, LINE, Rgb, WHITE},
    page::{LABEL_EM, MARGIN, NOTE_EM, TITLE_EM, block_height, write_block},
    scale::{LARGEST, SMALLEST},
    text::Font,
};

/// Size of the area between the axes, in points.
pub(crate) const AREA: [f64; 2] = [400.0, 270.0];
/// Height of a label line, of which two are below the axis, and length of a tick, in points.
const LINE_HEIGHT: f64 = 18.0;
const TICK: f64 = 3.0;
/// Colours of grid lines at the labels and between them.
const GRID: Rgb = [212; 3];
const FAINT: Rgb = [235; 3];
/// Colours that colour-blind readers can distinguish (M. Okabe, K. Ito, "Color Universal Design",
/// 2008), without the yellow, which is too pale for lines on paper.
pub(crate) const COLORS: [Rgb; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [0, 0, 0],
];

/// One curve.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name in the legend; empty to omit it.
    pub name: String,
    /// Points (x, y) in the order in which the line connects them; a point that is not finite, or
    /// not positive on a logarithmic axis, interrupts the line.
    pub points: Vec<[f64; 2]>,
    /// Whether to connect the points.
    pub line: bool,
    /// Whether to mark each point.
    pub markers: bool,
}

/// Curves with their axes.
///
/// ```
/// use eit_picture::{Plot, Series, draw_plot};
///
/// let points = (1..=100).map(|k| [f64::from(k), 1.0 / f64::from(k)]).collect();
/// let plot = Plot {
///     title: "Error over time".to_owned(),
///     footnote: String::new(),
///     x_label: "time, s".to_owned(),
///     y_label: "error".to_owned(),
///     x_log: true,
///     y_log: true,
///     series: vec![Series { name: "solver".to_owned(), points, line: true, markers: false }],
///     zoom: 1,
/// };
/// let canvas = draw_plot(&plot)?;
/// assert!(canvas.size_px()[0] > 100);
/// # Ok::<(), eit_picture::PictureError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Plot {
    /// Title; may be empty.
    pub title: String,
    /// Footnote; may be empty.
    pub footnote: String,
    /// Quantity and unit along x.
    pub x_label: String,
    /// Quantity and unit along y.
    pub y_label: String,
    /// Logarithmic x axis.
    pub x_log: bool,
    /// Logarithmic y axis.
    pub y_log: bool,
    /// The curves.
    pub series: Vec<Series>,
    /// Pixels per point (1 to 4).
    pub zoom: usize,
}

/// Draws curves with a legend on the right.
///
/// # Errors
/// [`PictureError::NoPoints`] if no point can be shown.
pub fn draw_plot(plot: &Plot) -> Result<Canvas, PictureError> {
    let points = || plot.series.iter().flat_map(|s| &s.points).filter(|p| plot.shows(p));
    if points().next().is_none() {
        return Err(PictureError::NoPoints { series: plot.series.len() });
    }
    let font = Font::load()?;
    let x_axis = Axis::new(points().map(|p| p[0]), plot.x_log, &plot.x_label);
    let y_axis = Axis::new(points().map(|p| p[1]), plot.y_log, &plot.y_label);
    let layout = Layout::new(plot, &y_axis, &font);
    let mut canvas = Canvas::new(layout.size[0], layout.size[1], plot.zoom.clamp(1, 4), font);
    write_block(&mut canvas, &layout.title, TITLE_EM, MARGIN);
    write_block(&mut canvas, &layout.note, NOTE_EM, layout.note_top);
    let pen = Pen { zoom: canvas.zoom() as f64 };
    let page = Rc::new(RefCell::new(Backend(canvas)));
    pen.draw(plot, &layout, &DrawingArea::from(&page), [x_axis, y_axis])
        .map_err(|error| PictureError::Plot { message: error.to_string() })?;
    let canvas = page.borrow().0.clone();
    Ok(canvas)
}

impl Plot {
    /// Whether the axes can show a point.
    fn shows(&self, point: &[f64; 2]) -> bool {
        let logs = [self.x_log, self.y_log];
        point.iter().zip(logs).all(|(v, log)| v.abs() <= LARGEST && (!log || *v >= SMALLEST))
    }
}

/// Positions of the parts of a plot, in points.
struct Layout {
    size: [f64; 2],
    title: Vec<String>,
    note: Vec<String>,
    note_top: f64,
    /// Upper left corner of the area between the axes.
    corner: [f64; 2],
    /// Names in the legend, shortened to 200 points; empty for a series that is not listed.
    names: Vec<String>,
}

impl Layout {
    /// Computes the layout; each length follows from the preceding ones.
    fn new(plot: &Plot, y_axis: &Axis, font: &Font) -> Self {
        let widest = |texts: &[String]| {
            texts.iter().map(|text| font.width(text, LABEL_EM)).fold(0.0, f64::max)
        };
        // axis name, labels and ticks
        let left = (MARGIN + LINE_HEIGHT + widest(&y_axis.labels) + 3.0 * TICK).ceil();
        let name = |series: &Series| font.shortened(&series.name, LABEL_EM, 200.0);
        let names: Vec<String> = plot.series.iter().map(name).collect();
        let legend = widest(&names);
        let legend = if legend > 0.0 { legend + 46.0 } else { 8.0 };
        let width = left + AREA[0] + legend + MARGIN;
        let title = font.wrap(&plot.title, TITLE_EM, width - 2.0 * MARGIN);
        let note = font.wrap(&plot.footnote, NOTE_EM, width - 2.0 * MARGIN);
        let top = (MARGIN + block_height(&title, TITLE_EM) + 8.0).floor();
        let named = names.iter().filter(|name| !name.is_empty()).count();
        let below_legend = 16.0 + LINE_HEIGHT * named as f64;
        let note_top = top + (AREA[1] + 2.0 * LINE_HEIGHT + 8.0).max(below_legend);
        let height = note_top + block_height(&note, NOTE_EM) + MARGIN;
        Self { size: [width, height], title, note, note_top, corner: [left, top], names }
    }
}

/// Error of plotters with this crate's backend.
type PlotError = DrawingAreaErrorKind<Infallible>;

/// Draws with plotters, at a number of pixels per point.
#[derive(Clone, Copy)]
struct Pen {
    zoom: f64,
}

impl Pen {
    /// Converts points to whole pixels.
    fn px(self, length: f64) -> i32 {
        (length * self.zoom).round() as i32
    }

    /// Style of a line of the given width in points, or of a filled shape.
    fn style(self, [r, g, b]: Rgb, width: f64) -> ShapeStyle {
        let stroke_width = self.px(width).max(1) as u32;
        ShapeStyle { color: RGBColor(r, g, b).into(), filled: true, stroke_width }
    }

    /// Style of labels; the backend has one font.
    fn text(self, pos: Pos) -> TextStyle<'static> {
        let font = FontDesc::new(FontFamily::SansSerif, LABEL_EM * self.zoom, FontStyle::Normal);
        let [r, g, b] = INK;
        TextStyle { font, color: BackendColor { alpha: 1.0, rgb: (r, g, b) }, pos }
    }

    /// Draws axes, grid and curves, then the legend.
    fn draw(
        self,
        plot: &Plot,
        layout: &Layout,
        page: &DrawingArea<Backend, Shift>,
        [x_axis, y_axis]: [Axis; 2],
    ) -> Result<(), PlotError> {
        let [left, top] = layout.corner.map(|at| self.px(at));
        let [width, height] = AREA.map(|length| self.px(length));
        let (margin, below) = (self.px(MARGIN), self.px(2.0 * LINE_HEIGHT));
        let area = (left + width - margin, height + below);
        let [x_name, y_name] = [&x_axis, &y_axis].map(|axis| axis.name.clone());
        let mut chart = ChartBuilder::on(&page.clone().shrink((margin, top), area))
            .x_label_area_size(below)
            .y_label_area_size(left - margin)
            .build_cartesian_2d(x_axis, y_axis)?;
        let mut axes = chart.configure_mesh();
        axes.x_desc(x_name).y_desc(y_name).label_style(self.text(Pos::default()));
        axes.light_line_style(self.style(FAINT, 0.5)).bold_line_style(self.style(GRID, 0.5));
        axes.axis_style(self.style(LINE, 1.0)).set_all_tick_mark_size(self.px(TICK)).draw()?;
        for curve in self.curves(plot) {
            for run in curve.series.points.split(|point| !plot.shows(point)) {
                let run: Vec<(f64, f64)> = run.iter().map(|point| (*point).into()).collect();
                chart.draw_series(curve.line(&run))?;
                chart.draw_series(curve.markers(&run))?;
            }
        }
        let named = self.curves(plot).zip(&layout.names).filter(|(_, name)| !name.is_empty());
        for (k, (curve, name)) in named.enumerate() {
            let y = top + self.px(8.0 + k as f64 * LINE_HEIGHT);
            let at = |right: f64| (left + width + self.px(14.0 + right), y);
            curve.line(&[at(0.0), at(20.0)]).iter().try_for_each(|line| page.draw(line))?;
            curve.markers(&[at(10.0)]).iter().try_for_each(|marker| page.draw(marker))?;
            page.draw_text(name, &self.text(Pos::new(HPos::Left, VPos::Center)), at(28.0))?;
        }
        Ok(())
    }

    /// Returns the series with their colours; when colours repeat, markers are hollow.
    fn curves(self, plot: &Plot) -> impl Iterator<Item = Curve<'_>> {
        plot.series.iter().enumerate().map(move |(k, series)| Curve {
            series,
            color: COLORS[k % COLORS.len()],
            hollow: k / COLORS.len() % 2 == 1,
            pen: self,
        })
    }
}

/// A series with its drawing style.
struct Curve<'a> {
    series: &'a Series,
    color: Rgb,
    hollow: bool,
    pen: Pen,
}

impl Curve<'_> {
    /// Connects the points if the series is a line.
    fn line<C: Clone>(&self, points: &[C]) -> Option<PathElement<C>> {
        self.series.line.then(|| PathElement::new(points, self.pen.style(self.color, 1.6)))
    }

    /// Draws dots or rings if the series has markers, with a white border that separates
    /// neighbours.
    fn markers<C: Copy>(&self, points: &[C]) -> Vec<Circle<C, f64>> {
        let rings = [(4.0, WHITE), (3.0, self.color), (1.5, WHITE)];
        let rings = &rings[..if self.hollow { 3 } else { 2 }];
        let of = |at: &C| {
            let (at, pen) = (*at, self.pen);
            rings.iter().map(move |(radius, color)| {
                Circle::new(at, radius * pen.zoom, pen.style(*color, 1.0))
            })
        };
        points.iter().filter(|_| self.series.markers).flat_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<[f64; 2]>, logs: [bool; 2]) -> Plot {
        Plot {
            title: "L-curve".into(),
            footnote: String::new(),
            x_label: "misfit (V)".into(),
            y_label: "norm (S)".into(),
            x_log: logs[0],
            y_log: logs[1],
            series: vec![Series { name: String::new(), points, line: true, markers: true }],
            zoom: 1,
        }
    }

    #[test]
    fn the_curve_is_drawn_in_its_color_and_nothing_else_is() {
        let canvas = draw_plot(&plot(vec![[1.0, 1.0], [f64::NAN, 2.0], [100.0, 1e-9]], [true; 2]));
        let canvas = canvas.unwrap();
        assert!(canvas.rgb().chunks_exact(3).any(|pixel| pixel == COLORS[0]));
        assert!(!canvas.rgb().chunks_exact(3).any(|pixel| pixel == COLORS[1]));
    }

    #[test]
    fn a_long_legend_makes_room() {
        let height = |count: usize| {
            let mut plot = plot(vec![[1.0, 1.0], [2.0, 2.0]], [false; 2]);
            let series = Series { name: "name".into(), ..plot.series[0].clone() };
            plot.series = vec![series; count];
            draw_plot(&plot).unwrap().size_px()[1]
        };
        assert_eq!(height(2), height(9));
        assert!(height(30) >= height(9) + 11 * LINE_HEIGHT as usize);
    }

    /// Labels below the axis are at least a character apart, whatever the range.
    #[test]
    fn numbers_along_an_axis_stand_apart() {
        use plotters::coord::ranged1d::{BoldPoints, Ranged as _};
        let font = Font::load().unwrap();
        let ends =
            [[0.0, 1.0], [-3.7e-5, 9e4], [0.301, 0.697], [1e-7, 3e8], [2.0, 2.00001], [-9e9, -8e9]];
        for (ends, log) in ends.into_iter().flat_map(|ends| [(ends, false), (ends, ends[0] > 0.0)])
        {
            let axis = Axis::new(ends.into_iter(), log, "x");
            let places = axis.key_points(BoldPoints(8));
            let places: Vec<i32> =
                places.iter().map(|at| axis.map(at, (0, AREA[0] as i32))).collect();
            let widths = axis.labels.windows(2).map(|pair| {
                pair.iter().map(|label| font.width(label, LABEL_EM) / 2.0).sum::<f64>()
                    + LABEL_EM / 2.0
            });
            for (pair, width) in places.windows(2).zip(widths) {
                assert!(f64::from(pair[1] - pair[0]) > width, "{ends:?} {log}: {:?}", axis.labels);
            }
        }
    }

    #[test]
    fn no_point_is_an_error() {
        for points in [vec![], vec![[f64::NAN, 1.0]], vec![[-1.0, 1.0], [0.0, 3.0]]] {
            let error = draw_plot(&plot(points, [true, false])).unwrap_err();
            assert!(matches!(error, PictureError::NoPoints { series: 1 }));
        }
    }
}
