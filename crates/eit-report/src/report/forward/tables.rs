//! Tables and JSON of the forward problem.

use super::super::table::Table;
use super::choice::{TARGETS, cheapest};
use super::results::{ForwardPoint, ForwardResults};
use serde_json::{Value, json};

fn ms(seconds: f64) -> String {
    format!("{:.3}", 1e3 * seconds)
}

fn mm(length_m: Option<f64>) -> String {
    length_m.map_or_else(|| "-".to_owned(), |length_m| format!("{:.3}", 1e3 * length_m))
}

/// Table of the cheapest mesh of each skin for each error.
pub(in super::super) fn choices(all: &[ForwardResults]) -> Table {
    let mut rows = Vec::new();
    for results in all {
        for target in TARGETS {
            let mut row = vec![results.case.skin().to_owned(), format!("{target:.0e}")];
            match cheapest(&results.points, target, |_| true) {
                Some(best) => row.extend([
                    best.elements.to_owned(),
                    best.mesh.to_owned(),
                    mm(best.edge_m),
                    mm(best.electrode_edge_m),
                    best.nodes.to_string(),
                    best.unknowns.to_string(),
                    ms(best.time.median_s),
                    ms(best.floor_s),
                    ms(best.voltages_time.median_s),
                    format!("{:.1e}", best.error),
                    linear(results, target),
                ]),
                None => {
                    row.push("none tried is that accurate".to_owned());
                    row.resize(HEAD.split('|').count(), "-".to_owned());
                }
            }
            rows.push(row);
        }
    }
    let references: Vec<String> = all
        .iter()
        .map(|results| format!("{}: {}", results.case.skin(), results.reference_text()))
        .collect();
    Table::new(
        HEAD,
        rows,
        format!(
            "The element order and mesh that take the least time for an error that every finer \
             mesh of the family also achieves; its edges are `edge_m` and `electrode_edge_m` in a \
             scene's `[mesh]`. Error: largest error of a voltage divided by the largest voltage. \
             Time: median for factorisation, voltages and Jacobian, reusing memory; next to it its \
             floor, the voltages alone, and the time of linear elements for the same error. \
             Reference: {}.",
            references.join("; ")
        ),
    )
}

const HEAD: &str = "scene | error asked | elements | mesh | edge, mm | at ends, mm | nodes | unknowns | takes, ms | floor, ms | voltages alone, ms | error | linear elements take, ms";

/// Median time of the cheapest linear elements for an error.
fn linear(results: &ForwardResults, target: f64) -> String {
    let found = cheapest(&results.points, target, |p| p.elements == "linear");
    found.map_or_else(|| "-".to_owned(), |point| ms(point.time.median_s))
}

/// Table of every mesh of every skin.
pub(in super::super) fn meshes(all: &[ForwardResults]) -> Table {
    let mut rows = Vec::new();
    for results in all {
        let against = results.reference.clone();
        rows.extend(results.points.iter().map(|point| {
            let mut row = cells(results.case.skin(), point);
            row.extend([against.clone(), format!("{:.0e}", results.reference_error)]);
            row
        }));
    }
    Table::new(
        "scene | elements | mesh | edge, mm | at ends, mm | nodes | triangles | unknowns | least, ms | median | most | floor, ms | voltages alone, median, ms | floor of those, ms | error | against | its own error",
        rows,
        "Factorisation, voltages and Jacobian, reusing memory; error: largest error of a voltage \
         divided by the largest voltage. Errors below ten times the reference's own are not \
         reported.",
    )
}

fn cells(scene: &str, point: &ForwardPoint) -> Vec<String> {
    let (time, voltages) = (&point.time, &point.voltages_time);
    vec![
        scene.to_owned(),
        point.elements.to_owned(),
        point.mesh.to_owned(),
        mm(point.edge_m),
        mm(point.electrode_edge_m),
        point.nodes.to_string(),
        point.triangles.to_string(),
        point.unknowns.to_string(),
        ms(time.least_s),
        ms(time.median_s),
        ms(time.most_s),
        ms(point.floor_s),
        ms(voltages.median_s),
        ms(point.voltages_floor_s),
        format!("{:.1e}", point.error),
    ]
}

pub(in super::super) fn json(all: &[ForwardResults]) -> Value {
    let of_target = |results: &ForwardResults, target: f64| {
        json!({
            "error": target,
            "choice": cheapest(&results.points, target, |_| true),
            "linear": cheapest(&results.points, target, |p| p.elements == "linear"),
        })
    };
    let of = |results: &ForwardResults| {
        json!({
            "scene": results.case.skin(),
            "what": results.case.what,
            "reference": results.reference,
            "reference_error": results.reference_error,
            "left_out": results.left_out,
            "meshes": results.points,
            "choices": TARGETS.iter().map(|&target| of_target(results, target)).collect::<Vec<_>>(),
        })
    };
    all.iter().map(of).collect()
}
