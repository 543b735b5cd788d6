//! What `eit report` measured on the built-in scenes: what plans expect of others.
//!
//! `measured.csv` is the `inverse.csv` of a full run (`eit report`); nothing in it is written by
//! hand. A scene is told by the built-in one that is most like it, and says which that is.

use crate::error::CliError;
use crate::machine::Machine;
use crate::method::Method;
use crate::pipeline::{DEFAULT_PIXELS, Setup};
use crate::scene::{Hyperparameter, OneOrMany, Rule, Scene};
use serde::Deserialize;

const TABLE: &str = include_str!("measured.csv");

/// Where contact impedances lie so far apart, scenes are like `stiff-contact`.
const STIFF: f64 = 1e4;
/// Where the conductivity may rise by so many times itself, they are like `high-contrast`.
const HIGH: f64 = 3.0;
/// From so many electrodes on they are like `general-32`, as those with general currents are.
const MANY: usize = 24;
/// Halfway between the paper's skin with a poor and with a good instrument, decibel.
const POOR_DB: f64 = 50.0;

/// One setting of a solver on a built-in scene.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Measured {
    pub scene: String,
    pub solver: String,
    /// None: on the elements of the mesh.
    pub pixels: Option<usize>,
    pub target_gap: Option<f64>,
    /// Gives a frame's image before the next frame comes.
    pub live: bool,
    pub relative_error: f64,
    pub ms_a_frame: f64,
    pub iterations: f64,
    pub choice_s: f64,
    /// Rate of a dense product where it was measured.
    pub machine_gflops: f64,
}

/// The table, and the part of it that tells a scene.
pub(crate) struct Table {
    rows: Vec<Measured>,
}

/// The built-in scene that is most like another, and why.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Nearest {
    pub scene: &'static str,
    pub why: String,
}

impl Table {
    /// Reads what comes with the program.
    pub fn load() -> Result<Self, CliError> {
        let mut reader = csv::Reader::from_reader(TABLE.as_bytes());
        let rows: Result<Vec<Measured>, csv::Error> = reader.deserialize().collect();
        let rows = rows.map_err(|e| CliError::Failure(format!("measured.csv: {e}")))?;
        Ok(Self { rows })
    }

    /// What was measured of a method on a scene, at the nearest number of pixels and gap; with
    /// `bounded`, of the variant that knows that touches only raise the conductivity.
    pub fn of(
        &self,
        scene: &str,
        (method, bounded): (Method, bool),
        (pixels, gap): (usize, f64),
    ) -> Option<&Measured> {
        let never_below = format!("{} ≥ 0", method.name());
        let [first, second] = match bounded {
            true => [never_below.as_str(), method.name()],
            false => [method.name(), never_below.as_str()],
        };
        let distance = |row: &Measured| {
            let far = |a: f64, b: f64| (a / b).ln().abs();
            row.pixels.map_or(0.0, |own| 10.0 * far(own as f64, pixels as f64))
                + row.target_gap.map_or(0.0, |own| far(own, gap))
        };
        let of = |name: &str| {
            let rows = self.rows.iter().filter(|row| row.scene == scene && row.solver == name);
            rows.min_by(|a, b| distance(a).total_cmp(&distance(b)))
        };
        of(first).or_else(|| of(second))
    }

    /// The least error within a time that a frame may take where the table was measured: the same
    /// choice on every machine.
    pub fn best(
        &self,
        scene: &str,
        (budget_s, live): (f64, bool),
        allowed: impl Fn(&Measured) -> bool,
    ) -> Option<&Measured> {
        self.rows
            .iter()
            .filter(|row| row.scene == scene && (row.live || !live) && allowed(row))
            .filter(|row| 1e-3 * row.ms_a_frame <= budget_s)
            .min_by(|a, b| {
                a.relative_error
                    .total_cmp(&b.relative_error)
                    .then(a.ms_a_frame.total_cmp(&b.ms_a_frame))
            })
    }
}

impl Measured {
    /// Time on a machine over that where it was measured.
    pub fn slowness(&self, machine: &Machine) -> f64 {
        1e9 * self.machine_gflops / machine.double_flops_per_s
    }

    /// Frames of the recording it was measured on.
    pub fn frames(&self) -> usize {
        if self.scene == "single-frame" { 1 } else { 20 }
    }

    /// The solver and its setting.
    pub fn words(&self) -> String {
        let pixels = self.pixels.map_or_else(String::new, |n| format!(", {n} pixels"));
        let gap = self.target_gap.map_or_else(String::new, |gap| format!(", gap {gap:e}"));
        format!("{}{pixels}{gap}", self.solver)
    }
}

/// The built-in scene that is most like this one. `voltages` are those of the untouched skin.
pub(crate) fn nearest(
    scene: &Scene,
    setup: &Setup,
    frames: Option<usize>,
    voltages: &[f64],
) -> Nearest {
    let found = |scene, why: &str| Nearest { scene, why: why.to_owned() };
    if frames == Some(1) {
        return found("single-frame", "one frame");
    }
    let electrodes = setup.protocol.electrodes();
    if setup.protocol.quadruples().is_none() {
        return found("general-32", "currents on more than two electrodes");
    }
    if electrodes >= MANY {
        return found("general-32", &format!("{electrodes} electrodes"));
    }
    if let Some(OneOrMany::Many(z)) = &scene.electrodes.contact_impedance_ohm_m {
        let (least, most) =
            z.iter().fold((f64::INFINITY, 0.0_f64), |(l, m), z| (l.min(*z), m.max(*z)));
        if most > STIFF * least {
            return found("stiff-contact", "contact impedances far apart");
        }
    }
    if scene.reconstruction.upper_s.is_some_and(|upper| upper >= HIGH * scene.skin.conductivity_s) {
        return found("high-contrast", "upper_s allows a multiple of the conductivity");
    }
    let rms = (voltages.iter().map(|v| v * v).sum::<f64>() / voltages.len() as f64).sqrt();
    match scene.noise.additive_v.map(|noise| 20.0 * (rms / noise).log10()) {
        Some(db) if db < POOR_DB => found("paper-disc-40", &format!("noise at {db:.0} dB")),
        Some(db) => found("paper-disc-60", &format!("noise at {db:.0} dB")),
        None if scene.denoise.is_some() => found("paper-fabric", "it has [denoise]"),
        None => found("paper-disc-60", "its noise is not stated"),
    }
}

/// Settings that the scene leaves open, chosen for the least error within its `frame_time_s`; the
/// scene as it is without that key. `live`: only what gives an image before the next frame comes.
///
/// The table's own times count, so that a scene is the same on every machine.
pub(crate) fn in_time(
    scene: Scene,
    setup: &Setup,
    (frames, live): (Option<usize>, bool),
    voltages: &[f64],
) -> Result<Scene, CliError> {
    let keys = &scene.reconstruction;
    let Some(budget_s) = keys.frame_time_s else { return Ok(scene) };
    let nearest = nearest(&scene, setup, frames, voltages);
    let table = Table::load()?;
    let allowed = |row: &Measured| {
        row.settings().is_some_and(|found| {
            // the absolute method keeps no pace, and a stream is for what streams
            let pace = match live {
                true => found.method != Method::GaussNewtonAbsolute,
                false => !row.solver.ends_with(STREAM),
            };
            pace && found.suits(&scene, row)
        })
    };
    let Some(row) = table.best(nearest.scene, (budget_s, live), allowed) else {
        return Err(CliError::input(format!(
            "reconstruction.frame_time_s is {budget_s}: nothing that the scene allows was so fast \
             on {} ({}), the built-in scene most like this one",
            nearest.scene, nearest.why
        ))
        .within(&scene.place));
    };
    let mut made = scene.clone();
    let keys = &mut made.reconstruction;
    if let Some(Settings { method, cross_validated }) = row.settings() {
        keys.method.get_or_insert_with(|| method.name().to_owned());
        if cross_validated && keys.hyperparameter.is_none() {
            keys.hyperparameter = Some(Hyperparameter::Rule(Rule::Gcv));
        }
    }
    keys.pixels = keys.pixels.or(row.pixels);
    keys.target_gap = keys.target_gap.or(row.target_gap);
    Ok(made)
}

/// What a row means for a scene file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Settings {
    method: Method,
    cross_validated: bool,
}

impl Settings {
    /// Whether a scene may be reconstructed so: its own method and hyperparameter come first, total
    /// variation needs the noise, and its bound belongs to scenes that state it.
    fn suits(self, scene: &Scene, row: &Measured) -> bool {
        let keys = &scene.reconstruction;
        let noise = scene.noise.additive_v.is_some() || scene.noise.quiet_frames.is_some();
        let bounded = keys.lower_s.is_some_and(|lower| lower >= 0.0);
        let stated = keys.method.as_deref().is_none_or(|name| name == self.method.name());
        let tv = !self.method.is_tv() || (noise && bounded == row.solver.contains(BOUNDED));
        let others = match self.method.is_tv() {
            true => keys.keys_of_gauss_newton().next().is_none(),
            false => keys.keys_of_tv().next().is_none(),
        };
        let rule = !self.cross_validated || keys.hyperparameter.is_none();
        // a net belongs to its number of pixels
        let pixels = scene.denoise.is_none() || row.pixels.is_none_or(|n| n == DEFAULT_PIXELS);
        stated && tv && others && rule && pixels
    }
}

impl Measured {
    /// What a scene file would say; `None` for what it cannot (a net, a peer).
    fn settings(&self) -> Option<Settings> {
        let name = self.solver.trim_end_matches(STREAM).trim_end_matches(BOUNDED);
        let (name, cross_validated) = match name.strip_suffix(", gcv") {
            Some(name) => (name, true),
            None => (name, false),
        };
        let method = Method::ALL.into_iter().find(|method| method.name() == name)?;
        Some(Settings { method, cross_validated })
    }
}

/// End of a solver's name that knows that touches only raise the conductivity.
const BOUNDED: &str = " ≥ 0";
/// End of the name of one that takes frame after frame.
const STREAM: &str = " stream";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::report::CASES;

    /// The table is whole: every scene and method of the report, with errors and times.
    #[test]
    fn every_scene_and_method_was_measured() {
        let table = Table::load().unwrap();
        for case in CASES {
            for method in Method::ALL {
                let sequence = matches!(method, Method::StTv | Method::TimePrior | Method::Kalman);
                if case.is_still && sequence {
                    continue;
                }
                let row = table.of(case.name, (method, true), (64, 1e-2)).unwrap();
                assert!(row.relative_error > 0.0 && row.ms_a_frame > 0.0, "{row:?}");
                assert!(row.pixels.is_none_or(|pixels| pixels == 64), "{row:?}");
                assert!(row.target_gap.is_none_or(|gap| gap == 1e-2), "{row:?}");
            }
        }
    }

    /// More time is never worse, and live choices are never better than all.
    #[test]
    fn the_best_improves_with_time() {
        let table = Table::load().unwrap();
        for case in CASES {
            let error = |budget_s, live| {
                let best = table.best(case.name, (budget_s, live), |_| true);
                best.map_or(f64::INFINITY, |row| row.relative_error)
            };
            for live in [false, true] {
                assert!(error(1e-2, live) <= error(1e-3, live), "{}", case.name);
                assert!(error(1e-3, live) <= error(1e-4, live), "{}", case.name);
            }
            assert!(error(1e-2, false) <= error(1e-2, true), "{}", case.name);
        }
    }
}
