//! The pictures of the page. One file because they form a single list.

use super::Shown;
use crate::error::ReportError;
use crate::output::axes;
use eit_denoise::{ImageStack, ThresholdRule};
use eit_picture::{
    Canvas, ColorMap, FrameLabels, PictureSettings, Plot, Series, SkinDrawing, draw_plot,
    draw_sheet, write_gif,
};
use ndarray::{Array2, Array3, ArrayView2, Axis, stack};

/// Snapshots of each experiment: truth, equation (7), and the defaults.
pub(super) const SHEETS: [[&str; 3]; 2] = [
    ["one-finger-truth.png", "one-finger-equation-7.png", "one-finger-defaults.png"],
    ["two-fingers-truth.png", "two-fingers-equation-7.png", "two-fingers-defaults.png"],
];
/// Electrode movement, and the phantom without.
pub(super) const MOVEMENT: &str = "movement.png";
/// From image to wanted image.
pub(super) const BASE: &str = "learning-base.png";
/// By training and experiment: images of the net, and errors of each frame.
pub(super) const TRAINED: [[[&str; 2]; 2]; 2] = [
    [
        ["training-1-one-finger.png", "training-1-one-finger-errors.png"],
        ["training-1-two-fingers.png", "training-1-two-fingers-errors.png"],
    ],
    [
        ["training-2-one-finger.png", "training-2-one-finger-errors.png"],
        ["training-2-two-fingers.png", "training-2-two-fingers-errors.png"],
    ],
];
/// Pressure of each experiment: a sheet and a movie.
pub(super) const PRESSURE: [[&str; 2]; 2] = [
    ["one-finger-pressure.png", "one-finger-pressure.gif"],
    ["two-fingers-pressure.png", "two-fingers-pressure.gif"],
];
/// Snapshots per row of a sheet.
const COLUMNS: usize = 7;
/// Share of the pixels of a scale's images within it; artefacts at electrodes may be beyond.
const WITHIN: f64 = 0.998;
/// Electrodes move by less than a millimetre: arrows are drawn this many times as long.
const MAGNIFIED: f64 = 25.0;
/// Snapshots from which the learning base is shown, by experiment.
const SHOWN_OF_BASE: [[usize; 3]; 2] = [[1, 8, 16], [1, 8, 16]];
/// Frames per second of a movie, and the number of frames from one picture to the next.
const MOVIE_RATE_HZ: f64 = 12.0;
const MOVIE_STEP: usize = 3;

/// A picture as file name and content.
pub(super) type File = (&'static str, Vec<u8>);

/// Names of all pictures.
pub(super) fn names() -> Vec<&'static str> {
    let mut names = vec![MOVEMENT, BASE];
    names.extend(SHEETS.into_iter().flatten());
    names.extend(TRAINED.into_iter().flatten().flatten());
    names.extend(PRESSURE.into_iter().flatten());
    names
}

/// Draws all pictures.
pub(super) fn all(
    shown: &[Shown; 2],
    phantom: &Array2<f64>,
    skin: &SkinDrawing,
) -> Result<Vec<File>, ReportError> {
    let mut files = Vec::new();
    let mut keep = |name: &'static str, canvas: &Canvas| {
        files.push((name, crate::output::png(canvas)?));
        Ok::<_, ReportError>(())
    };
    keep(MOVEMENT, &movement(shown, phantom, skin)?)?;
    keep(BASE, &learning_base(shown, skin)?)?;
    for (k, shown) in shown.iter().enumerate() {
        let truth = &shown.recording.simulation.truth.conductivity_change_s;
        let name = shown.experiment.name;
        let (raw, defaults) = (&shown.equation_7.values, &shown.defaults.values);
        let sheets = [
            ([truth; 2], "the true change of conductivity", false),
            ([raw; 2], "images by equation (7)", false),
            ([defaults, truth], "this program's defaults; crosses: touches", true),
        ];
        for (file, (images, what, is_marked)) in SHEETS[k].into_iter().zip(sheets) {
            let marks = is_marked.then_some(&shown.defaults.marks_m[..]);
            keep(file, &shown.sheet(images, &format!("{name}: {what}"), marks, skin)?)?;
        }
        for (training, made) in shown.trained.iter().enumerate() {
            let [images, errors] = TRAINED[training][k];
            let what = format!("{name}, through the net of training {}", training + 1);
            keep(images, &shown.sheet([&made.values, raw], &what, None, skin)?)?;
            keep(errors, &shown.errors(training)?)?;
        }
    }
    for (k, shown) in shown.iter().enumerate() {
        let [sheet, movie] = PRESSURE[k];
        let step = shown.touched.len().div_ceil(COLUMNS).max(1);
        let few: Vec<usize> = shown.touched.iter().copied().skip(step / 2).step_by(step).collect();
        if let Some((images, settings)) = shown.pressures(&few, COLUMNS)? {
            files.push((sheet, crate::output::png(&draw_sheet(images.view(), skin, &settings)?)?));
        }
        let many: Vec<usize> = shown.touched.iter().copied().step_by(MOVIE_STEP).collect();
        if let Some((images, settings)) = shown.pressures(&many, many.len())? {
            // truth and reconstruction of a frame beside each other
            let count = many.len();
            let order: Vec<usize> = (0..count).flat_map(|k| [k, count + k]).collect();
            let images = images.select(Axis(0), &order);
            let FrameLabels::Text(labels) = &settings.labels else { continue };
            let labels = order.iter().map(|&k| labels[k].clone()).collect();
            let labels = FrameLabels::Text(labels);
            let settings = PictureSettings { labels, columns: Some(2), ..settings };
            let mut gif = Vec::new();
            write_gif(images.view(), skin, &settings, MOVIE_RATE_HZ, &mut gif, &mut |_, _| {})?;
            files.push((movie, gif));
        }
    }
    Ok(files)
}

impl Shown {
    /// Time of a frame, seconds.
    fn time_s(&self, frame: usize) -> f64 {
        frame as f64 / self.recording.script.frame_rate_hz
    }

    /// Ends of the colour scale for images as strong as these.
    fn range(&self, images: &Array3<f64>) -> Option<[f64; 2]> {
        let frames = self.snapshots.iter().map(|&frame| images.index_axis(Axis(0), frame));
        let magnitudes = frames.flatten().map(|value| value.abs()).filter(|v| v.is_finite());
        let most = eit_core::quantile(&magnitudes.collect::<Vec<_>>(), WITHIN);
        most.filter(|most| *most > 0.0).map(|most| [-most, most])
    }

    /// Draws the 21 snapshots of a stack of images, in the colours of another one.
    fn sheet(
        &self,
        [images, scale]: [&Array3<f64>; 2],
        title: &str,
        marks_m: Option<&[Vec<[f64; 2]>]>,
        skin: &SkinDrawing,
    ) -> Result<Canvas, ReportError> {
        let label =
            |(k, frame): (usize, &usize)| format!("{} · {:.0} s", k + 1, self.time_s(*frame));
        let marks = |marks: &[Vec<[f64; 2]>]| {
            self.snapshots.iter().filter_map(|&frame| marks.get(frame).cloned()).collect()
        };
        let settings = PictureSettings {
            title: title.to_owned(),
            footnote: format!(
                "{} of {} frames, seed {}",
                super::SNAPSHOTS,
                images.dim().0,
                super::SEED
            ),
            range: self.range(scale),
            labels: FrameLabels::Text(self.snapshots.iter().enumerate().map(label).collect()),
            marks_m: marks_m.map(marks).unwrap_or_default(),
            columns: Some(COLUMNS),
            zoom: 1,
            ..Default::default()
        };
        Ok(draw_sheet(images.select(Axis(0), &self.snapshots).view(), skin, &settings)?)
    }

    /// Draws the error of each frame to the rule's wanted image and to the truth, before and after a net.
    fn errors(&self, training: usize) -> Result<Canvas, ReportError> {
        let made = &self.trained[training];
        let curve = |name: &str, errors_s2: &[f64]| Series {
            name: name.to_owned(),
            points: self.touched.iter().map(|&f| [self.time_s(f), errors_s2[f]]).collect(),
            line: true,
            markers: false,
        };
        let (name, raw) = (self.experiment.name, &self.equation_7);
        Ok(draw_plot(&Plot {
            title: format!("{name}, training {}: error of each frame", training + 1),
            footnote: format!("mean squared error; seed {}", super::SEED),
            series: vec![
                curve("before, to the wanted image", &raw.to_rule_s2),
                curve("after, to the wanted image", &made.to_rule_s2),
                curve("before, to the truth", &raw.to_truth_s2),
                curve("after, to the truth", &made.to_truth_s2),
            ],
            zoom: 1,
            ..axes([("time (s)", false), ("error (S²)", true)])
        })?)
    }

    /// True pressures of frames, then those found; `None` where no force is known.
    fn pressures(
        &self,
        frames: &[usize],
        columns: usize,
    ) -> Result<Option<(Array3<f64>, PictureSettings)>, ReportError> {
        let Some(pressed) = &self.defaults.pressed else { return Ok(None) };
        let truth = self.recording.simulation.truth.pressure_pa.select(Axis(0), frames);
        let found = pressed.images_pa.select(Axis(0), frames);
        let most = truth.iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(*v));
        let label = |what: &'static str| {
            move |&frame: &usize| format!("{what}, {:.0} s", self.time_s(frame))
        };
        let labels = frames.iter().map(label("truth")).chain(frames.iter().map(label("found")));
        let settings = PictureSettings {
            title: format!("{}: pressure", self.experiment.name),
            footnote: format!(
                "force learnt from presses, over the image of the touch; seed {}",
                super::SEED
            ),
            quantity: "p".to_owned(),
            unit: "Pa".to_owned(),
            map: ColorMap::Viridis,
            range: (most > 0.0).then_some([0.0, most]),
            labels: FrameLabels::Text(labels.collect()),
            columns: Some(columns),
            zoom: 1,
            ..Default::default()
        };
        Ok(Some((ndarray::concatenate(Axis(0), &[truth.view(), found.view()])?, settings)))
    }
}

/// Draws the phantom, a finger near the rim and two fingers by equation (7), with the movement of the electrodes.
fn movement(
    shown: &[Shown; 2],
    phantom: &Array2<f64>,
    skin: &SkinDrawing,
) -> Result<Canvas, ReportError> {
    let mut images = vec![phantom.view()];
    let mut labels = vec!["phantom: electrodes do not move".to_owned()];
    let (mut arrows_m, mut most_m) = (vec![Vec::new()], 0.0_f64);
    for (shown, what) in shown.iter().zip(["fabric, near the rim", "fabric, two fingers"]) {
        let frame = shown.snapshots.get(1).copied().unwrap_or(0);
        images.push(shown.equation_7.values.index_axis(Axis(0), frame));
        let shifts_m =
            shown.recording.simulation.truth.electrode_shift_m.index_axis(Axis(0), frame);
        let mut arrows = Vec::new();
        for electrode in &skin.electrodes {
            let Some(&from) = electrode.rim_m.get(electrode.rim_m.len() / 2) else { continue };
            let shift = shifts_m.row(electrode.number - 1);
            most_m = most_m.max(shift[0].hypot(shift[1]));
            arrows.push([from, [from[0] + MAGNIFIED * shift[0], from[1] + MAGNIFIED * shift[1]]]);
        }
        arrows_m.push(arrows);
        labels.push(format!("{what}, {:.0} s", shown.time_s(frame)));
    }
    let settings = PictureSettings {
        title: "Electrodes move with the fabric".to_owned(),
        footnote: format!(
            "images by equation (7); arrows: {MAGNIFIED:.0} times the movement, at most {:.2} mm; seed {}",
            1e3 * most_m,
            super::SEED
        ),
        range: shown[0].range(&shown[0].equation_7.values),
        labels: FrameLabels::Text(labels),
        arrows_m,
        columns: Some(3),
        ..Default::default()
    };
    Ok(draw_sheet(stack(Axis(0), &images)?.view(), skin, &settings)?)
}

/// Draws the steps from an image to the wanted image: without the ring at the rim, above 55 % of the largest value, and
/// without blobs of fewer than 15 pixels.
fn learning_base(shown: &[Shown; 2], skin: &SkinDrawing) -> Result<Canvas, ReportError> {
    let rule = ThresholdRule::default();
    let steps = [
        ThresholdRule { share: 0.0, least_pixels: 0, ..rule },
        ThresholdRule { least_pixels: 0, ..rule },
        rule,
    ];
    let names = ["image", "rim suppressed", "above 55 %", "15 pixels or more"];
    let columns = SHOWN_OF_BASE.as_flattened().len();
    let mut rows: Vec<Vec<Array2<f64>>> = vec![Vec::new(); names.len()];
    let mut labels = vec![Vec::new(); names.len()];
    for (shown, chosen) in shown.iter().zip(SHOWN_OF_BASE) {
        let mask = shown.equation_7.raster.mask();
        for &frame in chosen.iter().filter_map(|&k| shown.snapshots.get(k)) {
            let image: ArrayView2<'_, f64> = shown.equation_7.values.index_axis(Axis(0), frame);
            let one = ImageStack::new(image.insert_axis(Axis(0)).to_owned(), mask.clone())?;
            rows[0].push(image.to_owned());
            for (row, step) in steps.iter().enumerate() {
                let kept = step.on(mask.view())?.apply(&one)?.into_parts().0;
                rows[row + 1].push(kept.index_axis(Axis(0), 0).to_owned());
            }
            for (labels, name) in labels.iter_mut().zip(names) {
                labels.push(format!("{name}, {:.0} s", shown.time_s(frame)));
            }
        }
    }
    let images: Vec<_> = rows.iter().flatten().map(|image| image.view()).collect();
    let settings = PictureSettings {
        title: "From an image to the wanted image of the learning base".to_owned(),
        footnote: format!("one finger and two fingers by equation (7), seed {}", super::SEED),
        range: shown[0].range(&shown[0].equation_7.values),
        labels: FrameLabels::Text(labels.concat()),
        columns: Some(columns),
        zoom: 1,
        ..Default::default()
    };
    Ok(draw_sheet(stack(Axis(0), &images)?.view(), skin, &settings)?)
}
