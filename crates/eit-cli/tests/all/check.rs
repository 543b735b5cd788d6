//! What `eit check` reports about a faulty instrument: our own emulated device behind TCP.
#![cfg(unix)]

use crate::common::emulated::{information, start};
use crate::common::{Folder, SMALL, eit, recorded, succeed};
use eit_hw::Quadruple;
use eit_hw::emulator::Eits1Device;
use serde_json::Value;

/// Frames of 16 electrodes through the emulator: the verdict, the findings, and the answer of `check`.
fn checked(folder: &Folder, change: impl Fn(usize, [u32; 4], f64) -> f64) -> (Option<i32>, Value) {
    let quadruples: Vec<[u32; 4]> = (0..16)
        .flat_map(|d| (2..15).map(move |k| [d, d + 1, d + k, d + k + 1].map(|e| e % 16)))
        .collect();
    let instrument = "[instrument]\ndriver = \"eits1\"\nport = \"unused\"\nframe_rate_hz = 200.0\n";
    let sixteen = SMALL.replace("count = 8", "count = 16").replace("edge_m = 0.012", "nodes = 800");
    let scene = folder.write("scene.toml", sixteen + instrument);
    let voltages = folder.path("v.csv");
    succeed(format!("forward {scene} --out {voltages}"));
    let table = recorded(&voltages, false).row(0).to_vec();
    assert_eq!(table.len(), 208);
    let values: Vec<Vec<f64>> = (0..120)
        .map(|frame| {
            let value = |(i, &quadruple): (usize, &[u32; 4])| {
                let noise = ((frame * 7919 + i * 104_729) as f64).sin();
                change(frame, quadruple, table[i] * (1.0 + 1e-5 * noise))
            };
            quadruples.iter().enumerate().map(value).collect()
        })
        .collect();
    let source = move |sequence: u64, _: &[Quadruple], slots: &mut [f64]| {
        slots.copy_from_slice(&values[sequence as usize % values.len()]);
    };
    let emulator = start(Box::new(Eits1Device::new(information(16, "skin"), Box::new(source))));
    let port = emulator.endpoint().to_string();
    let output = eit(format!("check {scene} --port {port} --frames 100 --json"));
    let answer = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), answer)
}

fn electrodes(answer: &Value) -> Vec<u64> {
    let findings = answer["findings"].as_array().unwrap();
    findings.iter().filter_map(|finding| finding["electrode"].as_u64()).collect()
}

/// The faulty electrode is named, and no other.
#[test]
fn check_names_the_electrode_at_fault_and_exits_4() {
    let folder = Folder::new();
    let (code, answer) = checked(&folder, |_, _, value| value);
    assert_eq!((code, &answer["verdict"]), (Some(0), &"good".into()), "{answer}");
    // dead; floating at the largest value; noisy. Electrode 13, counted from 1
    let faults: [&dyn Fn(usize, [u32; 4], f64) -> f64; 3] = [
        &|_, q, value| if q.contains(&12) { 0.0 } else { value },
        &|_, q, value| if q.contains(&12) { 10.0 } else { value },
        &|frame, q, value| if q.contains(&12) { value * (1.0 + noise(frame, q)) } else { value },
    ];
    for (index, fault) in faults.iter().enumerate() {
        let (code, answer) = checked(&folder, fault);
        assert_eq!((code, &answer["verdict"]), (Some(4), &"faulty".into()), "{index}: {answer}");
        assert_eq!(electrodes(&answer), [13], "{index}: {answer}");
    }
}

/// Two channels that never change are reported as two, and a converter too coarse for touches is a fault.
#[test]
fn check_counts_stuck_channels_and_the_steps_of_the_converter() {
    let folder = Folder::new();
    let stuck = [[0, 1, 12, 13], [4, 5, 11, 12]];
    let (code, answer) =
        checked(&folder, |_, q, value| if stuck.contains(&q) { 0.02 } else { value });
    assert_eq!(code, Some(0), "{answer}");
    let what = answer["findings"].to_string();
    let both = "2 measurements do not change: drive (1, 2), pair (13, 14) and drive (5, 6), pair (12, 13);";
    assert!(what.contains(both), "{what}");
    // 10 bits of the largest voltage: hardly any value changes, and a touch is less than a step
    let (_, answer) = checked(&folder, |_, _, value| value);
    let fine = answer["resolution"]["steps_per_touch"].as_f64().unwrap();
    assert!(fine > 100.0, "{answer}");
    let step = 0.05 / 1023.0 * 40.0;
    let (code, answer) = checked(&folder, |frame, q, value| {
        // noise of a twentieth of a step, as from an amplifier
        step * (value / step + 0.05 * noise(frame, q)).round()
    });
    assert_eq!(code, Some(4), "{answer}");
    let resolution = &answer["resolution"];
    assert!(resolution["still_measurements"].as_u64().unwrap() > 104, "{answer}");
    assert!(resolution["steps_per_touch"].as_f64().unwrap() < 1.0, "{answer}");
    assert!(answer["findings"].to_string().contains("measurements never change"), "{answer}");
}

fn noise(frame: usize, q: [u32; 4]) -> f64 {
    let seed = q.iter().fold(frame as u64, |seed, &e| seed * 31 + u64::from(e));
    ((seed * 104_729) as f64).sin()
}
