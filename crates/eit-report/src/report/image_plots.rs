//! Plots of a scene's images: error against time, and one frame of each recording by every solver.

use super::cases::{Case, picture};
use super::picture::Picture;
use super::recording::RecordingResults;
use super::work_precision::WorkPrecisionCurve;
use crate::comparison::ReconstructionModel;
use crate::error::ReportError;
use crate::output::axes;
use eit_picture::{Canvas, FrameLabels, PictureSettings, Plot, Series, draw_plot, draw_sheet};
use eit_skin::plan::measured::Measured;
use ndarray::Axis;

/// Solvers drawn as a single line over the pixel counts.
const ONE_POINT: [&str; 4] =
    ["gauss-newton", "gauss-newton, gcv", "st-tv stream", "st-tv ≥ 0 stream"];

/// Name prefix of networks from files, drawn as one set of points; the table distinguishes them.
const NET: &str = "U-net ";

/// Draws the pictures of a scene; none if nothing was measured.
pub(super) fn draw(
    case: &Case,
    rows: &[Measured],
    note: &str,
    model: &ReconstructionModel,
    recordings: &[RecordingResults],
) -> Result<Vec<Picture>, ReportError> {
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let finest = model.raster.pixels();
    let plot = draw_plot(&Plot {
        title: format!("Error of the movie against run time: {}", case.name),
        footnote: format!(
            "{note}. Error: root mean square over both recordings; 1 is an empty image. Curves \
             vary the gap, or the number of pixels where the name says so"
        ),
        series: series(rows, finest),
        ..axes([("time per frame (s)", true), ("relative error", true)])
    })?;
    let mut pictures = vec![Picture::new(picture("error", &case.name), &plot)?];
    for recording in recordings {
        let shape = recording.recording.shape;
        let name = format!("{}_{shape}", picture("images", &case.name));
        pictures.push(Picture::new(name, &sheet(model, recording, note)?)?);
    }
    Ok(pictures)
}

/// Returns one curve per solver: over the gap at the finest raster, and at every raster for methods
/// that use knowledge of the fabric; over the rasters for solvers with one point on each.
fn series(rows: &[Measured], finest: usize) -> Vec<Series> {
    let coarsest = rows.iter().filter_map(|row| row.pixels).min().unwrap_or(finest);
    let mut all: Vec<Series> = Vec::new();
    for row in rows {
        let label = row.label();
        let name = match row.pixels {
            _ if ONE_POINT.contains(&label.as_str()) => {
                format!("{label}, {coarsest} to {finest} px")
            }
            None => label,
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
        match all.iter_mut().find(|known| known.name == name) {
            Some(known) => known.points.push(point),
            None => all.push(Series { name, points: vec![point], line: false, markers: true }),
        }
    }
    for series in &mut all {
        series.line = series.points.len() > 1 && !series.name.contains(NET);
    }
    all
}

/// Draws the truth and every solver's image of a recording, at the finest raster: the last frame that all
/// have.
fn sheet(
    model: &ReconstructionModel,
    recording: &RecordingResults,
    note: &str,
) -> Result<Canvas, ReportError> {
    let RecordingResults { recording, curves } = recording;
    let shown = |curve: &&WorkPrecisionCurve| {
        let fine = curve.solver.pixels.is_none_or(|pixels| pixels == model.raster.pixels());
        fine && curve.images.nrows() > 0
    };
    let least = curves.iter().filter(shown).map(|curve| curve.images.nrows()).min();
    let frame = least.unwrap_or(1) - 1;
    let (mut labels, mut rows) = (vec!["truth".to_owned()], vec![recording.truth.row(frame)]);
    for curve in curves.iter().filter(shown) {
        labels.push(curve.solver.label());
        rows.push(curve.images.row(frame));
    }
    let stacked = ndarray::stack(Axis(0), &rows)?;
    let images = model.raster.images_from_pixels(stacked.view())?;
    let skin = eit_picture::SkinDrawing::from_raster(&model.skin().mesh, &model.raster);
    let settings = PictureSettings {
        title: format!("{}: frame {frame} by every solver", fingers(recording.shape)),
        footnote: note.to_owned(),
        labels: FrameLabels::Text(labels),
        ..Default::default()
    };
    Ok(draw_sheet(images.view(), &skin, &settings)?)
}

/// The fingers of a recording in words, from the shape or number by which tables name it.
fn fingers(shape: &str) -> &str {
    match shape {
        "bell" => "Soft fingers",
        "pad" => "Hard fingers",
        "one" => "One finger",
        "two" => "Two fingers",
        other => other,
    }
}
