//! Draws a sheet: one or more images of one skin on a page with one colour bar.

use ndarray::{ArrayView3, Axis};

use crate::{
    FrameLabels, PictureError, PictureSettings, SkinDrawing,
    canvas::Canvas,
    page::{LABEL_EM, Page, PageSettings},
    panel::Panel,
    scale::{LARGEST, SMALLEST, Scale},
    text::Font,
};

/// Maximum number of images on a sheet.
const MAX_PANELS: usize = 24;

/// Draws images [frame, row, column] on one page with a common scale.
///
/// Row 0 is at the top (largest y); NaN means no value. Of more than 24 frames, 24 are chosen
/// evenly, including the first and the last, and the footnote says so. A raster finer than the
/// panel's pixels is sampled, not averaged.
///
/// # Errors
/// No image; a skin with coordinates that are not finite; labels, range or rate that are not valid.
pub fn draw_sheet(
    images: ArrayView3<'_, f64>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
) -> Result<Canvas, PictureError> {
    let cells = images.len_of(Axis(0)).min(MAX_PANELS);
    let side = match cells {
        0..=1 => 400.0,
        2..=4 => 280.0,
        _ => 190.0,
    };
    let zoom = settings.zoom.clamp(1, 4);
    let layout = SheetLayout { most: MAX_PANELS, group: 1, cells, side, zoom };
    let sheet = ImageSheet::new(images, skin, settings, layout)?;
    let mut canvas = sheet.page.canvas.clone();
    for cell in 0..cells {
        sheet.draw_frame(&mut canvas, cell, cell);
    }
    Ok(canvas)
}

/// How frames are selected and arranged.
pub(crate) struct SheetLayout {
    /// Maximum number of frames to show.
    pub(crate) most: usize,
    /// Number of images per frame.
    pub(crate) group: usize,
    /// Number of panels on the page.
    pub(crate) cells: usize,
    /// Longer side of each panel, in points.
    pub(crate) side: f64,
    /// Pixels per point.
    pub(crate) zoom: usize,
}

/// The selected frames and a page without them.
pub(crate) struct ImageSheet<'a> {
    images: ArrayView3<'a, f64>,
    smooth: bool,
    /// Indices of the images shown.
    pub(crate) chosen: Vec<usize>,
    labels: Vec<String>,
    marks_m: Vec<Vec<[f64; 2]>>,
    arrows_m: Vec<Vec<[[f64; 2]; 2]>>,
    pub(crate) scale: Scale,
    panel: Panel,
    pub(crate) page: Page,
}

impl<'a> ImageSheet<'a> {
    /// Validates the input and prepares everything that all frames share.
    pub(crate) fn new(
        images: ArrayView3<'a, f64>,
        skin: &SkinDrawing,
        settings: &PictureSettings,
        layout: SheetLayout,
    ) -> Result<Self, PictureError> {
        let (frames, rows, columns) = images.dim();
        if images.is_empty() {
            return Err(PictureError::Empty { frames, rows, columns });
        }
        let SheetLayout { most, group, cells, side, zoom } = layout;
        let groups = evenly_chosen(frames / group, most);
        let chosen: Vec<usize> = groups.iter().flat_map(|g| g * group..(g + 1) * group).collect();
        let range = settings.range.or_else(|| robust_range(images));
        let scale = Scale::new(images.iter(), &PictureSettings { range, ..settings.clone() })?;
        let labels = labels(&settings.labels, frames, &chosen)?;
        let font = Font::load()?;
        let labels: Vec<String> =
            labels.iter().map(|label| font.shortened(label, LABEL_EM, 300.0)).collect();
        let panel = Panel::new(skin, side, zoom, &font)?;
        let mut notes = vec![settings.footnote.clone()];
        if chosen.len() < frames {
            notes.push(format!("{} of {} frames", groups.len(), frames / group));
        }
        notes.extend(scale.remarks.iter().cloned());
        let page = Page::new(
            &PageSettings {
                title: &settings.title,
                note: &joined(&notes),
                cells,
                columns: settings.columns,
                cell_size: panel.size,
                label_width: labels.iter().map(|l| font.width(l, LABEL_EM)).reduce(f64::max),
                scale: Some(&scale),
                zoom,
            },
            font,
        );
        let of = |frame: &usize| settings.marks_m.get(*frame).cloned().unwrap_or_default();
        let marks_m = chosen.iter().map(of).collect();
        let of = |frame: &usize| settings.arrows_m.get(*frame).cloned().unwrap_or_default();
        let arrows_m = chosen.iter().map(of).collect();
        let smooth = settings.smooth;
        Ok(Self { images, smooth, chosen, labels, marks_m, arrows_m, scale, panel, page })
    }

    /// Draws the `k`-th selected frame into a panel of the page.
    pub(crate) fn draw_frame(&self, canvas: &mut Canvas, cell: usize, k: usize) {
        let corner = self.page.corners[cell];
        let image = self.images.index_axis(Axis(0), self.chosen[k]);
        self.panel.draw_image(canvas, corner, image, &self.scale, self.smooth);
        self.panel.draw_skin(canvas, corner);
        self.panel.draw_marks(canvas, corner, &self.marks_m[k]);
        self.panel.draw_arrows(canvas, corner, &self.arrows_m[k]);
        self.page.label(canvas, corner, &self.labels[k]);
    }
}

/// Ends of the colours: of each image the smallest and largest value but for 0.2 % of its pixels, so that a hot pixel
/// does not turn every touch pale; of these the outermost, so that a touch in a single image counts in full. `None`
/// where the scale's own choice is the same or needed.
fn robust_range(images: ArrayView3<'_, f64>) -> Option<[f64; 2]> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for image in images.outer_iter() {
        let finite = image.iter().copied().filter(|value| value.abs() <= LARGEST);
        let mut values: Vec<f64> = finite.collect();
        let Some(last) = values.len().checked_sub(1) else { continue };
        let beyond = (0.002 * values.len() as f64) as usize;
        low = low.min(*values.select_nth_unstable_by(beyond, f64::total_cmp).1);
        high = high.max(*values.select_nth_unstable_by(last - beyond, f64::total_cmp).1);
    }
    (low < high && low.abs().max(high.abs()) > SMALLEST).then_some([low, high])
}

/// Joins the notes that are not empty into one line.
pub(crate) fn joined(notes: &[String]) -> String {
    let notes: Vec<&str> = notes.iter().map(|n| n.trim()).filter(|n| !n.is_empty()).collect();
    notes.join(" · ")
}

/// Returns evenly chosen indices, including the first and the last; all of them up to `most`.
fn evenly_chosen(frames: usize, most: usize) -> Vec<usize> {
    let count = frames.min(most);
    let gaps = count.saturating_sub(1).max(1);
    (0..count).map(|k| (k * frames.saturating_sub(1) + gaps / 2) / gaps).collect()
}

/// Labels of the selected frames.
fn labels(
    labels: &FrameLabels,
    frames: usize,
    chosen: &[usize],
) -> Result<Vec<String>, PictureError> {
    match labels {
        FrameLabels::Number => Ok(chosen.iter().map(|frame| format!("frame {frame}")).collect()),
        FrameLabels::Time { rate_hz } if rate_hz.is_finite() && *rate_hz > 0.0 => {
            let label = |frame: &usize| format!("frame {frame} · {:.2} s", *frame as f64 / rate_hz);
            Ok(chosen.iter().map(label).collect())
        }
        FrameLabels::Time { rate_hz } => Err(PictureError::FrameRate { rate_hz: *rate_hz }),
        FrameLabels::Text(texts) if texts.len() == frames => {
            Ok(chosen.iter().map(|frame| texts[*frame].clone()).collect())
        }
        FrameLabels::Text(texts) => Err(PictureError::LabelCount { labels: texts.len(), frames }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        ColorMap,
        canvas::PALE,
        fixtures_for_tests::{disc, inner_box, walk},
    };

    fn small() -> PictureSettings {
        PictureSettings { zoom: 1, ..Default::default() }
    }

    fn count(canvas: &Canvas, color: [u8; 3]) -> usize {
        canvas.rgb().chunks_exact(3).filter(|pixel| *pixel == color).count()
    }

    #[test]
    fn frames_are_chosen_evenly_with_both_ends() {
        assert_eq!(evenly_chosen(3, 24), [0, 1, 2]);
        assert_eq!(evenly_chosen(11, 3), [0, 5, 10]);
        let chosen = evenly_chosen(255, 24);
        assert_eq!((chosen.len(), chosen[0], chosen[23]), (24, 0, 254));
        // 254 / 23 is 11.04
        assert!(chosen.windows(2).all(|w| (11..=12).contains(&(w[1] - w[0]))));
    }

    #[test]
    fn the_page_grows_with_the_panels_and_the_zoom() {
        let size = |frames: usize, zoom: usize| {
            let settings = PictureSettings { zoom, ..Default::default() };
            draw_sheet(walk(frames, 8).view(), &disc(8), &settings).unwrap().size_px()
        };
        let ([w6, h6], [w24, h24]) = (size(6, 1), size(24, 1));
        // 3 x 2 and 6 x 4 panels of 190 points, a gap of 8 and a label of 17 under each
        assert_eq!([w24 - w6, h24 - h6], [3 * (190 + 8), 2 * (190 + 17 + 8)]);
        assert_eq!(size(6, 2), [2 * w6, 2 * h6]);
        // one more line in the footnote: "24 of 25 frames"
        assert_eq!(size(25, 1)[0], w24);
        assert!(size(25, 1)[1] > h24);
    }

    #[test]
    fn the_same_input_gives_the_same_bytes() {
        let png = || {
            let mut bytes = Vec::new();
            let canvas = draw_sheet(walk(5, 16).view(), &disc(16), &small()).unwrap();
            canvas.write_png(&mut bytes).unwrap();
            (bytes, canvas)
        };
        let ((bytes, canvas), (again, _)) = (png(), png());
        assert_eq!(bytes, again);
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        let mut decoded = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut decoded).unwrap();
        assert_eq!([info.width, info.height].map(|size| size as usize), canvas.size_px());
        assert_eq!(&decoded[..info.buffer_size()], canvas.rgb());
    }

    #[test]
    fn a_touch_is_red_where_it_is() {
        // frame 0 of the walk: the bump is on the right
        let skin = disc(4);
        let canvas = draw_sheet(walk(1, 64).view(), &skin, &small()).unwrap();
        let red = ColorMap::CoolWarm.color(1.0);
        let pixel = |x: usize, y: usize| {
            let at = 3 * (y * canvas.size_px()[0] + x);
            &canvas.rgb()[at..at + 3]
        };
        // panel of 400 points at (14, 14); its middle is that of the disc, and 0.05 m are about 92
        // points
        assert_eq!(pixel(214 + 92, 214), red);
        assert_eq!(pixel(214 - 92, 214), ColorMap::CoolWarm.color(0.5));
    }

    /// An arrow is drawn where it is, and one without length or end is not.
    #[test]
    fn arrows_are_drawn_from_end_to_end() {
        let drawn = |arrow: [[f64; 2]; 2]| {
            let settings = PictureSettings { arrows_m: vec![vec![arrow]], ..small() };
            let images = ndarray::Array3::zeros((1, 64, 64));
            let canvas = draw_sheet(images.view(), &disc(4), &settings).unwrap();
            let dark = |at: usize| canvas.rgb()[3 * at] < 100;
            let width = canvas.size_px()[0];
            // the row of the middle, between the electrodes
            (60..360).filter(|x| dark(214 * width + x)).collect::<Vec<_>>()
        };
        let shown = drawn([[-0.05, 0.0], [0.05, 0.0]]);
        assert!((170..200).contains(&shown.len()), "{} pixels", shown.len());
        assert!(shown[0] > 115 && shown[0] < 130 && *shown.last().unwrap() > 300, "{shown:?}");
        assert_eq!(drawn([[0.0; 2]; 2]), [0; 0]);
        assert_eq!(drawn([[0.0; 2], [f64::NAN, 0.0]]), [0; 0]);
    }

    /// One hot pixel, a thousand times as strong as the touch, leaves the touch in full colour, and the footnote counts
    /// it.
    #[test]
    fn a_hot_pixel_does_not_hide_a_touch() {
        let (mut images, settings) = (walk(3, 64), small());
        let before = robust_range(images.view()).unwrap();
        let most = images.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
        images[[1, 40, 40]] = 1e3 * most;
        // the hot pixel takes the place of one other: the end moves by a pixel's step of the touch
        let [low, high] = robust_range(images.view()).unwrap();
        assert!((high / before[1] - 1.0).abs() < 0.01, "{before:?}, then {low} to {high}");
        assert!((0.5 * most..=most).contains(&high), "{low} to {high} of {most}");
        let layout = SheetLayout { most: 3, group: 1, cells: 3, side: 190.0, zoom: 1 };
        let sheet = ImageSheet::new(images.view(), &disc(4), &settings, layout).unwrap();
        assert!(sheet.scale.remarks.iter().any(|r| r.starts_with("values beyond the bar: ")));
        // a range that was asked for is kept
        let settings = PictureSettings { range: Some([-most, most]), ..settings };
        let layout = SheetLayout { most: 3, group: 1, cells: 3, side: 190.0, zoom: 1 };
        let sheet = ImageSheet::new(images.view(), &disc(4), &settings, layout).unwrap();
        assert_eq!(sheet.scale.remarks, ["values beyond the bar: 1"]);
    }

    #[test]
    fn values_that_are_none_are_hatched_or_left_white() {
        let mut images = walk(1, 16);
        images.fill(f64::NAN);
        let mut skin = disc(4);
        let hatched = count(&draw_sheet(images.view(), &skin, &small()).unwrap(), PALE);
        assert!(hatched > 1000, "{hatched}");
        skin.outlines_m.clear();
        // the edge of a letter may happen to have that grey
        let letters = count(&draw_sheet(images.view(), &skin, &small()).unwrap(), PALE);
        assert!(letters < 50, "{letters}");
    }

    #[test]
    fn odd_images_and_skins_still_make_a_picture() {
        let extreme = [0.0, -0.0, 5e-324, 1e-300, f64::MAX, f64::MIN, f64::INFINITY, f64::NAN];
        let slim = SkinDrawing {
            outlines_m: vec![vec![[0.0, 0.0], [100.0, 0.0], [100.0, 1e-3], [0.0, 1e-3]]],
            ..disc(0)
        };
        let mut empty = disc(0);
        empty.outlines_m = vec![vec![], vec![[0.0; 2]], inner_box(0, [9.0, 9.0], 0.0).rim_m];
        empty.electrodes = vec![inner_box(0, [0.0; 2], 0.0), inner_box(usize::MAX, [0.0; 2], 0.0)];
        empty.electrodes[0].rim_m.clear();
        for skin in [disc(16), slim, empty] {
            for map in [ColorMap::CoolWarm, ColorMap::Viridis] {
                for value in extreme {
                    for (smooth, shape) in [(true, (1, 1, 1)), (false, (2, 1, 7))] {
                        let mut images = ndarray::Array3::from_elem(shape, value);
                        images[[0, 0, 0]] = extreme[shape.2];
                        let long = "long ".repeat(99);
                        let settings = PictureSettings {
                            title: long.clone(),
                            quantity: long.clone(),
                            unit: long.clone(),
                            labels: FrameLabels::Text(vec![long; shape.0]),
                            map,
                            smooth,
                            ..small()
                        };
                        let [width, height] =
                            draw_sheet(images.view(), &skin, &settings).unwrap().size_px();
                        assert!(width.max(height) < 1200, "{width} x {height}");
                    }
                }
            }
        }
    }

    #[test]
    fn input_that_does_not_fit_is_refused() {
        let labels = FrameLabels::Text(vec!["one".into()]);
        let error = |images: ndarray::Array3<f64>, labels: &FrameLabels| {
            let settings = PictureSettings { labels: labels.clone(), ..small() };
            draw_sheet(images.view(), &disc(4), &settings).unwrap_err().to_string()
        };
        assert!(error(walk(2, 4), &labels).contains("1 labels for 2 frames"));
        let stopped = FrameLabels::Time { rate_hz: 0.0 };
        assert!(error(walk(2, 4), &stopped).contains("frame rate 0 Hz"));
        let none = ndarray::Array3::zeros((0, 4, 4));
        assert!(error(none, &FrameLabels::Number).contains("[0, 4, 4]"));
    }
}
