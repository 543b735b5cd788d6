//! The U-net frame by frame gives the images that it gives for a recording, and the one that sees detected touches is
//! nearer to the truth than the one of images alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "tests")]

use crate::common;
use crate::common::{Bench, Recording};
use eit_skin::denoise::{Check, LiveNet, Net, NetTarget, Verdict};
use eit_skin::eit_mesh::Raster;
use eit_skin::ndarray::{Array3, Axis};
use eit_skin::scene::DenoiseSettings;
use eit_skin::touches::{TouchFinder, Touches, touches};
use eit_skin::{FittedFrames, Progress, Touch, TouchState};
use std::path::Path;

/// A frame whose raw image is made constant.
const CONSTANT: usize = common::script::QUIET_FRAMES;

/// Weights of images alone, as a user's file.
fn of_images() -> String {
    let weights = "../eit-denoise/weights/paper-disc.safetensors";
    Path::new(env!("CARGO_MANIFEST_DIR")).join(weights).to_str().unwrap().to_owned()
}

fn load(weights: &str, fitted: &FittedFrames) -> Net {
    let settings = DenoiseSettings { weights: weights.to_owned(), any_skin: false };
    Net::load(&settings, &fitted.skin.skin.net_target()).unwrap()
}

/// Raw images [frame, row, column] by one-step Gauss-Newton.
fn raw_images(fitted: &FittedFrames) -> Array3<f64> {
    let mut silent = Progress::silent();
    let made = fitted.one_step(&mut silent).unwrap();
    made.images(&fitted.frames, &mut silent).unwrap().into_parts().0
}

/// One by one, with the touches of a finder that sees frame after frame.
fn live(net: &Net, fitted: &FittedFrames, raw: &Array3<f64>) -> (Array3<f64>, Vec<Verdict>) {
    let mut silent = Progress::silent();
    let raster = fitted.skin.raster(&mut silent).unwrap().clone();
    let mut net = LiveNet::new(net, fitted).unwrap();
    let mut finder =
        TouchFinder::new(fitted, common::script::RATE_HZ, &mut silent).unwrap().unwrap();
    let differences = fitted.differences_or_nan();
    let (mut made, mut verdicts) = (raw.clone(), Vec::new());
    let pixels = raster.masked_pixels().len();
    let (mut before, mut after) = (vec![0.0; pixels], vec![0.0; pixels]);
    for (frame, mut out) in made.outer_iter_mut().enumerate() {
        let values = fitted.frames.values.row(frame).to_vec();
        let time_s = frame as f64 / common::script::RATE_HZ;
        let good = fitted.frames.good.row(frame);
        let found = finder.push(&values, |i| good[i], time_s).unwrap().to_vec();
        let explained = finder.step().unwrap().is_explained;
        raster.pixels_from_image_into(raw.index_axis(Axis(0), frame), &mut before).unwrap();
        let row = differences.row(frame).to_vec();
        let verdict = net.push(&raster, &before, &row, &found, explained, &mut after).unwrap();
        raster.image_from_pixels_into(&after, out.view_mut()).unwrap();
        verdicts.push(verdict);
    }
    (made, verdicts)
}

/// The same bits and verdicts one by one as all at once, for both shipped nets; frames turned about their reference, in
/// which touches lower the conductivity, are left as they are.
#[test]
fn one_by_one_as_all_at_once() {
    let mut drawn = common::script::Drawn::new(31, 1);
    let script = drawn.press(0.6..2.0).press(0.6..2.0).press(0.6..2.0).script();
    let recording = Recording::simulate(&script, 31);
    let quiet = recording.values.slice_axis(Axis(0), (..common::script::QUIET_FRAMES).into());
    let quiet = quiet.mean_axis(Axis(0)).unwrap();
    let turned = Recording { values: 2.0 * &quiet - &recording.values, truth: Vec::new() };
    for weights in ["default".to_owned(), of_images()] {
        for (recording, is_foreign) in [(&recording, false), (&turned, true)] {
            let fitted = recording.fitted();
            let (net, mut raw) = (load(&weights, &fitted), raw_images(&fitted));
            // total variation may make an image of one value, of which the net of images makes no other
            raw.index_axis_mut(Axis(0), CONSTANT)
                .mapv_inplace(|v| if v.is_nan() { v } else { 1e-7 });
            let mut silent = Progress::silent();
            let raster = fitted.skin.raster(&mut silent).unwrap();
            let found = touches(&fitted, &mut silent).unwrap().unwrap();
            let mut whole = raw.clone();
            // with touches found before, and without
            for check in [Check::new(&fitted), Check::new(&fitted).with_touches(&found)] {
                whole = raw.clone();
                let checked = net.apply(&mut whole, raster, Some(&check), &mut silent).unwrap();
                let (made, verdicts) = live(&net, &fitted, &raw);
                let of_whole = checked.unwrap().judgements;
                let of_whole: Vec<Verdict> = of_whole.iter().map(|judged| judged.verdict).collect();
                assert_eq!(verdicts, of_whole, "{weights}, foreign: {is_foreign}");
                // the net of touches draws these, whatever the raw image is
                assert!(weights == "default" || verdicts[CONSTANT] != Verdict::Net);
                let same = made.iter().zip(&whole).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
                assert!(same, "{weights}, foreign: {is_foreign}");
                if weights == "default" {
                    nothing_far_from_touches(&whole, &verdicts, raster, &found);
                }
            }
            let touched = || recording_frames(&script);
            let kept = touched().filter(|f| {
                let of = |images: &Array3<f64>| images.index_axis(Axis(0), *f).to_owned();
                let (a, b) = (of(&whole), of(&raw));
                a.iter().zip(&b).all(|(a, b)| a == b || a.is_nan() && b.is_nan())
            });
            let (kept, all) = (kept.count(), touched().count());
            println!("{weights}, foreign {is_foreign}: raw in {kept} of {all} touched frames");
            // a frame or two while a finger comes; a foreign one while it hardly presses
            assert!(if is_foreign { 10 * kept >= 9 * all } else { 20 * kept <= all });
        }
    }
}

/// Without noise no touches can be sought, and "default" has only the net of images alone: on its own skin it is used,
/// on another one the raw images stay, one by one too.
#[test]
fn without_touches_another_skin_keeps_its_raw_images() {
    let script = common::script::Drawn::new(32, 1).press(0.6..2.0).script();
    let mut fitted = Recording::simulate(&script, 32).fitted();
    fitted.frames.quiet = None;
    let raw = raw_images(&fitted);
    let raster = fitted.skin.raster(&mut Progress::silent()).unwrap();
    let settings = DenoiseSettings { weights: "default".to_owned(), any_skin: true };
    let own = fitted.skin.skin.net_target();
    let touched = recording_frames(&script).next().unwrap();
    for (fingerprint, stays) in [("another", true), (own.fingerprint, false)] {
        let net = Net::load(&settings, &NetTarget { fingerprint, ..own }).unwrap();
        let mut images = raw.clone();
        let check = Check::new(&fitted);
        let checked = net.apply(&mut images, raster, Some(&check), &mut Progress::silent());
        let words = checked.unwrap().unwrap().description();
        let is_same = images.iter().zip(&raw).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
        assert_eq!((is_same, words.starts_with("the raw images stay")), (stays, stays), "{words}");
        let mut live = LiveNet::new(&net, &fitted).unwrap();
        let mut before = vec![0.0; raster.masked_pixels().len()];
        let mut after = before.clone();
        raster.pixels_from_image_into(raw.index_axis(Axis(0), touched), &mut before).unwrap();
        let row = fitted.differences_or_nan().row(touched).to_vec();
        let verdict = live.push(raster, &before, &row, &[], true, &mut after).unwrap();
        assert_eq!((verdict != Verdict::Net, after == before), (stays, stays));
    }
}

/// On another skin the net that sees touches is shown where these explain the frame: what its images leave of the data
/// depends on how much electrodes move there. Frames turned about their reference, and those of a wrong order of the
/// electrodes, stay raw.
#[test]
fn another_skin_shows_what_touches_explain() {
    let bench = Bench::of("patches");
    let mut drawn = common::script::Drawn::new(34, 1);
    let script = [[0.03, 0.02], [-0.04, 0.03], [0.02, -0.05]]
        .iter()
        .fold(&mut drawn, |drawn, place| drawn.press_at(&[*place], 0.7..2.0))
        .script();
    let recording = bench.simulate(&script, 34);
    let quiet = recording.values.slice_axis(Axis(0), (..common::script::QUIET_FRAMES).into());
    let quiet = quiet.mean_axis(Axis(0)).unwrap();
    let turned = Recording { values: 2.0 * &quiet - &recording.values, truth: Vec::new() };
    let settings = DenoiseSettings { weights: "default".to_owned(), any_skin: true };
    for (recording, is_foreign) in [(&recording, false), (&turned, true)] {
        let fitted = bench.fit(recording);
        let raw = raw_images(&fitted);
        let raster = fitted.skin.raster(&mut Progress::silent()).unwrap();
        let net = Net::load(&settings, &fitted.skin.skin.net_target()).unwrap();
        let mut images = raw.clone();
        let check = Check::new(&fitted);
        let checked = net.apply(&mut images, raster, Some(&check), &mut Progress::silent());
        let checked = checked.unwrap().unwrap();
        let (made, verdicts) = live(&net, &fitted, &raw);
        let of_whole: Vec<Verdict> = checked.judgements.iter().map(|j| j.verdict).collect();
        assert_eq!(verdicts, of_whole, "foreign: {is_foreign}");
        let same = made.iter().zip(&images).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
        assert!(same, "foreign: {is_foreign}");
        let touched = recording_frames(&script).collect::<Vec<_>>();
        let shown = touched.iter().filter(|f| verdicts[**f] == Verdict::Net).count();
        println!(
            "foreign {is_foreign}: {shown} of {} frames; {}",
            touched.len(),
            checked.description()
        );
        assert!(if is_foreign {
            10 * shown <= touched.len()
        } else {
            20 * shown >= 19 * touched.len()
        });
    }
}

/// The net that sees touches shows at most 5 % of its largest value farther than 11 pixels from each of them.
fn nothing_far_from_touches(
    images: &Array3<f64>,
    verdicts: &[Verdict],
    raster: &Raster,
    found: &Touches,
) {
    let far_m = 11.0 * raster.pixel_m();
    for ((image, touches), verdict) in images.outer_iter().zip(found.by_frame()).zip(verdicts) {
        let largest = image.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let is_net = *verdict == Verdict::Net;
        for ((row, column), value) in image.indexed_iter().filter(|_| is_net) {
            let [x, y] = raster.centre_m(row, column);
            let off = |touch: &Touch| (x - touch.position_m[0]).hypot(y - touch.position_m[1]);
            let mut present = touches.iter().filter(|touch| touch.state != TouchState::End);
            let is_far = present.all(|touch| off(touch) > far_m);
            // rounding of the product
            let is_small = value.abs() <= 0.05 * largest * (1.0 + 1e-12);
            assert!(!is_far || value.is_nan() || is_small, "{row} {column} {value} {largest}");
        }
    }
}

/// Frames in which a finger presses with at least 0.5 N.
fn recording_frames(
    script: &eit_skin::eit_fem::fabric::TouchScript,
) -> impl Iterator<Item = usize> + '_ {
    (0..script.frames).filter(|f| script.touches(*f).iter().any(|touch| touch.force_n >= 0.5))
}
