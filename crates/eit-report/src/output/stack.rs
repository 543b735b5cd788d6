//! Files that grow while a command runs, with constant memory use.

use super::{OutFolder, io};
use crate::error::ReportError;
use std::io::{BufWriter, Seek as _, SeekFrom, Write as _};
use tempfile::NamedTempFile;

/// Bytes of the header, which is rewritten once the number of images is known.
const HEADER: usize = 128;

/// A `.npy` stack of images [frame, row, column], written image by image.
#[derive(Debug)]
pub(crate) struct ImageFile {
    name: &'static str,
    file: BufWriter<NamedTempFile>,
    shape: [usize; 2],
    count: usize,
}

impl ImageFile {
    /// Begins a file of a folder, under a temporary name for now.
    ///
    /// # Errors
    ///
    /// A folder that cannot be written.
    pub(crate) fn new(
        folder: &OutFolder,
        name: &'static str,
        shape: [usize; 2],
    ) -> Result<Self, ReportError> {
        let mut file = folder.begin(name)?;
        file.write_all(&npy_header(&[0, shape[0], shape[1]])).map_err(io)?;
        Ok(Self { name, file, shape, count: 0 })
    }

    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    /// Appends an image in row-major order.
    ///
    /// # Errors
    ///
    /// An image of another shape, and a disk that is full.
    pub(crate) fn push(&mut self, image: ndarray::ArrayView2<'_, f64>) -> Result<(), ReportError> {
        let (rows, columns) = image.dim();
        if [rows, columns] != self.shape {
            let [high, wide] = self.shape;
            return Err(ReportError::Failure(format!(
                "{}: an image of {rows} x {columns} pixels follows images of {high} x {wide}",
                self.name
            )));
        }
        for value in image {
            self.file.write_all(&value.to_le_bytes()).map_err(io)?;
        }
        self.count += 1;
        Ok(())
    }

    /// Writes the final header and hands the file to its folder.
    ///
    /// # Errors
    ///
    /// A disk that is full.
    pub(crate) fn finish(self, folder: &mut OutFolder) -> Result<(), ReportError> {
        let Self { name, mut file, shape, count } = self;
        file.seek(SeekFrom::Start(0)).map_err(io)?;
        file.write_all(&npy_header(&[count, shape[0], shape[1]])).map_err(io)?;
        folder.end(name, file)
    }
}

/// Header of a `.npy` file of numbers, format version 1.0 (NumPy enhancement proposal 1); it has the same length for
/// every shape.
pub fn npy_header(shape: &[usize]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let words =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}", shape.join(", "));
    let length = HEADER - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{words:<0$}\n", length - 1).into_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, Axis};
    use ndarray_npy::ReadNpyExt as _;

    /// Other programs read back what was written, even an empty stack.
    #[test]
    fn a_stack_is_read_as_it_was_pushed() {
        for count in [0, 3] {
            let place = tempfile::tempdir().unwrap();
            let mut folder = OutFolder::new(place.path()).unwrap();
            let images =
                Array3::from_shape_fn((count, 2, 5), |(f, i, j)| (100 * f + 10 * i + j) as f64);
            let mut file = ImageFile::new(&folder, "images.npy", [2, 5]).unwrap();
            for image in images.axis_iter(Axis(0)) {
                file.push(image).unwrap();
            }
            assert!(file.push(ndarray::Array2::zeros((5, 2)).view()).is_err());
            file.finish(&mut folder).unwrap();
            assert!(!place.path().join("images.npy").exists(), "nothing before the end");
            folder.commit(&[]).unwrap();
            let file = std::fs::File::open(place.path().join("images.npy")).unwrap();
            assert_eq!(Array3::<f64>::read_npy(file).unwrap(), images);
        }
    }

    /// The longest possible shape does not change the length of the header.
    #[test]
    fn no_count_outgrows_the_header() {
        assert_eq!(npy_header(&[usize::MAX, 65_536, 65_536]).len(), HEADER);
        assert_eq!(npy_header(&[0, 1, 1]).len(), HEADER);
    }
}
