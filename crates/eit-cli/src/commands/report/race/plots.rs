//! Pictures of the race.

use super::super::bench::Bench;
use super::{Course, Point, Recording, Size};
use crate::draw;
use crate::error::CliError;
use crate::method::Method;
use crate::output::OutFolder;
use crate::picture::{Canvas, FrameLabels, PictureSettings, Plot, Series, draw_plot, draw_sheet};
use ndarray::Axis;

/// The plots, and one frame of each recording by every method.
pub(super) fn draw(
    bench: &Bench,
    courses: &[Course],
    recordings: &[Recording],
    (note, size): (&str, &Size),
    out: &mut OutFolder,
) -> Result<(), CliError> {
    let of = |shape: &'static str| courses.iter().filter(move |c| c.shape == shape);
    for (shape, file) in [("bell", "error_bell.png"), ("pad", "error_pad.png")] {
        let error = error_plot(of(shape), (shape, note, size))?;
        out.write(file, |w| Ok(error.write_png(w)?))?;
    }
    let gap = gap_plot(courses, note)?;
    out.write("gap.png", |w| Ok(gap.write_png(w)?))?;
    let images = images(bench, courses, recordings, (note, size))?;
    out.write("images.png", |w| Ok(images.write_png(w)?))
}

/// One series a method: a curve, or a mark where there is one run.
fn series<'a>(
    courses: impl Iterator<Item = &'a Course>,
    name: impl Fn(&Course) -> String,
    y: impl Fn(&Point) -> Option<f64>,
) -> Vec<Series> {
    let one = |course: &Course| Series {
        name: name(course),
        points: course
            .points
            .iter()
            .filter_map(|p| Some([p.seconds / course.frames as f64, y(p)?]))
            .collect(),
        line: course.points.len() > 1,
        markers: true,
    };
    courses.map(one).collect()
}

fn error_plot<'a>(
    courses: impl Iterator<Item = &'a Course>,
    (shape, note, size): (&str, &str, &Size),
) -> Result<Canvas, CliError> {
    let fewer = if size.absolute_frames < size.frames {
        let name = Method::GaussNewtonAbsolute.name();
        format!("; {name} on {} frames", size.absolute_frames)
    } else {
        String::new()
    };
    Ok(draw_plot(&Plot {
        title: format!("Error of the movie against run time: {shape} fingers"),
        footnote: format!("{note}{fewer}"),
        x_label: "time per frame (s)".to_owned(),
        y_label: "relative error".to_owned(),
        x_log: true,
        y_log: true,
        series: series(courses, |c| c.name.clone(), |p| Some(p.relative_error)),
        zoom: 2,
    })?)
}

fn gap_plot(courses: &[Course], note: &str) -> Result<Canvas, CliError> {
    let iterated = courses.iter().filter(|c| c.points.iter().any(|p| p.gap.is_some()));
    Ok(draw_plot(&Plot {
        title: "Certified gap against run time".to_owned(),
        footnote: format!("{note}. Gap: part by which the objective can still fall, proven"),
        x_label: "time per frame (s)".to_owned(),
        y_label: "relative duality gap".to_owned(),
        x_log: true,
        y_log: true,
        series: series(iterated, |c| format!("{}, {}", c.name, c.shape), |p| p.gap),
        zoom: 2,
    })?)
}

/// The truth and every method's image of the last frame that all have, one recording after the
/// other.
fn images(
    bench: &Bench,
    courses: &[Course],
    recordings: &[Recording],
    (note, size): (&str, &Size),
) -> Result<Canvas, CliError> {
    let frame = size.absolute_frames.min(size.frames) - 1;
    let (mut labels, mut rows) = (Vec::new(), Vec::new());
    for (shape, _, truth) in recordings {
        labels.push(format!("{shape}: truth"));
        rows.push(truth.row(frame));
        for course in courses.iter().filter(|course| course.shape == *shape) {
            labels.push(course.name.clone());
            rows.push(course.movie.row(frame));
        }
    }
    let stacked = ndarray::stack(Axis(0), &rows).map_err(|e| CliError::Failure(e.to_string()))?;
    let images = bench.raster.images_from_pixels(stacked.view())?;
    let skin = draw::skin(&bench.setup.mesh, &bench.raster);
    let settings = PictureSettings {
        title: format!("Frame {frame} by every method"),
        footnote: note.to_owned(),
        labels: FrameLabels::Text(labels),
        ..Default::default()
    };
    Ok(draw_sheet(images.view(), &skin, &settings)?)
}
