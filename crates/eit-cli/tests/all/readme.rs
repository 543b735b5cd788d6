//! The commands of README.md and of the book run as written, one folder a page, in order. A word behind `sh` says why a
//! block cannot: `board` needs an instrument or another terminal, `robot` a robot's software, `long` more time or other
//! programs. That their commands parse is tested in `src/cli/tests.rs`; `init.rs`, `silence.rs` and `instruments.rs` run
//! those that need a board.
#![cfg(unix)]

use crate::common::*;
use eit_skin::Scene;
use eit_skin::eit_fem::fabric::TouchScript;
use std::path::{Path, PathBuf};

/// README.md and all pages of the book.
fn pages() -> Vec<PathBuf> {
    let mut pages = files_below(&root().join("docs"), "md");
    pages.push(root().join("README.md"));
    pages.sort();
    pages
}

/// The blocks of a page with this text behind the fence.
fn blocks(page: &Path, mark: &str) -> Vec<String> {
    let text = read_text(page);
    let blocks = text.split("\n```").skip(1).step_by(2).filter_map(|block| block.split_once('\n'));
    blocks.filter(|(kind, _)| *kind == mark).map(|(_, lines)| format!("{lines}\n")).collect()
}

/// Runs the lines of the blocks that can run here; returns how many.
fn run(page: &Path) -> usize {
    let folder = Folder::new();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_eit"));
    let path =
        format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    let blocks = blocks(page, "sh").concat();
    let lines = blocks.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    let run = |line: &str| {
        println!("{}: `{line}`", page.display());
        let mut shell = Command::new("sh");
        shell.args(["-c", line]).env("PATH", &path).current_dir(folder.path(""));
        ended(&shell.output().unwrap(), 0)
    };
    lines.map(run).count()
}

#[test]
fn commands_of_all_pages() {
    let counts: usize = pages().iter().map(|page| run(page)).sum();
    // the README's four to look around and three from a scene to touches, three of the guide, one of UDP
    assert!(counts >= 10, "{counts}");
}

/// TOML is read, and pages with Rust code are compiled as documentation of the benches. PERFORMANCE.md is written by a
/// program and may be longer.
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
        assert_eq!(text.matches("\n```").count(), fences.len(), "{name}: an indented block");
        for pair in fences.chunks(2) {
            assert!(known.iter().any(|kind| kind == pair[0]), "{name}: ```{}", pair[0]);
            assert_eq!(pair.get(1), Some(&""), "{name}: the end of ```{}", pair[0]);
        }
        for block in blocks(&page, "toml") {
            toml::from_str::<toml::Table>(&block).unwrap_or_else(|error| panic!("{name}: {error}"));
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
    toml::from_str::<Scene>(&scenes[..scenes.len() - 1].concat()).unwrap();
    for script in blocks(&root().join("docs/FABRIC.md"), "toml") {
        toml::from_str::<TouchScript>(&script).unwrap();
    }
}
