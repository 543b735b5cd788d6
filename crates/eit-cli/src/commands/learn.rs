//! `eit learn`: place and force of touches from presses at known places.

use super::Answer;
use crate::cli::LearnArgs;
use crate::error::CliError;
use crate::progress;
use eit_picture::{Plot, Series, draw_plot};
use eit_report::output::{OutFile, io};
use eit_skin::learn::{
    CurvePoint, Frame, LearnedSkin, PlaceErrors, PressFrames, PressTable, learning_curve,
};
use eit_skin::scene::{Reference, Scene};
use eit_skin::{MeshOverride, Skin};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// Reads table and frames, learns, writes the file and the learning curve.
pub(crate) fn run(args: &LearnArgs) -> Result<Answer, CliError> {
    let mut scene = Scene::load(&args.scene)?;
    // what was learnt before is no part of what is learnt now
    scene.touch.learned = None;
    super::check_ending(&args.out, &["learned"])?;
    let table = PressTable::read(&args.presses)?;
    let earlier = args.with.as_deref().map(LearnedSkin::read).transpose()?;
    let out = OutFile::new(&args.out)?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let linearised = Arc::new(skin.linearise(&mut progress)?);
    let reference = reference(args, &scene, &table);
    let frames =
        progress.stage("read frames", || skin.read_frames(&args.frames, reference.as_ref()))?;
    let notes = frames.notes.clone();
    let fitted = linearised.fit(frames)?;
    let pressed = PressFrames::new(&table, &fitted.frames)?;
    let frame = if args.fit_frame { Frame::Fitted } else { Frame::Scene };
    let learned = LearnedSkin::learn(&fitted, &pressed, frame, earlier.as_ref(), &mut progress)?;
    let curve = learning_curve(&fitted, &pressed, frame, &mut progress)?;
    let bytes = learned.to_bytes()?;
    out.write(|w| w.write_all(&bytes).map_err(io))?;
    write_curve(&args.out, &learned, &curve)?;
    let json = to_json(args, &learned, &curve, &notes, &progress);
    Ok(Answer { text: text(args, &learned, &curve, &notes), json })
}

/// What is subtracted; any frame will do where every press has its own.
fn reference(args: &LearnArgs, scene: &Scene, table: &PressTable) -> Option<Reference> {
    let own = table.presses.iter().all(|press| press.before_first.is_some());
    let any = (own && scene.recording.reference.is_none()).then(|| "mean".to_owned());
    args.reference.clone().or(any).map(Reference::Text)
}

fn mm(errors: &PlaceErrors) -> String {
    format!("{:.1} mm in the median, {:.1} in the mean", 1e3 * errors.median_m, 1e3 * errors.mean_m)
}

fn text(args: &LearnArgs, learned: &LearnedSkin, curve: &[CurvePoint], notes: &[String]) -> String {
    let presses = learned.presses.places_m.len();
    let mut lines =
        vec![format!("{presses} presses; places are taken from {}", learned.places_by.words())];
    if let Some(model) = &learned.errors.model {
        lines.push(format!("the model alone errs by {}", mm(model)));
    }
    lines.push(format!(
        "with a learnt correction, presses held out one by one or a tenth at a time: {}",
        mm(&learned.errors.map)
    ));
    lines.push(format!(
        "regression from frames to places, presses held out one by one: {}",
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
            "force: {:.2} to {:.2} N were learnt, held out one by one to {:.0} %",
            force.curve.forces_n[0],
            force.curve.forces_n[1],
            100.0 * force.curve.error_ln
        ),
        None => "no force: at least three presses must state force_n".to_owned(),
    });
    for point in curve {
        lines.push(format!(
            "the first {} presses in time, tested on the {} after them: {}{}",
            point.learnt,
            point.tested,
            mm(&point.place),
            point.force.map_or(String::new(), |[median, high]| format!(
                "; force to {:.0} % in the median, {:.0} % in 90 % of them",
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

fn to_json(
    args: &LearnArgs,
    learned: &LearnedSkin,
    curve: &[CurvePoint],
    notes: &[String],
    progress: &eit_skin::Progress,
) -> Value {
    let errors = |e: &PlaceErrors| json!({ "median_m": e.median_m, "mean_m": e.mean_m });
    let point = |p: &CurvePoint| {
        json!({
            "learnt": p.learnt,
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
    })
}

/// Writes `csv`, and `png` where there is a point, beside the file.
fn write_curve(out: &Path, learned: &LearnedSkin, curve: &[CurvePoint]) -> Result<(), CliError> {
    OutFile::new(&out.with_extension("csv"))?.write(|w| {
        writeln!(w, "learnt,tested,places_by,median_m,mean_m,force_median,force_p90,time_s")
            .map_err(io)?;
        for CurvePoint { learnt, tested, places_by, place, force, time_s } in curve {
            let [median, p90] = match force {
                Some(parts) => parts.map(|part| format!("{part:.4}")),
                None => [String::new(), String::new()],
            };
            let by = format!("{places_by:?}").to_lowercase();
            let (m, a) = (place.median_m, place.mean_m);
            writeln!(w, "{learnt},{tested},{by},{m:.6},{a:.6},{median},{p90},{time_s:.3}")
                .map_err(io)?;
        }
        Ok(())
    })?;
    if curve.is_empty() {
        return Ok(());
    }
    let line = |name: &str, value: &dyn Fn(&CurvePoint) -> f64| Series {
        name: name.to_owned(),
        points: curve.iter().map(|p| [p.learnt as f64, 1e3 * value(p)]).collect(),
        line: true,
        markers: true,
    };
    let mut series = vec![line("median", &|p| p.place.median_m), line("mean", &|p| p.place.mean_m)];
    if let Some(model) = &learned.errors.model {
        let ends = [curve.first(), curve.last()].map(|p| p.map_or(0.0, |p| p.learnt as f64));
        let points = ends.map(|x| [x, 1e3 * model.median_m]).to_vec();
        let name = "model alone, median".to_owned();
        series.push(Series { name, points, line: true, markers: false });
    }
    let picture = draw_plot(&Plot {
        title: "Place by what was learnt".to_owned(),
        footnote: "learnt from the first presses in time, tested on all after them".to_owned(),
        x_label: "presses learnt from".to_owned(),
        y_label: "error, mm".to_owned(),
        x_log: true,
        y_log: true,
        series,
        zoom: 2,
    })?;
    OutFile::new(&out.with_extension("png"))?.write(|w| Ok(picture.write_png(w)?))?;
    Ok(())
}
