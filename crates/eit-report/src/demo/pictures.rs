//! The pictures. One file because they form a single list.

use super::accuracy::Accuracy;
use super::experiment::Experiment;
use super::live::LiveRun;
use crate::error::ReportError;
use crate::output::axes;
use eit_fem::fabric::Simulation;
use eit_picture::{
    Canvas, FrameLabels, PictureSettings, Plot, Series, SkinDrawing, Track, TracksPanel, draw_plot,
    draw_sheet, draw_tracks, write_gif,
};
use eit_skin::Steps;
use eit_skin::text::counted;
use ndarray::{ArrayView2, Axis};

/// Time from a frame to its image and touches.
pub(super) const LATENCY: &str = "latency.png";
/// Both experiments on one page.
pub(super) const OVERVIEW: &str = "overview.png";
/// The images that are compared.
const ROWS: [&str; 3] = ["truth", "raw", "after the U-net"];
/// Number of frames in the picture of images, and per experiment in the overview.
const FRAMES: usize = 6;
const FRAMES_OF_OVERVIEW: usize = 3;
/// Maximum number of frames of a movie, and frames per second.
const MOVIE_FRAMES: usize = 140;
const MOVIE_RATE_HZ: f64 = 12.0;
/// Number of bars of the histogram.
const BARS: usize = 40;
/// Ends of the colour scale relative to the largest true change: raw images are weaker than the
/// truth.
const RANGE: f64 = 0.6;
/// Touches detected in fewer than this fraction of the frames are drawn together.
const BRIEF: f64 = 0.1;

/// An experiment with its live results and their evaluation.
pub(super) struct Shown {
    pub experiment: Experiment,
    pub truth: Simulation,
    pub live: LiveRun,
    pub accuracy: Accuracy,
    /// Frames per second.
    pub rate_hz: f64,
}

/// A picture as a file name and content.
pub(super) type File = (&'static str, Vec<u8>);

fn png(name: &'static str, canvas: &Canvas) -> Result<File, ReportError> {
    Ok((name, crate::output::png(canvas)?))
}

/// Draws movie and figures of an experiment.
pub(super) fn of_experiment(
    shown: &Shown,
    skin: &SkinDrawing,
    bar: &Steps<'_>,
) -> Result<Vec<File>, ReportError> {
    let Shown { experiment, live, .. } = shown;
    if live.frames.is_empty() {
        return Ok(Vec::new());
    }
    let [images, error, touches, position] = experiment.figures;
    let mut files = vec![
        (experiment.movie, movie(shown, skin, bar)?),
        png(images, &shown.images(skin)?)?,
        png(error, &shown.error()?)?,
        png(touches, &shown.tracks(skin)?)?,
    ];
    if !shown.accuracy.pairs.is_empty() {
        files.push(png(position, &shown.position_error()?)?);
    }
    Ok(files)
}

impl Shown {
    /// The three images of a frame: truth, reconstruction, and after the network.
    fn of_frame(&self, k: usize) -> [ArrayView2<'_, f64>; 3] {
        let images = &self.truth.truth.conductivity_change_s;
        let row = self.accuracy.errors[k].frame;
        [
            images.index_axis(Axis(0), row),
            self.live.raw.index_axis(Axis(0), k),
            self.live.made.index_axis(Axis(0), k),
        ]
    }

    /// Indices of `count` frames with touches, spread evenly over all of them.
    fn chosen(&self, count: usize) -> Vec<usize> {
        let errors = self.accuracy.errors.iter().enumerate();
        let touched: Vec<usize> = errors.filter(|(_, e)| e.is_touched).map(|(k, _)| k).collect();
        let place = |k: usize| (2 * k + 1) * touched.len() / (2 * count);
        (0..count).filter_map(|k| touched.get(place(k)).copied()).collect()
    }

    /// Label of a frame: its time.
    fn label(&self, k: usize) -> String {
        format!("{:.1} s", self.time_s(self.accuracy.errors[k].frame))
    }

    /// Ends of the colour scale: a fraction of the largest true change.
    fn range(&self) -> Option<[f64; 2]> {
        let images = &self.truth.truth.conductivity_change_s;
        let most = images.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
        let most = RANGE * most;
        (most > 0.0).then_some([-most, most])
    }

    /// Title of a picture of images.
    fn title(&self) -> String {
        format!("{}: truth, reconstruction, after the U-net", capitalised(self.experiment.name))
    }

    /// Draws the true, raw and denoised images below each other.
    fn images(&self, skin: &SkinDrawing) -> Result<Canvas, ReportError> {
        let settings = PictureSettings {
            title: self.title(),
            footnote: format!("simulated fabric · {}", self.live.summary.images.how),
            range: self.range(),
            ..Default::default()
        };
        sheet(&[(self, FRAMES)], skin, settings)
    }

    /// Time of a frame of the script, seconds.
    fn time_s(&self, frame: usize) -> f64 {
        frame as f64 / self.rate_hz
    }

    /// Draws the relative error of the images, before and after the network.
    fn error(&self) -> Result<Canvas, ReportError> {
        let curve = |name: &str, k: usize| {
            let touched = self.accuracy.errors.iter().filter(|error| error.is_touched);
            let points = touched.map(|e| [self.time_s(e.frame), 100.0 * e.relative()[k]]).collect();
            Series { name: name.to_owned(), points, line: true, markers: false }
        };
        let [raw, made] = self.accuracy.relative_errors().map(|error| 100.0 * error);
        let [raw_s2, made_s2, _] = self.accuracy.errors_of_touched();
        Ok(draw_plot(&Plot {
            title: format!("{}: relative error of the images", capitalised(self.experiment.name)),
            footnote: format!(
                "root mean square error over that of the true change of conductivity, frames with \
                 a finger; medians {raw:.0} % and {made:.0} % (mean squared errors {raw_s2:.1e} \
                 and {made_s2:.1e} S²)"
            ),
            series: vec![curve("raw", 0), curve("after the U-net", 1)],
            ..axes([("time (s)", false), ("relative error (%)", false)])
        })?)
    }

    /// Ids of the touches that last, and of the brief ones.
    fn ids(&self) -> (Vec<u64>, Vec<u64>) {
        let mut ids: Vec<u64> = self.live.touches.iter().flatten().map(|touch| touch.id).collect();
        ids.sort_unstable();
        ids.dedup();
        let frames = |id: u64| {
            let all = self.live.touches.iter().flatten();
            all.filter(|touch| touch.id == id && touch.valid).count()
        };
        ids.into_iter().partition(|id| frames(*id) as f64 >= BRIEF * self.live.frames.len() as f64)
    }

    /// Draws the distance of every touch from its finger, in the colours of the tracks.
    fn position_error(&self) -> Result<Canvas, ReportError> {
        let (lasting, brief) = self.ids();
        let of = |ids: &[u64], name: String| {
            let pairs = self.accuracy.pairs.iter().filter(|pair| ids.contains(&pair.touch));
            let points = pairs.map(|p| [self.time_s(p.frame), 1e3 * p.distance_m]).collect();
            Series { name, points, line: false, markers: true }
        };
        let mut series: Vec<Series> =
            lasting.iter().map(|id| of(&[*id], format!("touch {id}"))).collect();
        if !brief.is_empty() {
            series.push(of(&brief, counted(brief.len(), "brief touch", "brief touches")));
        }
        Ok(draw_plot(&Plot {
            title: format!(
                "{}: distance of touches from the finger",
                capitalised(self.experiment.name)
            ),
            footnote: format!(
                "median {:.1} mm, largest {:.1} mm; a fingertip is 20 mm wide, the skin 200 mm",
                1e3 * self.accuracy.distance_m(),
                1e3 * self.accuracy.worst_distance_m().unwrap_or(f64::NAN)
            ),
            series,
            ..axes([("time (s)", false), ("distance (mm)", false)])
        })?)
    }

    /// Draws the detected touches and the tracks of the fingers, each touch on a separate skin,
    /// because fingers on the same path would hide one another's dots.
    fn tracks(&self, skin: &SkinDrawing) -> Result<Canvas, ReportError> {
        let (lasting, brief) = self.ids();
        let panel = |first_color: usize, ids: &[u64], name: String| {
            let of = self.live.frames.iter().zip(&self.live.touches);
            let of = of.flat_map(|(frame, touches)| touches.iter().map(move |t| (*frame, t)));
            let of: Vec<_> = of.filter(|(_, t)| ids.contains(&t.id) && t.valid).collect();
            let label = match (of.first(), of.last()) {
                (Some((first, _)), Some((last, _))) => {
                    format!("{name}: {:.1} to {:.1} s", self.time_s(*first), self.time_s(*last))
                }
                _ => name,
            };
            let places_m = of.iter().map(|(_, t)| [t.position_m[0], t.position_m[1]]).collect();
            let mut tracks = ways(&self.truth);
            let name = "one dot per frame, pale at first".to_owned();
            tracks.push(Track { name, places_m, is_truth: false });
            TracksPanel { label, tracks, first_color }
        };
        let mut panels: Vec<TracksPanel> = lasting
            .iter()
            .enumerate()
            .map(|(k, id)| panel(k, &[*id], format!("touch {id}")))
            .collect();
        if !brief.is_empty() || panels.is_empty() {
            panels.push(panel(
                lasting.len(),
                &brief,
                counted(brief.len(), "brief touch", "brief touches"),
            ));
        }
        let Accuracy { fingers, found, false_touches, without_finger, .. } = self.accuracy;
        let settings = PictureSettings {
            title: format!("{}: tracked touches", capitalised(self.experiment.name)),
            footnote: format!(
                "found in {found} of {fingers} cases, median position error {:.1} mm; {false_touches} dots are false, \
                 {without_finger} of them with no finger on the skin",
                1e3 * self.accuracy.distance_m()
            ),
            ..Default::default()
        };
        Ok(draw_tracks(&panels, skin, &settings)?)
    }
}

/// A text with its first letter capitalised.
pub(super) fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

/// True track of each finger; the first one has the name.
fn ways(truth: &Simulation) -> Vec<Track> {
    let mut fingers: Vec<u32> = truth.truth.touches.iter().map(|touch| touch.finger).collect();
    fingers.sort_unstable();
    fingers.dedup();
    let way = |(k, finger): (usize, &u32)| {
        let of = truth.truth.touches.iter().filter(|touch| touch.finger == *finger);
        let name = match (k, fingers.len()) {
            (_, 1) => "the finger",
            (0, _) => "the fingers",
            _ => "",
        };
        let name = name.to_owned();
        Track { name, places_m: of.map(|touch| touch.position_m).collect(), is_truth: true }
    };
    fingers.iter().enumerate().map(way).collect()
}

/// Draws frames of several experiments side by side, with a row for each of the three images.
fn sheet(
    shown: &[(&Shown, usize)],
    skin: &SkinDrawing,
    settings: PictureSettings,
) -> Result<Canvas, ReportError> {
    let frames: Vec<(&Shown, usize)> = shown
        .iter()
        .flat_map(|(shown, count)| shown.chosen(*count).into_iter().map(move |k| (*shown, k)))
        .collect();
    let (mut images, mut labels) = (Vec::new(), Vec::new());
    for (row, name) in ROWS.iter().enumerate() {
        for (shown, k) in &frames {
            images.push(shown.of_frame(*k)[row]);
            labels.push(format!("{name}, {}", shown.label(*k)));
        }
    }
    let stacked = ndarray::stack(Axis(0), &images)?;
    let labels = FrameLabels::Text(labels);
    let settings = PictureSettings { labels, columns: Some(frames.len()), ..settings };
    Ok(draw_sheet(stacked.view(), skin, &settings)?)
}

/// Draws true, raw and denoised images side by side, frame by frame.
fn movie(shown: &Shown, skin: &SkinDrawing, bar: &Steps<'_>) -> Result<Vec<u8>, ReportError> {
    let count = shown.live.frames.len();
    let every = count.div_ceil(MOVIE_FRAMES).max(1);
    let (mut images, mut labels, mut marks_m) = (Vec::new(), Vec::new(), Vec::new());
    for k in (0..count).step_by(every) {
        images.extend(shown.of_frame(k));
        labels.extend([ROWS[0].to_owned(), shown.label(k), ROWS[2].to_owned()]);
        let touches = shown.live.touches[k].iter().filter(|touch| touch.valid);
        let marks = touches.map(|t| [t.position_m[0], t.position_m[1]]).collect();
        marks_m.extend([Vec::new(), Vec::new(), marks]);
    }
    let stacked = ndarray::stack(Axis(0), &images)?;
    let settings = PictureSettings {
        title: shown.title(),
        footnote: "crosses: touches".to_owned(),
        labels: FrameLabels::Text(labels),
        marks_m,
        range: shown.range(),
        columns: Some(ROWS.len()),
        ..Default::default()
    };
    let mut bytes = Vec::new();
    let mut tick = |done: usize, all: usize| {
        bar.set_length(all);
        bar.set_position(done);
    };
    write_gif(stacked.view(), skin, &settings, MOVIE_RATE_HZ, &mut bytes, &mut tick)?;
    Ok(bytes)
}

/// Draws the pictures that cover both experiments.
pub(super) fn of_both(shown: &[Shown], skin: &SkinDrawing) -> Result<Vec<File>, ReportError> {
    let mut files = Vec::new();
    if let Some(canvas) = latency(shown)? {
        files.push(png(LATENCY, &canvas)?);
    }
    let frames: Vec<(&Shown, usize)> = shown.iter().map(|s| (s, FRAMES_OF_OVERVIEW)).collect();
    let settings = PictureSettings {
        title: "One and two fingers on the simulated fabric".to_owned(),
        footnote: "live, through an emulated instrument".to_owned(),
        range: shown.first().and_then(Shown::range),
        zoom: 1,
        ..Default::default()
    };
    files.push(png(OVERVIEW, &sheet(&frames, skin, settings)?)?);
    Ok(files)
}

/// Draws the distribution of the time from the last byte of a frame to its image and touches.
fn latency(shown: &[Shown]) -> Result<Option<Canvas>, ReportError> {
    let all = || shown.iter().flat_map(|s| &s.live.summary.latencies_s).map(|s| 1e3 * s);
    let least_ms = all().fold(f64::INFINITY, f64::min).max(0.1);
    let most_ms = all().fold(least_ms, f64::max);
    if most_ms <= least_ms {
        return Ok(None);
    }
    let span = (most_ms / least_ms).ln();
    let edge_ms = |bar: usize| least_ms * (span * bar as f64 / BARS as f64).exp();
    let histogram = |shown: &Shown| {
        let mut counts = [0.0; BARS];
        for latency_s in &shown.live.summary.latencies_s {
            let part = (1e3 * latency_s / least_ms).max(1.0).ln() / span;
            counts[((BARS as f64 * part) as usize).min(BARS - 1)] += 1.0;
        }
        let mut points = vec![[least_ms, 0.0]];
        for (bar, count) in counts.into_iter().enumerate() {
            points.extend([[edge_ms(bar), count], [edge_ms(bar + 1), count]]);
        }
        points.push([most_ms, 0.0]);
        let name = shown.experiment.name.to_owned();
        Series { name, points, line: true, markers: false }
    };
    Ok(Some(draw_plot(&Plot {
        title: "From the last byte of a frame to its image and touches".to_owned(),
        footnote:
            "on this computer, under its normal load; includes frames that wait for the images of \
                   earlier ones"
                .to_owned(),
        series: shown.iter().map(histogram).collect(),
        ..axes([("time (ms)", true), ("frames", false)])
    })?))
}
