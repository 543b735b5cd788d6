//! Curves over an axis: L-curves, convergence, error against run time.

use crate::{
    PictureError,
    canvas::{Align, Canvas, INK, LINE, PALE, Rgb, WHITE, crisp, crisp_frame},
    page::{LABEL_EM, MARGIN, NOTE_EM, TITLE_EM, block_height, write_block},
    scale::{Ticks, power_of_ten},
    text::Font,
};

/// Size of the area between the axes, in points.
const AREA: [f64; 2] = [400.0, 270.0];
/// Longer names in the legend are cut, in points.
const NAME_WIDTH: f64 = 200.0;
/// Height of a line of labels, in points.
const LINE_HEIGHT: f64 = 18.0;
/// Room between the extreme points and the axes, as part of the range.
const PADDING: f64 = 0.04;
/// Colours that colour-blind readers tell apart (M. Okabe, K. Ito, "Color Universal Design",
/// 2008), without the yellow that is too pale for lines on paper.
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
    /// What the legend calls it; empty: not in the legend.
    pub name: String,
    /// Points (x, y) in the order in which the line joins them; a point that is not finite, or
    /// not positive on a logarithmic axis, interrupts it.
    pub points: Vec<[f64; 2]>,
    /// Joins the points.
    pub line: bool,
    /// Marks each point.
    pub markers: bool,
}

/// Curves with their axes.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Headline; may be empty.
    pub title: String,
    /// Small print below; may be empty.
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
    /// Pixels to a point (1 to 4).
    pub zoom: usize,
}

/// Draws curves. Long, but one chain: each length follows from those before.
///
/// # Errors
/// [`PictureError::NoPoints`] when no point can be shown.
pub fn draw_plot(plot: &Plot) -> Result<Canvas, PictureError> {
    let logs = [plot.x_log, plot.y_log];
    let usable = |p: &[f64; 2]| {
        p.iter().zip(logs).all(|(v, log)| v.abs() <= 1e300 && (!log || *v >= 1e-300))
    };
    let points = || plot.series.iter().flat_map(|s| &s.points).filter(|p| usable(p));
    if points().next().is_none() {
        return Err(PictureError::NoPoints { series: plot.series.len() });
    }
    let x_axis = Axis::new(points().map(|p| p[0]), plot.x_log, &plot.x_label);
    let y_axis = Axis::new(points().map(|p| p[1]), plot.y_log, &plot.y_label);

    let font = Font::load()?;
    let widest = |texts: &mut dyn Iterator<Item = &String>| {
        texts.map(|text| font.width(text, LABEL_EM)).fold(0.0, f64::max)
    };
    let left = (MARGIN + widest(&mut y_axis.ticks.iter().map(|t| &t.1)) + 8.0).ceil();
    let names: Vec<String> =
        plot.series.iter().map(|s| font.shortened(&s.name, LABEL_EM, NAME_WIDTH)).collect();
    let legend = widest(&mut names.iter());
    let legend = if legend > 0.0 { legend + 46.0 } else { 0.0 };
    let width = left + AREA[0] + legend.max(8.0) + MARGIN;
    let title = font.wrap(&plot.title, TITLE_EM, width - 2.0 * MARGIN);
    let note = font.wrap(&plot.footnote, NOTE_EM, width - 2.0 * MARGIN);
    let title_height = block_height(&title, TITLE_EM);
    let top = (MARGIN + title_height + LINE_HEIGHT + 4.0).floor();
    let named = names.iter().filter(|name| !name.is_empty()).count();
    let below_legend = 16.0 + LINE_HEIGHT * named as f64;
    let note_top = top + (AREA[1] + 2.0 * LINE_HEIGHT + 8.0).max(below_legend);
    let height = note_top + block_height(&note, NOTE_EM) + MARGIN;

    let mut canvas = Canvas::new(width, height, plot.zoom.clamp(1, 4), font);
    write_block(&mut canvas, &title, TITLE_EM, MARGIN);
    write_block(&mut canvas, &note, NOTE_EM, note_top);
    draw_axes(&mut canvas, [left, top], &x_axis, &y_axis);
    let place = |p: &[f64; 2]| {
        usable(p).then(|| {
            [left + x_axis.place(p[0]) * AREA[0], top + (1.0 - y_axis.place(p[1])) * AREA[1]]
        })
    };
    let mut legend_at = [left + AREA[0] + 14.0, top + 8.0];
    // the colours come again, with hollow marks
    let styles = (0..).map(|k: usize| (COLORS[k % COLORS.len()], k / COLORS.len() % 2 == 1));
    for ((series, name), (color, hollow)) in plot.series.iter().zip(&names).zip(styles) {
        let points: Vec<_> = series.points.iter().map(place).collect();
        if series.line {
            for run in points.split(Option::is_none) {
                draw_line(&mut canvas, &run.iter().flatten().copied().collect::<Vec<_>>(), color);
            }
        }
        if series.markers {
            for point in points.iter().flatten() {
                draw_marker(&mut canvas, *point, color, hollow);
            }
        }
        if !name.is_empty() {
            let [x, y] = legend_at;
            if series.line {
                draw_line(&mut canvas, &[[x, y], [x + 20.0, y]], color);
            }
            if series.markers {
                draw_marker(&mut canvas, [x + 10.0, y], color, hollow);
            }
            canvas.text(name, LABEL_EM, [x + 28.0, y], Align::Left, INK);
            legend_at[1] += LINE_HEIGHT;
        }
    }
    Ok(canvas)
}

/// Frame, grid, ticks and the names of the axes.
fn draw_axes(canvas: &mut Canvas, [left, top]: [f64; 2], x_axis: &Axis, y_axis: &Axis) {
    let (right, bottom) = (left + AREA[0], top + AREA[1]);
    for (place, label) in &x_axis.ticks {
        let x = crisp(left + place * AREA[0]);
        canvas.stroke(&[[x, top], [x, bottom]], 0.6, PALE, 0.7);
        canvas.text(label, LABEL_EM, [x, bottom + 12.0], Align::Centre, INK);
    }
    for (place, label) in &y_axis.ticks {
        let y = crisp(bottom - place * AREA[1]);
        canvas.stroke(&[[left, y], [right, y]], 0.6, PALE, 0.7);
        canvas.text(label, LABEL_EM, [left - 6.0, y], Align::Right, INK);
    }
    canvas.stroke(&crisp_frame([left, top], AREA), 1.0, LINE, 1.0);
    let below = [left + AREA[0] / 2.0, bottom + 12.0 + LINE_HEIGHT];
    canvas.text(&x_axis.label, LABEL_EM, below, Align::Centre, INK);
    canvas.text(&y_axis.label, LABEL_EM, [left, top - 11.0], Align::Left, INK);
}

fn draw_line(canvas: &mut Canvas, points: &[[f64; 2]], color: Rgb) {
    canvas.stroke(points, 1.6, color, 1.0);
}

/// A dot with a white rim, so that neighbours stay apart; or a ring.
fn draw_marker(canvas: &mut Canvas, point: [f64; 2], color: Rgb, hollow: bool) {
    canvas.stroke(&[point], 7.5, WHITE, 1.0);
    canvas.stroke(&[point], 6.0, color, 1.0);
    if hollow {
        canvas.stroke(&[point], 3.0, WHITE, 1.0);
    }
}

/// One axis: its range and what is written along it.
struct Axis {
    log: bool,
    low: f64,
    high: f64,
    label: String,
    /// Places from 0 to 1, and what stands there.
    ticks: Vec<(f64, String)>,
}

impl Axis {
    /// An axis over all values, which are finite, and positive if `log`.
    fn new(values: impl Iterator<Item = f64> + Clone, log: bool, label: &str) -> Self {
        let transformed = values.map(|v| if log { v.log10() } else { v });
        let least = transformed.clone().fold(f64::INFINITY, f64::min);
        let most = transformed.fold(f64::NEG_INFINITY, f64::max);
        // a single value, or values alike to six digits, still need an axis with ticks
        let least_span = if log { 0.02 } else { (1e-6 * least.abs().max(most.abs())).max(1e-300) };
        let missing = (least_span - (most - least)).max(0.0) / 2.0;
        let padding = PADDING * (most - least + 2.0 * missing);
        let (low, high) = (least - missing - padding, most + missing + padding);
        let mut axis = Self { log, low, high, label: label.to_owned(), ticks: Vec::new() };
        if log && high - low >= 1.0 {
            // most 8 decades are written, so that the labels stand apart
            let every = (((high - low) / 8.0).ceil() as i32).max(1);
            let decades = (low.ceil() as i32)..=(high.floor() as i32);
            axis.ticks = decades
                .filter(|decade| decade % every == 0)
                .map(|decade| (axis.share(f64::from(decade)), power_of_ten(decade)))
                .collect();
            return axis;
        }
        let ends = if log { [10f64.powf(low), 10f64.powf(high)] } else { [low, high] };
        let mut ticks = Ticks::linear(ends[0], ends[1], 7);
        if ticks.exponent.abs() <= 3 {
            ticks = ticks.labelled(0);
        } else {
            axis.label = format!("{label}  ×{}", power_of_ten(ticks.exponent));
        }
        axis.ticks = ticks.values.iter().map(|v| axis.place(*v)).zip(ticks.labels).collect();
        axis
    }

    /// Place of a value, 0 at the low end and 1 at the high one.
    fn place(&self, value: f64) -> f64 {
        self.share(if self.log { value.log10() } else { value })
    }

    fn share(&self, transformed: f64) -> f64 {
        (transformed - self.low) / (self.high - self.low)
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
    fn axes_have_ticks_for_any_values() {
        let pairs = [[1.0, 1.0], [0.0, 0.0], [-3.0, 9e4], [1e300, -1e300], [5e-7, 5.000001e-7]];
        for pair in pairs {
            let axis = Axis::new(pair.into_iter(), false, "x");
            assert!((2..=12).contains(&axis.ticks.len()), "{pair:?}: {:?}", axis.ticks);
            assert!(axis.ticks.iter().all(|t| (0.0..=1.0).contains(&t.0)), "{:?}", axis.ticks);
        }
        for pair in [[1.0, 1.0], [1e-300, 1e300], [2.0, 3.0], [1e-6, 1.5e3]] {
            let axis = Axis::new(pair.into_iter(), true, "x");
            assert!((2..=12).contains(&axis.ticks.len()), "{pair:?}: {:?}", axis.ticks);
        }
        let decades = Axis::new([1e-2, 1e1].into_iter(), true, "x").ticks;
        let labels: Vec<_> = decades.iter().map(|t| t.1.as_str()).collect();
        assert_eq!(labels, ["10⁻²", "10⁻¹", "10⁰", "10¹"]);
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

    #[test]
    fn no_point_is_an_error() {
        for points in [vec![], vec![[f64::NAN, 1.0]], vec![[-1.0, 1.0], [0.0, 3.0]]] {
            let error = draw_plot(&plot(points, [true, false])).unwrap_err();
            assert!(matches!(error, PictureError::NoPoints { series: 1 }));
        }
    }
}
