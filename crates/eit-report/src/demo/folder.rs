//! The output folder of a demo and the checks that protect other files in it.

use crate::error::ReportError;
use crate::output::{OutFile, OutFolder, io};
use std::fs;
use std::io::{BufRead as _, BufReader, ErrorKind};
use std::path::{Path, PathBuf};

/// First line of the scene, which marks the folder as a demo's.
const MARK: &str = "# Made by `eit demo`.";
/// Maximum number of conflicting files named in an error.
const NAMED: usize = 3;
/// Files that a demo writes into the folder of each experiment.
const OF_EXPERIMENT: [&str; 5] =
    ["frames.npy", "truth.npy", "images.npy", "raw.npy", "touches.csv"];

/// A folder that the demo may write to.
pub(super) struct DemoFolder {
    path: PathBuf,
}

impl DemoFolder {
    /// Claims a new or empty folder, or that of an earlier demo, whose results are removed. A
    /// folder with other content is accepted only with `force`, and then only files with names used
    /// by the demo are changed.
    pub(crate) fn claim(
        path: impl AsRef<Path>,
        own: &[&str],
        force: bool,
    ) -> Result<Self, ReportError> {
        let path = path.as_ref();
        let folder = Self { path: path.to_path_buf() };
        let strangers = folder.strangers(own)?;
        if let ([first, rest @ ..], false) = (&strangers[..], force) {
            let mut names = first.clone();
            for name in rest.iter().take(NAMED - 1) {
                names += &format!(", {name}");
            }
            if strangers.len() > NAMED {
                names += &format!(" and {} more", strangers.len() - NAMED);
            }
            return Err(ReportError::input(format!(
                "{}: contains {names}, which no demo made: choose another folder with --out, or \
                 keep these files and write into the folder anyway with --force",
                path.display()
            )));
        }
        OutFolder::new(path)?;
        for name in own {
            folder.remove(&path.join(name))?;
        }
        Ok(folder)
    }

    /// Returns the entries that were not written by an earlier demo.
    fn strangers(&self, own: &[&str]) -> Result<Vec<String>, ReportError> {
        let refused = |e: std::io::Error| {
            ReportError::input(format!("{}: cannot be read: {e}", self.path.display()))
        };
        let entries = match fs::read_dir(&self.path) {
            // the folder does not exist; whether it can be created shows later
            Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Ok(Vec::new());
            }
            entries => entries.map_err(refused)?,
        };
        let is_demo = fs::File::open(self.scene()).is_ok_and(|file| {
            BufReader::new(file).lines().next().and_then(Result::ok).as_deref() == Some(MARK)
        });
        let mut strangers = Vec::new();
        for entry in entries {
            let name = entry.map_err(refused)?.file_name().to_string_lossy().into_owned();
            // a killed run leaves its temporary files
            if !(is_demo && own.contains(&&*name) || name.starts_with(".eit-")) {
                strangers.push(name);
            }
        }
        strangers.sort();
        Ok(strangers)
    }

    /// Removes a result of an earlier demo: a file, or a folder with the files that a demo writes
    /// there.
    fn remove(&self, place: &Path) -> Result<(), ReportError> {
        let gone = |result: std::io::Result<()>| match result {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(ReportError::at(place, e)),
            _ => Ok(()),
        };
        if !place.is_dir() {
            return gone(fs::remove_file(place));
        }
        for name in OF_EXPERIMENT {
            gone(fs::remove_file(place.join(name)))?;
        }
        // the folder stays if it has other contents
        let _ = fs::remove_dir(place);
        Ok(())
    }

    /// Writes the scene of the recordings, marked as a demo's.
    pub(crate) fn write_scene(&self, text: &str) -> Result<(), ReportError> {
        OutFile::new(&self.scene())?.write(|out| writeln!(out, "{MARK}\n{text}").map_err(io))
    }

    /// Returns where the demo writes its scene.
    pub(crate) fn scene(&self) -> PathBuf {
        self.path.join("scene.toml")
    }

    /// Path of an entry of the folder.
    pub(crate) fn join(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}
