//! Times the forward problem and Jacobian on the peers' meshes, one thread, f64.
//!
//! Usage: `peers [--values FOLDER] NODES...` with NODES of 500, 2000, 5000, 20000. Prints one JSON
//! object per mesh: sizes, medians of CPU time and wall time in seconds, norms of voltages (V) and
//! Jacobian (V/S). With `--values` it also writes `voltages_NODES.f64` and `jacobian_NODES.f64`
//! (raw little-endian f64, row-major) for comparison with the peer's.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::stopwatch::{Times, median};
use benches::{Result, problem};
use ndarray::Array2;
use serde_json::json;
use std::hint::black_box;
use std::path::{Path, PathBuf};

/// Repetitions of each timing; the peers take 7.
const REPEATS: usize = 15;

fn main() -> Result<()> {
    let mut values = None;
    let mut targets = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--values" {
            values = Some(PathBuf::from(arguments.next().ok_or("--values needs a folder")?));
        } else {
            let target = argument.parse().map_err(|_| {
                format!("'{argument}' is not one of the numbers of nodes 500, 2000, 5000 and 20000")
            })?;
            targets.push(target);
        }
    }
    if targets.is_empty() {
        return Err("give numbers of nodes: 500, 2000, 5000 or 20000".into());
    }
    for target in targets {
        time(target, values.as_deref())?;
    }
    Ok(())
}

fn time(target: usize, values: Option<&Path>) -> Result<()> {
    let Some(mesh) = problem::peers_mesh(target)? else { return Ok(()) };
    let model = problem::model(&mesh)?;
    let sigma = problem::conductivity(model.elements());
    let mut workspace = model.workspace()?;
    let mut jacobian = Array2::zeros((model.protocol().measurements(), model.elements()));

    let forward = median(REPEATS, || {
        black_box(model.solve(&sigma, &mut workspace)?.measurements());
        Ok(())
    })?;
    let both = median(REPEATS, || {
        let mut solution = model.solve(&sigma, &mut workspace)?;
        black_box(solution.measurements());
        solution.jacobian_into(jacobian.view_mut())?;
        black_box(&jacobian);
        Ok(())
    })?;
    let mut solution = model.solve(&sigma, &mut workspace)?;
    let voltages = solution.measurements();
    let backward_error = solution.report().backward_error;
    if let Some(folder) = values {
        write(folder, &format!("voltages_{target}.f64"), voltages.iter())?;
        write(folder, &format!("jacobian_{target}.f64"), jacobian.iter())?;
    }
    let cost = model.cost();
    // the Jacobian cannot run separately: its fields need the factor of a forward solve
    let rest = |part: fn(&Times) -> f64| part(&both) - part(&forward);
    let line = json!({
        "target": target,
        "nodes": mesh.surface().nodes().len(),
        "elements": model.elements(),
        "factor_entries": cost.factor_entries,
        "factor_flop": cost.factor_flops,
        "repeats": REPEATS,
        "forward_cpu_s": forward.cpu_s,
        "jacobian_cpu_s": rest(|t| t.cpu_s),
        "both_cpu_s": both.cpu_s,
        "forward_wall_s": forward.wall_s,
        "jacobian_wall_s": rest(|t| t.wall_s),
        "both_wall_s": both.wall_s,
        "backward_error": backward_error,
        "voltage_norm": voltages.dot(&voltages).sqrt(),
        "jacobian_norm": jacobian.iter().map(|x| x * x).sum::<f64>().sqrt(),
    });
    println!("{line}");
    Ok(())
}

fn write<'a>(folder: &Path, name: &str, values: impl Iterator<Item = &'a f64>) -> Result<()> {
    let bytes: Vec<u8> = values.flat_map(|x| x.to_le_bytes()).collect();
    let path = folder.join(name);
    std::fs::write(&path, bytes).map_err(|e| format!("cannot write {}: {e}", path.display()).into())
}
