//! `eit simulate`: writes frames of the simulated fabric, with their truth and a scene for
//! reconstruction.

use crate::Answer;
use crate::error::ReportError;
use crate::output::ending;
use crate::output::{OutFile, OutFolder, io, write_csv, write_npy};
use crate::settings::SimulateSettings;
use eit_fem::fabric::{PlayCircle, Simulation, SimulationSettings, TouchScript, TrueQuality};
use eit_mesh::{Mesh, Raster};
use eit_picture::{FrameLabels, PictureSettings, draw_sheet, write_gif};
use eit_skin::scene::{Scene, Shape, from_toml};
use eit_skin::{MeshOverride, Progress, Skin, check_images, rounding_warning};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// Nodes of the simulation mesh: 3.5 times those of the reconstruction mesh.
const NODES: usize = 7000;
/// Files that a run may omit.
const OPTIONAL: [&str; 1] = ["truth.gif"];

/// Where to write results.
enum Out {
    Folder(OutFolder),
    Frames(OutFile, String),
}

/// Runs a simulation and writes its results.
///
/// # Errors
///
/// A scene or script that is invalid, frames that are too few, and an output folder that cannot be written.
pub fn run(args: &SimulateSettings, progress: &mut Progress) -> Result<Answer, ReportError> {
    let scene = Scene::load(&args.scene)?;
    let file = script_file(&args.script)?;
    let format = ending(&args.out);
    let mut out = match format.as_str() {
        "npy" | "csv" => Out::Frames(OutFile::new(&args.out)?, format),
        _ => Out::Folder(OutFolder::new(&args.out)?),
    };
    let nodes = match scene.skin.shape {
        Shape::Mesh => args.nodes,
        _ => Some(args.nodes.unwrap_or(NODES)),
    };
    let skin = Skin::set_up(&scene, &MeshOverride { file: None, nodes }, progress)?;
    let script = script(args, file, &skin.mesh)?;
    check_images(2 * script.frames, skin.pixels())?;
    let raster = skin.raster(progress)?;
    let threads = match args.threads {
        Some(threads) => threads,
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let how = SimulationSettings { seed: args.seed, threads, keep_elements: false };
    let fabric = skin.simulated_fabric()?;
    let made = progress.steps("simulate", script.frames, |bar| {
        fabric.simulate(&script, &raster, &how, &mut |done| bar.set_position(done))
    });
    let made = made.map_err(|e| ReportError::from(e).within(&args.script))?;
    let note = rounding_warning(&made.report.untouched)?;
    let what =
        Made { scene: &scene, script: &script, mesh: &skin.mesh, raster: &raster, made: &made };
    if let Out::Folder(folder) = &mut out {
        what.write_numbers(folder)?;
        what.write_texts(folder)?;
        what.write_pictures(folder, progress)?;
    }
    let mut json = what.report(args.seed, progress);
    json["warning"] = json!(note);
    json["out"] = json!(args.out.display().to_string());
    let mut text = what.text(&args.out);
    match out {
        Out::Folder(mut folder) => {
            let mut files = folder.names();
            files.push("report.json");
            json["files"] = json!(files);
            folder.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
            folder.commit(&OPTIONAL)?;
            let scene = args.out.join("scene.toml");
            text += &format!("\nnext: eit reconstruct {} --out images", pasted(&scene));
        }
        Out::Frames(file, format) => file.write(|w| match format.as_str() {
            "npy" => write_npy(&made.frames_v, w),
            _ => write_csv(made.frames_v.view(), w),
        })?,
    }
    Ok(Answer { text: crate::with_warning(text, note.as_ref()), json })
}

/// A path as it can be pasted into a shell.
pub fn pasted(path: impl AsRef<Path>) -> String {
    let text = path.as_ref().display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:\\".contains(c);
    match text.chars().all(is_plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

/// Reads the script from a file; `None` for the name of a built-in one, which needs the mesh.
fn script_file(name: &str) -> Result<Option<TouchScript>, ReportError> {
    let path = Path::new(name);
    if ending(path) == "toml" {
        let text = eit_skin::scene::read_settings(path)
            .map_err(|error| ReportError::input(error.to_string()))?;
        return Ok(Some(from_toml(&text, name)?));
    }
    if TouchScript::BUILT_IN.contains(&name) {
        return Ok(None);
    }
    let known = TouchScript::BUILT_IN.join(", ");
    Err(ReportError::input(format!(
        "--script {name}: no such script; known scripts are {known}; or give a file F.toml"
    )))
}

/// Returns the script to run, checked against its skin.
fn script(
    args: &SimulateSettings,
    file: Option<TouchScript>,
    mesh: &Mesh,
) -> Result<TouchScript, ReportError> {
    let mut script = match file {
        Some(script) => script,
        None => TouchScript::built_in(&args.script, &PlayCircle::of(mesh), args.seed)?,
    };
    if let Some(frames) = args.frames {
        let quiet = script.quiet_frames;
        if frames <= quiet && script.frames > quiet {
            return Err(ReportError::input(format!(
                "--frames {frames}: the script {} begins with {quiet} frames of the untouched skin: give more",
                args.script
            )));
        }
        script.frames = script.frames.min(frames);
    }
    script.validate(mesh).map_err(|e| ReportError::from(e).within(&args.script))?;
    Ok(script)
}

/// A simulation and its input.
struct Made<'a> {
    scene: &'a Scene,
    script: &'a TouchScript,
    mesh: &'a Mesh,
    raster: &'a Raster,
    made: &'a Simulation,
}

impl Made<'_> {
    fn write_numbers(&self, out: &mut OutFolder) -> Result<(), ReportError> {
        let Simulation { frames_v, exact_v, reference_v, truth, .. } = self.made;
        out.write("frames.npy", |w| write_npy(frames_v, w))?;
        out.write("exact.npy", |w| write_npy(exact_v, w))?;
        out.write("reference.npy", |w| write_npy(reference_v, w))?;
        out.write("noise_std.npy", |w| write_npy(&truth.noise_std_v, w))?;
        out.write("truth_pressure.npy", |w| write_npy(&truth.pressure_pa, w))?;
        out.write("truth_conductivity.npy", |w| write_npy(&truth.conductivity_change_s, w))?;
        out.write("truth_electrode_shift.npy", |w| write_npy(&truth.electrode_shift_m, w))?;
        out.write("truth_contact_impedance.npy", |w| write_npy(&truth.contact_impedance, w))?;
        let codes = truth.quality.mapv(|q| f64::from(q.code()));
        out.write("truth_quality.npy", |w| write_npy(&codes, w))
    }

    fn write_texts(&self, out: &mut OutFolder) -> Result<(), ReportError> {
        out.write("touches.csv", |w| self.write_touches(w))?;
        let failed = |e: toml::ser::Error| ReportError::Failure(format!("writing failed: {e}"));
        let script = toml::to_string(self.script).map_err(failed)?;
        out.write("script.toml", |w| w.write_all(script.as_bytes()).map_err(io))?;
        let scene = toml::to_string(&self.scene_table()?).map_err(failed)?;
        out.write("scene.toml", |w| {
            writeln!(w, "# {} with the frames of script \"{}\"", self.scene.name, self.script.name)
                .and_then(|()| w.write_all(scene.as_bytes()))
                .map_err(io)
        })
    }

    fn write_touches(&self, w: &mut dyn Write) -> Result<(), ReportError> {
        writeln!(
            w,
            "frame,time_s,finger,x_m,y_m,force_n,tip_radius_m,contact_radius_m,area_m2,depth_m"
        )
        .map_err(io)?;
        for touch in &self.made.truth.touches {
            let time_s = touch.frame as f64 / self.script.frame_rate_hz;
            let [x_m, y_m] = touch.position_m;
            writeln!(
                w,
                "{},{time_s},{},{x_m:e},{y_m:e},{:e},{:e},{:e},{:e},{:e}",
                touch.frame,
                touch.finger,
                touch.force_n,
                touch.tip_radius_m,
                touch.contact_radius_m,
                touch.area_m2,
                touch.depth_m
            )
            .map_err(io)?;
        }
        Ok(())
    }

    /// Returns the scene with this recording: reference and noise from the quiet frames, files of
    /// the scene with their full paths.
    fn scene_table(&self) -> Result<toml::Table, ReportError> {
        let mut table: toml::Table =
            from_toml(&Scene::text(&self.scene.place)?, &self.scene.place)?;
        for (section, key) in [
            ("skin", "file"),
            ("protocol", "quadruples_file"),
            ("protocol", "stimulation_file"),
            ("protocol", "measurement_file"),
        ] {
            let found = table.get_mut(section).and_then(|s| s.get_mut(key));
            if let Some(toml::Value::String(file)) = found {
                let path = self.scene.resolve(Path::new(file.as_str()));
                let full = std::path::absolute(&path).map_err(|e| ReportError::at(&path, e))?;
                *file = full.display().to_string();
            }
        }
        let mut recording = toml::Table::new();
        recording.insert("file".to_owned(), "frames.npy".into());
        recording.insert("frame_rate_hz".to_owned(), self.script.frame_rate_hz.into());
        let quiet = self.script.quiet_frames as i64;
        let mut noise = toml::Table::new();
        if quiet >= 3 {
            recording.insert("reference".to_owned(), format!("0..{quiet}").into());
            noise.insert("quiet_frames".to_owned(), format!("0..{quiet}").into());
        } else {
            recording.insert("reference".to_owned(), 0.into());
        }
        table.insert("recording".to_owned(), recording.into());
        table.insert("noise".to_owned(), noise.into());
        Ok(table)
    }

    fn write_pictures(
        &self,
        out: &mut OutFolder,
        progress: &mut Progress,
    ) -> Result<(), ReportError> {
        let rate_hz = self.script.frame_rate_hz;
        let settings = PictureSettings {
            title: format!("{}: {}, truth", self.scene.name, self.script.name),
            footnote: "true change of the sheet conductivity relative to the untouched skin"
                .to_owned(),
            labels: FrameLabels::Time { rate_hz },
            ..Default::default()
        };
        let skin = eit_picture::SkinDrawing::from_raster(self.mesh, self.raster);
        let images = self.made.truth.conductivity_change_s.view();
        let sheet = progress.stage("sheet", || draw_sheet(images, &skin, &settings))?;
        out.write("truth.png", |w| Ok(sheet.write_png(w)?))?;
        if self.script.frames > 1 {
            progress.steps("movie", self.script.frames, |bar| {
                out.write("truth.gif", |w| {
                    let mut tick = |done: usize, _: usize| bar.set_position(done);
                    Ok(write_gif(images, &skin, &settings, rate_hz, w, &mut tick)?)
                })
            })?;
        }
        Ok(())
    }

    /// Largest electrode displacement in the plane of the skin, metres.
    fn largest_shift_m(&self) -> f64 {
        let shifts = self.made.truth.electrode_shift_m.rows().into_iter();
        shifts.map(|s| s[0].hypot(s[1])).fold(0.0, f64::max)
    }

    fn report(&self, seed: u64, progress: &Progress) -> Value {
        let (report, truth) = (&self.made.report, &self.made.truth);
        let bad = |wanted| truth.quality.iter().filter(|q| **q == wanted).count();
        json!({
            "scene": self.scene.name,
            "script": self.script.name,
            "seed": seed,
            "frames": report.frames,
            "quiet_frames": self.script.quiet_frames,
            "frame_rate_hz": self.script.frame_rate_hz,
            "measurements": self.made.reference_v.len(),
            "touches": truth.touches.len(),
            "mesh": {
                "nodes": self.mesh.surface().nodes().len(),
                "elements": self.mesh.surface().triangles().len(),
            },
            "pixels": self.raster.pixels(),
            "extent_m": self.raster.extent_m(),
            "largest_electrode_shift_m": self.largest_shift_m(),
            "least_area_ratio": report.least_area_ratio,
            "converter_range_v": report.range_v,
            "noise_std_v": truth.noise_std_v.iter().fold(0.0_f64, |m, s| m.max(*s)),
            "bad_values": {
                "source_limited": bad(TrueQuality::SourceLimited),
                "saturated": bad(TrueQuality::Saturated),
                "loose": bad(TrueQuality::Loose),
                "lost": bad(TrueQuality::Lost),
                "torn": bad(TrueQuality::Torn),
                "spiked": bad(TrueQuality::Spiked),
            },
            "untouched_solve": crate::reconstruct::solve_json(&report.untouched),
            "threads": report.threads,
            "time_s": report.time_s,
            "frames_per_s": report.frames as f64 / report.time_s,
            "stages": progress.times(),
        })
    }

    fn text(&self, out: &Path) -> String {
        let report = &self.made.report;
        format!(
            "{} frames of {} measurements, script {}, on {} nodes; {:.0} frames per second on {} \
             threads\nelectrodes moved by up to {:.2} mm in the plane\nwritten to {}",
            report.frames,
            self.made.reference_v.len(),
            self.script.name,
            self.mesh.surface().nodes().len(),
            report.frames as f64 / report.time_s,
            report.threads,
            1e3 * self.largest_shift_m(),
            out.display()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_quoted_where_a_shell_needs_it() {
        assert_eq!(pasted(Path::new("out/scene.toml")), "out/scene.toml");
        assert_eq!(pasted(Path::new("six \u{fc}/scene.toml")), "'six \u{fc}/scene.toml'");
        assert_eq!(pasted(Path::new("it's")), r"'it'\''s'");
    }
}
