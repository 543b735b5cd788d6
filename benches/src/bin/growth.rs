//! Measures how the forward problem scales with the mesh: time, memory, and the exponent between
//! sizes.
//!
//! Usage: `growth [--dry-run]`. Each size runs in its own process, so that its peak memory is
//! known. Writes the part "growth" of `docs/PERFORMANCE.md`; takes about half a minute.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::stopwatch::median;
use benches::{Result, document, problem};
use eit_fem::ForwardModel;
use ndarray::Array2;
use serde_json::{Value, json};
use std::hint::black_box;
use std::process::Command;
use std::time::Instant;

const SIZES: [usize; 3] = [2_000, 20_000, 200_000];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--one", nodes] => {
            println!("{}", one(nodes.parse()?)?);
            return Ok(());
        }
        [] | ["--dry-run"] => {}
        _ => return Err(format!("{arguments:?}: only --dry-run is known").into()),
    }
    let load = document::load();
    let rows = SIZES.into_iter().map(in_own_process).collect::<Result<Vec<Value>>>()?;
    let body = table(&rows, load);
    if arguments.is_empty() {
        return document::write("growth", &body);
    }
    println!("{body}");
    Ok(())
}

fn in_own_process(nodes: usize) -> Result<Value> {
    let out =
        Command::new(std::env::current_exe()?).args(["--one", &nodes.to_string()]).output()?;
    if !out.status.success() {
        return Err(String::from_utf8_lossy(&out.stderr).into());
    }
    Ok(serde_json::from_slice(&out.stdout)?)
}

/// Measures the times for one size, milliseconds of CPU time.
fn one(nodes: usize) -> Result<Value> {
    let (shape, electrodes) = problem::disc();
    let mesh = eit_mesh::generate(&shape, &electrodes, &problem::mesh_settings(nodes)?)?;
    let start = Instant::now();
    let model = problem::model(&mesh)?;
    let mut workspace = model.workspace()?;
    let set_up_s = start.elapsed().as_secs_f64();
    let before_mb = peak_mb();
    let sigma = problem::conductivity(model.elements());
    let repeats = (100_000 / nodes).clamp(5, 51);
    let forward = median(repeats, || {
        black_box(model.solve(&sigma, &mut workspace)?.measurements());
        Ok(())
    })?;
    let rows = rows(&model)?;
    let mut unique = Array2::<f32>::zeros((rows.1, model.elements()));
    let halved = median(repeats, || {
        let mut solution = model.solve(&sigma, &mut workspace)?;
        black_box(solution.measurements());
        solution.unique_jacobian_into(unique.view_mut())?;
        Ok(())
    })?;
    drop(unique);
    let mut jacobian = Array2::<f64>::zeros((rows.0, model.elements()));
    let whole = median(repeats, || {
        let mut solution = model.solve(&sigma, &mut workspace)?;
        black_box(solution.measurements());
        solution.jacobian_into(jacobian.view_mut())?;
        Ok(())
    })?;
    Ok(json!({
        "nodes": mesh.surface().nodes().len(),
        "set_up_ms": 1e3 * set_up_s,
        "factor_mflop": 1e-6 * model.cost().factor_flops,
        "forward_ms": 1e3 * forward.cpu_s,
        "unique_ms": 1e3 * halved.cpu_s,
        "whole_ms": 1e3 * whole.cpu_s,
        "set_up_mb": before_mb,
        "peak_mb": peak_mb(),
    }))
}

/// Number of measurements, and number of those that are not multiples of each other.
fn rows(model: &ForwardModel) -> Result<(usize, usize)> {
    let sets = model.unique_measurements().len();
    let all = model.protocol().measurements();
    if sets == 0 || sets > all { Err("no measurements".into()) } else { Ok((all, sets)) }
}

/// Peak memory of this process in megabytes, if the system reports it.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1e-3 * line.split_whitespace().next()?.parse::<f64>().ok()?)
}

fn table(rows: &[Value], load: Option<f64>) -> String {
    let load = load.map_or_else(|| "unknown".to_owned(), |load| format!("{load:.1}"));
    let mut lines = vec![
        format!(
            "{}. One thread, CPU time, medians, memory reused. Load average before: {load}.",
            document::machine()
        ),
        String::new(),
        "| nodes | set-up, ms | factor, MFLOP | forward, ms | forward and 208 rows in f64, ms | \
         forward and 104 rows in f32, ms | peak memory of mesh and model, MB | and of all this, MB |"
            .to_owned(),
        "|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    let columns = [
        "set_up_ms",
        "factor_mflop",
        "forward_ms",
        "whole_ms",
        "unique_ms",
        "set_up_mb",
        "peak_mb",
    ];
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap_or(f64::NAN);
    for row in rows {
        let cells = columns.map(|key| document::digits(number(row, key)));
        lines.push(format!("| {} | {} |", row["nodes"], cells.join(" | ")));
    }
    for pair in rows.windows(2) {
        let power = |key| {
            let [low, high] = [&pair[0], &pair[1]].map(|row| number(row, key));
            let [few, many] = [&pair[0], &pair[1]].map(|row| number(row, "nodes"));
            format!("{:.2}", (high / low).ln() / (many / few).ln())
        };
        let cells = columns.map(power);
        lines.push(format!("| *power of the nodes* | {} |", cells.join(" | ")));
    }
    lines.join("\n")
}
