//! `eit simulate`: writes frames of the simulated fabric, with their truth and a scene for
//! reconstruction.

use crate::Answer;
use crate::error::ReportError;
use crate::output::ending;
use crate::output::{OutFile, OutFolder, io, write_csv, write_npy};
use crate::settings::SimulationFiles;
use eit_fem::fabric::{Simulation, TrueQuality};
use eit_picture::{FrameLabels, PictureSettings, draw_sheet, write_gif};
use eit_skin::Progress;
use eit_skin::scene::{Reference, Scene, from_toml};
use eit_skin::simulate::SimulatedRecording;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

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
pub fn run(args: &SimulationFiles, progress: &mut Progress) -> Result<Answer, ReportError> {
    let scene = Scene::load(&args.scene)?;
    let format = ending(&args.out);
    let mut out = match format.as_str() {
        "npy" | "csv" => Out::Frames(OutFile::new(&args.out)?, format),
        _ => Out::Folder(OutFolder::new(&args.out)?),
    };
    let recording = SimulatedRecording::run(&scene, &args.simulation, progress)?;
    let (made, note) = (&recording.simulation, &recording.warning);
    let what = Made { scene: &scene, recording: &recording };
    if let Out::Folder(folder) = &mut out {
        what.write_numbers(folder)?;
        what.write_texts(folder)?;
        what.write_pictures(folder, progress)?;
    }
    let mut json = what.report(args.simulation.seed, progress);
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
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

/// A simulation and its input.
struct Made<'a> {
    scene: &'a Scene,
    recording: &'a SimulatedRecording,
}

impl Made<'_> {
    fn write_numbers(&self, out: &mut OutFolder) -> Result<(), ReportError> {
        let Simulation { frames_v, exact_v, reference_v, truth, .. } = &self.recording.simulation;
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
        let script = toml::to_string(&self.recording.script).map_err(failed)?;
        out.write("script.toml", |w| w.write_all(script.as_bytes()).map_err(io))?;
        let scene = toml::to_string(&self.scene_table()?).map_err(failed)?;
        out.write("scene.toml", |w| {
            writeln!(
                w,
                "# {} with the frames of script \"{}\"",
                self.scene.name, self.recording.script.name
            )
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
        for touch in &self.recording.simulation.truth.touches {
            let time_s = touch.frame as f64 / self.recording.script.frame_rate_hz;
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
        recording.insert("frame_rate_hz".to_owned(), self.recording.script.frame_rate_hz.into());
        let reference = match self.recording.reference() {
            Reference::Frame(frame) => (frame as i64).into(),
            Reference::Text(frames) => frames.into(),
        };
        recording.insert("reference".to_owned(), reference);
        let mut noise = toml::Table::new();
        if let Some(quiet) = self.recording.quiet_frames() {
            noise.insert("quiet_frames".to_owned(), quiet.to_string().into());
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
        let rate_hz = self.recording.script.frame_rate_hz;
        let settings = PictureSettings {
            title: format!("{}: {}, truth", self.scene.name, self.recording.script.name),
            footnote: "true change of the sheet conductivity relative to the untouched skin"
                .to_owned(),
            labels: FrameLabels::Time { rate_hz },
            ..Default::default()
        };
        let skin = eit_picture::SkinDrawing::from_raster(
            &self.recording.skin.mesh,
            &self.recording.raster,
        );
        let images = self.recording.simulation.truth.conductivity_change_s.view();
        let sheet = progress.stage("sheet", || draw_sheet(images, &skin, &settings))?;
        out.write("truth.png", |w| Ok(sheet.write_png(w)?))?;
        if self.recording.script.frames > 1 {
            progress.steps("movie", self.recording.script.frames, |bar| {
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
        let shifts = self.recording.simulation.truth.electrode_shift_m.rows().into_iter();
        shifts.map(|s| s[0].hypot(s[1])).fold(0.0, f64::max)
    }

    fn report(&self, seed: u64, progress: &Progress) -> Value {
        let (report, truth) = (&self.recording.simulation.report, &self.recording.simulation.truth);
        let bad = |wanted| truth.quality.iter().filter(|q| **q == wanted).count();
        json!({
            "scene": self.scene.name,
            "script": self.recording.script.name,
            "seed": seed,
            "frames": report.frames,
            "quiet_frames": self.recording.script.quiet_frames,
            "frame_rate_hz": self.recording.script.frame_rate_hz,
            "measurements": self.recording.simulation.reference_v.len(),
            "touches": truth.touches.len(),
            "mesh": {
                "nodes": self.recording.skin.mesh.surface().nodes().len(),
                "elements": self.recording.skin.mesh.surface().triangles().len(),
            },
            "pixels": self.recording.raster.pixels(),
            "extent_m": self.recording.raster.extent_m(),
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
        let report = &self.recording.simulation.report;
        format!(
            "{} frames of {} measurements, script {}, on {} nodes; {:.0} frames per second on {} \
             threads\nelectrodes moved by up to {:.2} mm in the plane\nwritten to {}",
            report.frames,
            self.recording.simulation.reference_v.len(),
            self.recording.script.name,
            self.recording.skin.mesh.surface().nodes().len(),
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
