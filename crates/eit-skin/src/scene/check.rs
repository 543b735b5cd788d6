//! Checks that only need the scene: ranges of numbers, and keys that would be ignored.
//!
//! The crates that build shapes, electrodes and protocols check those.

use super::{
    Delta, ElementKind, Hyperparameter, PriorKind, RequiredAccuracyKey, Rule, Scene, Shape,
};
use crate::error::SkinError;
use crate::method::Method;

/// Largest length of a skin, metres: a larger one is a slip of unit.
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
            let pixels = settings.reconstruction.pixels.unwrap_or(crate::skin::DEFAULT_PIXELS);
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
        } else if self.mesh.elements == Some(ElementKind::Quadratic) {
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

    /// Rejects sizes and corners that are not in metres, before a mesh of such a skin is attempted. Smaller skins than any
    /// that was built are allowed: nothing tells them from a slip of unit.
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

    fn check_numbers(&self) -> Result<(), SkinError> {
        let image = &self.reconstruction;
        let fixed = match image.hyperparameter {
            Some(Hyperparameter::Value(value)) => Some(value),
            _ => None,
        };
        let positive = [
            ("skin.conductivity_s", Some(self.skin.conductivity_s)),
            ("reconstruction.correlation_length_m", image.correlation_length_m),
            ("reconstruction.hyperparameter", fixed),
            ("reconstruction.noise_figure", image.noise_figure),
            ("noise.additive_v", self.noise.additive_v),
            ("touch.least_strength_m2", self.touch.least_strength_m2),
            ("reconstruction.lambda_space", image.lambda_space),
            ("reconstruction.target_gap", image.target_gap),
            ("reconstruction.deadline_s", image.deadline_s),
            ("reconstruction.frame_time_s", image.frame_time_s),
            ("reconstruction.electrode_movement_m", image.electrode_movement_m),
        ];
        for (key, value) in positive {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                let must = "finite and above zero";
                return Err(SkinError::OutOfRange { key, value, must });
            }
        }
        // beyond what any skin has: a slip of unit
        let plausible = [
            (
                "recording.frame_rate_hz",
                self.recording.frame_rate_hz,
                1e-4..=1e6,
                "from 0.0001 to 1000000 (frames a second)",
            ),
            (
                "protocol.current_a",
                self.protocol.current_a,
                1e-9..=10.0,
                "from 1e-9 to 10 (ampere)",
            ),
        ];
        for (key, value, range, must) in plausible {
            if let Some(value) = value.filter(|v| !range.contains(v)) {
                return Err(SkinError::OutOfRange { key, value, must });
            }
        }
        if let Some(scale) = self.recording.scale.filter(|s| !s.is_finite() || *s == 0.0) {
            let (key, must) = ("recording.scale", "finite and not zero");
            return Err(SkinError::OutOfRange { key, value: scale, must });
        }
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

    /// Checks numbers of the total variation methods that may be zero, or whose range is bounded.
    fn check_tv(&self) -> Result<(), SkinError> {
        let image = &self.reconstruction;
        let delta = match image.delta {
            Some(Delta::Value(value)) => Some(value),
            _ => None,
        };
        for (key, value) in
            [("reconstruction.lambda_time", image.lambda_time), ("reconstruction.delta", delta)]
        {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v >= 0.0)) {
                let must = "finite and not below zero";
                return Err(SkinError::OutOfRange { key, value, must });
            }
        }
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

    /// Checks keys that exclude each other, and keys that need another one.
    fn check_company(&self) -> Result<(), SkinError> {
        let (protocol, electrodes, image) =
            (&self.protocol, &self.electrodes, &self.reconstruction);
        let (mesh, skin) = (&self.mesh, &self.skin);
        let quadruples = ("protocol.quadruples_file", protocol.quadruples_file.is_some());
        let stimulation = ("protocol.stimulation_file", protocol.stimulation_file.is_some());
        let drive = ("protocol.drive", protocol.drive.is_some());
        let measure = ("protocol.measure", protocol.measure.is_some());
        let pairs = ("protocol.pairs", protocol.pairs.is_some());
        let positions = ("electrodes.positions_m", electrodes.positions_m.is_some());
        let angle = ("electrodes.first_angle_deg", electrodes.first_angle_deg.is_some());
        let file = ("skin.shape = \"mesh\"", skin.shape == Shape::Mesh);
        // a file with electrodes is used unchanged
        let own = ("skin.shape = \"mesh\" without positions_m", file.1 && !positions.1);
        let radius = ("electrodes.radius_m", electrodes.radius_m.is_some());
        let accuracy = ("mesh.required_accuracy", mesh.required_accuracy.is_some());
        let exclusive = [
            (drive, pairs),
            (drive, quadruples),
            (drive, stimulation),
            (pairs, quadruples),
            (pairs, stimulation),
            (quadruples, stimulation),
            (measure, quadruples),
            (measure, stimulation),
            (positions, angle),
            (("skin.radius_m", skin.radius_m.is_some()), ("skin.width_m", skin.width_m.is_some())),
            (("skin.radius_m", skin.radius_m.is_some()), ("skin.outline", skin.outline.is_some())),
            (("skin.width_m", skin.width_m.is_some()), ("skin.outline", skin.outline.is_some())),
            (file, ("skin.radius_m", skin.radius_m.is_some())),
            (file, ("mesh.nodes", mesh.nodes.is_some())),
            (own, ("mesh.edge_m", mesh.edge_m.is_some())),
            (own, ("mesh.electrode_edge_m", mesh.electrode_edge_m.is_some())),
            (own, ("mesh.grading", mesh.grading.is_some())),
            (("mesh.nodes", mesh.nodes.is_some()), ("mesh.edge_m", mesh.edge_m.is_some())),
            (accuracy, ("mesh.nodes", mesh.nodes.is_some())),
            (accuracy, ("mesh.edge_m", mesh.edge_m.is_some())),
            (accuracy, ("mesh.electrode_edge_m", mesh.electrode_edge_m.is_some())),
            (
                ("noise.additive_v", self.noise.additive_v.is_some()),
                ("noise.quiet_frames", self.noise.quiet_frames.is_some()),
            ),
            (file, ("electrodes.count", electrodes.count.is_some())),
            (own, ("electrodes.width_m", electrodes.width_m.is_some())),
            (own, radius),
            (file, angle),
        ];
        if let Some(((one, _), (other, _))) = exclusive.iter().find(|(a, b)| a.1 && b.1) {
            return Err(SkinError::Exclusive { one, other });
        }
        let figure_rule =
            matches!(image.hyperparameter, None | Some(Hyperparameter::Rule(Rule::NoiseFigure)));
        let smooth = matches!(image.prior, None | Some(PriorKind::Laplace | PriorKind::Gaussian));
        let capacitance =
            skin.sheet_capacitance_f.is_some() || electrodes.contact_capacitance_f_per_m.is_some();
        let frequency = ("protocol.frequency_hz", protocol.frequency_hz.is_some());
        let needs = [
            (("skin.sheet_capacitance_f", skin.sheet_capacitance_f.is_some()), frequency),
            (
                (
                    "electrodes.contact_capacitance_f_per_m",
                    electrodes.contact_capacitance_f_per_m.is_some(),
                ),
                frequency,
            ),
            (
                frequency,
                ("skin.sheet_capacitance_f or electrodes.contact_capacitance_f_per_m", capacitance),
            ),
            (
                ("protocol.measurement_file", protocol.measurement_file.is_some()),
                ("protocol.stimulation_file", stimulation.1),
            ),
            (
                ("reconstruction.noise_figure", image.noise_figure.is_some()),
                ("hyperparameter = \"noise-figure\"", figure_rule),
            ),
            (
                ("reconstruction.correlation_length_m", image.correlation_length_m.is_some()),
                ("prior = \"laplace\" or \"gaussian\"", smooth),
            ),
            (("skin.file", skin.file.is_some()), file),
            (("skin.scale_m", skin.scale_m.is_some()), file),
            (radius, positions),
            (
                // 0 disables the time term, whatever the weight in space
                (
                    "reconstruction.lambda_time",
                    image.lambda_time.is_some_and(|weight| weight != 0.0),
                ),
                ("reconstruction.lambda_space", image.lambda_space.is_some()),
            ),
        ];
        match needs.iter().find(|(a, b)| a.1 && !b.1) {
            None => Ok(()),
            Some(((key, _), (other, _))) => {
                let because = format!("without {other}");
                Err(SkinError::NoEffect { key: (*key).to_owned(), because })
            }
        }
    }
}

/// Rejects a length or coordinate beyond any skin.
pub(super) fn check_length(key: impl FnOnce() -> String, value_m: f64) -> Result<(), SkinError> {
    match value_m.abs() > MOST_LENGTH_M {
        true => Err(SkinError::NotMetres { key: key(), value_m, most_m: MOST_LENGTH_M }),
        false => Ok(()),
    }
}
