//! A skin linearised at its untouched state: the starting point of every linear method.

use crate::displacement;
use crate::error::SkinError;
use crate::limits::rounding_warning;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, PriorKind, ReconstructionSettings};
use crate::skin::Skin;
use crate::weave::Weave;
use eit_fem::SolveReport;
use eit_inverse::{
    DifferenceData, Gaussian, GaussianSettings, Laplace, LaplaceSettings, Noser, Prior, Tikhonov,
};
use eit_mesh::Raster;
use ndarray::{Array1, Array2};
use std::sync::OnceLock;

/// Voltages and Jacobian for the homogeneous background.
///
/// ```
/// use eit_skin::{Progress, Scene, Skin};
///
/// let skin = Skin::from_scene(Scene::load("paper-disc")?)?;
/// let linearised = skin.linearise(&mut Progress::silent())?;
/// assert_eq!(linearised.voltages.len(), skin.protocol.measurements());
/// # Ok::<(), eit_skin::SkinError>(())
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct LinearisedSkin {
    /// The skin at whose conductivity the model is linearised.
    pub skin: Skin,
    /// Voltages for the background, volt.
    pub voltages: Array1<f64>,
    /// [measurement, element], volt per siemens.
    pub jacobian: Array2<f64>,
    /// Derivatives for electrode movement, if electrodes move: [measurement, displacement], volt per metre.
    pub movement: Option<Array2<f64>>,
    /// Report of the forward solve.
    pub report: SolveReport,
    /// Effect of rounding, if it may matter.
    pub warning: Option<String>,
    /// Whether the data are already differences, white with standard deviation 1, because nuisance parameters
    /// were removed.
    pub(crate) is_white: bool,
    raster: OnceLock<Raster>,
}

impl Skin {
    /// Computes voltages and Jacobian for the homogeneous background, and their derivatives for electrode
    /// movement if the settings allow it.
    ///
    /// # Errors
    ///
    /// A model that cannot be solved, or whose voltages have no certain digit.
    pub fn linearise(&self, progress: &mut Progress) -> Result<LinearisedSkin, SkinError> {
        let background = self.background_s();
        let mut linearised = progress.stage("forward and Jacobian", || {
            let mut workspace = self.model.workspace()?;
            let mut solution = self.solve(&background, &mut workspace)?;
            let report = solution.report();
            let warning = rounding_warning(&report)?;
            let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
            Ok::<_, SkinError>(LinearisedSkin {
                skin: self.clone(),
                voltages,
                jacobian,
                movement: None,
                report,
                warning,
                is_white: false,
                raster: OnceLock::new(),
            })
        })?;
        if self.settings.reconstruction.electrode_movement_m.is_some() {
            linearised.movement = Some(displacement::jacobian(&background, self, progress)?);
        }
        Ok(linearised)
    }
}

impl LinearisedSkin {
    /// Returns the skin with other reconstruction settings.
    pub fn with_reconstruction(mut self, settings: ReconstructionSettings) -> Self {
        if settings.pixels != self.skin.settings.reconstruction.pixels {
            self.raster = OnceLock::new();
        }
        self.skin.settings.reconstruction = settings;
        self
    }

    /// Chooses the settings left open, within the skin's `frame_time_s`; requires feature `plan`.
    ///
    /// # Errors
    ///
    /// `frame_time_s` is set without that feature.
    #[cfg(not(feature = "plan"))]
    pub fn in_frame_time(self, _frames: Option<usize>, _live: bool) -> Result<Self, SkinError> {
        match self.skin.settings.reconstruction.frame_time_s {
            None => Ok(self),
            Some(_) => Err(SkinError::input(
                "reconstruction.frame_time_s: this program was built without plans (feature `plan` of \
                 eit-skin)",
            )
            .within(&self.skin.place)),
        }
    }

    /// Returns the skin linearised with a weave.
    pub(crate) fn with_weave(&self, weave: Weave) -> Result<Self, SkinError> {
        let skin = self.skin.with_weave(weave)?;
        Ok(Self { raster: self.raster.clone(), ..skin.linearise(&mut Progress::silent())? })
    }

    /// Returns the skin with a Jacobian for white differences.
    pub(crate) fn whitened(&self, jacobian: Array2<f64>) -> Self {
        Self { jacobian, movement: None, is_white: true, ..self.clone() }
    }

    /// Returns whether differences are plain or normalised.
    pub fn difference_kind(&self) -> DifferenceKind {
        if self.is_white { DifferenceKind::Plain } else { self.skin.difference_kind() }
    }

    /// Returns what is subtracted and divided by, for methods that use the element Jacobian.
    pub(crate) fn difference_data(&self) -> DifferenceData {
        match self.difference_kind() {
            DifferenceKind::Plain => DifferenceData::Plain,
            DifferenceKind::Normalised => {
                DifferenceData::Normalised { model_voltages_v: self.voltages.to_vec() }
            }
        }
    }

    /// Returns the pixel raster of the skin's images, built on first use.
    ///
    /// # Errors
    ///
    /// The errors of [`Raster::new`].
    pub fn raster(&self, progress: &mut Progress) -> Result<&Raster, SkinError> {
        if let Some(raster) = self.raster.get() {
            return Ok(raster);
        }
        let raster = self.skin.raster(progress)?;
        Ok(self.raster.get_or_init(|| raster))
    }

    /// Returns the prior that the settings name, else Laplace's.
    ///
    /// # Errors
    ///
    /// The errors of the prior.
    pub fn prior(&self) -> Result<Box<dyn Prior + Send + Sync>, SkinError> {
        let surface = self.skin.mesh.surface();
        let keys = &self.skin.settings.reconstruction;
        let length = keys.correlation_length_m;
        Ok(match keys.prior.unwrap_or(PriorKind::Laplace) {
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

    /// Converts rows of a Jacobian to derivatives of the differences: divided by the model's voltages if data
    /// are normalised, zero where a measurement is not used.
    pub(crate) fn rows_of_differences(
        &self,
        mut rows: Array2<f64>,
        used: &[bool],
    ) -> Result<Array2<f64>, SkinError> {
        self.difference_data().apply_to_rows(&mut rows, Some(used))?;
        Ok(rows)
    }

    /// Whether images use each measurement, `[measurement]`: all, except those on current-carrying electrodes
    /// if the settings omit these.
    #[cfg(feature = "denoise")]
    pub(crate) fn imaging_measurements(&self) -> Vec<bool> {
        let driven = crate::frames::on_driven_electrodes(&self.skin.protocol);
        let use_driven = self.skin.settings.reconstruction.use_driven_electrodes;
        driven.into_iter().map(|driven| use_driven || !driven).collect()
    }

    /// Returns the Jacobian of differences with respect to pixels, `[measurement, masked pixel]`: the element
    /// Jacobian times the matrix from pixels to elements.
    ///
    /// # Errors
    ///
    /// A raster of another mesh.
    pub fn pixel_jacobian(&self, raster: &Raster, used: &[bool]) -> Result<Array2<f64>, SkinError> {
        let from_pixel = raster.element_from_pixel();
        let jacobian = from_pixel.premultiply_dense(self.jacobian.view())?;
        self.rows_of_differences(jacobian, used)
    }
}
