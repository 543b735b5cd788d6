//! Draws tracks of touches on skins.

use plotters::style::text_anchor::HPos;

use crate::{
    PictureError, PictureSettings, SkinDrawing,
    canvas::{Canvas, INK, Rgb, WHITE},
    page::{LABEL_EM, Page, PageSettings},
    panel::Panel,
    plot::COLORS,
    text::Font,
};

/// Share of its colour that the first dot of a track has; the last one has all of it.
const FIRST_SHADE: f64 = 0.25;
/// Length of the legend's samples and line height of the legend, in points.
const SAMPLE: f64 = 18.0;
const LINE_HEIGHT: f64 = 16.0;
/// Colour of true tracks.
const TRUE: Rgb = [208; 3];

/// Positions of one touch over time.
#[derive(Clone, Debug)]
pub struct Track {
    /// Name in the legend; empty to omit it.
    pub name: String,
    /// Positions in order, metres; one that is not finite interrupts the track.
    pub places_m: Vec<[f64; 2]>,
    /// Whether this is a true track (grey line) rather than a detected one (coloured dots).
    pub is_truth: bool,
}

/// The tracks on one skin.
#[derive(Clone, Debug)]
pub struct TracksPanel {
    /// Label below the skin.
    pub label: String,
    /// Tracks in drawing order: the true ones first, later ones on top. Detected tracks that may overlap belong on
    /// panels of their own.
    pub tracks: Vec<Track>,
    /// Number of this panel's first colour, so that a track on a panel of its own has its own colour.
    pub first_color: usize,
}

/// Draws skins side by side, each with its tracks and a ruler. The dots of a detected track begin pale and end in full
/// colour. Only title, footnote and zoom of the settings are used.
///
/// # Errors
/// A skin whose coordinates are not finite.
pub fn draw_tracks(
    panels: &[TracksPanel],
    skin: &SkinDrawing,
    settings: &PictureSettings,
) -> Result<Canvas, PictureError> {
    let font = Font::load()?;
    let zoom = settings.zoom.clamp(1, 4);
    let side = if panels.len() > 1 { 300.0 } else { 400.0 };
    let panel = Panel::new(skin, side, zoom, &font)?;
    let lines = panels.iter().map(|p| legend(p).count()).max().unwrap_or(0);
    let room = LINE_HEIGHT * (lines + 2) as f64;
    let labels = panels.iter().flat_map(|p| legend(p).map(|t| &t.name).chain([&p.label]));
    let widest = labels.map(|l| font.width(l, LABEL_EM)).fold(0.0, f64::max) + SAMPLE + 8.0;
    let page = Page::new(
        &PageSettings {
            title: &settings.title,
            note: &settings.footnote,
            cells: panels.len(),
            columns: Some(panels.len()),
            cell_size: [panel.size[0].max(widest), panel.size[1] + room],
            label_width: None,
            scale: None,
            zoom,
        },
        font,
    );
    let mut canvas = page.canvas;
    for (content, corner) in panels.iter().zip(&page.corners) {
        let corner = [corner[0] + ((widest - panel.size[0]).max(0.0) / 2.0).floor(), corner[1]];
        panel.draw_skin(&mut canvas, corner);
        for (track, look) in content.tracks.iter().zip(looks(content)) {
            let at = |p: &[f64; 2]| {
                let [x, y] = panel.to_page(*p);
                [corner[0] + x, corner[1] + y]
            };
            for way in track.places_m.split(|p| !p.iter().all(|v| v.is_finite())) {
                let way: Vec<[f64; 2]> = way.iter().map(at).collect();
                look.draw(&mut canvas, &way);
            }
        }
        let below = [corner[0], corner[1] + panel.size[1]];
        let y = draw_legend(&mut canvas, content, below, panel.size[0]) + LINE_HEIGHT;
        draw_ruler(&mut canvas, &panel, [corner[0], y]);
    }
    Ok(canvas)
}

/// The tracks that have a name.
fn legend(panel: &TracksPanel) -> impl Iterator<Item = &Track> {
    panel.tracks.iter().filter(|track| !track.name.is_empty())
}

/// How a track is drawn: a line if true, dots with a white border if detected.
#[derive(Clone, Copy)]
struct Look {
    color: Rgb,
    /// Width of the line or of the dots, in points.
    size: f64,
    is_line: bool,
}

impl Look {
    fn draw(self, canvas: &mut Canvas, way: &[[f64; 2]]) {
        let Self { color, size, is_line } = self;
        if is_line {
            canvas.stroke(way, size, color, 1.0);
            return;
        }
        let last = way.len().saturating_sub(1).max(1) as f64;
        for (k, place) in way.iter().enumerate() {
            let share = FIRST_SHADE + (1.0 - FIRST_SHADE) * k as f64 / last;
            canvas.stroke(&[*place], size + 1.0, WHITE, 1.0);
            canvas.stroke(&[*place], size, color.map(|c| shade(c, share)), 1.0);
        }
    }
}

/// A colour mixed with white.
fn shade(color: u8, share: f64) -> u8 {
    (255.0 - share * (255.0 - f64::from(color))).round() as u8
}

/// Grey for the truth, then one colour per track.
fn looks(panel: &TracksPanel) -> Vec<Look> {
    let mut next = COLORS.into_iter().cycle().skip(panel.first_color % COLORS.len());
    let of = |track: &Track| match track.is_truth {
        true => Look { color: TRUE, size: 9.0, is_line: true },
        false => Look { color: next.next().unwrap_or(INK), size: 4.6, is_line: false },
    };
    panel.tracks.iter().map(of).collect()
}

/// Draws a bar of 1, 2 or 5 times a power of ten, at most a quarter as long as the skin, with its length in
/// millimetres.
fn draw_ruler(canvas: &mut Canvas, panel: &Panel, [left, y]: [f64; 2]) {
    let points_per_m = panel.to_page([1.0, 0.0])[0] - panel.to_page([0.0; 2])[0];
    let most_m = 0.25 * panel.size[0].max(panel.size[1]) / points_per_m;
    let power = 10_f64.powf(most_m.log10().floor());
    let Some(length_m) = [5.0, 2.0, 1.0].map(|k| k * power).into_iter().find(|l| *l <= most_m)
    else {
        return;
    };
    let right = left + length_m * points_per_m;
    let up = y - 5.0;
    canvas.stroke(&[[left, up], [left, y], [right, y], [right, up]], 1.0, INK, 1.0);
    // twelve digits: 0.02 m are 20 mm, not 20.000000000000004
    let length_mm = (1e15 * length_m).round() / 1e12;
    canvas.text(&format!("{length_mm} mm"), LABEL_EM, [right + 8.0, y - 2.5], HPos::Left, INK);
}

/// Draws the legend below the skin, and returns the height of its last line.
fn draw_legend(canvas: &mut Canvas, panel: &TracksPanel, [left, top]: [f64; 2], width: f64) -> f64 {
    let mut y = top + LINE_HEIGHT / 2.0;
    canvas.text(&panel.label, LABEL_EM, [left + width / 2.0, y], HPos::Center, INK);
    for (track, look) in panel.tracks.iter().zip(looks(panel)) {
        if track.name.is_empty() {
            continue;
        }
        y += LINE_HEIGHT;
        look.draw(canvas, &[0.0, 0.5, 1.0].map(|part| [left + part * SAMPLE, y]));
        canvas.text(&track.name, LABEL_EM, [left + SAMPLE + 8.0, y], HPos::Left, INK);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures_for_tests::disc;

    fn panel(tracks: Vec<Track>) -> TracksPanel {
        TracksPanel { label: "one finger".into(), tracks, first_color: 0 }
    }

    fn track(is_truth: bool, places_m: Vec<[f64; 2]>) -> Track {
        Track { name: "way".into(), places_m, is_truth }
    }

    fn small() -> PictureSettings {
        PictureSettings { zoom: 1, ..Default::default() }
    }

    /// Detected positions are coloured, from pale to full, and nothing else is; the truth is grey.
    #[test]
    fn places_are_where_they_were_found() {
        let draw = |panel: TracksPanel| draw_tracks(&[panel], &disc(4), &small()).unwrap();
        let count = |canvas: &Canvas, color: Rgb| {
            canvas.rgb().chunks_exact(3).filter(|pixel| *pixel == color).count()
        };
        let truth = draw(panel(vec![track(true, vec![[-0.05, 0.0], [0.05, 0.0]])]));
        assert_eq!(count(&truth, COLORS[0]), 0);
        // dots of 4.6 points, blended at their borders, cover at most 5 x 5 pixels; one more of each shade in the legend
        let way = vec![[0.05, 0.0], [0.0, 0.0], [-0.05, 0.0]];
        let found = || panel(vec![track(false, way.clone())]);
        let first = COLORS[0].map(|c| shade(c, FIRST_SHADE));
        let canvas = draw(found());
        for color in [COLORS[0], first] {
            assert!((2 * 4..=2 * 25).contains(&count(&canvas, color)), "{}", count(&canvas, color));
        }
        let other = draw(TracksPanel { first_color: 1, ..found() });
        assert_eq!(count(&other, COLORS[0]), 0);
        assert!(count(&other, COLORS[1]) >= 2 * 4);
    }

    #[test]
    fn no_panel_and_no_place_are_pictures() {
        let [title, footnote] = ["title", "note"].map(str::to_owned);
        draw_tracks(&[], &disc(4), &PictureSettings { title, footnote, ..small() }).unwrap();
        draw_tracks(&[panel(vec![track(false, Vec::new())])], &disc(4), &small()).unwrap();
    }
}
