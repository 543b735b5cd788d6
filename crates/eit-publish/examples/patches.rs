//! Measures a body of emulated patches on this computer: loss, latency and processor share.
//!
//! ```sh
//! cargo run --release -p eit-publish --features zenoh --example patches -- 32 20
//! ```
//!
//! starts 32 processes, each of which publishes 100 frames a second as a patch does, with one touch that moves, and
//! joins them for 20 seconds. A third argument `still` publishes untouched frames, of which only heartbeats are sent;
//! `every` publishes every frame.
#![allow(clippy::print_stdout, reason = "a program that measures")]

use eit_publish::body::{Body, BodySettings};
use eit_publish::{Publisher, SessionSettings, ZenohSettings, ZenohSink};
use eit_skin::{Touch, TouchFrame, TouchState};
use std::error::Error;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Frames a second of each patch.
const RATE_HZ: f64 = 100.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["patch", topic, address, seconds, kind] => patch(topic, address, seconds.parse()?, kind),
        [patches, seconds] => measure(patches.parse()?, seconds.parse()?, "moving"),
        [patches, seconds, kind] => measure(patches.parse()?, seconds.parse()?, kind),
        _ => Err("give the number of patches, the seconds, and moving, still or every".into()),
    }
}

/// Publishes frames with their time, and prints how many were handed to zenoh and dropped.
fn patch(topic: &str, address: &str, seconds: f64, kind: &str) -> Result<(), Box<dyn Error>> {
    let mut settings = ZenohSettings::new(topic);
    settings.session =
        SessionSettings { connect: vec![address.to_owned()], ..SessionSettings::default() };
    if kind == "every" {
        settings.change = None;
    }
    let mut publisher = Publisher::new().with_zenoh(ZenohSink::new(&settings)?);
    let start = Instant::now();
    let frames = (seconds * RATE_HZ) as u64;
    let (mut slowest, mut spent) = (Duration::ZERO, Duration::ZERO);
    for sequence in 0..frames {
        let touches = [touch(sequence)];
        let frame = TouchFrame {
            number: sequence,
            sequence,
            epoch: 0,
            time_s: sequence as f64 / RATE_HZ,
            host_time_s: None,
            touches: if kind == "still" { &[] } else { &touches },
            faults: &[],
            whole: true,
            latency_s: Some(0.0),
            ..Default::default()
        };
        let begun = Instant::now();
        publisher.touches(&frame)?;
        spent += begun.elapsed();
        slowest = slowest.max(begun.elapsed());
        let next = start + Duration::from_secs_f64((sequence + 1) as f64 / RATE_HZ);
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    publisher.end()?;
    let mean_us = 1e6 * spent.as_secs_f64() / frames as f64;
    let sink = publisher.zenoh().first().ok_or("a sink")?;
    println!("{} {mean_us} {}", sink.statistics().dropped_frames, 1e6 * slowest.as_secs_f64());
    Ok(())
}

/// A finger that circles.
fn touch(sequence: u64) -> Touch {
    let (y, x) = (0.05 * sequence as f64).sin_cos();
    Touch {
        id: 1,
        state: TouchState::Hold,
        position_m: [0.05 * x, 0.05 * y, 0.0],
        normal: Some([0.0, 0.0, 1.0]),
        position_covariance_m2: [[1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0; 3]],
        velocity_m_s: [-0.25 * y, 0.25 * x, 0.0],
        intensity_s_m2: 2.5e-11,
        intensity_std_s_m2: Some(1e-12),
        peak_s: 1e-6,
        confidence: 0.99,
        age_frames: sequence,
        age_s: sequence as f64 / RATE_HZ,
        valid: true,
        whole: true,
        split_from: None,
        merged_into: None,
        learnt: None,
    }
}

/// Starts the patches, joins them, and prints a line of a table.
fn measure(patches: usize, seconds: f64, kind: &str) -> Result<(), Box<dyn Error>> {
    let port = std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let address = format!("tcp/127.0.0.1:{port}");
    let file: String = (0..patches)
        .map(|n| format!("[[patch]]\nname = \"p{n}\"\ntopic = \"skin/p{n}\"\n"))
        .collect();
    let mut settings = BodySettings::parse(&file)?;
    settings.session.listen = vec![address.clone()];
    settings.topic = Some("body".to_owned());
    let mut body = Body::open(&settings)?;
    let program = std::env::current_exe()?;
    // they connect, and are all heard, before the time that counts; and go on for longer
    let lasting = format!("{}", seconds + 10.0);
    let children: Vec<Child> = (0..patches)
        .map(|n| {
            Command::new(&program)
                .args(["patch", &format!("skin/p{n}"), &address, &lasting, kind])
                .stdout(Stdio::piped())
                .spawn()
        })
        .collect::<Result<_, _>>()?;
    let limit = Instant::now() + Duration::from_secs(60);
    while body.patches().iter().any(|patch| patch.received == 0) {
        body.next(Duration::from_millis(50));
        if Instant::now() > limit {
            return Err("some patches are not heard".into());
        }
    }
    let settled = Instant::now() + Duration::from_secs(2);
    while Instant::now() < settled {
        body.next(Duration::from_millis(50));
    }
    let before = body.patches();
    body.reset_latency();
    let busy = |children: &[Child]| -> [f64; 2] {
        let all = children.iter().map(|child| processor_s(child.id())).sum();
        [processor_s(std::process::id()), all]
    };
    let (start, used) = (Instant::now(), busy(&children));
    while start.elapsed().as_secs_f64() < seconds {
        body.next(Duration::from_millis(50));
    }
    let elapsed = start.elapsed().as_secs_f64();
    let now_used = busy(&children);
    let after = body.patches();
    let count = |of: fn(&eit_publish::ros::PatchState) -> u64| -> u64 {
        after.iter().map(of).sum::<u64>() - before.iter().map(of).sum::<u64>()
    };
    let (received, lost) = (count(|patch| patch.received), count(|patch| patch.lost));
    let share = [0, 1].map(|who| 100.0 * (now_used[who] - used[who]) / elapsed);
    let milliseconds = |quantile| {
        1e3 * body.latency().and_then(|latency| latency.quantile_s(quantile)).unwrap_or(f64::NAN)
    };
    println!(
        "{patches} patches, {kind}: {:.0} messages/s, {lost} lost of {received}, latency median {:.2} ms, \
         99 % {:.2} ms, largest {:.1} ms, processor of the body {:.1} %, of a patch {:.2} % of one core",
        received as f64 / elapsed,
        milliseconds(0.5),
        milliseconds(0.99),
        1e3 * body.latency().map_or(f64::NAN, |latency| latency.largest_s()),
        share[0],
        share[1] / patches as f64
    );
    println!("dropped by the body: {:?}", body.dropped());
    let (mut dropped, mut mean_us, mut slowest_us) = (0.0, 0.0_f64, 0.0_f64);
    for child in children {
        let said = String::from_utf8(child.wait_with_output()?.stdout)?;
        let numbers: Vec<f64> =
            said.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        if let [lost, mean, slowest] = numbers[..] {
            dropped += lost;
            mean_us = mean_us.max(mean);
            slowest_us = slowest_us.max(slowest);
        }
    }
    println!(
        "dropped by the patches: {dropped}; a frame costs its skin {mean_us:.1} us on average, {slowest_us:.0} us \
         at most"
    );
    Ok(())
}

/// Time that a process has used the processor, seconds (Linux; else 0).
fn processor_s(process: u32) -> f64 {
    let Ok(text) = std::fs::read_to_string(format!("/proc/{process}/stat")) else { return 0.0 };
    // the name, in parentheses, may hold anything
    let rest = text.rsplit(')').next().unwrap_or_default();
    let ticks: f64 = rest
        .split_whitespace()
        .skip(11)
        .take(2)
        .filter_map(|field| field.parse::<f64>().ok())
        .sum();
    // 100 a second on every Linux of today
    ticks / 100.0
}
