//! Every claim of docs/VALIDATION.md and docs/validation names a test that exists, or a program of the repository.

use crate::common::*;
use std::collections::BTreeSet;

/// Files with tests as `folder::file` and tests as `folder::file::test`, each also by the ends of its path.
fn tests() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for folder in ["crates", "benches"] {
        for file in files_below(&root().join(folder), "rs") {
            let path = file.strip_prefix(root()).unwrap().with_extension("");
            let mut path: Vec<&str> = path.iter().map(|part| part.to_str().unwrap()).collect();
            path.retain(|&part| part != "mod" && part != "tests");
            for test in read_text(&file).split("#[test]").skip(1) {
                let name = test.split("fn ").nth(1).unwrap().split('(').next().unwrap();
                for start in 0..path.len() {
                    let file = path[start..].join("::");
                    names.insert(format!("{file}::{name}"));
                    names.insert(file);
                }
            }
        }
    }
    names
}

/// What stands between backticks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

fn is_name(text: &str) -> bool {
    text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || "_:".contains(c))
}

#[test]
fn every_claim_names_a_test() {
    let tests = tests();
    let mut pages = files_below(&root().join("docs/validation"), "md");
    pages.push(root().join("docs/VALIDATION.md"));
    let mut wrong = Vec::new();
    let mut claims = 0;
    for page in pages {
        // the column of tests, in a table that has one
        let mut column = None;
        for (number, line) in read_text(&page).lines().enumerate() {
            let place = format!("{}:{}", page.file_name().unwrap().display(), number + 1);
            let cells: Vec<&str> = line.split(" | ").collect();
            if line.starts_with("|---") {
                continue;
            }
            if !line.starts_with('|') {
                column = None;
            } else if let Some(&cell) = column.and_then(|column: usize| cells.get(column)) {
                let (names, others): (Vec<&str>, Vec<&str>) =
                    quoted(cell).partition(|text| is_name(text));
                let programs = others.iter().filter(|other| root().join(other).exists()).count();
                claims += 1;
                if names.is_empty() && programs == 0 {
                    wrong.push(format!("{place}: no test"));
                }
                let unknown = names.iter().filter(|&&name| !tests.contains(name));
                wrong.extend(unknown.map(|name| format!("{place}: no test is named {name}")));
            } else {
                column = cells.iter().position(|cell| cell.trim_matches(&['|', ' ']) == "test");
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(claims > 100, "{claims}");
}
