//! Orders of measurements, and helpers shared by several test files.

pub mod arrays;
pub mod instruments;
pub mod recordings;
pub mod wire;

use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU8, Ordering};

use eit_hw::emulator::Listen;
use eit_hw::{
    Format, FrameOrientation, HwError, Quadruple, ReadOptions, Recording, parse_recording,
};

/// A free port, on Linux at a loopback address of its own: nobody else takes it while the instrument is unplugged.
pub fn own_port() -> Listen {
    static ADDRESSES: AtomicU8 = AtomicU8::new(2);
    let [low, high, ..] = std::process::id().to_le_bytes();
    let own = ADDRESSES.fetch_add(1, Ordering::Relaxed);
    let host = if cfg!(target_os = "linux") { [127, high, low, own] } else { [127, 0, 0, 1] };
    Listen::Tcp(format!("{}:0", Ipv4Addr::from(host)))
}

/// Drives (d, d+gap), measured pairs (m, m+1) of `count` electrodes from `first(d)` on.
fn pairs(n: u32, gap: u32, count: u32, first: fn(u32) -> u32) -> Vec<Quadruple> {
    let drive = |d| {
        (first(d)..first(d) + count)
            .map(move |m| [d, d + gap, m, m + 1].map(|electrode| electrode % n))
    };
    (0..n).flat_map(drive).collect()
}

/// Adjacent drive (d, d+1), measured pairs (d+2+k, d+3+k) mod n.
pub fn rotated(n: u32) -> Vec<Quadruple> {
    pairs(n, 1, n - 3, |d| d + 2)
}

/// Adjacent drive (d, d+1), all measured pairs (m, m+1) by m.
pub fn ascending_kept(n: u32) -> Vec<Quadruple> {
    pairs(n, 1, n, |_| 0)
}

/// [`ascending_kept`] without measured pairs that include a driven electrode.
pub fn ascending(n: u32) -> Vec<Quadruple> {
    apart(ascending_kept(n))
}

/// Adjacent drive (d, d+1), all measured pairs (d+k, d+k+1) mod n.
pub fn rotated_kept(n: u32) -> Vec<Quadruple> {
    pairs(n, 1, n, |d| d)
}

/// Drive (d, d+8), measured pairs (m, m+1) by m without a driven electrode.
pub fn opposite(n: u32) -> Vec<Quadruple> {
    apart(pairs(n, n / 2, n, |_| 0))
}

/// Without measured pairs that include a driven electrode.
pub fn apart(mut quadruples: Vec<Quadruple>) -> Vec<Quadruple> {
    quadruples.retain(|[a, b, m, n]| ![m, n].contains(&a) && ![m, n].contains(&b));
    quadruples
}

/// A place for a file of this name, in a folder of its own.
pub fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

pub type Parsed = Result<Recording, HwError>;

/// Parses the content of a file `f.FORMAT`.
pub fn parse(format: Format, content: impl AsRef<[u8]>, options: &ReadOptions) -> Parsed {
    parse_recording(content.as_ref(), format!("f.{format}"), format, options)
}

pub fn csv(content: impl AsRef<[u8]>) -> Parsed {
    parse(Format::Csv, content, &ReadOptions::default())
}

/// Options for a table.
pub fn table(frames_are: FrameOrientation, complex: bool) -> ReadOptions {
    ReadOptions { frames_are: Some(frames_are), complex, ..ReadOptions::default() }
}

/// Voltages for 1 A and 1 S between `n` equally spaced point electrodes on the rim of a homogeneous
/// disc: the potential at a distance r from a source on the rim is -ln(r) / pi, up to a constant.
pub fn point_electrode_disc(quadruples: &[Quadruple], n: u32) -> Vec<f64> {
    let pi = std::f64::consts::PI;
    let distance = |i: u32, j: u32| 2.0 * (pi * f64::from(i.abs_diff(j)) / f64::from(n)).sin();
    let voltage = |&[a, b, m, n]: &Quadruple| {
        let potential = |at: u32| (distance(at, b) / distance(at, a)).ln() / pi;
        // infinite or NaN on a driven electrode
        potential(m) - potential(n)
    };
    quadruples.iter().map(voltage).collect()
}

/// Asserts that this takes at most 64 MB plus ten times the file.
pub fn little_memory<T>(name: &str, file_bytes: usize, work: impl FnOnce() -> T) -> T {
    let mut result = None;
    let peak = allocation_counter::measure(|| result = Some(work())).bytes_max;
    let most = 64_000_000 + 10 * file_bytes as u64;
    assert!(peak <= most, "{name}: {peak} of {most} bytes");
    result.unwrap()
}

/// Asserts that the error message is one line and contains all of `parts`.
#[track_caller]
pub fn refused(result: Result<impl Sized, HwError>, parts: &[&str]) {
    let message = result.err().unwrap().to_string();
    assert!(!message.contains('\n'), "{message}");
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}
