//! A plotters backend that draws on a [`Canvas`].

use std::convert::Infallible;

use plotters::style::text_anchor::VPos;
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};

use crate::{
    Canvas,
    canvas::Rgb,
    text::{CAP_HEIGHT_EM, DESCENT_EM},
};

/// A canvas as seen by plotters, in pixels. The canvas draws lines and letters itself
/// (docs/DESIGN.md explains why).
pub(crate) struct Backend(pub(crate) Canvas);

/// Drawing cannot fail.
type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// Returns colour and opacity.
fn color_of(color: BackendColor) -> (Rgb, f64) {
    let (r, g, b) = color.rgb;
    ([r, g, b], color.alpha)
}

impl DrawingBackend for Backend {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        let [width, height] = self.0.size_px().map(|size| size as u32);
        (width, height)
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, at: BackendCoord, color: BackendColor) -> Drawn {
        let (color, opacity) = color_of(color);
        self.0.blend(at.0.into(), at.1.into(), color, opacity);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        let (color, opacity) = color_of(style.color());
        let width = style.stroke_width();
        // align lines along the axes with pixel borders, so that they are sharp
        let middle = f64::from(width % 2) / 2.0;
        let path: Vec<_> =
            path.into_iter().map(|(x, y)| [x, y].map(|at| f64::from(at) + middle)).collect();
        self.0.stroke_px(&path, width.into(), color, opacity);
        Ok(())
    }

    /// Draws a filled circle; plots use no others.
    fn draw_circle<S: BackendStyle>(
        &mut self,
        at: BackendCoord,
        radius: u32,
        style: &S,
        _fill: bool,
    ) -> Drawn {
        let (color, opacity) = color_of(style.color());
        let middle = [at.0, at.1].map(|at| f64::from(at) + 0.5);
        self.0.stroke_px(&[middle], 2.0 * f64::from(radius), color, opacity);
        Ok(())
    }

    /// Draws text; the size of a style is its em.
    fn draw_text<T: BackendTextStyle>(&mut self, text: &str, style: &T, at: BackendCoord) -> Drawn {
        let (em, (color, opacity)) = (style.size(), color_of(style.color()));
        let baseline = match style.anchor().v_pos {
            VPos::Top => CAP_HEIGHT_EM * em,
            VPos::Center => CAP_HEIGHT_EM * em / 2.0,
            VPos::Bottom => -DESCENT_EM * em,
        };
        let font = self.0.font().clone();
        let left = font.left_of(text, em, style.anchor().h_pos);
        font.raster(text, em, [left.round(), baseline.round()], |right, down, covered| {
            let (right, down) = style.transform().transform(right as i32, down as i32);
            self.0.blend((at.0 + right).into(), (at.1 + down).into(), color, covered * opacity);
        });
        Ok(())
    }

    fn estimate_text_size<T: BackendTextStyle>(
        &self,
        text: &str,
        style: &T,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let em = style.size();
        Ok((self.0.font().width(text, em).ceil() as u32, (CAP_HEIGHT_EM * em).ceil() as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::Font;
    use plotters::style::{
        BLACK, FontDesc, FontFamily, FontStyle, FontTransform, ShapeStyle, TextStyle,
        text_anchor::{HPos, Pos},
    };

    fn page() -> Backend {
        Backend(Canvas::new(200.0, 200.0, 1, Font::load().unwrap()))
    }

    /// Returns the first column and one past the last, then the same for rows, that are darker than
    /// mid-grey.
    fn dark(page: &Backend) -> [[i32; 2]; 2] {
        let dots = page.0.rgb().chunks_exact(3).enumerate().filter(|(_, dot)| dot[0] < 128);
        let dots: Vec<[i32; 2]> = dots.map(|(k, _)| [k as i32 % 200, k as i32 / 200]).collect();
        [0, 1].map(|axis| {
            let along = || dots.iter().map(|dot| dot[axis]);
            [along().min().unwrap(), along().max().unwrap() + 1]
        })
    }

    /// An I of 73 pixels, its stem centred 15 pixels from its start, for every anchor.
    #[test]
    fn text_stands_where_it_is_anchored() {
        let written = |h_pos, v_pos, turn: FontTransform| {
            let font = FontDesc::new(FontFamily::SansSerif, 100.0, FontStyle::Normal);
            let style = TextStyle { font: font.transform(turn), ..TextStyle::from("") };
            let mut page = page();
            page.draw_text("I", &style.pos(Pos::new(h_pos, v_pos)), (100, 100)).unwrap();
            dark(&page).map(|[low, high]| [low - 100, high - 100])
        };
        let middle = |[low, high]: [i32; 2]| (low + high) / 2;
        let [x, y] = written(HPos::Left, VPos::Top, FontTransform::None);
        assert!(
            (middle(x) - 15).abs() <= 1 && y[0].abs() <= 1 && (y[1] - 73).abs() <= 1,
            "{x:?} {y:?}"
        );
        let [x, y] = written(HPos::Center, VPos::Center, FontTransform::None);
        assert!(middle(x).abs() <= 1 && middle(y).abs() <= 1, "{x:?} {y:?}");
        let [x, y] = written(HPos::Right, VPos::Bottom, FontTransform::None);
        // 24 pixels are left below for descenders
        assert!((middle(x) + 15).abs() <= 1 && (y[1] + 24).abs() <= 1, "{x:?} {y:?}");
        // rotated upwards: the right side becomes the top
        let [x, y] = written(HPos::Left, VPos::Center, FontTransform::Rotate270);
        assert!(middle(x).abs() <= 1 && (middle(y) + 15).abs() <= 1, "{x:?} {y:?}");
    }

    #[test]
    fn lines_along_the_axes_are_sharp_and_as_wide_as_wanted() {
        for width in 1..5 {
            let style = ShapeStyle::from(BLACK).stroke_width(width);
            let mut page = page();
            page.draw_line((100, 20), (100, 180), &style).unwrap();
            // between its ends, a row is only black and white
            let row = &page.0.rgb()[3 * 200 * 100..3 * 200 * 101];
            assert!(row.iter().all(|part| *part == 0 || *part == 255));
            assert_eq!(row.iter().filter(|part| **part == 0).count(), 3 * width as usize);
        }
    }
}
