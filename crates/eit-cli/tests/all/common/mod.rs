//! Runs the program as a user does.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

#[cfg(unix)]
pub mod emulated;

use ndarray::Array2;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs `eit` with arguments.
pub fn eit(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_eit")).args(arguments).output().expect("the program starts")
}

/// Runs `eit` and expects success; returns stdout.
pub fn succeed(arguments: &[&str]) -> String {
    let output = eit(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "eit {arguments:?}: {stderr}");
    assert_eq!(stderr, "", "nothing of the progress may reach a pipe");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs `eit` and expects a rejection with exit code 2 and one line; returns the line.
pub fn refuse(arguments: &[&str]) -> String {
    let output = eit(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "eit {arguments:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "one line: {stderr}");
    assert!(output.stdout.is_empty());
    stderr
}

/// Runs `eit` and expects a failure with exit code 1 and one line; returns the line.
#[cfg(feature = "train")]
pub fn fail(arguments: &[&str]) -> String {
    let output = eit(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "eit {arguments:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "one line: {stderr}");
    stderr
}

/// The scenes that come with the project.
pub fn scene(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/scenes").join(name);
    path.to_str().unwrap().to_owned()
}

/// Text of a path.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A scene file in a folder.
pub fn write_scene(folder: &Path, content: &str) -> PathBuf {
    let path = folder.join("scene.toml");
    std::fs::write(&path, content).unwrap();
    path
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
pub fn touched_frames(folder: &Path, scene: &Path) -> (PathBuf, Array2<f64>) {
    let [voltages, mesh, sigma] = ["v.npy", "m.msh", "s.npy"].map(|name| folder.join(name));
    succeed(&["mesh", text(scene), "--out", text(&mesh)]);
    let read = eit_mesh::read_gmsh(&mesh).unwrap();
    let finger = |c: [f64; 3]| (-((c[0] - 0.03).powi(2) + c[1] * c[1]) / 0.01_f64.powi(2)).exp();
    let values = read.surface().centroids().into_iter().map(|c| 1e-5 * (1.0 + 0.5 * finger(c)));
    let values: Vec<f64> = values.collect();
    let values = Array2::from_shape_vec((1, values.len()), values).unwrap();
    ndarray_npy::write_npy(&sigma, &values).unwrap();
    let solve = |more: &[&str]| -> ndarray::Array1<f64> {
        let fixed = ["forward", text(scene), "--mesh", text(&mesh), "--out", text(&voltages)];
        succeed(&[&fixed[..], more].concat());
        ndarray_npy::read_npy(&voltages).unwrap()
    };
    let (still, touched) = (solve(&[]), solve(&["--conductivity", text(&sigma)]));
    let size = still.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let frames = Array2::from_shape_fn((200, still.len()), |(frame, i)| {
        let noise = 1e-5 * size * ((frame * 7919 + i * 104_729) as f64).sin();
        noise + if frame > 100 { touched[i] } else { still[i] }
    });
    let path = folder.join("touched.npy");
    ndarray_npy::write_npy(&path, &frames).unwrap();
    (path, frames)
}
