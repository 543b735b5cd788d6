//! Frames for the tests of sinks.

use eit_publish::{SCHEMA, Start, UdpSink};
use eit_skin::faults::{ElectrodeFault, FaultKind};
use eit_skin::{Touch, TouchFrame, TouchState};
use std::time::{Duration, Instant};

/// Maximum time that a test waits.
pub const LIMIT: Duration = Duration::from_secs(20);

/// A touch at (30, -10) mm.
pub fn touch() -> Touch {
    Touch {
        id: 7,
        state: TouchState::Hold,
        position_m: [0.03, -0.01, 0.0],
        normal: Some([0.6, 0.0, 0.8]),
        position_covariance_m2: [[4e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 0.0, 0.0]],
        velocity_m_s: [0.1, 0.0, -0.0],
        intensity_s_m2: 2.5e-11,
        intensity_std_s_m2: Some(1e-12),
        peak_s: 1e-6,
        confidence: 0.97,
        age_frames: 12,
        age_s: 0.12,
        valid: true,
        whole: false,
        split_from: None,
        merged_into: Some(3),
        learnt: None,
    }
}

/// Electrode 5 is stuck.
pub const FAULTS: [ElectrodeFault; 1] =
    [ElectrodeFault { electrode: 4, kind: FaultKind::Stuck, since_s: 1.5 }];

/// A frame with these touches.
pub fn frame<'a>(
    number: u64,
    touches: &'a [Touch],
    faults: &'a [ElectrodeFault],
) -> TouchFrame<'a> {
    TouchFrame {
        number,
        sequence: number,
        epoch: 1,
        time_s: 2.0,
        host_time_s: Some(1.7e9 + 0.25),
        touches,
        faults,
        whole: faults.is_empty(),
        latency_s: Some(2e-3),
        ..Default::default()
    }
}

/// Four outline points and eight electrodes of 10 mm.
#[cfg(any(feature = "foxglove", feature = "web", feature = "zenoh"))]
pub fn shape() -> eit_publish::SkinShape {
    let electrode = |start: f64| vec![[start, 0.0], [start + 0.01, 0.0]];
    eit_publish::SkinShape {
        name: "arm".into(),
        outlines_m: vec![vec![[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.0, 0.1]]],
        electrodes_m: (0..8).map(|n| electrode(0.02 * f64::from(n))).collect(),
        extent_m: [0.0, 0.2, 0.0, 0.1],
    }
}

/// A skin that is live.
pub fn start() -> Start<'static> {
    let instrument = "a \"board\"\nof 16";
    Start { skin: "arm", instrument, electrodes: 16, reference_frames: 40, is_live: true }
}

/// A zenoh endpoint of this computer at a free port. On Linux each has a loopback address of its own, so that nobody
/// takes the port before zenoh does.
#[cfg(feature = "zenoh")]
pub fn endpoint() -> String {
    use std::sync::atomic::{AtomicU8, Ordering};
    static ENDPOINTS: AtomicU8 = AtomicU8::new(2);
    let [low, high, ..] = std::process::id().to_le_bytes();
    let own = ENDPOINTS.fetch_add(1, Ordering::Relaxed);
    let host = if cfg!(target_os = "linux") { [127, high, low, own] } else { [127, 0, 0, 1] };
    let listener = std::net::TcpListener::bind((std::net::Ipv4Addr::from(host), 0)).unwrap();
    format!("tcp/{}", listener.local_addr().unwrap())
}

/// Waits for a condition, with a limit.
pub fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < LIMIT, "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A receiver of datagrams, and a sink that sends them.
pub fn datagrams() -> (std::net::UdpSocket, UdpSink) {
    let receiver = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver.set_read_timeout(Some(LIMIT)).unwrap();
    let sink = UdpSink::new(&receiver.local_addr().unwrap().to_string()).unwrap();
    (receiver, sink)
}

/// The line of the next datagram.
pub fn received(receiver: &std::net::UdpSocket) -> serde_json::Value {
    let mut datagram = [0; 65_536];
    let size = receiver.recv(&mut datagram).unwrap();
    serde_json::from_slice(&datagram[..size]).unwrap()
}

/// The schema of every line.
pub fn schema() -> jsonschema::Validator {
    jsonschema::validator_for(&serde_json::from_str(SCHEMA).unwrap()).unwrap()
}
