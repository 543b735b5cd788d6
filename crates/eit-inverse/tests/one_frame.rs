//! What a program leaves out that reconstructs one image from one frame. It runs the example `one_frame`
//! and searches its own executable for names. It has no test harness, so that nothing else is linked into
//! it.
//!
//! The linker drops code that nothing calls; whatever can be called, at any depth, appears under its name.
//! A missing name therefore means code that cannot run.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "tests")]

#[path = "../examples/one_frame.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod one_frame;

use std::collections::BTreeSet;

/// Modules of this crate that a single image does not need: time, touches, drift, other methods, choice of
/// the hyperparameter, figures of merit.
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

/// Crates and modules that must be absent: complex numbers, the network, instruments, recordings, nets.
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

/// A path as the compiler mangles it: every name after its length. Built at run time, so that it does not
/// occur in this program itself.
fn mangled(path: &[&str]) -> Vec<u8> {
    path.iter().map(|name| format!("{}{name}", name.len())).collect::<String>().into_bytes()
}

fn holds(program: &[u8], what: &[u8]) -> bool {
    program.windows(what.len()).any(|window| window == what)
}

/// Modules of this crate named in the program, with the files inside them.
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

/// Returns the name at the start of a mangled path and the rest of the path.
fn name(path: &[u8]) -> (String, &[u8]) {
    let digits = path.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let length = std::str::from_utf8(&path[..digits]).unwrap().parse().unwrap_or(0);
    let (name, rest) = path[digits..].split_at(length.min(path.len() - digits));
    (String::from_utf8_lossy(name).into_owned(), rest)
}

fn main() {
    // the brightest pixel, of 6 mm, is within a tenth of the radius
    let error_m = one_frame::run().unwrap();
    assert!(error_m < 0.01, "{error_m} m off");
    if cfg!(windows) {
        println!("skipped: programs do not hold their names here");
        return;
    }
    let program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
    let modules = modules(&program);
    println!("modules of eit-inverse in one image of one frame: {modules:?}");
    // names that are used are found, so a name that is not found is absent
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
