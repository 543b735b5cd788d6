//! The answer of `eit learn`.

use super::{Found, outputs};
use crate::cli::LearnArgs;
use crate::commands::Answer;
use eit_skin::Progress;
use eit_skin::learn::{CurvePoint, LearnedSkin, Learning, PlaceErrors, PlacesBy, PressFrames};
use serde_json::{Value, json};

/// The answer as text and as JSON.
pub(super) fn answer(args: &LearnArgs, found: &Found, progress: &Progress) -> Answer {
    Answer { text: text(args, found), json: to_json(args, found, progress) }
}

/// Notes about presses that should be checked, by their lines.
pub(super) fn notes(learning: &Learning, pressed: &PressFrames) -> Vec<String> {
    let unlike = learning.unlike.iter().map(|unlike| {
        format!(
            "{}: judging by the other presses, no touch anywhere explains {:.0} % of its change: \
             was the skin \
             pressed at this place, and only there? The press is learnt all the same",
            pressed.name(unlike.press),
            100.0 * unlike.rest
        )
    });
    let forces = learning.without_touch.iter().map(|&press| {
        format!(
            "{}: no touch was found in its frames, so its force is not learnt",
            pressed.name(press)
        )
    });
    unlike.chain(forces).collect()
}

fn mm(errors: &PlaceErrors) -> String {
    format!("{:.1} mm (median), {:.1} mm (mean)", 1e3 * errors.median_m, 1e3 * errors.mean_m)
}

fn text(args: &LearnArgs, found: &Found) -> String {
    let Found { learning: Learning { skin: learned, without_touch, .. }, curve, notes } = found;
    let presses = learned.presses.places_m.len();
    let mut lines =
        vec![format!("{presses} presses; touches are located by {}", learned.places_by.words())];
    lines.extend(gained(learned));
    if let Some(model) = &learned.errors.model {
        lines.push(format!("error of the model alone: {}", mm(model)));
    }
    lines.push(format!(
        "with a learnt correction, presses held out singly or a tenth at a time: {}",
        mm(&learned.errors.map)
    ));
    lines.push(format!(
        "regression from frames to places, presses held out singly: {}",
        mm(&learned.errors.regression)
    ));
    if args.fit_frame {
        let pose = &learned.pose;
        lines.push(format!(
            "the table's places are turned by {:.1} degrees{}, scaled by {:.3} and shifted by {:.1} and {:.1} \
             mm on the scene's skin; a touch {} the conductivity",
            pose.turn_rad.to_degrees(),
            if pose.is_mirrored { " after y is reversed" } else { "" },
            pose.scale,
            1e3 * pose.shift_m[0],
            1e3 * pose.shift_m[1],
            if learned.sign > 0.0 { "raises" } else { "lowers" }
        ));
    }
    lines.push(match &learned.force {
        Some(force) => format!(
            "force: {:.2} to {:.2} N were learnt, from the strength by {}; error of presses held \
             out singly {:.0} %",
            force.curve.forces_n[0],
            force.curve.forces_n[1],
            force.strength_by.words(),
            100.0 * force.curve.error_ln
        ),
        None => without_force(learned, without_touch.len()),
    });
    for point in curve {
        lines.push(format!(
            "{}, tested on the {} after them: {}{}",
            learnt(point),
            point.tested,
            mm(&point.place),
            point.force.map_or(String::new(), |[median, high]| format!(
                "; force error {:.0} % (median), {:.0} % (90 % quantile)",
                100.0 * median,
                100.0 * high
            ))
        ));
    }
    lines.extend(notes.iter().map(|note| format!("note: {note}")));
    lines.push(format!("written to {}; for the scene:", args.out.display()));
    lines.push(format!("  [touch] learned = \"{}\"", args.out.display()));
    lines.join("\n")
}

/// By how much the mean error of the method used is below that of the model alone; `None` if it is the model's.
fn gained(learned: &LearnedSkin) -> Option<String> {
    let by = match learned.places_by {
        PlacesBy::Model => return None,
        PlacesBy::Map => learned.errors.map,
        PlacesBy::Regression => learned.errors.regression,
    };
    let model = learned.errors.model?;
    Some(format!(
        "its mean error is {:.0} % less than that of the model alone",
        100.0 * (1.0 - by.mean_m / model.mean_m)
    ))
}

/// Explains why no force was learnt.
fn without_force(learned: &LearnedSkin, without_touch: usize) -> String {
    let stated = learned.forces_n.iter().flatten().count();
    match without_touch {
        0 => format!("no force: {stated} presses state force_n, but three are needed"),
        _ => format!(
            "no force: {stated} presses state force_n, and a touch was found in {} of them, but \
             three are needed",
            stated.saturating_sub(without_touch)
        ),
    }
}

/// Describes what a point of the curve was learnt from.
fn learnt(point: &CurvePoint) -> String {
    match (point.earlier, point.learnt - point.earlier) {
        (0, new) => format!("the first {new} presses"),
        (earlier, 0) => format!("the {earlier} presses of the earlier file alone"),
        (earlier, new) => format!("the {earlier} earlier presses and the first {new} new ones"),
    }
}

fn to_json(args: &LearnArgs, found: &Found, progress: &Progress) -> Value {
    let Found { learning: Learning { skin: learned, .. }, curve, notes } = found;
    let errors = |e: &PlaceErrors| json!({ "median_m": e.median_m, "mean_m": e.mean_m });
    let point = |p: &CurvePoint| {
        json!({
            "learnt": p.learnt,
            "earlier": p.earlier,
            "tested": p.tested,
            "places_by": p.places_by,
            "place": errors(&p.place),
            "force_error": p.force.map(|[median, p90]| json!({ "median": median, "p90": p90 })),
            "time_s": p.time_s,
        })
    };
    json!({
        "presses": learned.presses.places_m.len(),
        "measurements": learned.channels.len(),
        "places_by": learned.places_by,
        "errors": {
            "model": learned.errors.model.as_ref().map(errors),
            "map": errors(&learned.errors.map),
            "regression": errors(&learned.errors.regression),
        },
        "frame": {
            "turn_rad": learned.pose.turn_rad,
            "is_mirrored": learned.pose.is_mirrored,
            "scale": learned.pose.scale,
            "shift_m": learned.pose.shift_m,
            "sign": learned.sign,
        },
        "force": learned.force.as_ref().map(|force| json!({
            "learnt_n": force.curve.forces_n,
            "relative_error": force.curve.error_ln,
            "strength_by": force.strength_by,
        })),
        "learning_curve": curve.iter().map(point).collect::<Vec<_>>(),
        "notes": notes,
        "stages": progress.times(),
        "out": args.out.display().to_string(),
        "curve": outputs::beside(&args.out, "csv").display().to_string(),
    })
}
