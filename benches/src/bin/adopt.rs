//! Copies the results of `eit report --full --out DIR` into the project:
//! `cargo run --release -p benches --bin adopt -- DIR`.
//!
//! The tables of choices and of best meshes go to `docs/PERFORMANCE.md`, pictures to `docs/images`, and
//! `inverse.csv`, without networks that are not shipped, to `crates/eit-skin/src/plan/measured.csv`, which
//! `eit plan` reads. With DIR from `eit report --full --forward`, only the forward problems are updated;
//! with DIR from `eit report --full --images`, all but these.
#![allow(clippy::print_stdout, reason = "a program")]

use benches::{Result, document};
use std::fs;
use std::path::{Path, PathBuf};

/// Sections of `report.md`, and the parts of the document that they replace.
const SECTIONS: [(&str, &str); 2] =
    [("Which solver for which time", "choices"), ("Forward problem", "forward")];
/// Pictures used by the document.
const PICTURES: [&str; 6] = [
    "error_paper_disc_60.png",
    "error_paper_fabric.png",
    "forward_paper_disc.png",
    "forward_stiff_contact.png",
    "forward_plate_with_hole.png",
    "forward_hemisphere.png",
];

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).ok_or("name a folder created by eit report --out DIR")?;
    let folder = Path::new(&folder);
    if folder.join("incomplete.txt").exists() {
        return Err("the report is incomplete: let it run to its end".into());
    }
    let report = read(&folder.join("report.md"))?;
    let lead = report.lines().nth(2).unwrap_or_default();
    let is_whole = folder.join("inverse.csv").exists();
    for (title, part) in SECTIONS {
        match section(&report, title) {
            Some(body) => document::write(part, &format!("{lead}\n\n{body}"))?,
            None if is_whole && part != "forward" => {
                return Err(format!("no section '{title}'").into());
            }
            None => {}
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for name in PICTURES {
        let (from, place) = (folder.join(name), root.join("docs/images").join(name));
        if !from.exists() && (!is_whole || name.starts_with("forward")) {
            continue;
        }
        fs::copy(from, &place).map_err(|e| format!("{}: {e}", place.display()))?;
    }
    if !is_whole {
        println!("forward problems adopted");
        return Ok(());
    }
    let table = shipped(&read(&folder.join("inverse.csv"))?)?;
    let rows = table.lines().count() - 1;
    let place = root.join("crates/eit-skin/src/plan/measured.csv");
    fs::write(&place, table).map_err(|e| format!("{}: {e}", place.display()))?;
    println!("{rows} rows adopted");
    Ok(())
}

fn read(path: &PathBuf) -> Result<String> {
    Ok(fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?)
}

/// Returns the text under a heading, up to the next one.
fn section(report: &str, title: &str) -> Option<String> {
    let (_, rest) = report.split_once(&format!("\n## {title}\n"))?;
    Some(rest.split("\n## ").next()?.trim().to_owned())
}

/// Keeps the rows of solvers available to users: no networks from files.
fn shipped(table: &str) -> Result<String> {
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let head = reader.headers()?.clone();
    let column = |name: &str| {
        head.iter().position(|own| own == name).ok_or_else(|| format!("no column '{name}'"))
    };
    let solver = column("solver")?;
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&head)?;
    for row in reader.records() {
        let row = row?;
        let net = row[solver].split_once("U-net").is_some_and(|(_, name)| !name.is_empty());
        if !net {
            writer.write_record(&row)?;
        }
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
