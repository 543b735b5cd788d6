//! Patches joined into a body: by messages with times that the test sets, and over zenoh.

use crate::common::{LIMIT, endpoint, frame, touch};
use eit_publish::body::{Body, BodyNews, BodySettings, BodyState, Origin, Placement};
use eit_publish::ros::{
    Attachment, BodyTouchArray, Header, MarkerArray, PoseStamped, TfMessage, Time, TouchArray,
    TouchMessage, from_cdr, skin_state, touch_state,
};
use eit_publish::{Publisher, SessionSettings, ZenohSettings, ZenohSink};
use eit_skin::{SkinState, Touch};
use std::time::{Duration, Instant};
use zenoh::Wait as _;

const FILE: &str = r#"
    frame = "torso"
    topic = "body"
    silent_after_s = 0.4
    [[patch]]
    name = "left"
    topic = "/skin/left"
    position_m = [1.0, 0.0, 0.0]
    rpy_deg = [0.0, 0.0, 90.0]
    [[patch]]
    name = "right"
    topic = "skin/right"
    position_m = [0.0, -2.0, 0.5]
"#;

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
}

/// A body whose time the test sets.
struct Bench {
    state: BodyState,
    start: Instant,
    /// State of the skin in the next messages.
    skin: SkinState,
}

impl Bench {
    fn new() -> Self {
        let start = Instant::now();
        let state = BodyState::new(&BodySettings::parse(FILE).unwrap(), start);
        Self { state, start, skin: SkinState::Sound }
    }

    fn at(&self, seconds: f64) -> Instant {
        self.start + Duration::from_secs_f64(seconds)
    }

    /// A message of a patch, sent at once; its publisher is known by a number.
    fn hear(
        &mut self,
        patch: usize,
        publisher: u8,
        sequence: i64,
        seconds: f64,
        touches: &[(u64, u8)],
    ) -> Option<BodyNews> {
        let touch = |&(id, state): &(u64, u8)| TouchMessage {
            id,
            state,
            position: [0.1, 0.0, 0.0].into(),
            velocity: [0.0, 0.2, 0.0].into(),
            position_covariance: [4.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 9.0],
            ..Default::default()
        };
        let stamp = Time::from_seconds(1e9 + seconds - 0.01);
        let message = TouchArray {
            header: Header { stamp, ..Default::default() },
            state: skin_state::number(self.skin),
            touches: touches.iter().map(touch).collect(),
            ..Default::default()
        };
        let time_ns = ((1e9 + seconds) * 1e9) as i64;
        let attachment = Attachment { sequence, time_ns, gid: [publisher; 16] };
        let origin = Origin { attachment, arrived: self.at(seconds), arrived_s: 1e9 + seconds };
        let mut news = Vec::new();
        self.state.receive(patch, &message, &origin, &mut news);
        assert!(news.len() < 2, "{news:?}");
        news.pop()
    }

    fn silences(&mut self, seconds: f64) -> Vec<BodyNews> {
        let mut news = Vec::new();
        let now = self.at(seconds);
        self.state.silences(now, &mut news);
        news
    }

    /// Patch, touch and state of the list.
    fn list(&mut self, seconds: f64) -> Vec<(usize, u64, u8)> {
        let list = self.state.list(1e9 + seconds);
        list.touches.iter().map(|t| (t.patch, t.touch.id, t.touch.state)).collect()
    }
}

/// Position, velocity and covariance turn with the patch; times are on one clock.
#[test]
fn touches_are_placed_on_the_robot() {
    let mut bench = Bench::new();
    bench.hear(0, 1, 1, 0.1, &[(5, touch_state::HOLD)]);
    bench.hear(1, 2, 1, 0.1, &[(5, touch_state::HOLD)]);
    let list = bench.state.list(1e9 + 0.2);
    let [left, right] = [0, 1].map(|index| list.touches[index]);
    assert!(near(left.touch.position.into(), [1.0, 0.1, 0.0]), "{left:?}");
    assert!(near(left.touch.velocity.into(), [-0.2, 0.0, 0.0]), "{left:?}");
    let covariance = left.touch.position_covariance;
    assert!(near([covariance[0], covariance[4], covariance[8]], [1.0, 4.0, 9.0]), "{left:?}");
    assert!(near(right.touch.position.into(), [0.1, -2.0, 0.5]), "{right:?}");
    assert!((left.time_s - (1e9 + 0.09)).abs() < 1e-6, "{}", left.time_s - 1e9);
    let message = bench.state.message(&list, bench.at(0.2));
    let names = (&*message.touches[0].patch, &*message.patches[1].name);
    assert_eq!((&*message.header.frame_id, names), ("torso", ("left", "right")));
}

/// Angles as in URDF: a quarter about x, then one about z, takes x to y, y to z and z to x.
#[test]
fn angles_are_those_of_urdf() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let placement = Placement::from_angles([0.0; 3], [quarter, 0.0, quarter]);
    let place = |placement: &Placement, position: [f64; 3]| -> [f64; 3] {
        let touch = TouchMessage { position: position.into(), ..Default::default() };
        placement.place(&touch).position.into()
    };
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert!((0..3).all(|k| near(place(&placement, axes[k]), axes[(k + 1) % 3])));
    let turned = place(&Placement::from_angles([0.0; 3], [0.0, 0.3, 0.0]), [1.0, 0.0, 0.0]);
    assert!(near(turned, [0.3_f64.cos(), 0.0, -(0.3_f64.sin())]), "{turned:?}");
    let half = Placement::new([0.0; 3], [0.0, 0.0, 2.0, 0.0]);
    assert_eq!(half.pose().orientation.z, 1.0, "of length 1");
}

/// Silent patches are named once, with their touches ended, and named again when they are back.
#[test]
fn silence_is_named_and_so_is_its_end() {
    let mut bench = Bench::new();
    assert_eq!(bench.hear(0, 1, 1, 0.1, &[(5, touch_state::HOLD)]), None);
    assert_eq!(bench.list(0.1), [(0, 5, touch_state::HOLD)]);
    assert_eq!(bench.silences(0.39), []);
    // the right patch was never heard
    let BodyNews::Silent { patch: 1, for_s, was_heard: false } = bench.silences(0.41)[0] else {
        panic!("the right patch is silent")
    };
    assert!((for_s - 0.41).abs() < 1e-9);
    let news = bench.silences(0.51);
    assert!(matches!(news[..], [BodyNews::Silent { patch: 0, was_heard: true, .. }]), "{news:?}");
    assert!(bench.state.has_changed(), "its touches have ended");
    assert_eq!(bench.list(0.51), [(0, 5, touch_state::END)]);
    assert_eq!(bench.list(0.52), []);
    assert_eq!(bench.silences(5.0), [], "named once");
    let Some(BodyNews::Back { patch: 0, after_s }) = bench.hear(0, 1, 2, 6.1, &[]) else {
        panic!("it is back")
    };
    assert!((after_s - 6.0).abs() < 1e-6, "{after_s}");
    let states = bench.state.states(bench.at(6.2));
    assert_eq!((states[0].silent, states[1].silent), (false, true));
    assert!((states[0].age - 0.1).abs() < 1e-6 && states[1].age.is_nan());
    // by default within half a second, looked for every 20 ms
    let default = BodySettings::parse(&FILE.replace("silent_after_s = 0.4", "")).unwrap();
    bench.state = BodyState::new(&default, bench.start);
    bench.hear(0, 1, 1, 0.1, &[]);
    let news = bench.silences(0.1 + 0.48);
    assert!(news.iter().any(|news| matches!(news, BodyNews::Silent { patch: 0, .. })), "{news:?}");
}

/// Gaps in a publisher's numbers are losses; a patch that is started anew begins anew; messages that come late
/// or twice change nothing.
#[test]
fn losses_are_counted() {
    let mut bench = Bench::new();
    [5, 6, 9, 9, 8, 10].iter().for_each(|sequence| _ = bench.hear(0, 1, *sequence, 0.1, &[]));
    bench.silences(0.6);
    [1, 3].iter().for_each(|sequence| _ = bench.hear(0, 2, *sequence, 0.6, &[]));
    let state = &bench.state.states(bench.at(0.1))[0];
    assert_eq!((state.received, state.lost), (6, 3));
}

/// A second publisher of a patch is named once, and listened to when the first is silent.
#[test]
fn two_publishers_are_named() {
    let mut bench = Bench::new();
    bench.hear(0, 1, 1, 0.1, &[(5, touch_state::HOLD)]);
    assert_eq!(bench.hear(0, 2, 1, 0.11, &[]), Some(BodyNews::TwoPublishers { patch: 0 }));
    assert_eq!(bench.hear(0, 2, 2, 0.12, &[]), None);
    assert_eq!(bench.list(0.13), [(0, 5, touch_state::HOLD)]);
    let status = |bench: &Bench, at_s: f64| bench.state.diagnostics(bench.at(at_s))[0].clone();
    let two = status(&bench, 0.13);
    assert!(two.level == 1 && two.message.starts_with("two programs"), "{}", two.message);
    bench.silences(0.6);
    assert_eq!(status(&bench, 0.6).message, "silent for 0.5 s");
    assert!(matches!(bench.hear(0, 2, 9, 0.6, &[]), Some(BodyNews::Back { .. })));
    assert_eq!(bench.list(0.61), [(0, 5, touch_state::END)]);
}

/// What is known of a patch is told when it changes, and listed.
#[test]
fn the_state_of_a_patch_is_told() {
    use SkinState::{Frozen, Sound};
    let mut bench = Bench::new();
    let told = [(Sound, None), (Frozen, Some(Frozen)), (Frozen, None), (Sound, Some(Sound))];
    for ((state, news), sequence) in told.into_iter().zip(1..) {
        bench.skin = state;
        let news = news.map(|state| BodyNews::State { patch: 0, state });
        assert_eq!(bench.hear(0, 1, sequence, 0.1, &[]), news);
        assert_eq!(bench.state.states(bench.at(0.1))[0].state, skin_state::number(state));
    }
}

/// The end of a touch is listed once, also where the next message came before the list.
#[test]
fn every_end_is_listed_once() {
    let mut bench = Bench::new();
    bench.hear(0, 1, 1, 0.1, &[(5, touch_state::BEGIN), (6, touch_state::HOLD)]);
    bench.hear(0, 1, 2, 0.11, &[(5, touch_state::END), (6, touch_state::HOLD)]);
    bench.hear(0, 1, 3, 0.12, &[(6, touch_state::HOLD)]);
    let mut list = bench.list(0.13);
    list.sort_unstable();
    assert_eq!(list, [(0, 5, touch_state::END), (0, 6, touch_state::HOLD)]);
    assert_eq!(bench.list(0.14), [(0, 6, touch_state::HOLD)]);
    assert!(!bench.state.has_changed());
    bench.hear(0, 1, 4, 0.15, &[(6, touch_state::END)]);
    assert!(bench.state.has_changed());
    assert_eq!(bench.list(0.16), [(0, 6, touch_state::END)]);
    assert_eq!(bench.list(0.17), []);
}

#[test]
fn files_that_cannot_be_are_refused() {
    let settings = BodySettings::parse(FILE).unwrap();
    assert_eq!((&*settings.patches[0].topic, &*settings.frame_id), ("skin/left", "torso"));
    let patch = |keys: &str| format!("[[patch]]\nname = \"a\"\ntopic = \"skin/a\"\n{keys}");
    for (text, wanted) in [
        (String::new(), "patch"),
        ("patch = []".to_owned(), "no patch"),
        (patch("colour = 3"), "colour"),
        (patch("") + &patch(""), "two patches are named a"),
        (patch("") + &patch("").replace("\"a\"", "\"b\""), "share the topic skin/a"),
        (patch("").replace("skin/a", "skin/2"), "patch a: topic"),
        (patch("quaternion = [0.0, 0.0, 0.0, 2.0]"), "length 2"),
        (patch("quaternion = [0.0, 0.0, 0.0, 1.0]\nrpy_deg = [0.0, 0.0, 0.0]"), "not both"),
        (patch("position_m = [nan, 0.0, 0.0]"), "finite"),
        (patch("position_m = [0.0, 0.0]"), "position_m"),
        (format!("silent_after_s = 0.0\n{}", patch("")), "silent_after_s = 0"),
        (format!("max_rate_hz = inf\n{}", patch("")), "max_rate_hz = inf"),
        (format!("topic = \"a b\"\n{}", patch("")), "topic: a b"),
        (format!("[zenoh]\nport = 3\n{}", patch("")), "port"),
    ] {
        let error = BodySettings::parse(&text).unwrap_err();
        assert!(error.contains(wanted), "{text}: {error}");
    }
    let error = BodySettings::load(std::path::Path::new("never.toml")).unwrap_err();
    assert!(error.is_input() && error.to_string().starts_with("never.toml: "), "{error}");
}

/// A body that listens, and its address.
fn listening(file: &str) -> (Body, BodySettings, String) {
    let mut settings = BodySettings::parse(file).unwrap();
    let address = endpoint();
    settings.session.listen = vec![address.clone()];
    (Body::open(&settings).unwrap(), settings, address)
}

fn patch(topic: &str, address: &str) -> Publisher {
    let mut settings = ZenohSettings::new(topic);
    settings.session = SessionSettings { connect: vec![address.to_owned()], ..Default::default() };
    Publisher::new().with_zenoh(ZenohSink::new(&settings).unwrap())
}

/// Waits for news that are wanted; the others are passed over, and between them something is done.
fn wait<T>(
    body: &mut Body,
    mut between: impl FnMut(),
    mut wanted: impl FnMut(BodyNews) -> Option<T>,
) -> T {
    let begun = Instant::now();
    loop {
        between();
        if let Some(found) = body.next(Duration::from_millis(10)).and_then(&mut wanted) {
            return found;
        }
        assert!(begun.elapsed() < LIMIT, "no such news");
    }
}

/// Two patches over zenoh: their touches in one list, and what a node of ROS 2 hears of it. That a patch ends and comes back
/// is tested by `body::by_zenoh::two_patches_and_a_body` of eit-cli.
#[test]
fn two_patches_by_zenoh() {
    let (mut body, _, address) = listening(&FILE.replace("silent_after_s = 0.4", ""));
    let (sender, heard) = std::sync::mpsc::channel();
    let node = SessionSettings { connect: vec![address.clone()], ..Default::default() };
    let node = node.open().unwrap();
    let keep = move |sample: zenoh::sample::Sample| {
        let _ = sender.send((sample.key_expr().to_string(), sample.payload().to_bytes().to_vec()));
    };
    let _all = node.declare_subscriber("0/**").callback(keep).wait().unwrap();
    let is_never_heard = |news: BodyNews| match news {
        BodyNews::Silent { patch: 0, was_heard: false, .. } => Some(()),
        _ => None,
    };
    wait(&mut body, || (), is_never_heard);

    let [mut left, mut right] = ["skin/left", "skin/right"].map(|topic| patch(topic, &address));
    let speak = || {
        left.touches(&frame(1, &[Touch { id: 3, ..touch() }], &[])).unwrap();
        right.touches(&frame(1, &[touch()], &[])).unwrap();
    };
    let list = wait(&mut body, speak, |news| match news {
        BodyNews::Touches(list) => Some(list).filter(|list| list.touches.len() == 2),
        _ => None,
    });
    let [a, b] = [0, 1].map(|patch| {
        let touch = &list.touches[patch].touch;
        (touch.id, <[f64; 3]>::from(touch.position))
    });
    assert!(a.0 == 3 && near(a.1, [1.01, 0.03, 0.0]), "{a:?}");
    assert!(b.0 == 7 && near(b.1, [0.03, -2.01, 0.5]), "{b:?}");
    // stamps of 2023 are those of a recording: the time of sending counts
    assert!((list.time_s - list.touches[0].time_s).abs() < 1.0);

    assert_eq!(body.name(1), "right");
    let states = body.patches();
    assert!(states.iter().all(|state| state.lost == 0 && state.received > 0), "{states:?}");
    assert_eq!(body.dropped(), [0, 0]);
    assert!(body.latency().unwrap().quantile_s(0.5).unwrap() < 0.5);

    // poses are published every second
    let (mut lists, mut poses, mut frames, mut markers) = (0, 0, 0, 0);
    let begun = Instant::now();
    while lists == 0 || poses == 0 || frames == 0 || markers == 0 {
        let all = [lists, poses, frames, markers];
        assert!(begun.elapsed() < LIMIT, "lists with two touches, poses, frames, markers: {all:?}");
        // whoever waits without a limit gets the next list, however long that limit is
        assert!(body.next(Duration::MAX).is_some());
        for (key, payload) in heard.try_iter() {
            if key.starts_with("0/body/touches/eit_skin_msgs::msg::dds_::BodyTouchArray_/RIHS01_") {
                let list: BodyTouchArray = from_cdr(&payload).unwrap();
                assert_eq!((&*list.header.frame_id, list.patches.len()), ("torso", 2));
                lists += usize::from(list.touches.len() == 2);
            } else if key.starts_with("0/skin/left/pose/") {
                let pose: PoseStamped = from_cdr(&payload).unwrap();
                assert_eq!((&*pose.header.frame_id, pose.pose.position.x), ("torso", 1.0));
                poses += 1;
            } else if key.starts_with("0/tf_static/") {
                let arm = &from_cdr::<TfMessage>(&payload).unwrap().transforms[0];
                assert_eq!((&*arm.header.frame_id, &*arm.child_frame_id), ("torso", "left"));
                assert_eq!(<[f64; 3]>::from(arm.translation), [1.0, 0.0, 0.0]);
                frames += 1;
            } else if key.starts_with("0/body/markers/") {
                markers += from_cdr::<MarkerArray>(&payload).unwrap().markers.len();
            }
        }
    }
}

/// Foxglove sees the touches of all patches, their frames, and what happens to them.
#[cfg(feature = "foxglove")]
#[test]
fn foxglove_is_shown_a_body() {
    use crate::foxglove_sink::{Client, decoded};
    use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
    let (mut body, settings, address) = listening(FILE);
    let mut shown = eit_publish::FoxgloveBody::new("127.0.0.1:0", &settings).unwrap();
    let mut client = Client::new(shown.address());
    client.subscribe(&["/body/scene", "/tf", "/body/log"]);
    let (over, is_over) = std::sync::mpsc::channel::<()>();
    let speaking = std::thread::spawn(move || {
        let mut left = patch("skin/left", &address);
        while is_over.try_recv().is_err() {
            left.touches(&frame(1, &[touch()], &[])).unwrap();
            if let Some(news) = body.next(Duration::from_millis(10)) {
                shown.show(&body, &news);
            }
        }
    });
    let begun = Instant::now();
    let (mut touched, mut frames, mut said) = (0, 0, String::new());
    while touched == 0 || frames == 0 || !said.contains("right: silent") {
        assert!(begun.elapsed() < LIMIT, "{touched} touches, {frames} frames, {said}");
        let (subscription, payload) = client.message();
        match subscription {
            0 => {
                let scene: SceneUpdate = decoded(&payload);
                let sphere = scene.entities[0].spheres.first();
                let at = sphere.map(|sphere| sphere.pose.unwrap().position.unwrap());
                touched +=
                    usize::from(at.is_some_and(|p| near([p.x, p.y, p.z], [1.01, 0.03, 0.0])));
            }
            1 => {
                let found: FrameTransforms = decoded(&payload);
                assert_eq!(found.transforms[1].child_frame_id, "right");
                frames += 1;
            }
            _ => said += &format!("{}; ", decoded::<Log>(&payload).message),
        }
    }
    over.send(()).unwrap();
    speaking.join().unwrap();
}

/// A patch of another version is named, not taken for a silent one alone.
#[test]
fn messages_that_cannot_be_read_are_named() {
    let (mut body, _, address) = listening(FILE);
    let other = SessionSettings { connect: vec![address], ..Default::default() }.open().unwrap();
    let hash = eit_publish::ros::type_hash("eit_skin_msgs/msg/TouchArray").unwrap();
    let speak = || {
        for (patch, hash) in [("left", "RIHS01_0"), ("right", hash.as_str())] {
            let name = "eit_skin_msgs::msg::dds_::TouchArray_";
            other.put(format!("0/skin/{patch}/touches/{name}/{hash}"), vec![1, 2]).wait().unwrap();
        }
    };
    let reason = wait(&mut body, speak, |news| match news {
        BodyNews::Unreadable { patch: 0, reason } => Some(reason),
        BodyNews::Unreadable { patch, reason } => {
            assert!(patch == 1 && reason.contains("attachment"), "{reason}");
            None
        }
        _ => None,
    });
    assert!(reason.contains("RIHS01_0"), "{reason}");
}
