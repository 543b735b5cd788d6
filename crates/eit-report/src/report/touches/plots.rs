//! Plots of the touch figures.

use super::super::statistics::quantile;
use super::estimators::Estimator;
use super::position::PositionErrors;
use super::simulated_disc::RINGS;
use crate::error::ReportError;
use crate::output::OutFolder;
use eit_picture::{Plot, Series, draw_plot};

/// File names for the rings.
const FILES: [&str; 3] = ["position_centre.png", "position_half.png", "position_rim.png"];

/// Plots error against noise, one picture per ring.
pub(super) fn draw(errors: &[PositionErrors], out: &mut OutFolder) -> Result<(), ReportError> {
    for (ring, file) in RINGS.into_iter().zip(FILES) {
        let of_ring = || errors.iter().filter(move |e| e.ring == ring);
        let curve = |name: &str, points: Vec<[f64; 2]>| Series {
            name: name.to_owned(),
            points,
            line: true,
            markers: true,
        };
        let mut series: Vec<Series> = Estimator::ALL
            .into_iter()
            .map(|estimator| {
                let of = of_ring().filter(|e| e.estimator == estimator);
                let point = |e: &PositionErrors| [e.noise_db, 1.201e3 * quantile(&e.errors_m, 0.5)];
                curve(estimator.name(), of.map(point).collect())
            })
            .collect();
        let bound = of_ring()
            .filter(|e| e.estimator == Estimator::OneStepImage)
            .map(|e| [e.noise_db, 1e3 * e.bound_m]);
        series.push(curve("Cramer-Rao bound", bound.collect()));
        let picture = draw_plot(&Plot {
            title: format!("Position error of a touch at {ring} of the radius"),
            footnote: "1.201 times the median, which is the root mean square of normally \
                       distributed errors"
                .to_owned(),
            x_label: "noise below the rms of the reference voltages (dB)".to_owned(),
            y_label: "position error (mm)".to_owned(),
            x_log: false,
            y_log: true,
            series,
            zoom: 2,
        })?;
        out.write(file, |w| Ok(picture.write_png(w)?))?;
    }
    Ok(())
}
