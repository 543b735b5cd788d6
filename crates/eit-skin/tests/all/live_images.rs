//! Images of a live stream that are only made while they are needed.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

use crate::common::source::Listed;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::eit_hw::driver::Event;
use eit_skin::eit_hw::{Frame, Quality, Unit};
use eit_skin::live::{LiveModel, LiveObserver, Summary, TouchFrame};
use eit_skin::scene::Scene;
use eit_skin::{LiveStream, MeshOverride, Progress, Skin, SkinError};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const REFERENCE: usize = 20;
/// A finger stays for this number of frames after the reference, then the skin is untouched.
const TOUCHED: usize = 4;
const ALL: usize = 12;

fn model() -> Arc<LiveModel> {
    let mut progress = Progress::silent();
    let mut scene = Scene::load("paper-disc").unwrap();
    scene.reconstruction.method = Some("st-tv".to_owned());
    // so few that an image reaches its gap before its time is over
    scene.reconstruction.pixels = Some(32);
    let mesh = MeshOverride { nodes: Some(1200), ..Default::default() };
    let skin = Skin::set_up(&scene, &mesh, &mut progress).unwrap();
    Arc::new(LiveModel::new(&skin, REFERENCE, &mut progress).unwrap())
}

/// Noise of a ten-thousandth, and the response of an element in the middle while it is touched; one frame each
/// `step_s` seconds.
fn frames(model: &LiveModel, step_s: f64) -> Vec<Frame> {
    let linearised = &model.linearised;
    let centroids = linearised.skin.mesh.surface().centroids();
    let nearest = |k: &usize| centroids[*k][0].hypot(centroids[*k][1]);
    let middle = (0..centroids.len()).min_by(|a, b| nearest(a).total_cmp(&nearest(b))).unwrap();
    let response = linearised.jacobian.column(middle);
    let size = |v: &f64| v.abs();
    let voltage = linearised.voltages.iter().map(size).fold(0.0, f64::max);
    let touch = 0.02 * voltage / response.iter().map(size).fold(0.0, f64::max);
    let mut random = Random::named(1, "noise", 0);
    let frame = |sequence: usize| {
        let is_touched = (REFERENCE..REFERENCE + TOUCHED).contains(&sequence);
        let values = linearised.voltages.iter().zip(response).map(|(v, r)| {
            v + if is_touched { touch * r } else { 0.0 } + 1e-4 * voltage * random.normal()
        });
        let values: Vec<f64> = values.collect();
        Frame {
            quality: vec![Quality::GOOD; values.len()],
            values,
            imaginary: None,
            sequence: sequence as u64,
            epoch: 0,
            device_time_s: Some(step_s * sequence as f64),
            host_time_s: None,
        }
    };
    (0..REFERENCE + ALL).map(frame).collect()
}

/// The last image, if images are only made of these frames after the reference.
fn last_image(
    model: &Arc<LiveModel>,
    frames: &[Frame],
    is_made: impl Fn(usize) -> bool,
) -> Vec<f64> {
    let mut stream = LiveStream::of_unit(Arc::clone(model), Unit::Volt, Some(20.0));
    for (k, frame) in frames.iter().enumerate() {
        stream.push(frame, false).unwrap();
        let wanted = k >= REFERENCE && is_made(k - REFERENCE);
        if wanted {
            stream.make_image().unwrap();
        }
        if let Some(shown) = stream.shown() {
            assert_eq!(shown.images.is_some(), wanted, "frame {k}");
        }
    }
    stream.shown().unwrap().images.unwrap().pixels().to_vec()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// An image after frames without one shows nothing of a touch that ended meanwhile, whether it is coupled to the
/// last image (short gap) or not (more than half a second): it differs from a first image by less than a
/// hundredth of the touch. That is the gap to which images are solved; measured 0.002.
#[test]
fn an_image_after_a_gap_shows_nothing_of_an_old_touch() {
    let model = model();
    let last = TOUCHED + 2;
    for step_s in [0.05, 0.2] {
        let frames = frames(&model, step_s);
        let frames = &frames[..=REFERENCE + last];
        let first = last_image(&model, frames, |k| k == last);
        let after_gap = last_image(&model, frames, |k| k < TOUCHED || k == last);
        let touched = last_image(&model, &frames[..REFERENCE + TOUCHED], |_| true);
        let [gap, touch] = [&after_gap, &touched].map(|image| distance(image, &first));
        println!("a frame each {step_s} s: {gap:e} after a gap, {touch:e} of the touch");
        assert!(gap < 0.01 * touch, "{gap:e} {touch:e}");
    }
}

/// Users of a live stream are told when the voltages are not those of the scene.
#[test]
fn a_reference_of_another_level_is_reported() {
    let model = model();
    for (factor, is_reported) in [(1.0, false), (3.0, true)] {
        let mut stream = LiveStream::of_unit(Arc::clone(&model), Unit::Volt, Some(20.0));
        for mut frame in frames(&model, 0.05).into_iter().take(REFERENCE) {
            assert!(stream.notes().is_empty(), "{:?}", stream.notes());
            frame.values.iter_mut().for_each(|v| *v *= factor);
            stream.push(&frame, false).unwrap();
        }
        let notes = stream.notes();
        let tells = notes.iter().any(|note| note.starts_with("voltages are 3.0"));
        assert_eq!(tells, is_reported, "{notes:?}");
        let names = |words: &str| notes.iter().any(|note| note.contains(words));
        assert_eq!(
            names("strengths (intensity)") && names("1e-3 for millivolts"),
            is_reported,
            "{notes:?}"
        );
    }
}

/// Numbers of the frames whose touches were given, and of those that had an image.
#[derive(Default)]
struct FrameNumbers {
    wants_every_image: bool,
    is_ready: Arc<AtomicBool>,
    touches: Vec<u64>,
    images: Vec<u64>,
}

impl LiveObserver for FrameNumbers {
    type Error = SkinError;

    fn reference(&mut self, _: &[Frame], _: &[String], _: Option<u64>) -> Result<(), SkinError> {
        self.is_ready.store(true, Ordering::Relaxed);
        Ok(())
    }

    fn touches(&mut self, frame: &TouchFrame<'_>) -> Result<(), SkinError> {
        self.touches.push(frame.number);
        Ok(())
    }

    fn frame(&mut self, frame: &TouchFrame<'_>) -> Result<(), SkinError> {
        if frame.images.is_some() {
            self.images.push(frame.number);
        }
        Ok(())
    }

    fn wants_every_image(&self) -> bool {
        self.wants_every_image
    }

    fn goes_on(&mut self, _: &Summary) -> bool {
        true
    }
}

/// While live frames wait, touches of all of them are given and images are skipped and counted. Nobody's image is
/// skipped who needs every one, nor in a replay.
#[test]
fn images_are_skipped_while_frames_wait_and_touches_never() {
    let model = model();
    let all: Vec<u64> = (0..ALL as u64).collect();
    for (is_live, wants_every_image) in [(true, false), (true, true), (false, false)] {
        let mut frames = frames(&model, 0.05);
        // they arrived in their time, also where they waited
        for (k, frame) in frames.iter_mut().enumerate() {
            frame.host_time_s = Some(1.8e9 + 0.05 * k as f64);
        }
        let mut seen = FrameNumbers { wants_every_image, ..FrameNumbers::default() };
        let source = Listed::new(frames.into_iter().map(Event::Frame));
        let mut source = source.held_at(REFERENCE as u64 - 1, &seen.is_ready);
        let summary = model.watch(&mut source, is_live, &mut seen).unwrap();
        assert_eq!(seen.touches, all);
        let rate_hz = summary.frame_rate_hz().unwrap();
        // a time in f64 is known to 2e-7 s; a replay has its own pace
        assert_eq!((rate_hz - 20.0).abs() < 1e-3, is_live, "{rate_hz}");
        let skipped = summary.images.skipped as usize;
        assert_eq!(seen.images.len() + skipped, ALL);
        // the last frame has none behind it
        assert_eq!(seen.images.last(), all.last());
        println!("live: {is_live}, every image: {wants_every_image}: {skipped} skipped");
        assert_eq!(skipped > 0, is_live && !wants_every_image);
    }
}
