//! The page around the panels: title, grid, colour bar, footnote.

use plotters::style::text_anchor::HPos;

use crate::{
    canvas::{Canvas, INK, LINE},
    scale::Scale,
    text::Font,
};

/// Margin of the page in points.
pub(crate) const MARGIN: f64 = 14.0;
/// Ems of title, labels and footnote, in points.
pub(crate) const TITLE_EM: f64 = 14.0;
pub(crate) const LABEL_EM: f64 = 11.0;
pub(crate) const NOTE_EM: f64 = 10.0;
/// Line height relative to the em.
pub(crate) const LEADING: f64 = 1.5;
/// Gap between panels, and between panels and bar, in points.
const GAP: [f64; 2] = [8.0, 18.0];
/// Height above the bar for its heading, and the shortest and longest bar, in points.
const BAR_HEADING: f64 = 26.0;
const BAR_HEIGHT: [f64; 2] = [80.0, 260.0];

/// The contents that determine the layout of a page.
pub(crate) struct PageSettings<'a> {
    pub(crate) title: &'a str,
    pub(crate) note: &'a str,
    /// Number of panels.
    pub(crate) cells: usize,
    /// Panels per row; chosen automatically if `None`.
    pub(crate) columns: Option<usize>,
    /// Size of each panel, in points.
    pub(crate) cell_size: [f64; 2],
    /// Width of the widest label under a panel; `None` reserves no space for labels.
    pub(crate) label_width: Option<f64>,
    pub(crate) scale: Option<&'a Scale>,
    pub(crate) zoom: usize,
}

/// A page with everything except the panels.
pub(crate) struct Page {
    pub(crate) canvas: Canvas,
    /// Upper left corners of the panels, in whole points.
    pub(crate) corners: Vec<[f64; 2]>,
    cell_size: [f64; 2],
}

impl Page {
    /// Lays out the page and writes everything that is the same in all frames. It is long because
    /// each length follows from the preceding ones.
    pub(crate) fn new(settings: &PageSettings<'_>, font: Font) -> Self {
        let PageSettings { cells, columns: wanted, cell_size, label_width, scale, zoom, .. } =
            *settings;
        let label_height = label_width.map_or(0.0, |_| (LABEL_EM * LEADING).ceil());
        let step = [
            cell_size[0].max(label_width.unwrap_or(0.0).ceil() + GAP[0]) + GAP[0],
            cell_size[1] + label_height + GAP[0],
        ];
        let columns = wanted.unwrap_or_else(|| columns(cells, step)).clamp(1, cells.max(1));
        let rows = cells.max(1).div_ceil(columns);
        let grid = [columns as f64 * step[0] - GAP[0], rows as f64 * step[1] - GAP[0]];
        let bar_height = grid[1].clamp(BAR_HEIGHT[0], BAR_HEIGHT[1] + BAR_HEADING) - BAR_HEADING;
        let (bar, least_height) = match scale {
            Some(scale) => {
                let width = scale.bar_width(|text, em| font.width(text, em)).ceil();
                (GAP[1] + width, bar_height + BAR_HEADING + 8.0)
            }
            None => (0.0, 0.0),
        };
        // titles fit above narrow skins
        let width = (grid[0] + bar).max(300.0) + 2.0 * MARGIN;
        let title = font.wrap(settings.title, TITLE_EM, width - 2.0 * MARGIN);
        let note = font.wrap(settings.note, NOTE_EM, width - 2.0 * MARGIN);
        let top = MARGIN + block_height(&title, TITLE_EM);
        let body = grid[1].max(least_height);
        let note_top = top + body + if note.is_empty() { 0.0 } else { 6.0 };
        let height = note_top + block_height(&note, NOTE_EM) + MARGIN;

        let mut canvas = Canvas::new(width, height, zoom, font);
        write_block(&mut canvas, &title, TITLE_EM, MARGIN);
        write_block(&mut canvas, &note, NOTE_EM, note_top);
        // content narrower than the page is centred
        let left = (MARGIN + (width - 2.0 * MARGIN - grid[0] - bar) / 2.0).floor();
        if let Some(scale) = scale {
            let above = ((body - bar_height - BAR_HEADING) / 2.0).max(0.0);
            let corner = [left + grid[0] + GAP[1], (top + above + BAR_HEADING).floor()];
            scale.draw_bar(&mut canvas, corner, bar_height.floor());
        }
        let inset =
            [((step[0] - GAP[0] - cell_size[0]) / 2.0).floor(), ((body - grid[1]) / 2.0).floor()];
        let corners = (0..cells)
            .map(|cell| {
                let place = [(cell % columns) as f64, (cell / columns) as f64];
                [
                    left + place[0] * step[0] + inset[0],
                    (top + place[1] * step[1] + inset[1]).floor(),
                ]
            })
            .collect();
        Self { canvas, corners, cell_size }
    }

    /// Writes the label under a panel.
    pub(crate) fn label(&self, canvas: &mut Canvas, corner: [f64; 2], text: &str) {
        let middle = corner[0] + self.cell_size[0] / 2.0;
        let line = corner[1] + self.cell_size[1] + LABEL_EM * 0.7;
        canvas.text(text, LABEL_EM, [middle, line], HPos::Center, INK);
    }
}

/// Number of columns that makes a grid about half again as wide as high, without empty columns.
fn columns(cells: usize, step: [f64; 2]) -> usize {
    let cells = cells.max(1);
    let wanted = (cells as f64 * 1.5 * step[1] / step[0]).sqrt().round();
    let rows = cells.div_ceil((wanted as usize).clamp(1, cells));
    cells.div_ceil(rows)
}

/// Height of a block of text, in points.
pub(crate) fn block_height(lines: &[String], em: f64) -> f64 {
    (lines.len() as f64 * em * LEADING).ceil()
}

/// Writes lines downwards from the left margin; the footnote is paler.
pub(crate) fn write_block(canvas: &mut Canvas, lines: &[String], em: f64, top: f64) {
    let color = if em > LABEL_EM { INK } else { LINE };
    for (k, line) in lines.iter().enumerate() {
        let middle = top + (k as f64 + 0.5) * em * LEADING - 1.0;
        canvas.text(line, em, [MARGIN, middle], HPos::Left, color);
    }
}

#[cfg(test)]
mod tests {
    use super::columns;

    #[test]
    fn grids_are_full_and_wide() {
        let square = [1.0, 1.0];
        assert_eq!([1, 2, 3, 4, 6, 24].map(|n| columns(n, square)), [1, 2, 2, 2, 3, 6]);
        assert_eq!(columns(4, [9.0, 1.0]), 1);
        assert_eq!(columns(4, [1.0, 9.0]), 4);
    }
}
