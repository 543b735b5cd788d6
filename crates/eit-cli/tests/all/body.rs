//! Two patches and a body as three processes, over zenoh on the loopback interface; or, built without, how to
//! get it.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common;

#[cfg(not(feature = "zenoh"))]
use crate::common::refuse;

/// One sentence that says how to build it, before any work.
#[cfg(not(feature = "zenoh"))]
#[test]
fn without_zenoh_the_way_to_get_it_is_told() {
    let said = refuse(&["body", "never.toml"]);
    assert!(said.contains("cargo install --path crates/eit-cli --features zenoh"), "{said}");
    let said = refuse(&["replay", "paper-disc", "--from", "never.mcap", "--zenoh", "skin"]);
    assert!(said.contains("--zenoh: this eit was built without zenoh"), "{said}");
}

#[cfg(not(feature = "foxglove"))]
#[test]
fn without_foxglove_the_way_to_get_it_is_told() {
    for flag in ["--foxglove", "--foxglove-record=F.mcap"] {
        let said = common::refuse(&["replay", "paper-disc", "--from", "never.mcap", flag]);
        assert!(said.contains("cargo install --path crates/eit-cli --features foxglove"), "{said}");
    }
}

#[test]
fn endpoints_need_a_key() {
    let args =
        ["replay", "paper-disc", "--from", "never.mcap", "--zenoh-connect", "tcp/127.0.0.1:1"];
    let said = common::refuse(&args);
    assert!(said.contains("--zenoh <KEY>"), "{said}");
}

#[cfg(feature = "zenoh")]
mod by_zenoh {
    use crate::common::{SMALL, eit, refuse, succeed, text, touched_frames, write_scene};
    use serde_json::Value;
    use std::io::{BufRead as _, BufReader, Lines};
    use std::process::{Child, ChildStdout, Command, Stdio};
    use std::time::{Duration, Instant};

    const LIMIT: Duration = Duration::from_secs(60);

    /// Ends with the test.
    struct Process(Child);

    impl Process {
        fn start(arguments: &[&str]) -> Self {
            let mut command = Command::new(env!("CARGO_BIN_EXE_eit"));
            command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::null());
            Self(command.spawn().unwrap())
        }
    }

    impl Drop for Process {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// The next line that is wanted.
    fn line(lines: &mut Lines<BufReader<ChildStdout>>, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let line = lines.next().expect("a line").unwrap();
            let line: Value = serde_json::from_str(&line).unwrap();
            if wanted(&line) {
                return line;
            }
            assert!(begun.elapsed() < LIMIT, "no such line; last {line}");
        }
    }

    /// Two live skins, each with an emulated instrument; the process of one is killed and started again.
    #[test]
    fn two_patches_and_a_body() {
        let folder = tempfile::tempdir().unwrap();
        let instrument =
            "[instrument]\nport = \"unused\"\ndriver = \"eits1\"\nframe_rate_hz = 100.0";
        let scene = write_scene(folder.path(), &format!("{SMALL}\n{instrument}\n"));
        let (frames, _) = touched_frames(folder.path(), &scene);
        // on Linux at a loopback address that nobody else uses, so that the port stays free
        let host = if cfg!(target_os = "linux") { "127.69.73.84:0" } else { "127.0.0.1:0" };
        let free = std::net::TcpListener::bind(host).unwrap().local_addr().unwrap();
        let address = format!("tcp/{free}");
        let file = folder.path().join("body.toml");
        let patch = |name: &str, x: f64| {
            format!(
                "[[patch]]\nname = \"{name}\"\ntopic = \"skin/{name}\"\nposition_m = [{x:.1}, 0.0, 0.0]\n"
            )
        };
        let body = format!(
            "frame = \"torso\"\ntopic = \"body\"\nzenoh.listen = [\"{address}\"]\n{}{}",
            patch("left", 1.0),
            patch("right", -1.0)
        );
        std::fs::write(&file, body).unwrap();
        let mut body = Process::start(&["body", text(&file)]);
        let mut lines = BufReader::new(body.0.stdout.take().unwrap()).lines();
        let start = line(&mut lines, |_| true);
        assert_eq!((&start["type"], &start["frame"]), (&"start".into(), &"torso".into()));
        let place = |name: &str| folder.path().join(name);
        let emulate = |name: &str| {
            let port = place(name);
            let process = Process::start(&[
                "emulate",
                text(&scene),
                "--port",
                text(&port),
                "--frames",
                text(&frames),
            ]);
            let begun = Instant::now();
            while !port.exists() {
                assert!(begun.elapsed() < LIMIT, "no port");
                std::thread::sleep(Duration::from_millis(10));
            }
            process
        };
        let live = |name: &str| {
            let (key, port) = (format!("skin/{name}"), place(name));
            let from = ["live", text(&scene), "--port", text(&port)];
            let to = ["--zenoh", &key, "--zenoh-connect", &address, "--frame-id", name];
            Process::start(&[&from[..], &to].concat())
        };
        let _instruments = ["left", "right"].map(emulate);
        let (mut left, right) = (live("left"), live("right"));
        let of = |line: &Value, name: &str| -> Option<[f64; 2]> {
            let mut touches = line["touches"].as_array()?.iter();
            let touch = touches.find(|touch| touch["patch"] == name)?;
            Some([0, 1].map(|axis| touch["position_m"][axis].as_f64().unwrap()))
        };
        let both = line(&mut lines, |l| of(l, "left").is_some() && of(l, "right").is_some());
        // the finger is at (30, 0) mm of each patch
        for (name, origin) in [("left", 1.0), ("right", -1.0)] {
            let [x, y] = of(&both, name).unwrap();
            assert!((x - origin - 0.03).hypot(y) < 0.015, "{name}: {x}, {y}");
        }
        assert!(left.0.try_wait().unwrap().is_none(), "it goes on");
        drop(right);
        let silent = line(&mut lines, |l| l["event"] == "silent" && l["patch"] == "right");
        assert!(
            silent["for_s"].as_f64().unwrap() > 0.35 && silent["was_heard"] == true,
            "{silent}"
        );
        let _again = live("right");
        let back = line(&mut lines, |l| l["event"] == "back" && l["patch"] == "right");
        assert!(back["after_s"].as_f64().unwrap() > 0.35, "{back}");
        // Ctrl-C: a last line, and success
        let asked = Command::new("kill").args(["-INT", &body.0.id().to_string()]).status().unwrap();
        assert!(asked.success());
        line(&mut lines, |l| l["event"] == "ended");
        assert!(body.0.wait().unwrap().success());
    }

    #[test]
    fn bad_bodies_are_refused() {
        let said = refuse(&["body", "never.toml"]);
        assert!(said.contains("never.toml"), "{said}");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("body.toml");
        std::fs::write(&file, "colour = 3\n").unwrap();
        let output = eit(&["body", text(&file)]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && said.contains("colour"), "{said}");
        let said = refuse(&["replay", "paper-disc", "--from", "never.mcap", "--zenoh", "2 arms"]);
        assert!(said.contains("--zenoh: 2 arms: not a topic"), "{said}");
    }

    /// No patch comes: a summary as one object.
    #[test]
    fn a_summary_counts() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("body.toml");
        let listen = "zenoh.listen = [\"tcp/127.0.0.1:0\"]";
        std::fs::write(&file, format!("{listen}\n[[patch]]\nname = \"a\"\ntopic = \"skin/a\"\n"))
            .unwrap();
        let said = succeed(&["body", text(&file), "--seconds", "0.6", "--json"]);
        let said: Value = serde_json::from_str(&said).unwrap();
        assert_eq!((&said["received"], &said["patches"][0]["silent"]), (&0.into(), &true.into()));
        assert!(said["lists"].as_u64().unwrap() >= 2, "{said}");
    }
}
