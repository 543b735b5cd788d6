//! The commands of README.md and of the book run as written, one folder a page, in order.
//!
//! A word behind `sh` says why a block cannot run here: `board` needs an instrument or another terminal,
//! `robot` a robot's software, `long` more time or other programs. That the program understands their
//! commands is tested beside its arguments (`src/cli/tests.rs`), and every command that needs a board is
//! run by `init.rs`, `silence.rs` or `instruments.rs`.
#![cfg(unix)]

use crate::common::{Folder, read_text, stderr};
use eit_skin::Scene;
use eit_skin::eit_fem::fabric::TouchScript;
use std::path::{Path, PathBuf};
use std::process::Command;

/// README.md and all pages of the book, relative to the repository.
fn pages() -> Vec<PathBuf> {
    let root = root();
    let mut pages = vec![root.join("README.md")];
    for folder in ["docs", "docs/performance", "docs/validation"] {
        let entries = std::fs::read_dir(root.join(folder)).unwrap();
        pages.extend(entries.map(|entry| entry.unwrap().path()));
    }
    pages.retain(|path| path.extension().is_some_and(|ending| ending == "md"));
    pages.sort();
    pages
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The blocks of a page with this text behind the fence.
fn blocks(page: &Path, mark: &str) -> Vec<String> {
    let text = read_text(page);
    let mut blocks = Vec::new();
    let mut block: Option<String> = None;
    for line in text.lines() {
        match (line.trim().strip_prefix("```"), &mut block) {
            (Some(_), Some(_)) => blocks.extend(block.take()),
            (Some(found), None) if found == mark => block = Some(String::new()),
            // a block of another kind: its end is no beginning
            (Some(_), None) => block = None,
            (None, Some(block)) => *block += &format!("{line}\n"),
            (None, None) => {}
        }
    }
    blocks
}

/// Runs the lines of the blocks that can run here; returns how many.
fn run(page: &Path) -> usize {
    let folder = Folder::new();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_eit"));
    let path =
        format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    let blocks = blocks(page, "sh").concat();
    let lines = blocks.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut count = 0;
    for line in lines {
        let mut shell = Command::new("sh");
        shell.args(["-c", line]).env("PATH", &path).current_dir(folder.path(""));
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{}: `{line}`: {}", page.display(), stderr(&output));
        count += 1;
    }
    count
}

#[test]
fn commands_of_all_pages() {
    let counts: usize = pages().iter().map(|page| run(page)).sum();
    // the README's four to look around and three from a scene to touches, three of the guide, one of UDP
    assert!(counts >= 10, "{counts}");
}

/// Blocks have a language, and those of the shell a known reason not to run; TOML is read, and pages with Rust code are
/// compiled as documentation of the benches. A page fits a sitting; tables that a program writes do not count.
#[test]
fn pages_are_short_and_their_blocks_of_known_kinds() {
    let known = "sh,sh board,sh robot,sh long,toml,rust,rust+no_run,python,text,c,json";
    let known: Vec<String> = known.split(',').map(|kind| kind.replace('+', ",")).collect();
    let compiled = read_text(root().join("benches/src/lib.rs"));
    for page in pages() {
        let (name, text) = (page.strip_prefix(root()).unwrap().display(), read_text(&page));
        let is_generated = page.ends_with("docs/PERFORMANCE.md");
        assert!(is_generated || text.lines().count() < 250, "{name}");
        let fences: Vec<&str> =
            text.lines().filter_map(|line| line.trim().strip_prefix("```")).collect();
        for pair in fences.chunks(2) {
            assert!(known.iter().any(|kind| kind == pair[0]), "{name}: ```{}", pair[0]);
            assert_eq!(pair.get(1), Some(&""), "{name}: the end of ```{}", pair[0]);
        }
        for block in blocks(&page, "toml") {
            let read: Result<toml::Table, _> = toml::from_str(&block);
            assert!(read.is_ok(), "{name}: {}", read.unwrap_err());
        }
        let code = blocks(&page, "rust").len() + blocks(&page, "rust,no_run").len();
        assert!(code == 0 || compiled.contains(&format!("../../{name}\"")), "{name}");
    }
}

/// No key of the pages on scenes and scripts is unknown.
#[test]
fn keys_of_scenes_and_scripts_exist() {
    let scenes = blocks(&root().join("docs/SCENE.md"), "toml");
    // the last one is eit.toml, options of commands beside the scene
    let scene = scenes[..scenes.len() - 1].concat();
    let read = toml::from_str::<Scene>(&scene);
    assert!(read.is_ok(), "{}", read.unwrap_err());
    for script in blocks(&root().join("docs/FABRIC.md"), "toml") {
        let read = toml::from_str::<TouchScript>(&script);
        assert!(read.is_ok(), "{}", read.unwrap_err());
    }
}
