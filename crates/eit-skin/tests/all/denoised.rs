//! The U-net frame by frame gives the images that it gives for a recording, and shows no image that the data contradict.

use crate::common::*;
use eit_skin::denoise::{Check, LiveNet, Net, NetTarget, Verdict};
use eit_skin::eit_mesh::Raster;
use eit_skin::ndarray::{Array3, Axis};
use eit_skin::scene::DenoiseSettings;
use eit_skin::touches::{TouchFinder, Touches};
use eit_skin::{FittedFrames, Progress, Touch, TouchState};
use std::path::Path;

/// A frame whose raw image is made constant.
const CONSTANT: usize = QUIET_FRAMES;

/// Raw images [frame, row, column] by one-step Gauss-Newton.
fn raw_images(fitted: &FittedFrames) -> Array3<f64> {
    let mut silent = Progress::silent();
    let made = fitted.one_step(&mut silent).unwrap();
    made.images(&fitted.frames, &mut silent).unwrap().into_parts().0
}

fn same<'a>(a: impl IntoIterator<Item = &'a f64>, b: impl IntoIterator<Item = &'a f64>) -> bool {
    a.into_iter().zip(b).all(|(a, b)| a == b || a.is_nan() && b.is_nan())
}

/// One by one, with the touches of a finder that sees frame after frame.
fn live(net: &Net, fitted: &FittedFrames, raw: &Array3<f64>) -> (Array3<f64>, Vec<Verdict>) {
    let mut silent = Progress::silent();
    let raster = fitted.skin.raster(&mut silent).unwrap();
    let mut net = LiveNet::new(net, fitted).unwrap();
    let mut finder = TouchFinder::new(fitted, RATE_HZ, &mut silent).unwrap().unwrap();
    let differences = fitted.differences_or_nan();
    let (mut made, mut verdicts) = (raw.clone(), Vec::new());
    let mut before = vec![0.0; raster.masked_pixels().len()];
    let mut after = before.clone();
    for (frame, mut out) in made.outer_iter_mut().enumerate() {
        let values = fitted.frames.values.row(frame).to_vec();
        let good = fitted.frames.good.row(frame);
        let found = finder.push(&values, |i| good[i], frame as f64 / RATE_HZ).unwrap().to_vec();
        let explained = finder.step().unwrap().is_explained;
        raster.pixels_from_image_into(raw.index_axis(Axis(0), frame), &mut before).unwrap();
        let row = differences.row(frame).to_vec();
        let verdict = net.push(raster, &before, &row, &found, explained, &mut after).unwrap();
        raster.image_from_pixels_into(&after, out.view_mut()).unwrap();
        verdicts.push(verdict);
    }
    (made, verdicts)
}

/// Frames in which a finger presses with at least 0.5 N.
fn touched(recording: &Recording) -> Vec<usize> {
    recording.truth.iter().filter(|t| t.force_n >= 0.5).map(|t| t.frame).collect()
}

/// The same bits and verdicts one by one as all at once, with touches found before and without. All but one in twenty of
/// touched frames show the net (while a finger comes); nine in ten of those turned about their reference stay as they are.
fn check(bench: &Bench, recording: &Recording, all_weights: &[&str], any_skin: bool) {
    let (turned, touched) = (recording.turned(), touched(recording));
    for (recording, is_foreign) in [(recording, false), (&turned, true)] {
        let (fitted, mut silent) = (bench.fit(recording), Progress::silent());
        let (found, mut raw) = ((!any_skin).then(|| touches_of(&fitted)), raw_images(&fitted));
        let raster = fitted.skin.raster(&mut silent).unwrap();
        // total variation may make an image of one value, of which the net of images makes no other
        raw.index_axis_mut(Axis(0), CONSTANT).mapv_inplace(|v| if v.is_nan() { v } else { 1e-7 });
        for &weights in all_weights {
            let name = format!("{weights}, foreign: {is_foreign}");
            let settings = DenoiseSettings { weights: weights.to_owned(), any_skin };
            let net = Net::load(&settings, &fitted.skin.skin.net_target()).unwrap();
            let (made, verdicts) = live(&net, &fitted, &raw);
            let with = found.iter().map(|found| Check::new(&fitted).with_touches(found));
            let without = (any_skin || !is_foreign).then(|| Check::new(&fitted));
            for check in with.chain(without) {
                let mut whole = raw.clone();
                let checked = net.apply(&mut whole, raster, Some(&check), &mut silent).unwrap();
                let of_whole: Vec<Verdict> =
                    checked.unwrap().judgements.iter().map(|judged| judged.verdict).collect();
                assert_eq!(verdicts, of_whole, "{name}");
                assert!(same(&made, &whole), "{name}");
            }
            if let (Some(found), "default") = (&found, weights) {
                nothing_far_from_touches(&made, &verdicts, raster, found);
            }
            // the net of touches draws these, whatever the raw image is
            assert!(weights == "default" || verdicts[CONSTANT] != Verdict::Net);
            let of = |images: &Array3<f64>, f: usize| images.index_axis(Axis(0), f).to_owned();
            let kept = touched.iter().filter(|f| same(&of(&made, **f), &of(&raw, **f))).count();
            let all = touched.len();
            println!("{name}: raw in {kept} of {all} touched frames");
            assert!(if is_foreign { 10 * kept >= 9 * all } else { 20 * kept <= all }, "{name}");
        }
    }
}

/// Both shipped nets: that of touches, and that of images alone, as a user's file.
#[test]
fn one_by_one_as_all_at_once() {
    let weights = "../eit-denoise/weights/paper-disc.safetensors";
    let of_images = Path::new(env!("CARGO_MANIFEST_DIR")).join(weights);

    let [recording] = PAPER.draw([31], 1, |drawn, _| drawn.presses(3, 0.6..2.0));
    check(&PAPER, &recording, &["default", of_images.to_str().unwrap()], false);
}

/// What images of the net leave of the data depends on how much electrodes move: shown is what touches explain.
#[test]
fn another_skin_shows_what_touches_explain() {
    let bench = Bench::of("patches");
    let places = [[0.03, 0.02], [-0.04, 0.03], [0.02, -0.05]];
    let [recording] = bench.draw([34], 1, |drawn, _| {
        places.iter().for_each(|place| _ = drawn.press_at(&[*place], 0.7..2.0));
    });
    check(&bench, &recording, &["default"], true);
}

/// Without noise no touches can be sought, and "default" is the net of images alone, which is used on its own skin only.
#[test]
fn without_touches_another_skin_keeps_its_raw_images() {
    let [recording] = PAPER.draw([32], 1, |drawn, _| drawn.presses(1, 0.6..2.0));
    let mut fitted = PAPER.fit(&recording);
    fitted.frames.quiet = None;
    let raw = raw_images(&fitted);
    let raster = fitted.skin.raster(&mut Progress::silent()).unwrap();
    let settings = DenoiseSettings { weights: "default".to_owned(), any_skin: true };
    let own = fitted.skin.skin.net_target();
    let touched = touched(&recording)[0];
    for (fingerprint, stays) in [("another", true), (own.fingerprint, false)] {
        let net = Net::load(&settings, &NetTarget { fingerprint, ..own }).unwrap();
        let mut images = raw.clone();
        let check = Check::new(&fitted);
        let checked = net.apply(&mut images, raster, Some(&check), &mut Progress::silent());
        let words = checked.unwrap().unwrap().description();
        let is_same = same(&images, &raw);
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
