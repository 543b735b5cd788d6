//! Stores the commit from which the program is built: trained weights state it, so that they can be
//! reproduced.

use std::process::Command;

/// Returns the output of git; `None` outside a checkout or without git.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // the log grows with every commit and checkout, whether references are packed or not
    for what in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", what]) {
            // a missing file would trigger this at every build
            if std::path::Path::new(&path).exists() {
                println!("cargo::rerun-if-changed={path}");
            }
        }
    }
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]);
    let commit = git(&["rev-parse", "--short=10", "HEAD"])
        .map(|commit| if changed.is_some() { commit + "-changed" } else { commit });
    println!("cargo::rustc-env=EIT_COMMIT={}", commit.as_deref().unwrap_or("unknown"));
}
