//! Frames of a synthetic skin through a detector.

use super::{ELECTRODES, Skin};
use crate::touch::score::{ElectrodeState, ScoreDetector};
use crate::touch::{Touch, TouchState};
use fixtures::Random;

/// Two touches begin, keep their ids while one moves, and end; nothing is shown without them.
#[test]
fn touches_begin_move_and_end() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(11);
    let mut push = |detector: &mut ScoreDetector, touches: &[([f64; 2], f64)]| {
        let frame = skin.frame(touches, &mut random);
        detector.push(&frame, |_| false, 0.05).unwrap();
        detector.touches().to_vec()
    };
    for _ in 0..10 {
        assert!(push(&mut detector, &[]).is_empty());
    }
    let mut ids = [0; 2];
    for k in 0..10 {
        let first = [0.06 + 1e-3 * f64::from(k), 0.08];
        let true_m = [first, [0.14, 0.12]];
        let touches = push(&mut detector, &[(true_m[0], 3e-5), (true_m[1], 4e-5)]);
        if k < 2 {
            continue;
        }
        assert_eq!(touches.len(), 2, "{k} {touches:?}");
        for (at, id) in true_m.iter().zip(&mut ids) {
            let near = |t: &&Touch| {
                let way_m = (t.position_m[0] - at[0]).hypot(t.position_m[1] - at[1]);
                // half a print: it follows a slow touch with a lag
                way_m < 4e-3
            };
            let touch = touches.iter().find(near);
            let touch = touch.unwrap();
            assert!(touch.valid && touch.confidence > 0.98 && (*id == 0 || *id == touch.id));
            *id = touch.id;
        }
    }
    assert!(ids[0] != ids[1]);
    let ended = push(&mut detector, &[]);
    assert!(ended.len() == 2 && ended.iter().all(|t| t.state == TouchState::End && !t.valid));
    for _ in 0..10 {
        assert!(push(&mut detector, &[]).is_empty());
    }
}

/// An electrode whose halves disagree is named in its first frame and heals; touches are found without it.
#[test]
fn a_noisy_electrode_is_left_out_and_heals() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(13);
    for k in 0..60 {
        let is_bad = (10..20).contains(&k);
        let touch = [([0.08, 0.11], 3e-5)];
        let mut frame = skin.frame(if k > 14 { &touch } else { &[] }, &mut random);
        if is_bad {
            skin.of_electrode[4].iter().for_each(|&i| frame[i] += 0.02 * random.normal());
        }
        detector.push(&frame, |_| false, 0.05).unwrap();
        let expected = if is_bad { ElectrodeState::Noisy } else { ElectrodeState::Sound };
        if k < 30 {
            assert_eq!(detector.electrodes()[4], expected, "{k}");
        }
        assert_eq!(detector.is_missing(skin.of_electrode[4][0]), is_bad);
        let others = detector.electrodes().iter().filter(|s| **s != ElectrodeState::Sound).count();
        assert_eq!(others, usize::from(is_bad), "{k}");
        if k > 17 {
            assert_eq!(detector.touches().len(), 1, "{k}");
        }
    }
}

/// A frame of which nothing counts, or not a number, leaves touches as they are, not valid, and is no error.
#[test]
fn frames_without_values_say_nothing() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(17);
    for _ in 0..6 {
        let frame = skin.frame(&[([0.08, 0.11], 3e-5)], &mut random);
        detector.push(&frame, |_| false, 0.05).unwrap();
    }
    let id = detector.touches()[0].id;
    let nothing = vec![f64::NAN; skin.used.len()];
    detector.push(&nothing, |_| false, 0.05).unwrap();
    assert!(detector.touches().iter().all(|t| t.id == id && !t.valid));
    assert!(detector.push(&nothing[1..], |_| false, 0.05).is_err());
    assert!(detector.push(&nothing, |_| false, 0.0).is_err());
    let frame = skin.frame(&[([0.08, 0.11], 3e-5)], &mut random);
    let touches = detector.push(&frame, |_| false, 0.05).unwrap();
    assert!(touches.len() == 1 && touches[0].id == id && touches[0].valid);
}

/// Standard deviation of a touch's position.
fn std_m(touch: &Touch) -> f64 {
    let covariance = touch.position_covariance_m2;
    (covariance[0][0] + covariance[1][1]).sqrt()
}

/// What an amplifier adds to each drive moves no touch, and accuses no electrode.
#[test]
fn offsets_of_drives_are_no_touches() {
    let mut skin = Skin::new();
    skin.common.fill(1.0);
    let mut detector = skin.detector();
    let mut random = Random::new(19);
    let at = [0.08, 0.11];
    for k in 0..12 {
        let touch = [(at, 3e-5)];
        let mut frame = skin.frame(if k > 3 { &touch } else { &[] }, &mut random);
        let offsets_v: Vec<f64> = (0..ELECTRODES).map(|_| 1e-3 * random.normal()).collect();
        frame.iter_mut().zip(&skin.drive).for_each(|(v, drive)| *v += offsets_v[*drive]);
        let touches = detector.push(&frame, |_| false, 0.05).unwrap();
        assert_eq!(touches.len(), usize::from(k > 3), "{k} {touches:?}");
        // three standard deviations as stated in each frame
        let way_m = |t: &Touch| (t.position_m[0] - at[0]).hypot(t.position_m[1] - at[1]);
        assert!(touches.iter().all(|t| way_m(t) < 3.0 * std_m(t)), "{touches:?}");
        assert!(detector.electrodes().iter().all(|s| *s == ElectrodeState::Sound), "{k}");
    }
}

/// The time that a scan takes is found from a touch that moves, and its place is that at the first drive.
#[test]
fn the_time_of_a_scan_is_found() {
    let mut skin = Skin::new();
    // small voltages, so that halves are as equal as the noise allows
    skin.volts.iter_mut().for_each(|v| *v *= 0.03);
    for part in [0.0, 0.8] {
        let mut detector = skin.detector();
        let mut random = Random::new(23);
        let at = |time: f64| [0.06 + 4e-3 * time, 0.08 + 2e-3 * time];
        for k in 0..16 {
            let frame = skin.scan(f64::from(k), part, at, &mut random);
            let touches = detector.push(&frame, |_| false, 0.05).unwrap();
            if k > 8 {
                let [x, y] = at(f64::from(k));
                let way_m = |t: &Touch| (t.position_m[0] - x).hypot(t.position_m[1] - y);
                // three standard deviations as stated in each frame
                let is_near = |t: &Touch| way_m(t) < 3.0 * std_m(t);
                assert!(touches.len() == 1 && is_near(&touches[0]), "{part} {k} {touches:?}");
            }
        }
        // a tenth of a frame is 0.4 mm
        let found = detector.electrodes.scan.part();
        assert!((found - part).abs() < 0.1, "{found} {part}");
    }
}

/// A finger that has moved on during a gap in the frames is found where it is, and accuses no electrode.
#[test]
fn a_gap_in_the_frames_is_no_longer_scan() {
    let mut skin = Skin::new();
    skin.volts.iter_mut().for_each(|v| *v *= 0.03);
    let mut detector = skin.detector();
    let mut random = Random::new(29);
    let at = |time: f64| [0.06 + 2e-3 * time, 0.08 + 1e-3 * time];
    for k in 0..24 {
        let is_after = k >= 20;
        let frames = if k == 20 { 11.0 } else { 1.0 };
        let begin = f64::from(k) + if is_after { 10.0 } else { 0.0 };
        let frame = skin.scan(begin, 0.8, at, &mut random);
        let touches = detector.push(&frame, |_| false, 0.05 * frames).unwrap().to_vec();
        if k > 8 {
            let [x, y] = at(begin);
            // half a finger's width after the gap: what it knows of the motion is old
            let near_m = |t: &Touch| if is_after { 9e-3 } else { 3.0 * std_m(t) };
            let way_m = |t: &Touch| (t.position_m[0] - x).hypot(t.position_m[1] - y);
            let lasting: Vec<&Touch> =
                touches.iter().filter(|t| t.state != TouchState::End).collect();
            assert!(
                lasting.len() == 1 && way_m(lasting[0]) < near_m(lasting[0]),
                "{k} {touches:?}"
            );
        }
        // how long a scan takes is known once something has moved
        let is_sound = |s: &ElectrodeState| *s == ElectrodeState::Sound;
        assert!(k <= 8 || detector.electrodes().iter().all(is_sound), "{k}");
    }
}

/// A damaged value is no jump of the skin where nothing else moves, and a frame that is damaged as a whole is not
/// explained; a touch outlives both.
#[test]
fn damage_ends_no_touch() {
    let mut skin = Skin::new();
    skin.volts.iter_mut().for_each(|v| *v *= 0.03);
    let mut detector = skin.detector();
    let mut random = Random::new(31);
    let at = |time: f64| [0.06 + 2e-3 * time.min(16.0), 0.08];
    for k in 0..40 {
        let mut frame = skin.scan(f64::from(k), 0.8, at, &mut random);
        let (is_torn, spike) = (k == 36, 3 * k as usize);
        match k {
            20 | 24 | 28 | 32 => frame[spike] += 0.2 * skin.volts[spike].abs(),
            36 => frame.iter_mut().for_each(|v| *v += 1e-2 * random.normal()),
            _ => {}
        }
        let touches = detector.push(&frame, |_| false, 0.05).unwrap();
        if k > 8 {
            assert_eq!(touches.len(), 1, "{k} {touches:?}");
            assert_eq!((touches[0].id, touches[0].valid), (1, !is_torn), "{k}");
        }
        if matches!(k, 20 | 24 | 28 | 32) {
            assert!(detector.electrodes.is_lost.iter().filter(|lost| **lost).count() == 1, "{k}");
        }
    }
}

/// Touches, missing values and damage come and go: nothing is allocated once the largest numbers have occurred.
#[test]
fn push_allocates_nothing() {
    let skin = Skin::new();
    let mut detector = skin.detector();
    let mut random = Random::new(37);
    let at = [[0.05, 0.06], [0.14, 0.07], [0.10, 0.15]];
    for k in 0..60 {
        let count = if k % 10 < 5 { 3 } else { k % 3 };
        let touches: Vec<([f64; 2], f64)> = at[..count].iter().map(|at| (*at, 4e-5)).collect();
        let mut frame = skin.frame(&touches, &mut random);
        match k % 7 {
            3 => frame[k] += 0.1,
            5 => frame.iter_mut().skip(k).step_by(9).for_each(|v| *v += 1e-2 * random.normal()),
            _ => {}
        }
        let missing = 11 * (k % 4);
        let info = allocation_counter::measure(|| {
            detector.push(&frame, |i| i < missing, 0.05).unwrap();
        });
        // the frame with the most places of all is among the first 36
        assert!(k < 36 || info.count_total == 0, "{k}: {info:?}");
    }
}
