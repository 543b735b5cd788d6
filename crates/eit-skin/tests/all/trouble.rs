//! What a robot is told when the instrument or a contact is in trouble: frame by frame, through [`Sensor`].

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::Bench;
use crate::common::script::{Drawn, QUIET_FRAMES, RATE_HZ};
use crate::common::source::Listed;
use eit_skin::eit_hw::driver::Event;
use eit_skin::eit_hw::{Frame, Quality, Unit};
use eit_skin::live::{LiveModel, LiveStream, SkinState};
use eit_skin::ndarray::Array2;
use eit_skin::scene::{Scene, ValueKind};
use eit_skin::{Next, Progress, Sensor, Skin, TouchState};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Where the finger of [`held`] presses.
const AT: [f64; 2] = [0.04, 0.02];

/// Frames of one finger that is held for three seconds from 0.2 s after the reference on, and then nothing for a second.
fn held(bench: &Bench, seed: u64) -> Array2<f64> {
    let mut drawn = Drawn::new(seed, 1);
    (0..3).for_each(|_| _ = drawn.press_at(&[AT], 1.0..1.5));
    let mut script = drawn.script();
    let keys = &mut script.fingers[0].keys;
    // down once, up once
    let (first, last) = (keys[0], keys[keys.len() - 1]);
    let force_n = keys.iter().map(|key| key.force_n).fold(0.0, f64::max);
    let at = |time_s: f64, force_n: f64| {
        let mut key = first;
        (key.time_s, key.force_n) = (time_s, force_n);
        key
    };
    *keys = vec![
        at(first.time_s, 0.0),
        at(first.time_s + 0.2, force_n),
        at(last.time_s - 0.2, force_n),
        at(last.time_s, 0.0),
    ];
    bench.simulate(&script, seed).values
}

fn skin(text: &str) -> (Skin, Bench) {
    let scene = || Scene::parse(text, "scene").unwrap();
    let mut skin = Skin::from_scene(scene()).unwrap();
    skin.settings.recording.frame_rate_hz = Some(RATE_HZ);
    (skin, Bench::believing(scene(), scene()))
}

fn disc() -> (Skin, Bench) {
    skin(&Scene::text("paper-disc").unwrap())
}

fn frames(values: &Array2<f64>) -> Vec<Frame> {
    let frame = |(k, row): (usize, eit_skin::ndarray::ArrayView1<'_, f64>)| Frame {
        values: row.to_vec(),
        imaginary: None,
        quality: vec![Quality::GOOD; row.len()],
        sequence: k as u64,
        epoch: 0,
        device_time_s: Some(k as f64 / RATE_HZ),
        host_time_s: None,
    };
    values.outer_iter().enumerate().map(frame).collect()
}

/// What is told of a frame.
#[derive(Debug, Clone)]
struct Output {
    frame: usize,
    /// Valid touches at [`AT`], and others.
    touches: [usize; 2],
    faults: Vec<usize>,
    whole: bool,
    explained: bool,
    frozen: bool,
}

fn output(sensor: &mut Sensor, frames: &[Frame]) -> Vec<Output> {
    let mut all = Vec::new();
    for frame in frames {
        let Some(shown) = sensor.push(frame).unwrap() else { continue };
        let mut touches = [0; 2];
        for touch in shown.touches.iter().filter(|t| t.valid && t.state != TouchState::End) {
            let [x, y, _] = touch.position_m;
            touches[usize::from((x - AT[0]).hypot(y - AT[1]) > 0.025)] += 1;
        }
        all.push(Output {
            frame: frame.sequence as usize,
            touches,
            faults: shown.faults.iter().map(|fault| fault.electrode).collect(),
            whole: shown.whole,
            explained: shown.state == SkinState::Sound,
            frozen: shown.state == SkinState::Frozen,
        });
    }
    all
}

/// Frames in which the finger is shown.
fn found(output: &[Output]) -> Vec<usize> {
    output.iter().filter(|output| output.touches[0] > 0).map(|output| output.frame).collect()
}

fn others(output: &[Output]) -> usize {
    output.iter().map(|output| output.touches[1]).sum()
}

/// An instrument that sends one frame again and again says nothing of the skin, and the finger of that frame is not shown
/// for ever.
#[test]
fn a_frozen_instrument_is_reported() {
    let (skin, bench) = disc();
    let values = held(&bench, 51);
    let mut sent = frames(&values);
    let frozen = 70..sent.len();
    let old = sent[70].values.clone();
    sent[frozen].iter_mut().for_each(|frame| frame.values.clone_from(&old));
    let output = output(&mut skin.sensor().unwrap(), &sent);
    let first = output.iter().find(|output| output.frozen).unwrap().frame;
    // ten equal frames
    assert_eq!(first, 79);
    assert!(output.iter().all(|output| output.frozen == (output.frame >= first)));
    assert!(output.iter().filter(|output| output.frozen).all(|output| !output.whole));
    assert!(
        found(&output).last().is_some_and(|last| (78..80).contains(last)),
        "{:?}",
        found(&output)
    );
}

/// Zeros of an instrument that starts again are neither faulty electrodes for long nor the end of a finger's touch.
#[test]
fn an_outage_does_not_swallow_a_finger() {
    let (skin, bench) = disc();
    let mut sent = frames(&held(&bench, 52));
    sent[70..78].iter_mut().for_each(|frame| frame.values.fill(0.0));
    let output = output(&mut skin.sensor().unwrap(), &sent);
    let after = output.iter().filter(|output| (102..110).contains(&output.frame));
    // electrodes are used again after a second
    assert!(
        after.clone().all(|output| output.touches[0] == 1 && output.faults.is_empty()),
        "{output:?}"
    );
    assert_eq!(others(&output), 0);
}

/// With opposite drive, and with three electrodes between those driven, no measurement has a reciprocal. An electrode that does
/// not conduct any more is named all the same, and the finger goes on.
#[test]
fn a_lost_electrode_is_named_without_reciprocity() {
    for drive in ["opposite", "skip-3"] {
        lost_electrode_is_named(drive);
    }
}

fn lost_electrode_is_named(drive: &str) {
    let text = Scene::text("paper-disc").unwrap();
    let text = text.replace("drive = \"adjacent\"", &format!("drive = \"{drive}\""));
    let (skin, bench) = self::skin(&text);
    let lost = Bench::believing(
        Scene::parse(&format!("{text}\n[fabric.instrument]\nlost = [5]\n"), "lost").unwrap(),
        Scene::parse(&text, "sound").unwrap(),
    );
    let sound = frames(&held(&bench, 53));
    let mut sent = frames(&held(&lost, 53));
    // quiet, and under the finger
    for from in [44, 70] {
        sent[..from].clone_from_slice(&sound[..from]);
        let output = output(&mut skin.sensor().unwrap(), &sent);
        let named = output.iter().find(|output| !output.faults.is_empty()).unwrap();
        println!("{drive}, lost from frame {from}: named in frame {}", named.frame);
        assert!(named.frame <= from + 4 && named.faults == [4], "{named:?}");
        let held = output.iter().filter(|output| (75..100).contains(&output.frame));
        assert!(held.clone().all(|output| output.touches[0] == 1 && !output.whole), "{output:?}");
        assert_eq!(others(&output), 0);
    }
}

/// A contact that steps by two percent under a finger: neither touches nor a gain alone explain that, both together do. The
/// electrode is named, and the finger goes on without its measurements.
#[test]
fn a_step_under_a_finger_is_named() {
    let (skin, bench) = disc();
    let quadruples = skin.protocol.quadruples().unwrap().to_vec();
    let sound = frames(&held(&bench, 56));
    for electrode in [2, 3, 9] {
        for gain in [0.98, 1.02] {
            let mut sent = sound.clone();
            for frame in &mut sent[70..] {
                let involved = quadruples.iter().zip(&mut frame.values);
                involved.filter(|(q, _)| q.contains(&electrode)).for_each(|(_, v)| *v *= gain);
            }
            let output = output(&mut skin.sensor().unwrap(), &sent);
            let named = output.iter().find(|output| !output.faults.is_empty()).unwrap();
            assert!(named.frame <= 72 && named.faults == [electrode as usize], "{named:?}");
            let held = output.iter().filter(|output| (73..120).contains(&output.frame));
            assert!(
                held.clone().all(|output| output.touches[0] == 1),
                "{electrode} {gain}: {output:?}"
            );
            assert_eq!(others(&output), 0);
        }
    }
}

/// A contact that opens and closes changes all voltages in a way that is reciprocal, and the reference follows it; when it
/// closes, that was shown as touches.
#[test]
fn a_loose_contact_is_no_touch() {
    let text = Scene::text("paper-disc").unwrap();
    let loose = "[fabric.instrument]\nloose = [3]\nloose_rate_hz = 0.1\nloose_time_s = 3.0\n";
    let (skin, _) = disc();
    let bench = Bench::believing(
        Scene::parse(&format!("{text}\n{loose}"), "loose").unwrap(),
        Scene::parse(&text, "sound").unwrap(),
    );
    let (mut shown, mut unexplained) = (0, 0);
    for seed in [1, 2, 7] {
        let mut script = Drawn::new(seed, 1).press_at(&[AT], 1.0..1.5).script();
        script.frames = 600;
        script.fingers.clear();
        let output =
            output(&mut skin.sensor().unwrap(), &frames(&bench.simulate(&script, seed).values));
        shown += output.iter().filter(|output| output.touches != [0, 0]).count();
        unexplained += output.iter().filter(|output| !output.explained).count();
    }
    println!("{shown} frames with a touch, {unexplained} unexplained");
    assert!(shown <= MOST_SHOWN && unexplained > 0, "{shown} {unexplained}");
}

/// Of 1 680 frames; none are measured.
const MOST_SHOWN: usize = 20;

/// The reference leaves out frames of another kind and waits while a hand is on the skin.
#[test]
fn the_reference_is_that_of_an_untouched_skin() {
    let (skin, bench) = disc();
    let values = held(&bench, 54);
    let sound = frames(&values);
    for (name, edit) in [("zero", 0.0), ("ten times", 10.0), ("missing", f64::NAN)] {
        let mut sent = sound.clone();
        sent[10].values.iter_mut().for_each(|v| *v *= edit);
        let mut sensor = skin.sensor().unwrap();
        let output = output(&mut sensor, &sent);
        assert!(found(&output).len() > 40 && others(&output) == 0, "{name}: {:?}", found(&output));
        assert!(sensor.notes().iter().any(|note| note.contains("1 frame left out")), "{name}");
    }
    // a finger that lifts while the reference is taken: what comes after it is the reference
    let mut sent = sound[100..].to_vec();
    sent.extend(sound.iter().cloned());
    for (k, frame) in sent.iter_mut().enumerate() {
        (frame.sequence, frame.device_time_s) = (k as u64, Some(k as f64 / RATE_HZ));
    }
    let mut sensor = skin.sensor().unwrap();
    let output = output(&mut sensor, &sent);
    assert!(found(&output).len() > 40 && others(&output) == 0, "{:?}", found(&output));
    assert!(sensor.notes().iter().any(|note| note.contains("later")), "{:?}", sensor.notes());
}

/// Frames of another connection have a reference of their own.
#[test]
fn another_connection_takes_a_reference() {
    let (skin, bench) = disc();
    let values = held(&bench, 55);
    let mut sent = frames(&values);
    let mut again = sent.clone();
    for (k, frame) in again.iter_mut().enumerate() {
        (frame.epoch, frame.sequence) = (1, (sent.len() + k) as u64);
        frame.device_time_s = Some((sent.len() + k) as f64 / RATE_HZ);
        // another gain of each channel
        let gain = |i: usize| 1.0 + 0.03 * ((i * 7919 % 13) as f64 / 13.0 - 0.5);
        frame.values.iter_mut().enumerate().for_each(|(i, v)| *v *= gain(i));
    }
    let count = sent.len();
    sent.append(&mut again);
    let output = output(&mut skin.sensor().unwrap(), &sent);
    assert!(output.iter().all(|output| !(count..count + QUIET_FRAMES - 1).contains(&output.frame)));
    let [first, second] = [0..count, count..2 * count]
        .map(|range| found(&output).iter().filter(|frame| range.contains(frame)).count());
    assert!(first > 40 && first.abs_diff(second) <= 2 && others(&output) == 0, "{first} {second}");
}

/// A reference that is told consists of exactly those frames, as if a program had set it; some that are missing are
/// noted, and where hardly any came another is taken. Each thing is told once, and then the source is over.
#[test]
fn a_reference_is_the_one_that_is_told() {
    let (skin, bench) = disc();
    let sent = frames(&held(&bench, 57));
    let is_told = |frame: &Frame| frame.sequence < 40 && frame.sequence.is_multiple_of(2);
    let of = |missing: std::ops::Range<u64>| {
        let sequences = sent.iter().filter(|frame| is_told(frame)).map(|frame| frame.sequence);
        let told = Event::Reference { epoch: 0, sequences: sequences.collect(), until: None };
        let came = sent.iter().filter(|frame| !missing.contains(&frame.sequence)).cloned();
        let source = Listed::new(std::iter::once(told).chain(came.map(Event::Frame)));
        let mut sensor = skin.sensor_of(Box::new(source), false).unwrap();
        let (mut touches, mut others) = (Vec::new(), Vec::new());
        loop {
            match sensor.next_within(Duration::MAX).unwrap() {
                Next::Frame(frame) => {
                    touches.push((frame.sequence, format!("{:?}", frame.touches)));
                }
                Next::Waiting { left } => others.push(format!("{left} left")),
                Next::Event(event) => others.push(format!("{event:?}")),
                Next::Over => break,
                Next::Nothing => panic!("nothing, at {:?}", touches.last()),
            }
        }
        assert!(others[0].starts_with("Reference"), "{}", others[0]);
        assert_eq!(others.iter().position(|said| said == "0 left"), Some(others.len() - 1));
        (touches, sensor.notes().join("\n"), sensor.reference().len())
    };
    let (touches, notes, count) = of(0..0);
    assert!(notes.is_empty() && count == 20, "{notes}");
    let mut sensor = skin.sensor().unwrap();
    let told: Vec<Frame> = sent.iter().filter(|frame| is_told(frame)).cloned().collect();
    assert!(sensor.set_reference(&told[..3]).is_err());
    sensor.set_reference(&told).unwrap();
    for (frame, (sequence, wanted)) in sent[39..].iter().zip(&touches) {
        let found = sensor.push(frame).unwrap().unwrap();
        assert_eq!((found.sequence, &format!("{:?}", found.touches)), (*sequence, wanted));
    }
    let is_touched = |(_, touches): &(u64, String)| touches != "[]";
    assert!(touches.len() == sent.len() - 39 && touches.iter().any(is_touched));

    let (_, notes, count) = of(9..12);
    assert!(notes.contains("1 of the 20 reference frames") && count == 19, "{notes}");
    let (_, notes, count) = of(0..35);
    assert!(notes.contains("18 of the 20 reference frames") && count == 40, "{notes}");
}

/// A board that reports a function of the voltage: the function is named from the untouched skin, and with it in the scene the same
/// finger is found.
#[test]
fn values_that_are_no_voltages_are_named_and_converted() {
    let (mut skin, bench) = disc();
    let sent = frames(&held(&bench, 57));
    let valid = |sensor: &mut Sensor, sent: &[Frame]| -> Vec<[f64; 2]> {
        let mut places = Vec::new();
        for frame in sent {
            let found = sensor.push(frame).unwrap();
            let touches = found.iter().flat_map(|found| found.touches);
            places.extend(touches.filter(|t| t.valid).map(|t| [t.position_m[0], t.position_m[1]]));
        }
        places
    };
    let wanted = valid(&mut skin.sensor().unwrap(), &sent).len();
    for (kind, of) in [
        (ValueKind::Reciprocal, (|v: f64| 1e3 / v.abs()) as fn(f64) -> f64),
        (ValueKind::Decibel, |v| 20.0 * v.abs().log10()),
        (ValueKind::Squared, |v| v * v),
    ] {
        let mut reported = sent.clone();
        reported.iter_mut().flat_map(|frame| &mut frame.values).for_each(|v| *v = of(*v));
        skin.settings.recording.values = ValueKind::Voltage;
        let mut sensor = skin.sensor().unwrap();
        let blind = valid(&mut sensor, &reported).len();
        let named = format!("values = \"{}\"", kind.name().0);
        assert!(sensor.notes().iter().any(|note| note.contains(&named)), "{:?}", sensor.notes());
        skin.settings.recording.values = kind;
        let mut sensor = skin.sensor().unwrap();
        let places = valid(&mut sensor, &reported);
        println!(
            "{kind:?}: {blind} touches as voltages, {} converted, {wanted} of voltages",
            places.len()
        );
        assert!(
            !sensor.notes().iter().any(|note| note.contains("values =")),
            "{:?}",
            sensor.notes()
        );
        assert!(places.len() + 3 >= wanted && places.len() <= wanted + 3);
        let off_m = |[x, y]: &[f64; 2]| (x - AT[0]).hypot(y - AT[1]);
        assert!(places.iter().all(|place| off_m(place) < 0.01), "{places:?}");
    }
}

/// Live frames do not wait while the detector of touches is set up: they are not searched. Frames of a recording wait, but those that
/// were not searched are not, if it tells them.
#[test]
fn live_frames_do_not_wait_for_the_set_up() {
    const LAST: u64 = 42;
    let (skin, bench) = disc();
    let sent = frames(&held(&bench, 57));
    let run = |told: Option<Event>, is_live: bool| {
        let is_over = Arc::new(AtomicBool::new(false));
        let frames = sent.iter().cloned().map(Event::Frame);
        let source = Listed::new(told.into_iter().chain(frames)).held_at(LAST, &is_over);
        let mut sensor = skin.sensor_of(Box::new(source), is_live).unwrap();
        let (mut touches, mut waited) = (Vec::new(), 0);
        loop {
            match sensor.next_within(Duration::MAX).unwrap() {
                Next::Waiting { left: 0 } => is_over.store(true, Ordering::Relaxed),
                Next::Waiting { .. } => waited += usize::from(!sensor.reference().is_empty()),
                Next::Frame(frame) => {
                    touches.push((frame.sequence, format!("{:?}", frame.touches)));
                }
                Next::Over => break,
                other => assert!(matches!(other, Next::Event(_)), "{other:?}"),
            }
        }
        (touches, waited)
    };
    let (touches, _) = run(None, true);
    let is_touched = |(_, touches): &&(u64, String)| touches != "[]";
    assert_eq!(touches[0].0, LAST + 1);
    assert!(touches.iter().filter(is_touched).count() > 40);
    let told = |until| Event::Reference { epoch: 0, sequences: (0..40).collect(), until };
    let (replayed, waited) = run(Some(told(Some(LAST))), false);
    // the frames between the reference and the last one
    assert!(replayed == touches && waited as u64 == LAST - 40 + 1, "{waited}");
    assert_eq!(run(Some(told(None)), false).0[0].0, 40);
}

/// With a new reference nothing from before is shown, and no id is used twice. The first frame of a recording that the
/// scene states, and which live frames do not have, is no obstacle.
#[test]
fn a_new_reference_forgets_touches_and_continues_their_ids() {
    let (mut skin, bench) = disc();
    skin.settings.recording.first_frame = Some(30);
    let sent = frames(&held(&bench, 56));
    let mut sensor = skin.sensor().unwrap();
    let mut last = 0;
    for round in 0..2 {
        let mut ids = Vec::new();
        for frame in &sent {
            let touches = sensor.push(frame).unwrap().map(|shown| shown.touches.to_vec());
            assert_eq!(sensor.shown().is_some(), touches.is_some(), "round {round}");
            ids.extend(touches.iter().flatten().map(|touch| touch.id));
        }
        let (first, most) = (ids.iter().min().unwrap(), ids.iter().max().unwrap());
        assert!(*first > last, "round {round}: {first} after {last}");
        last = *most;
        sensor.restart();
        assert!(sensor.shown().is_none());
    }
    let mut silent = Progress::silent();
    let error = LiveModel::new(&skin, 1 << 60, &mut silent).unwrap_err().to_string();
    assert!(error.contains("there must be"), "{error}");
}

/// A frame at full scale, or too large by a factor, is reciprocal; it costs itself and nothing after it. A small factor that
/// touches might explain is not believed either.
#[test]
fn a_damaged_frame_costs_itself_only() {
    let (skin, bench) = disc();
    let sent = frames(&held(&bench, 57));
    let sound = found(&output(&mut skin.sensor().unwrap(), &sent));
    let largest = sent[0].values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    for (what, at) in
        [("full scale", 60), ("full scale", 115), ("10", 80), ("1.3", 115), ("1.1", 115)]
    {
        let mut sent = sent.clone();
        for value in &mut sent[at].values {
            *value = match what.parse::<f64>() {
                Ok(factor) => factor * *value,
                Err(_) => 1.25 * largest,
            };
        }
        let output = output(&mut skin.sensor().unwrap(), &sent);
        let left: Vec<usize> = found(&output).into_iter().filter(|frame| *frame != at).collect();
        let missing = sound.iter().filter(|frame| **frame != at && !left.contains(frame)).count();
        assert!(
            missing <= 1 && others(&output) == 0,
            "{what} at {at}: {missing}, {}",
            others(&output)
        );
        assert!(output.iter().all(|output| output.faults.is_empty()), "{what} at {at}");
    }
}

/// One quiet frame that repeats the one before does not hide a frozen instrument; it is told after twice the time.
#[test]
fn a_frozen_instrument_is_reported_after_a_repeated_frame() {
    let (skin, bench) = disc();
    let mut sent = frames(&held(&bench, 58));
    sent[7].values = sent[6].values.clone();
    let old = sent[70].values.clone();
    sent[70..].iter_mut().for_each(|frame| frame.values.clone_from(&old));
    let output = output(&mut skin.sensor().unwrap(), &sent);
    assert_eq!(output.iter().find(|output| output.frozen).unwrap().frame, 88);
}

/// Eight electrodes on a long skin: so few measurements that a gain fits much of any touch. No electrode is blamed for one,
/// and nothing is shown elsewhere.
#[test]
fn eight_electrodes_on_a_long_skin() {
    let text = r#"
        [skin]
        shape = "rectangle"
        width_m = 0.3
        height_m = 0.06
        conductivity_s = 1e-5
        [electrodes]
        count = 8
        width_m = 0.01
        contact_impedance_ohm_m = 1000
        [protocol]
        drive = "adjacent"
        measure = "adjacent"
        driven_electrodes = "drop"
        order = "rotated"
        current_a = 1e-4
    "#;
    let (skin, bench) = skin(text);
    for seed in [2, 3] {
        let script = bench.script("tapping", seed);
        let recording = bench.simulate(&script, seed);
        let mut sensor = skin.sensor().unwrap();
        let (mut seen, mut far, mut blamed) = (0, 0, 0);
        for frame in frames(&recording.values) {
            let Some(shown) = sensor.push(&frame).unwrap() else { continue };
            blamed += shown.faults.len();
            let fingers = recording.truth.iter().filter(|t| t.frame == frame.sequence as usize);
            let places: Vec<[f64; 2]> = fingers.map(|finger| finger.position_m).collect();
            for touch in shown.touches.iter().filter(|t| t.valid && t.state != TouchState::End) {
                let [x, y, _] = touch.position_m;
                let is_there = places.iter().any(|[a, b]| (x - a).hypot(y - b) < 0.03);
                (seen, far) = (seen + usize::from(is_there), far + usize::from(!is_there));
            }
        }
        println!("seed {seed}: {seen} there, {far} elsewhere, {blamed} blamed");
        assert!(seen >= 10 && far == 0 && blamed == 0, "seed {seed}: {seen}, {far}, {blamed}");
    }
}

/// Two fingers on a small skin with eight electrodes: what is reported is on the skin. (The filter is beyond the rim in 16
/// of 868 rows.)
#[test]
fn touches_are_on_the_skin() {
    let text = r#"
        [skin]
        shape = "rectangle"
        width_m = 0.1
        height_m = 0.07
        conductivity_s = 1e-4
        [electrodes]
        count = 8
        width_m = 0.01
        contact_impedance_ohm_m = 200
        [protocol]
        drive = "opposite"
        measure = "adjacent"
        current_a = 1e-3
    "#;
    let (_, bench) = skin(text);
    let recording = bench.simulate(&bench.script("two-fingers", 34), 34);
    let touches = bench.touches(&recording);
    assert!(touches.rows.len() > 50, "{}", touches.rows.len());
    for row in &touches.rows {
        let [x, y, _] = row.touch.position_m;
        // rounding
        let is_on = x.abs() <= 0.05 + 1e-9 && y.abs() <= 0.035 + 1e-9;
        assert!(is_on, "frame {}: {x} {y}", row.frame);
    }
}

/// Electrodes of which nothing comes from the start are named, and touches go on; a damaged frame does not enter the
/// reference of a recording.
#[test]
fn what_is_wrong_from_the_start_is_named() {
    let (skin, bench) = disc();
    let recording = bench.simulate(&Drawn::new(59, 1).press(0.8..1.2).script(), 59);
    let quadruples = skin.protocol.quadruples().unwrap().to_vec();
    let sound = bench.touches(&recording);
    for value in [0.0, f64::NAN, 1.25] {
        let mut broken = recording.clone();
        for mut row in broken.values.rows_mut() {
            for (v, quadruple) in row.iter_mut().zip(&quadruples) {
                if quadruple.contains(&5) {
                    *v = value;
                }
            }
        }
        let touches = bench.touches(&broken);
        let faulty: Vec<usize> = touches.faults.iter().map(|fault| fault.electrode).collect();
        assert_eq!(faulty, [5], "{value}");
        assert!(touches.rows.iter().all(|row| !row.touch.whole), "{value}");
        let output = output(&mut skin.sensor().unwrap(), &frames(&broken.values));
        assert!(output.iter().all(|output| !output.whole && output.faults == [5]), "{value}");
        assert!(touches.frames_with_touch() + 3 >= sound.frames_with_touch(), "{value}");
    }
    let mut damaged = recording.clone();
    damaged.values.row_mut(3).fill(0.0);
    let fitted = bench.fit(&damaged);
    assert!(fitted.frames.notes.iter().any(|note| note.starts_with("1 frame left out")));
    assert_eq!(bench.touches(&damaged).frames_with_touch(), sound.frames_with_touch());
    assert!(sound.not_explained.is_empty() && sound.frozen.is_empty());
}

/// An instrument that was unplugged and begins at 0 again, both its clock and its frames: the time of the session goes on.
#[test]
fn time_goes_on_when_the_instrument_is_found_again() {
    let (skin, bench) = disc();
    let sent = frames(&held(&bench, 61));
    let mut sensor = skin.sensor().unwrap();
    let mut times = Vec::new();
    for epoch in 0..3 {
        for frame in &sent[..QUIET_FRAMES + 20] {
            let shown = sensor.push(&Frame { epoch, ..frame.clone() }).unwrap();
            times.extend(shown.map(|shown| (shown.epoch, shown.time_s)));
        }
    }
    let epochs: Vec<u32> = times.iter().map(|(epoch, _)| *epoch).collect();
    assert!(epochs.contains(&0) && epochs.contains(&2), "{epochs:?}");
    for pair in times.windows(2) {
        let [(before, from_s), (after, to_s)] = [pair[0], pair[1]];
        assert!(to_s > from_s, "epoch {before} at {from_s} s, then {after} at {to_s} s");
    }
}

/// A program without a command line reads of arguments and settings, not of options that it does not have; one with options
/// can name them.
#[test]
fn errors_name_arguments_and_no_options() {
    let (skin, _) = disc();
    let error = skin.read_frames(&[], None).unwrap_err();
    let problem = "no frames: give their files, or set [recording] file in the scene";
    assert_eq!(error.as_argument(), Some(("frames", problem)));
    assert_eq!(error.to_string(), format!("frames: {problem}"));
    let error = eit_skin::method::choose(&skin.settings, Some("best"), None).unwrap_err();
    assert!(error.to_string().starts_with("method: \"best\": the methods are"), "{error}");
    let error = error.within("a.toml");
    assert_eq!(error.as_argument().map(|(name, _)| name), Some("method"));
    assert_eq!(eit_skin::SkinError::input("x").as_argument(), None);
}

/// While the reference waits for the skin to rest, the stream says so.
#[test]
fn a_reference_that_waits_says_why() {
    let (skin, bench) = disc();
    let sent = frames(&held(&bench, 60));
    let model = LiveModel::new(&skin, 40, &mut Progress::silent()).unwrap();
    let mut stream =
        LiveStream::of_unit(Arc::new(model), Unit::Volt, Some(RATE_HZ)).without_images();
    // the finger comes within the first forty frames
    for frame in &sent[20..62] {
        stream.push(frame, false).unwrap();
    }
    assert!(stream.unrest().is_some_and(|change| change > 1e-3));
    // a sensor that frames are pushed to has no next one, however long it may wait
    assert!(matches!(skin.sensor().unwrap().next_within(Duration::MAX).unwrap(), Next::Over));
}

/// A touch that was said to have ended, because no frame came, goes on as another one: its id is never used again.
#[test]
fn what_goes_on_after_its_end_is_another_touch() {
    let (skin, bench) = disc();
    let sent = frames(&held(&bench, 61));
    let model = LiveModel::new(&skin, 40, &mut Progress::silent()).unwrap();
    let mut stream =
        LiveStream::of_unit(Arc::new(model), Unit::Volt, Some(RATE_HZ)).without_images();
    let mut sent = sent.iter();
    let mut touched = |stream: &mut LiveStream| loop {
        stream.push(sent.next().unwrap(), false).unwrap();
        let touches = stream.shown().map_or(&[][..], |shown| shown.touches);
        if let [touch] = touches[..] {
            return touch;
        }
    };
    let before = touched(&mut stream);
    let last = stream.end().unwrap();
    assert_eq!((last.state, last.touches.len()), (SkinState::NoData, 1));
    let ended = last.touches[0];
    assert_eq!((ended.id, ended.state, ended.valid), (before.id, TouchState::End, false));
    assert!(stream.end().is_none() && stream.shown().is_none(), "said once");
    let after = touched(&mut stream);
    assert_eq!(after.state, TouchState::Begin);
    assert!(after.id > before.id, "{} after {}", after.id, before.id);
    let next = touched(&mut stream);
    assert_eq!((next.id, next.state), (after.id, TouchState::Hold));
}
