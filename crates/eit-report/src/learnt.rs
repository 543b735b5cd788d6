//! Learning from presses at known places, and the files and the answer of it.

use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFile, axes, io};
use eit_picture::{Plot, Series, draw_plot};
use eit_skin::learn::{
    CurvePoint, Frame, HeldOut, LearnedSkin, Learning, PlaceErrors, PressFrames, learning_curve,
};
use eit_skin::text::counted;
use eit_skin::{FittedFrames, Progress};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// What is learnt from, however it was collected.
#[derive(Debug)]
pub struct Presses<'a> {
    /// Frames of the presses.
    pub fitted: &'a FittedFrames,
    /// The presses.
    pub pressed: &'a PressFrames,
    /// Coordinates of the places.
    pub frame: Frame,
    /// What was learnt before.
    pub earlier: Option<&'a LearnedSkin>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Files of what is learnt and of its learning curve, reserved before any work.
#[derive(Debug)]
pub struct LearnFiles {
    out: PathBuf,
    learned: OutFile,
    csv: OutFile,
    png: OutFile,
}

/// What was learnt.
struct Found {
    learning: Learning,
    curve: Vec<CurvePoint>,
    notes: Vec<String>,
}

/// File name of the curve: skin.curve.csv for skin.learned.
fn beside(out: &Path, ending: &str) -> PathBuf {
    out.with_extension(format!("curve.{ending}"))
}

impl LearnFiles {
    /// Reserves the files. `inputs` are files that are read, with their roles.
    ///
    /// # Errors
    ///
    /// An output that is also an input, and a folder that cannot be written.
    pub fn new(out: &Path, inputs: &[(&str, PathBuf)]) -> Result<Self, ReportError> {
        let outs = [out.to_path_buf(), beside(out, "csv"), beside(out, "png")];
        for (what, input) in inputs {
            let same = outs.iter().find(|out| {
                let [one, other] = [*out, input].map(|path| path.canonicalize());
                matches!((one, other), (Ok(one), Ok(other)) if one == other)
            });
            if let Some(same) = same {
                let (same, input) = (same.display(), input.display());
                return Err(ReportError::input(format!(
                    "{same}: --out would overwrite {what} {input}: name another file with --out"
                )));
            }
        }
        let [learned, csv, png] = outs.each_ref().map(OutFile::new);
        Ok(Self { out: out.to_path_buf(), learned: learned?, csv: csv?, png: png? })
    }

    /// Learns, and writes what was learnt and the learning curve; a curve without points gets no picture.
    ///
    /// # Errors
    ///
    /// Presses from which nothing can be learnt, and a disk that is full.
    pub fn learn(
        self,
        presses: Presses<'_>,
        progress: &mut Progress,
    ) -> Result<Answer, ReportError> {
        let Presses { fitted, pressed, frame, earlier, mut notes } = presses;
        let learning = LearnedSkin::learn(fitted, pressed, frame, earlier, progress)?;
        let curve = learning_curve(fitted, pressed, frame, earlier, progress)?;
        notes.extend(self::notes(&learning, pressed));
        let bytes = learning.skin.to_bytes()?;
        self.learned.write(|w| w.write_all(&bytes).map_err(io))?;
        self.csv.write(|w| write_csv(w, &curve).map_err(io))?;
        if curve.iter().any(|point| point.place.mean_m > 0.0) {
            let picture = draw_plot(&plot(&learning.skin, &curve))?;
            self.png.write(|w| Ok(picture.write_png(w)?))?;
        }
        Ok(answer(&self.out, &Found { learning, curve, notes }, progress))
    }
}

fn write_csv(w: &mut dyn Write, curve: &[CurvePoint]) -> std::io::Result<()> {
    writeln!(
        w,
        "learnt,earlier,tested,places_by,shown,median_m,mean_m,beside,ghosts,force_median,force_p90,time_s"
    )?;
    for point in curve {
        let CurvePoint { learnt, earlier, tested, places_by, place, force, time_s, .. } = point;
        let ([beside, ghosts], shown) = (point.ghosts, point.shown);
        let force = force.map(|parts| parts.map(|part| format!("{part:.4}")));
        let [median, p90] = force.unwrap_or_default();
        let by = format!("{places_by:?}").to_lowercase();
        let (m, a) = (place.median_m, place.mean_m);
        writeln!(
            w,
            "{learnt},{earlier},{tested},{by},{shown:.4},{m:.6},{a:.6},{beside:.4},{ghosts:.4},{median},{p90},{time_s:.3}"
        )?;
    }
    Ok(())
}

fn plot(learned: &LearnedSkin, curve: &[CurvePoint]) -> Plot {
    let line = |name: &str, value: &dyn Fn(&CurvePoint) -> f64| Series {
        name: name.to_owned(),
        points: curve.iter().map(|p| [p.learnt as f64, 1e3 * value(p)]).collect(),
        line: true,
        markers: true,
    };
    let mut series = vec![line("median", &|p| p.place.median_m), line("mean", &|p| p.place.mean_m)];
    if let Some(model) = &learned.held_out.model {
        let alone = line("model alone, median", &|_| model.median_m);
        series.push(Series { markers: false, ..alone });
    }
    Plot {
        title: "Position error after learning".to_owned(),
        footnote: "the first presses are learnt, up to a hundred later ones tested".to_owned(),
        series,
        ..axes([("presses learnt", true), ("error, mm", true)])
    }
}

/// Notes about presses that should be checked: one of each kind, with the worst press and their number.
fn notes(learning: &Learning, pressed: &PressFrames) -> Vec<String> {
    let more = |count: usize| match count - 1 {
        0 => String::new(),
        more => format!(" (and {} with less or as much)", counted(more as u64, "press", "presses")),
    };
    let worst = learning.unlike.iter().max_by(|one, other| one.rest.total_cmp(&other.rest));
    let unlike = worst.map(|worst| {
        format!(
            "{}: judging by the other presses, no touch anywhere explains {:.0} % of its change{}: was the skin pressed \
             at this place, and only there? Such a press is learnt all the same",
            pressed.name(worst.press),
            100.0 * worst.rest,
            more(learning.unlike.len())
        )
    });
    let forces = learning.without_touch.first().map(|&press| {
        let (press, count) = (pressed.name(press), learning.without_touch.len());
        let all = if count > 1 { format!(" and {} more", count - 1) } else { String::new() };
        format!("{press}{all}: no touch was found in its frames, so its force is not learnt")
    });
    unlike.into_iter().chain(forces).collect()
}

/// The answer as text and as JSON.
fn answer(out: &Path, found: &Found, progress: &Progress) -> Answer {
    let Found { learning: Learning { skin: learned, without_touch, .. }, curve, notes, .. } = found;
    let presses = learned.presses.places_m.len();
    let HeldOut { model, presses: by_presses, shown, middle, false_touches } = learned.held_out;
    let mut lines = vec![format!(
        "{presses} presses; touches are found by {}",
        learned.places_by.description()
    )];
    let [false_touches, steps] = false_touches;
    lines.push(format!(
        "presses that are held out: {:.0} % are shown by what the others have taught, and a touch in {false_touches} of \
         {steps} changes of the untouched skin",
        100.0 * shown
    ));
    let unshown = "one that is not shown counts as the skin's radius";
    lines.push(format!("their error: {}; {unshown}", mm(&by_presses)));
    lines.extend(model.map(|model| format!("error of the model alone: {}; {unshown}", mm(&model))));
    lines.push(format!("error of the middle of the others: {}", mm(&middle)));
    if learned.frame == Frame::Fitted {
        let [x_m, y_m, _] = learned.shift_m;
        lines.push(format!(
            "touches are in the table's coordinates, shifted by {x_m:.4} and {y_m:.4} m so that the middle of the \
             presses is that of the scene's skin"
        ));
    }
    lines.push(force(learned, without_touch.len()));
    lines.extend(curve.iter().map(tested));
    lines.extend(notes.iter().map(|note| format!("note: {note}")));
    let place = out.display();
    lines.push(format!("written to {place}; for the scene:\n  [touch] learned = \"{place}\""));
    Answer { text: lines.join("\n"), json: json(out, found, progress) }
}

fn mm(errors: &PlaceErrors) -> String {
    format!("{:.1} mm (median), {:.1} mm (mean)", 1e3 * errors.median_m, 1e3 * errors.mean_m)
}

/// Which forces were learnt, or why none.
fn force(learned: &LearnedSkin, without_touch: usize) -> String {
    if let Some(force) = &learned.force {
        let ([from, to], percent) = (force.forces_n, 100.0 * force.error_ln);
        return format!(
            "force: {from:.2} to {to:.2} N were learnt; error of presses held out singly {percent:.0} %"
        );
    }
    let stated = learned.forces_n.iter().flatten().count();
    let found = match without_touch {
        0 => String::new(),
        _ => format!(" and a touch was found in {} of them,", stated.saturating_sub(without_touch)),
    };
    format!("no force: {stated} presses state force_n,{found} but three are needed")
}

/// A point of the learning curve.
fn tested(point: &CurvePoint) -> String {
    let learnt = match (point.earlier, point.learnt - point.earlier) {
        (0, new) => format!("the first {new} presses"),
        (earlier, 0) => format!("the {earlier} presses of the earlier file alone"),
        (earlier, new) => format!("the {earlier} earlier presses and the first {new} new ones"),
    };
    let force = point.force.map_or(String::new(), |force| {
        let [median, high] = force.map(|part| 100.0 * part);
        format!("; force error {median:.0} % (median), {high:.0} % (90 % quantile)")
    });
    let (tested, shown) = (point.tested, 100.0 * point.shown);
    let place = if point.shown > 0.0 { format!(", {}", mm(&point.place)) } else { String::new() };
    let [beside, ghosts] = point.ghosts;
    let more = match beside + ghosts > 0.0 {
        true => {
            format!("; false touches a frame: {beside:.3} beside a press, {ghosts:.3} without one")
        }
        false => String::new(),
    };
    format!("{learnt}, touch list of {tested} after them: {shown:.0} % shown{place}{more}{force}")
}

fn json(out: &Path, found: &Found, progress: &Progress) -> Value {
    let Found { learning: Learning { skin: learned, .. }, curve, notes, .. } = found;
    let point = |p: &CurvePoint| {
        json!({
            "learnt": p.learnt,
            "earlier": p.earlier,
            "tested": p.tested,
            "places_by": p.places_by,
            "shown": p.shown,
            "place": p.place,
            "false_touches": { "beside": p.ghosts[0], "untouched": p.ghosts[1] },
            "force_error": p.force.map(|[median, p90]| json!({ "median": median, "p90": p90 })),
            "time_s": p.time_s,
        })
    };
    json!({
        "presses": learned.presses.places_m.len(),
        "measurements": learned.channels.len(),
        "places_by": learned.places_by,
        "held_out": learned.held_out,
        "frame": {
            "shift_m": learned.shift_m,
            "sign": learned.orientation.sign,
        },
        "force": learned.force.as_ref().map(|force| json!({
            "learnt_n": force.forces_n,
            "relative_error": force.error_ln,
        })),
        "learning_curve": curve.iter().map(point).collect::<Vec<_>>(),
        "notes": notes,
        "stages": progress.times(),
        "out": out.display().to_string(),
        "curve": beside(out, "csv").display().to_string(),
    })
}
