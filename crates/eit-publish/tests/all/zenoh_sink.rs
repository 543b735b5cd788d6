//! A skin by zenoh on the loopback interface, as a subscriber gets it.

use crate::common::{FAULTS, LIMIT, endpoint, frame, shape, start, touch, wait_for};
use eit_publish::ros::{
    Attachment, DiagnosticArray, ElectrodeFaultMessage, Image, MarkerArray, OccupancyGrid,
    PoseStamped, TouchArray, from_cdr, skin_state, touch_state, type_hash,
};
use eit_publish::{
    PublishError, Publisher, SessionSettings, SkinImage, SkinShape, ZenohSettings, ZenohSink,
};
use eit_skin::eit_hw::driver::Event;
use eit_skin::ndarray::array;
use eit_skin::{SkinState, Touch, TouchFrame, TouchState};
use serde::de::DeserializeOwned;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use zenoh::Wait as _;
use zenoh::sample::{Sample, SampleKind};

/// What a program hears below a key.
struct Listener {
    samples: Receiver<Sample>,
    _subscriber: zenoh::pubsub::Subscriber<()>,
}

impl Listener {
    fn new(session: &zenoh::Session, key: &str) -> Self {
        let (sender, samples) = channel();
        // an error is the end of the test
        let keep = move |sample| _ = sender.send(sample);
        let subscriber = session.declare_subscriber(key.to_owned()).callback(keep).wait().unwrap();
        Self { samples, _subscriber: subscriber }
    }

    fn next(&self) -> Sample {
        self.samples.recv_timeout(LIMIT).expect("a message")
    }
}

fn settings(connect: &[&str], listen: &[&str]) -> SessionSettings {
    let own = |endpoints: &[&str]| endpoints.iter().map(|&text| text.to_owned()).collect();
    SessionSettings { connect: own(connect), listen: own(listen), ..Default::default() }
}

/// A skin in domain 3 that connects to an address.
fn publisher(address: &str, change: impl FnOnce(&mut ZenohSettings)) -> Publisher {
    let mut wanted = ZenohSettings::new("/skin/arm");
    wanted.frame_id = "left_arm".to_owned();
    wanted.domain = 3;
    wanted.session = settings(&[address], &[]);
    change(&mut wanted);
    let mut publisher = Publisher::new().with_zenoh(ZenohSink::new(&wanted).unwrap());
    publisher.skin(&SkinShape { extent_m: [-0.15, 0.15, -0.1, 0.1], ..shape() }).unwrap();
    publisher.start(&start()).unwrap();
    publisher
}

/// A session that listens, and a skin that connects to it.
fn connected(change: impl FnOnce(&mut ZenohSettings)) -> (zenoh::Session, Publisher) {
    let address = endpoint();
    (settings(&[], &[&address]).open().unwrap(), publisher(&address, change))
}

fn message<M: DeserializeOwned>(sample: &Sample) -> M {
    from_cdr(&sample.payload().to_bytes()).unwrap()
}

fn attachment(sample: &Sample) -> Attachment {
    Attachment::from_bytes(&sample.attachment().unwrap().to_bytes()).unwrap()
}

/// Publishes until it is heard: sessions find each other in their own time.
fn until(listener: &Listener, mut publish: impl FnMut()) -> Sample {
    let begun = Instant::now();
    loop {
        publish();
        if let Ok(sample) = listener.samples.recv_timeout(Duration::from_millis(50)) {
            return sample;
        }
        assert!(begun.elapsed() < LIMIT, "nothing is heard");
    }
}

/// Publishes an untouched frame until it is heard.
fn until_heard(publisher: &mut Publisher, listener: &Listener) -> Sample {
    until(listener, || publisher.touches(&frame(0, &[], &[])).unwrap())
}

fn key(topic: &str, package: &str, name: &str) -> String {
    let hash = type_hash(&format!("{package}/msg/{name}")).unwrap();
    format!("3/{topic}/{package}::msg::dds_::{name}_/{hash}")
}

/// Every frame arrives once, in order, with the key, payload and attachment that ROS 2 expects.
#[test]
fn a_subscriber_gets_every_frame() {
    let (session, mut publisher) = connected(|settings| settings.change = None);
    let listener = Listener::new(&session, "3/skin/arm/touches/**");
    let first = until_heard(&mut publisher, &listener);
    assert_eq!(first.key_expr().as_str(), key("skin/arm/touches", "eit_skin_msgs", "TouchArray"));
    // those that were sent before it was known that one is heard
    std::thread::sleep(Duration::from_millis(200));
    let mut last = listener.samples.try_iter().last().unwrap_or(first);
    let touches = [touch(), Touch { id: 8, state: TouchState::Begin, ..touch() }];
    for sequence in 1..=200 {
        publisher.touches(&frame(sequence, &touches, &FAULTS)).unwrap();
        // 1 000 a second
        std::thread::sleep(Duration::from_millis(1));
    }
    for sequence in 1..=200 {
        let sample = listener.next();
        let (before, now) = (attachment(&last), attachment(&sample));
        assert_eq!((now.sequence, now.gid), (before.sequence + 1, before.gid));
        assert!(now.time_ns >= before.time_ns && now.time_ns > 1_700_000_000_000_000_000);
        let message: TouchArray = message(&sample);
        assert_eq!((message.sequence, message.whole), (sequence, false));
        assert!(message.epoch > 1_700_000_000, "{}", message.epoch);
        assert_eq!(message.header.frame_id, "left_arm");
        assert_eq!(message.header.stamp.seconds(), 1.7e9 + 0.25);
        assert_eq!((message.time, message.latency), (2.0, 2e-3));
        let fault = ElectrodeFaultMessage { electrode: 5, kind: 1, since: 1.5 };
        assert_eq!(message.faulty_electrodes, [fault]);
        let [hold, begin] = [0, 1].map(|index| message.touches[index]);
        assert_eq!((hold.id, hold.state, begin.id, begin.state), (7, 1, 8, 0));
        assert_eq!(<[f64; 3]>::from(hold.position), [0.03, -0.01, 0.0]);
        assert_eq!((hold.position_covariance[0], hold.position_covariance[4]), (4e-6, 1e-6));
        assert!(hold.force.is_nan() && hold.force_std.is_nan() && hold.likeness == 0);
        assert_eq!((hold.intensity, hold.intensity_std), (2.5e-11, 1e-12));
        assert_eq!((hold.valid, hold.whole, hold.merged_into), (true, false, 3));
        last = sample;
    }
    let frozen = TouchFrame { state: SkinState::Frozen, ..frame(201, &touches, &FAULTS) };
    publisher.touches(&frozen).unwrap();
    let state = message::<TouchArray>(&listener.next()).state;
    assert_eq!(state, skin_state::number(SkinState::Frozen));
    publisher.end().unwrap();
    let statistics = publisher.zenoh()[0].statistics();
    assert_eq!((statistics.dropped_frames, publisher.zenoh()[0].sent().1), (0, 0));
    // a last list ends the touches, once
    let last: TouchArray = message(&listener.next());
    assert!(last.touches.iter().all(|touch| touch.state == touch_state::END && !touch.valid));
    assert_eq!(last.state, skin_state::number(SkinState::NoData));
    assert!(listener.samples.try_recv().is_err(), "nothing twice");
}

/// Images and markers are made and sent once somebody subscribes to them; NaN outside the skin stays NaN. A map has the size of the
/// skin, and no colour for changes that no touch is faint enough for.
#[test]
fn images_are_sent_to_who_subscribes() {
    let (session, mut publisher) = connected(|_| ());
    let maps = Listener::new(&session, "3/skin/arm/map/**");
    let markers = Listener::new(&session, "3/skin/arm/markers/**");
    let images = Listener::new(&session, &key("skin/arm/image", "sensor_msgs", "Image"));
    let drawn = until(&markers, || publisher.touches(&frame(1, &[touch()], &FAULTS)).unwrap());
    let drawn: MarkerArray = message(&drawn);
    assert_eq!((drawn.markers.len(), drawn.markers[1].header.frame_id.as_str()), (3, "left_arm"));
    wait_for("a subscriber of images is not seen", || publisher.wants_image());
    assert!(publisher.takes_images() && publisher.has_viewer());
    assert!((0..50).any(|_| !publisher.wants_image()), "the last one is not old enough");
    let change_s = array![[1e-6, f64::NAN, 0.0], [-2e-6, 0.5e-6, 0.0]];
    let mut show = || {
        let image = SkinImage { faintest_s: 1e-5, ..change_s.view().into() };
        publisher.image(image).unwrap();
    };
    let map: OccupancyGrid = message(&until(&maps, &mut show));
    assert_eq!((map.width, map.height, map.resolution), (3, 2, 0.1));
    let corner: [f64; 3] = map.origin.position.into();
    assert_eq!((corner, map.data.as_slice()), ([-0.15, -0.1, 0.0], &[20, 5, 0, 10, -1, 0][..]));
    let image: Image = message(&until(&images, &mut show));
    assert_eq!((image.height, image.width, image.step), (2, 3, 12));
    assert_eq!((image.encoding.as_str(), image.header.frame_id.as_str()), ("32FC1", "left_arm"));
    let values: Vec<f32> =
        image.data.chunks(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
    assert!(values[1].is_nan());
    assert_eq!((values[0], values[3], values[4]), (1e-6, -2e-6, 0.5e-6));
    publisher.end().unwrap();
}

/// Diagnostics say what is wrong, and the pose where the skin is.
#[test]
fn diagnostics_name_faults_and_silence() {
    let pose = Some(("base_link".to_owned(), Default::default()));
    let (session, mut publisher) = connected(|settings| settings.pose = pose);
    let listener = Listener::new(&session, "3/**");
    until_heard(&mut publisher, &listener);
    let topic = key("skin/arm/pose", "geometry_msgs", "PoseStamped");
    let mut samples = std::iter::from_fn(|| Some(listener.next()));
    let pose = samples.find(|sample| sample.key_expr().as_str() == topic).unwrap();
    let pose: PoseStamped = message(&pose);
    assert_eq!((pose.header.frame_id.as_str(), pose.pose.orientation.w), ("base_link", 1.0));
    let topic = key("diagnostics", "diagnostic_msgs", "DiagnosticArray");
    let status = |level: u8, word: &str, speak: &mut dyn FnMut()| {
        let mut found = None;
        wait_for(word, || {
            speak();
            let samples = listener.samples.try_iter().filter(|s| s.key_expr().as_str() == topic);
            let mut status = samples.map(|s| message::<DiagnosticArray>(&s).status.remove(0));
            found = status.find(|status| status.level == level && status.message.contains(word));
            found.is_some()
        });
        found.unwrap()
    };
    let mut speak = || publisher.touches(&frame(1, &[], &FAULTS)).unwrap();
    let faulty = status(1, "faulty", &mut speak);
    let said = [&*faulty.message, &faulty.name, &faulty.hardware_id];
    assert_eq!(said, ["faulty electrodes: 5", "skin/arm: EIT skin arm", "a \"board\"\nof 16"]);
    // then no frame for more than a second
    publisher.event(&Event::Disconnected { reason: "unplugged".into() }).unwrap();
    let silent = status(3, "unplugged", &mut || ()).message;
    let (seconds, _) = silent.strip_prefix("no frame for ").unwrap().split_once(" s: ").unwrap();
    assert!(seconds.parse::<f64>().unwrap() >= 1.0, "{seconds}");
}

/// An untouched skin sends ten messages a second instead of two hundred; a touch is sent at once, and one that
/// does not change waits for the heartbeat.
#[test]
fn only_changes_and_heartbeats_are_published() {
    let (session, mut publisher) = connected(|_| ());
    let listener = Listener::new(&session, "3/skin/arm/touches/**");
    until_heard(&mut publisher, &listener);
    std::thread::sleep(Duration::from_millis(200));
    listener.samples.try_iter().for_each(drop);
    for touches in [&[][..], &[touch()]] {
        let begun = Instant::now();
        for sequence in 1..=200 {
            publisher.touches(&frame(sequence, touches, &[])).unwrap();
            std::thread::sleep(Duration::from_millis(5));
        }
        let seconds = begun.elapsed().as_secs_f64();
        std::thread::sleep(Duration::from_millis(200));
        let messages: Vec<TouchArray> = listener.samples.try_iter().map(|s| message(&s)).collect();
        // heartbeats are at most ten a second, and fewer where this computer is busy
        let most = (seconds / 0.0995).ceil() as usize + 1 + touches.len();
        assert!((5..=most).contains(&messages.len()), "{} in {seconds} s", messages.len());
        let first = messages.iter().find(|message| message.touches.len() == touches.len());
        assert!(touches.is_empty() || first.unwrap().sequence == 1, "a touch is sent at once");
    }
}

/// Through a router, as nodes of ROS 2 reach each other; the tokens are what `ros2 topic list` shows.
#[test]
fn a_router_forwards_messages_and_tokens() {
    let address = endpoint();
    let mut config = zenoh::Config::default();
    let listen = format!("[\"{address}\"]");
    let keys = ["mode", "listen/endpoints", "scouting/multicast/enabled"];
    for (key, value) in keys.into_iter().zip(["\"router\"", &listen, "false"]) {
        config.insert_json5(key, value).unwrap();
    }
    let router = zenoh::open(config).wait().unwrap();
    let session = settings(&[&address], &[]).open().unwrap();
    let (sender, tokens) = channel();
    let _graph = session
        .liveliness()
        .declare_subscriber("@ros2_lv/3/**")
        .callback(move |sample| _ = sender.send((sample.kind(), sample.key_expr().to_string())))
        .wait()
        .unwrap();
    let listener = Listener::new(&session, "3/skin/arm/touches/**");
    let mut publisher = publisher(&address, |_| ());
    let sample = until_heard(&mut publisher, &listener);
    assert_eq!(message::<TouchArray>(&sample).header.frame_id, "left_arm");
    let token = || tokens.recv_timeout(LIMIT).expect("a token");
    let mut announced: Vec<(SampleKind, String)> = (0..6).map(|_| token()).collect();
    announced.sort_by_key(|(_, token)| token.split('/').nth(4).unwrap().parse::<u32>().unwrap());
    let wanted = [
        ("NN", ""),
        ("MP", "%skin%arm%touches"),
        ("MP", "%skin%arm%markers"),
        ("MP", "%skin%arm%image"),
        ("MP", "%skin%arm%map"),
        ("MP", "%diagnostics"),
    ];
    for ((kind, token), (entity, topic)) in announced.iter().zip(wanted) {
        let parts: Vec<&str> = token.split('/').collect();
        let found = (*kind, parts[5], *parts.get(9).unwrap_or(&""));
        assert_eq!(found, (SampleKind::Put, entity, topic), "{token}");
        assert!(token.contains("/%/%/eit_skin_arm"), "{token}");
    }
    // both hear of another program that publishes the same, and of its end
    let rivals = |publisher: &Publisher| publisher.zenoh()[0].rivals();
    assert_eq!(rivals(&publisher), 0);
    let other = self::publisher(&address, |_| ());
    wait_for("the other", || rivals(&publisher) == 1 && rivals(&other) == 1);
    drop(other);
    wait_for("the end of the other", || rivals(&publisher) == 0);
    // the end of the program takes the tokens back
    drop(tokens.try_iter().last());
    drop(publisher);
    assert_eq!(token().0, SampleKind::Delete);
    router.close().wait().unwrap();
}

/// Nobody listens, or nobody is there: frames cost no time, and the end comes soon.
#[test]
fn frames_do_not_wait_for_the_network() {
    let mut publisher = publisher(&endpoint(), |settings| settings.change = None);
    let begun = Instant::now();
    let touches = [touch(); 5];
    for sequence in 0..20_000 {
        publisher.touches(&frame(sequence, &touches, &FAULTS)).unwrap();
    }
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    let begun = Instant::now();
    publisher.end().unwrap();
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    let statistics = publisher.zenoh()[0].statistics();
    let (sent, refused) = publisher.zenoh()[0].sent();
    // and the list that ends the touches
    assert_eq!(statistics.frames, 20_001);
    // diagnostics are messages, too
    assert!(sent + refused + statistics.dropped_frames >= 20_000, "{sent} {statistics:?}");
}

#[test]
fn names_and_endpoints_that_are_none_are_refused() {
    let error = ZenohSink::new(&ZenohSettings::new("skin/2 arms")).unwrap_err();
    assert!(matches!(error, PublishError::Topic { .. }) && error.is_input(), "{error}");
    let mut wanted = ZenohSettings::new("skin");
    for endpoint in ["127.0.0.1:7447", "carrier-pigeon/127.0.0.1:1", "tls/127.0.0.1:1"] {
        wanted.session = settings(&[], &[endpoint]);
        let error = ZenohSink::new(&wanted).unwrap_err();
        assert!(matches!(error, PublishError::Zenoh { .. }) && error.is_input(), "{error}");
    }
    wanted.session = SessionSettings { config: Some("never.json5".into()), ..Default::default() };
    assert!(ZenohSink::new(&wanted).unwrap_err().is_input());
}
