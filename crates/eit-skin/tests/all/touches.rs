//! Touches on the simulated fabric, with default settings. Full figures: `docs/validation/touches.md`.

use crate::common::*;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::faults::FaultKind;
use eit_skin::ndarray::Axis;
use eit_skin::touches::Touches;
use eit_skin::{FittedFrames, Progress, Touch, TouchState};
use std::f64::consts::TAU;
use std::sync::LazyLock;

const PRESS_N: std::ops::Range<f64> = 0.7..2.0;

/// Electrode that breaks, from 0, ...
const BROKEN: usize = 5;
/// ... and the frame from which it is broken: 3 s after the quiet ones.
const BROKEN_FROM: usize = 100;

/// One finger that presses six times, starting half a second after the electrode breaks.
static PRESSES: LazyLock<[Recording; 3]> = LazyLock::new(|| {
    PAPER.draw(SEEDS, 1, |drawn, _| {
        drawn.next_s += 3.5;
        drawn.presses(6, PRESS_N);
    })
});

/// The first presses of one of these recordings.
fn pressed(recording: usize, presses: usize) -> Recording {
    let Recording { values, truth } = &PRESSES[recording];
    let frames = ((5.6 + 1.6 * presses as f64) * RATE_HZ) as usize;
    let values = values.slice_axis(Axis(0), (..frames).into()).to_owned();
    Recording { values, truth: truth.clone() }
}

/// Frames of a recording in which a finger presses firmly.
fn held(recording: &Recording) -> Vec<usize> {
    let frames = recording.truth.iter().filter(|touch| touch.force_n > 0.7).map(|t| t.frame);
    frames.filter(|frame| *frame < recording.values.nrows()).collect()
}

/// Draws and simulates a script with each of three seeds, and scores all of them together.
fn check(name: &str, fingers: u32, bars: &Bars, draw: impl Fn(&mut Drawn, u64)) {
    PAPER.score(&PAPER.draw(SEEDS, fingers, draw)).check(name, bars);
}

/// Three times 15 s without a finger show nothing, and the presses after them are found.
#[test]
fn quiet() {
    let recordings = PAPER.draw([SEEDS[0]], 1, |drawn, _| {
        for _ in 0..3 {
            drawn.next_s += 15.0;
            drawn.press(PRESS_N);
        }
    });
    PAPER.score(&recordings).check("quiet", &ONE);
}

#[test]
fn one() {
    PAPER.score(PRESSES.as_slice()).check("one", &ONE);
}

/// Four fingers, at least 40 mm apart.
#[test]
fn four() {
    let bars = Bars { found: 0.95, ..ONE };
    check("four", 4, &bars, |drawn, _| drawn.presses(3, PRESS_N));
}

/// Of such a frame one touch alone explains nothing, and what fingers do to each other looks like one in the middle.
#[test]
fn hexagon() {
    PAPER.score(HEXAGONS.as_slice()).check("hexagon", &Bars { found: 0.99, extra: 0.01, ..ONE });
}

/// Two fingers close in to 26 mm and part again; one bell between them fits nearly as well there.
#[test]
fn closing_in() {
    check("closing in", 2, &Bars { error_m: 12e-3, ..ONE }, |drawn, seed| {
        drawn.close_in(seed as f64, 1.0, 0.11, 0.026).close_in(seed as f64 + 1.5, 1.0, 0.09, 0.026);
    });
}

/// Friction drags fabric and electrodes along. One stroke of the nine may change its id.
#[test]
fn slide() {
    let bars = Bars { error_m: 8e-3, id_changes: 1, ..ONE };
    check("slide", 1, &bars, |drawn, _| (0..3).for_each(|_| _ = drawn.slide()));
}

#[test]
fn slide_through_the_centre() {
    let recordings = PAPER.draw([2, 7, 12], 1, |drawn, _| {
        drawn
            .slide_along([[0.0, 0.07], [0.0, -0.07]])
            .slide_along([[-0.07, -0.02], [0.07, 0.02]])
            .slide_along([[0.05, -0.05], [-0.05, 0.05]]);
    });
    let bars = Bars { error_m: 8e-3, extra: 0.005, ..ONE };
    PAPER.score(&recordings).check("slide through the centre", &bars);
}

/// What slides leave behind is no touch after the last lift and, after the one to the rim, no contact that got worse.
#[test]
fn what_slides_leave_behind() {
    let strokes = [
        [[0.038098, -0.016589], [0.005786, 0.048674]],
        [[0.024392, -0.030199], [-0.064698, 0.039181]],
        [[0.056019, 0.006405], [-0.082509, -0.030300]],
        [[-0.063036, 0.037963], [0.048067, -0.070624]],
        [[-0.008402, 0.076902], [0.066876, 0.059034]],
        [[-0.014313, -0.085903], [-0.002441, 0.081608]],
        [[-0.048291, -0.052698], [0.081769, 0.011604]],
        [[0.029833, 0.011935], [-0.051892, 0.052711]],
        [[0.022064, -0.074650], [-0.017700, 0.031780]],
    ];
    let [recording] = PAPER.draw([18101], 1, |drawn, _| {
        strokes.iter().for_each(|way| drawn.slide_along(*way).next_s += 0.1);
    });
    let touches = PAPER.touches(&recording);
    assert_eq!(touches.faults, []);
    Score::of(&recording, &touches).check("slides", &Bars { found: 0.98, ..ANY });
}

/// Another unit, current or conductivity: the same touches, light ones too, drawn alike in images relative to the scene.
#[test]
fn another_level_of_voltages() {
    let [recording] = PAPER.draw([SEEDS[0]], 2, |drawn, _| drawn.presses(4, 0.1..0.4));
    let fitted = PAPER.fit(&recording);
    let found = touches_of(&fitted);
    assert!(found.rows.len() > 50, "{}", found.rows.len());
    // the last one: millivolts
    for factor in [3.0, 1.0 / 3.0, 1e3] {
        let values = &recording.values * factor;
        let other_fitted = PAPER.fit(&Recording { values, truth: Vec::new() });
        let other_found = touches_of(&other_fitted);
        let level = other_fitted.level() / fitted.level();
        assert!((level / factor - 1.0).abs() < 1e-9, "{level}");
        assert_eq!(found.rows.len(), other_found.rows.len(), "{factor} times the voltages");
        let drawn = |fitted: &FittedFrames, touch: &Touch| {
            fitted.image_per_strength() * touch.intensity_s_m2
        };
        for (row, other) in found.rows.iter().zip(&other_found.rows) {
            assert_eq!((row.frame, row.touch.id), (other.frame, other.touch.id));
            let [x, y, _] = other.touch.position_m;
            assert!(off_m(&row.touch, [x, y]) < 1e-6, "{row:?} {other:?}");
            let ratio = drawn(&other_fitted, &other.touch) / drawn(&fitted, &row.touch);
            assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
            // as docs/METHODS.md says of `intensity`
            let strength = factor * other.touch.intensity_s_m2 / row.touch.intensity_s_m2;
            assert!((strength - 1.0).abs() < 1e-3, "{strength}");
        }
    }
}

/// The only fault that was found, and its frame.
fn only_fault(touches: &Touches) -> (usize, FaultKind, usize) {
    let [fault] = touches.faults[..] else { panic!("{:?}", touches.faults) };
    (fault.electrode, fault.kind, (fault.since_s * RATE_HZ).round() as usize)
}

/// Closer than this to the electrode, an image only shows what the others see from afar, metres.
const BLIND_M: f64 = 60e-3;

/// For each frame with a finger that does not move up or down, distances to the largest value of the image and the broken electrode, metres.
fn peaks<'a>(
    recording: &'a Recording,
    fitted: &FittedFrames,
) -> impl Iterator<Item = [f64; 2]> + use<'a> {
    let mut progress = Progress::silent();
    let imaging = fitted.one_step(&mut progress).unwrap();
    let images = imaging.images(&fitted.frames, &mut progress).unwrap();
    // the first of 16 electrodes is at +y, the others follow counter-clockwise
    let broken = polar(0.1, TAU * (0.25 + BROKEN as f64 / 16.0));
    recording.truth.iter().filter(|touch| touch.force_n >= 0.7).map(move |touch| {
        let image = images.frame(touch.frame).unwrap();
        let values = image.indexed_iter().filter(|(_, v)| v.is_finite());
        let ((row, column), _) = values.max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        let peak = imaging.raster.centre_m(row, column);
        [peak, broken].map(|place| distance_m(place, touch.position_m))
    })
}

/// An electrode opens: it is named within 5 frames, and touches are found without it. Without the values that the touch
/// finder excludes, images show the finger; with all values they show the electrode.
#[test]
fn open_electrode() {
    let (mut score, lost) = (Score::default(), PAPER.measurements_of(BROKEN));
    let (mut healthy, mut with, mut without) = (Vec::new(), Vec::new(), Vec::new());
    for (recording, seed) in PRESSES.iter().zip(SEEDS) {
        healthy.extend(peaks(recording, &PAPER.fit(recording)));
        let mut recording = recording.clone();
        let end = recording.values.nrows();
        recording.open(BROKEN, BROKEN_FROM..end, &mut Random::new(seed));
        let mut fitted = PAPER.fit(&recording);
        let touches = touches_of(&fitted);
        let (electrode, kind, frame) = only_fault(&touches);
        assert_eq!((electrode, kind), (BROKEN, FaultKind::Contradicts));
        assert!((BROKEN_FROM..BROKEN_FROM + 5).contains(&frame), "{frame}");
        // every touch came after the fault
        assert!(touches.rows.iter().all(|row| !row.touch.whole));
        score.add(&recording, &touches);
        with.extend(peaks(&recording, &fitted));
        let before = fitted.frames.good.clone();
        touches.leave_out(&mut fitted.frames);
        let good = &fitted.frames.good;
        // nothing before the fault, and soon after it all measurements of the electrode
        assert!(good.rows().into_iter().take(BROKEN_FROM).zip(before.rows()).all(|(a, b)| a == b));
        assert!(lost.iter().all(|&i| before[[BROKEN_FROM + 5, i]] && !good[[BROKEN_FROM + 5, i]]));
        without.extend(peaks(&recording, &fitted));
    }
    score.check("open electrode", &ONE);
    let errors_m = |peaks: &[[f64; 2]], beyond_m: f64| -> Vec<f64> {
        peaks.iter().filter(|[_, broken_m]| *broken_m > beyond_m).map(|peak| peak[0]).collect()
    };
    let worst_m = |errors_m: Vec<f64>| errors_m.into_iter().fold(0.0, f64::max);
    let of_all = [&healthy, &without].map(|peaks| worst_m(errors_m(peaks, 0.0)));
    let far_m = worst_m(errors_m(&without, BLIND_M));
    let nearest_m = errors_m(&with, BLIND_M).into_iter().fold(f64::INFINITY, f64::min);
    println!("worst {of_all:?} m healthy and without, {far_m} m far; with {nearest_m} m at best");
    // error of one-step images near a rim, a tenth of the radius, plus a pixel; measured 12 mm
    assert!(of_all[0] < 15e-3 && far_m < 15e-3, "{of_all:?} {far_m}");
    // next to the missing electrode the peak is drawn inward: measured 27 mm
    assert!(of_all[1] < 35e-3, "{of_all:?}");
    // the measurements of the open electrode are brighter than any finger, and next to it
    assert!(nearest_m > 35e-3, "{nearest_m}");
}

/// The electrode recovers before the second press: within 2 s it is used again, and no touch is shown for that.
#[test]
fn open_electrode_heals() {
    let [mut recording] = PAPER.draw([SEEDS[0]], 1, |drawn, _| {
        drawn.next_s += 3.5;
        drawn.press(0.8..2.0).next_s += 3.0;
        drawn.presses(2, 0.8..2.0);
    });
    // a second after the first press was lifted
    let healed_from = (7.7 * RATE_HZ) as usize;
    recording.open(BROKEN, BROKEN_FROM..healed_from, &mut Random::new(SEEDS[0]));
    let touches = PAPER.touches(&recording);
    assert_eq!(only_fault(&touches).0, BROKEN);
    let all = PAPER.measurements_of(BROKEN);
    let is_back = |frame: usize| all.iter().all(|&i| !touches.is_missing[[frame, i]]);
    let back = (healed_from..recording.values.nrows()).find(|&frame| is_back(frame)).unwrap();
    // the monitor requires 1 s of good frames
    assert!(back - healed_from <= (2.0 * RATE_HZ) as usize, "{back}");
    assert!((back..recording.values.nrows()).all(is_back));
    Score::of(&recording, &touches).check("healed", &ONE);
    assert!(touches.rows.last().unwrap().touch.whole);
}

/// Electrodes of recordings drift by a part each second from a frame on: they are named after at most so many frames, no
/// others are, and neither a phantom nor a lost finger lasts.
fn check_drifts(
    name: &str,
    cases: impl IntoIterator<Item = (Recording, usize, usize, f64, usize)>,
) {
    let mut score = Score::default();
    for (mut recording, electrode, from, per_s, most) in cases {
        recording.drift(electrode, from, per_s);
        let touches = PAPER.touches(&recording);
        let (found, kind, frame) = only_fault(&touches);
        assert_eq!((found, kind), (electrode, FaultKind::Drifts), "{name}");
        println!("{name}: {electrode}, {per_s} from frame {from}: named in {frame}");
        assert!(frame - from <= most, "{name}, electrode {electrode}: {frame}");
        score.add(&recording, &touches);
    }
    score.check(name, &ONE);
}

/// From untouched frames on, or under a finger, which hides it for longer.
#[test]
fn drifting_electrode() {
    let free = [(0, -0.01), (1, -0.01), (1, 0.01)].map(|(k, per_s)| (k, 100, per_s, 5));
    let under = [(0, -0.01), (2, 0.01)].map(|(k, per_s)| (k, 125, per_s, 20));
    let cases = free.into_iter().chain(under);
    let cases = cases.map(|(k, from, per_s, most)| (PRESSES[k].clone(), BROKEN, from, per_s, most));
    check_drifts("drifting electrode", cases);
}

/// From two frames before a finger lands on: these name it. (Of all 16 electrodes and three fabrics, from two or four
/// frames before: extra 0.11; under a finger others are still named when it lifts.)
#[test]
fn drift_as_a_finger_lands() {
    let steady = pressed(1, 4);
    let mut pairs = steady.truth.windows(2);
    let from = pairs.find(|pair| pair[1].frame > pair[0].frame + 5).unwrap()[1].frame - 2;
    let cases = [2, 3, 4, 9, 15].map(|electrode| (steady.clone(), electrode, from, -0.01, 5));
    check_drifts("drift as a finger lands", cases);
}

/// Damage under a finger blames no electrode. The touch keeps its id and is not whole; where nothing is left of a frame it
/// is not valid, and the frame not explained. The next frame is complete.
#[test]
fn bad_frames() {
    const ALL: usize = 208;
    let sound = pressed(0, 3);
    let (held, mut random) = (held(&sound), Random::new(SEEDS[0]));
    let every = |step: usize| held.iter().copied().skip(3).step_by(step);
    for (name, bad, lost) in [
        // no electrode loses most of its own
        ("missing values", every(3).collect::<Vec<_>>(), 10),
        ("damaged", every(4).chain((QUIET_FRAMES..60).step_by(10)).collect(), ALL),
        ("dropped in a row", held[3..6].to_vec(), ALL),
    ] {
        let mut recording = sound.clone();
        for (k, &frame) in bad.iter().enumerate() {
            let is_garbage = name == "damaged" && k % 2 == 1;
            for i in (0..lost).map(|n| n * ALL / lost) {
                let garbage_v = 0.1 * sound.largest_v() * random.normal();
                recording.values[[frame, i]] = if is_garbage { garbage_v } else { f64::NAN };
            }
        }
        let touches = PAPER.touches(&recording);
        assert!(touches.faults.is_empty(), "{name}: {:?}", touches.faults);
        let nothing_left = |frame: &usize| lost == ALL && bad.contains(frame);
        for (frame, missing) in touches.is_missing.rows().into_iter().enumerate() {
            let missing = missing.iter().filter(|missing| **missing).count();
            assert_eq!(missing, if bad.contains(&frame) { lost } else { 0 }, "{name}: {frame}");
        }
        let mut not_explained: Vec<usize> = bad.iter().copied().filter(nothing_left).collect();
        not_explained.sort_unstable();
        assert_eq!(touches.not_explained, not_explained, "{name}");
        for &frame in held.iter().filter(|frame| held.contains(&(**frame - 1))) {
            let rows: Vec<_> = touches.rows.iter().filter(|row| row.frame == frame).collect();
            let [row] = rows[..] else { panic!("{name}: frame {frame}: {rows:?}") };
            assert_eq!(row.touch.valid, !nothing_left(&frame), "{name}: frame {frame}");
            assert_eq!(row.touch.whole, !bad.contains(&frame), "{name}: frame {frame}");
            assert_ne!(row.touch.state, TouchState::End, "{name}: frame {frame}");
        }
        assert_eq!(touches.count(), 3, "{name}");
        let found = if lost == ALL { 0.0 } else { ONE.found };
        Score::of(&recording, &touches).check(name, &Bars { found, ..ONE });
    }
}

/// Damaged frames are left out of images, others and their touches are not; a strong press is none of them.
#[test]
fn damaged_frames_are_left_out_of_images() {
    let sound = pressed(2, 2);
    let [zero, larger] = [1, 3].map(|after| held(&sound)[0] + after);
    let mut damaged = sound.clone();
    damaged.values.row_mut(zero).fill(0.0);
    damaged.values.row_mut(larger).mapv_inplace(|v| 1.5 * v);
    for (recording, left) in [(&sound, vec![]), (&damaged, vec![zero, larger])] {
        let fitted = PAPER.fit(recording);
        let mut frames = fitted.frames.clone();
        touches_of(&fitted).leave_out(&mut frames);
        for (frame, good) in frames.good.rows().into_iter().enumerate() {
            let is_right = good.iter().all(|good| *good != left.contains(&frame));
            assert!(is_right, "{left:?}, frame {frame}: {:?}", frames.notes);
        }
    }
}
