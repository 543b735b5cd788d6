//! Memory of commands that read files: the whole process takes at most 64 MB plus ten times the file.
#![cfg(target_os = "linux")]

use crate::common::*;

const MOST_BYTES: u64 = 64_000_000;
const FILE_BYTES: usize = 20_000_000;

/// Runs a command; returns its largest memory in bytes, and whether it succeeded.
fn peak(line: &str) -> (u64, bool) {
    let mut child = command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    loop {
        // the largest so far, whenever it is asked
        let found = std::fs::read_to_string(&status).unwrap_or_default();
        let line = found.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse().ok());
        peak = peak.max(1024 * kilobytes.unwrap_or(0_u64));
        if let Some(ended) = child.try_wait().unwrap() {
            return (peak, ended.success());
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn check(line: String, file: &str) {
    let bytes = std::fs::metadata(file).unwrap().len();
    let (peak, succeeded) = peak(&line);
    println!("{:.1} MB of {:.1}: {line}", 1e-6 * peak as f64, 1e-6 * bytes as f64);
    assert!(succeeded, "{line}");
    assert!(peak > 1_000_000, "not measured");
    assert!(peak <= MOST_BYTES + 10 * bytes, "{line}: {peak} bytes, file of {bytes}");
}

#[test]
fn commands_that_read_take_little_memory() {
    let folder = Folder::new();
    let path = |name: &str| folder.path(name);
    let rows = table(&Array2::from_shape_fn((2, 208), |(row, _)| 7.0 + row as f64));
    let digits = folder.write("digits.csv", rows.repeat(FILE_BYTES / 832));
    let line = folder.write("line.csv", format!("{}\n", vec!["7"; FILE_BYTES / 2].join(",")));
    // the frames of 48 000 lines, as text, as an array and as a recording, and back
    let (array, recording) = (path("digits.npy"), path("digits.mcap"));
    check(format!("convert {digits} --out {}", path("copy.csv")), &digits);
    check(format!("convert {digits} --out {array}"), &digits);
    check(format!("convert {digits} --scene paper-disc --out {recording}"), &digits);
    check(format!("convert {array} --out {}", path("array.csv")), &array);
    check(format!("convert {recording} --out {}", path("recording.csv")), &recording);
    check(format!("convert {recording} --out {}", path("copy.mcap")), &recording);
    check(format!("convert {recording} --recover --out {}", path("whole.mcap")), &recording);
    check(format!("convert {line} --out {}", path("line.npy")), &line);
    // a frame that no recording can hold is refused before any is written
    let refused = path("line.mcap");
    assert!(!peak(&format!("convert {line} --out {refused}")).1);
    assert!(!exists(&refused));
    for (one, other) in [("copy.csv", "array.csv"), ("copy.csv", "recording.csv")] {
        assert_eq!(read(path(one)), read(path(other)));
    }
}

/// Settings beyond a size whose most expensive content fits the bound, and many presses, are refused at once.
#[test]
fn settings_and_tables_take_little_memory() {
    let folder = Folder::new();
    let (scene, all) = (SMALL, 1 << 19);
    let filled = |unit: &str| {
        format!("{scene}\n[x]\na = [{}]\n", unit.repeat((all - 40 - scene.len()) / unit.len()))
    };
    let contents = ["1,", "[],", "{},", "\"\","].map(filled);
    for content in contents.iter().chain([&format!("{scene}{}", "\n".repeat(all - scene.len()))]) {
        let file = folder.write("scene.toml", content);
        let (peak, _) = peak(&format!("plan {file}"));
        assert!(peak > 1_000_000 && peak <= MOST_BYTES + 10 * content.len() as u64, "{peak}");
        let said = stderr(&eit(format!("plan {file}")));
        assert!(!said.contains("kB"), "not read: {said}");
        folder.write("scene.toml", format!("{content}{}", " ".repeat(all)));
        says(&refuse(format!("plan {file}")), "not a file of at most 512 kB");
    }
    let out = folder.path("a.learned");
    let presses = folder.write("presses.csv", format!("x_m,y_m\n{}", "0,0\n".repeat(5_000_000)));
    let learn = format!("learn paper-disc --presses {presses} --frames {presses} --out {out}");
    let start = Instant::now();
    let (peak, succeeded) = peak(&learn);
    assert!(!succeeded && peak <= MOST_BYTES + 10 * 20_000_000, "{peak}");
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
    assert!(refuse(&learn).contains("more than 200000 presses"));
}
