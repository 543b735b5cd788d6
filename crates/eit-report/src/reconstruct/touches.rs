//! Writes `touches.csv` and the touches section of `report.json`.

use crate::error::ReportError;
use crate::output::io;
use eit_inverse::touch::Touch;
use eit_skin::faults::{ElectrodeFault, fault_lines};
use eit_skin::live::{SkinState, TouchFields};
use eit_skin::scene::TouchModel;
use eit_skin::text::counted;
use eit_skin::touches::Touches;
use serde_json::{Value, json};
use std::io::Write;

/// Columns of `touches.csv`: the fields that every output has for a touch, and what is known of the skin in that frame.
pub(crate) const HEADER: &str = "frame,time_s,id,state,x_m,y_m,z_m,std_x_m,std_y_m,std_z_m,nx,ny,nz,vx_m_s,vy_m_s,vz_m_s,\
     intensity_s_m2,intensity_std_s_m2,confidence,valid,whole,age_s,force_n,force_std_n,unlike,split_from,merged_into,skin";

/// Writes one row per touch and frame.
///
/// # Errors
///
/// A writer that fails.
pub(crate) fn write_csv(touches: &Touches, out: &mut dyn Write) -> Result<(), ReportError> {
    writeln!(out, "{HEADER}").map_err(io)?;
    touches.rows.iter().try_for_each(|row| {
        let (frame, time_s) = touches.in_recording(row);
        write_row(frame, time_s, &row.touch, touches.state(row.frame), out)
    })
}

/// Writes a row that tells the state of the skin in a frame without touches; its other columns are empty.
///
/// # Errors
///
/// A writer that fails.
pub(crate) fn write_state(
    frame: u64,
    time_s: f64,
    skin: SkinState,
    out: &mut dyn Write,
) -> Result<(), ReportError> {
    let none = ",".repeat(HEADER.matches(',').count() - 1);
    writeln!(out, "{frame},{time_s:.6}{none}{}", skin.name()).map_err(io)
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
    skin: SkinState,
    out: &mut dyn Write,
) -> Result<(), ReportError> {
    let known = |value: Option<String>| value.unwrap_or_default();
    let number = |value: f64| format!("{value:.4}");
    let TouchFields { id, state, confidence, valid, whole, age_s, .. } = TouchFields::from(touch);
    let ([x, y, z], [vx, vy, vz]) = (touch.position_m, touch.velocity_m_s);
    let [std_x, std_y, std_z] = touch.position_std_m();
    let normal = touch.normal.map(|[x, y, z]| format!("{x:.4},{y:.4},{z:.4}"));
    writeln!(
        out,
        "{frame},{time_s:.6},{id},{state},{x:.6},{y:.6},{z:.6},{std_x:.3e},{std_y:.3e},{std_z:.3e},{},\
         {vx:.4},{vy:.4},{vz:.4},{:.6e},{},{confidence:.4},{valid},{whole},{age_s:.6},{},{},{},{},{},{}",
        normal.unwrap_or_else(|| ",,".to_owned()),
        touch.intensity_s_m2,
        known(touch.intensity_std_s_m2.map(|std| format!("{std:.3e}"))),
        known(touch.force_n().map(number)),
        known(touch.force_std_n().map(number)),
        known(touch.learnt.map(|learnt| learnt.is_unlike.to_string())),
        known(touch.split_from.map(|id| id.to_string())),
        known(touch.merged_into.map(|id| id.to_string())),
        skin.name()
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
            "never_valid": touches.never_valid(),
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

/// Touches that are listed and do not count.
fn never_valid(count: usize) -> String {
    match count {
        0 => String::new(),
        count => format!(" ({count} more in touches.csv were never valid)"),
    }
}

/// Returns the summary line for the text.
pub(super) fn line(touches: Option<&Touches>) -> String {
    let Some(touches) = touches else {
        return "touches are not detected: the noise is unknown ([noise])".to_owned();
    };
    let mut text = format!(
        "{}{}, at most {} at once, in {} of {} frames",
        counted(touches.count(), "touch", "touches"),
        never_valid(touches.never_valid()),
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
        let choices = &touches.choices;
        if choices.presses.is_none() && choices.model == TouchModel::Search {
            text += "; fabric that remembers or warms, an amplifier that leaks and drives that take turns are \
                     explained by [touch] model = \"one-score\"";
        }
    }
    for line in fault_lines(&touches.faults) {
        text += &format!("\n{line}");
    }
    text
}
