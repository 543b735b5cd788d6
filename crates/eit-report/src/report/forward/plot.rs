//! Plots the error of a skin's voltages against time.

use super::results::ForwardResults;
use crate::error::ReportError;
use crate::output::axes;
use eit_picture::{Canvas, Plot, Series, draw_plot};

/// Draws element orders and meshes, and time floors.
pub(super) fn draw(results: &ForwardResults) -> Result<Canvas, ReportError> {
    let mut series: Vec<Series> = Vec::new();
    for point in &results.points {
        let (name, place) = (point.curve(), [point.time.median_s, point.error]);
        match series.iter_mut().find(|known| known.name == name) {
            Some(known) => known.points.push(place),
            None => series.push(Series { name, points: vec![place], line: true, markers: true }),
        }
    }
    let (name, points) = ("floor of the best".to_owned(), floors(results));
    series.push(Series { name, points, line: true, markers: false });
    let case = &results.case;
    Ok(draw_plot(&Plot {
        title: format!("Error of the voltages against run time: {}", case.skin()),
        footnote: format!(
            "{}: {}. Time: median for factorisation, voltages and Jacobian on each mesh. Error: \
             largest error of a voltage divided by the largest voltage, relative to {}. Floor: the \
             same work at this machine's best rates",
            case.skin(),
            case.what,
            results.reference_text()
        ),
        series,
        ..axes([("time (s)", true), ("error", true)])
    })?)
}

/// Returns the smallest error within each floor, in ascending order of time.
fn floors(results: &ForwardResults) -> Vec<[f64; 2]> {
    let points = results.points.iter();
    let mut places: Vec<[f64; 2]> = points.map(|point| [point.floor_s, point.error]).collect();
    places.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut least = f64::INFINITY;
    places.retain(|[_, error]| {
        let better = *error < least;
        least = least.min(*error);
        better
    });
    places
}
