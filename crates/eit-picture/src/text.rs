//! Text: widths, line breaks and anti-aliased glyphs of the built-in font.

use ab_glyph::{Font as _, FontRef, PxScale, ScaleFont as _, point};
use plotters::style::text_anchor::HPos;

use crate::PictureError;

/// Height of capitals and digits of DejaVu Sans relative to its em (1493 of 2048 units), and
/// descent below the baseline (483).
pub(crate) const CAP_HEIGHT_EM: f64 = 0.729;
pub(crate) const DESCENT_EM: f64 = 0.236;

/// Maximum number of lines of a text; the rest is cut, so that no text makes a page too large to
/// write.
const MOST_LINES: usize = 12;

/// The built-in sans serif.
#[derive(Clone, Debug)]
pub(crate) struct Font(FontRef<'static>);

impl Font {
    /// Loads the built-in font.
    pub(crate) fn load() -> Result<Self, PictureError> {
        let bytes: &'static [u8] = include_bytes!("../assets/DejaVuSans-subset.ttf");
        FontRef::try_from_slice(bytes).map(Self).map_err(|_| PictureError::Font)
    }

    /// ab_glyph scales by ascent plus descent; sizes in this crate are the em.
    fn scale(&self, em: f64) -> PxScale {
        let units_per_em = self.0.units_per_em().unwrap_or(2048.0);
        PxScale::from(em as f32 * self.0.height_unscaled() / units_per_em)
    }

    /// Width of a line of text with em `em`, in the same unit.
    pub(crate) fn width(&self, text: &str, em: f64) -> f64 {
        let font = self.0.as_scaled(self.scale(em));
        text.chars().map(|c| f64::from(font.h_advance(font.glyph_id(c)))).sum()
    }

    /// Offset of the start of a line of text from its anchor.
    pub(crate) fn left_of(&self, text: &str, em: f64, align: HPos) -> f64 {
        match align {
            HPos::Left => 0.0,
            HPos::Center => -0.5 * self.width(text, em),
            HPos::Right => -self.width(text, em),
        }
    }

    /// Breaks text at spaces (but not at no-break spaces) so that no line is wider than `width`; a
    /// longer word is cut, as is a text of more than twelve lines.
    pub(crate) fn wrap(&self, text: &str, em: f64, width: f64) -> Vec<String> {
        let mut lines = Vec::new();
        let mut line = String::new();
        for letter in text.trim().chars() {
            let blank = letter.is_whitespace() && letter != '\u{a0}';
            line.push(if blank { ' ' } else { letter });
            if self.width(&line, em) > width && line.chars().count() > 1 {
                let cut = match line.trim_end().rfind(' ') {
                    Some(blank) if blank > 0 => blank,
                    _ => line.len() - letter.len_utf8(),
                };
                let rest = line.split_off(cut).trim_start().to_owned();
                lines.push(std::mem::replace(&mut line, rest).trim_end().to_owned());
                if lines.len() == MOST_LINES {
                    lines.iter_mut().skip(MOST_LINES - 1).for_each(|last| last.push('…'));
                    return lines;
                }
            }
        }
        if !line.trim().is_empty() {
            lines.push(line);
        }
        lines
    }

    /// Text on one line, shortened with an ellipsis if it is wider than `width`.
    pub(crate) fn shortened(&self, text: &str, em: f64, width: f64) -> String {
        match &self.wrap(text, em, width)[..] {
            [] => String::new(),
            [line] => line.clone(),
            [line, ..] => format!("{line}…"),
        }
    }

    /// Calls `paint(x, y, coverage)` for each pixel touched by a line of text whose baseline starts
    /// at (`x`, `y`); pixel coordinates count right and down and may be negative.
    pub(crate) fn raster(
        &self,
        text: &str,
        em: f64,
        [x, y]: [f64; 2],
        mut paint: impl FnMut(i64, i64, f64),
    ) {
        let scale = self.scale(em);
        let font = self.0.as_scaled(scale);
        let mut pen_x = x as f32;
        for letter in text.chars() {
            let id = font.glyph_id(letter);
            if let Some(glyph) =
                self.0.outline_glyph(id.with_scale_and_position(scale, point(pen_x, y as f32)))
            {
                let corner = glyph.px_bounds().min;
                glyph.draw(|column, row, coverage| {
                    let (left, top) = (corner.x as i64, corner.y as i64);
                    paint(left + i64::from(column), top + i64::from(row), f64::from(coverage));
                });
            }
            pen_x += font.h_advance(id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Font;

    #[test]
    fn lines_fit_and_lose_no_letter() {
        let font = Font::load().unwrap();
        let text = "Gauss-Newton, hyperparameter 0.03, and_one_word_that_is_too_long_for_any_line";
        let lines = font.wrap(text, 11.0, 120.0);
        assert!(lines.iter().all(|line| font.width(line, 11.0) <= 120.0), "{lines:?}");
        let letters = |s: &str| s.chars().filter(|c| !c.is_whitespace()).collect::<String>();
        assert_eq!(letters(&lines.concat()), letters(text));
        assert!(font.wrap("  ", 11.0, 120.0).is_empty());
        assert_eq!(font.wrap("ab", 11.0, 0.0), ["a", "b"]);
        assert_eq!(font.wrap("a at 100\u{a0}V", 11.0, 40.0), ["a at", "100\u{a0}V"]);
        let long = font.wrap(&text.repeat(99), 11.0, 120.0);
        assert_eq!((long.len(), long[11].ends_with('…')), (12, true));
        assert_eq!(font.shortened("one two", 11.0, 30.0), "one…");
    }

    #[test]
    fn every_sign_the_pictures_use_has_a_glyph() {
        use ab_glyph::Font as _;
        let font = Font::load().unwrap();
        for sign in "Δσλµ·−×°²³⁰¹⁴⁵⁶⁷⁸⁹⁻Ω0Az~".chars() {
            assert_ne!(font.0.glyph_id(sign).0, 0, "{sign}");
        }
    }
}
