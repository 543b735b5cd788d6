//! Writes the learning curve as numbers and as a picture.

use crate::error::ReportError;
use crate::output::{OutFile, axes, io};
use eit_denoise::Epoch;
use eit_picture::{Plot, Series, draw_plot};
use std::path::Path;

/// Writes `csv` and `png` files next to the weights; `footnote` names the network.
///
/// # Errors
///
/// A folder that cannot be written.
pub fn write(
    curve: &[Epoch],
    footnote: String,
    weights: impl AsRef<Path>,
) -> Result<(), ReportError> {
    let weights = weights.as_ref();
    OutFile::new(&weights.with_extension("csv"))?.write(|w| {
        writeln!(w, "epoch,train_error,held_out_error,rate").map_err(io)?;
        for Epoch { epoch, train_error, held_out_error, rate, .. } in curve {
            writeln!(w, "{epoch},{train_error:e},{held_out_error:e},{rate:e}").map_err(io)?;
        }
        Ok(())
    })?;
    let line = |name: &str, value: &dyn Fn(&Epoch) -> f64| Series {
        name: name.to_owned(),
        points: curve.iter().map(|e| [(e.epoch + 1) as f64, value(e)]).collect(),
        line: true,
        markers: true,
    };
    let plot = Plot {
        title: "Learning curve".to_owned(),
        footnote,
        series: vec![
            line("training set", &|e| e.train_error),
            line("held out", &|e| e.held_out_error),
        ],
        ..axes([("epoch", false), ("mean squared error, relative to the raw images", true)])
    };
    let picture = draw_plot(&plot)?;
    OutFile::new(&weights.with_extension("png"))?.write(|w| Ok(picture.write_png(w)?))
}
