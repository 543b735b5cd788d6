//! A skin for Foxglove, as a client of its WebSocket protocol and a reader of its recordings get it.

use crate::common::{FAULTS, LIMIT, frame, shape, start, touch};
use eit_publish::{FoxgloveSettings, FoxgloveSink, PublishError, Publisher};
use eit_skin::eit_hw::driver::Event;
use eit_skin::ndarray::array;
use eit_skin::{LearntTouch, SkinState, Touch, TouchFrame, TouchState};
use foxglove::Decode;
use foxglove::messages::{Grid, Log, SceneUpdate};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

pub(crate) fn decoded<T: Decode>(bytes: &[u8]) -> T {
    T::decode(bytes).unwrap_or_else(|_| panic!("a message"))
}

/// Everything that a recording holds, by topic and schema.
fn recorded(path: &std::path::Path) -> BTreeMap<(String, String), Vec<Vec<u8>>> {
    let bytes = std::fs::read(path).unwrap();
    let mut topics = BTreeMap::<_, Vec<_>>::new();
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        let schema = message.channel.schema.as_ref().unwrap();
        let encodings = (&*schema.encoding, &*message.channel.message_encoding);
        assert_eq!(encodings, ("protobuf", "protobuf"));
        let key = (message.channel.topic.clone(), schema.name.clone());
        topics.entry(key).or_default().push(message.data.into_owned());
    }
    topics
}

#[test]
fn a_recording_holds_scene_image_and_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skin.mcap");
    let (topic, frame_id) = ("/arm/".into(), "left_arm".into());
    let settings =
        FoxgloveSettings { server: None, recording: Some(path.clone()), topic, frame_id };
    let sink = FoxgloveSink::new(&settings).unwrap();
    assert_eq!(sink.address(), None);
    let mut publisher = Publisher::new().with_foxglove(sink);
    assert!(publisher.takes_images() && publisher.has_viewer());
    publisher.skin(&shape()).unwrap();
    publisher.start(&start()).unwrap();
    let learnt = Some(LearntTouch { force_n: Some([1.5, 0.1]), is_unlike: false });
    let touches = [
        touch(),
        Touch { id: 8, valid: false, learnt, velocity_m_s: [0.0; 3], ..touch() },
        Touch { id: 9, state: TouchState::End, ..touch() },
    ];
    publisher.touches(&frame(1, &touches, &FAULTS)).unwrap();
    publisher.image(array![[1e-6, f64::NAN], [-2e-6, 0.0]].view()).unwrap();
    publisher.event(&Event::Disconnected { reason: "unplugged".into() }).unwrap();
    publisher.touches(&TouchFrame { state: SkinState::Frozen, ..frame(2, &[], &[]) }).unwrap();
    publisher.end().unwrap();
    assert_eq!(publisher.foxglove().unwrap().statistics().dropped_frames, 0);
    // a second program does not write over it
    let error = FoxgloveSink::new(&settings).unwrap_err();
    assert!(matches!(error, PublishError::Foxglove { .. }) && error.is_input(), "{error}");

    let topics = recorded(&path);
    let names: Vec<(&str, &str)> = topics.keys().map(|(topic, of)| (&**topic, &**of)).collect();
    let wanted = [
        ("/arm/image", "foxglove.Grid"),
        ("/arm/log", "foxglove.Log"),
        ("/arm/scene", "foxglove.SceneUpdate"),
    ];
    assert_eq!(names, wanted);
    let [images, logs, scene] = topics.values().collect::<Vec<_>>()[..] else { panic!() };
    let scene: Vec<SceneUpdate> = scene.iter().map(|bytes| decoded(bytes)).collect();
    let outline = &scene[0].entities[0];
    assert_eq!((outline.id.as_str(), outline.frame_id.as_str()), ("skin", "left_arm"));
    assert_eq!((outline.lines.len(), outline.lines[0].points.len()), (9, 4));
    let shown = &scene[1].entities[0];
    // two touches and one faulty electrode; the touch that ended is not drawn
    assert_eq!((shown.id.as_str(), shown.spheres.len(), shown.arrows.len()), ("touches", 3, 1));
    let labels: Vec<&str> = shown.texts.iter().map(|text| text.text.as_str()).collect();
    assert_eq!(labels, ["7", "8 1.5 N"]);
    let position = shown.spheres[0].pose.as_ref().unwrap().position.as_ref().unwrap();
    assert_eq!((position.x, position.y, position.z), (0.03, -0.01, 0.0));
    let electrode = shown.spheres[2].pose.as_ref().unwrap().position.as_ref().unwrap();
    assert!((electrode.x - 0.085).abs() < 1e-12, "the middle of electrode 5: {}", electrode.x);
    // along x, as the velocity
    let arrow = shown.arrows[0].pose.as_ref().unwrap().orientation.as_ref().unwrap();
    assert_eq!((arrow.w, arrow.z), (1.0, 0.0));
    assert!((shown.arrows[0].shaft_length - 0.01).abs() < 1e-12);

    let grid: Grid = decoded(&images[0]);
    assert_eq!((grid.column_count, grid.row_stride, grid.cell_stride), (2, 16, 8));
    let size = grid.cell_size.as_ref().unwrap();
    assert_eq!((size.x, size.y), (0.1, 0.05));
    let bytes = |cell: usize, from: usize| &grid.data[8 * cell + from..8 * cell + from + 4];
    let value = |cell| f32::from_le_bytes(bytes(cell, 0).try_into().unwrap());
    // the first row of a grid is the lowest
    assert_eq!((value(0), value(1), value(2)), (-2e-6, 0.0, 1e-6));
    assert!(value(3).is_nan());
    let colour = |cell| bytes(cell, 4);
    assert_eq!((colour(0), colour(1)), (&[0, 0, 255, 255][..], &[255, 255, 255, 255][..]));
    assert_eq!((colour(2)[0], colour(2)[3], colour(3)), (255, 255, &[0; 4][..]));

    let said = [("no data", 3), ("unplugged", 4), ("repeats an old frame", 3)];
    for (place, (word, level)) in said.into_iter().enumerate() {
        let log: Log = decoded(&logs[place]);
        assert!(log.message.contains(word) && log.level == level, "{log:?}");
    }
    let frozen = &scene.last().unwrap().entities[0];
    assert_eq!(frozen.texts[0].text, "Not known: the instrument repeats an old frame");
}

/// A client of the protocol `foxglove.sdk.v1`, as little of it as a test needs.
pub(crate) struct Client(TcpStream);

impl Client {
    pub(crate) fn new(address: std::net::SocketAddr) -> Self {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        let request = format!(
            "GET / HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
             Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            head.push(0);
            let last = head.len() - 1;
            stream.read_exact(&mut head[last..]).unwrap();
        }
        assert!(head.starts_with(b"HTTP/1.1 101 "), "{}", String::from_utf8_lossy(&head));
        Self(stream)
    }

    /// Subscribes to topics, with their places as numbers.
    pub(crate) fn subscribe(&mut self, topics: &[&str]) {
        let channels = loop {
            let (_, content) = self.next();
            let said: Value = serde_json::from_slice(&content).unwrap();
            if said["op"] == "advertise" {
                break said["channels"].as_array().unwrap().clone();
            }
        };
        for (place, topic) in topics.iter().enumerate() {
            let channel = channels.iter().find(|channel| channel["topic"] == *topic);
            let subscription = json!({ "id": place, "channelId": channel.expect(topic)["id"] });
            self.say(&json!({ "op": "subscribe", "subscriptions": [subscription] }));
        }
    }

    /// Number of the subscription and content of the next message.
    pub(crate) fn message(&mut self) -> (usize, Vec<u8>) {
        loop {
            let (kind, content) = self.next();
            if kind == 2 && content[0] == 1 {
                // a message: subscription, time, payload
                let number = u32::from_le_bytes(content[1..5].try_into().unwrap());
                return (number as usize, content[13..].to_vec());
            }
        }
    }

    /// Kind (1: text, 2: binary) and content of the next frame (RFC 6455, section 5.2).
    fn next(&mut self) -> (u8, Vec<u8>) {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).unwrap();
        let mut length = u64::from(head[1] & 0x7f);
        if length >= 126 {
            let mut bytes = [0; 8];
            let count = if length == 126 { 2 } else { 8 };
            self.0.read_exact(&mut bytes[8 - count..]).unwrap();
            length = u64::from_be_bytes(bytes);
        }
        let mut content = vec![0; length as usize];
        self.0.read_exact(&mut content).unwrap();
        (head[0] & 0x0f, content)
    }

    fn say(&mut self, value: &Value) {
        let text = value.to_string();
        assert!(text.len() < 126);
        // masked with zeros
        let head = [0x81, 0x80 | text.len() as u8, 0, 0, 0, 0];
        self.0.write_all(&[&head[..], text.as_bytes()].concat()).unwrap();
    }
}

#[test]
fn a_client_sees_the_skin_live() {
    let settings = FoxgloveSettings { server: Some("127.0.0.1:0".into()), ..Default::default() };
    let sink = FoxgloveSink::new(&settings).unwrap();
    let address = sink.address().unwrap();
    assert!(address.ip().is_loopback() && address.port() != 0);
    let mut publisher = Publisher::new().with_foxglove(sink);
    assert!(!publisher.has_viewer() && !publisher.wants_image(), "nobody looks");
    publisher.skin(&shape()).unwrap();
    publisher.start(&start()).unwrap();
    let mut client = Client::new(address);
    client.subscribe(&["/skin/scene", "/skin/image"]);
    let (over, is_over) = std::sync::mpsc::channel::<()>();
    let speaking = std::thread::spawn(move || {
        let mut sequence = 0;
        while is_over.try_recv().is_err() {
            sequence += 1;
            publisher.touches(&frame(sequence, &[touch()], &[])).unwrap();
            if publisher.wants_image() {
                publisher.image(array![[1e-6, f64::NAN]].view()).unwrap();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        publisher
    });
    let begun = Instant::now();
    let (mut outlines, mut touches, mut images) = (0, 0, 0);
    while outlines < 2 || touches < 10 || images < 5 {
        assert!(begun.elapsed() < LIMIT, "{outlines} outlines, {touches} touches, {images} images");
        let (subscription, payload) = client.message();
        if subscription == 1 {
            assert_eq!(decoded::<Grid>(&payload).column_count, 2);
            images += 1;
            continue;
        }
        let scene: SceneUpdate = decoded(&payload);
        match scene.entities[0].id.as_str() {
            "skin" => outlines += 1,
            _ => touches += scene.entities[0].spheres.len(),
        }
    }
    over.send(()).unwrap();
    let mut publisher = speaking.join().unwrap();
    let begun = Instant::now();
    publisher.end().unwrap();
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    assert_eq!(publisher.foxglove().unwrap().statistics().dropped_frames, 0);
}

#[test]
fn addresses_that_are_none_or_taken_are_named() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap().to_string();
    for address in ["8765", "", "a b:1", &taken] {
        let settings = FoxgloveSettings { server: Some(address.into()), ..Default::default() };
        let error = FoxgloveSink::new(&settings).unwrap_err();
        assert!(error.is_input() && error.to_string().starts_with(address), "{error}");
    }
}
