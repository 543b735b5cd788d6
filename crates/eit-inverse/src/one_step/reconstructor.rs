//! Map from frames to images: the part that runs for every frame.

use super::missing::{Damping, MissingData};
use super::spectrum::Spectrum;
use crate::InverseError;
use crate::check::check_length;
use crate::data::{Channels, FrameStatus};
use eit_mesh::CsrMatrix;
use faer::linalg::matmul::matmul;
use faer::{Accum, ColMut, ColRef, Mat, MatMut, MatRef, Par};
use ndarray::{Array1, Array2, ArrayView2};

/// Scratch memory of one thread; with it, reconstructing a frame does not allocate.
#[derive(Debug, Clone)]
pub struct Workspace {
    pub(super) difference: Vec<f64>,
    pub(super) coefficients: Vec<f64>,
    pub(super) missing: MissingData,
}

impl Workspace {
    /// Returns `C dv` of the last computed image, `[rank]`.
    pub(crate) fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }
}

/// Fixed linear map from frames to images on elements or pixels, `Send + Sync`.
///
/// The map is applied as two factors, `image = B (C dv)` with `B` `[image, rank]` and `C`
/// `[rank, measurement]`. One frame costs `2 r (m + n)` flops and reads `8 r (m + n)` bytes once;
/// the product `reconstruction_matrix * dv` costs `2 m n`. With reciprocal data `r <= m / 2`, so
/// the factors halve the work. Both forms are limited by memory bandwidth (a quarter of a flop per
/// byte): 208 measurements and 2000 elements read 1.8 MB per frame.
#[derive(Debug, Clone)]
pub struct Reconstructor {
    pub(crate) channels: Channels,
    rank: usize,
    image_len: usize,
    /// `B`, row-major `[image, rank]`.
    image_basis: Vec<f64>,
    /// `C`, row-major `[rank, used measurement]`.
    data_basis: Vec<f64>,
    pub(super) damping: Damping,
}

impl Reconstructor {
    /// `image_basis` `[image, rank]` row-major.
    pub(crate) fn new(
        channels: Channels,
        image_basis: Vec<f64>,
        spectrum: &Spectrum,
        hyperparameter: f64,
    ) -> Self {
        let rank = spectrum.values.len();
        let image_len = image_basis.len() / rank.max(1);
        let (data_basis, damping) = (Vec::new(), Damping::default());
        let mut this = Self { channels, rank, image_len, image_basis, data_basis, damping };
        this.set_hyperparameter(spectrum, hyperparameter);
        this
    }

    /// `C = diag(1 / (d + mu)) U' W^1/2`.
    pub(crate) fn set_hyperparameter(&mut self, spectrum: &Spectrum, hyperparameter: f64) {
        self.data_basis.clear();
        for (k, f) in spectrum.filter(hyperparameter).iter().enumerate() {
            let weights = self.channels.root_weights.iter().enumerate();
            self.data_basis.extend(weights.map(|(i, w)| f * spectrum.vectors[(i, k)] * w));
        }
        self.damping = Damping::new(spectrum, hyperparameter);
    }

    /// Returns the number of measurements of the protocol, which is the length of a frame.
    pub fn measurements(&self) -> usize {
        self.channels.count
    }

    /// Returns the length of an image: the number of elements, or of pixels after
    /// [`on_raster`](crate::OneStepGaussNewton::on_raster).
    pub fn image_len(&self) -> usize {
        self.image_len
    }

    /// Allocates scratch memory for [`reconstruct_into`](Self::reconstruct_into) and related methods.
    pub fn workspace(&self) -> Workspace {
        Workspace {
            difference: vec![0.0; self.channels.used.len()],
            coefficients: vec![0.0; self.rank],
            missing: MissingData::default(),
        }
    }

    /// Returns the difference data of a frame, `[used measurement]`: volts (plain) or dimensionless
    /// (normalised), with unused measurements removed.
    ///
    /// # Errors
    /// Returns an error for wrong lengths, values that are not finite, and zero reference voltages
    /// with normalised data.
    pub fn difference(
        &self,
        frame: &[f64],
        reference_frame: &[f64],
    ) -> Result<Array1<f64>, InverseError> {
        let mut difference = vec![0.0; self.channels.used.len()];
        self.channels.difference_into(0, frame, reference_frame, &[], &mut difference)?;
        Ok(difference.into())
    }

    /// Reconstructs the image of one frame, `[element]` or `[pixel]`: the change of sheet
    /// conductivity relative to the reference frame, siemens per square, positive where the
    /// conductivity is higher.
    ///
    /// # Errors
    /// See [`difference`](Self::difference).
    pub fn reconstruct(
        &self,
        frame: &[f64],
        reference_frame: &[f64],
    ) -> Result<Array1<f64>, InverseError> {
        let mut image = vec![0.0; self.image_len];
        self.reconstruct_into(frame, reference_frame, &mut self.workspace(), &mut image)?;
        Ok(image.into())
    }

    /// Like [`reconstruct`](Self::reconstruct), but writes into `image` and does not allocate.
    ///
    /// A frame equal to its reference costs only the comparison.
    ///
    /// # Errors
    /// See [`difference`](Self::difference); [`InverseError::WrongLength`] if image or workspace
    /// belong to another reconstruction.
    pub fn reconstruct_into(
        &self,
        frame: &[f64],
        reference_frame: &[f64],
        workspace: &mut Workspace,
        image: &mut [f64],
    ) -> Result<FrameStatus, InverseError> {
        self.check_memory(workspace, image)?;
        let Workspace { difference, coefficients, .. } = workspace;
        let status = self.channels.difference_into(0, frame, reference_frame, &[], difference)?;
        match status {
            FrameStatus::Computed => {
                self.to_coefficients(difference, coefficients);
                self.to_image(coefficients, image);
            }
            FrameStatus::Unchanged => image.fill(0.0),
        }
        Ok(status)
    }

    /// Applies the linear map `image = RM dv` to difference data `[used measurement]`, as returned by
    /// [`difference`](Self::difference).
    ///
    /// Use it for means of frames or for differences computed elsewhere. Does not allocate.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`]; [`InverseError::NonFiniteData`] with frame index 0.
    pub fn reconstruct_difference_into(
        &self,
        difference: &[f64],
        workspace: &mut Workspace,
        image: &mut [f64],
    ) -> Result<FrameStatus, InverseError> {
        self.check_memory(workspace, image)?;
        let status = self.check_difference(difference)?;
        match status {
            FrameStatus::Computed => {
                self.to_coefficients(difference, &mut workspace.coefficients);
                self.to_image(&workspace.coefficients, image);
            }
            FrameStatus::Unchanged => image.fill(0.0),
        }
        Ok(status)
    }

    /// Rejects difference data of the wrong length or with non-finite values; returns whether any
    /// value is non-zero.
    pub(super) fn check_difference(&self, difference: &[f64]) -> Result<FrameStatus, InverseError> {
        check_length("difference", difference.len(), self.channels.used.len())?;
        if let Some(k) = difference.iter().position(|dv| !dv.is_finite()) {
            let (measurement, value) = (self.channels.used[k], difference[k]);
            return Err(InverseError::NonFiniteData { frame: 0, measurement, value });
        }
        let unchanged = difference.iter().all(|dv| *dv == 0.0);
        Ok(if unchanged { FrameStatus::Unchanged } else { FrameStatus::Computed })
    }

    pub(super) fn check_memory(
        &self,
        workspace: &Workspace,
        image: &[f64],
    ) -> Result<(), InverseError> {
        check_length("image", image.len(), self.image_len)?;
        check_length("workspace", workspace.difference.len(), self.channels.used.len())?;
        check_length("workspace", workspace.coefficients.len(), self.rank)
    }

    /// `C dv`.
    pub(super) fn to_coefficients(&self, difference: &[f64], coefficients: &mut [f64]) {
        let (dv, c) = (ColRef::from_slice(difference), ColMut::from_slice_mut(coefficients));
        matmul(c, Accum::Replace, self.data_rows(), dv, 1.0, Par::Seq);
    }

    /// `B c`.
    pub(super) fn to_image(&self, coefficients: &[f64], image: &mut [f64]) {
        let (c, image) = (ColRef::from_slice(coefficients), ColMut::from_slice_mut(image));
        matmul(image, Accum::Replace, self.image_rows(), c, 1.0, Par::Seq);
    }

    /// Reconstructs many frames `[frame, measurement]` at once into images `[frame, element]` or
    /// `[frame, pixel]`.
    ///
    /// Uses matrix-matrix products: the factors are read once per block of frames, not once per
    /// frame.
    ///
    /// # Errors
    /// See [`difference`](Self::difference); the error contains the frame index.
    pub fn reconstruct_frames(
        &self,
        frames: ArrayView2<'_, f64>,
        reference_frame: &[f64],
    ) -> Result<Array2<f64>, InverseError> {
        let difference = self.differences(frames, reference_frame)?;
        let count = frames.nrows();
        let coefficients = self.data_rows() * &difference;
        let mut images = Array2::zeros((count, self.image_len));
        if let Some(values) = images.as_slice_mut() {
            let images = MatMut::from_column_major_slice_mut(values, self.image_len, count);
            matmul(images, Accum::Replace, self.image_rows(), &coefficients, 1.0, Par::Seq);
        }
        Ok(images)
    }

    /// Returns the difference data of frames, `[used measurement, frame]`.
    pub(crate) fn differences(
        &self,
        frames: ArrayView2<'_, f64>,
        reference_frame: &[f64],
    ) -> Result<Mat<f64>, InverseError> {
        check_length("columns of frames", frames.ncols(), self.channels.count)?;
        let mut difference = Mat::zeros(self.channels.used.len(), frames.nrows());
        let mut frame = Vec::with_capacity(frames.ncols());
        let mut dv = vec![0.0; self.channels.used.len()];
        for (index, row) in frames.rows().into_iter().enumerate() {
            frame.clear();
            frame.extend(row);
            self.channels.difference_into(index, &frame, reference_frame, &[], &mut dv)?;
            difference.col_mut(index).copy_from(ColRef::from_slice(&dv));
        }
        Ok(difference)
    }

    /// Returns the reconstruction matrix `RM = B C`, `[image, measurement]`, with `image = RM dv`.
    ///
    /// Columns of unused measurements are zero. Computed at each call (`2 n m r` flops).
    pub fn reconstruction_matrix(&self) -> Array2<f64> {
        let product = self.image_rows() * self.data_rows();
        let mut matrix = Array2::zeros((self.image_len, self.channels.count));
        for (k, &measurement) in self.channels.used.iter().enumerate() {
            (0..self.image_len).for_each(|e| matrix[(e, measurement)] = product[(e, k)]);
        }
        matrix
    }

    /// `B` as a matrix.
    pub(crate) fn image_rows(&self) -> MatRef<'_, f64> {
        MatRef::from_row_major_slice(&self.image_basis, self.image_len, self.rank)
    }

    pub(super) fn data_rows(&self) -> MatRef<'_, f64> {
        MatRef::from_row_major_slice(&self.data_basis, self.rank, self.channels.used.len())
    }

    /// Returns this map followed by a sparse one, `[pixel, element]`.
    pub(crate) fn followed_by(&self, pixel_from_element: &CsrMatrix) -> Result<Self, InverseError> {
        check_length(
            "columns of pixel_from_element",
            pixel_from_element.columns(),
            self.image_len,
        )?;
        let (pixels, rank) = (pixel_from_element.rows(), self.rank);
        let mut image_basis = vec![0.0; pixels * rank];
        for (pixel, sum) in image_basis.chunks_exact_mut(rank).enumerate() {
            let (elements, weights) = pixel_from_element.row(pixel);
            for (&e, weight) in elements.iter().zip(weights) {
                let row = &self.image_basis[e as usize * rank..][..rank];
                sum.iter_mut().zip(row).for_each(|(s, b)| *s += weight * b);
            }
        }
        let (channels, data_basis) = (self.channels.clone(), self.data_basis.clone());
        let damping = self.damping.clone();
        Ok(Self { channels, rank, image_len: pixels, image_basis, data_basis, damping })
    }
}
