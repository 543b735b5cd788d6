//! Meshes, protocols and numbers for tests.

#[cfg(feature = "fabric")]
pub mod skins;
pub mod textbook;

use eit_fem::analytic::DiscSeries;
use eit_fem::{DrivenElectrodes, ElementOrder, FemError, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Electrode, Mesh, RimElectrodes, Surface};
use fixtures::MeshArrays;
use ndarray::{Array, Array1, ArrayView1, Dimension};
use std::sync::LazyLock;

pub const BOTH: [ElementOrder; 2] = [ElementOrder::Linear, ElementOrder::Quadratic];

/// The paper's disc.
pub const RADIUS_M: f64 = 0.1;
pub const WIDTH_M: f64 = 0.0196;
pub const CONDUCTIVITY_S: f64 = 1e-5;
pub const IMPEDANCE_OHM_M: f64 = 1e3;

pub fn paper_electrodes() -> RimElectrodes {
    RimElectrodes::equally_spaced(16, WIDTH_M)
}

pub fn paper_protocol() -> Protocol {
    PairProtocol::default().protocol().unwrap()
}

pub fn mesh_of(arrays: &MeshArrays) -> Mesh {
    let nodes = arrays.nodes.rows().into_iter().map(|r| [r[0], r[1], 0.0]).collect();
    let surface = Surface::new(nodes, arrays.triangles.clone()).unwrap();
    let electrodes = arrays.edges_per_electrode().into_iter().map(Electrode::Rim).collect();
    Mesh::new(surface, electrodes).unwrap()
}

/// Ring mesh of a unit disc: ring `k` of `rings` has `6 k` nodes, so the mesh has six-fold
/// symmetry. `rings` is a multiple of 4. There are 12 electrodes that cover half the rim; electrode
/// `l` is centred at `(l + 1/2) 30 degrees` and covers 15 degrees.
pub fn ring_disc(rings: usize) -> Mesh {
    assert_eq!(rings % 4, 0);
    let first = |ring: usize| if ring == 0 { 0 } else { 1 + 3 * ring * (ring - 1) };
    let mut nodes = vec![[0.0, 0.0, 0.0]];
    for ring in 1..=rings {
        for i in 0..6 * ring {
            let angle = std::f64::consts::TAU * i as f64 / (6 * ring) as f64;
            let r = ring as f64 / rings as f64;
            nodes.push([r * angle.cos(), r * angle.sin(), 0.0]);
        }
    }
    let mut triangles = Vec::new();
    for ring in 1..=rings {
        let outer = |i: usize| (first(ring) + i % (6 * ring)) as u32;
        let inner =
            |i: usize| if ring == 1 { 0 } else { (first(ring - 1) + i % (6 * (ring - 1))) as u32 };
        for sector in 0..6 {
            for i in 0..ring {
                let (o, n) = (sector * ring + i, sector * (ring - 1) + i);
                triangles.push([outer(o), outer(o + 1), inner(n)]);
                if i + 1 < ring {
                    triangles.push([inner(n), outer(o + 1), inner(n + 1)]);
                }
            }
        }
    }
    let per = 6 * rings / 12;
    let rim = |i: usize| (first(rings) + i % (6 * rings)) as u32;
    let electrodes = (0..12)
        .map(|l| {
            let from = l * per + per / 4;
            Electrode::Rim((from..from + per / 2).map(|i| [rim(i), rim(i + 1)]).collect())
        })
        .collect();
    Mesh::new(Surface::new(nodes, triangles).unwrap(), electrodes).unwrap()
}

/// Angles of the electrode centres of [`ring_disc`].
pub fn ring_disc_angles() -> Vec<f64> {
    (0..12).map(|l| (l as f64 + 0.5) * std::f64::consts::TAU / 12.0).collect()
}

/// A strip `length x width` of right triangles with one electrode over each short side.
pub fn strip(length: f64, width: f64, columns: usize, rows: usize) -> Mesh {
    let node = |i: usize, j: usize| (i * (rows + 1) + j) as u32;
    let nodes = (0..=columns)
        .flat_map(|i| {
            (0..=rows).map(move |j| {
                [length * i as f64 / columns as f64, width * j as f64 / rows as f64, 0.0]
            })
        })
        .collect();
    let mut triangles = Vec::new();
    for i in 0..columns {
        for j in 0..rows {
            triangles.push([node(i, j), node(i + 1, j), node(i + 1, j + 1)]);
            triangles.push([node(i, j), node(i + 1, j + 1), node(i, j + 1)]);
        }
    }
    let side = |i: usize| Electrode::Rim((0..rows).map(|j| [node(i, j), node(i, j + 1)]).collect());
    Mesh::new(Surface::new(nodes, triangles).unwrap(), vec![side(0), side(columns)]).unwrap()
}

/// Random numbers from 0 to 1.
pub fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut random = fixtures::Random::new(seed);
    (0..count).map(|_| random.uniform()).collect()
}

pub fn moved(mesh: &Mesh, to: impl FnMut([f64; 3]) -> [f64; 3]) -> Mesh {
    let nodes = mesh.surface().nodes().iter().copied().map(to).collect();
    let surface = Surface::new(nodes, mesh.surface().triangles().to_vec()).unwrap();
    Mesh::new(surface, mesh.electrodes().to_vec()).unwrap()
}

pub fn with_electrodes(mesh: &Mesh, change: impl FnOnce(&mut Vec<Electrode>)) -> Mesh {
    let mut electrodes = mesh.electrodes().to_vec();
    change(&mut electrodes);
    Mesh::new(mesh.surface().clone(), electrodes).unwrap()
}

/// [`ring_disc`] with a patch as its last electrode.
pub fn patched_disc() -> Mesh {
    with_electrodes(&ring_disc(8), |list| list[11] = Electrode::Patch(vec![0, 1, 2, 3]))
}

/// [`ring_disc`] with a curved rim: the midpoints of rim edges lie on the circle.
pub fn round_disc(rings: usize) -> Mesh {
    let mesh = ring_disc(rings);
    let radius: Vec<f64> = mesh.surface().nodes().iter().map(|p| p[0].hypot(p[1])).collect();
    let on_rim = |n: u32| radius[n as usize] > 1.0 - 1e-12;
    // both ends are on the last ring, so it is a rim edge
    let middle = |edge: [u32; 2], p: [f64; 3]| {
        let r = p[0].hypot(p[1]);
        if edge.into_iter().all(on_rim) { [p[0] / r, p[1] / r, 0.0] } else { p }
    };
    mesh.with_midpoints(middle).unwrap()
}

pub fn largest<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    values.into_iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Largest difference, relative to the largest value.
pub fn relative<D: Dimension>(found: &Array<f64, D>, wanted: &Array<f64, D>) -> f64 {
    largest(&(found - wanted)) / largest(wanted)
}

/// Exchanging current and voltage changes nothing: both values come from one symmetric matrix.
pub fn assert_reciprocal(protocol: &Protocol, v: &Array1<f64>) {
    let quadruples = protocol.quadruples().unwrap();
    for (i, &[a, b, m, n]) in quadruples.iter().enumerate() {
        let j = quadruples.iter().position(|&q| q == [m, n, a, b]).unwrap();
        assert!((v[i] - v[j]).abs() < 1e-13 * largest(v), "{i} {j}");
    }
}

/// Orders of convergence in the edge length, which is 1 / sqrt(nodes), between successive meshes.
pub fn orders(nodes: &[usize], errors: &[f64]) -> Vec<f64> {
    let pairs = nodes.windows(2).zip(errors.windows(2));
    pairs.map(|(n, e)| 2.0 * (e[0] / e[1]).ln() / (n[1] as f64 / n[0] as f64).ln()).collect()
}

/// Orders of convergence between meshes of halved edges.
pub fn halving_orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

/// `(8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h`, with the error `h^4 f^(5) / 30`.
pub fn five_points(h: f64, at: impl Fn(f64) -> Array1<f64>) -> Array1<f64> {
    (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
}

/// Checks that the remainder `|V(t) - V(0) - t J|` falls as `t^2` between halved steps, and that the
/// derivative is not zero.
///
/// The remainder is `t^2 |V''| / 2 + t^3 ..`. With a step of a few per cent of what it changes, the
/// slope is 2 to within 2 %; rounding (1e-14) stays four digits below the last remainder.
pub fn assert_slope_two(
    what: &str,
    slope: ArrayView1<'_, f64>,
    step: f64,
    at: impl Fn(f64) -> Array1<f64>,
) {
    let zero = at(0.0);
    let remainders =
        [step, 0.5 * step, 0.25 * step].map(|t| largest(&(at(t) - &zero - &(&slope * t))));
    let slopes = halving_orders(&remainders);
    assert!(slopes.iter().all(|s| (s - 2.0).abs() < 0.1), "{what}: {slopes:?} {remainders:?}");
    assert!(largest(slope) * step > 10.0 * remainders[0], "{what}: first order, {remainders:?}");
}

/// Adjacent pairs, one ampere.
pub fn adjacent(electrodes: usize) -> Protocol {
    PairProtocol { electrodes, current_a: 1.0, ..Default::default() }.protocol().unwrap()
}

/// Adjacent pairs of 12 electrodes, half an ampere, with measurements on driven electrodes.
pub fn kept() -> Protocol {
    let driven_electrodes = DrivenElectrodes::Keep;
    PairProtocol { electrodes: 12, driven_electrodes, current_a: 0.5, ..Default::default() }
        .protocol()
        .unwrap()
}

pub fn model_of(mesh: &Mesh, protocol: &Protocol, z: &[f64], order: ElementOrder) -> ForwardModel {
    ForwardModel::with_element_order(mesh, protocol, z, order).unwrap()
}

/// Voltages of a sheet of one conductivity.
pub fn even(model: &ForwardModel, conductivity_s: f64) -> Array1<f64> {
    model.forward(&vec![conductivity_s; model.elements()]).unwrap()
}

/// Random numbers from `least` to `least + 1`.
pub fn uneven(seed: u64, count: usize, least: f64) -> Vec<f64> {
    noise(seed, count).iter().map(|x| least + x).collect()
}

/// Conductivities from 0.5 to 1.5.
pub fn random_conductivity(model: &ForwardModel, seed: u64) -> Vec<f64> {
    uneven(seed, model.elements(), 0.5)
}

/// The paper's disc with 16 electrodes, mesh-free.
pub fn paper_series(degree: usize, harmonics: usize) -> DiscSeries {
    DiscSeries {
        radius_m: RADIUS_M,
        conductivity_s: CONDUCTIVITY_S,
        electrode_angles_rad: (0..16).map(|l| (22.5 * f64::from(l)).to_radians()).collect(),
        electrode_width_m: WIDTH_M,
        contact_impedance_ohm_m: IMPEDANCE_OHM_M,
        degree,
        harmonics,
    }
}

/// Voltages of a series in protocol order.
pub fn series_voltages(series: &DiscSeries, protocol: &Protocol, impedance: &[f64]) -> Array1<f64> {
    let currents = protocol.stimulations_a();
    let potentials = series.electrode_potentials_with(currents, impedance).unwrap();
    let patterns = protocol.measurement_patterns();
    let voltage = |&[s, m]: &[u32; 2]| potentials.row(s as usize).dot(&patterns.row(m as usize));
    protocol.data().iter().map(voltage).collect()
}

/// Voltages of [`paper_series`] for adjacent pairs: with few and with many terms.
pub static PAPER_VOLTAGES: LazyLock<[Array1<f64>; 2]> = LazyLock::new(|| {
    [(12, 2000), (16, 4000)].map(|(degree, harmonics)| {
        series_voltages(&paper_series(degree, harmonics), &paper_protocol(), &[IMPEDANCE_OHM_M; 16])
    })
});

/// A strip with randomly displaced inner nodes, to avoid symmetry.
pub fn rough_strip(length: f64, width: f64, columns: usize, rows: usize) -> Mesh {
    let even = strip(length, width, columns, rows);
    let shifts = noise(11, 2 * even.surface().nodes().len());
    let mut shifts = shifts.chunks_exact(2);
    let step = (length / columns as f64).min(width / rows as f64);
    let inside = |x: f64, size: f64| x > 1e-9 * size && x < (1.0 - 1e-9) * size;
    moved(&even, |p| {
        let shift = shifts.next().unwrap();
        let free = inside(p[0], length) && inside(p[1], width);
        let by = |k: usize| if free { 0.5 * step * (shift[k] - 0.5) } else { 0.0 };
        [p[0] + by(0), p[1] + by(1), 0.0]
    })
}

/// Voltages with other places of the nodes and other contacts.
pub fn deformed(model: &ForwardModel, nodes: &[[f64; 3]], z: &[f64], sigma: &[f64]) -> Array1<f64> {
    let mut geometry = model.geometry();
    model.deform(nodes, z, &mut geometry).unwrap();
    model.solve_deformed(&geometry, sigma, &mut model.workspace().unwrap()).unwrap().measurements()
}

/// Checks that a call fails with this message.
#[track_caller]
pub fn says<T>(result: Result<T, FemError>, wanted: &str) {
    assert_eq!(result.err().unwrap().to_string(), wanted);
}

/// Checks that a call fails with a message of one line that contains these words.
#[track_caller]
pub fn refused<T>(result: Result<T, FemError>, words: &str) {
    let message = result.err().unwrap().to_string();
    assert!(message.contains(words) && !message.contains('\n'), "{message}");
}
