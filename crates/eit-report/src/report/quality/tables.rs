//! Tables of image quality: means in Markdown, every row in CSV.

use super::super::markdown;
use super::super::scores::{GreitFigures, Scores};
use super::super::solver::METHODS;
use super::comparison::{COMPARED, Grid, Row};
use crate::simulate::FingerShape;
use eit_skin::method::Method;

/// A figure of merit in a table.
struct Figure {
    title: &'static str,
    value: fn(&Scores) -> f64,
    digits: usize,
    /// Whether larger is better.
    more: bool,
}

const FIGURES: [Figure; 5] = [
    Figure {
        title: "Relative error (0 best, 1 for an empty image)",
        value: |s| s.relative_error,
        digits: 3,
        more: false,
    },
    Figure { title: "Correlation", value: |s| s.correlation, digits: 3, more: true },
    Figure {
        title: "Structural similarity (SSIM)",
        value: |s| s.similarity,
        digits: 3,
        more: true,
    },
    Figure {
        title: "Position error of found fingers, mm",
        value: |s| 1e3 * s.position_error_m,
        digits: 1,
        more: false,
    },
    Figure { title: "Part of the fingers found", value: |s| s.found, digits: 2, more: true },
];

/// Returns all tables as Markdown.
pub(super) fn markdown_of(rows: &[Row], grid: &Grid, note: &str) -> String {
    let mut text =
        format!("# Quality of every method\n\n{note} The best value of each row is in bold.\n");
    for figure in &FIGURES {
        text += &format!("\n## {}\n\nMean over the numbers of touches.\n\n", figure.title);
        text += &table(rows, figure, &["finger", "noise, dB", "speed"], &|row| {
            vec![row.shape.name().to_owned(), format!("{}", row.noise_db), row.speed.to_owned()]
        });
        text += "\nMean over noise levels and speeds.\n\n";
        text += &table(rows, figure, &["finger", "touches"], &|row| {
            vec![row.shape.name().to_owned(), row.touches.to_string()]
        });
    }
    text += "\n## GREIT figures of a single finger\n\nMean over frames and speeds: amplitude \
             response (1 best), position error in mm, resolution, shape deformation, ringing (0 \
             best).\n\n";
    text += &greit_table(rows, grid);
    text += &format!("\n## Where st-tv is not the best by relative error\n\n{}", losses(rows));
    text
}

/// Means of a figure, with one row per key and one column per method.
fn table(
    rows: &[Row],
    figure: &Figure,
    keys: &[&str],
    key: &dyn Fn(&Row) -> Vec<String>,
) -> String {
    let mut lines: Vec<Vec<String>> = Vec::new();
    for row in rows {
        let key = key(row);
        if !lines.contains(&key) {
            lines.push(key);
        }
    }
    let body: Vec<Vec<String>> = lines
        .into_iter()
        .map(|line| {
            let means: Vec<f64> = (0..COMPARED)
                .map(|method| {
                    let of = rows.iter().filter(|row| row.method == method && key(row) == line);
                    mean(of.map(|row| (figure.value)(&row.scores)))
                })
                .collect();
            let finite = means.iter().copied().filter(|m| m.is_finite());
            let better = |a: f64, b: f64| if figure.more { a.max(b) } else { a.min(b) };
            let best = finite.reduce(better).unwrap_or(f64::NAN);
            let cells = means.iter().map(|m| {
                let cell = format!("{m:.*}", figure.digits);
                if *m == best { format!("**{cell}**") } else { cell }
            });
            line.iter().cloned().chain(cells).collect()
        })
        .collect();
    let names: Vec<String> = METHODS[..COMPARED].iter().map(|method| method.name()).collect();
    let head: Vec<&str> = keys.iter().copied().chain(names.iter().map(String::as_str)).collect();
    markdown::table(&head, &body)
}

fn greit_table(rows: &[Row], grid: &Grid) -> String {
    type Of = fn(&GreitFigures) -> f64;
    let figures: [(&str, Of); 5] = [
        ("AR", |g| g.amplitude_response),
        ("PE, mm", |g| 1e3 * g.position_error_m),
        ("RES", |g| g.resolution),
        ("SD", |g| g.shape_deformation),
        ("RNG", |g| g.ringing),
    ];
    let mut body = Vec::new();
    let levels =
        FingerShape::ALL.iter().flat_map(|shape| grid.noise_db.iter().map(|db| (*shape, *db)));
    for (shape, noise_db) in levels {
        for (number, method) in METHODS[..COMPARED].iter().enumerate() {
            let of =
                |row: &&Row| row.shape == shape && row.noise_db == noise_db && row.method == number;
            let single: Vec<GreitFigures> =
                rows.iter().filter(of).filter_map(|row| row.scores.greit).collect();
            let cells = figures.iter().map(|(name, value)| {
                let digits = if name.ends_with("mm") { 1 } else { 2 };
                format!("{:.digits$}", mean(single.iter().map(value)))
            });
            let names = [shape.name().to_owned(), format!("{noise_db}"), method.name()];
            body.push(names.into_iter().chain(cells).collect());
        }
    }
    let head: Vec<&str> =
        ["finger", "noise, dB", "method"].into_iter().chain(figures.iter().map(|f| f.0)).collect();
    markdown::table(&head, &body)
}

/// Lists sequences on which another method has a smaller error than both forms of st-tv.
fn losses(rows: &[Row]) -> String {
    let mut body = Vec::new();
    for sequence in rows.chunks(COMPARED) {
        let error = |row: &&Row| row.scores.relative_error;
        let least = |part: &mut dyn Iterator<Item = &'_ Row>| {
            part.map(|row| (error(&row), row.method)).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let is_st_tv = |row: &&Row| METHODS[row.method].method == Method::StTv;
        let own = least(&mut sequence.iter().filter(is_st_tv));
        let other = least(&mut sequence.iter().filter(|row| !is_st_tv(row)));
        if let (Some(own), Some(other), Some(row)) = (own, other, sequence.first())
            && other.0 < own.0
        {
            body.push(vec![
                row.shape.name().to_owned(),
                format!("{}", row.noise_db),
                row.speed.to_owned(),
                row.touches.to_string(),
                format!("{:.3}", own.0),
                format!("{:.3} ({})", other.0, METHODS[other.1].name()),
            ]);
        }
    }
    if body.is_empty() {
        return "Nowhere.\n".to_owned();
    }
    markdown::table(
        &["finger", "noise, dB", "speed", "touches", "st-tv, better form", "best other"],
        &body,
    )
}

/// Mean of the finite values; NaN if there are none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

/// Returns every row as CSV.
pub(super) fn csv(rows: &[Row]) -> String {
    let mut text = "finger,noise_db,speed,touches,method,relative_error,correlation,ssim,\
                    position_error_m,found,extra,amplitude_response,greit_position_error_m,\
                    resolution,shape_deformation,ringing,seconds,choice\n"
        .to_owned();
    for row in rows {
        let s = &row.scores;
        let g = s.greit.map_or_else(
            || ",,,,".to_owned(),
            |g| {
                format!(
                    "{},{},{},{},{}",
                    g.amplitude_response,
                    g.position_error_m,
                    g.resolution,
                    g.shape_deformation,
                    g.ringing
                )
            },
        );
        text += &format!(
            "{},{},{},{},\"{}\",{},{},{},{},{},{},{g},{},\"{}\"\n",
            row.shape.name(),
            row.noise_db,
            row.speed,
            row.touches,
            METHODS[row.method].name(),
            s.relative_error,
            s.correlation,
            s.similarity,
            s.position_error_m,
            s.found,
            s.extra,
            row.seconds,
            row.choice
        );
    }
    text
}
