//! Compares the times of stages with their floors, the limits set by flops and bytes on this
//! machine.
//!
//! Usage: `floors NODES...` with NODES of 500, 2000, 5000, 20000. Prints one JSON object per stage:
//! median CPU time on one thread, the work that every implementation must do, and the floor: flops
//! at the rate of a dense matrix product, bytes at the rate of a plain store or read of the same
//! amount of memory. Both rates are measured here, one after the other.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::stopwatch::median;
use benches::{Result, limits, problem};
use eit_inverse::{Noser, OneStepGaussNewton, OneStepSettings};
use eit_mesh::{Mesh, Raster};
use ndarray::Array2;
use serde_json::json;
use std::hint::black_box;

/// Repetitions of each timing.
const REPEATS: usize = 15;
/// Pixels per side of the image.
const PIXELS: usize = 64;
/// Number of frames in the batch.
const FRAMES: usize = 100;

/// The work of a stage.
#[derive(Default)]
struct Work {
    flop: f64,
    stored_bytes: usize,
    read_bytes: usize,
}

fn main() -> Result<()> {
    let flop_per_s = limits::matmul_flop_per_s()?;
    for argument in std::env::args().skip(1) {
        let target =
            argument.parse().map_err(|_| format!("'{argument}' is not a number of nodes"))?;
        if let Some(mesh) = problem::peers_mesh(target)? {
            let jacobian = forward_and_jacobian(&mesh, flop_per_s)?;
            frames(&mesh, &jacobian, flop_per_s)?;
        }
    }
    Ok(())
}

fn forward_and_jacobian(mesh: &Mesh, flop_per_s: f64) -> Result<Array2<f64>> {
    let model = problem::model(mesh)?;
    let sigma = problem::conductivity(model.elements());
    let mut workspace = model.workspace()?;
    let mut jacobian = Array2::zeros((model.protocol().measurements(), model.elements()));
    let forward = median(REPEATS, || {
        black_box(model.solve(&sigma, &mut workspace)?.measurements());
        Ok(())
    })?;
    let both = median(REPEATS, || {
        model.solve(&sigma, &mut workspace)?.jacobian_into(jacobian.view_mut())?;
        Ok(())
    })?;
    let cost = model.cost();
    let nodes = mesh.surface().nodes().len();
    // a factor with this many entries must be written, whatever the flops
    let work =
        Work { flop: cost.factor_flops, stored_bytes: 8 * cost.factor_entries, ..Work::default() };
    print(nodes, "forward: factorisation, measurements", forward.cpu_s, &work, flop_per_s)?;
    let fields = 2.0 * (cost.factor_entries * cost.field_solves) as f64;
    let products = 3.0 * (cost.field_products * model.elements()) as f64;
    let work = Work {
        flop: fields + products,
        stored_bytes: 8 * jacobian.len(),
        read_bytes: 8 * cost.factor_entries,
    };
    let seconds = both.cpu_s - forward.cpu_s;
    print(nodes, "Jacobian: fields, products, stores", seconds, &work, flop_per_s)?;
    Ok(jacobian)
}

fn frames(mesh: &Mesh, jacobian: &Array2<f64>, flop_per_s: f64) -> Result<()> {
    let nodes = mesh.surface().nodes().len();
    let (measurements, elements) = jacobian.dim();
    let settings = OneStepSettings::default();
    let mut made = None;
    let set_up = median(3, || {
        made = Some(OneStepGaussNewton::new(jacobian, &Noser::default(), settings.clone())?);
        Ok(())
    })?;
    let difference = made.ok_or("a set-up has run")?;
    let rank = difference.report().rank;
    // J P J' by symmetry, and P J' in the basis of its eigenvectors
    let flop = (measurements * measurements * elements + 2 * measurements * elements * rank) as f64;
    let stored_bytes = 8 * rank * elements;
    let work = Work { flop, stored_bytes, read_bytes: 8 * measurements * elements };
    print(nodes, "reconstruction set-up, NOSER", set_up.cpu_s, &work, flop_per_s)?;

    let raster = Raster::new(mesh.surface(), PIXELS)?;
    let on_pixels = difference.on_raster(raster.pixel_from_element())?;
    let pixels = on_pixels.image_len();
    let reference = vec![0.0; measurements];
    let frames = Array2::from_shape_fn((FRAMES, measurements), |(f, m)| ((f + 3 * m) % 7) as f64);
    let frame = frames.row(0).to_vec();
    let (mut memory, mut image) = (on_pixels.workspace(), vec![0.0; pixels]);
    let one = median(20 * REPEATS, || {
        on_pixels.reconstruct_into(&frame, &reference, &mut memory, &mut image)?;
        black_box(&image);
        Ok(())
    })?;
    let multiplications = rank * (measurements + pixels);
    let (flop, read_bytes) = (2.0 * multiplications as f64, 8 * multiplications);
    let work = Work { flop, read_bytes, ..Work::default() };
    print(nodes, "one frame on pixels", one.cpu_s, &work, flop_per_s)?;
    let batch = median(REPEATS, || {
        black_box(on_pixels.reconstruct_frames(frames.view(), &reference)?);
        Ok(())
    })?;
    let stored_bytes = 8 * FRAMES * pixels;
    let work = Work { flop: FRAMES as f64 * flop, stored_bytes, read_bytes };
    print(nodes, "batch of 100 frames on pixels", batch.cpu_s, &work, flop_per_s)
}

fn print(nodes: usize, stage: &str, cpu_s: f64, work: &Work, flop_per_s: f64) -> Result<()> {
    let rate = |bytes: usize, measure: fn(usize) -> Result<f64>| match bytes {
        0 => Ok(f64::INFINITY),
        bytes => measure(bytes),
    };
    let store_byte_per_s = rate(work.stored_bytes, limits::store_byte_per_s)?;
    let read_byte_per_s = rate(work.read_bytes, limits::read_byte_per_s)?;
    let arithmetic_s = work.flop / flop_per_s;
    let memory_s =
        work.stored_bytes as f64 / store_byte_per_s + work.read_bytes as f64 / read_byte_per_s;
    let line = json!({
        "nodes": nodes,
        "stage": stage,
        "cpu_s": cpu_s,
        "flop": work.flop,
        "stored_bytes": work.stored_bytes,
        "read_bytes": work.read_bytes,
        // infinite rates (nothing stored or read) become null
        "flop_per_s": flop_per_s,
        "store_byte_per_s": store_byte_per_s,
        "read_byte_per_s": read_byte_per_s,
        // arithmetic and memory access can overlap
        "floor_s": arithmetic_s.max(memory_s),
        "bound": if arithmetic_s > memory_s { "flops" } else { "bytes" },
    });
    println!("{line}");
    Ok(())
}
