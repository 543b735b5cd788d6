//! What a program leaves out that reconstructs one image from one frame: this one runs the example `one_frame`
//! and searches itself for names. It has no test harness, so that nothing else is linked into it.
//!
//! The linker drops code that nothing calls; whatever can be called, at any depth, appears under its name.
//! A missing name therefore means code that cannot run.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "tests")]

#[path = "../examples/one_frame.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod one_frame;

/// Modules of this crate that a single image does not need: time, touches, drift, other methods, choice of
/// the hyperparameter, figures of merit.
const LEFT_OUT: &str = "eit_inverse::calibration eit_inverse::metrics eit_inverse::noise \
    eit_inverse::one_step::hyperparameter eit_inverse::one_step::masked \
    eit_inverse::one_step::missing eit_inverse::sequence eit_inverse::st_tv eit_inverse::touch";

/// Crates and modules that must be absent: complex numbers, the network, instruments, recordings, nets.
const FOREIGN: &str =
    "num_complex gemm_c64 std::net serialport eit_hw mcap eit_denoise burn_tensor";

/// Names that are used are found, so a name that is not found is absent.
const USED: &str = "eit_inverse::one_step::reconstructor eit_inverse::one_step::spectrum \
    eit_mesh eit_fem core::fmt";

/// A path as the compiler mangles it: every name after its length. Built at run time, so that it does not
/// occur in this program itself.
fn mangled(path: &str) -> Vec<u8> {
    let names = path.split("::").map(|name| format!("{}{name}", name.len()));
    names.collect::<String>().into_bytes()
}

fn holds(program: &[u8], what: &[u8]) -> bool {
    program.windows(what.len()).any(|window| window == what)
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
    for (paths, wanted) in [(USED, true), (LEFT_OUT, false), (FOREIGN, false)] {
        for path in paths.split(' ') {
            assert_eq!(holds(&program, &mangled(path)), wanted, "{path}");
        }
    }
}
