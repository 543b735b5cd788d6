//! What `eit plan` promises of a scene beside what was measured.

use super::super::bench::{Bench, Entrant, Entry, Sequence as Images};
use super::super::scores::{Scores, Truth};
use super::Recording;
use super::floor::Floors;
use crate::error::ReportError;
use eit_inverse::DifferenceFrames;
use eit_skin::method::{self, Method};
use eit_skin::plan::expected::Expected;
use eit_skin::plan::sequence::Sequence;
use eit_skin::plan::stages;
use eit_skin::scene::{DenoiseSettings, Rule};
use eit_skin::{Progress, Skin, total_variation as tv};
use ndarray::Array2;
use std::time::Instant;

/// Timings of each stage, of which the median counts.
const REPEATS: usize = 3;

/// A scene's plan and the truth.
#[derive(Debug, Clone)]
pub(super) struct Promise {
    pub method: Method,
    /// Stage, seconds that the plan expects, seconds that were measured: means over the recordings.
    pub stages: Vec<(&'static str, f64, f64)>,
    /// Relative error that the plan expects, where it knows one, and that of this run: root mean
    /// square over the recordings.
    pub error: (Option<f64>, f64),
}

/// Runs the scene as its user would, with its own method and with one-step images, on recordings
/// that the table of the plan has not seen, and compares.
///
/// The scene of a fabric has `[denoise]`, as that of `eit demo`: its noise alone is not telling.
pub(super) fn of(
    (bench, is_fabric): (&Bench, bool),
    recordings: &[Recording],
    floors: &Floors,
) -> Result<Vec<Promise>, ReportError> {
    let Some(first) = recordings.first() else { return Ok(Vec::new()) };
    let mut skin = bench.skin().clone();
    skin.settings.noise.additive_v = Some(first.simulated.noise_std_v);
    if is_fabric {
        let weights = "default".to_owned();
        skin.settings.denoise = Some(DenoiseSettings { weights, any_skin: false });
    }
    let own = method::choose(&skin.settings, None, Some(first.truth.nrows()))?.method;
    let methods = [own, Method::GaussNewton];
    methods.into_iter().map(|method| one(&skin, bench, (method, recordings), floors)).collect()
}

fn one(
    skin: &Skin,
    bench: &Bench,
    (method, recordings): (Method, &[Recording]),
    floors: &Floors,
) -> Result<Promise, ReportError> {
    let measured: Vec<Measured> = recordings
        .iter()
        .map(|recording| measure(skin, bench, (method, recording)))
        .collect::<Result<_, _>>()?;
    let frames = recordings.first().map_or(0, |recording| recording.truth.nrows());
    let (voltages, machine) = (bench.linearised.voltages.to_vec(), &floors.machine);
    let expected = Expected::of(skin, method, Some(frames), &voltages, machine)?;
    let row = expected.row.as_ref();
    let planned = stages::of(skin, method, Sequence::Frames(frames), machine, row);
    let count = measured.len() as f64;
    let both = planned.iter().filter_map(|stage| {
        let of = |m: &Measured| m.times.iter().find(|(name, _)| *name == stage.name).map(|t| t.1);
        let found: Option<f64> = measured.iter().map(of).sum();
        found.map(|seconds| (stage.name, stage.time_s, seconds / count))
    });
    let squares: f64 = measured.iter().map(|m| m.error * m.error).sum();
    let error = (expected.error(), (squares / count).sqrt());
    Ok(Promise { method, stages: both.collect(), error })
}

/// Seconds of each stage, and the error of the images.
struct Measured {
    times: Vec<(&'static str, f64)>,
    error: f64,
}

/// Median seconds of some runs, and what the last one made.
fn median_s<T>(mut run: impl FnMut() -> Result<T, ReportError>) -> Result<(T, f64), ReportError> {
    let (mut seconds, mut made) = (Vec::new(), None);
    for _ in 0..REPEATS {
        let start = Instant::now();
        made = Some(run()?);
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    let made = made.ok_or_else(|| ReportError::Failure("no run".to_owned()))?;
    Ok((made, seconds[REPEATS / 2]))
}

fn measure(
    skin: &Skin,
    bench: &Bench,
    (method, recording): (Method, &Recording),
) -> Result<Measured, ReportError> {
    let (_, mesh_s) = median_s(|| Ok(skin.source.build()?))?;
    let background = skin.background_s();
    let mut workspace = skin.model.workspace()?;
    let (_, forward_s) = median_s(|| {
        let solution = skin.model.solve(&background, &mut workspace)?;
        Ok(solution.measurements())
    })?;
    let (_, both_s) = median_s(|| {
        let mut solution = skin.model.solve(&background, &mut workspace)?;
        Ok((solution.measurements(), solution.jacobian()))
    })?;
    let mut times =
        vec![("mesh", mesh_s), ("forward", forward_s), ("Jacobian", both_s - forward_s)];
    let movie = match method.is_tv() {
        true => total_variation(bench, (method, recording), &mut times)?,
        false => one_step(skin, bench, recording, &mut times)?,
    };
    let positions_m = &recording.simulated.positions_m;
    let truth = Truth { pixels: &recording.truth, positions_m };
    let error = Scores::new(bench, movie.view(), &truth)?.relative_error;
    Ok(Measured { times, error })
}

type Times = Vec<(&'static str, f64)>;

fn total_variation(
    bench: &Bench,
    (method, recording): (Method, &Recording),
    times: &mut Times,
) -> Result<Array2<f64>, ReportError> {
    let keys = &bench.skin().settings.reconstruction;
    let entrant = Entrant { method, lower_s: keys.lower_s };
    let simulated = &recording.simulated;
    let settings = entrant.settings(bench, Rule::NoiseFigure);
    let fitted = bench.fitted(&simulated.frames, simulated.noise_std_v, settings);
    let build = || Entry::new(bench, &fitted, method);
    let (mut set_up, mut choice) = (Vec::new(), Vec::new());
    let mut entry = build()?;
    for k in 0..REPEATS {
        if k > 0 {
            entry = build()?;
        }
        set_up.push(entry.set_up_s);
        choice.push(entry.choice_s);
    }
    let values = fitted.differences();
    let differences = DifferenceFrames::all_good(values.view());
    let stop = tv::stop(keys);
    let (Images { pixels: movie, report }, solve_s) = median_s(|| entry.run(&differences, &stop))?;
    let middle = |mut seconds: Vec<f64>| {
        seconds.sort_by(f64::total_cmp);
        seconds[seconds.len() / 2]
    };
    times.extend([
        ("Jacobian of pixels", middle(set_up)),
        ("weights", middle(choice)),
        ("iteration", solve_s / report.iterations.max(1) as f64),
        ("solve", solve_s),
    ]);
    Ok(movie)
}

fn one_step(
    skin: &Skin,
    bench: &Bench,
    recording: &Recording,
    times: &mut Times,
) -> Result<Array2<f64>, ReportError> {
    let frames = &recording.simulated.frames;
    // the noise that the plan was told: the first recording's
    let noise_std_v = skin.settings.noise.additive_v.unwrap_or(recording.simulated.noise_std_v);
    let fitted = bench.fitted(frames, noise_std_v, skin.settings.reconstruction.clone());
    let (imaging, matrix_s) = median_s(|| Ok(fitted.one_step(&mut Progress::silent())?))?;
    let reconstructor = imaging.difference.on_raster(bench.raster.pixel_from_element())?;
    let mut memory = reconstructor.workspace();
    let mut movie = Array2::zeros((frames.values.nrows(), reconstructor.image_len()));
    let mut image = vec![0.0; reconstructor.image_len()];
    let (_, all_s) = median_s(|| {
        for (frame, mut row) in frames.values.rows().into_iter().zip(movie.rows_mut()) {
            let reference = &frames.reference;
            reconstructor.reconstruct_into(&frame.to_vec(), reference, &mut memory, &mut image)?;
            row.iter_mut().zip(&image).for_each(|(out, value)| *out = *value);
        }
        Ok(())
    })?;
    times.extend([
        ("reconstruction matrix", matrix_s),
        ("each frame", all_s / frames.values.nrows() as f64),
    ]);
    Ok(movie)
}
