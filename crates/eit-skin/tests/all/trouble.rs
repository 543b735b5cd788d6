//! What a robot is told when the instrument or a contact is in trouble: frame by frame, through [`Sensor`].

use crate::common::*;
use eit_skin::eit_hw::driver::Event;
use eit_skin::eit_hw::{Frame, Unit};
use eit_skin::live::{LiveModel, LiveStream, SkinState, TouchFrame};
use eit_skin::ndarray::Array2;
use eit_skin::scene::{ElectrodeSettings, Scene, SkinSettings, ValueKind};
use eit_skin::{Next, Progress, Sensor, Skin, Touch, TouchState};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

/// Where the finger of [`held`] presses.
const AT: [f64; 2] = [0.04, 0.02];

/// One finger that is held for four seconds from 0.1 s after the quiet frames on, and then nothing for a second.
fn held(bench: &Bench) -> Recording {
    bench.simulate(&Drawn::new(57, 1).hold(AT, 1.25, 3.9).script(), 57)
}

/// The same on the paper's disc.
static HELD: LazyLock<Recording> = LazyLock::new(|| held(&PAPER));

static DISC: LazyLock<Skin> = LazyLock::new(|| skin(&Scene::load("paper-disc").unwrap()));

fn skin(scene: &Scene) -> Skin {
    let mut skin = Skin::from_scene(scene.clone()).unwrap();
    skin.settings.recording.frame_rate_hz = Some(RATE_HZ);
    skin
}

fn sensor() -> Sensor {
    DISC.sensor().unwrap()
}

fn stream() -> LiveStream {
    let model = LiveModel::new(&DISC, QUIET_FRAMES, &mut Progress::silent()).unwrap();
    LiveStream::of_unit(Arc::new(model), Unit::Volt, Some(RATE_HZ)).without_images()
}

fn frames(values: &Array2<f64>) -> Vec<Frame> {
    let frame = |(k, row): (usize, eit_skin::ndarray::ArrayView1<'_, f64>)| Frame {
        device_time_s: Some(k as f64 / RATE_HZ),
        ..Frame::new(k as u64, row.to_vec())
    };
    values.outer_iter().enumerate().map(frame).collect()
}

fn sent() -> Vec<Frame> {
    frames(&HELD.values)
}

#[derive(Debug)]
struct Output {
    frame: usize,
    /// Those to act on.
    touches: Vec<Touch>,
    faults: Vec<usize>,
    whole: bool,
    state: SkinState,
}

impl Output {
    fn of(shown: &TouchFrame<'_>) -> Self {
        let acted_on = |touch: &&Touch| touch.valid && touch.state != TouchState::End;
        Self {
            frame: shown.sequence as usize,
            touches: shown.touches.iter().filter(acted_on).copied().collect(),
            faults: shown.faults.iter().map(|fault| fault.electrode).collect(),
            whole: shown.whole,
            state: shown.state,
        }
    }
}

fn output(sensor: &mut Sensor, frames: &[Frame]) -> Vec<Output> {
    let shown = |frame: &Frame| sensor.push(frame).unwrap().map(|shown| Output::of(&shown));
    frames.iter().filter_map(shown).collect()
}

/// Frames in which the finger is shown, where nothing else may be.
fn found(output: &[Output]) -> Vec<usize> {
    let mut touches = output.iter().flat_map(|output| &output.touches);
    assert!(touches.all(|touch| off_m(touch, AT) <= 0.025), "{output:?}");
    output.iter().filter(|output| !output.touches.is_empty()).map(|output| output.frame).collect()
}

fn within(output: &[Output], first: usize, end: usize) -> impl Iterator<Item = &Output> {
    output.iter().filter(move |output| (first..end).contains(&output.frame))
}

/// Touches of a sensor's frames, and what else it says, until its source is over; `is_over` is set after the set-up.
fn drain(sensor: &mut Sensor, is_over: &AtomicBool) -> (Vec<(u64, String)>, Vec<String>) {
    let (mut touches, mut others) = (Vec::new(), Vec::new());
    loop {
        match sensor.next_within(Duration::MAX).unwrap() {
            Next::Frame(frame) => touches.push((frame.sequence, format!("{:?}", frame.touches))),
            Next::Waiting { left } => {
                is_over.fetch_or(left == 0, Ordering::Relaxed);
                others.push(format!("{left} left, {} for reference", sensor.reference().len()));
            }
            Next::Event(event) => others.push(format!("{event:?}")),
            Next::Over => return (touches, others),
            Next::Nothing => panic!("nothing, at {:?}", touches.last()),
        }
    }
}

fn is_touched((_, touches): &(u64, String)) -> bool {
    touches != "[]"
}

/// Touches, faults and states of a sensor that these frames are pushed to.
fn told(frames: &[Frame]) -> Vec<Output> {
    output(&mut sensor(), frames)
}

/// The first frame in which an electrode is named.
fn named(output: &[Output]) -> (usize, &[usize]) {
    let named = output.iter().find(|output| !output.faults.is_empty()).unwrap();
    (named.frame, &named.faults)
}

/// An instrument that sends one frame again and again says nothing of the skin; the finger of that frame ends.
#[test]
fn a_frozen_instrument_is_reported() {
    let mut sent = sent();
    let old = sent[70].values.clone();
    sent[70..].iter_mut().for_each(|frame| frame.values.clone_from(&old));
    let output = told(&sent);
    // from the tenth equal frame on
    for output in &output {
        assert_eq!(output.state == SkinState::Frozen, output.frame >= 79, "{output:?}");
        assert!(output.frame < 79 || !output.whole, "{output:?}");
    }
    let found = found(&output);
    assert!(found.last().is_some_and(|last| (78..80).contains(last)), "{found:?}");
}

/// Zeros of an instrument that starts again are neither faulty electrodes for long nor the end of a finger's touch.
#[test]
fn an_outage_does_not_swallow_a_finger() {
    let mut sent = sent();
    sent[70..78].iter_mut().for_each(|frame| frame.values.fill(0.0));
    let output = told(&sent);
    // electrodes are used again after a second
    let is_found = |output: &Output| output.touches.len() == 1 && output.faults.is_empty();
    assert!(within(&output, 102, 110).all(is_found), "{output:?}");
    found(&output);
}

/// An electrode that does not conduct any more is named without a reciprocal measurement; the finger goes on.
#[test]
fn a_lost_electrode_is_named_without_reciprocity() {
    for drive in ["opposite", "skip-3"] {
        let text = with_drive(drive);
        let scene = |more: &str| Scene::parse(&(text.clone() + more), "scene").unwrap();
        let (sound, lost) = (scene(""), scene("\n[fabric.instrument]\nlost = [5]\n"));
        let [before, after] = [&sound, &lost]
            .map(|measured| frames(&held(&Bench::believing(measured, &sound)).values));
        // quiet, and under the finger
        for from in [44, 70] {
            let sent = [&before[..from], &after[from..]].concat();
            let output = output(&mut skin(&sound).sensor().unwrap(), &sent);
            let (frame, faults) = named(&output);
            assert!(frame <= from + 4 && faults == [4], "{frame}: {faults:?}");
            let is_held = |output: &Output| output.touches.len() == 1 && !output.whole;
            assert!(within(&output, 75, 100).all(is_held), "{output:?}");
            found(&output);
        }
    }
}

/// A contact steps by two percent under a finger: it is named, and the finger goes on without its measurements.
#[test]
fn a_step_under_a_finger_is_named() {
    for (electrode, gain) in [(2, 0.98), (3, 1.02), (9, 0.98), (9, 1.02)] {
        let mut sent = sent();
        let involved = PAPER.measurements_of(electrode);
        sent[70..].iter_mut().for_each(|f| involved.iter().for_each(|i| f.values[*i] *= gain));
        let output = told(&sent);
        let (frame, faults) = named(&output);
        assert!(frame <= 72 && faults == [electrode], "{frame}: {faults:?}");
        let is_found = |output: &Output| output.touches.len() == 1;
        assert!(within(&output, 73, 120).all(is_found), "{electrode} {gain}: {output:?}");
        found(&output);
    }
}

/// A contact that opens and closes changes all voltages reciprocally, and the reference follows it; closing is no touch.
#[test]
fn a_loose_contact_is_no_touch() {
    let loose = "\n[fabric.instrument]\nloose = [3]\nloose_rate_hz = 0.1\nloose_time_s = 3.0\n";
    let loose = Scene::parse(&(Scene::text("paper-disc").unwrap() + loose), "loose").unwrap();
    let bench = Bench::believing(&loose, &Scene::load("paper-disc").unwrap());
    let (mut shown, mut unexplained) = (0, 0);
    for seed in [1, 2, 7] {
        let mut script = Drawn::new(seed, 0).script();
        script.frames = 600;
        let output = told(&frames(&bench.simulate(&script, seed).values));
        shown += output.iter().filter(|output| !output.touches.is_empty()).count();
        unexplained += output.iter().filter(|output| output.state != SkinState::Sound).count();
    }
    // of 1 680 frames; none are measured
    assert!(shown <= 20 && unexplained > 0, "{shown} {unexplained}");
}

/// The reference leaves out frames of another kind and waits while a hand is on the skin.
#[test]
fn the_reference_is_that_of_an_untouched_skin() {
    let sound = sent();
    let check = |sent: &[Frame], note: &str| {
        let mut sensor = sensor();
        let found = found(&output(&mut sensor, sent));
        assert!(found.len() > 40, "{note}: {found:?}");
        assert!(sensor.notes().iter().any(|said| said.contains(note)), "{:?}", sensor.notes());
    };
    let mut sent = sound.clone();
    for (frame, edit) in [(8, 0.0), (10, 10.0), (12, f64::NAN)] {
        sent[frame].values.iter_mut().for_each(|v| *v *= edit);
    }
    check(&sent, "3 frames left out");
    // a finger that lifts while the reference is taken: what comes after it is the reference
    let mut sent = [&sound[100..], &sound].concat();
    for (k, frame) in sent.iter_mut().enumerate() {
        (frame.sequence, frame.device_time_s) = (k as u64, Some(k as f64 / RATE_HZ));
    }
    check(&sent, "later");
}

/// Another connection, whose clock and numbers begin at 0, has its own reference; the time of the session goes on.
#[test]
fn another_connection_takes_a_reference() {
    let (mut sensor, mut counts, mut last_s) = (sensor(), [0; 2], f64::NEG_INFINITY);
    for (epoch, count) in (0..).zip(&mut counts) {
        for (k, mut frame) in sent().into_iter().enumerate() {
            // another gain of each channel
            let gain = |i: usize| 1.0 + 0.03 * ((i * 7919 % 13) as f64 / 13.0 - 0.5);
            if epoch > 0 {
                frame.values.iter_mut().enumerate().for_each(|(i, v)| *v *= gain(i));
            }
            let Some(shown) = sensor.push(&Frame { epoch, ..frame }).unwrap() else { continue };
            assert!(k >= QUIET_FRAMES - 1 && shown.epoch == epoch, "{k} of epoch {epoch}");
            assert!(shown.time_s > last_s, "{} s after {last_s} s", shown.time_s);
            last_s = shown.time_s;
            *count += found(&[Output::of(&shown)]).len();
        }
    }
    assert!(counts[0] > 40 && counts[0].abs_diff(counts[1]) <= 2, "{counts:?}");
}

/// A reference that is told consists of exactly those frames, as if a program had set it; some that are missing are
/// noted, and where hardly any came another is taken. Each thing is told once, and then the source is over.
#[test]
fn a_reference_is_the_one_that_is_told() {
    let sent = sent();
    let is_told = |frame: &&Frame| frame.sequence < 40 && frame.sequence.is_multiple_of(2);
    let told: Vec<Frame> = sent.iter().filter(is_told).cloned().collect();
    let of = |missing: std::ops::Range<u64>| {
        let sequences = told.iter().map(|frame| frame.sequence).collect();
        let reference = Event::Reference { epoch: 0, sequences, until: None };
        let came = sent.iter().filter(|frame| !missing.contains(&frame.sequence)).cloned();
        let source = Listed::new(std::iter::once(reference).chain(came.map(Event::Frame)));
        let mut sensor = DISC.sensor_of(Box::new(source), false).unwrap();
        let (touches, others) = drain(&mut sensor, &AtomicBool::new(false));
        assert!(others[0].starts_with("Reference"), "{}", others[0]);
        let none_left = others.iter().position(|said| said.starts_with("0 left"));
        assert_eq!(none_left, Some(others.len() - 1));
        (touches, sensor.notes().join("\n"), sensor.reference().len())
    };
    let (touches, notes, count) = of(0..0);
    assert!(notes.is_empty() && count == 20, "{notes}");
    let mut sensor = sensor();
    assert!(sensor.set_reference(&told[..3]).is_err());
    sensor.set_reference(&told).unwrap();
    for (frame, (sequence, wanted)) in sent[39..].iter().zip(&touches) {
        let found = sensor.push(frame).unwrap().unwrap();
        assert_eq!((found.sequence, &format!("{:?}", found.touches)), (*sequence, wanted));
    }
    assert!(touches.len() == sent.len() - 39 && touches.iter().any(is_touched));

    for (missing, note, wanted) in [(9..12, "1 of the 20", 19), (0..35, "18 of the 20", 40)] {
        let (_, notes, count) = of(missing);
        assert!(notes.contains(&format!("{note} reference frames")) && count == wanted, "{notes}");
    }
}

/// Functions of the voltage are named from the untouched skin; with that in the scene the same finger is found.
#[test]
fn values_that_are_no_voltages_are_named_and_converted() {
    let wanted = found(&told(&sent())).len();
    for (kind, of) in [
        (ValueKind::Reciprocal, (|v: f64| 1e3 / v.abs()) as fn(f64) -> f64),
        (ValueKind::Decibel, |v| 20.0 * v.abs().log10()),
        (ValueKind::Squared, |v| v * v),
    ] {
        let mut sent = sent();
        sent.iter_mut().flat_map(|frame| &mut frame.values).for_each(|v| *v = of(*v));
        let mut blind = sensor();
        output(&mut blind, &sent);
        let (notes, named) = (blind.notes(), format!("values = \"{}\"", kind.name().0));
        assert!(notes.iter().any(|note| note.contains(&named)), "{notes:?}");
        let mut skin = DISC.clone();
        skin.settings.recording.values = kind;
        let mut sensor = skin.sensor().unwrap();
        let shown = output(&mut sensor, &sent);
        let mut touches = shown.iter().flat_map(|output| &output.touches);
        assert!(touches.all(|touch| off_m(touch, AT) < 0.01), "{kind:?}: {shown:?}");
        let notes = sensor.notes();
        assert!(!notes.iter().any(|note| note.contains("values =")), "{notes:?}");
        let converted = found(&shown).len();
        assert!(converted.abs_diff(wanted) <= 3, "{kind:?}: {converted}, {wanted} of voltages");
    }
}

/// While the detector is set up, live frames are not searched; those of a recording are, but for those it tells.
#[test]
fn live_frames_do_not_wait_for_the_set_up() {
    const LAST: u64 = 42;
    let run = |told: Option<Event>, is_live: bool| {
        let is_over = Arc::new(AtomicBool::new(false));
        let frames = sent().into_iter().map(Event::Frame);
        let source = Listed::new(told.into_iter().chain(frames)).held_at(LAST, &is_over);
        let mut sensor = DISC.sensor_of(Box::new(source), is_live).unwrap();
        let (touches, others) = drain(&mut sensor, &is_over);
        let waits = |said: &&String| {
            said.ends_with("for reference") && !said.starts_with("0 left") && !said.contains(" 0 ")
        };
        (touches, others.iter().filter(waits).count() as u64)
    };
    let (touches, _) = run(None, true);
    assert_eq!(touches[0].0, LAST + 1);
    assert!(touches.iter().filter(|touches| is_touched(touches)).count() > 40);
    let told = |until| Event::Reference { epoch: 0, sequences: (0..40).collect(), until };
    let (replayed, waited) = run(Some(told(Some(LAST))), false);
    // the frames between the reference and the last one
    assert!(replayed == touches && waited == LAST - 40 + 1, "{waited}");
    assert_eq!(run(Some(told(None)), false).0[0].0, 40);
}

/// Nothing from before is shown, no id used twice. A `first_frame` of the scene's recording is no obstacle.
#[test]
fn a_new_reference_forgets_touches_and_continues_their_ids() {
    let mut skin = DISC.clone();
    skin.settings.recording.first_frame = Some(30);
    let (mut sensor, mut last) = (skin.sensor().unwrap(), 0);
    for round in 0..2 {
        let mut ids = Vec::new();
        for frame in &sent() {
            let touches = sensor.push(frame).unwrap().map(|shown| shown.touches.to_vec());
            assert_eq!(sensor.shown().is_some(), touches.is_some(), "round {round}");
            ids.extend(touches.iter().flatten().map(|touch| touch.id));
        }
        assert!(*ids.iter().min().unwrap() > last, "round {round}: {ids:?} after {last}");
        last = *ids.iter().max().unwrap();
        sensor.restart();
        assert!(sensor.shown().is_none());
    }
    let error = LiveModel::new(&skin, 1 << 60, &mut Progress::silent()).unwrap_err().to_string();
    assert!(error.contains("there must be"), "{error}");
}

/// A frame at full scale, or too large by a factor, even a small one that touches might explain, costs itself only.
#[test]
fn a_damaged_frame_costs_itself_only() {
    let sound = found(&told(&sent()));
    let full_v = 1.25 * HELD.largest_v();
    let damaged = [(None, 60), (Some(10.0), 75), (Some(1.3), 90), (Some(1.1), 105), (None, 115)];
    let mut sent = sent();
    for (factor, at) in damaged {
        let damage = |v: &mut f64| *v = factor.map_or(full_v, |factor| factor * *v);
        sent[at].values.iter_mut().for_each(damage);
    }
    let output = told(&sent);
    let left = found(&output);
    for (factor, at) in damaged {
        let missing = sound.iter().filter(|k| (at + 1..at + 10).contains(*k) && !left.contains(k));
        assert!(missing.count() <= 1, "{factor:?} at {at}: {left:?}");
    }
    let missing = sound.iter().filter(|frame| !left.contains(frame)).count();
    assert!(missing <= 2 * damaged.len(), "{missing}: {left:?}");
    assert!(output.iter().all(|output| output.faults.is_empty()), "{output:?}");
}

/// So few measurements that a gain fits much of any touch: no electrode is blamed for one, nothing is shown elsewhere.
#[test]
fn eight_electrodes_on_a_long_skin() {
    let electrodes = ElectrodeSettings::equally_spaced(8, 0.01, 1e3);
    let scene = Scene::new(SkinSettings::rectangle(0.3, 0.06, 1e-5), electrodes);
    let (skin, bench) = (skin(&scene), Bench::believing(&scene, &scene));
    for seed in [2, 3] {
        let recording = bench.simulate(&bench.script("tapping", seed), seed);
        let mut seen = 0;
        for shown in output(&mut skin.sensor().unwrap(), &frames(&recording.values)) {
            assert!(shown.faults.is_empty(), "seed {seed}: {shown:?}");
            for touch in &shown.touches {
                let mut fingers = recording.truth.iter().filter(|t| t.frame == shown.frame);
                let is_there = fingers.any(|finger| off_m(touch, finger.position_m) < 0.03);
                assert!(is_there, "seed {seed}: {shown:?}");
                seen += 1;
            }
        }
        assert!(seen >= 10, "seed {seed}: {seen}");
    }
}

/// What is reported is on the skin. (The filter is beyond the rim in 16 of 868 rows.)
#[test]
fn touches_are_on_the_skin() {
    let electrodes = ElectrodeSettings::equally_spaced(8, 0.01, 200.0);
    let mut scene = Scene::new(SkinSettings::rectangle(0.1, 0.07, 1e-4), electrodes);
    scene.protocol.drive = Some("opposite".to_owned());
    scene.protocol.current_a = Some(1e-3);
    let bench = Bench::believing(&scene, &scene);
    let touches = bench.touches(&bench.simulate(&bench.script("two-fingers", 34), 34));
    assert!(touches.rows.len() > 50, "{}", touches.rows.len());
    for row in &touches.rows {
        let [x, y, _] = row.touch.position_m;
        // rounding
        assert!(x.abs() <= 0.05 + 1e-9 && y.abs() <= 0.035 + 1e-9, "frame {}: {x} {y}", row.frame);
    }
}

/// Electrodes of which nothing comes are named, and touches go on; a damaged frame does not enter the reference.
#[test]
fn what_is_wrong_from_the_start_is_named() {
    let sound = PAPER.touches(&HELD);
    for value in [0.0, f64::NAN, 1.25] {
        let mut broken = HELD.clone();
        PAPER.measurements_of(5).iter().for_each(|i| broken.values.column_mut(*i).fill(value));
        let touches = PAPER.touches(&broken);
        let faulty: Vec<usize> = touches.faults.iter().map(|fault| fault.electrode).collect();
        assert_eq!(faulty, [5], "{value}");
        assert!(touches.rows.iter().all(|row| !row.touch.whole), "{value}");
        let output = told(&frames(&broken.values));
        assert!(output.iter().all(|output| !output.whole && output.faults == [5]), "{value}");
        assert!(touches.frames_with_touch() + 3 >= sound.frames_with_touch(), "{value}");
    }
    let mut damaged = HELD.clone();
    damaged.values.row_mut(3).fill(0.0);
    let notes = PAPER.fit(&damaged).frames.notes;
    assert!(notes.iter().any(|note| note.starts_with("1 frame left out")), "{notes:?}");
    assert_eq!(PAPER.touches(&damaged).frames_with_touch(), sound.frames_with_touch());
    assert!(sound.not_explained.is_empty() && sound.frozen.is_empty());
}

/// Users of a live stream are told when the voltages are not those of the scene.
#[test]
fn a_reference_of_another_level_is_reported() {
    for (factor, is_reported) in [(1.0, false), (3.0, true)] {
        let mut stream = stream();
        for mut frame in sent().into_iter().take(QUIET_FRAMES) {
            assert!(stream.notes().is_empty(), "{:?}", stream.notes());
            frame.values.iter_mut().for_each(|v| *v *= factor);
            stream.push(&frame, false).unwrap();
        }
        let notes = stream.notes().join("\n");
        for words in ["voltages are 3.0", "strengths (intensity)", "1e-3 for millivolts"] {
            assert_eq!(notes.contains(words), is_reported, "{notes}");
        }
    }
}

#[test]
fn a_reference_that_waits_says_why() {
    let mut stream = stream();
    // the finger comes within the first forty frames
    for frame in &sent()[20..62] {
        stream.push(frame, false).unwrap();
    }
    assert!(stream.unrest().is_some_and(|change| change > 1e-3));
    // a sensor that frames are pushed to has no next one, however long it may wait
    assert!(matches!(sensor().next_within(Duration::MAX).unwrap(), Next::Over));
}

/// A touch that was said to have ended, because no frame came, goes on as another one.
#[test]
fn what_goes_on_after_its_end_is_another_touch() {
    let (mut stream, mut sent) = (stream(), sent().into_iter());
    let mut touched = |stream: &mut LiveStream| loop {
        stream.push(&sent.next().unwrap(), false).unwrap();
        if let Some([touch]) = stream.shown().map(|shown| shown.touches) {
            return *touch;
        }
    };
    let before = touched(&mut stream);
    let last = stream.end().unwrap();
    assert_eq!((last.state, last.touches.len()), (SkinState::NoData, 1));
    let ended = last.touches[0];
    assert_eq!((ended.id, ended.state, ended.valid), (before.id, TouchState::End, false));
    assert!(stream.end().is_none() && stream.shown().is_none(), "said once");
    let [after, next] = [0; 2].map(|_| touched(&mut stream));
    assert!(after.id > before.id, "{} after {}", after.id, before.id);
    assert_eq!((after.state, next.state, next.id), (TouchState::Begin, TouchState::Hold, after.id));
}
