//! Images and touches of a whole recording, as `eit reconstruct` computes them.

#[cfg(feature = "denoise")]
use crate::denoise::{Check, Checked, Net};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::limits::{check_images, check_pixel_jacobian};
use crate::method::{self, Method, MethodChoice};
use crate::movement::WithoutMovement;
use crate::one_step::Imaging;
use crate::progress::Progress;
use crate::sequence;
use crate::skin::Skin;
use crate::total_variation::TvMovie;
use crate::touches::{self, Touches};
use eit_inverse::{DifferenceFrames, SequenceReport};
use eit_mesh::Raster;
use ndarray::Array3;
use std::sync::Arc;

/// Images of a recording.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Images {
    /// Changes of the conductivity, siemens, [frame, row, column], NaN outside the skin.
    pub values: Array3<f64>,
    /// Pixels of the images.
    pub raster: Raster,
    /// What they were made with.
    pub solver: ImageSolver,
    /// The data without electrode movement, which the images were made from, if it was removed.
    pub without: Option<WithoutMovement>,
}

/// What images were made with.
#[derive(Debug, Clone)]
pub enum ImageSolver {
    /// A Gauss-Newton method.
    GaussNewton {
        /// The one-step reconstruction, whose hyperparameter the methods for sequences share.
        imaging: Box<Imaging>,
        /// Report of a method for sequences; `None` for one-step images.
        sequence: Option<SequenceReport>,
    },
    /// Total variation.
    TotalVariation(Box<TvMovie>),
}

/// Images and touches of a recording.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Reconstruction {
    /// Frames and model; without the values that are excluded for the touches.
    pub fitted: FittedFrames,
    /// The method, and why it was chosen.
    pub choice: MethodChoice,
    /// Touches; `None` if the noise of the data is unknown.
    pub touches: Option<Touches>,
    /// Images.
    pub images: Images,
    /// The U-net that the settings name, which [`Reconstruction::denoise`] applies.
    #[cfg(feature = "denoise")]
    pub net: Option<Net>,
    /// Frames whose images come from a U-net that was trained for this skin.
    pub(crate) cleaned_frames: Vec<bool>,
}

impl Skin {
    /// Finds touches and makes images by the given method, else that of the settings, else the one that suits them.
    ///
    /// ```
    /// use eit_skin::ndarray::{Axis, stack};
    /// use eit_skin::scene::Reference;
    /// use eit_skin::{Progress, Scene, Skin};
    ///
    /// let mut scene = Scene::load("paper-disc")?;
    /// scene.recording.reference = Some(Reference::Frame(0));
    /// let skin = Skin::from_scene(scene)?;
    /// let rest = skin.model.forward(&skin.background_s())?;
    /// let touched = rest.mapv(|v| v / 1.05);
    /// let values = stack(Axis(0), &[rest.view(), touched.view()])?;
    ///
    /// let made = skin.reconstruct(skin.frames_of_values(&values)?, None, &mut Progress::silent())?;
    /// assert_eq!(made.images.values.shape(), [2, 64, 64]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// An unknown method; weights of a U-net that do not fit, before any work; images that do not fit in memory; the
    /// errors of the method.
    pub fn reconstruct(
        &self,
        frames: Frames,
        method: Option<&str>,
        progress: &mut Progress,
    ) -> Result<Reconstruction, SkinError> {
        let count = frames.values.nrows();
        check_images(count, self.pixels())?;
        let linearised = self.linearise(progress)?.in_frame_time(Some(count), false)?;
        let choice = method::choose(&linearised.skin.settings, method, Some(count))?;
        if choice.method.is_tv() {
            check_pixel_jacobian(frames.values.ncols(), linearised.skin.pixels())?;
        }
        #[cfg_attr(not(feature = "denoise"), expect(unused_variables, reason = "there is no net"))]
        let net = self.net()?;
        let mut fitted = Arc::new(linearised).fit(frames)?;
        if !fitted.fit.is_alike() {
            // before work that may be for nothing, and is long where the model cannot explain the frames
            fitted.frames.notes.iter().for_each(|note| progress.note(note));
        }
        let touches = touches::touches(&fitted, progress)?;
        if let Some(found) = &touches {
            // images do not use faulty electrodes
            found.leave_out(&mut fitted.frames);
        }
        let images = fitted.images(choice.method, progress)?;
        Ok(Reconstruction {
            fitted,
            choice,
            touches,
            images,
            #[cfg(feature = "denoise")]
            net,
            cleaned_frames: vec![false; count],
        })
    }
}

impl FittedFrames {
    /// Makes images. If the settings say that electrodes move, the effect of movement is first removed from the data.
    ///
    /// # Errors
    ///
    /// The errors of the method, and of removing movement.
    pub fn images(&self, method: Method, progress: &mut Progress) -> Result<Images, SkinError> {
        let without = self.without_movement(method, progress)?;
        let left = without.as_ref().map_or(self, |without| &without.fitted);
        if method.is_tv() {
            let raster = left.skin.raster(progress)?.clone();
            let movie = left.total_variation(method, progress)?;
            let values = raster.images_from_pixels(movie.pixels.view())?;
            let solver = ImageSolver::TotalVariation(Box::new(movie));
            return Ok(Images { values, raster, solver, without });
        }
        let imaging = match &without {
            Some(without) => without.one_step(progress)?,
            None => None,
        };
        let imaging = match imaging {
            Some(imaging) => imaging,
            None => left.one_step(progress)?,
        };
        let (values, sequence) = match method {
            Method::GaussNewton => (imaging.images(&left.frames, progress)?.into_parts().0, None),
            _ => {
                let (images, report) = left.sequence(method, &imaging, progress)?;
                (images, Some(report))
            }
        };
        let raster = imaging.raster.clone();
        let solver = ImageSolver::GaussNewton { imaging: Box::new(imaging), sequence };
        Ok(Images { values, raster, solver, without })
    }

    /// Returns whether the noise of the data is stated, as opposed to treating them as white.
    pub fn states_noise(&self) -> bool {
        self.skin.is_white || self.skin.skin.settings.noise.additive_v.is_some()
    }

    /// Images [frame, row, column] of a method for sequences, with the hyperparameter of one-step images.
    fn sequence(
        &self,
        method: Method,
        imaging: &Imaging,
        progress: &mut Progress,
    ) -> Result<(Array3<f64>, SequenceReport), SkinError> {
        let prior = self.skin.prior()?;
        let mut settings = self.one_step_settings()?;
        settings.hyperparameter = imaging.difference.report().hyperparameter;
        if self.states_noise() {
            // with gain and reference, so that residuals are in units of the noise; images depend only
            // on ratios
            settings.noise_std = self.noise()?.map(|noise| noise.std);
        }
        let built = progress.stage("set-up of the method", || {
            sequence::method(method, &self.skin, prior.as_ref(), settings)
        })?;
        let Some(mut solver) = built else {
            return Err(SkinError::Failure(format!("{} works on pixels", method.name())));
        };
        let values = self.frames.differences(imaging.kind);
        let good = Some(self.frames.good.view());
        let differences = DifferenceFrames { values: values.view(), good };
        let movie = progress.stage("images", || solver.reconstruct_sequence(&differences))?;
        let pixels = sequence::pixels_of(movie.images.view(), &imaging.raster)?;
        Ok((imaging.raster.images_from_pixels(pixels.view())?, movie.report))
    }
}

impl Reconstruction {
    /// Returns the frames that the images were made from: without electrode movement, if it was removed.
    pub fn imaged(&self) -> &FittedFrames {
        self.images.without.as_ref().map_or(&self.fitted, |without| &without.fitted)
    }

    /// Applies the U-net that the settings name to the images; those that do not explain their measurements stay raw.
    /// Returns the verdicts, if there is a net whose weights have a limit.
    ///
    /// # Errors
    ///
    /// The errors of [`Net::apply`].
    #[cfg(feature = "denoise")]
    pub fn denoise(&mut self, progress: &mut Progress) -> Result<Option<Checked>, SkinError> {
        let Some(net) = &self.net else { return Ok(None) };
        // an image is compared with the data that it was made from
        let check = Check::new(self.imaged());
        let check = match &self.touches {
            Some(found) => check.with_touches(found),
            None => check,
        };
        let checked =
            net.apply(&mut self.images.values, &self.images.raster, Some(&check), progress)?;
        self.cleaned_frames.fill(net.is_of_this_skin);
        for &raw in checked.iter().flat_map(|checked| &checked.raw_frames) {
            self.cleaned_frames[raw] = false;
        }
        Ok(checked)
    }
}
