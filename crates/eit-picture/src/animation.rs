//! Writes a sequence of images as a GIF.

use std::io::Write;

use gif::{DisposalMethod, Encoder, Frame, Repeat};
use ndarray::ArrayView3;

use crate::{
    PictureError, PictureSettings, SkinDrawing,
    canvas::{INK, LINE, PALE, Rgb, WHITE},
    sheet::{ImageSheet, SheetLayout},
};

/// Maximum number of frames in an animation; longer sequences are sampled evenly.
const MAX_FRAMES: usize = 300;
/// Longer side of the skin's panel, in points and pixels: for a single image and for several per
/// frame.
const SIDES: [f64; 2] = [320.0, 240.0];
/// Number of colours in a GIF's colour table.
const TABLE: usize = 256;

/// Writes images [frame, row, column] as a GIF that loops forever, at `rate_hz` frames per second.
///
/// Scale, electrodes and texts are those of [`crate::draw_sheet`] and stay the same throughout.
/// Sequences of more than 300 frames are sampled evenly to 300. GIF delays are multiples of 10 ms,
/// and viewers ignore delays below 20 ms, so faster rates play at 50 Hz. `progress` receives the
/// number of frames written and the total. With [`PictureSettings::columns`], each frame shows that
/// number of images side by side.
///
/// # Errors
/// As for a sheet; a rate that is not positive; a failure to write to `out`.
pub fn write_gif(
    images: ArrayView3<'_, f64>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
    rate_hz: f64,
    out: impl Write,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(), PictureError> {
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err(PictureError::FrameRate { rate_hz });
    }
    let delay = (100.0 / rate_hz).round().clamp(2.0, f64::from(u16::MAX)) as u16;
    let group = settings.columns.unwrap_or(1).clamp(1, 8);
    let side = SIDES[usize::from(group > 1)];
    let layout = SheetLayout { most: MAX_FRAMES, group, cells: group, side, zoom: 1 };
    let sheet = ImageSheet::new(images, skin, settings, layout)?;
    // a page with a few panels of 320 points, wrapped texts and a bar stays far below 65535 pixels
    let [width, height] = sheet.page.canvas.size_px();
    let mut palette = Palette::new(sheet.scale.colors());
    let mut encoder = Encoder::new(out, width as u16, height as u16, &palette.table())?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut before: Vec<u8> = Vec::new();
    let frames = sheet.chosen.len() / group;
    for k in 0..frames {
        let mut canvas = sheet.page.canvas.clone();
        (0..group).for_each(|cell| sheet.draw_frame(&mut canvas, cell, k * group + cell));
        let now = palette.indices(canvas.rgb());
        encoder.write_frame(&Frame { delay, ..changed(&before, &now, [width, height]) })?;
        before = now;
        progress(k + 1, frames);
    }
    Ok(())
}

/// Returns the smallest rectangle in which two pages differ, as a frame that is kept on the page:
/// everything if there was no previous page, a single pixel if nothing changed.
fn changed(before: &[u8], now: &[u8], [width, height]: [usize; 2]) -> Frame<'static> {
    let mut columns = [width, 0];
    let mut rows = [height, 0];
    let old_rows = before.chunks_exact(width).map(Some).chain(std::iter::repeat(None));
    for (y, (new, old)) in now.chunks_exact(width).zip(old_rows).enumerate() {
        let differs = |x: &usize| old.is_none_or(|old| old[*x] != new[*x]);
        if let Some(first) = (0..width).find(differs) {
            let last = (first..width).rev().find(differs).unwrap_or(first);
            columns = [columns[0].min(first), columns[1].max(last + 1)];
            rows = [rows[0].min(y), y + 1];
        }
    }
    if rows[1] == 0 {
        (columns, rows) = ([0, 1], [0, 1]);
    }
    let lines = now.chunks_exact(width).take(rows[1]).skip(rows[0]);
    let buffer: Vec<u8> = lines.flat_map(|line| &line[columns[0]..columns[1]]).copied().collect();
    Frame {
        left: columns[0] as u16,
        top: rows[0] as u16,
        width: (columns[1] - columns[0]) as u16,
        height: (rows[1] - rows[0]) as u16,
        buffer: buffer.into(),
        dispose: DisposalMethod::Keep,
        ..Frame::default()
    }
}

/// The colours of a GIF: those of the scale, lines and text, with greys between them.
struct Palette {
    colors: Vec<Rgb>,
    /// Colours seen, each with its nearest one: a page has a few hundred of them.
    seen: Vec<(Rgb, u8)>,
}

impl Palette {
    fn new(scale: &[Rgb]) -> Self {
        let mut colors: Vec<Rgb> = scale.iter().copied().take(TABLE / 2 + 96).collect();
        colors.extend([WHITE, INK, LINE, PALE]);
        let greys = TABLE - colors.len();
        colors.extend((0..greys).map(|k| [(255 * k / greys) as u8; 3]));
        let black = (Rgb::default(), nearest(&colors, Rgb::default()));
        Self { colors, seen: vec![black; 1 << 12] }
    }

    /// Returns the colour table in file format.
    fn table(&self) -> Vec<u8> {
        self.colors.concat()
    }

    /// Returns the index of the nearest colour for each pixel.
    fn indices(&mut self, rgb: &[u8]) -> Vec<u8> {
        let (pixels, _) = rgb.as_chunks();
        let index = |color: &Rgb| {
            let [red, green, blue] = color.map(usize::from);
            let seen = &mut self.seen[(red ^ green << 2 ^ blue << 4) % (1 << 12)];
            if seen.0 != *color {
                *seen = (*color, nearest(&self.colors, *color));
            }
            seen.1
        };
        pixels.iter().map(index).collect()
    }
}

/// Returns the index of the nearest colour; of equally near ones, the first.
fn nearest(colors: &[Rgb], color: Rgb) -> u8 {
    let distance = |other: &Rgb| -> u32 {
        other.iter().zip(color).map(|(a, b)| u32::from(a.abs_diff(b)).pow(2)).sum()
    };
    (0..colors.len()).min_by_key(|k| distance(&colors[*k])).unwrap_or(0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        ColorMap,
        fixtures_for_tests::{disc, walk},
    };

    fn write(images: ArrayView3<'_, f64>, rate_hz: f64) -> Vec<u8> {
        let settings = PictureSettings { title: "walk".into(), ..Default::default() };
        let mut bytes = Vec::new();
        write_gif(images, &disc(16), &settings, rate_hz, &mut bytes, &mut |_, _| {}).unwrap();
        bytes
    }

    /// Decodes the full pages that a viewer displays (palette indices) and the delays.
    fn play(bytes: &[u8]) -> (Vec<Vec<u8>>, Vec<u16>, usize) {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes).unwrap();
        let width = usize::from(decoder.width());
        let mut page = vec![0; width * usize::from(decoder.height())];
        let (mut pages, mut delays) = (Vec::new(), Vec::new());
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            for (row, line) in frame.buffer.chunks_exact(usize::from(frame.width)).enumerate() {
                let start = (row + usize::from(frame.top)) * width + usize::from(frame.left);
                page[start..start + line.len()].copy_from_slice(line);
            }
            delays.push(frame.delay);
            pages.push(page.clone());
        }
        assert_eq!(decoder.repeat(), Repeat::Infinite);
        (pages, delays, width)
    }

    #[test]
    fn a_sequence_plays_every_frame_at_its_rate_and_shows_what_a_sheet_shows() {
        let images = walk(4, 16);
        let (pages, delays, width) = play(&write(images.view(), 10.0));
        assert_eq!(delays, [10; 4]);
        let settings = PictureSettings { title: "walk".into(), ..Default::default() };
        let layout = SheetLayout { most: MAX_FRAMES, group: 1, cells: 1, side: SIDES[0], zoom: 1 };
        let sheet = ImageSheet::new(images.view(), &disc(16), &settings, layout).unwrap();
        let palette = Palette::new(sheet.scale.colors());
        for (k, page) in pages.iter().enumerate() {
            let mut canvas = sheet.page.canvas.clone();
            sheet.draw_frame(&mut canvas, 0, k);
            assert_eq!(canvas.size_px()[0], width);
            let mut worst = 0;
            for (index, wanted) in page.iter().zip(canvas.rgb().chunks_exact(3)) {
                let shown = palette.colors[usize::from(*index)];
                let off = shown.iter().zip(wanted).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
                worst = worst.max(off);
            }
            // the table has no mixtures of lines with saturated colours: at worst 39 off here,
            // whereas a missing frame would be off by more than 100
            assert!(worst <= 48, "frame {k}: {worst}");
        }
    }

    #[test]
    fn still_and_long_and_fast_sequences_are_played() {
        let (pages, ..) = play(&write(ndarray::Array3::zeros((3, 4, 4)).view(), 10.0));
        assert_eq!(pages.len(), 3);
        let mut last = (0, 0);
        let images = ndarray::Array3::from_elem((301, 1, 1), f64::NAN);
        let mut bytes = Vec::new();
        let settings = PictureSettings::default();
        write_gif(images.view(), &disc(4), &settings, 1e3, &mut bytes, &mut |done, all| {
            assert_eq!(done, last.0 + 1);
            last = (done, all);
        })
        .unwrap();
        assert_eq!(last, (300, 300));
        assert_eq!(play(&bytes).1, vec![2; 300]);
    }

    /// Three images per frame: six images give two frames with the panels side by side.
    #[test]
    fn images_of_a_frame_stand_side_by_side() {
        let settings = PictureSettings { columns: Some(3), ..Default::default() };
        let (mut bytes, mut last) = (Vec::new(), (0, 0));
        let images = walk(7, 8);
        write_gif(images.view(), &disc(4), &settings, 5.0, &mut bytes, &mut |done, all| {
            last = (done, all);
        })
        .unwrap();
        assert_eq!(last, (2, 2));
        let (pages, _, width) = play(&bytes);
        assert_eq!(pages.len(), 2);
        assert!(width > 3 * SIDES[1] as usize, "{width}");
    }

    #[test]
    fn the_same_input_gives_the_same_bytes() {
        let images = walk(3, 8);
        assert_eq!(write(images.view(), 7.0), write(images.view(), 7.0));
    }

    #[test]
    fn the_table_holds_the_scale_and_the_lines() {
        for map in [ColorMap::CoolWarm, ColorMap::Viridis] {
            let settings = PictureSettings { map, ..Default::default() };
            let scale = crate::scale::Scale::new([1.0].iter(), &settings).unwrap();
            let mut palette = Palette::new(scale.colors());
            assert_eq!(palette.table().len(), 3 * TABLE);
            let needed: Vec<Rgb> =
                scale.colors().iter().copied().chain([WHITE, INK, LINE, PALE]).collect();
            for (color, index) in needed.iter().zip(palette.indices(&needed.concat())) {
                assert_eq!(palette.colors[usize::from(index)], *color);
            }
        }
    }

    #[test]
    fn a_rate_that_is_none_and_a_writer_that_fails_are_errors() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
                Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
            }
            fn flush(&mut self) -> std::io::Result<()> {
                Ok(())
            }
        }
        let (images, settings) = (walk(2, 4), PictureSettings::default());
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error =
                write_gif(images.view(), &disc(4), &settings, rate_hz, Full, &mut |_, _| {});
            assert!(matches!(error, Err(PictureError::FrameRate { .. })));
        }
        let error = write_gif(images.view(), &disc(4), &settings, 10.0, Full, &mut |_, _| {});
        assert!(matches!(error, Err(PictureError::Gif(_))));
    }
}
