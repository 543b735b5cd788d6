//! Finds the groups of a Gmsh file that are electrodes.

use super::gmsh_sections::{Problem, Sections};
use std::collections::{BTreeMap, HashMap};

/// Where an electrode name is declared: dimension (1 lines, 2 triangles), tags and line.
pub(super) struct ElectrodeName {
    pub dimension: u8,
    pub tags: Vec<u64>,
    pub line: usize,
}

/// Returns the electrode number from a group's name. `Err` for a name that looks like an
/// electrode's but is malformed.
fn electrode_number(name: &str) -> Result<Option<usize>, String> {
    let prefix = "electrode";
    let Some(rest) = name.get(..prefix.len()).filter(|p| p.eq_ignore_ascii_case(prefix)) else {
        return Ok(None);
    };
    let tail = name[rest.len()..].trim_start_matches(['_', '-', ' ']);
    if tail.is_empty() || !tail.bytes().all(|b| b.is_ascii_digit()) {
        return Ok(None);
    }
    match tail.parse::<usize>() {
        Ok(number) if number > 0 && name == format!("electrode_{number}") => Ok(Some(number)),
        _ => Err(format!(
            "the group \"{name:.60}\" looks like an electrode: name it electrode_N, N from 1 and \
             without leading zeros"
        )),
    }
}

/// Returns the named electrodes by number; rejects names in two dimensions and missing numbers.
pub(super) fn electrode_names(
    sections: &Sections,
) -> Result<BTreeMap<usize, ElectrodeName>, Problem> {
    let mut names: BTreeMap<usize, ElectrodeName> = BTreeMap::new();
    for group in &sections.names {
        let line = group.line;
        let Some(number) = electrode_number(&group.name).map_err(|p| (line, p))? else { continue };
        let dimension = group.dimension;
        if !(1..=2).contains(&dimension) {
            let problem = format!(
                "electrode_{number} is a group of dimension {dimension}: an electrode has a width, \
                 so make it a physical curve (rim) or surface (patch)"
            );
            return Err((line, problem));
        }
        let name = names.entry(number).or_insert(ElectrodeName { dimension, tags: vec![], line });
        if name.dimension != dimension {
            let problem = format!(
                "electrode_{number} is a physical curve and a physical surface: rename one of them"
            );
            return Err((line, problem));
        }
        name.tags.push(group.tag);
    }
    if let Some(missing) = (1..=names.len()).find(|n| !names.contains_key(n)) {
        let last = names.keys().next_back().copied().unwrap_or(0);
        let problem = format!(
            "electrode_{missing} is missing, but electrode_{last} exists: number the electrodes \
             from 1 without gaps"
        );
        return Err((0, problem));
    }
    Ok(names)
}

/// Electrode of each group (dimension, tag) that elements refer to; a group belongs to at most one
/// electrode.
pub(super) fn electrode_groups(
    sections: &Sections,
    names: &BTreeMap<usize, ElectrodeName>,
) -> Result<HashMap<(u8, i64), usize>, Problem> {
    let mut of_physical: HashMap<(u8, u64), usize> = HashMap::new();
    for (&number, name) in names {
        for &tag in &name.tags {
            let other = of_physical.insert((name.dimension, tag), number);
            if let Some(other) = other.filter(|&o| o != number) {
                let problem = format!("group {tag} is named electrode_{other} and _{number}");
                return Err((name.line, problem));
            }
        }
    }
    let mut groups = HashMap::new();
    let Some(entities) = &sections.entities else {
        for ((dimension, tag), number) in of_physical {
            if let Ok(tag) = i64::try_from(tag) {
                groups.insert((dimension, tag), number);
            }
        }
        return Ok(groups);
    };
    for (&(dimension, tag), entity) in entities {
        let mut numbers =
            entity.physical.iter().filter_map(|&tag| of_physical.get(&(dimension, tag)).copied());
        if let Some(number) = numbers.next() {
            if let Some(other) = numbers.find(|&other| other != number) {
                let problem = format!("entity {tag} is in electrode_{number} and _{other}");
                return Err((entity.line, problem));
            }
            groups.insert((dimension, tag), number);
        }
    }
    Ok(groups)
}
