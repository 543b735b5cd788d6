//! Recordings and arrays as `eit convert` and others read and write them.
#![cfg(unix)]

use crate::common::emulated::{device, record, scene, signal, start};
use crate::common::*;
use eit_hw::capture::{CaptureReader, CaptureWriter, Damage, MAGIC};
use std::os::unix::fs::symlink;

fn make_pipe(path: &str) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// `--recover` writes the intact parts, and reports the rest.
#[test]
fn recover_reports_what_is_missing() {
    let folder = Folder::new();
    let (_, json, out) = record(&folder, &start(device("skin")), 3, 0);
    let mut bytes = read(&out);
    let all = number(&json, "frames");
    // a byte in the middle of the content of some chunk
    let at = bytes.len() / 2;
    bytes[at] ^= 4;
    let (damaged, whole) = (folder.write("damaged.mcap", &bytes), folder.path("whole.mcap"));
    let line = format!("convert {damaged} --recover --out {whole}");
    let found = answer(&line);
    assert_eq!(found["bad_chunks"], 1, "{found}");
    let frames = number(&found, "frames");
    // chunks contain a second each, or more if the processor was busy for long: at least three quarters of
    // three seconds are outside a single chunk
    assert!(frames < all && frames > 0.25 * all, "{frames} of {all}");
    let capture = eit_hw::capture::read(&whole).unwrap();
    assert!(capture.frames().count() as f64 == frames && !capture.damage.unfinished);
    refuse_each([(&*line, "exists"), (&format!("{line}.csv"), ".mcap")]);
}

/// Messages that are no frames are told, not called damage-free, and so is a recording of two set-ups.
#[test]
fn recover_does_not_call_other_content_undamaged() {
    let (folder, [from, to]) = Folder::with_paths(["a.mcap", "b.mcap"]);
    succeed(format!("convert {} --out {to}", folder.write("t.csv", "1,2\n")));
    let capture = eit_hw::capture::read(&to).unwrap();
    let session = capture.sessions().next().unwrap();
    let mut writer = CaptureWriter::create(&from, session, Default::default()).unwrap();
    let mut frame = capture.frames().next().unwrap().clone();
    writer.frame(&frame).unwrap();
    frame.values.pop();
    frame.quality.pop();
    writer.frame(&frame).unwrap();
    writer.finish().unwrap();
    std::fs::remove_file(&to).unwrap();
    // a channel and a message of it, by hand
    let record = |op: u8, parts: &[&[u8]]| {
        let content = parts.concat();
        [&[op][..], &(content.len() as u64).to_le_bytes(), &content].concat()
    };
    let text_of = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let bytes = [
        MAGIC.to_vec(),
        record(1, &[&text_of(""), &text_of("test")]),
        record(4, &[&[1, 0, 0, 0], &text_of("/eit/frame"), &text_of("json"), &[0; 4]]),
        record(5, &[&[1, 0], &[0; 20], b"{\"no\": 1}"]),
    ];
    let other = folder.write("c.mcap", bytes.concat());
    for (from, words) in [
        (from, "1 frame(s) or session(s) have other measurements"),
        (other.clone(), "1 message(s) are not what their topic holds"),
    ] {
        let said = succeed(format!("convert {from} --recover --out {to}"));
        assert!(said.contains(words) && !said.contains("no damage"), "{said}");
        std::fs::remove_file(&to).unwrap();
    }
    let found = answer(format!("convert {other} --recover --out {to}"));
    has(&found, json!({ "frames": 0, "unreadable": 1 }));
}

/// Nor stray files; after SIGKILL the half has `.part` or a dot in its name.
#[test]
fn a_command_that_is_ended_leaves_no_half_files() {
    let (folder, [whole]) = Folder::with_paths(["whole.mcap"]);
    let table = random_table(&folder, 6000);
    succeed(format!("convert {table} --out {whole}"));
    let names = || {
        let mut names = folder.names();
        names.retain(|name| name != "a.csv" && name != "whole.mcap");
        names
    };
    let (mut ended, mut seen) = (0, 0);
    for (end, name) in [
        ("-INT", "b.npy"),
        ("-TERM", "b.mcap"),
        ("-HUP", "b.mcap"),
        ("-KILL", "b.mcap"),
        ("-KILL", "r.mcap"),
        ("-INT", "r.mcap"),
    ] {
        let out = folder.path(name);
        let form = if name == "r.mcap" { "--recover" } else { "" };
        let line = format!("convert {whole} {form} --out {out}");
        let mut child = command(&line).stdout(Stdio::null()).spawn().unwrap();
        // until it writes
        while names().is_empty() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        signal(&child, end);
        // else it was faster; then everything is there
        if !child.wait().unwrap().success() {
            ended += 1;
            let left = names();
            seen += left.len();
            assert!(end == "-KILL" || left.is_empty(), "{end}: {left:?}");
            assert!(left.iter().all(|name| name.ends_with(".part")), "{left:?}");
            // the next run is not in the way of what was left
            let again = succeed(&line);
            assert!(again.starts_with("6000 frames"), "{again}");
        }
        assert_eq!(names(), [name], "{end}");
        std::fs::remove_file(&out).unwrap();
    }
    assert!(ended >= 3, "{ended} of 6 were ended while they wrote, {seen} files left");
}

/// A table of 208 random values a row.
fn random_table(folder: &Folder, rows: usize) -> String {
    let mut random = fixtures::Random::new(2);
    let values = Array2::from_shape_simple_fn((rows, 208), || random.uniform());
    folder.write("a.csv", table(&values))
}

/// A pipe or device is not replaced by a file, a link stays one, and what is read is not written over.
#[test]
fn an_output_that_is_no_file_is_refused() {
    let folder = Folder::new();
    let table = folder.write("a.csv", "1,2,3\n4,5,6\n");
    make_pipe(&folder.path("pipe.csv"));
    symlink("/dev/null", folder.path("null.csv")).unwrap();
    symlink(folder.path("nothing.csv"), folder.path("dangling.csv")).unwrap();
    let target = folder.write("target.csv", "old");
    symlink("target.csv", folder.path("link.csv")).unwrap();
    let line = |name: &str| format!("convert {table} --out {}", folder.path(name));
    refuse_each([
        (line("pipe.csv"), "pipe.csv…is a device, pipe or socket"),
        (line("null.csv"), "null.csv…is a device, pipe or socket"),
        (line("dangling.csv"), "dangling.csv…is a link to nothing"),
        (line("./a.csv"), "./a.csv…is the file to convert"),
    ]);
    let link = folder.path("link.csv");
    succeed(line("link.csv"));
    assert!(std::path::Path::new(&link).is_symlink());
    assert_eq!((read_text(&target).lines().count(), read_text(&table).lines().count()), (2, 2));
}

/// That would look complete; nor does a recording of ours without a frame.
#[test]
fn nothing_whole_is_refused_and_leaves_no_file() {
    let (folder, [new]) = Folder::with_paths(["new.mcap"]);
    let noise = [MAGIC, &[0xa5; 5000]].concat();
    for (content, to, wanted) in [
        (&noise[..], "new.mcap", "damaged.mcap: its 5008 bytes hold no intact message"),
        (b"", "new.mcap", "damaged.mcap"),
        (&noise, "none/new.mcap", "new.mcap: cannot be written"),
    ] {
        let (damaged, to) = (folder.write("damaged.mcap", content), folder.path(to));
        refuse_each([(format!("convert {damaged} --recover --out {to}"), wanted)]);
        assert!(!exists(&new));
    }
    let (table, whole) = (folder.write("a.csv", "1,2,3\n4,5,6\n"), folder.path("whole.mcap"));
    succeed(format!("convert {table} --out {whole}"));
    // the first chunk holds the session alone
    let bytes = read(&whole);
    let recover = |length| {
        let cut = folder.write("cut.mcap", &bytes[..length]);
        eit(format!("convert {cut} --recover --out {new}"))
    };
    let is_refused = |output: &Output| output.status.code() == Some(2) && !exists(&new);
    let mut outputs = (0..bytes.len()).step_by(50).map(recover);
    let output = outputs.find(|output| !is_refused(output)).unwrap();
    says(&ended(&output, 1), "cut.mcap: no frame is intact; …new.mcap is not written");
    assert!(!exists(&new));
}

/// A frame that the file's end cuts off is counted, and told in the singular.
#[test]
fn convert_tells_of_a_cut_frame() {
    let folder = Folder::new();
    // two frames of 256 values and a part of one
    let bytes: Vec<u8> = (0..600).flat_map(|k| (0.1 + 0.001 * k as f32).to_le_bytes()).collect();
    let (cut, table) = (folder.write("cut.get", bytes), folder.path("table.csv"));
    let found = answer(format!("convert {cut} --out {table}"));
    let note = "1 cut frame skipped (byte 2048: 352 bytes instead of 1024)";
    has(&found, json!({ "frames": 2, "skipped_frames": 1, "notes": [note] }));
}

/// A skin that never rests: what to do, also for programs.
#[test]
fn a_replay_without_a_reference_says_why() {
    let (folder, scene) = Folder::with_scene("");
    let (_, frames) = touched_frames(&folder);
    // each measurement swings by 5 %
    let swings = Array2::from_shape_fn((72, frames.ncols()), |(f, i)| {
        frames[[0, i]] * (1.0 + 0.05 * (f as f64 / 3.0).sin() * (i as f64 / 20.0 - 1.0))
    });
    let (array, recording) = (folder.write_array("a.npy", &swings), folder.path("swings.mcap"));
    succeed(format!("convert {array} --out {recording} --scene {scene}"));
    let replay = format!("replay {scene} --from {recording}");
    let words = "72 frames came, and none was searched for touches: begin…--reference-frames; in a replay also \
                 [recording] reference";
    says(&stdout(&eit(&replay)), words);
    let found = parse(&stdout(&eit(format!("{replay} --json"))));
    assert_eq!(found["unsearched"]["frames"], 72, "{found}");
    assert!(number(&found, "unrest") > 0.01, "{found}");
}

/// Where its frames have no times, the assumed rate is told once, by whatever command reads it, unless it is stated.
#[test]
fn a_table_is_replayed_after_the_command_that_is_named() {
    let (folder, plain) = Folder::with_scene("");
    let of_recording = |name, key| folder.write(name, format!("{SMALL}\n[recording]\n{key}\n"));
    let stated = of_recording("stated.toml", "frame_rate_hz = 50.0");
    let (array, _) = touched_frames(&folder);
    let [table, recording, out] = folder.paths(["press.csv", "press.mcap", "out"]);
    succeed(format!("convert {array} --out {table}"));

    let named = format!("convert {table} --scene {plain} --out {recording}");
    let words = format!("`eit {named}`…[recording] frame_rate_hz");
    refuse_each([(format!("replay {plain} --from {table}"), words)]);
    succeed(&named);

    // a column of times is left out, and one that is something else is named, whatever reads the table
    let content = read_text(&table);
    let with = |name: &str, first: fn(usize) -> f64| {
        let rows = content.lines().enumerate().map(|(k, row)| format!("{},{row}\n", first(k)));
        folder.write(name, rows.collect::<String>())
    };
    let timed = with("timed.csv", |k| 0.02 * k as f64);
    let other = with("other.csv", |k| (k as f64).sin());
    let reconstruct = |scene: &str, table: &str| {
        format!("reconstruct {scene} --frames {table} --reference 0..40 --out {out}")
    };
    let convert = |table: &str| {
        format!("convert {table} --scene {plain} --out {}", folder.path("other.mcap"))
    };
    let wanted = "remove that column";
    refuse_each([(reconstruct(&plain, &other), wanted), (convert(&other), wanted)]);
    assert!(succeed(convert(&timed)).contains("the first column grows in equal steps"));

    // the arrangement that the scene states is that of the table
    let turned = folder.write_array("turned.npy", &recorded(&table, false).t().to_owned());
    let scene = of_recording("turned.toml", "frames_are = \"columns\"");
    let back = folder.path("back.csv");
    succeed(format!("convert {turned} --scene {scene} --out {back}"));
    assert_eq!(read_text(&back), content);

    for (scene, count) in [(&plain, 1), (&stated, 0)] {
        let replay = format!("replay {scene} --from {recording}");
        for line in [reconstruct(scene, &table), replay] {
            let output = eit(&line);
            ended(&output, 0);
            let said = all_said(&output);
            let notes = said.matches("20 frames a second; if it is another one").count();
            assert_eq!(notes, count, "{line}: {said}");
        }
    }
}

/// Of several arrays of a MATLAB file, the one is read whose frames fit the scene, also by columns, or that the scene names.
#[test]
fn matlab_arrays_are_read_by_shape_or_name() {
    let folder = Folder::new();
    let (frames, images) = (Array2::from_shape_fn((5, 40), |(f, i)| (i + 40 * f) as f64), "never");
    // an array of doubles, the first index fastest; names of one letter stand in their tag
    let array = |name: u8, shape: [u32; 2], values: &mut dyn Iterator<Item = &f64>| {
        let data: Vec<u8> = values.flat_map(|value| value.to_le_bytes()).collect();
        let words =
            [6, 8, 6, 0, 5, 8, shape[0], shape[1], 0x1_0001, u32::from(name), 9, data.len() as u32];
        let content = [&words.map(u32::to_le_bytes).concat()[..], &data].concat();
        [&[14, content.len() as u32].map(u32::to_le_bytes).concat()[..], &content].concat()
    };
    let header = [&[b' '; 124][..], b"\0\x01IM"].concat();
    let times = array(b't', [5, 1], &mut frames.iter().take(5));
    let both = array(b'v', [40, 5], &mut frames.iter());
    let others = array(b'w', [40, 5], &mut frames.iter().skip(1).chain(&[7.0]));
    let one = folder.write("one.mat", [&header[..], &times, &both].concat());
    let two = folder.write("two.mat", [&header[..], &times, &both, &others].concat());
    let (scene, out) = (folder.scene(""), folder.path("back.npy"));
    let said = succeed(format!("convert {one} --scene {scene} --out {out}"));
    says(&said, "read the array `v` [40, 5], a frame in each column");
    assert_eq!(read_array::<Ix2>(&out), frames);
    let asked = "`t` [5, 1], `v` [40, 5], `w` [40, 5]; set `[recording] array`";
    refuse_each([
        (format!("convert {two} --scene {scene} --out {out}"), asked),
        (format!("reconstruct {scene} --frames {two} --reference 0 --out {images}"), asked),
    ]);
    let scene = folder.scene("[recording]\narray = \"w\"\n");
    succeed(format!("convert {two} --scene {scene} --out {out}"));
    assert_eq!(read_array::<Ix2>(&out)[[0, 0]], 1.0);
}

/// Of a full disk; the error names the file, not its temporary one, and nothing of it is left.
#[test]
fn a_conversion_that_fails_leaves_no_recording() {
    let folder = Folder::new();
    let table = random_table(&folder, 500);
    for name in ["a.mcap", "b.npy"] {
        let out = folder.path(name);
        let line = format!("convert {table} --out {out}");
        let output = in_shell("trap '' XFSZ; ulimit -f 400;", line).output().unwrap();
        let said = ended(&output, 1);
        assert!(said.contains(&out) && !said.contains(".eit-"), "{said}");
        assert!(name != "a.mcap" || said.contains("a.mcap: cannot be written"), "{said}");
        assert_eq!(folder.names(), ["a.csv"]);
    }
}

/// Nested brackets in the header of images once took a minute, and were echoed in full.
#[test]
fn a_hostile_header_of_images_is_refused_at_once() {
    let folder = Folder::new();
    let headed = |length: [u8; 4], header: &str| {
        [b"\x93NUMPY\x02\x00", &length[..], header.as_bytes()].concat()
    };
    let nested = [24, 60_000].map(|depth| {
        let shape = "[".repeat(depth) + &"]".repeat(depth);
        let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
        headed((header.len() as u32).to_le_bytes(), &header)
    });
    for bytes in nested.into_iter().chain([headed([0xff; 4], "{}")]) {
        let (images, start) = (folder.write("nest.npy", bytes), Instant::now());
        let options = format!("--weights default --images {images} --out never");
        let said = refuse(format!("net apply paper-disc {options}"));
        assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
        assert!(said.len() < 400, "{} bytes", said.len());
    }
}

/// Devices and pipes have no end: they are rejected before they are read.
#[test]
fn devices_without_an_end_are_no_files() {
    let folder = Folder::new();
    let [endless, pipe, out] = folder.paths(["zero.toml", "pipe.toml", "f.learned"]);
    symlink("/dev/zero", &endless).unwrap();
    make_pipe(&pipe);
    let table = folder.write("p.csv", "x_m,y_m\n0,0\n");
    for endless in [&*endless, &pipe, "/dev/zero"] {
        let script = format!("simulate paper-disc --script {endless} --out never");
        if endless != "/dev/zero" {
            refuse_each([(script, format!("{endless}…not a file of at most"))]);
        }
        for (presses, with) in [(endless, &*table), (&table, endless)] {
            let data = format!("--presses {presses} --with {with} --frames {table}");
            let line = format!("learn paper-disc {data} --out {out}");
            refuse_each([(line, format!("eit: {endless}: "))]);
        }
    }
    let zero = "[noise]\nadditive_v = 1e-6\n[touch]\nlearned = \"/dev/zero\"\n";
    let frames = Array2::from_shape_fn((2, 40), |(frame, _)| 1.0 + frame as f64);
    let frames = folder.write_array("f.npy", &frames);
    let scene = folder.scene(zero);
    refuse_each([
        (&*format!("reconstruct {scene} --frames {frames} --reference 0 --out never"), "/dev/zero"),
        ("plan /dev/zero", "/dev/zero"),
        ("convert /dev/zero --out never.csv", "/dev/zero"),
        ("reconstruct paper-disc --frames /dev/zero --out never", "/dev/zero"),
        ("convert /dev/zero --recover --out never.mcap", "/dev/zero"),
    ]);
}

/// Converted message by message: epochs, clocks and notes are kept, and a scene's order applies.
#[test]
fn convert_keeps_what_a_recording_holds() {
    let folder = Folder::new();
    let (_, json, out) = record(&folder, &start(device("skin")), 1, 0);
    let frames = &json["frames"];
    let [other, table, array, scene] = folder.paths(["b.mcap", "b.csv", "b.npy", "scene.toml"]);
    for (to, more) in [(&other, &*format!("--scene {scene}")), (&table, ""), (&array, "")] {
        let said = succeed(format!("convert {out} --out {to} {more}"));
        assert!(said.starts_with(&format!("{frames} frames of 40 values")), "{said}");
    }
    let [one, same] = [&out, &other].map(|path| eit_hw::capture::read(path).unwrap());
    assert_eq!(one.entries, same.entries);
    // log times of the messages, which players use
    let times = |path: &str| {
        let (mut reader, mut times) = (CaptureReader::open(path).unwrap(), Vec::new());
        while reader.next_entry().unwrap().is_some() {
            times.push(reader.times().unwrap());
        }
        times
    };
    let wanted = times(&out);
    let lasted_ns = wanted.last().unwrap().log_ns - wanted[0].log_ns;
    assert!(lasted_ns > 500_000_000, "frames of one second: {lasted_ns} ns");
    assert_eq!(times(&other), wanted);
    assert!([&table, &array].iter().all(|path| recorded(path, false) == recorded(&out, false)));
}

/// Every command reads the parts of a split recording as one.
#[test]
fn a_split_recording_is_one_recording_for_every_command() {
    let folder = Folder::new();
    let emulator = start(device("skin"));
    let (scene, port, out) = (scene(&folder), emulator.endpoint(), folder.path("press.mcap"));
    let record = format!("record {scene} --port {port} --out {out}");
    let json = answer(format!("{record} --seconds 3.5 --split-s 1"));
    let frames = number(&json, "frames");
    let files = eit_hw::capture::files(&out);
    let names: Vec<&str> = files.iter().map(|file| file.to_str().unwrap()).collect();
    assert!((3..=4).contains(&files.len()) && !exists(&out), "{names:?}");
    let bytes: u64 = files.iter().map(|file| file.metadata().unwrap().len()).sum();
    has(&json, json!({ "files": names, "bytes": bytes }));
    // a name that is taken by parts
    refuse_each([
        (format!("{record} --seconds 1"), "press.00001.mcap: exists…--append"),
        (format!("convert {} --out {out}", names[0]), "press.00001.mcap: exists"),
    ]);
    // a second run in the last part
    let json = answer(format!("{record} --seconds 1 --append"));
    let all = frames + number(&json, "frames");
    assert_eq!(eit_hw::capture::files(&out), files);
    let capture = eit_hw::capture::read(&out).unwrap();
    assert_eq!((capture.frames().count() as f64, capture.damage), (all, Damage::default()));
    for name in ["all.csv", "all.npy", "all.mcap"] {
        let said = succeed(format!("convert {out} --out {}", folder.path(name)));
        assert!(said.starts_with(&format!("{all} frames of 40 values")), "{said}");
    }
    let [one, whole, rest] = folder.paths(["all.mcap", "whole.mcap", "rest.mcap"]);
    assert_eq!(eit_hw::capture::read(&one).unwrap().entries, capture.entries);
    let said = succeed(format!("convert {out} --recover --out {whole}"));
    assert!(said.starts_with(&format!("{all} frames")) && said.contains("no damage"), "{said}");
    // images and touches are those of the converted recording
    let images = |from: &str, to: &str| {
        let [to, replayed] = folder.paths([to, &format!("replay-{to}")]);
        succeed(format!("reconstruct {scene} --frames {from} --reference 0..20 --out {to}"));
        // the second run is another epoch, which stderr says
        ended(&eit(format!("replay {scene} --from {from} --out {replayed}")), 0);
        [to, replayed].map(|folder| read(format!("{folder}/images.npy")))
    };
    assert_eq!(images(&out, "parts"), images(&one, "one"));
    // a missing part is reported, and the rest is written
    std::fs::remove_file(&files[1]).unwrap();
    for to in [format!("{rest} --recover"), folder.path("rest.csv")] {
        let said = succeed(format!("convert {out} --out {to}"));
        says(&said, "1 part(s) of the recording are missing");
    }
    refuse_each([
        (format!("{record} --split-mb 0"), "--split-mb "),
        (format!("{record} --split-mb nan"), "--split-mb "),
        (format!("{record} --split-s 0.5"), "--split-s "),
        (format!("live {scene} --port {port} --split-s 1"), "need --record"),
    ]);
}

/// Total variation of live frames with more pixels than it can keep up with is rejected before work.
#[test]
fn live_total_variation_of_too_many_pixels_is_refused() {
    let folder = Folder::new();
    let emulator = start(device("skin"));
    let (_, _, out) = record(&folder, &emulator, 1, 0);
    let content = read_text(scene(&folder));
    let too_many = "40 measurements on 648 x 648 pixels are too many for total variation of live frames: use at \
                    most 647";
    for (pixels, wanted) in [(648, too_many), (4096, "40 measurements on 4096 x 4096 pixels")] {
        let keys = format!("[reconstruction]\nmethod = \"st-tv\"\npixels = {pixels}\n");
        let many = folder.write("many.toml", format!("{content}\n{keys}"));
        let (port, start) = (emulator.endpoint(), Instant::now());
        refuse_each([
            (format!("live {many} --port {port} --seconds 9"), wanted),
            (format!("replay {many} --from {out} --speed 1"), wanted),
        ]);
        assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
    }
}

/// Tables become recordings and tables again, with identical numbers.
#[test]
fn convert_keeps_every_bit() {
    let folder = Folder::new();
    let frames = Array2::from_shape_fn((5, 40), |(i, j)| (0.1 + i as f64).powf(j as f64 - 20.0));
    folder.write_array("a.npy", &frames);
    let convert = |from, to| format!("convert {} --out {}", folder.path(from), folder.path(to));
    for (from, to) in
        [("a.npy", "b.mcap"), ("b.mcap", "c.csv"), ("c.csv", "d.mcap"), ("d.mcap", "e.npy")]
    {
        succeed(convert(from, to));
    }
    assert_eq!(read_array::<Ix2>(folder.path("e.npy")), frames);
    let [there, unknown] = ["b.mcap", "b.txt"].map(|to| convert("a.npy", to));
    refuse_each([(there, "never overwritten"), (unknown, "--out must end in")]);
}
