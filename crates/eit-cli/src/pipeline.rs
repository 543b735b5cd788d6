//! From a scene to its stages: mesh, linearised forward model, reconstruction, raster.
//!
//! Each stage is built only where a command needs it.

use crate::error::CliError;
use crate::frames::Frames;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Hyperparameter, PriorKind, Rule, Scene};
use eit_denoise::ImageStack;
use eit_fem::{ForwardModel, Protocol, SolveReport};
use eit_inverse::{
    Chosen, Difference, DifferenceData, DifferenceSettings, Gaussian, GaussianSettings,
    HyperparameterChoice, Laplace, LaplaceSettings, NoiseTarget, Noser, Prior, Tikhonov,
};
use eit_mesh::{Mesh, Raster};
use ndarray::{Array1, Array2, ArrayView1, Axis};

/// Pixels along the longer side where the scene states none: a disc of 64 has 3 200 pixels, ten
/// times more than 208 measurements can tell apart.
pub(crate) const DEFAULT_PIXELS: usize = 64;

/// Noise figure where the scene states nothing: the image is as noisy as the data.
pub(crate) const DEFAULT_NOISE_FIGURE: f64 = 1.0;

/// Largest array that is tried, bytes.
const MOST_BYTES: f64 = 8e9;

/// Mesh and protocol of a scene.
pub(crate) struct Setup {
    /// The skin.
    pub mesh: Mesh,
    /// Patterns, in data order.
    pub protocol: Protocol,
    /// Ready to solve.
    pub model: ForwardModel,
}

/// The model linearised at the homogeneous background.
pub(crate) struct Linearised {
    /// Voltages of the background, volt.
    pub voltages: Array1<f64>,
    /// [measurement, element], volt per siemens.
    pub jacobian: Array2<f64>,
    /// How the solve went.
    pub report: SolveReport,
    /// What rounding may have cost, where that is worth saying.
    pub warning: Option<String>,
}

/// A reconstruction ready for frames.
pub(crate) struct Imaging {
    /// On elements.
    pub difference: Difference,
    /// How the hyperparameter was chosen.
    pub chosen: Chosen,
    /// The rule in words.
    pub rule: String,
    /// Pixels of the pictures.
    pub raster: Raster,
    /// Plain or normalised.
    pub kind: DifferenceKind,
}

/// Mesh, protocol and forward model of a scene; `mesh_file` and `nodes` override the scene's mesh.
pub(crate) fn setup(
    scene: &Scene,
    mesh_file: Option<&std::path::Path>,
    nodes: Option<usize>,
    progress: &mut Progress,
) -> Result<Setup, CliError> {
    let wanted = match mesh_file {
        Some(file) => crate::scene::SceneMesh::File(file.to_path_buf()),
        None => scene.mesh(nodes)?,
    };
    // what needs no mesh is checked before one is made
    if let Some(electrodes) = wanted.electrodes() {
        scene.protocol(electrodes)?;
        scene.contact_impedance(electrodes)?;
    }
    let mesh = progress.stage("mesh", || wanted.build()).map_err(|e| e.within(&scene.place))?;
    let electrodes = mesh.electrodes().len();
    if electrodes == 0 {
        return Err(CliError::input(
            "the mesh has no electrode: name physical lines electrode_1 ..",
        ));
    }
    let protocol = scene.protocol(electrodes)?;
    let impedance = scene.contact_impedance(electrodes)?;
    let bytes = 8.0 * protocol.measurements() as f64 * mesh.surface().triangles().len() as f64;
    if bytes > MOST_BYTES {
        return Err(CliError::input(format!(
            "{} measurements on {} elements make a Jacobian of {:.0} GB: use a coarser [mesh] or \
             fewer measurements",
            protocol.measurements(),
            mesh.surface().triangles().len(),
            1e-9 * bytes
        )));
    }
    let model = progress.stage("forward model", || ForwardModel::new(&mesh, &protocol, &impedance));
    let model = model.map_err(|e| CliError::from(e).within(&scene.place))?;
    Ok(Setup { mesh, protocol, model })
}

/// Voltages and Jacobian of the homogeneous background.
pub(crate) fn linearise(
    scene: &Scene,
    setup: &Setup,
    progress: &mut Progress,
) -> Result<Linearised, CliError> {
    let background = vec![scene.skin.conductivity_s; setup.model.elements()];
    progress.stage("forward and Jacobian", || {
        let mut workspace = setup.model.workspace()?;
        let mut solution = setup.model.solve(&background, &mut workspace)?;
        let report = solution.report();
        let warning = certain(&report)?;
        let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
        Ok(Linearised { voltages, jacobian, report, warning })
    })
}

/// Losses worth a warning, and losses that leave nothing to report.
const WARN_LOSS: f64 = 1e-6;
const REFUSE_LOSS: f64 = 0.1;

/// Refuses voltages that rounding may have made worthless; warns where it may have cost digits.
pub(crate) fn certain(report: &SolveReport) -> Result<Option<String>, CliError> {
    let loss = report.expected_loss;
    if loss.is_nan() || loss > REFUSE_LOSS {
        return Err(CliError::Failure(format!(
            "no digit of the voltages is certain: conductances on this skin span {:.0} decades \
             (contact impedances times conductivity against element size, or contrast); bring them \
             nearer to each other",
            (loss / (1000.0 * f64::EPSILON)).log10()
        )));
    }
    Ok((loss > WARN_LOSS).then(|| {
        format!(
            "rounding may have cost up to {loss:.0e} of the largest voltage (a cautious estimate)"
        )
    }))
}

/// The scene's prior.
fn prior(scene: &Scene, setup: &Setup) -> Result<Box<dyn Prior>, CliError> {
    let surface = setup.mesh.surface();
    let length = scene.reconstruction.correlation_length_m;
    Ok(match scene.reconstruction.prior.unwrap_or(PriorKind::Laplace) {
        PriorKind::Tikhonov => Box::new(Tikhonov::new(surface)),
        PriorKind::Noser => Box::new(Noser::default()),
        PriorKind::Laplace => {
            let settings = LaplaceSettings { correlation_length_m: length };
            Box::new(Laplace::new(surface, &settings)?)
        }
        PriorKind::Gaussian => {
            Box::new(Gaussian::new(surface, &GaussianSettings { length_m: length })?)
        }
    })
}

/// Computes the reconstruction of a scene for frames.
pub(crate) fn imaging(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    frames: &Frames,
    progress: &mut Progress,
) -> Result<Imaging, CliError> {
    let kind = scene.difference_kind(&setup.protocol);
    let data = match kind {
        DifferenceKind::Plain => DifferenceData::Plain,
        DifferenceKind::Normalised => {
            DifferenceData::Normalised { model_voltages_v: linearised.voltages.to_vec() }
        }
    };
    let additive = scene.noise.additive_v.map(|e| vec![e; setup.protocol.measurements()]);
    let noise_std = additive.map(|noise_std_v| data.noise_std(&noise_std_v)).transpose()?;
    let settings = DifferenceSettings {
        data,
        noise_std,
        used: Some(frames.used.clone()),
        ..Default::default()
    };
    let prior = prior(scene, setup)?;
    let mut difference = progress.stage("reconstruction matrix", || {
        Difference::new(&linearised.jacobian, prior.as_ref(), settings)
    })?;
    let (chosen, rule) = progress
        .stage("hyperparameter", || choose(scene, setup, linearised, frames, &mut difference))?;
    let pixels = scene.reconstruction.pixels.unwrap_or(DEFAULT_PIXELS);
    let raster = progress.stage("raster", || Raster::new(setup.mesh.surface(), pixels))?;
    Ok(Imaging { difference, chosen, rule, raster, kind })
}

fn choose(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    frames: &Frames,
    difference: &mut Difference,
) -> Result<(Chosen, String), CliError> {
    let keys = &scene.reconstruction;
    let target;
    let figure = keys.noise_figure.unwrap_or(DEFAULT_NOISE_FIGURE);
    let default = Hyperparameter::Rule(Rule::NoiseFigure);
    let clean = frames.clean();
    let needs_data =
        matches!(keys.hyperparameter, Some(Hyperparameter::Rule(Rule::LCurve | Rule::Gcv)));
    if needs_data && clean.is_empty() {
        return Err(CliError::input(
            "the hyperparameter is chosen from the data, but no frame is good in every used \
             measurement: take hyperparameter = \"noise-figure\" or a number",
        ));
    }
    let values = frames.values.select(Axis(0), &clean);
    let (values, reference_frame) = (values.view(), frames.reference.as_slice());
    let (choice, words) = match keys.hyperparameter.as_ref().unwrap_or(&default) {
        Hyperparameter::Value(value) => {
            (HyperparameterChoice::Fixed(*value), "fixed by the scene".to_owned())
        }
        Hyperparameter::Rule(Rule::NoiseFigure) => {
            target = NoiseTarget::central(setup.mesh.surface(), &linearised.jacobian)?;
            let choice = HyperparameterChoice::NoiseFigure { figure, target: &target };
            (choice, format!("noise figure {figure}"))
        }
        Hyperparameter::Rule(Rule::LCurve) => {
            (HyperparameterChoice::LCurve { frames: values, reference_frame }, "L-curve".into())
        }
        Hyperparameter::Rule(Rule::Gcv) => (
            HyperparameterChoice::Gcv { frames: values, reference_frame },
            "generalised cross-validation".into(),
        ),
    };
    Ok((difference.choose_hyperparameter(&choice)?, words))
}

impl Imaging {
    /// Images [frame, row, column] in siemens, NaN outside the skin.
    ///
    /// Frames with bad values among the used measurements are reconstructed without them.
    pub fn images(&self, frames: &Frames, progress: &mut Progress) -> Result<ImageStack, CliError> {
        let count = frames.values.nrows();
        let bytes = 8.0 * count as f64 * (self.raster.pixels() as f64).powi(2);
        if bytes > MOST_BYTES {
            return Err(CliError::input(format!(
                "{count} images of {0} x {0} pixels take {1:.0} GB: use fewer [reconstruction] \
                 pixels or fewer frames",
                self.raster.pixels(),
                1e-9 * bytes
            )));
        }
        progress.steps("images", count, |bar| {
            let reconstructor = self.difference.on_raster(self.raster.pixel_from_element())?;
            let mut pixels = Array2::zeros((count, self.raster.masked_pixels().len()));
            let clean = frames.clean();
            let values = frames.values.select(Axis(0), &clean);
            let found = reconstructor.reconstruct_frames(values.view(), &frames.reference)?;
            for (row, frame) in found.rows().into_iter().zip(&clean) {
                pixels.row_mut(*frame).assign(&row);
            }
            bar.set_position(clean.len() as u64);
            let mut workspace = reconstructor.workspace();
            let mut image = vec![0.0; reconstructor.image_len()];
            for frame in (0..count).filter(|frame| clean.binary_search(frame).is_err()) {
                let bad: Vec<usize> =
                    (0..frames.used.len()).filter(|&i| !frames.good[[frame, i]]).collect();
                let values = frames.values.row(frame).to_vec();
                let (reference, memory) = (&frames.reference, &mut workspace);
                reconstructor
                    .reconstruct_without_into(&values, reference, &bad, memory, &mut image)
                    .map_err(|e| CliError::from(e).within(&format!("frame {frame}")))?;
                pixels.row_mut(frame).assign(&ArrayView1::from(&image));
                bar.inc(1);
            }
            let images = self.raster.images_from_pixels(pixels.view())?;
            Ok(ImageStack::new(images, self.raster.mask().clone())?)
        })
    }

    /// Part of each frame's difference that its image leaves unexplained, 0 to 1; `None` where the
    /// frame has bad values or does not differ from the reference.
    pub fn residuals(&self, frames: &Frames) -> Result<Vec<Option<f64>>, CliError> {
        let mut residuals = vec![None; frames.values.nrows()];
        for frame in frames.clean() {
            let values = frames.values.row(frame).to_vec();
            residuals[frame] = self.difference.relative_residual(&values, &frames.reference)?;
        }
        Ok(residuals)
    }
}
