//! Runs the program as a user does.

#[cfg(unix)]
pub mod emulated;

use eit_skin::Skin;
use ndarray::{Array, Dimension};
use ndarray_npy::ReadNpyExt as _;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

pub use ndarray::{Array1, Array2, Array3, ArrayView1, Axis, Ix1, Ix2, Ix3};
pub use serde_json::{Value, json};
pub use std::process::{Child, Command, Output, Stdio};
pub use std::time::{Duration, Instant};

/// Maximum time that a test waits.
pub const LIMIT: Duration = Duration::from_secs(240);

/// Waits until something has happened.
pub fn wait_until(mut happened: impl FnMut() -> bool) {
    let start = Instant::now();
    while !happened() {
        assert!(start.elapsed() < LIMIT, "nothing happens");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The program with the arguments of a line, which a failed test prints. `\u{a0}` is a space in a path, see [`scene`].
pub fn command(line: impl AsRef<str>) -> Command {
    println!("eit {}", line.as_ref());
    let mut command = Command::new(env!("CARGO_BIN_EXE_eit"));
    command.args(line.as_ref().split_ascii_whitespace().map(|word| word.replace('\u{a0}', " ")));
    command
}

/// Runs `eit` with the arguments of a line.
pub fn eit(line: impl AsRef<str>) -> Output {
    command(line).output().expect("the program starts")
}

/// `eit` below a shell, after commands of the shell; its arguments have no spaces.
#[cfg(unix)]
pub fn in_shell(before: &str, line: impl AsRef<str>) -> Command {
    let script = format!("{before} exec '{}' {}", env!("CARGO_BIN_EXE_eit"), line.as_ref());
    let mut shell = Command::new("sh");
    shell.args(["-c", &script]);
    shell
}

/// What a run wrote to stdout and to stderr.
pub fn all_said(output: &Output) -> String {
    stdout(output) + &stderr(output)
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
    assert_eq!(ended(&output, 0), "", "nothing of the progress may reach a pipe");
    stdout(&output)
}

/// The same with `--json`; returns the answer.
pub fn answer(line: impl AsRef<str>) -> Value {
    parse(&succeed(format!("{} --json", line.as_ref())))
}

/// Expects this exit code; returns stderr.
pub fn ended(output: &Output, code: i32) -> String {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{}{said}", stdout(output));
    said
}

/// Parses an answer.
pub fn parse(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// Runs `eit` and expects a rejection with exit code 2 and one line; returns the line.
pub fn refuse(line: impl AsRef<str>) -> String {
    let output = eit(&line);
    assert!(output.stdout.is_empty());
    one_line(&output, 2)
}

/// Expects words in a text, or all that stand between `…`.
pub fn says(text: &str, words: impl AsRef<str>) {
    let words = words.as_ref();
    assert!(words.split('…').all(|words| text.contains(words)), "{words}: {text}");
}

/// Expects each of these lines to be rejected with its words, or all that stand between `…`.
pub fn refuse_each<L: AsRef<str>, W: AsRef<str>>(cases: impl IntoIterator<Item = (L, W)>) {
    for (line, words) in cases {
        says(&refuse(&line), words);
    }
}

/// Expects `eit plan` to reject each of these scenes with its words.
pub fn refuse_plans(cases: impl IntoIterator<Item = (String, &'static str)>) {
    let folder = Folder::new();
    for (scene, words) in cases {
        says(&refuse(format!("plan {}", folder.write("scene.toml", &scene))), words);
    }
}

/// [`SMALL`] with another text for a part of it.
pub fn altered(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from), "{from}");
    SMALL.replace(from, to)
}

/// Runs `eit` and expects a failure with exit code 1 and one line; returns the line.
#[cfg(feature = "train")]
pub fn fail(line: impl AsRef<str>) -> String {
    one_line(&eit(&line), 1)
}

/// Expects this exit code and one line on stderr; returns the line.
pub fn one_line(output: &Output, code: i32) -> String {
    let said = ended(output, code);
    assert_eq!(said.trim_end().lines().count(), 1, "one line: {said}");
    said
}

/// Path of a scene that comes with the project, as a word of a line.
pub fn scene(name: &str) -> String {
    let path = root().join("fixtures/scenes").join(name);
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

    /// A folder and a scene file in it: [`SMALL`] and more keys.
    pub fn with_scene(more: &str) -> (Self, String) {
        let folder = Self::new();
        let scene = folder.scene(more);
        (folder, scene)
    }

    /// A folder and paths of files in it.
    pub fn with_paths<const N: usize>(names: [&str; N]) -> (Self, [String; N]) {
        let folder = Self::new();
        let paths = folder.paths(names);
        (folder, paths)
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

    /// [`SMALL`] with another text for a part of it, as the scene file.
    pub fn altered(&self, from: &str, to: &str) -> String {
        self.write("scene.toml", altered(from, to))
    }

    /// Names of all files in it, sorted.
    pub fn names(&self) -> Vec<String> {
        names_in(self.0.path())
    }
}

/// Names of all files in a folder, sorted.
pub fn names_in(folder: impl AsRef<Path>) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All files below a folder with this ending.
pub fn files_below(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (folders, mut found): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    found.retain(|path| path.extension().is_some_and(|of_file| of_file == ending));
    found.extend(folders.iter().flat_map(|folder| files_below(folder, ending)));
    found
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

/// Rows of a table with a header.
pub fn rows(path: impl AsRef<Path>) -> Vec<BTreeMap<String, String>> {
    let text = read_text(path);
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect());
    let header: Vec<String> = lines.next().unwrap();
    let row = |cells: Vec<String>| {
        assert_eq!(cells.len(), header.len(), "{cells:?}");
        header.iter().cloned().zip(cells).collect()
    };
    lines.map(row).collect()
}

/// An array as a table, a line for each row.
pub fn table(values: &Array2<f64>) -> String {
    let cells = |row: ArrayView1<'_, f64>| row.iter().map(f64::to_string).collect::<Vec<_>>();
    values.rows().into_iter().map(|row| cells(row).join(",") + "\n").collect()
}

/// Expects these values in an answer.
pub fn has(answer: &Value, wanted: Value) {
    for (name, value) in wanted.as_object().unwrap() {
        assert_eq!(answer[name], *value, "{name} in {answer}");
    }
}

/// Number of this name in an answer.
pub fn number(json: &Value, name: &str) -> f64 {
    json[name].as_f64().unwrap_or_else(|| panic!("no number {name} in {json}"))
}

/// Numbers of a list of this name in an answer.
pub fn numbers(json: &Value, name: &str) -> Vec<f64> {
    json[name].as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Texts of this name in each object of a list.
pub fn texts<'a>(list: &'a Value, name: &str) -> Vec<&'a str> {
    list.as_array().unwrap().iter().map(|object| object[name].as_str().unwrap()).collect()
}

/// Distance of two places in a plane.
pub fn distance_m([a, b]: [f64; 2], [c, d]: [f64; 2]) -> f64 {
    (a - c).hypot(b - d)
}

/// Largest magnitude of numbers, but for those that are none.
pub fn largest<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    values.into_iter().fold(0.0, |most, value| most.max(value.abs()))
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

/// Voltages of a skin whose conductivity differs by a factor that depends on the place.
pub fn voltages(skin: &Skin, factor: impl Fn([f64; 3]) -> f64) -> Array1<f64> {
    let places = skin.mesh.surface().centroids();
    let sigma_s = skin.background_s().into_iter().zip(places).map(|(s, place)| s * factor(place));
    skin.model.forward(&sigma_s.collect::<Vec<_>>()).unwrap()
}

/// Two hundred frames of 40 values of [`SMALL`]: quiet at first, then a finger that stays; also as a file in a folder.
pub fn touched_frames(folder: &Folder) -> (String, &'static Array2<f64>) {
    static FRAMES: LazyLock<Array2<f64>> = LazyLock::new(|| {
        let skin = Skin::load(Folder::new().scene("")).unwrap();
        let square_m2 = |c: [f64; 3]| (c[0] - 0.03).powi(2) + c[1] * c[1];
        let touched = voltages(&skin, |c| 1.0 + 0.5 * (-square_m2(c) / 0.01_f64.powi(2)).exp());
        let still = voltages(&skin, |_| 1.0);
        Array2::from_shape_fn((200, still.len()), |(frame, i)| {
            let noise = 1e-5 * largest(&still) * ((frame * 7919 + i * 104_729) as f64).sin();
            noise + if frame > 100 { touched[i] } else { still[i] }
        })
    });
    (folder.write_array("touched.npy", &*FRAMES), &FRAMES)
}
