//! What looks for touches, set up for one noise level: image and segmentation, or the fit.

use super::super::bench::{Entrant, Entry};
use super::lab::{Lab, RADIUS_M, Random};
use crate::error::ReportError;
use eit_inverse::touch::{
    Bell, FitResult, FitSettings, NoiseFloor, Touch, TouchFit, TouchStream, TouchStreamSettings,
};
use eit_inverse::{
    HyperparameterChoice, NoiseTarget, OneStepGaussNewton, OneStepSettings, Reconstructor, StTv,
    Stop, Workspace,
};
use eit_skin::Skin;
use eit_skin::method::Method;
use eit_skin::one_step::DEFAULT_NOISE_FIGURE;
use eit_skin::scene::Rule;
use ndarray::{Array2, ArrayView1};

/// Noise added to those images, relative to the peak of a touch: most of their pixels are exactly
/// zero, and no deviation may be.
const JITTER: f64 = 1e-3;

/// Gap of ST-TV, the default of `eit reconstruct`.
const TARGET_GAP: f64 = 1e-2;

/// Every way to find touches in one frame.
pub(super) struct Eyes<'a> {
    lab: &'a Lab,
    /// Standard deviation of the noise of a difference, volt.
    pub noise_std_v: f64,
    /// One-step images.
    pub one_step: Reconstructor,
    workspace: Workspace,
    one_step_touches: TouchStream,
    /// ST-TV of single frames, and where its images rise above noise.
    tv: Option<(StTv, TouchStream)>,
    /// Bells on the forward model.
    pub fit: TouchFit<'a>,
    pixels: Vec<f64>,
}

impl<'a> Eyes<'a> {
    /// For a noise level, with the mesh that a fit of one touch then needs.
    pub fn new(lab: &'a Lab, noise_db: f64) -> Result<Self, ReportError> {
        Self::fitting_on(lab, noise_db, lab.fitting(noise_db))
    }

    /// For a noise level and a mesh to fit on.
    pub fn fitting_on(lab: &'a Lab, noise_db: f64, skin: &'a Skin) -> Result<Self, ReportError> {
        let noise_std_v = lab.noise_std_v(noise_db);
        let (one_step, floor) = one_step(lab, noise_std_v)?;
        let stream = TouchStream::new(lab.cells.clone(), floor, every_image_alone())?;
        let sheet = skin.background_s();
        let settings = FitSettings::with_noise(vec![noise_std_v; lab.reference_v.len()]);
        let fit = TouchFit::new(&skin.model, skin.mesh.surface(), &sheet, settings)?;
        Ok(Self {
            workspace: one_step.workspace(),
            pixels: vec![0.0; one_step.image_len()],
            one_step_touches: stream,
            lab,
            noise_std_v,
            one_step,
            tv: None,
            fit,
        })
    }

    /// Touches of a one-step image, the strongest first.
    pub fn one_step(
        &mut self,
        frame: &[f64],
        reference: &[f64],
    ) -> Result<Vec<Touch>, ReportError> {
        let image = &mut self.pixels;
        self.one_step.reconstruct_into(frame, reference, &mut self.workspace, image)?;
        strongest_first(&self.one_step_touches, image)
    }

    /// Chooses the weights of ST-TV on frames, and measures its noise with them.
    pub fn open_tv(&mut self, frames: Array2<f64>, reference: &[f64]) -> Result<(), ReportError> {
        let mut solver = total_variation(self.lab, frames, reference, self.noise_std_v)?;
        let mut random = Random::new(5, 0);
        let mut images = Array2::zeros((self.lab.quiet, self.pixels.len()));
        let jitter = JITTER * super::lab::AMPLITUDE * self.lab.sheet_s();
        for mut row in images.rows_mut() {
            let quiet = random.noisy(reference, self.noise_std_v);
            let image = tv_image(self.lab, &mut solver, &quiet, reference)?;
            row.iter_mut().zip(&image).for_each(|(r, x)| *r = x + jitter * random.normal());
        }
        let floor = NoiseFloor::of_quiet_images(images.view())?;
        let stream = TouchStream::new(self.lab.cells.clone(), floor, every_image_alone())?;
        self.tv = Some((solver, stream));
        Ok(())
    }

    /// Touches of the ST-TV image of a single frame, the strongest first; none before
    /// [`open_tv`](Self::open_tv).
    pub fn tv(&mut self, frame: &[f64], reference: &[f64]) -> Result<Vec<Touch>, ReportError> {
        let Some((solver, stream)) = &mut self.tv else { return Ok(Vec::new()) };
        let image = tv_image(self.lab, solver, frame, reference)?;
        strongest_first(stream, &image)
    }

    /// Bells to start from: those of a one-step image, or its highest pixel where it shows none.
    pub fn starts(&mut self, frame: &[f64], reference: &[f64]) -> Result<Vec<Bell>, ReportError> {
        let touches = self.one_step(frame, reference)?;
        if touches.is_empty() {
            let highest = self.pixels.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            let place = highest.map_or([0.0; 3], |(k, _)| self.lab.cells.positions_m()[k]);
            return Ok(vec![Bell { position_m: place, amplitude: 0.2, radius_m: RADIUS_M }]);
        }
        Ok(touches.iter().map(|touch| start(touch, self.lab.sheet_s())).collect())
    }

    /// One bell, from the strongest start.
    pub fn one_bell(&mut self, frame: &[f64], reference: &[f64]) -> Result<FitResult, ReportError> {
        let starts = self.starts(frame, reference)?;
        Ok(self.fit.fit(frame, reference, &starts[..1])?)
    }
}

/// A bell that looks like a touch: half of its peak is at `radius sqrt(2 ln 2)`.
fn start(touch: &Touch, sheet_s: f64) -> Bell {
    let radius_m = (touch.area_m2 / (2.0 * std::f64::consts::LN_2 * std::f64::consts::PI)).sqrt();
    Bell {
        position_m: touch.position_m,
        amplitude: (touch.peak_s / sheet_s).clamp(-0.5, 2.0),
        radius_m: radius_m.clamp(4e-3, 0.03),
    }
}

/// Settings under which every image is judged alone.
fn every_image_alone() -> TouchStreamSettings {
    TouchStreamSettings { birth_hits: 1, birth_frames: 1, ..Default::default() }
}

/// Touches of one image by a stream that has seen none.
fn strongest_first(stream: &TouchStream, image: &[f64]) -> Result<Vec<Touch>, ReportError> {
    let mut touches = stream.clone().push(image, 0.0)?.to_vec();
    touches.sort_by(|a, b| b.peak_s.total_cmp(&a.peak_s));
    Ok(touches)
}

/// The detector of `eit reconstruct`: weighted by the noise, noise figure 1; and its noise floor.
pub(super) fn one_step(
    lab: &Lab,
    noise_std_v: f64,
) -> Result<(Reconstructor, NoiseFloor), ReportError> {
    let bench = &lab.bench;
    let data = bench.linearised.difference_data();
    let noise_std = data.noise_std(&vec![noise_std_v; lab.reference_v.len()])?;
    let settings =
        OneStepSettings { data, noise_std: Some(noise_std.clone()), ..Default::default() };
    let mut difference =
        OneStepGaussNewton::new(&bench.linearised.jacobian, bench.prior.as_ref(), settings)?;
    let surface = bench.skin().mesh.surface();
    let target = NoiseTarget::central(surface, &bench.linearised.jacobian)?;
    let figure = DEFAULT_NOISE_FIGURE;
    difference
        .choose_hyperparameter(&HyperparameterChoice::NoiseFigure { figure, target: &target })?;
    let reconstructor = difference.on_raster(bench.raster.pixel_from_element())?;
    let floor = NoiseFloor::of_reconstruction(&reconstructor, &noise_std)?;
    Ok((reconstructor, floor))
}

/// ST-TV with the bound that pressing only raises the conductivity, its weights chosen on frames.
pub(super) fn total_variation(
    lab: &Lab,
    frames: Array2<f64>,
    reference: &[f64],
    noise_std_v: f64,
) -> Result<StTv, ReportError> {
    let entrant = Entrant { method: Method::StTv, lower_s: Some(0.0) };
    let frames = lab.frames(frames, reference);
    let settings = entrant.settings(&lab.bench, Rule::Gcv);
    let fitted = lab.bench.fitted(&frames, noise_std_v, settings);
    let entry = Entry::new(&lab.bench, &fitted, entrant.method)?;
    entry.into_tv().ok_or_else(|| ReportError::Failure("st-tv works on pixels".to_owned()))
}

/// Difference data of a frame as the methods on pixels take it.
pub(super) fn difference(lab: &Lab, frame: &[f64], reference: &[f64]) -> Array2<f64> {
    let row = ArrayView1::from(frame).insert_axis(ndarray::Axis(0)).to_owned();
    lab.frames(row, reference).differences(lab.bench.kind())
}

fn tv_image(
    lab: &Lab,
    solver: &mut StTv,
    frame: &[f64],
    reference: &[f64],
) -> Result<Vec<f64>, ReportError> {
    let values = difference(lab, frame, reference);
    let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
    let movie = solver.solve(&eit_inverse::DifferenceFrames::all_good(values.view()), &stop)?;
    Ok(movie.images.row(0).to_vec())
}
