//! Touches on the simulated fabric through the library, with default settings: few enough frames for every
//! run. Full figures: `docs/validation/touches.md`.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::score::{Counts, Score, acted_on};
use crate::common::script::{Drawn, FIRST_S, QUIET_FRAMES, RATE_HZ};
use crate::common::{Recording, measurements_of};
use eit_skin::eit_fem::fabric::Random;
use eit_skin::faults::FaultKind;
use eit_skin::touches::Touches;
use eit_skin::{FittedFrames, Touch, TouchState};

/// Seeds of scripts and fabrics: every script is drawn three times.
const SEEDS: [u64; 3] = [71, 81, 91];

/// Forces of presses, newton.
const PRESS_N: std::ops::Range<f64> = 0.7..2.0;

/// Electrode that breaks, from 0, ...
const BROKEN: usize = 5;
/// ... and the frame from which it is broken: 3 s after the quiet ones.
const BROKEN_FROM: usize = 100;

/// Bars that a script must meet.
struct Bars {
    found: f64,
    error_m: f64,
    extra: f64,
    id_changes: usize,
}

/// The bars of the full scripts are tighter (found 0.99, 3 mm, 0.01 extra): here one press at the rim is 5 %
/// of all frames, and one that is found a frame late costs 0.003.
const ONE: Bars = Bars { found: 0.97, error_m: 6e-3, extra: 0.05, id_changes: 0 };

fn check(name: &str, score: &Score, bars: &Bars) {
    println!("{name}: {score:?}");
    score.check_ghosts();
    assert!(score.found >= bars.found, "{name}: {score:?}");
    assert!(score.error_m < bars.error_m, "{name}: {score:?}");
    assert!(score.extra <= bars.extra, "{name}: {score:?}");
    assert!(score.id_changes <= bars.id_changes, "{name}: {score:?}");
}

/// Draws and simulates a script with each seed, and scores all of them together.
fn check_drawn(name: &str, fingers: u32, bars: &Bars, draw: impl Fn(&mut Drawn)) {
    let mut counts = Counts::default();
    for seed in SEEDS {
        let mut drawn = Drawn::new(seed, fingers);
        draw(&mut drawn);
        let recording = Recording::simulate(&drawn.script(), seed);
        counts.add(&recording, &recording.touches(), QUIET_FRAMES);
    }
    check(name, &counts.score(), bars);
}

/// 15 s without a finger show nothing, and the press after them is found.
#[test]
fn quiet() {
    check_drawn("quiet", 1, &ONE, |drawn| {
        drawn.next_s += 15.0;
        drawn.press(PRESS_N);
    });
}

#[test]
fn one() {
    check_drawn("one", 1, &ONE, |drawn| (0..6).for_each(|_| _ = drawn.press(PRESS_N)));
}

/// Nine strokes over the same fabric: what slides leave behind is neither a touch that stays after the last lift nor,
/// after the one to the rim, a contact that got worse. (Both were told before detectors knew it.)
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
    let mut drawn = Drawn::new(18101, 1);
    for way in strokes {
        drawn.slide_along(way, 1.5, 0.05).next_s += 0.1;
    }
    let recording = Recording::simulate(&drawn.script(), 18101);
    let touches = recording.touches();
    let score = Counts::of(&recording, &touches, QUIET_FRAMES).score();
    println!("{score:?}, {:?}", touches.faults);
    assert_eq!(touches.faults, []);
    score.check_ghosts();
    assert!(score.found > 0.98, "{score:?}");
}

/// Voltages of another unit, current or conductivity: the same touches, light ones too, at the same places, and drawn
/// alike in the images, which are relative to the scene.
///
/// With the least strength of the scene's conductivity, light touches of three times the voltages were not found.
#[test]
fn another_level_of_voltages() {
    let mut drawn = Drawn::new(SEEDS[0], 2);
    (0..4).for_each(|_| _ = drawn.press(0.1..0.4));
    let recording = Recording::simulate(&drawn.script(), SEEDS[0]);
    let (fitted, found) = (recording.fitted(), recording.touches());
    assert!(found.rows.len() > 50, "{}", found.rows.len());
    // the last one: millivolts
    for factor in [3.0, 1.0 / 3.0, 1e3] {
        let values = &recording.values * factor;
        let other = Recording { values, truth: Vec::new() };
        let (other_fitted, other_found) = (other.fitted(), other.touches());
        let level = other_fitted.level() / fitted.level();
        assert!((level / factor - 1.0).abs() < 1e-9, "{level}");
        assert_eq!(found.rows.len(), other_found.rows.len(), "{factor} times the voltages");
        let drawn = |fitted: &FittedFrames, touch: &Touch| {
            fitted.image_per_strength() * touch.intensity_s_m2
        };
        for (row, other) in found.rows.iter().zip(&other_found.rows) {
            assert_eq!((row.frame, row.touch.id), (other.frame, other.touch.id));
            let (a, b) = (row.touch.position_m, other.touch.position_m);
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6, "{a:?} {b:?}");
            let ratio = drawn(&other_fitted, &other.touch) / drawn(&fitted, &row.touch);
            assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
            // as docs/METHODS.md says of `intensity`
            let strength = factor * other.touch.intensity_s_m2 / row.touch.intensity_s_m2;
            assert!((strength - 1.0).abs() < 1e-3, "{strength}");
        }
    }
}

/// Four fingers, at least 40 mm apart.
#[test]
fn four() {
    let bars = Bars { found: 0.95, ..ONE };
    check_drawn("four", 4, &bars, |drawn| (0..3).for_each(|_| _ = drawn.press(PRESS_N)));
}

/// Three chords of 60 mm or more at 50 mm/s: friction drags fabric and electrodes along. One stroke of the
/// nine may change its id.
#[test]
fn slide() {
    let bars = Bars { error_m: 8e-3, id_changes: 1, ..ONE };
    check_drawn("slide", 1, &bars, |drawn| (0..3).for_each(|_| _ = drawn.slide(1.5, 0.05)));
}

/// Slides through the centre, where one finger and its trail were shown as two fingers for three to five frames of each
/// of these recordings (0.016 to 0.026 extra a frame, five changes of id in all).
#[test]
fn slide_through_the_centre() {
    let mut counts = Counts::default();
    for seed in [2, 7, 12] {
        let mut drawn = Drawn::new(seed, 1);
        for way in [
            [[0.0, 0.07], [0.0, -0.07]],
            [[-0.07, -0.02], [0.07, 0.02]],
            [[0.05, -0.05], [-0.05, 0.05]],
        ] {
            drawn.slide_along(way, 1.5, 0.05);
        }
        let recording = Recording::simulate(&drawn.script(), seed);
        counts.add(&recording, &recording.touches(), QUIET_FRAMES);
    }
    let bars = Bars { error_m: 8e-3, extra: 0.005, ..ONE };
    check("slide through the centre", &counts.score(), &bars);
}

/// Six fingers in regular hexagons: of such a frame one touch alone explains nothing (the first frames showed none), and
/// what the fingers do to each other looks like a seventh in the middle (up to 0.29 extra touches a frame).
#[test]
fn hexagon() {
    let mut counts = Counts::default();
    for seed in SEEDS {
        let mut drawn = Drawn::new(seed, 6);
        for (radius_m, angle) in [(0.06, 0.0), (0.06, 0.2), (0.05, 0.4), (0.07, 0.1)] {
            drawn.ring(radius_m, angle, 1.5);
        }
        let recording = Recording::simulate(&drawn.script(), seed);
        counts.add(&recording, &recording.touches(), QUIET_FRAMES);
    }
    check("hexagon", &counts.score(), &Bars { found: 0.99, extra: 0.01, ..ONE });
}

/// Two fingers close in to 26 mm and part again. Each stays one finger, though one bell between them fits nearly as well
/// there: two touches became one in one of these recordings (found 0.98, two changes of id) and in six of eight of
/// `docs/validation/touches.md` before the known touches were asked.
#[test]
fn closing_in() {
    let mut counts = Counts::default();
    for seed in SEEDS {
        let mut drawn = Drawn::new(seed, 2);
        drawn.close_in(seed as f64, 1.0, 0.11, 0.026).close_in(seed as f64 + 1.5, 1.0, 0.09, 0.026);
        let recording = Recording::simulate(&drawn.script(), seed);
        counts.add(&recording, &recording.touches(), QUIET_FRAMES);
    }
    check("closing in", &counts.score(), &Bars { error_m: 12e-3, ..ONE });
}

/// One finger that presses repeatedly, starting half a second after the electrode breaks.
fn bench(seed: u64, presses: usize) -> Recording {
    let mut drawn = Drawn::new(seed, 1);
    drawn.next_s = FIRST_S + 3.5;
    (0..presses).for_each(|_| _ = drawn.press(0.8..2.0));
    Recording::simulate(&drawn.script(), seed)
}

/// The frame in which the only fault was found: that of this electrode, by violated reciprocity.
fn frame_of_fault(touches: &Touches) -> usize {
    let [fault] = touches.faults[..] else { panic!("{:?}", touches.faults) };
    assert_eq!((fault.electrode, fault.kind), (BROKEN, FaultKind::Contradicts));
    (fault.since_s * RATE_HZ).round() as usize
}

/// An electrode opens: it is named within 5 frames, and touches are found without it.
#[test]
fn open_electrode() {
    let mut counts = Counts::default();
    for seed in SEEDS {
        let mut recording = bench(seed, 6);
        let end = recording.values.nrows();
        recording.open(BROKEN, BROKEN_FROM..end, &mut Random::new(seed));
        let touches = recording.touches();
        let frame = frame_of_fault(&touches);
        println!("fault found {} frames after it began", frame - BROKEN_FROM);
        assert!((BROKEN_FROM..BROKEN_FROM + 5).contains(&frame), "{frame}");
        // every touch came after the fault
        assert!(touches.rows.iter().all(|row| !row.touch.whole));
        counts.add(&recording, &touches, QUIET_FRAMES);
    }
    check("open electrode", &counts.score(), &ONE);
}

/// The contact of an electrode gets better or worse by 1 % a second, from untouched frames on or under a finger: it is
/// named, no other one is, and neither a phantom nor a lost finger lasts. Worse contacts looked like four fingers
/// around the electrode for as long as they lasted.
#[test]
fn drifting_electrode() {
    let mut counts = Counts::default();
    for (seed, from, per_s) in
        [(71, 100, -0.01), (81, 100, -0.01), (81, 100, 0.01), (71, 125, -0.01), (91, 125, 0.01)]
    {
        let mut recording = bench(seed, 6);
        recording.drift(BROKEN, from, per_s);
        let touches = recording.touches();
        let [fault] = touches.faults[..] else { panic!("{:?}", touches.faults) };
        assert_eq!((fault.electrode, fault.kind), (BROKEN, FaultKind::Drifts));
        let late = (fault.since_s * RATE_HZ).round() as usize - from;
        println!("{per_s} from frame {from} on: named after {late} frames");
        // a finger hides it for longer
        assert!(late <= if from == 100 { 5 } else { 20 }, "seed {seed}: {late}");
        counts.add(&recording, &touches, QUIET_FRAMES);
    }
    check("drifting electrode", &counts.score(), &ONE);
}

/// The contact of an electrode gets worse from two frames before a finger lands on. Where these two frames tell, they
/// name it: before, it stood as touches until the finger lifted, 20 frames later, and one beside it was named instead.
/// (Of all 16 electrodes and three fabrics, from two or four frames before: extra 0.14 before, 0.11 now; under a finger
/// others are still named when it lifts.)
#[test]
fn drift_as_a_finger_lands() {
    let mut recording = bench(81, 4);
    let steady = recording.values.clone();
    let mut pairs = recording.truth.windows(2);
    let second = pairs.find(|pair| pair[1].frame > pair[0].frame + 5).unwrap();
    let from = second[1].frame - 2;
    let mut counts = Counts::default();
    for electrode in [2, 3, 4, 9, 15] {
        recording.values.assign(&steady);
        recording.drift(electrode, from, -0.01);
        let touches = recording.touches();
        let [fault] = touches.faults[..] else { panic!("{electrode}: {:?}", touches.faults) };
        assert_eq!((fault.electrode, fault.kind), (electrode, FaultKind::Drifts));
        let late = (fault.since_s * RATE_HZ).round() as usize - from;
        assert!(late <= 5, "{electrode}: {late}");
        counts.add(&recording, &touches, QUIET_FRAMES);
    }
    check("drift as a finger lands", &counts.score(), &ONE);
}

/// The electrode recovers before the second press: within 2 s it is used again, and no touch is shown for
/// that.
#[test]
fn open_electrode_heals() {
    let seed = SEEDS[0];
    let mut drawn = Drawn::new(seed, 1);
    drawn.next_s = FIRST_S + 3.5;
    drawn.press(0.8..2.0).next_s += 3.0;
    drawn.press(0.8..2.0).press(0.8..2.0);
    let mut recording = Recording::simulate(&drawn.script(), seed);
    // a second after the first press was lifted
    let healed_from = ((FIRST_S + 3.5 + 1.1 + 1.0) * RATE_HZ) as usize;
    recording.open(BROKEN, BROKEN_FROM..healed_from, &mut Random::new(seed));
    let touches = recording.touches();
    frame_of_fault(&touches);
    let all = measurements_of(BROKEN);
    let is_back = |frame: usize| all.iter().all(|&i| !touches.is_missing[[frame, i]]);
    let back = (healed_from..recording.values.nrows()).find(|&frame| is_back(frame)).unwrap();
    println!("used again {} frames after its signal", back - healed_from);
    // the monitor requires 1 s of good frames
    assert!(back - healed_from <= (2.0 * RATE_HZ) as usize, "{back}");
    assert!((back..recording.values.nrows()).all(is_back));
    check("healed", &Counts::of(&recording, &touches, QUIET_FRAMES).score(), &ONE);
    let last = touches.rows.last().unwrap();
    assert!(last.touch.whole, "{last:?}");
}

/// Values that are not numbers are excluded from their frames; the touch continues and says so.
#[test]
fn missing_values() {
    let seed = SEEDS[0];
    let mut recording = bench(seed, 1);
    let held: Vec<usize> = (0..recording.values.nrows())
        .filter(|frame| recording.truth.iter().any(|t| t.frame == *frame && t.force_n > 0.7))
        .collect();
    let mut random = Random::new(seed);
    // every third frame of the press, ten of 208 values each: no electrode loses most of its own
    let holed: Vec<usize> = held.iter().copied().skip(3).step_by(3).collect();
    for &frame in &holed {
        (0..10).for_each(|_| recording.values[[frame, random.below(208)]] = f64::NAN);
    }
    let touches = recording.touches();
    assert!(touches.faults.is_empty(), "{:?}", touches.faults);
    for frame in held[1]..=*held.last().unwrap() {
        let [touch] = acted_on(&touches, frame)[..] else { panic!("frame {frame}") };
        assert_eq!(touch.whole, !holed.contains(&frame), "frame {frame}");
        assert_ne!(touch.state, TouchState::End);
    }
    assert_eq!(touches.count(), 1);
    check("missing values", &Counts::of(&recording, &touches, QUIET_FRAMES).score(), &ONE);
}

/// Dropped packets and garbage while a finger presses: no electrode is blamed, the touch is not valid in
/// them, keeps its id, and the next frame is complete.
#[test]
fn bad_frames() {
    let seed = SEEDS[0];
    let mut recording = bench(seed, 3);
    let mut random = Random::new(seed);
    let largest = recording.values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let held: Vec<usize> = (0..recording.values.nrows())
        .filter(|frame| recording.truth.iter().any(|t| t.frame == *frame && t.force_n > 0.7))
        .collect();
    // one in ten of all frames, and one in four of the presses
    let bad: Vec<usize> =
        held.iter().skip(3).step_by(4).copied().chain((QUIET_FRAMES..60).step_by(10)).collect();
    for (k, &frame) in bad.iter().enumerate() {
        for value in recording.values.row_mut(frame) {
            *value = if k % 2 == 0 { f64::NAN } else { 0.1 * largest * random.normal() };
        }
    }
    let touches = recording.touches();
    assert!(touches.faults.is_empty(), "{:?}", touches.faults);
    for frame in QUIET_FRAMES..recording.values.nrows() {
        let missing = touches.is_missing.row(frame).iter().filter(|missing| **missing).count();
        assert_eq!(missing, if bad.contains(&frame) { 208 } else { 0 }, "frame {frame}");
    }
    // that there is no touch in them does not mean that nothing touches the skin
    assert!(
        bad.iter().all(|frame| touches.not_explained.contains(frame)),
        "{:?}",
        touches.not_explained
    );
    for &frame in held.iter().filter(|frame| held.contains(&(**frame - 1))) {
        let [row] = touches.rows.iter().filter(|row| row.frame == frame).collect::<Vec<_>>()[..]
        else {
            panic!("frame {frame}")
        };
        let is_good = !bad.contains(&frame);
        assert_eq!((row.touch.valid, row.touch.whole), (is_good, is_good), "frame {frame}");
        assert_ne!(row.touch.state, TouchState::End, "frame {frame}");
    }
    assert_eq!(touches.count(), 3);
    let score = Counts::of(&recording, &touches, QUIET_FRAMES).score();
    println!("bad frames: {score:?}");
    score.check_ghosts();
    assert_eq!(score.id_changes, 0, "{score:?}");
    assert!(score.error_m < ONE.error_m, "{score:?}");
}

/// Three frames without one value while a finger presses: it is the same touch before and after, and not valid between.
#[test]
fn touches_are_held_while_nothing_is_measured() {
    let seed = SEEDS[1];
    let mut recording = bench(seed, 1);
    let held: Vec<usize> = (0..recording.values.nrows())
        .filter(|frame| recording.truth.iter().any(|t| t.frame == *frame && t.force_n > 0.7))
        .collect();
    let lost = held[3]..held[3] + 3;
    for frame in lost.clone() {
        recording.values.row_mut(frame).fill(f64::NAN);
    }
    let touches = recording.touches();
    assert_eq!(touches.not_explained, lost.clone().collect::<Vec<_>>());
    for frame in held[1]..=*held.last().unwrap() {
        let rows: Vec<_> = touches.rows.iter().filter(|row| row.frame == frame).collect();
        let [row] = rows[..] else { panic!("frame {frame}: {rows:?}") };
        assert_eq!(row.touch.valid, !lost.contains(&frame), "frame {frame}");
        assert_ne!(row.touch.state, TouchState::End, "frame {frame}");
    }
    assert_eq!(touches.count(), 1);
}

/// Damaged frames are left out of images, others and their touches are not; a strong press is none of them.
#[test]
fn damaged_frames_are_left_out_of_images() {
    let recording = bench(SEEDS[2], 2);
    let mut frames = recording.fitted().frames;
    recording.touches().leave_out(&mut frames);
    assert!(frames.good.iter().all(|good| *good), "{:?}", frames.notes);
    let mut damaged = bench(SEEDS[2], 2);
    let pressed = damaged.truth.iter().find(|t| t.force_n > 0.7).unwrap().frame;
    let [zero, larger] = [pressed + 1, pressed + 3];
    damaged.values.row_mut(zero).fill(0.0);
    damaged.values.row_mut(larger).mapv_inplace(|v| 1.5 * v);
    let mut frames = damaged.fitted().frames;
    damaged.touches().leave_out(&mut frames);
    for (frame, good) in frames.good.rows().into_iter().enumerate() {
        let is_left = good.iter().any(|good| *good);
        assert_eq!(is_left, ![zero, larger].contains(&frame), "frame {frame}: {:?}", frames.notes);
    }
}
