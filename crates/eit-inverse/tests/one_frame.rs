//! Code that a one-frame reconstruction does not link: this program runs the example `one_frame` and
//! searches its own executable for symbol names. It has no test harness, so that nothing else is linked.
//!
//! The linker removes functions that nothing calls; all others appear under their names. A missing name
//! therefore means that the code cannot run.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "tests")]

#[path = "../examples/one_frame.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod one_frame;

use std::collections::BTreeSet;

/// Modules of this crate that a one-frame reconstruction does not need: time, touches, drift, other
/// methods, choice of the hyperparameter, figures of merit.
const LEFT_OUT: [&str; 9] = [
    "calibration",
    "metrics",
    "noise",
    "one_step::hyperparameter",
    "one_step::masked",
    "one_step::missing",
    "sequence",
    "st_tv",
    "touch",
];

/// Other crates and modules that it does not need: complex numbers, networking, instruments, recordings,
/// neural networks.
const FOREIGN: [&[&str]; 8] = [
    &["num_complex"],
    &["gemm_c64"],
    &["std", "net"],
    &["serialport"],
    &["eit_hw"],
    &["mcap"],
    &["eit_denoise"],
    &["burn_tensor"],
];

/// A mangled path: every name is preceded by its length. It is built at run time, so that the string itself
/// is not part of the executable.
fn mangled(path: &[&str]) -> Vec<u8> {
    path.iter().map(|name| format!("{}{name}", name.len())).collect::<String>().into_bytes()
}

fn holds(program: &[u8], what: &[u8]) -> bool {
    program.windows(what.len()).any(|window| window == what)
}

/// Modules of this crate that appear in the executable, as `module::submodule`.
fn modules(program: &[u8]) -> BTreeSet<String> {
    let own = mangled(&["eit_inverse"]);
    let ends = (own.len()..program.len()).filter(|&end| program[..end].ends_with(&own));
    let path = |end: usize| {
        let (room, rest) = name(&program[end..]);
        let (file, _) = name(rest);
        format!("{room}::{file}")
    };
    ends.map(path).collect()
}

/// Splits a mangled path into its first name and the rest.
fn name(path: &[u8]) -> (String, &[u8]) {
    let digits = path.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let length = std::str::from_utf8(&path[..digits]).unwrap().parse().unwrap_or(0);
    let (name, rest) = path[digits..].split_at(length.min(path.len() - digits));
    (String::from_utf8_lossy(name).into_owned(), rest)
}

fn main() {
    // the brightest pixel, 6 mm wide, is within a tenth of the radius
    let error_m = one_frame::run().unwrap();
    assert!(error_m < 0.01, "{error_m} m off");
    if cfg!(windows) {
        println!("skipped: executables contain no symbol names on this platform");
        return;
    }
    let program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
    let modules = modules(&program);
    println!("modules of eit-inverse in one image of one frame: {modules:?}");
    // modules in use are found, so a missing name is evidence
    for used in ["one_step::reconstructor", "one_step::spectrum"] {
        assert!(modules.contains(used), "{used}: {modules:?}");
    }
    for used in [&["eit_mesh"][..], &["eit_fem"], &["core", "fmt"]] {
        assert!(holds(&program, &mangled(used)), "{used:?}");
    }
    for module in LEFT_OUT {
        assert!(!modules.iter().any(|name| name.starts_with(module)), "{module}: {modules:?}");
    }
    for path in FOREIGN {
        assert!(!holds(&program, &mangled(path)), "{path:?}");
    }
}
