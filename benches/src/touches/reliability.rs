//! Whether confidence is calibrated: the confidence of touches against the fraction of them that is
//! near a finger.

use crate::Result;
use crate::recording::{Recording, Simulator, WITHIN_M, distance_m, valid_touches};
use crate::table::{Cell, Table};
use eit_fem::fabric::{FabricSettings, Instrument};
use eit_skin::method::Method;

/// Edges of the confidence bins.
const EDGES: [f64; 8] = [0.0, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0];
/// Scripts with their seeds; a quick run takes the last.
const SCRIPTS: [(&str, u64); 6] = [
    ("one-finger", 701),
    ("two-fingers", 702),
    ("stroking", 703),
    ("tapping", 704),
    ("closing-in", 705),
    ("random", 706),
];
/// Noise of the instrument, volts: 87 and 67 dB below the root mean square of the reference. With
/// little noise, few touches are uncertain.
const NOISE_V: [f64; 2] = [2e-5, 2e-4];

/// A valid touch in a frame.
#[derive(Debug, Clone, Copy)]
struct Listed {
    confidence: f64,
    /// Whether it is near a finger.
    is_true: bool,
    /// Whether any finger is on the skin.
    is_touched: bool,
}

/// Counts the true ones among some touches.
fn cells<'a>(name: String, touches: impl Iterator<Item = &'a Listed>) -> Vec<Cell> {
    let (mut count, mut true_ones, mut confidence) = (0.0, 0.0, 0.0);
    for touch in touches {
        count += 1.0;
        true_ones += f64::from(u8::from(touch.is_true));
        confidence += touch.confidence;
    }
    vec![
        Cell::Text(name),
        Cell::Number(count - true_ones, 0),
        Cell::Number(count, 0),
        Cell::Number(confidence / count, 3),
        Cell::Number(true_ones / count, 3),
    ]
}

/// Simulates the scripts and lists their touches by confidence, beginning with those on an untouched
/// skin.
pub(super) fn table(simulator: &Simulator, quick: bool) -> Result<Table> {
    let scripts = if quick { &SCRIPTS[SCRIPTS.len() - 1..] } else { &SCRIPTS };
    let frames = if quick { 120 } else { 400 };
    let mut all = Vec::new();
    for &(script, seed) in scripts {
        for noise_v in NOISE_V {
            let instrument = Instrument { noise_v: [noise_v; 2], ..Instrument::default() };
            let fabric = FabricSettings { instrument, ..FabricSettings::default() };
            all.extend(listed(simulator, &simulator.built_in(script, seed, &fabric, frames)?)?);
        }
    }
    let untouched = all.iter().filter(|touch| !touch.is_touched);
    let mut rows = vec![
        cells("while nothing touched the skin".to_owned(), untouched),
        cells("all".to_owned(), all.iter()),
    ];
    for (&low, &high) in EDGES.iter().zip(&EDGES[1..]) {
        let within = |t: &&Listed| t.confidence >= low && (t.confidence < high || high >= 1.0);
        if all.iter().any(|touch| within(&touch)) {
            rows.push(cells(format!("{low} to {high}"), all.iter().filter(within)));
        }
    }
    let names: Vec<&str> = scripts.iter().map(|(name, _)| *name).collect();
    Ok(Table {
        title: "Is the confidence of touches calibrated?",
        note: format!(
            "Every valid touch of every frame, and whether a finger was within {:.0} mm. Of touches \
             with confidence 0.9, nine in ten should have a finger. Simulated fabric with all its \
             defaults, scripts {}, {frames} frames each at most, noise of {:.0} and {:.0} uV.",
            1e3 * WITHIN_M,
            names.join(", "),
            1e6 * NOISE_V[0],
            1e6 * NOISE_V[1],
        ),
        columns: vec!["confidence", "without a finger", "touches", "mean confidence", "true"],
        rows,
    })
}

fn listed(simulator: &Simulator, recording: &Recording) -> Result<Vec<Listed>> {
    let chain = simulator.chain(&recording.script, Method::GaussNewton, None)?;
    let touches = valid_touches(&recording.reconstruct(&chain)?)?;
    let mut all = Vec::new();
    for frame in recording.after_quiet() {
        let fingers = recording.fingers(frame);
        all.extend(touches[frame].iter().map(|touch| {
            let is_near = |place| distance_m(touch.position_m, place) <= WITHIN_M;
            Listed {
                confidence: touch.confidence,
                is_true: fingers.iter().any(|finger| is_near(finger.position_m)),
                is_touched: !fingers.is_empty(),
            }
        }));
    }
    Ok(all)
}
