//! Checks that need the scene alone: numbers in range, keys that would be ignored.
//!
//! Shapes, electrodes and protocols are checked by the crates that build them.

use super::{Hyperparameter, PriorKind, Rule, Scene, Shape};
use crate::error::CliError;

/// Most pixels along the longer side: 16 million pixels an image.
const MOST_PIXELS: usize = 4096;

impl Scene {
    /// Refuses what cannot be, and what would silently have no effect.
    pub(super) fn check(&self) -> Result<(), CliError> {
        self.check_numbers().and_then(|()| self.check_company()).map_err(|e| e.within(&self.place))
    }

    fn check_numbers(&self) -> Result<(), CliError> {
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
            ("recording.frame_rate_hz", self.recording.frame_rate_hz),
            ("protocol.current_a", self.protocol.current_a),
        ];
        for (key, value) in positive {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                let message = format!("{key} is {value}: it must be finite and above zero");
                return Err(CliError::input(message));
            }
        }
        if let Some(scale) = self.recording.scale.filter(|s| !s.is_finite() || *s == 0.0) {
            let message = format!("recording.scale is {scale}: it must be finite and not zero");
            return Err(CliError::input(message));
        }
        if let Some(pixels) = image.pixels.filter(|p| !(1..=MOST_PIXELS).contains(p)) {
            let message =
                format!("reconstruction.pixels is {pixels}: it must be 1 to {MOST_PIXELS}");
            return Err(CliError::input(message));
        }
        Ok(())
    }

    /// Keys that exclude each other, and keys that need another one.
    fn check_company(&self) -> Result<(), CliError> {
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
            (file, ("mesh.edge_m", mesh.edge_m.is_some())),
            (("mesh.nodes", mesh.nodes.is_some()), ("mesh.edge_m", mesh.edge_m.is_some())),
            (file, ("electrodes.count", electrodes.count.is_some())),
            (file, ("electrodes.width_m", electrodes.width_m.is_some())),
            (file, positions),
            (file, angle),
        ];
        if let Some(((one, _), (other, _))) = exclusive.iter().find(|(a, b)| a.1 && b.1) {
            let message = format!("{one} and {other} exclude each other: keep one");
            return Err(CliError::input(message));
        }
        let figure_rule =
            matches!(image.hyperparameter, None | Some(Hyperparameter::Rule(Rule::NoiseFigure)));
        let smooth = matches!(image.prior, None | Some(PriorKind::Laplace | PriorKind::Gaussian));
        let needs = [
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
        ];
        match needs.iter().find(|(a, b)| a.1 && !b.1) {
            None => Ok(()),
            Some(((key, _), (other, _))) => {
                Err(CliError::input(format!("{key} has no effect without {other}")))
            }
        }
    }
}
