//! Instruments that fall silent, restart, report wrong numbers or send hostile text: our own emulated device behind TCP.
#![cfg(unix)]

use crate::common::emulated::{
    device, own_host, record, scene, side_by_side, start, start_meddled,
};
use crate::common::*;
use eit_hw::codec::eits1::{self, Kind};
use eit_hw::driver::Event;
use eit_hw::emulator::{Emulator, FaultPlan, Listen};
use eit_skin::Next;

const HOSTILE: &str = "sk\u{1b}]0;OWNED\u{7}\u{1b}[31min\n\rFAKE LINE\u{9b}2J";

/// A robot's loop is told that the instrument is gone, instead of seeing only that no frame comes.
#[test]
fn a_robot_hears_that_the_instrument_is_gone() {
    let (folder, emulator) = (Folder::new(), start(device("skin")));
    let skin = eit_skin::Skin::load(scene(&folder)).unwrap();
    let mut sensor = skin.open_at(Some(&emulator.endpoint().to_string())).unwrap();
    let wait = Duration::from_millis(50);
    wait_until(|| matches!(sensor.next_within(wait).unwrap(), Next::Waiting { .. }));
    drop(emulator);
    let is_gone = |next: Next| matches!(next, Next::Event(Event::Disconnected { .. }));
    wait_until(|| is_gone(sensor.next_within(wait).unwrap()));
    assert!(matches!(sensor.next_within(Duration::ZERO).unwrap(), Next::Nothing));
}

/// It loses its set-up without telling the host, which configures it again.
#[test]
fn a_restart_that_nobody_heard_of_leads_to_a_new_set_up() {
    let folder = Folder::new();
    let (mut frames, mut is_done) = (0, false);
    let emulator = start_meddled(move |_, device, sent| {
        frames += usize::from(!sent.is_empty());
        if frames == 60 && !is_done {
            is_done = true;
            device.power_cycle();
            // the announcement is lost on the way
            device.poll(Duration::ZERO, &mut Vec::new());
            sent.clear();
        }
    });
    let (said, json, out) = record(&folder, &emulator, 6, 0);
    says(&said, "no frame for 0.5 s");
    has(&json, json!({ "reconnections": 1, "ended_silent": false }));
    // set-up, 2 s of silence, set-up again: more than two seconds of frames remain
    assert!(number(&json, "frames") > 200.0, "{json}");
    // it is configured again after two seconds
    assert!(number(&json, "silent_s") >= 2.0, "{json}");
    assert_eq!(eit_hw::capture::read(&out).unwrap().frames().last().unwrap().epoch, 1);
}

/// And not told to be without power: the bytes are counted, and the reason why it is not used again is given once.
#[test]
fn a_board_that_sends_other_lines_is_named() {
    let mut sent = 0_u32;
    let emulator = start_meddled(move |now, _, out| {
        out.clear();
        while f64::from(sent) < 50.0 * now.as_secs_f64() {
            let count = if sent < 150 { 40 } else { 20 };
            let values = (0..count).map(|k| (sent * 7 + k).to_string());
            out.extend(values.collect::<Vec<_>>().join(",").bytes().chain(*b"\r\n"));
            sent += 1;
        }
    });
    let (folder, port) = (Folder::new(), emulator.endpoint());
    let board = folder.scene("[instrument]\ndriver = \"csv\"\nport = \"unused\"\n");
    let out = folder.path("out.mcap");
    let said = ended(&eit(format!("record {board} --port {port} --out {out} --seconds 16")), 3);
    says(&said, "bytes came: it sends something else than before");
    assert!(!said.contains("check its power"), "{said}");
    let reason =
        "received complete lines of 20 numbers, but the scene's protocol has 40 measurements";
    assert_eq!(said.matches(reason).count(), 1, "{said}");
}

/// Frames of the time in which it was unplugged are estimated, and that time does not lower the rate.
#[test]
fn frames_of_an_unplugged_time_are_estimated() {
    let folder = Folder::new();
    // some 100 frames
    let unplug_after_bytes = vec![20_000];
    let plan = FaultPlan { unplug_after_bytes, unplugged_s: 1.5, ..FaultPlan::default() };
    let listen = Listen::Tcp(format!("{}:0", own_host()));
    let emulator = Emulator::start(device("skin"), &listen, plan).unwrap();
    let (_, json, _) = record(&folder, &emulator, 6, 0);
    let number = |key: &str| number(&json, key);
    assert_eq!((number("reconnections"), number("lost")), (1.0, 0.0), "{json}");
    // attempts to reconnect come at growing intervals, and take longer on a busy computer
    assert!((1.5..4.5).contains(&number("disconnected_s")), "{json}");
    assert_eq!(number("silent_s"), 0.0, "{json}");
    let estimate = (100.0 * number("disconnected_s")).round();
    assert_eq!(number("no_data_frames_estimate"), estimate, "{json}");
    // 6 s at 100 Hz, of which the first set-up takes some
    assert!((450.0..=620.0).contains(&(number("frames") + estimate)), "{json}");
    // with the time without data it would be at most 75 per second
    assert!((80.0..=110.0).contains(&number("frame_rate_hz")), "{json}");
    // the same in words
    let (scene, port, other) = (scene(&folder), emulator.endpoint(), folder.path("other.mcap"));
    let said = succeed(format!("record {scene} --port {port} --seconds 1 --out {other}"));
    assert!(!said.contains("no data"), "{said}");
}

#[test]
fn silence_at_the_end_is_exit_code_3() {
    let folder = Folder::new();
    let emulator = start_meddled(|now, _, sent| {
        if now > Duration::from_millis(1500) {
            sent.clear();
        }
    });
    let (_, json, _) = record(&folder, &emulator, 3, 3);
    assert_eq!(json["ended_silent"], true, "{json}");
    // up to 1.5 s after its start at 100 Hz, some of which the set-up takes
    assert!((20.0..150.0).contains(&number(&json, "frames")), "{json}");
    // the same while watching, and if nothing arrives at all
    let (scene, port) = (scene(&folder), emulator.endpoint());
    for (command, wanted) in [("live", "no frame for"), ("check", "no frame within 2 s")] {
        let output = eit(format!("{command} {scene} --port {port} --seconds 2"));
        says(&ended(&output, 3), wanted);
        let said = all_said(&output);
        assert!(command != "live" || said.contains("silent or unplugged at the end"), "{said}");
    }
}

/// The frame counter restarts or has one impossible value: hardly a frame is lost.
#[test]
fn a_count_that_begins_anew_or_jumps_loses_few_frames() {
    side_by_side([("anew", 1), ("jump", 0)], |(name, epochs)| {
        let (folder, mut frames) = (Folder::new(), 0_u32);
        let emulator = start_meddled(move |_, _, sent| {
            let mut out = Vec::new();
            eits1::Decoder::new().push(sent, &mut |event| {
                let eits1::Event::Message(mut message) = event else { return };
                frames += u32::from(message.kind == Kind::Frame);
                match name {
                    _ if message.kind != Kind::Frame => {}
                    "anew" if frames > 100 => message.sequence = frames - 101,
                    "jump" if frames == 100 => message.sequence += 1_000_000_000,
                    _ => {}
                }
                eits1::encode(&message, &mut out).unwrap();
            });
            *sent = out;
        });
        let (_, json, out) = record(&folder, &emulator, 3, 0);
        // 3 s at 100 Hz, of which a third may pass while others occupy the processor; lost are the frame with
        // the impossible number, and one that it hides
        let [found, lost] = ["frames", "lost"].map(|key| number(&json, key));
        assert!(found > 200.0 && lost <= 2.0, "{name}: {json}");
        assert_eq!(json["reconnections"], 0, "{name}: {json}");
        let capture = eit_hw::capture::read(&out).unwrap();
        assert_eq!(capture.frames().last().unwrap().epoch, epochs, "{name}");
    });
}

/// Names, notes and files from elsewhere cannot move the cursor or fake a line.
#[test]
fn nothing_of_others_reaches_the_terminal_as_it_is() {
    let (folder, emulator) = (Folder::new(), start(device(HOSTILE)));
    let (scene, port, out) = (scene(&folder), emulator.endpoint(), folder.path("out.mcap"));
    let note = "a\u{1b}[2Jb";
    for line in [
        format!("check {scene} --identify --port {port}"),
        format!("check {scene} --identify --port {port} --json"),
        format!("check {scene} --port {port} --frames 20"),
        format!("record {scene} --port {port} --out {out} --seconds 1 --note {note}"),
        format!("replay {scene} --from {out}"),
        format!("replay {scene} --from {out} --json"),
        "plan no\u{1b}[31mscene.toml".to_owned(),
    ] {
        let output = eit(&line);
        // the text is printed, not dropped; `eit replay` names a recording, not its instrument
        let (code, name) = match line.split(' ').next() {
            Some("plan") => (2, "scene.toml"),
            Some("replay") => (0, ""),
            _ => (0, "OWNED"),
        };
        ended(&output, code);
        for said in [stdout(&output), stderr(&output)] {
            assert!(!said.contains(|c: char| c.is_control() && c != '\n'), "{said:?}");
            // nor start a line within the name
            assert!(!said.lines().any(|line| line.trim_start().starts_with("FAKE")), "{said:?}");
        }
        says(&all_said(&output), name);
    }
}

/// Two programs cannot record to one file, nor two hosts use one instrument.
#[test]
fn a_second_recorder_is_refused() {
    let folder = Folder::new();
    let (first, second) = (start(device("one")), start(device("two")));
    let (scene, out) = (scene(&folder), folder.path("out.mcap"));
    let [one, two] = [first.endpoint(), second.endpoint()];
    let line = format!("record {scene} --port {one} --out {out} --seconds 4");
    let mut running = command(line).stdout(Stdio::null()).spawn().unwrap();
    wait_until(|| exists(&out));
    let line = format!("record {scene} --port {two} --out {out} --seconds 1 --append");
    says(&ended(&eit(line), 2), "out.mcap: another program is recording to it");
    // the instrument has one host
    let other = folder.path("other.mcap");
    let refused = eit(format!("record {scene} --port {one} --out {other} --seconds 1"));
    assert!(!refused.status.success());
    assert!(running.wait().unwrap().success());
    let capture = eit_hw::capture::read(&out).unwrap();
    // 4 s at 100 Hz, of which half may pass while others occupy the processor
    assert!(!capture.damage.is_any() && capture.frames().count() > 200);
    assert!(capture.frames().all(|frame| frame.epoch == 0));
}
