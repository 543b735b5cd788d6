//! Runs the program as a user does.

#[cfg(unix)]
pub mod emulated;

use ndarray::{Array, Array2, Dimension};
use ndarray_npy::ReadNpyExt as _;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// The program with the arguments of a line. A space in a path is written as `\u{a0}`, see [`scene`].
pub fn command(line: impl AsRef<str>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_eit"));
    command.args(line.as_ref().split_ascii_whitespace().map(|word| word.replace('\u{a0}', " ")));
    command
}

/// Runs `eit` with the arguments of a line.
pub fn eit(line: impl AsRef<str>) -> Output {
    command(line).output().expect("the program starts")
}

/// What a run wrote to stderr.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What a run wrote to stdout.
pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Runs `eit` and expects success; returns stdout.
pub fn succeed(line: impl AsRef<str>) -> String {
    let output = eit(&line);
    let stderr = stderr(&output);
    assert!(output.status.success(), "eit {}: {stderr}", line.as_ref());
    assert_eq!(stderr, "", "nothing of the progress may reach a pipe");
    stdout(&output)
}

/// The same with `--json`; returns the answer.
pub fn answer(line: impl AsRef<str>) -> Value {
    parse(&succeed(format!("{} --json", line.as_ref())))
}

/// Parses an answer.
pub fn parse(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// Runs `eit` and expects a rejection with exit code 2 and one line; returns the line.
pub fn refuse(line: impl AsRef<str>) -> String {
    let output = eit(&line);
    assert!(output.stdout.is_empty());
    one_line(&output, 2, line.as_ref())
}

/// Runs `eit` and expects a failure with exit code 1 and one line; returns the line.
#[cfg(feature = "train")]
pub fn fail(line: impl AsRef<str>) -> String {
    one_line(&eit(&line), 1, line.as_ref())
}

fn one_line(output: &Output, code: i32, line: &str) -> String {
    let stderr = stderr(output);
    assert_eq!(output.status.code(), Some(code), "eit {line}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "one line: {stderr}");
    stderr
}

/// Path of a scene that comes with the project, as a word of a line.
pub fn scene(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/scenes").join(name);
    path.to_str().unwrap().replace(' ', "\u{a0}")
}

/// A temporary folder with paths as text.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        assert!(!folder.path().to_str().unwrap().contains(' '), "tests run in {folder:?}");
        Self(folder)
    }

    /// Path of a file in it.
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// Paths of several files in it.
    pub fn paths<const N: usize>(&self, names: [&str; N]) -> [String; N] {
        names.map(|name| self.path(name))
    }

    /// Writes a file in it.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    /// Writes an array as `.npy` in it.
    pub fn write_array<D: Dimension>(&self, name: &str, array: &Array<f64, D>) -> String {
        let path = self.path(name);
        ndarray_npy::write_npy(&path, array).unwrap();
        path
    }

    /// A scene file in it: [`SMALL`] and more keys.
    pub fn scene(&self, more: &str) -> String {
        self.write("scene.toml", format!("{SMALL}\n{more}"))
    }

    /// Names of all files in it, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }
}

pub fn exists(path: impl AsRef<Path>) -> bool {
    path.as_ref().exists()
}

pub fn read(path: impl AsRef<Path>) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.as_ref().display()))
}

pub fn read_text(path: impl AsRef<Path>) -> String {
    String::from_utf8(read(path)).unwrap()
}

/// Reads an array of numbers.
pub fn read_array<D: Dimension>(path: impl AsRef<Path>) -> Array<f64, D> {
    Array::read_npy(&read(path)[..]).unwrap()
}

/// Values of a recording or table, [frame, value].
pub fn recorded(path: impl AsRef<Path>, complex: bool) -> Array2<f64> {
    let options = eit_hw::ReadOptions { complex, ..Default::default() };
    eit_hw::read_recording(path, None, &options).unwrap().real
}

/// A small valid scene; tests break one part of it.
pub const SMALL: &str = r#"
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 8
width_m = 0.02
contact_impedance_ohm_m = 1e3

[protocol]
drive = "adjacent"
current_a = 1e-4

[mesh]
edge_m = 0.012
"#;

/// Two hundred frames of 40 values: quiet at first, then a finger that stays.
pub fn touched_frames(folder: &Folder, scene: &str) -> (String, Array2<f64>) {
    let [voltages, mesh] = folder.paths(["v.npy", "m.msh"]);
    succeed(format!("mesh {scene} --out {mesh}"));
    let surface = eit_mesh::read_gmsh(&mesh).unwrap().surface().clone();
    let finger = |c: [f64; 3]| (-((c[0] - 0.03).powi(2) + c[1] * c[1]) / 0.01_f64.powi(2)).exp();
    let values = surface.centroids().into_iter().map(|c| 1e-5 * (1.0 + 0.5 * finger(c)));
    let values = ndarray::Array1::from_iter(values).insert_axis(ndarray::Axis(0));
    let sigma = folder.write_array("s.npy", &values);
    let solve = |more: &str| -> ndarray::Array1<f64> {
        succeed(format!("forward {scene} --mesh {mesh} --out {voltages} {more}"));
        read_array(&voltages)
    };
    let (still, touched) = (solve(""), solve(&format!("--conductivity {sigma}")));
    let size = still.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let frames = Array2::from_shape_fn((200, still.len()), |(frame, i)| {
        let noise = 1e-5 * size * ((frame * 7919 + i * 104_729) as f64).sin();
        noise + if frame > 100 { touched[i] } else { still[i] }
    });
    (folder.write_array("touched.npy", &frames), frames)
}
