//! Where to press: places spread over a skin, in words and as a small drawing.

use crate::error::SkinError;
use crate::learn::CANDIDATES;
use eit_core::vector;
use eit_inverse::learn::candidates;
use eit_mesh::{Mesh, Raster};

/// Distance of the places from the rim, as a fraction of half the skin's extent: a fingertip nearer to the rim is
/// partly beside the skin.
const MARGIN: f64 = 0.15;
/// Skins of at least this half extent get places in whole millimetres, smaller ones in tenths, metres.
const WHOLE_MM_M: f64 = 0.03;
/// Columns of a drawing. A character is about twice as high as wide.
const COLUMNS: usize = 44;

/// Returns places for presses, metres: the first in the middle, each next one as far as possible from all
/// before it. Any number of the first ones is spread over the skin.
pub(crate) fn press_places(mesh: &Mesh) -> Vec<[f64; 3]> {
    let surface = mesh.surface();
    let [low, high] = surface.bounds_m();
    let half_m = (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max);
    let nodes = surface.nodes();
    let rim: Vec<[f64; 3]> =
        surface.rim_edges().iter().flatten().map(|&node| nodes[node as usize]).collect();
    let from_rim = |place: &[f64; 3]| nearest_m(&rim, place);
    let all = candidates(surface, CANDIDATES);
    let mut left: Vec<[f64; 3]> =
        all.iter().filter(|place| from_rim(place) >= MARGIN * half_m).copied().collect();
    if left.is_empty() {
        // a skin as narrow as its margins
        left = all;
    }
    let middle: [f64; 3] = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
    let mut distances: Vec<f64> =
        left.iter().map(|place| -vector::distance(*place, middle)).collect();
    let mut chosen = Vec::with_capacity(left.len());
    while let Some(at) = (0..left.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b])) {
        let place = left.swap_remove(at);
        distances.swap_remove(at);
        let is_first = chosen.is_empty();
        for (distance, other) in distances.iter_mut().zip(&left) {
            let here = vector::distance(*other, place);
            *distance = if is_first { here } else { distance.min(here) };
        }
        chosen.push(place);
    }
    let is_flat = high[2] - low[2] == 0.0;
    let step_m = if half_m >= WHOLE_MM_M { 1e-3 } else { 1e-4 };
    if is_flat {
        // adding 0 turns -0 into 0
        let round = |x: f64| (x / step_m).round() * step_m + 0.0;
        chosen.iter_mut().for_each(|p| (p[0], p[1]) = (round(p[0]), round(p[1])));
    }
    chosen
}

/// Describes a place: its coordinates, and its distances from the two nearest electrodes, by which it is found
/// with a ruler.
pub fn place_text(mesh: &Mesh, place_m: [f64; 3]) -> String {
    let [x, y, z] = place_m.map(|m| 1e3 * m);
    let at = match z == 0.0 {
        true => format!("({x:.1}, {y:.1}) mm"),
        false => format!("({x:.1}, {y:.1}, {z:.1}) mm"),
    };
    let centres = (0..mesh.electrodes().len()).filter_map(|k| mesh.electrode_centre_m(k));
    let mut electrodes: Vec<(f64, usize)> =
        centres.enumerate().map(|(k, centre)| (vector::distance(centre, place_m), k + 1)).collect();
    electrodes.sort_by(|a, b| a.0.total_cmp(&b.0));
    match electrodes[..] {
        [(one_m, one), (other_m, other), ..] => format!(
            "{at}: {:.0} mm from electrode {one}, {:.0} mm from electrode {other}",
            1e3 * one_m,
            1e3 * other_m
        ),
        _ => at,
    }
}

/// Draws a flat skin in characters: `X` the place that is asked for, `o` earlier ones, `1` and `#` the electrodes,
/// `.` the skin; y points up. Empty for a curved skin.
///
/// # Errors
/// A skin without area.
pub fn draw_places(
    mesh: &Mesh,
    done_m: &[[f64; 3]],
    asked_m: [f64; 3],
) -> Result<String, SkinError> {
    let [low, high] = mesh.surface().bounds_m();
    if high[2] - low[2] > 0.0 {
        return Ok(String::new());
    }
    let raster = Raster::new(mesh.surface(), COLUMNS)?;
    let (rows, columns) = raster.mask().dim();
    let mut drawn = vec![vec![' '; columns]; rows.div_ceil(2)];
    for ((row, column), inside) in raster.mask().indexed_iter() {
        if *inside {
            drawn[row / 2][column] = '.';
        }
    }
    let mut put = |place: [f64; 3], sign: char| {
        let [x, y] = [place[0], place[1]];
        let column = ((x - low[0]) / (high[0] - low[0]) * columns as f64) as usize;
        let row = ((high[1] - y) / (high[1] - low[1]) * rows as f64) as usize / 2;
        drawn[row.min(rows.div_ceil(2) - 1)][column.min(columns - 1)] = sign;
    };
    for electrode in (0..mesh.electrodes().len()).rev() {
        if let Some(centre) = mesh.electrode_centre_m(electrode) {
            put(centre, if electrode == 0 { '1' } else { '#' });
        }
    }
    done_m.iter().for_each(|place| put(*place, 'o'));
    put(asked_m, 'X');
    let lines: Vec<String> = drawn.into_iter().map(|line| line.into_iter().collect()).collect();
    Ok(lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n"))
}

fn nearest_m(places: &[[f64; 3]], place: &[f64; 3]) -> f64 {
    places.iter().map(|other| vector::distance(*other, *place)).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scene, Skin};

    fn skin(text: &str) -> Skin {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("skin.toml");
        std::fs::write(&file, text).unwrap();
        Skin::from_scene(Scene::load(file.to_str().unwrap()).unwrap()).unwrap()
    }

    const DISC: &str = "[skin]\nshape = \"disc\"\nradius_m = 0.05\nconductivity_s = 1e-5\n\
                        [electrodes]\ncount = 8\nwidth_m = 0.005\ncontact_impedance_ohm_m = 1e3\n\
                        [protocol]\ndrive = \"adjacent\"\nmeasure = \"adjacent\"\n";

    /// Every beginning of the list covers the skin: no place of the skin is far from the first 12, 25, 50.
    #[test]
    fn first_places_are_spread() {
        let skin = skin(DISC);
        let places = press_places(&skin.mesh);
        assert!(places.len() > 300 && places[0][0].hypot(places[0][1]) < 3e-3, "{:?}", places[0]);
        let inner = candidates(skin.mesh.surface(), 2000);
        let inner = inner.iter().filter(|p| p[0].hypot(p[1]) < 0.85 * 0.05);
        let all: Vec<_> = inner.collect();
        for count in [12, 25, 50] {
            let gap_m = all.iter().map(|p| nearest_m(&places[..count], p)).fold(0.0, f64::max);
            // an ideal covering by discs has a radius of about 1.1 / sqrt(count)
            assert!(gap_m < 2.0 * 0.0425 / (count as f64).sqrt(), "{count}: {gap_m}");
        }
        for [x, y, _] in &places {
            assert!(x.hypot(*y) < 0.0435, "{x} {y}");
            assert!((1e3 * x - (1e3 * x).round()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_place_in_words_and_drawn() {
        let skin = skin(DISC);
        let words = place_text(&skin.mesh, [0.0, 0.04, 0.0]);
        // electrode 1 is on the +x axis by default, so the third of eight is at the top
        assert!(words.starts_with("(0.0, 40.0) mm: 10 mm from electrode 3, "), "{words}");
        let drawn = draw_places(&skin.mesh, &[[0.0, -0.02, 0.0]], [0.02, 0.02, 0.0]).unwrap();
        println!("{drawn}");
        let at = |sign: char| {
            let found = drawn.lines().enumerate().find_map(|(row, l)| Some((row, l.find(sign)?)));
            found.unwrap()
        };
        let ((x_row, x_column), (o_row, o_column)) = (at('X'), at('o'));
        assert!(x_row < o_row && x_column > o_column, "{drawn}");
        assert!(at('1').1 > 40 && drawn.matches('#').count() == 7, "{drawn}");
        assert!(drawn.lines().all(|line| line.len() <= COLUMNS) && drawn.lines().count() == 22);
    }
}
