//! Ids, births, ends and velocities of detected touches, on synthetic detections.

use eit_inverse::touch::{DetectedTouch, Touch, TouchState, TouchTracker, TrackerSettings};
use fixtures::Random;

const DT_S: f64 = 0.05;

/// Strength from which a touch is reported at once, S m^2.
const STRONG: f64 = 6e-6;
const WEAK: f64 = 0.5 * STRONG;

fn touch(x_m: f64, y_m: f64, strength_s_m2: f64) -> DetectedTouch {
    DetectedTouch {
        position_m: [x_m, y_m, 0.0],
        normal: [0.0, 0.0, 1.0],
        position_covariance_m2: [[1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0; 3]],
        strength_s_m2,
        strength_std_s_m2: 0.01 * STRONG,
        peak_s: strength_s_m2 / 1.5e-4,
        worth: 5.0,
        learnt: None,
    }
}

/// A tracker and its clock.
struct Bench {
    tracker: TouchTracker,
    frame: u32,
}

impl Bench {
    fn new(change: impl Fn(&mut TrackerSettings)) -> Self {
        let mut settings = TrackerSettings::with_strong(STRONG);
        change(&mut settings);
        Self { tracker: TouchTracker::new(settings).unwrap(), frame: 0 }
    }

    fn push(&mut self, found: &[DetectedTouch]) -> Vec<Touch> {
        self.frame += 1;
        self.tracker.push(found, DT_S * f64::from(self.frame), true).unwrap().to_vec()
    }

    fn push_unseen(&mut self) -> Vec<Touch> {
        self.frame += 1;
        self.tracker.push_unseen(DT_S * f64::from(self.frame)).unwrap().to_vec()
    }
}

/// Returns the only touch.
fn only(touches: &[Touch]) -> Touch {
    let [touch] = touches else { panic!("{touches:?}") };
    *touch
}

fn ids(touches: &[Touch]) -> Vec<u64> {
    touches.iter().map(|touch| touch.id).collect()
}

/// Id, state and validity of the only touch.
fn only_state(touches: &[Touch]) -> (u64, TouchState, bool) {
    let touch = only(touches);
    (touch.id, touch.state, touch.valid)
}

#[test]
fn more_touches_than_fit_are_refused() {
    let seventeen: Vec<_> = (0..17).map(|k| touch(0.1 * f64::from(k), 0.0, WEAK)).collect();
    let mut bench = Bench::new(|_| ());
    bench.push(&seventeen[..16]);
    let mut untroubled = bench.tracker.clone();
    let refused = bench.tracker.push(&seventeen, 1.0, true);
    refused!(refused, TooManyTouches { found: 17, most: 16 });
    // unchanged: the second frame of weak touches names as many as allowed
    let touches = bench.tracker.push(&seventeen[..16], 1.0, true).unwrap();
    assert_eq!(touches.len(), 8);
    assert_eq!(touches, untroubled.push(&seventeen[..16], 1.0, true).unwrap());
    // settings that allow more touches have room for more
    let mut roomy = Bench::new(|settings| settings.max_touches = 20);
    assert!(roomy.tracker.push(&seventeen, 1.0, true).is_ok());
}

/// A touch is reported when it has been shown often enough, with age 0; at once if it is strong and known to four of
/// its standard deviations, or weak but worth enough and known well enough. One whose strength is below three quarters
/// of its standard deviation is not to be acted on. Once born, it continues, weak or not.
#[test]
fn births_need_strength_or_evidence_and_precision() {
    let (strong, nan) = (2.0 * STRONG, f64::NAN);
    // after how many frames; how many it must be shown in by the settings; strength, its deviation, worth; is it valid?
    for (after, birth_frames, strength_s_m2, strength_std_s_m2, worth, valid) in [
        (1, 1, WEAK, 0.01 * STRONG, 5.0, true),
        (2, 2, WEAK, 0.01 * STRONG, 5.0, true),
        (4, 4, WEAK, 0.01 * STRONG, 5.0, true),
        (1, 10, STRONG, 0.01 * STRONG, 5.0, true),
        (1, 10, -STRONG, 0.01 * STRONG, 5.0, true),
        (1, 2, WEAK, 0.24 * WEAK, 8.0, true),
        (2, 2, WEAK, 0.24 * WEAK, 7.9, true),
        (2, 2, WEAK, 0.26 * WEAK, 80.0, true),
        (1, 2, strong, 0.49 * STRONG, 5.0, true),
        (2, 2, strong, 0.51 * STRONG, 5.0, true),
        (2, 2, strong, 2.6 * STRONG, 5.0, true),
        (2, 2, strong, 2.7 * STRONG, 5.0, false),
        (2, 2, strong, nan, 5.0, false),
    ] {
        let case = format!("{birth_frames} {strength_s_m2:e} {strength_std_s_m2:e} {worth}");
        let mut bench = Bench::new(|settings| settings.birth_frames = birth_frames);
        let found = DetectedTouch { strength_std_s_m2, worth, ..touch(0.0, 0.1, strength_s_m2) };
        (1..after).for_each(|_| assert!(bench.push(&[found]).is_empty(), "{case}"));
        let born = bench.push(&[found]);
        assert_eq!(only_state(&born), (1, TouchState::Begin, valid), "{case}");
        assert_eq!((born[0].age_frames, born[0].age_s), (0, 0.0), "{case}");
        assert!(after > 1 || born[0].intensity_s_m2 == strength_s_m2, "{case}");
        let next = only(&bench.push(&[touch(0.0, 0.1, WEAK)]));
        assert_eq!((next.id, next.state, next.age_frames), (1, TouchState::Hold, 1), "{case}");
        assert!((next.age_s - DT_S).abs() < 1e-12, "{case}");
    }
}

/// Frames of which nothing is known neither end a touch nor keep it valid, for half a second.
#[test]
fn touches_are_held_while_nothing_is_known() {
    let mut bench = Bench::new(|_| ());
    bench.push(&[touch(0.02, 0.0, STRONG)]);
    for _ in 0..5 {
        assert_eq!(only_state(&bench.push_unseen()), (1, TouchState::Hold, false));
    }
    assert_eq!(only_state(&bench.push(&[touch(0.02, 0.0, STRONG)])), (1, TouchState::Hold, true));
    let frames = 0..2 + (0.5 / DT_S) as u32;
    let touches: Vec<Touch> = frames.flat_map(|_| bench.push_unseen()).collect();
    let (last, held) = touches.split_last().unwrap();
    assert_eq!(last.state, TouchState::End);
    assert!(held.iter().all(|touch| touch.state == TouchState::Hold));
    assert!(bench.push_unseen().is_empty());
}

/// A missing touch stays for the forgiven frames as not valid, ends once and is gone.
#[test]
fn forgiven_frames_then_the_end() {
    for forgiven in [0, 1, 3] {
        let mut bench = Bench::new(|settings| settings.forgiven_frames = forgiven);
        bench.push(&[touch(0.02, 0.0, STRONG)]);
        for missed in 0..forgiven {
            assert_eq!(only_state(&bench.push(&[])), (1, TouchState::Hold, false), "{missed}");
        }
        let end = bench.push(&[]);
        assert_eq!(only_state(&end), (1, TouchState::End, false), "{forgiven}");
        assert_eq!(end[0].intensity_s_m2, STRONG);
        assert!(bench.push(&[]).is_empty());
        // ids are never reused, nor by a tracker that continues them
        assert_eq!(only(&bench.push(&[touch(0.02, 0.0, STRONG)])).id, 2);
        let mut next = Bench::new(|_| ());
        next.tracker.set_next_id(bench.tracker.next_id());
        assert_eq!(only(&next.push(&[touch(0.02, 0.0, STRONG)])).id, 3);
        // reported positions are on the skin, wherever the filter is
        next.tracker.place(|[x, y, z]| [x.min(0.01), y, z]);
        assert_eq!(only(next.tracker.touches()).position_m, [0.01, 0.0, 0.0]);
    }
}

/// A touch that is missed while it moves is followed on; its end is where it was seen last.
#[test]
fn the_end_is_where_it_was_seen() {
    let mut bench = Bench::new(|settings| settings.forgiven_frames = 3);
    let seen = (0..20).map(|k| only(&bench.push(&[touch(2e-3 * f64::from(k), 0.0, STRONG)])));
    let seen = seen.last().unwrap();
    for _ in 0..3 {
        let held = only(&bench.push(&[]));
        assert!(!held.valid && held.position_m[0] > seen.position_m[0] + 1e-3, "{held:?}");
    }
    let end = only(&bench.push(&[]));
    assert_eq!((end.state, end.position_m), (TouchState::End, seen.position_m));
}

/// At rest, and for a touch that reappears where it would have moved to.
#[test]
fn numbers_are_kept_through_gaps() {
    for speed_m_s in [0.0, 0.3] {
        let mut bench = Bench::new(|settings| settings.forgiven_frames = 2);
        for frame in 0..40_u32 {
            let found = [touch(speed_m_s * DT_S * f64::from(frame), 0.0, STRONG)];
            let is_gap = frame % 10 >= 8;
            let held = only(&bench.push(if is_gap { &[] } else { &found }));
            assert_eq!((held.id, held.age_frames, held.valid), (1, u64::from(frame), !is_gap));
        }
    }
}

/// Two fingers that pass each other at 12 mm, listed in either order, keep their ids.
#[test]
fn numbers_are_kept_through_a_crossing() {
    let mut bench = Bench::new(|_| ());
    for frame in 0..41 {
        let x_m = 0.2 * DT_S * f64::from(frame - 20);
        let mut found = [touch(x_m, 6e-3, STRONG), touch(-x_m, -6e-3, 1.5 * STRONG)];
        // the first has id 1
        if frame % 2 == 1 {
            found.swap(0, 1);
        }
        let touches = bench.push(&found);
        assert_eq!(ids(&touches), [1, 2], "{frame}");
        for (touch, y_m) in touches.iter().zip([6e-3, -6e-3]) {
            let is_there = (touch.position_m[1] - y_m).abs() < 1e-9;
            assert!(touch.valid && is_there, "{frame}: {touch:?}");
        }
    }
}

#[test]
fn beyond_the_gate_is_another_touch() {
    for (way_m, wanted) in [(39e-3, &[1][..]), (41e-3, &[1, 2])] {
        let mut bench = Bench::new(|_| ());
        bench.push(&[touch(0.0, 0.0, STRONG)]);
        assert_eq!(ids(&bench.push(&[touch(way_m, 0.0, STRONG)])), wanted, "{way_m}");
    }
}

/// There are never more named touches than the limit; the next one is named when one has ended.
#[test]
fn the_most_is_kept() {
    let mut bench = Bench::new(|settings| settings.max_touches = 2);
    let three = [0.0, 0.1, 0.2].map(|x_m| touch(x_m, 0.0, STRONG));
    (0..5).for_each(|_| assert_eq!(ids(&bench.push(&three)), [1, 2]));
    assert_eq!(ids(&bench.push(&three[1..])), [1, 2]);
    // the first ends, the third takes its place
    let touches = bench.push(&three[1..]);
    assert_eq!(ids(&touches), [1, 2, 3]);
    assert_eq!((touches[0].state, touches[2].state), (TouchState::End, TouchState::Begin));
}

#[test]
fn time_that_goes_back_is_refused() {
    let mut bench = Bench::new(|_| ());
    let found = [touch(0.0, 0.0, STRONG)];
    bench.tracker.push(&found, 5.0, true).unwrap();
    let mut untroubled = bench.tracker.clone();
    for time_s in [5.0, 4.9, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let refused = bench.tracker.push(&found, time_s, true);
        refused!(refused, TimeOrder { frame: 1, time_s: found, before_s: 5.0 }
            if found.total_cmp(&time_s).is_eq());
    }
    assert_eq!(bench.tracker.push(&[], 5.1, false), untroubled.push(&[], 5.1, false));
    assert!(!only(bench.tracker.touches()).whole);
}

/// A point in steady motion, measured without error, has its velocity. At 5 mm a frame, 4 standard deviations of
/// a measured place, it may still have come to rest, with a probability of 0.003: that share of a frame's way
/// (0.015 mm), and two or three times that share of the velocity, are missing. At 25 mm a frame the least probability
/// of a rest is left, 1e-6. One that comes to rest soon has no velocity.
#[test]
fn velocity_of_a_steady_point() {
    let steady = |speed_m_s: f64, place_error_m: f64, velocity_part: f64| {
        let mut bench = Bench::new(|settings| settings.gate_m = 0.1);
        let velocity_m_s = [0.8 * speed_m_s, -0.6 * speed_m_s, 0.0];
        let at = |frame: u32| velocity_m_s.map(|v| v * DT_S * f64::from(frame));
        for [x_m, y_m, _] in (0..30).map(at) {
            bench.push(&[touch(x_m, y_m, STRONG)]);
        }
        let found = only(bench.tracker.touches());
        for (i, velocity_m_s) in velocity_m_s.iter().enumerate() {
            let velocity_error_m_s = (found.velocity_m_s[i] - velocity_m_s).abs();
            assert!(velocity_error_m_s < velocity_part * speed_m_s, "{found:?}");
            assert!((found.position_m[i] - at(29)[i]).abs() < place_error_m, "{found:?}");
        }
        (bench, at(29))
    };
    steady(0.5, 3e-8, 3e-6);
    let (mut bench, [x_m, y_m, _]) = steady(0.1, 2e-5, 0.01);
    // the filter forgets a velocity within about ten frames
    (0..30).for_each(|_| _ = bench.push(&[touch(x_m, y_m, STRONG)]));
    let rest = only(bench.tracker.touches());
    assert!(rest.velocity_m_s.iter().all(|v| v.abs() < 1e-3), "{rest:?}");
}

/// Confidence rises with worth, age and relative precision of the strength; strength alone does not matter.
#[test]
fn confidence_rises_with_worth_age_and_certainty() {
    let confidences_of = |worth: f64, strength_s_m2: f64, part: f64| -> Vec<f64> {
        let mut bench = Bench::new(|_| ());
        let strength_std_s_m2 = part * strength_s_m2;
        let found = DetectedTouch { worth, strength_std_s_m2, ..touch(0.0, 0.0, strength_s_m2) };
        (0..6).map(|_| only(&bench.push(&[found])).confidence).collect()
    };
    let confidences = |worth, strength_s_m2| confidences_of(worth, strength_s_m2, 0.1);
    let worths = [1.0, 1.8, 2.5, 5.0, 20.0, 200.0];
    let all = worths.map(|worth| confidences(worth, STRONG));
    for (worth, of) in worths.iter().zip(&all) {
        assert!(of.iter().all(|c| (0.0..=1.0).contains(c)), "{worth}: {of:?}");
        assert!(of[..4].windows(2).all(|pair| pair[1] > pair[0]), "{worth}: {of:?}");
        assert!(of[3..].windows(2).all(|pair| pair[1] == pair[0]), "{worth}: {of:?}");
        // four times as strong: the same to the last digit
        assert_eq!(of, &confidences(*worth, 4.0 * STRONG));
    }
    let parts = [0.2, 0.1, 0.05, 0.01].map(|part| confidences_of(5.0, STRONG, part));
    for pair in all.windows(2).chain(parts.windows(2)) {
        assert!(pair[0].iter().zip(&pair[1]).all(|(less, more)| more > less), "{pair:?}");
    }
    // a strength of unknown precision: reported with the second frame, and no id is lost
    let mut bench = Bench::new(|_| ());
    let unknown = DetectedTouch { strength_std_s_m2: f64::INFINITY, ..touch(0.0, 0.0, STRONG) };
    bench.push(&[unknown]);
    let confidence = only(&bench.push(&[unknown])).confidence;
    assert!(confidence > 0.5 && confidence < parts[0][0], "{confidence}");
}

/// Touches come, go and jump while old ones are forgiven for long, and fill all available room: never more
/// than the most are reported, in order, and nothing is allocated from the first frame on.
#[test]
fn crowds_neither_exceed_the_most_nor_allocate() {
    let mut bench = Bench::new(|settings| settings.forgiven_frames = 20);
    let mut random = Random::new(1);
    for frame in 0..400 {
        let found: Vec<DetectedTouch> = (0..random.below(17))
            .map(|_| touch(random.between(-1.0, 1.0), random.between(-1.0, 1.0), STRONG))
            .collect();
        let time_s = DT_S * f64::from(frame);
        let info = allocation_counter::measure(|| {
            bench.tracker.push(&found, time_s, true).unwrap();
        });
        assert_eq!(info.count_total, 0, "{frame}: {info:?}");
        let touches = bench.tracker.touches();
        assert!(touches.iter().filter(|t| t.state != TouchState::End).count() <= 8);
        assert!(touches.windows(2).all(|pair| pair[0].id < pair[1].id));
    }
}
