//! Finds touches in a recording without images, as a robot would, and measures the time per frame.
//!
//! ```text
//! cargo run --release -p eit-skin --example find_touches -- SCENE OUT.csv [FRAMES] [--truth TOUCHES.csv]
//! ```
//!
//! With the true touches of a simulation, it lists the fingers that have no touch within 25 mm.

#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use eit_skin::ndarray::Axis;
use eit_skin::scene::Scene;
use eit_skin::touches::TouchFinder;
use eit_skin::{MeshOverride, Progress, Skin, Touch, TouchState};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Distance within which a touch belongs to a finger, metres.
const GATE_M: f64 = 25e-3;

/// A finger in a frame of a simulation.
struct Finger {
    frame: usize,
    position_m: [f64; 3],
    force_n: f64,
}

impl Finger {
    fn has(&self, touch: &Touch) -> bool {
        let way = |k: usize| touch.position_m[k] - self.position_m[k];
        touch.valid && touch.state != TouchState::End && way(0).hypot(way(1)) < GATE_M
    }
}

/// Reads `touches.csv` of `eit simulate`.
fn fingers(file: &str) -> Result<Vec<Finger>, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(file)?;
    let finger = |line: &str| {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |k: usize| columns.get(k).and_then(|text| text.parse::<f64>().ok());
        Some(Finger {
            frame: columns.first()?.parse().ok()?,
            position_m: [number(3)?, number(4)?, 0.0],
            force_n: number(5)?,
        })
    };
    let lines = text.lines().skip(1);
    lines.map(|line| finger(line).ok_or_else(|| format!("{file}: {line}").into())).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (args, truth) = match args.iter().position(|arg| arg == "--truth") {
        Some(at) => (&args[..at], args.get(at + 1)),
        None => (&args[..], None),
    };
    let truth = truth.map_or(Ok(Vec::new()), |file| fingers(file))?;
    let [scene, out, frames @ ..] = args else {
        return Err("usage: find_touches SCENE OUT.csv [FRAMES] [--truth TOUCHES.csv]".into());
    };
    let mut progress = Progress::silent();
    let begin = Instant::now();
    let skin = Skin::set_up(&Scene::load(scene)?, &MeshOverride::default(), &mut progress)?;
    let files: Vec<PathBuf> = frames.iter().map(PathBuf::from).collect();
    let frames = skin.read_frames(&files, None)?;
    let fitted = Arc::new(skin.linearise(&mut progress)?).fit(frames)?;
    let linearised_s = begin.elapsed().as_secs_f64();
    let rate_hz = fitted.frames.rate_hz.unwrap_or(20.0);
    let finder = TouchFinder::new(&fitted, rate_hz, &mut progress)?;
    let mut finder = finder.ok_or("the noise is unknown")?;
    let made_s = begin.elapsed().as_secs_f64() - linearised_s;
    let mut csv = std::io::BufWriter::new(std::fs::File::create(out)?);
    writeln!(csv, "frame,id,state,x_m,y_m,z_m,intensity,confidence,age,valid")?;
    let mut times = Vec::new();
    let mut faults = Vec::new();
    for (frame, row) in fitted.frames.values.axis_iter(Axis(0)).enumerate() {
        let (values, good) = (row.to_vec(), fitted.frames.good.row(frame));
        let time_s = frame as f64 / rate_hz;
        let begin = Instant::now();
        let touches = finder.push(&values, |i| good[i], time_s)?;
        times.push(begin.elapsed().as_secs_f64());
        let touches = touches.to_vec();
        for finger in truth.iter().filter(|finger| finger.frame == frame) {
            if !touches.iter().any(|touch| finger.has(touch)) {
                let [x, y, _] = finger.position_m;
                println!("frame {frame}: finger of {:.2} N at {x:.3}, {y:.3} lost", finger.force_n);
            }
        }
        for touch in &touches {
            let ([x, y, z], Touch { id, state, valid, confidence, age_frames, .. }) =
                (touch.position_m, *touch);
            let state = format!("{state:?}").to_lowercase();
            let intensity = touch.intensity_s_m2;
            writeln!(
                csv,
                "{frame},{id},{state},{x:.6},{y:.6},{z:.6},{intensity:.4e},{confidence:.4},{age_frames},{valid}"
            )?;
        }
        for fault in finder.faults() {
            if !faults.contains(fault) {
                faults.push(*fault);
                println!(
                    "frame {frame}: electrode {} {}",
                    fault.electrode + 1,
                    fault.kind.description()
                );
            }
        }
    }
    times.sort_by(f64::total_cmp);
    let at = |part: f64| 1e3 * times[((times.len() - 1) as f64 * part) as usize];
    println!(
        "set-up {:.2} s and {made_s:.2} s; a frame {:.3} ms, p99 {:.3}, longest {:.3} ms",
        linearised_s,
        at(0.5),
        at(0.99),
        at(1.0)
    );
    Ok(())
}
