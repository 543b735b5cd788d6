//! Checks that only need the scene: ranges of numbers, and keys that would be ignored.
//!
//! The crates that build shapes, electrodes and protocols check those.

use super::{
    Delta, ElementOrder, Hyperparameter, PriorKind, RequiredAccuracyKey, Rule, Scene, Shape,
};
use super::{DeltaRule, ValueKind};
use crate::error::SkinError;
use crate::method::Method;
use std::ops::RangeInclusive;

/// Largest length of a skin, metres; larger values are taken for a mistake in the unit.
pub(super) const MOST_LENGTH_M: f64 = 10.0;
/// Maximum number of pixels along the longer side: 16 million pixels per image.
const MOST_PIXELS: usize = 4096;
/// Maximum number of electrodes: adjacent patterns then give 4.2 million measurements.
const MOST_ELECTRODES: usize = 2048;
/// Maximum number of mesh nodes; solving takes some 30 GB.
const MOST_NODES: usize = 20_000_000;

impl Scene {
    /// Rejects invalid settings, and settings that would silently have no effect.
    pub(crate) fn check(&self) -> Result<(), SkinError> {
        self.check_lengths()
            .and_then(|()| self.check_numbers())
            .and_then(|()| self.touch.validate())
            .and_then(|()| self.check_tv())
            .and_then(|()| self.check_reactive())
            .and_then(|()| self.check_company())
            .and_then(|()| self.check_method())
            .and_then(|()| self.required_accuracy().map(|_| ()))
            .and_then(|()| self.check_movement())
            .map_err(|e| e.within(&self.place))
    }

    /// Rejects invalid settings of the stages after the model (touches, method, weights of a U-net) before
    /// any work.
    ///
    /// # Errors
    ///
    /// An invalid setting; the message names key and value.
    pub fn check_stages(&self) -> Result<(), SkinError> {
        let settings = self.stage_settings();
        settings.touch.validate().map_err(|e| e.within(&self.place))?;
        crate::method::choose(&settings, None, None)?;
        #[cfg(feature = "denoise")]
        if let Some(denoise) = &settings.denoise {
            let pixels = settings.reconstruction.pixels.unwrap_or(super::DEFAULT_PIXELS);
            let fingerprint = &self.skin_fingerprint()?;
            let target =
                crate::denoise::NetTarget { fingerprint, pixels, sign: settings.touch.sign };
            crate::denoise::Net::load(denoise, &target)?;
        }
        Ok(())
    }

    /// Rejects settings that are incompatible with electrode movement.
    fn check_movement(&self) -> Result<(), SkinError> {
        if self.reconstruction.electrode_movement_m.is_none() {
            return Ok(());
        }
        let absolute = Method::GaussNewtonAbsolute.name();
        let why = if self.reconstruction.method.as_deref() == Some(absolute) {
            "method = \"gauss-newton-absolute\" exclude each other: movement is removed from \
             differences before a linear method; keep one"
        } else if self.mesh.elements == Some(ElementOrder::Quadratic) {
            "[mesh] elements = \"quadratic\" exclude each other: derivatives along displacements are \
             those of linear elements; keep one"
        } else {
            return Ok(());
        };
        Err(SkinError::input(format!("reconstruction.electrode_movement_m and {why}")))
    }

    /// Rejects electrode movement for commands that train or apply a U-net.
    ///
    /// # Errors
    ///
    /// [`SkinError::Input`] if the scene models electrode movement.
    pub fn refuse_movement(&self, command: &str) -> Result<(), SkinError> {
        if self.reconstruction.electrode_movement_m.is_none() {
            return Ok(());
        }
        let message = format!(
            "`eit {command}` does not support reconstruction.electrode_movement_m (U-nets learn to \
             remove the artefacts of movement from images that have them): remove it from the scene"
        );
        Err(SkinError::input(message).within(&self.place))
    }

    /// Rejects sizes and corners that are not in metres, before such a mesh is generated. Skins
    /// smaller than any built so far are allowed, because nothing distinguishes them from a mistake
    /// in the unit.
    fn check_lengths(&self) -> Result<(), SkinError> {
        let skin = &self.skin;
        let sizes = [
            ("skin.radius_m", skin.radius_m),
            ("skin.width_m", skin.width_m),
            ("skin.height_m", skin.height_m),
        ];
        for (key, value_m) in sizes {
            check_length(|| key.to_owned(), value_m.unwrap_or_default())?;
        }
        let outline = skin.outline.iter().map(|corners| ("skin.outline".to_owned(), corners));
        let holes = skin.holes.iter().enumerate();
        let holes = holes.map(|(h, corners)| (format!("skin.holes, hole {}", h + 1), corners));
        for (key, corners) in outline.chain(holes) {
            for (k, corner) in corners.iter().enumerate() {
                for value_m in corner.0 {
                    check_length(|| format!("{key}, corner {}", k + 1), value_m)?;
                }
            }
        }
        Ok(())
    }

    fn check_weave(&self) -> Result<(), SkinError> {
        let (ratio, angle_deg) = (self.skin.weave_ratio, self.skin.weave_angle_deg);
        if angle_deg.is_some() && ratio.is_none() {
            return Err(SkinError::input(
                "skin.weave_angle_deg needs skin.weave_ratio: how much better the fabric conducts along that angle",
            ));
        }
        // beyond what any fabric has: a slip of the point
        let ratios = (0.1..=10.0, "from 0.1 to 10");
        let angles = (-360.0..=360.0, "from -360 to 360 (degrees)");
        check_numbers([
            ("skin.weave_ratio", ratio, Must::Within(ratios)),
            ("skin.weave_angle_deg", angle_deg, Must::Within(angles)),
        ])
    }

    fn check_numbers(&self) -> Result<(), SkinError> {
        self.check_weave()?;
        let image = &self.reconstruction;
        let fixed = match image.hyperparameter {
            Some(Hyperparameter::Value(value)) => Some(value),
            _ => None,
        };
        let delta = match image.delta {
            Some(Delta::Value(value)) => Some(value),
            _ => None,
        };
        // beyond what any skin has: a slip of unit
        let rates = (1e-4..=1e6, "from 0.0001 to 1000000 (frames a second)");
        let currents = (1e-9..=10.0, "from 1e-9 to 10 (ampere)");
        check_numbers([
            ("skin.conductivity_s", Some(self.skin.conductivity_s), Must::Positive),
            ("reconstruction.correlation_length_m", image.correlation_length_m, Must::Positive),
            ("reconstruction.hyperparameter", fixed, Must::Positive),
            ("reconstruction.noise_figure", image.noise_figure, Must::Positive),
            ("noise.additive_v", self.noise.additive_v, Must::Positive),
            ("touch.least_strength_m2", self.touch.least_strength_m2, Must::Positive),
            ("reconstruction.lambda_space", image.lambda_space, Must::Positive),
            ("reconstruction.target_gap", image.target_gap, Must::Positive),
            ("reconstruction.deadline_s", image.deadline_s, Must::Positive),
            ("reconstruction.frame_time_s", image.frame_time_s, Must::Positive),
            ("reconstruction.electrode_movement_m", image.electrode_movement_m, Must::Positive),
            ("recording.frame_rate_hz", self.recording.frame_rate_hz, Must::Within(rates)),
            ("protocol.current_a", self.protocol.current_a, Must::Within(currents)),
            ("recording.scale", self.recording.scale, Must::NotZero),
            ("reconstruction.lambda_time", image.lambda_time, Must::NotNegative),
            ("reconstruction.delta", delta, Must::NotNegative),
        ])?;
        if let Some(RequiredAccuracyKey::Relative(value)) = self.mesh.required_accuracy
            && !(value > 0.0 && value < 1.0)
        {
            return Err(SkinError::input(format!(
                "mesh.required_accuracy is {value}: a fraction of the largest voltage, it must be above 0 \
                 and below 1"
            )));
        }
        if let Some(pixels) = image.pixels.filter(|p| !(1..=MOST_PIXELS).contains(p)) {
            let message =
                format!("reconstruction.pixels is {pixels}: it must be 1 to {MOST_PIXELS}");
            return Err(SkinError::input(message));
        }
        let electrodes = &self.electrodes;
        let count = electrodes.count.max(electrodes.positions_m.as_ref().map(Vec::len));
        if let Some(count) = count.filter(|&count| count > MOST_ELECTRODES) {
            let message = format!("{count} electrodes: a skin has at most {MOST_ELECTRODES}");
            return Err(SkinError::input(message));
        }
        let limits = [("mesh.node_limit", self.mesh.node_limit), ("mesh.nodes", self.mesh.nodes)];
        for (key, nodes) in limits {
            if let Some(nodes) = nodes.filter(|&nodes| nodes > MOST_NODES) {
                let message = format!("{key} is {nodes}: it must be at most {MOST_NODES}");
                return Err(SkinError::input(message));
            }
        }
        Ok(())
    }

    /// Checks the gap and the bounds of total variation, and the frames that show the noise.
    fn check_tv(&self) -> Result<(), SkinError> {
        let image = &self.reconstruction;
        if let Some(gap) = image.target_gap.filter(|gap| *gap >= 1.0) {
            return Err(SkinError::input(format!(
                "reconstruction.target_gap is {gap}: it is relative to the objective and must be \
                 below 1"
            )));
        }
        let lower = image.lower_s.unwrap_or(f64::NEG_INFINITY);
        let upper = image.upper_s.unwrap_or(f64::INFINITY);
        if !(lower <= 0.0 && upper >= 0.0 && lower < upper) {
            return Err(SkinError::input(format!(
                "reconstruction.lower_s = {lower} and upper_s = {upper} must include zero (no change), as \
                 a bound or between them"
            )));
        }
        if let Some(frames) = self.noise.quiet_frames.filter(|frames| frames.count() < 3) {
            return Err(SkinError::input(format!(
                "noise.quiet_frames = \"{frames}\": frames N to M - 1; the noise is measured on three \
                 or more"
            )));
        }
        Ok(())
    }

    /// Checks that the method exists and reads the method-specific keys that are set.
    fn check_method(&self) -> Result<(), SkinError> {
        let image = &self.reconstruction;
        let (mut of_tv, mut of_others) = (image.keys_of_tv(), image.keys_of_gauss_newton());
        let Some(name) = &image.method else {
            return match (of_tv.chain(image.bounds()).next(), of_others.next()) {
                (Some(one), Some(other)) => Err(SkinError::input(format!(
                    "{one} and {other} belong to different methods: set reconstruction.method or remove \
                     one"
                ))),
                _ => Ok(()),
            };
        };
        let method = Method::parse("reconstruction.method", name)?;
        let bounded = method.is_tv() || method == Method::GaussNewtonAbsolute;
        let ignored = if method.is_tv() { of_others.next() } else { of_tv.next() };
        let ignored = ignored.or(image.bounds().next().filter(|_| !bounded));
        if let Some(key) = ignored {
            let because = format!("with method = \"{name}\"");
            return Err(SkinError::NoEffect { key: key.to_owned(), because });
        }
        if method == Method::Tv && image.lambda_time.is_some_and(|weight| weight != 0.0) {
            return Err(SkinError::input(
                "reconstruction.lambda_time has no effect with method = \"tv\": use \"st-tv\"",
            ));
        }
        Ok(())
    }

    /// Rejects keys that exclude each other, and keys without the key that they need.
    fn check_company(&self) -> Result<(), SkinError> {
        let table = self.to_table()?;
        let is_set = |key: &str| {
            let is_file = self.skin.shape == Shape::Mesh;
            match (key, key.split_once('.')) {
                (MESH_FILE, _) => is_file,
                (PAPER, _) => self.reconstruction.delta == Some(Delta::Rule(DeltaRule::Paper)),
                (OTHER_VALUES, _) => self.recording.values != ValueKind::Voltage,
                (GROUND, _) => self.protocol.measure.as_deref() == Some("ground"),
                // such a file is used unchanged
                (OWN_ELECTRODES, _) => is_file && self.electrodes.positions_m.is_none(),
                (_, Some((section, key))) => {
                    table.get(section).is_some_and(|keys| keys.get(key).is_some())
                }
                _ => false,
            }
        };
        if let Some(&[one, other]) =
            EXCLUSIVE.iter().find(|keys| keys.iter().all(|key| is_set(key)))
        {
            return Err(SkinError::Exclusive { one, other });
        }
        let image = &self.reconstruction;
        let figure_rule =
            matches!(image.hyperparameter, None | Some(Hyperparameter::Rule(Rule::NoiseFigure)));
        let smooth = matches!(image.prior, None | Some(PriorKind::Laplace | PriorKind::Gaussian));
        let capacitances =
            ["skin.sheet_capacitance_f", "electrodes.contact_capacitance_f_per_m"].map(is_set);
        let needs = [
            ("skin.sheet_capacitance_f", FREQUENCY, is_set(FREQUENCY)),
            ("electrodes.contact_capacitance_f_per_m", FREQUENCY, is_set(FREQUENCY)),
            (
                FREQUENCY,
                "skin.sheet_capacitance_f or electrodes.contact_capacitance_f_per_m",
                capacitances.contains(&true),
            ),
            ("protocol.measurement_file", STIMULATION, is_set(STIMULATION)),
            ("reconstruction.noise_figure", "hyperparameter = \"noise-figure\"", figure_rule),
            ("reconstruction.correlation_length_m", "prior = \"laplace\" or \"gaussian\"", smooth),
            ("skin.file", MESH_FILE, is_set(MESH_FILE)),
            ("skin.scale_m", MESH_FILE, is_set(MESH_FILE)),
            ("electrodes.radius_m", POSITIONS, is_set(POSITIONS)),
            (
                "reconstruction.lambda_time",
                "reconstruction.lambda_space",
                // 0 disables the time term, whatever the weight in space
                image.lambda_time == Some(0.0) || image.lambda_space.is_some(),
            ),
        ];
        match needs.iter().find(|(key, _, is_met)| is_set(key) && !is_met) {
            None => Ok(()),
            Some((key, other, _)) => {
                let because = format!("without {other}");
                Err(SkinError::NoEffect { key: (*key).to_owned(), because })
            }
        }
    }
}

const MESH_FILE: &str = "skin.shape = \"mesh\"";
const OWN_ELECTRODES: &str = "skin.shape = \"mesh\" without positions_m";
const FREQUENCY: &str = "protocol.frequency_hz";
const STIMULATION: &str = "protocol.stimulation_file";
const QUADRUPLES: &str = "protocol.quadruples_file";
const PAPER: &str = "reconstruction.delta = \"paper\"";
const OTHER_VALUES: &str = "recording.values other than \"voltage\"";
const GROUND: &str = "protocol.measure = \"ground\"";
const POSITIONS: &str = "electrodes.positions_m";
const FIRST_ANGLE: &str = "electrodes.first_angle_deg";
const ACCURACY: &str = "mesh.required_accuracy";

/// Keys that exclude each other.
const EXCLUSIVE: [[&str; 2]; 29] = [
    ["protocol.drive", "protocol.pairs"],
    ["protocol.drive", QUADRUPLES],
    ["protocol.drive", STIMULATION],
    ["protocol.pairs", QUADRUPLES],
    ["protocol.pairs", STIMULATION],
    [QUADRUPLES, STIMULATION],
    ["protocol.measure", QUADRUPLES],
    ["protocol.measure", STIMULATION],
    // differences of other values than voltages mean nothing
    [GROUND, OTHER_VALUES],
    [PAPER, "reconstruction.lambda_space"],
    [PAPER, "reconstruction.lambda_time"],
    [POSITIONS, FIRST_ANGLE],
    ["skin.radius_m", "skin.width_m"],
    ["skin.radius_m", "skin.outline"],
    ["skin.width_m", "skin.outline"],
    [MESH_FILE, "skin.radius_m"],
    [MESH_FILE, "mesh.nodes"],
    [OWN_ELECTRODES, "mesh.edge_m"],
    [OWN_ELECTRODES, "mesh.electrode_edge_m"],
    [OWN_ELECTRODES, "mesh.grading"],
    ["mesh.nodes", "mesh.edge_m"],
    [ACCURACY, "mesh.nodes"],
    [ACCURACY, "mesh.edge_m"],
    [ACCURACY, "mesh.electrode_edge_m"],
    ["noise.additive_v", "noise.quiet_frames"],
    [MESH_FILE, "electrodes.count"],
    [OWN_ELECTRODES, "electrodes.width_m"],
    [OWN_ELECTRODES, "electrodes.radius_m"],
    [MESH_FILE, FIRST_ANGLE],
];

/// Allowed range of a number.
pub(crate) enum Must {
    Positive,
    NotNegative,
    NotZero,
    #[cfg(feature = "learn")]
    Finite,
    /// A range, and its description.
    Within((RangeInclusive<f64>, &'static str)),
}

/// Rejects numbers out of range; the error names key, value and range.
pub(crate) fn check_numbers(
    numbers: impl IntoIterator<Item = (&'static str, Option<f64>, Must)>,
) -> Result<(), SkinError> {
    for (key, value, must) in numbers {
        let Some(value) = value else { continue };
        let (is_met, must) = match must {
            Must::Positive => (value.is_finite() && value > 0.0, "finite and above zero"),
            Must::NotNegative => (value.is_finite() && value >= 0.0, "finite and not below zero"),
            Must::NotZero => (value.is_finite() && value != 0.0, "finite and not zero"),
            #[cfg(feature = "learn")]
            Must::Finite => (value.is_finite(), "finite"),
            Must::Within((range, words)) => (range.contains(&value), words),
        };
        if !is_met {
            return Err(SkinError::OutOfRange { key, value, must });
        }
    }
    Ok(())
}

/// Rejects a length or coordinate beyond any skin.
pub(super) fn check_length(key: impl FnOnce() -> String, value_m: f64) -> Result<(), SkinError> {
    match value_m.abs() > MOST_LENGTH_M {
        true => Err(SkinError::NotMetres { key: key(), value_m, most_m: MOST_LENGTH_M }),
        false => Ok(()),
    }
}
