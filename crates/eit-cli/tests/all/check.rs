//! What `eit check` reports about a faulty instrument: our own emulated device behind TCP.
#![cfg(unix)]

use crate::common::emulated::{information, start};
use crate::common::*;
use eit_hw::Quadruple;
use eit_hw::emulator::Eits1Device;
use std::sync::LazyLock;

/// A skin of 16 electrodes: its folder, its scene, and its voltages.
static SKIN: LazyLock<(Folder, String, Vec<f64>)> = LazyLock::new(|| {
    let folder = Folder::new();
    let instrument = "[instrument]\ndriver = \"eits1\"\nport = \"unused\"\nframe_rate_hz = 200.0\n";
    let sixteen = altered("count = 8", "count = 16").replace("edge_m = 0.012", "nodes = 800");
    let scene = folder.write("scene.toml", sixteen + instrument);
    let voltages = folder.path("v.csv");
    succeed(format!("forward {scene} --out {voltages}"));
    let table = recorded(&voltages, false).row(0).to_vec();
    assert_eq!(table.len(), 208);
    (folder, scene, table)
});

/// Value of a measurement in a frame: its number, electrodes, and value without and with noise.
type Change<'a> = &'a dyn Fn(usize, [u32; 4], f64, f64) -> f64;

/// Frames through the emulator: the exit code of `check` and its answer.
fn checked(change: Change<'_>) -> (Option<i32>, Value) {
    let (_, scene, table) = &*SKIN;
    let quadruples: Vec<[u32; 4]> = (0..16)
        .flat_map(|d| (2..15).map(move |k| [d, d + 1, d + k, d + k + 1].map(|e| e % 16)))
        .collect();
    let frame = |frame: usize| -> Vec<f64> {
        let value = |(i, &quadruple): (usize, &[u32; 4])| {
            let noise = ((frame * 7919 + i * 104_729) as f64).sin();
            change(frame, quadruple, table[i], table[i] * (1.0 + 1e-5 * noise))
        };
        quadruples.iter().enumerate().map(value).collect()
    };
    let values: Vec<Vec<f64>> = (0..120).map(frame).collect();
    let source = move |sequence: u64, _: &[Quadruple], slots: &mut [f64]| {
        slots.copy_from_slice(&values[sequence as usize % values.len()]);
    };
    let emulator = start(Box::new(Eits1Device::new(information(16, "skin"), Box::new(source))));
    let port = emulator.endpoint();
    let output = eit(format!("check {scene} --port {port} --frames 100 --json"));
    (output.status.code(), serde_json::from_slice(&output.stdout).unwrap_or(Value::Null))
}

/// The faulty electrode is named, and no other; faults that neither violate reciprocity nor are flagged, too: a bridge
/// that removes the voltage between two electrodes, and a multiplexer that holds the values of one.
#[test]
fn check_names_the_electrode_at_fault_and_exits_4() {
    let (code, answer) = checked(&|_, _, _, value| value);
    assert_eq!((code, &answer["verdict"]), (Some(0), &"good".into()), "{answer}");
    assert_eq!(answer["findings"], json!([]));
    let at = |q: [u32; 4]| q.contains(&12);
    // electrodes are counted from 1
    let faults: [(&str, &[u64], &str, Change<'_>); 5] = [
        ("dead", &[13], "", &|_, q, _, value| if at(q) { 0.0 } else { value }),
        ("floating", &[13], "", &|_, q, _, value| if at(q) { 10.0 } else { value }),
        ("noisy", &[13], "", &|f, q, _, value| value * if at(q) { 1.0 + noise(f, q) } else { 1.0 }),
        ("bridge", &[13, 14], "shorted", &|_, [a, _, m, _], _, value| {
            value * if [a, m].contains(&12) { 1e-3 } else { 1.0 }
        }),
        ("held", &[13], "stuck", &|_, q, still, value| if at(q) { still } else { value }),
    ];
    for (name, electrodes, what, fault) in faults {
        let (code, answer) = checked(fault);
        assert_eq!((code, &answer["verdict"]), (Some(4), &"faulty".into()), "{name}: {answer}");
        let findings = answer["findings"].as_array().unwrap();
        let named: Vec<u64> = findings.iter().filter_map(|f| f["electrode"].as_u64()).collect();
        let is_right = !named.is_empty() && named.iter().all(|e| electrodes.contains(e));
        assert!(is_right && (named.len() == 1 || electrodes.len() == 2), "{name}: {answer}");
        let is_said = |f: &&Value| f["electrode"].is_u64() && f["what"].to_string().contains(what);
        assert!(findings.iter().any(|f| is_said(&f)), "{name}: {answer}");
    }
}

/// Two channels that never change are reported as two, and a converter too coarse for touches is a fault.
#[test]
fn check_counts_stuck_channels_and_the_steps_of_the_converter() {
    let stuck = [[0, 1, 12, 13], [4, 5, 11, 12]];
    let (code, answer) = checked(&|_, q, _, value| if stuck.contains(&q) { 0.02 } else { value });
    assert_eq!(code, Some(0), "{answer}");
    let what = answer["findings"].to_string();
    let both = "2 measurements do not change: drive (1, 2), pair (13, 14) and drive (5, 6), pair (12, 13);";
    assert!(what.contains(both), "{what}");
    // 10 bits of the largest voltage: hardly any value changes, and a touch is less than a step
    assert!(number(&answer["resolution"], "steps_per_touch") > 100.0, "{answer}");
    let step = 0.05 / 1023.0 * 40.0;
    // noise of a twentieth of a step, as from an amplifier
    let coarse = |f, q, _, value: f64| step * (value / step + 0.05 * noise(f, q)).round();
    let (code, answer) = checked(&coarse);
    assert_eq!(code, Some(4), "{answer}");
    let resolution = &answer["resolution"];
    assert!(number(resolution, "still_measurements") > 104.0, "{answer}");
    assert!(number(resolution, "steps_per_touch") < 1.0, "{answer}");
    assert!(answer["findings"].to_string().contains("measurements never change"), "{answer}");
}

fn noise(frame: usize, q: [u32; 4]) -> f64 {
    let seed = q.iter().fold(frame as u64, |seed, &e| seed * 31 + u64::from(e));
    ((seed * 104_729) as f64).sin()
}
