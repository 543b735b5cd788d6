//! Pictures of the race: error over time, and one frame by every solver.

use super::super::bench::Bench;
use super::Recording;
use super::case::Case;
use super::forward::{ForwardCourse, OURS};
use super::point::Course;
use crate::error::ReportError;
use eit_picture::{Canvas, FrameLabels, PictureSettings, Plot, Series, draw_plot, draw_sheet};
use eit_skin::plan::measured::Measured;
use ndarray::Axis;

/// Solvers whose curve over the pixels is one line.
const ONE_POINT: [&str; 4] =
    ["gauss-newton", "gauss-newton, gcv", "st-tv stream", "st-tv ≥ 0 stream"];

/// A peer whose settings are one curve.
const PEER: &str = "NumPy primal-dual";

/// Nets of files: one set of points for all of them, the table tells them apart.
const NET: &str = "U-net ";

/// Files of a scene's pictures and their bytes.
pub(super) fn draw(
    case: &Case,
    (rows, note): (&[Measured], &str),
    judge: &Bench,
    (recordings, courses): (&[Recording], &[Vec<Course>]),
) -> Result<Vec<(&'static str, Vec<u8>)>, ReportError> {
    let mut pictures = Vec::new();
    if rows.is_empty() {
        return Ok(pictures);
    }
    let [curves, images] = case.files;
    let finest = judge.raster.pixels();
    let plot = draw_plot(&Plot {
        title: format!("Error of the movie against run time: {}", case.name),
        footnote: format!(
            "{note}. Error: root mean square over both recordings; 1: an empty image. Curves run \
             over the gap, or over the pixels where the name says so"
        ),
        x_label: "time per frame (s)".to_owned(),
        y_label: "relative error".to_owned(),
        x_log: true,
        y_log: true,
        series: series(rows, finest),
        zoom: 2,
    })?;
    pictures.push((curves, png(&plot)?));
    pictures.push((images, png(&sheet(judge, recordings, courses, note)?)?));
    Ok(pictures)
}

/// The bytes of a picture.
pub(super) fn png(canvas: &Canvas) -> Result<Vec<u8>, ReportError> {
    let mut bytes = Vec::new();
    canvas.write_png(&mut bytes)?;
    Ok(bytes)
}

/// One curve for each solver: over the gap at the finest raster, and for what is known of the
/// fabric at each; over the rasters where there is one point on each.
fn series(rows: &[Measured], finest: usize) -> Vec<Series> {
    let coarsest = rows.iter().filter_map(|row| row.pixels).min().unwrap_or(finest);
    let mut solvers: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
    for row in rows {
        let label = row.label();
        let name = match row.pixels {
            _ if ONE_POINT.contains(&label.as_str()) => {
                format!("{label}, {coarsest} to {finest} px")
            }
            None => label,
            _ if label.starts_with(PEER) => PEER.to_owned(),
            _ if label.contains(NET) => {
                format!(
                    "{} of other sizes",
                    label.split_inclusive(NET).next().unwrap_or_default().trim()
                )
            }
            Some(pixels) if label == "st-tv ≥ 0" => format!("{label}, {pixels} px"),
            Some(pixels) if pixels == finest => label,
            Some(_) => continue,
        };
        let point = [1e-3 * row.ms_a_frame, row.relative_error];
        match solvers.iter_mut().find(|(known, _)| *known == name) {
            Some((_, points)) => points.push(point),
            None => solvers.push((name, vec![point])),
        }
    }
    let one = |(name, points): (String, Vec<[f64; 2]>)| Series {
        line: points.len() > 1 && !name.contains(NET),
        name,
        points,
        markers: true,
    };
    solvers.into_iter().map(one).collect()
}

/// Error of the voltages of a skin over time: kinds of elements and meshes, what time cannot be less
/// than, peers.
pub(super) fn forward(course: &ForwardCourse) -> Result<Canvas, ReportError> {
    let (mut ours, mut peers): (Vec<Series>, Vec<Series>) = (Vec::new(), Vec::new());
    for point in &course.points {
        let series = if point.solver == OURS { &mut ours } else { &mut peers };
        let (name, place) = (point.curve(), [point.time.median_s, point.error]);
        match series.iter_mut().find(|known| known.name == name) {
            Some(known) => known.points.push(place),
            None => series.push(Series { name, points: vec![place], line: true, markers: true }),
        }
    }
    let (name, points) = ("floor of the best".to_owned(), floors(course));
    ours.push(Series { name, points, line: true, markers: false });
    ours.extend(peers);
    Ok(draw_plot(&Plot {
        title: format!("Error of the voltages against run time: {}", course.skin.scene),
        footnote: format!(
            "{}: {}. Time: median, factorisation, voltages and Jacobian, mesh by mesh. Error: the largest \
             over the largest voltage, against {}. Floor: the same work at this machine's best rates",
            course.skin.scene,
            course.skin.what,
            course.reference_words()
        ),
        x_label: "time (s)".to_owned(),
        y_label: "error".to_owned(),
        x_log: true,
        y_log: true,
        series: ours,
        zoom: 2,
    })?)
}

/// The least error that some mesh of ours has within each floor, ascending in time.
fn floors(course: &ForwardCourse) -> Vec<[f64; 2]> {
    let ours = course.points.iter().filter(|point| point.solver == OURS);
    let mut places: Vec<[f64; 2]> = ours.map(|point| [point.floor_s, point.error]).collect();
    places.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut least = f64::INFINITY;
    places.retain(|[_, error]| {
        let better = *error < least;
        least = least.min(*error);
        better
    });
    places
}

/// The truth and every solver's image of the last frame that all have, one recording after the
/// other, at the finest raster.
fn sheet(
    judge: &Bench,
    recordings: &[Recording],
    courses: &[Vec<Course>],
    note: &str,
) -> Result<Canvas, ReportError> {
    let shown = |course: &&Course| {
        let fine = course.solver.pixels.is_none_or(|pixels| pixels == judge.raster.pixels());
        fine && course.movie.nrows() > 0
    };
    let least = courses.iter().flatten().filter(shown).map(|course| course.movie.nrows()).min();
    let frame = least.unwrap_or(1) - 1;
    let (mut labels, mut rows) = (Vec::new(), Vec::new());
    for (recording, courses) in recordings.iter().zip(courses) {
        labels.push(format!("{}: truth", recording.shape));
        rows.push(recording.truth.row(frame));
        for course in courses.iter().filter(shown) {
            labels.push(course.solver.label());
            rows.push(course.movie.row(frame));
        }
    }
    let stacked =
        ndarray::stack(Axis(0), &rows).map_err(|e| ReportError::Failure(e.to_string()))?;
    let images = judge.raster.images_from_pixels(stacked.view())?;
    let skin = eit_picture::SkinDrawing::from_raster(&judge.skin().mesh, &judge.raster);
    let settings = PictureSettings {
        title: format!("Frame {frame} by every solver"),
        footnote: note.to_owned(),
        labels: FrameLabels::Text(labels),
        ..Default::default()
    };
    Ok(draw_sheet(images.view(), &skin, &settings)?)
}
