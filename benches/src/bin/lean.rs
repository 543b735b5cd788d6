//! Measures what optional features cost: for every meaningful choice of crates and features, the
//! crates compiled, their compile time, and the size of a small program. Writes the table of
//! `docs/PERFORMANCE.md`. One file because it is a standalone program.
//!
//! Usage: `lean [--burn] [--dry-run] [--only TEXT]`. `--burn` includes burn, which takes minutes;
//! `--only` keeps the rows that contain the text and, like `--dry-run`, prints them. Linux only:
//! CPU time is read from `/proc`.
//!
//! All rows build into one folder that starts empty. `cargo` is told to call this program instead
//! of `rustc`: it runs `rustc` and records the CPU time of each unit (a crate with its features)
//! under the hash in its file names. The time of a row is the sum over the units that `cargo`
//! reports for it, whichever row compiled them. It equals the time of a build from scratch, without
//! building everything from scratch for every row.
//!
//! Each row is a program outside this workspace that depends on our crates by path, as a robot's
//! program would, with one of the examples as its source, so no dev-dependencies or features of
//! other crates are included. Versions are those in this workspace's `Cargo.lock`; nothing is
//! downloaded.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program's output and progress")]

use benches::{Result, document};
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Number of parallel jobs of a build.
const JOBS: &str = "2";

/// Set when this program runs instead of `rustc`: the folder for recorded times.
const TIMES: &str = "EIT_LEAN_TIMES";

/// One row.
struct Choice {
    /// Our crates and their features.
    crates: &'static [(&'static str, &'static [&'static str])],
    /// The example to build; empty for the command-line program `eit`.
    example: &'static str,
    /// Crates that the example uses directly, with their versions.
    others: &'static [(&'static str, &'static str)],
}

const NDARRAY: (&str, &str) = ("ndarray", "0.17");
const STEP_TIME: &[(&str, &str)] = &[NDARRAY, ("cpu-time", "1")];

const CHOICES: [Choice; 16] = [
    Choice { crates: &[("eit-mesh", &[])], example: "eit-mesh/examples/disc.rs", others: &[] },
    Choice {
        crates: &[("eit-mesh", &[]), ("eit-fem", &[])],
        example: "eit-fem/examples/forward.rs",
        others: &[NDARRAY],
    },
    Choice {
        crates: &[("eit-mesh", &[]), ("eit-fem", &["fabric"])],
        example: "eit-fem/examples/fabric.rs",
        others: &[],
    },
    Choice {
        crates: &[("eit-mesh", &[]), ("eit-fem", &["serde"])],
        example: "eit-fem/examples/fabric.rs",
        others: &[],
    },
    Choice {
        crates: &[("eit-mesh", &[]), ("eit-fem", &[]), ("eit-inverse", &[])],
        example: "eit-inverse/examples/one_frame.rs",
        others: &[],
    },
    Choice {
        crates: &[("eit-mesh", &[]), ("eit-fem", &[]), ("eit-inverse", &["st-tv"])],
        example: "eit-inverse/examples/stream.rs",
        others: &[NDARRAY],
    },
    Choice {
        crates: &[("eit-hw", &[])],
        example: "eit-hw/examples/read_recording.rs",
        others: &[],
    },
    Choice { crates: &[("eit-hw", &["serial"])], example: "eit-hw/examples/load.rs", others: &[] },
    Choice {
        crates: &[("eit-hw", &["mcap"])],
        example: "eit-hw/examples/instrument.rs",
        others: &[],
    },
    Choice {
        crates: &[("eit-hw", &["serial", "mcap"])],
        example: "eit-hw/examples/instrument.rs",
        others: &[],
    },
    Choice {
        crates: &[("eit-denoise", &[])],
        example: "eit-denoise/examples/image_stack.rs",
        others: &[NDARRAY],
    },
    Choice {
        crates: &[("eit-denoise", &["unet"])],
        example: "eit-denoise/examples/clean.rs",
        others: &[NDARRAY],
    },
    Choice {
        crates: &[("eit-denoise", &["train"])],
        example: "eit-denoise/examples/step_time.rs",
        others: STEP_TIME,
    },
    Choice { crates: &[("eit-skin", &["hw"])], example: "eit-skin/examples/robot.rs", others: &[] },
    Choice {
        crates: &[("eit-skin", &["hw", "recording"])],
        example: "eit-skin/examples/robot.rs",
        others: &[],
    },
    Choice { crates: &[("eit-cli", &[])], example: "", others: &[] },
];

fn main() -> Result<ExitCode> {
    if let Some(times) = std::env::var_os(TIMES) {
        return compile(Path::new(&times));
    }
    table()?;
    Ok(ExitCode::SUCCESS)
}

/// Runs `rustc` and records its time.
fn compile(times: &Path) -> Result<ExitCode> {
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let (rustc, arguments) = arguments.split_first().ok_or("no compiler named")?;
    let status = Command::new(rustc).args(arguments).env_remove(TIMES).status()?;
    // `--crate-name NAME` and `-C extra-filename=-HASH`; queries to the compiler have no hash
    let words = || arguments.iter().filter_map(|a| a.to_str());
    let name = words().skip_while(|word| *word != "--crate-name").nth(1);
    let hash = words().find_map(|word| word.strip_prefix("extra-filename=-"));
    if let (Some(name), Some(hash)) = (name, hash) {
        for place in [name, hash] {
            std::fs::write(times.join(place), children_cpu_s()?.to_string())?;
        }
    }
    Ok(if status.success() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn table() -> Result<()> {
    let (mut burn, mut dry_run, mut only) = (false, false, None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--burn" => burn = true,
            "--dry-run" => dry_run = true,
            "--only" => only = Some(arguments.next().ok_or("--only needs a text")?),
            other => return Err(format!("'{other}': --burn, --dry-run or --only").into()),
        }
    }
    let folder = Folder::new()?;
    let mut rows = Vec::new();
    for choice in &CHOICES {
        let name = choice.name();
        let is_wanted = only.as_ref().is_none_or(|only| name.contains(only.as_str()));
        if is_wanted && (burn || !name.contains("train")) {
            let row = choice.measure(&folder.0)?.row(choice);
            eprintln!("{row}");
            rows.push(row);
        }
    }
    let head = format!(
        "{}. `cargo build --release` of a program outside of the workspace from scratch: the CPU \
         time of all `rustc` processes, {JOBS} at a time, including the program's own but \
         excluding runs of build scripts. On hyper-threaded or shared cores it is up to twice that \
         on a dedicated core.",
        document::machine()
    );
    let columns = "| crates (features) | program | crates compiled | CPU, s | size, kB | without \
                   symbols, kB |\n|---|---|---|---|---|---|";
    let body = format!("{head}\n\n{columns}\n{}", rows.join("\n"));
    if dry_run || only.is_some() {
        println!("{body}");
        return Ok(());
    }
    document::write("lean", &body)
}

/// The costs reported in a row.
struct Cost {
    crates: usize,
    cpu_s: f64,
    bytes: u64,
    stripped_bytes: u64,
}

impl Cost {
    fn row(&self, choice: &Choice) -> String {
        let [kb, stripped_kb] = [self.bytes, self.stripped_bytes].map(|bytes| bytes.div_ceil(1000));
        format!(
            "| {} | {} | {} | {:.0} | {kb} | {stripped_kb} |",
            choice.name(),
            choice.program(),
            self.crates,
            self.cpu_s
        )
    }
}

impl Choice {
    /// Returns the row's name, without crates that are dependencies of others in the row.
    fn name(&self) -> String {
        let has = |wanted: &str| self.crates.iter().any(|(name, _)| *name == wanted);
        let is_listed = |(name, _): &&(&str, &[&str])| match *name {
            "eit-mesh" => !has("eit-fem"),
            "eit-fem" => !has("eit-inverse"),
            _ => true,
        };
        let written = |(name, features): &(&str, &[&str])| match features {
            [] => format!("`{name}`"),
            _ => format!("`{name}` ({})", features.join(", ")),
        };
        let names: Vec<String> = self.crates.iter().filter(is_listed).map(written).collect();
        names.join(", ")
    }

    fn program(&self) -> String {
        let name = match self.example.rsplit_once('/') {
            Some((folder, "main.rs")) => folder.rsplit('/').next(),
            Some((_, file)) => file.strip_suffix(".rs"),
            None => Some("eit"),
        };
        format!("`{}`", name.unwrap_or_default())
    }

    fn measure(&self, folder: &Path) -> Result<Cost> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize()?;
        let (home, chosen) = match self.example {
            "" => (root, &["-p", "eit-cli"][..]),
            _ => (self.outside(&root, folder)?, &[][..]),
        };
        let (times, this) = (folder.join("times"), std::env::current_exe()?);
        std::fs::create_dir_all(&times)?;
        let cargo = |command: &[&str]| {
            let mut cargo = Command::new(env!("CARGO"));
            cargo.current_dir(&home).args(command).arg("--offline").args(chosen);
            cargo.env("RUSTC_WRAPPER", &this).env(TIMES, &times).env("CARGO_INCREMENTAL", "0");
            // the `rustc` next to cargo: rustup's would use the toolchain that some crates specify
            // for their developers
            cargo.env("RUSTC", Path::new(env!("CARGO")).with_file_name("rustc"));
            cargo.env("CARGO_TARGET_DIR", folder.join("target")).stderr(Stdio::inherit());
            cargo
        };
        let listed = ["tree", "--edges", "normal,build", "--prefix", "none", "--no-dedupe"];
        let tree = output(cargo(&listed))?;
        let names: BTreeSet<String> =
            tree.lines().map(|l| l.split_whitespace().take(2).collect()).collect();
        let build = ["build", "--release", "--quiet", "--jobs", JOBS, "--message-format", "json"];
        let cpu_s = compiled_s(&output(cargo(&build))?, &times)?;
        let name = if self.example.is_empty() { "eit" } else { "program" };
        let program = folder.join("target/release").join(name);
        let bytes = std::fs::metadata(&program)?.len();
        // the same crate with another option: its time is recorded under another name
        let mut strip = cargo(&["rustc", "--release", "--quiet", "--jobs", JOBS, "--bin", name]);
        strip.args(["--", "-C", "strip=symbols"]);
        output(strip)?;
        let stripped_bytes = std::fs::metadata(&program)?.len();
        // the program itself does not count as a dependency
        Ok(Cost { crates: names.len() - 1, cpu_s, bytes, stripped_bytes })
    }

    /// A program that depends on our crates by path.
    fn outside(&self, root: &Path, folder: &Path) -> Result<PathBuf> {
        let crates = root.join("crates");
        let mut manifest = format!(
            "[package]\nname = \"program\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
             [[bin]]\nname = \"program\"\npath = '{}'\n\n[workspace]\n\n[dependencies]\n",
            crates.join(self.example).display()
        );
        for (name, features) in self.crates {
            let path = crates.join(name);
            manifest += &format!(
                "{name} = {{ path = '{}', default-features = false, features = {features:?} }}\n",
                path.display()
            );
        }
        for (name, version) in self.others {
            manifest += &format!("{name} = \"{version}\"\n");
        }
        let home = folder.join("program");
        std::fs::create_dir_all(&home)?;
        std::fs::write(home.join("Cargo.toml"), manifest)?;
        // the same versions and the same compiler
        for file in ["Cargo.lock", "rust-toolchain.toml"] {
            std::fs::copy(root.join(file), home.join(file))?;
        }
        Ok(home)
    }
}

/// Total recorded time of all units that `cargo` names in its messages, seconds.
fn compiled_s(messages: &str, times: &Path) -> Result<f64> {
    let mut units = BTreeSet::new();
    for message in messages.lines() {
        let message: serde_json::Value = serde_json::from_str(message)?;
        let files = message["filenames"].as_array().into_iter().flatten();
        units.extend(files.filter_map(|file| unit(Path::new(file.as_str()?))));
    }
    let mut sum_s = 0.0;
    for unit in &units {
        let text = std::fs::read_to_string(times.join(unit));
        sum_s += text.map_err(|error| format!("no time of {unit}: {error}"))?.parse::<f64>()?;
    }
    Ok(sum_s)
}

/// Returns the hash in `libname-HASH.rlib` or `name-HASH/build-script-build`, or the name of a
/// program.
fn unit(file: &Path) -> Option<String> {
    let of = |name: &OsStr| {
        let (_, hash) = name.to_str()?.rsplit_once('-')?;
        let is_hash = hash.len() == 16 && hash.bytes().all(|b| b.is_ascii_hexdigit());
        is_hash.then(|| hash.to_owned())
    };
    let hash = of(file.file_stem()?).or_else(|| of(file.parent()?.file_name()?));
    hash.or_else(|| Some(file.file_name()?.to_str()?.to_owned()))
}

/// A temporary folder for one build.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self> {
        let folder = std::env::temp_dir().join(format!("eit-lean-{}", std::process::id()));
        std::fs::create_dir(&folder)?;
        Ok(Self(folder))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // a folder that cannot be removed stays in the system's temporary folder
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Runs a command and returns its output.
fn output(mut command: Command) -> Result<String> {
    let done = command.output()?;
    if !done.status.success() {
        return Err(format!("{command:?} ended with {}", done.status).into());
    }
    Ok(String::from_utf8(done.stdout)?)
}

/// CPU time of all finished child processes of this program and of their children, seconds.
fn children_cpu_s() -> Result<f64> {
    /// Ticks per second on every Linux system.
    const TICKS_HZ: f64 = 100.0;
    let text = std::fs::read_to_string("/proc/self/stat")?;
    let (_, fields) = text.rsplit_once(')').ok_or("no name in /proc/self/stat")?;
    // fields from the third on; the 16th and 17th are user and system time of the children
    let fields = fields.split_whitespace().skip(13).take(2);
    let ticks: f64 = fields.map(str::parse::<f64>).sum::<std::result::Result<f64, _>>()?;
    Ok(ticks / TICKS_HZ)
}
