//! Two patches and a body as three processes, over zenoh on the loopback interface; or how to get it.
#![cfg(unix)]
use crate::common::refuse_each;

/// One sentence that says how to build it, before any work.
#[cfg(not(feature = "zenoh"))]
#[test]
fn without_zenoh_the_way_to_get_it_is_reported() {
    let built_without = "--zenoh: this eit was built without zenoh";
    refuse_each([
        ("body never.toml", "cargo install --path crates/eit-cli --features zenoh"),
        ("replay paper-disc --from never.mcap --zenoh skin", built_without),
    ]);
}

#[cfg(not(feature = "foxglove"))]
#[test]
fn without_foxglove_the_way_to_get_it_is_reported() {
    let install = "cargo install --path crates/eit-cli --features foxglove";
    let line = |to| (format!("replay paper-disc --from never.mcap {to}"), install);
    refuse_each(["--foxglove", "--foxglove-record=F.mcap"].map(line));
}

#[test]
fn endpoints_need_a_key() {
    let line = "replay paper-disc --from never.mcap --zenoh-connect tcp/127.0.0.1:1";
    refuse_each([(line, "--zenoh <KEY>")]);
}

#[cfg(feature = "zenoh")]
mod by_zenoh {
    use crate::common::emulated::{emulate, own_host, printed, scene, signal};
    use crate::common::*;

    /// Ends with the test.
    struct Process(Child);

    impl Process {
        fn start(line: String) -> Self {
            Self(command(line).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap())
        }
    }

    impl Drop for Process {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// The next line that is wanted.
    fn line(lines: &mut impl Iterator<Item = String>, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let line = parse(&lines.next().expect("a line"));
            if wanted(&line) {
                return line;
            }
            assert!(begun.elapsed() < LIMIT, "no such line; last {line}");
        }
    }

    /// Two live skins, each with an emulated instrument; the process of one is killed and started again.
    #[test]
    fn two_patches_and_a_body() {
        let folder = Folder::new();
        let scene = scene(&folder);
        let (frames, _) = touched_frames(&folder);
        let free = std::net::TcpListener::bind((own_host(), 0)).unwrap().local_addr().unwrap();
        let address = format!("tcp/{free}");
        let patch = |(name, x): (&str, &str)| {
            let keys = format!("name = \"{name}\"\ntopic = \"skin/{name}\"");
            format!("[[patch]]\n{keys}\nposition_m = [{x}, 0.0, 0.0]\n")
        };
        let patches = [("left", "1.0"), ("right", "-1.0")].map(patch).concat();
        let keys = format!("frame = \"torso\"\ntopic = \"body\"\nzenoh.listen = [\"{address}\"]\n");
        let file = folder.write("body.toml", keys + &patches);
        let mut body = Process::start(format!("body {file}"));
        let mut lines = printed(&mut body.0);
        let start = line(&mut lines, |_| true);
        has(&start, json!({ "type": "start", "frame": "torso" }));
        let place = |name: &str| folder.path(name);
        let instrument = |name: &str| emulate(&scene, &place(name), &format!("--frames {frames}"));
        let live = |name: &str| {
            let (key, port) = (format!("skin/{name}"), place(name));
            let to = format!("--zenoh {key} --zenoh-connect {address} --frame-id {name}");
            Process::start(format!("live {scene} --port {port} {to}"))
        };
        let _instruments = ["left", "right"].map(instrument);
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
        assert!(number(&silent, "for_s") > 0.35 && silent["was_heard"] == true, "{silent}");
        let _again = live("right");
        let back = line(&mut lines, |l| l["event"] == "back" && l["patch"] == "right");
        assert!(number(&back, "after_s") > 0.35, "{back}");
        // Ctrl-C: a last line, and success
        signal(&body.0, "-INT");
        line(&mut lines, |l| l["event"] == "ended");
        assert!(body.0.wait().unwrap().success());
    }

    #[test]
    fn bad_bodies_are_refused() {
        let folder = Folder::new();
        let body = folder.write("body.toml", "colour = 3\n");
        let arms = "replay paper-disc --from never.mcap --zenoh 2\u{a0}arms";
        refuse_each([
            ("body never.toml", "never.toml"),
            (&format!("body {body}"), "colour"),
            (arms, "--zenoh: 2 arms: not a topic"),
        ]);
    }

    /// No patch comes: a summary as one object.
    #[test]
    fn a_summary_counts() {
        let folder = Folder::new();
        let listen = "zenoh.listen = [\"tcp/127.0.0.1:0\"]";
        let body = format!("{listen}\n[[patch]]\nname = \"a\"\ntopic = \"skin/a\"\n");
        let file = folder.write("body.toml", body);
        let said = answer(format!("body {file} --seconds 0.6"));
        assert_eq!((&said["received"], &said["patches"][0]["silent"]), (&0.into(), &true.into()));
        assert!(number(&said, "lists") >= 2.0, "{said}");
    }
}
