//! Writes `touches.csv` and the touches section of `report.json`.

use crate::error::ReportError;
use crate::output::io;
use eit_inverse::touch::{Touch, TouchState};
use eit_skin::faults::{ElectrodeFault, fault_lines};
use eit_skin::text::counted;
use eit_skin::touches::{TouchRow, Touches};
use serde_json::{Value, json};
use std::io::Write;

/// Columns of `touches.csv`.
pub(crate) const HEADER: &str = "frame,time_s,id,state,x_m,y_m,z_m,intensity,intensity_std,confidence,\
                      std_x,std_y,vx,vy,valid,whole,force_n,force_std_n,unlike,nx,ny,nz";

/// Writes one row per touch and frame.
///
/// # Errors
///
/// A writer that fails.
pub(crate) fn write_csv(rows: &[TouchRow], out: &mut dyn Write) -> Result<(), ReportError> {
    writeln!(out, "{HEADER}").map_err(io)?;
    rows.iter().try_for_each(|row| write_row(row.frame as u64, row.time_s, &row.touch, out))
}

/// Writes one row.
///
/// # Errors
///
/// A writer that fails.
pub(crate) fn write_row(
    frame: u64,
    time_s: f64,
    touch: &Touch,
    out: &mut dyn Write,
) -> Result<(), ReportError> {
    let state = match touch.state {
        TouchState::Begin => "begin",
        TouchState::Hold => "hold",
        TouchState::End => "end",
    };
    let ([x, y, z], [vx, vy, _]) = (touch.position_m, touch.velocity_m_s);
    let [std_x, std_y, _] = touch.position_std_m();
    writeln!(
        out,
        "{frame},{time_s:.6},{},{state},{x:.6},{y:.6},{z:.6},{:.6e},{},{:.4},{std_x:.3e},\
         {std_y:.3e},{vx:.4},{vy:.4},{},{},{},{},{},{}",
        touch.id,
        touch.intensity_s_m2,
        touch.intensity_std_s_m2.map_or_else(String::new, |std| format!("{std:.3e}")),
        touch.confidence,
        touch.valid,
        touch.whole,
        touch.force_n().map_or_else(String::new, |force_n| format!("{force_n:.4}")),
        touch.force_std_n().map_or_else(String::new, |std_n| format!("{std_n:.4}")),
        touch.learnt.map_or_else(String::new, |learnt| learnt.is_unlike.to_string()),
        touch.normal.map_or_else(|| ",,".to_owned(), |[x, y, z]| format!("{x:.4},{y:.4},{z:.4}"))
    )
    .map_err(io)
}

/// Returns the section for `report.json`; `null` if the noise is unknown.
pub(super) fn touches_json(touches: Option<&Touches>) -> Value {
    touches.map_or(Value::Null, |touches| {
        json!({
            "frames": touches.frames,
            "frames_with_touch": touches.frames_with_touch(),
            "count": touches.count(),
            "most_at_once": touches.most(),
            "rows": touches.rows.len(),
            "not_explained_frames": touches.not_explained,
            "frozen_frames": touches.frozen,
            "frame_rate_hz": touches.rate_hz,
            "choices": touches.choices,
            "faulty_electrodes": touches.faults.iter().map(ElectrodeFault::json).collect::<Vec<_>>(),
        })
    })
}

/// Returns the summary line for the text.
pub(super) fn line(touches: Option<&Touches>) -> String {
    let Some(touches) = touches else {
        return "touches are not detected: the noise is unknown ([noise])".to_owned();
    };
    let mut text = format!(
        "{}, at most {} at once, in {} of {} frames",
        counted(touches.count(), "touch", "touches"),
        touches.most(),
        touches.frames_with_touch(),
        touches.frames
    );
    for line in touches.choices.lines() {
        text += &format!("\n{line}");
    }
    if let [first, ..] = touches.frozen[..] {
        let count = counted(touches.frozen.len() as u64, "frame", "frames");
        text += &format!(
            "\n{count} repeat an old one, the first {first}: nothing is known of the skin there"
        );
    }
    if let [first, ..] = touches.not_explained[..] {
        let count = counted(touches.not_explained.len() as u64, "frame", "frames");
        text += &format!(
            "\n{count} not explained by touches, the first {first}: none is valid there, and none does not mean that \
             nothing touches the skin"
        );
    }
    for line in fault_lines(&touches.faults) {
        text += &format!("\n{line}");
    }
    text
}
