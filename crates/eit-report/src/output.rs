//! Output files are written under a temporary name in the target folder and then renamed, so that
//! incomplete files are never visible and existing files are not lost. Whether a folder is writable
//! is checked before computing.

mod stack;
mod stray;

pub(crate) use stack::{ImageFile, npy_header};
pub use stray::{remember, remove_temporaries};

use crate::error::ReportError;
use eit_picture::{Canvas, Plot};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// An output file. Its folder was writable when it was reserved.
pub struct OutFile {
    path: PathBuf,
}

impl OutFile {
    /// Reserves a path. Where it is a link, the file that it names is written.
    ///
    /// # Errors
    ///
    /// A path that cannot be written, or that is a folder where a file is meant (and the other way round); a
    /// device or pipe, which would be replaced by a file; a link to nothing.
    pub fn new(path: impl AsRef<Path>) -> Result<Self, ReportError> {
        let path = path.as_ref();
        let refused =
            |message: &str| Err(ReportError::input(format!("{}: {message}", path.display())));
        let path = match path.canonicalize() {
            Ok(found) if found.is_dir() => {
                return refused("is a folder, but --out must name a file here");
            }
            Ok(found) if !found.is_file() => {
                return refused("is a device, pipe or socket, but --out must name a file here");
            }
            Ok(found) if path.is_symlink() => found,
            Err(_) if path.is_symlink() => {
                return refused("is a link to nothing: remove it, or name another file");
            }
            _ => path.to_path_buf(),
        };
        // removed again at once: a program that is killed while it computes leaves nothing behind
        drop(Self::temporary(&path)?);
        Ok(Self { path })
    }

    fn temporary(path: &Path) -> Result<NamedTempFile, ReportError> {
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        // named after the file, so that the next run removes what one that was killed has left
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        // at most 240 of the 255 bytes that a name may have
        let name: String = name.chars().take(60).collect();
        let prefix = format!(".eit-{name}.");
        remove_left(folder, &prefix);
        temporary_in(folder, &prefix).map_err(|e| {
            let message =
                format!("{}: cannot write in this folder: {}", folder.display(), e.kind());
            ReportError::input(message)
        })
    }

    /// Writes the content and renames the file to its final path.
    ///
    /// # Errors
    ///
    /// Those of the content, and a disk that is full.
    pub fn write(
        self,
        content: impl FnOnce(&mut dyn Write) -> Result<(), ReportError>,
    ) -> Result<(), ReportError> {
        let path = self.path;
        let mut writer = BufWriter::new(Self::temporary(&path)?);
        fill(&mut writer, &path, content)?;
        let temporary = writer.into_inner().map_err(|e| ReportError::at(&path, e.error()))?;
        temporary.persist(&path).map_err(|e| ReportError::at(&path, e.error))?;
        Ok(())
    }
}

impl std::fmt::Debug for OutFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OutFile").field("path", &self.path).finish_non_exhaustive()
    }
}

/// An output folder whose files all appear together at the end, or not at all.
#[derive(Debug)]
pub(crate) struct OutFolder {
    path: PathBuf,
    files: Vec<(String, NamedTempFile)>,
}

/// Rejects a file where `--out` names a folder.
///
/// # Errors
///
/// [`ReportError::Input`], before any work.
pub fn check_folder(path: &Path) -> Result<(), ReportError> {
    match path.exists() && !path.is_dir() {
        true => {
            let message = "is a file, but --out must name a folder here";
            Err(ReportError::input(format!("{}: {message}", path.display())))
        }
        false => Ok(()),
    }
}

impl OutFolder {
    /// Creates the folder if necessary and checks that it is writable.
    ///
    /// # Errors
    ///
    /// A path that cannot be written, or that is a folder where a file is meant (and the other way round).
    pub(crate) fn new(path: impl AsRef<Path>) -> Result<Self, ReportError> {
        let path = path.as_ref();
        check_folder(path)?;
        let refused = |e: std::io::Error| {
            ReportError::input(format!(
                "{}: cannot write to this folder: {}; choose another with --out",
                path.display(),
                e.kind()
            ))
        };
        std::fs::create_dir_all(path).map_err(refused)?;
        temporary_in(path, ".eit-").map_err(refused)?;
        Ok(Self { path: path.to_path_buf(), files: Vec::new() })
    }

    /// Writes one file of the folder, under a temporary name for now.
    ///
    /// # Errors
    ///
    /// Those of the content, and a disk that is full.
    pub(crate) fn write(
        &mut self,
        name: &str,
        content: impl FnOnce(&mut dyn Write) -> Result<(), ReportError>,
    ) -> Result<(), ReportError> {
        let mut writer = self.begin(name)?;
        fill(&mut writer, &self.path.join(name), content)?;
        self.end(name, writer)
    }

    /// Begins a file of the folder that is written gradually; [`end`](Self::end) completes it.
    ///
    /// # Errors
    ///
    /// A folder that cannot be written.
    pub(crate) fn begin(&self, name: &str) -> Result<BufWriter<NamedTempFile>, ReportError> {
        let place = self.path.join(name);
        Ok(BufWriter::new(
            temporary_in(&self.path, ".eit-").map_err(|e| ReportError::at(&place, e))?,
        ))
    }

    /// Completes a file begun with [`begin`](Self::begin), under a temporary name for now.
    ///
    /// # Errors
    ///
    /// A disk that is full.
    pub(crate) fn end(
        &mut self,
        name: &str,
        writer: BufWriter<NamedTempFile>,
    ) -> Result<(), ReportError> {
        let place = self.path.join(name);
        let temporary = writer.into_inner().map_err(|e| ReportError::at(&place, e.error()))?;
        self.files.push((name.to_owned(), temporary));
        Ok(())
    }

    /// Renames all files to their final names and removes results of an earlier run that this run
    /// did not write. `own` lists the names that the command may write.
    ///
    /// # Errors
    ///
    /// A file that cannot be renamed or removed.
    pub(crate) fn commit(self, own: &[&str]) -> Result<(), ReportError> {
        let names = self.names();
        let old: Vec<&&str> = own.iter().filter(|name| !names.contains(name)).collect();
        for (name, temporary) in self.files {
            let place = self.path.join(name);
            temporary.persist(&place).map_err(|e| ReportError::at(&place, e.error))?;
        }
        for old in old {
            let old = self.path.join(old);
            match std::fs::remove_file(&old) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(ReportError::at(&old, e));
                }
                _ => {}
            }
        }
        Ok(())
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Names written so far, in order.
    pub(crate) fn names(&self) -> Vec<&str> {
        self.files.iter().map(|(name, _)| name.as_str()).collect()
    }
}

/// Writes the content of a file; errors name the file, not the temporary one.
fn fill(
    writer: &mut BufWriter<NamedTempFile>,
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> Result<(), ReportError>,
) -> Result<(), ReportError> {
    let temporary = writer.get_ref().path().display().to_string();
    content(writer).map_err(|error| match error {
        ReportError::Failure(message) => {
            ReportError::Failure(message.replace(&temporary, &path.display().to_string()))
        }
        other => other,
    })
}

/// Removes the temporary files of this beginning that no program has locked.
fn remove_left(folder: &Path, prefix: &str) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let is_ours = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with(prefix);
    for entry in entries.flatten().filter(|entry| is_ours(&entry.file_name())) {
        if std::fs::File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok()) {
            // another program may have removed it
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

fn temporary_in(folder: &Path, prefix: &str) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // temporary files are private by default; these become ordinary user files
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let file = builder.tempfile_in(folder)?;
    // where there are no locks, nothing counts as left
    let _ = file.as_file().try_lock();
    stray::remember(file.path());
    Ok(file)
}

/// Converts an I/O error of a writer to a failure.
pub fn io(error: std::io::Error) -> ReportError {
    ReportError::Failure(format!("writing failed: {error}"))
}

/// A plot without curves: the label of each axis, and whether it is logarithmic.
pub(crate) fn axes([x, y]: [(&str, bool); 2]) -> Plot {
    Plot {
        title: String::new(),
        footnote: String::new(),
        x_label: x.0.to_owned(),
        y_label: y.0.to_owned(),
        x_log: x.1,
        y_log: y.1,
        series: Vec::new(),
        zoom: 2,
    }
}

/// A picture in PNG format.
pub(crate) fn png(canvas: &Canvas) -> Result<Vec<u8>, ReportError> {
    let mut bytes = Vec::new();
    canvas.write_png(&mut bytes)?;
    Ok(bytes)
}

/// Writes an array of real or complex numbers as `.npy`.
///
/// # Errors
///
/// A writer that fails.
pub fn write_npy<S, D>(
    array: &ndarray::ArrayBase<S, D>,
    out: &mut dyn Write,
) -> Result<(), ReportError>
where
    S: ndarray::Data,
    S::Elem: ndarray_npy::WritableElement,
    D: ndarray::Dimension,
{
    use ndarray_npy::WriteNpyExt as _;
    array.write_npy(out).map_err(|e| ReportError::Failure(format!("writing failed: {e}")))
}

/// Writes rows of numbers as comma-separated text, in the shortest form that reads back exactly.
///
/// # Errors
///
/// A writer that fails.
pub fn write_csv(
    rows: ndarray::ArrayView2<'_, f64>,
    out: &mut dyn Write,
) -> Result<(), ReportError> {
    for row in rows.rows() {
        let line: Vec<String> = row.iter().map(|v| format!("{v:e}")).collect();
        writeln!(out, "{}", line.join(",")).map_err(io)?;
    }
    Ok(())
}

/// Returns the extension of a path in lower case.
pub fn ending(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase())
}

/// Reads the images of a file: [frame, row, column].
///
/// # Errors
///
/// A file that cannot be read, or whose array is not [frame, row, column] of numbers.
pub(crate) fn read_images(path: impl AsRef<Path>) -> Result<ndarray::Array3<f64>, ReportError> {
    let path = path.as_ref();
    let array = eit_hw::read_array(path)?;
    let shape = array.shape().to_vec();
    array.into_dimensionality().map_err(|_| {
        let place = path.display();
        ReportError::input(format!(
            "{place}: has the shape {shape:?}; expected [frame, row, column]"
        ))
    })
}
