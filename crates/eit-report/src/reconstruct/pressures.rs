//! Pressures of touches whose force was learnt: images, a movie, and a table.

use crate::error::ReportError;
use crate::output::{OutFolder, io, write_npy};
use eit_core::median;
use eit_picture::{ColorMap, PictureSettings, SkinDrawing, write_gif};
use eit_skin::Pressures;
use eit_skin::touches::Touches;
use serde_json::{Value, json};

/// Names of the files.
pub(super) const FILES: [&str; 3] = ["pressure.npy", "pressure.csv", "pressure.gif"];

/// Writes all files; the movie if there is more than one frame.
///
/// # Errors
///
/// A picture that cannot be drawn, a folder that cannot be written.
pub(super) fn write(
    out: &mut OutFolder,
    pressures: &Pressures,
    found: &Touches,
    skin: &SkinDrawing,
    settings: &PictureSettings,
    rate_hz: Option<f64>,
) -> Result<(), ReportError> {
    let [images, table, movie] = FILES;
    out.write(images, |w| write_npy(&pressures.images_pa, w))?;
    out.write(table, |w| {
        writeln!(w, "frame,time_s,id,force_n,force_std_n,area_m2,pressure_pa,pressure_std_pa")
            .map_err(io)?;
        for (row, mean) in found.rows.iter().zip(&pressures.touches) {
            let (Some(mean), Some(force)) =
                (mean, row.touch.force_n().zip(row.touch.force_std_n()))
            else {
                continue;
            };
            let ((frame, time_s), id) = (found.in_recording(row), row.touch.id);
            writeln!(
                w,
                "{frame},{time_s:.6},{id},{:.4},{:.4},{:.4e},{:.4e},{}",
                force.0,
                force.1,
                mean.area_m2,
                mean.pressure_pa,
                mean.std_pa.map_or_else(String::new, |std_pa| format!("{std_pa:.4e}"))
            )
            .map_err(io)?;
        }
        Ok(())
    })?;
    let settings = PictureSettings {
        quantity: "p".to_owned(),
        unit: "Pa".to_owned(),
        map: ColorMap::Viridis,
        range: None,
        ..settings.clone()
    };
    if pressures.images_pa.shape()[0] < 2 {
        return Ok(());
    }
    let rate_hz = rate_hz.unwrap_or(super::MOVIE_RATE_HZ);
    out.write(movie, |w| {
        Ok(write_gif(pressures.images_pa.view(), skin, &settings, rate_hz, w, &mut |_, _| {})?)
    })
}

/// Median of the pressures, and of their stated errors.
fn medians(pressures: &Pressures) -> [Option<f64>; 2] {
    let all = || pressures.touches.iter().flatten();
    [median(all().map(|mean| mean.pressure_pa)), median(all().filter_map(|mean| mean.std_pa))]
}

/// The pressures in words.
pub(super) fn note(pressures: &Pressures) -> String {
    let [pressure_pa, std_pa] = medians(pressures);
    let kpa = 1e-3 * pressure_pa.unwrap_or(f64::NAN);
    let value = match std_pa {
        Some(std_pa) => format!("pressure {kpa:.3} +- {:.3} kPa", 1e-3 * std_pa),
        None => format!(
            "pressure at least {kpa:.3} kPa, as images without a U-net for this skin are wider than the contact"
        ),
    };
    let count = pressures.touches.iter().flatten().count();
    format!(
        "{value}: force over the area of a touch in the image, median of {count} touches in a frame"
    )
}

/// The section of `report.json`.
pub(super) fn json(pressures: &Pressures) -> Value {
    let [pressure_pa, std_pa] = medians(pressures);
    json!({
        "touches": pressures.touches.iter().flatten().count(),
        "median_pa": pressure_pa,
        "median_std_pa": std_pa,
    })
}
