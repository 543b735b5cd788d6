//! Voltages of a touched skin by the derivatives of the untouched one.
//!
//! With the change `c` of ln(conductivity) of each element, its strain `E` and the change of ln(contact impedance) of each
//! electrode, a voltage is
//!
//! ```text
//! v = v_0 + sum over elements of  J sigma c + A (E22 - E11) - 2 B E12  + sum over electrodes of  Z z (d ln z - stretch)
//! ```
//!
//! with the derivatives of [`crate::derivatives`]; only the part of the strain without dilation matters in two dimensions.
//! The strain is Hencky's, so that the slope of a dent counts and large strains have the effect of small ones one after the
//! other: with the gradient `D` of the displacement `U`, as far as the rim lets it, and `P` the part of `U` in the plane,
//!
//! ```text
//! E = ln(1 + grad P + grad P' + D' D) / 2
//! ```
//!
//! It is evaluated at centroids, from the closed forms of the dents with tabulated Bessel functions. Second order in `c` is left out: a disc whose conductivity changes by the factor `e^c` acts like
//! `2 tanh(c/2) = c - c^3/12`.
//!
//! Cost of a frame: for 104 different voltages and `e` elements 312 multiplications of f32 per element, 1.2 kB of the
//! matrix read, and about 120 flops per element and touch.

use super::instant::Instant;
use super::plan::Plan;
use crate::error::FemError;
use crate::fabric::bessel::KTable;
use crate::fabric::conductivity::sixteenths;
use crate::fabric::contact::Dent;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::motion::{Motion, Placed};
use crate::fabric::settings::Instrument;
use eit_core::vector::{Vector, along, cross, dot, norm, normal, scaled, sub, unit};
use eit_mesh::{Electrode, Mesh};
use faer::linalg::matmul::matmul;
use faer::{Accum, Col, Mat, Par};
use pulp::Arch;

/// Intervals of a dent's table: a touch's voltages change by 0.3 % at most against exact profiles (measured).
const INTERVALS: usize = 64;

/// Derivatives of the voltages of an untouched skin, and where its elements are.
pub(super) struct Linearised {
    untouched_v: Vec<f64>,
    /// Measurements that are multiples of each other.
    sets: Vec<Vec<(usize, f64)>>,
    /// [input, set], each set's in one piece: three inputs per element, then one per electrode.
    derivatives: Mat<f32>,
    tiles: Vec<Tile>,
    /// Elements under each electrode, and the weights of their strain in its stretch.
    stretches: Vec<Vec<(usize, Strain)>>,
    strains: Vec<Strain>,
    /// How many times as large each element looks to currents, by [`Profile`].
    sizes: Vec<f64>,
    inputs: Col<f32>,
    outputs: Col<f32>,
    bessel: KTable,
}

/// Strain of an element in its frame: 11, 22, 12, and its rotation from 1 to 2, on which an anisotropic sheet depends.
type Strain = [f64; 4];

/// One element.
struct Tile {
    middle_m: Vector,
    /// Largest distance of a corner from the middle, metres.
    size_m: f64,
    /// Unit vectors in its plane, and its normal.
    frame: [Vector; 3],
    /// Fraction of the free displacement by which it moves, and its gradient, 1/m.
    follows: f64,
    rise: [f64; 2],
    /// `S22 - S11` and `-2 S12` of [`crate::derivatives::movement`] for each component of the strain.
    shears: [Strain; 2],
}

impl Linearised {
    /// Refuses what is not linear.
    pub(super) fn check(fabric: &Fabric) -> Result<(), FemError> {
        let Instrument { loose, compliance_v, common_mode_db, .. } = &fabric.settings.instrument;
        let given = |value: &Option<f64>| value.unwrap_or(0.0);
        let (volts, decibels) = (given(compliance_v), given(common_mode_db));
        let must = "left out where the skin is linearised";
        FemError::require("number of loose contacts", loose.len() as f64, loose.is_empty(), must)?;
        FemError::require("compliance_v", volts, compliance_v.is_none(), must)?;
        FemError::require("common_mode_db", decibels, common_mode_db.is_none(), must)
    }

    pub(super) fn new(fabric: &Fabric, plan: &Plan) -> Result<Self, FemError> {
        let (model, mesh) = (&fabric.model, &fabric.mesh);
        let (mut geometry, mut workspace) = (model.geometry(), model.workspace()?);
        let instrument = &fabric.settings.instrument;
        let contact = |(l, z): (usize, &f64)| {
            z * if instrument.lost.contains(&(l + 1)) { instrument.open_factor } else { 1.0 }
        };
        let impedance: Vec<f64> =
            fabric.contact_impedance.iter().enumerate().map(contact).collect();
        model.change_contacts(&impedance, &mut geometry)?;
        let mut solution = model.solve_deformed(&geometry, &plan.untouched_s, &mut workspace)?;
        let untouched_v = solution.measurements().to_vec();
        let contacts = solution.contact_jacobian()?;
        let (sheet, shears) = (solution.unique_jacobian::<f64>(), solution.shear_jacobian()?);
        let sets = model.unique_measurements();
        let (elements, electrodes) = (model.elements(), impedance.len());
        let derivatives = Mat::from_fn(3 * elements + electrodes, sets.len(), |input, set| {
            let value = match input.checked_sub(3 * elements) {
                Some(l) => contacts[[sets[set][0].0, l]] * impedance[l],
                None if input % 3 == 0 => sheet[[set, input / 3]] * plan.untouched_s[input / 3],
                None => shears[[set, input / 3 * 2 + input % 3 - 1]],
            };
            value as f32
        });
        let tiles = tiles(fabric);
        Ok(Self {
            untouched_v,
            inputs: Col::zeros(derivatives.nrows()),
            outputs: Col::zeros(derivatives.ncols()),
            derivatives,
            sets,
            strains: vec![[0.0; 4]; tiles.len()],
            sizes: vec![1.0; tiles.len()],
            stretches: stretches(mesh, &tiles),
            tiles,
            bessel: KTable::new(),
        })
    }

    /// Computes the voltages of an instant from its touches, and the memory of each element.
    pub(super) fn voltages(
        &mut self,
        fabric: &Fabric,
        plan: &Plan,
        instant: &mut Instant,
        memory: &mut [f64],
    ) {
        for (log, drift) in instant.contact_impedance.iter_mut().zip(&plan.contact_drift) {
            *log = drift.at(instant.time_s);
        }
        if let Some(linear) = &fabric.settings.linear {
            fabric.elements.changes_into(linear, &instant.touches, &mut instant.elements);
            let drift = plan.sheet_drift.at(instant.time_s);
            instant.elements.iter_mut().for_each(|change| *change = change.ln_1p() + drift);
        } else {
            let profiles: Vec<Profile<'_>> = instant
                .dents
                .iter()
                .map(|touch| Profile::new(touch, &fabric.motion, &self.bessel))
                .collect();
            // with the widest registers
            Arch::new().dispatch(|| self.feel(fabric, plan, &profiles, &mut instant.elements));
            let at = |profile: &Profile<'_>, place| {
                profile.at(profile.from(place).distance_m).deflection_m
            };
            let sum = |place| profiles.iter().map(|profile| at(profile, place)).sum();
            fabric.motion.add_contacts(sum, &mut instant.contact_impedance);
            plan.remember(instant, memory);
        }
        let warmth = plan.warmth(instant.time);
        instant.elements.iter_mut().zip(warmth).for_each(|(change, warmth)| *change += warmth);
        let weighted = |weights: &Strain, strain: &Strain| -> f64 {
            weights.iter().zip(strain).map(|(weight, part)| weight * part).sum()
        };
        let elements = self.tiles.iter().zip(&self.strains).zip(&instant.elements).enumerate();
        for (e, ((tile, strain), change)) in elements {
            self.inputs[3 * e] = (self.sizes[e] * change) as f32;
            self.inputs[3 * e + 1] = weighted(&tile.shears[0], strain) as f32;
            self.inputs[3 * e + 2] = weighted(&tile.shears[1], strain) as f32;
        }
        let electrodes = self.stretches.iter().zip(&instant.contact_impedance).enumerate();
        for (l, (parts, log)) in electrodes {
            let stretch = parts.iter().map(|(e, weights)| weighted(weights, &self.strains[*e]));
            self.inputs[3 * self.tiles.len() + l] = (log - stretch.sum::<f64>()) as f32;
        }
        let (outputs, inputs) = (self.outputs.as_mat_mut(), self.inputs.as_mat());
        matmul(outputs, Accum::Replace, self.derivatives.transpose(), inputs, 1.0, Par::Seq);
        for (set, change) in self.sets.iter().zip(self.outputs.iter()) {
            for (k, factor) in set {
                instant.voltages_v[*k] = self.untouched_v[*k] + factor * f64::from(*change);
            }
        }
    }

    /// Computes the drive and the strain of each element under dents.
    #[inline(always)]
    fn feel(&mut self, fabric: &Fabric, plan: &Plan, profiles: &[Profile<'_>], drives: &mut [f64]) {
        let law = &plan.law;
        for (e, tile) in self.tiles.iter().enumerate() {
            let (mut sum, mut ring, mut cut) = (Dent::default(), 0.0, None);
            let (mut moved, mut size) = (Moved::default(), 1.0);
            for profile in profiles {
                let touch = profile.touch;
                let from = profile.from(tile.middle_m);
                let felt = profile.at(from.distance_m);
                let here_pa = touch.dent.pressure_pa(from.distance_m, felt.deflection_m);
                sum.pressure_pa += here_pa;
                sum.areal_strain += felt.areal_strain;
                ring += touch.ring_at(from.distance_m);
                let edge_m = (from.distance_m - touch.dent.contact_radius_m).abs();
                if edge_m <= tile.size_m * touch.stretch {
                    cut = Some((profile, here_pa));
                }
                if fabric.motion.moves {
                    moved.add(tile, touch, &from, &felt, fabric.motion.half_m);
                    size *= 1.0 + tile.follows * tile.follows * (felt.looks - 1.0);
                }
            }
            let drive = |pressure_pa| law.saturated(law.drive(&Dent { pressure_pa, ..sum }) + ring);
            drives[e] = match cut {
                // other touches press alike on all of the element
                Some((profile, here_pa)) => {
                    let rest_pa = sum.pressure_pa - here_pa;
                    let at = |place| profile.pressure_pa(profile.from(place).distance_m);
                    let corners = fabric.mesh.surface().corners(e);
                    let points = sixteenths(&corners).map(|place| drive(rest_pa + at(place)));
                    points.sum::<f64>() / 16.0
                }
                None => drive(sum.pressure_pa),
            };
            (self.strains[e], self.sizes[e]) = (moved.strain(tile), size);
        }
    }
}

/// A dent, tabulated over `c / (c + r)` with half a membrane length `c`, and how large the sheet around it looks.
///
/// A round stretch acts only together with a change of conductivity: currents see the stretched sheet as a flat one on
/// which the circle of radius `r` has the radius `rho`, where `d ln rho / d ln r` is the ratio `q` of the radial to the
/// tangential stretch. A piece of the sheet looks `q (rho / r)^2` times as large, with
/// `ln(rho / r) = - integral from r to infinity of (q - 1) dr / r`.
struct Profile<'a> {
    touch: &'a Placed,
    half_m: f64,
    table: [Felt; INTERVALS + 1],
}

/// What a dent does at a distance.
#[derive(Clone, Copy, Default)]
struct Felt {
    deflection_m: f64,
    slope: f64,
    areal_strain: f64,
    /// Displacement over distance.
    across: f64,
    /// How many times as large the sheet looks.
    looks: f64,
    /// How far friction drags, over [`Placed::drag_m`].
    dragged: f64,
}

/// A place seen from a touch.
struct From {
    /// Along the tangent plane, metres.
    offset_m: Vector,
    /// [`Placed::distance_m`], its inverse and its gradient; the last two zero at the centre.
    distance_m: f64,
    per_m: f64,
    outward: Vector,
}

impl<'a> Profile<'a> {
    fn new(touch: &'a Placed, motion: &Motion, bessel: &KTable) -> Self {
        let half_m = 0.5 * touch.dent.length_m();
        // far away all is flat
        let mut table = [Felt { looks: 1.0, ..Default::default() }; INTERVALS + 1];
        let (mut integral, mut former): (f64, Option<[f64; 2]>) = (0.0, None);
        for (k, entry) in table.iter_mut().enumerate().skip(1) {
            let r = half_m * (INTERVALS as f64 / k as f64 - 1.0);
            let dent = touch.dent.at_by(r, &|x| bessel.at(x));
            // at the centre all directions are alike: half of the areal strain each
            let across = if r > 0.0 { dent.displacement_m / r } else { 0.5 * dent.areal_strain };
            let along = dent.areal_strain - 0.5 * dent.slope.powi(2) - across;
            let ratio = (1.0 + along).hypot(dent.slope) / (1.0 + across);
            let rate = if r > 0.0 { (ratio - 1.0) / r } else { 0.0 };
            integral += former.map_or(0.0, |[far, before]| 0.5 * (far - r) * (rate + before));
            former = Some([r, rate]);
            let looks = ratio * (-2.0 * integral).exp();
            let Dent { deflection_m, slope, areal_strain, .. } = dent;
            let near_m = r.max(touch.dent.contact_radius_m);
            let dragged = (motion.half_m / near_m).ln().max(0.0);
            *entry = Felt { deflection_m, slope, areal_strain, across, looks, dragged };
        }
        Self { touch, half_m, table }
    }

    #[inline(always)]
    fn from(&self, place_m: Vector) -> From {
        let Placed { seat, axis, stretch, .. } = self.touch;
        let to = sub(place_m, seat.place_m);
        let offset_m = along(to, -dot(to, seat.normal), seat.normal);
        let (square, ratio) = (dot(to, to), stretch * stretch);
        let (square, gradient) = match ratio == 1.0 {
            true => (square, to),
            false => {
                let x = dot(to, *axis);
                let across = scaled(ratio, along(to, -x, *axis));
                let square = x * x / ratio + (square - x * x).max(0.0) * ratio;
                (square, along(across, x / ratio, *axis))
            }
        };
        let distance_m = square.sqrt();
        let per_m = if square > 0.0 { 1.0 / distance_m } else { 0.0 };
        From { offset_m, distance_m, per_m, outward: scaled(per_m, gradient) }
    }

    #[inline(always)]
    fn at(&self, distance_m: f64) -> Felt {
        let place = INTERVALS as f64 * self.half_m / (self.half_m + distance_m);
        let k = (place as usize).min(INTERVALS - 1);
        let (part, [a, b]) = (place - k as f64, [&self.table[k], &self.table[k + 1]]);
        let mix = |a: f64, b: f64| a + part * (b - a);
        Felt {
            deflection_m: mix(a.deflection_m, b.deflection_m),
            slope: mix(a.slope, b.slope),
            areal_strain: mix(a.areal_strain, b.areal_strain),
            across: mix(a.across, b.across),
            looks: mix(a.looks, b.looks),
            dragged: mix(a.dragged, b.dragged),
        }
    }

    #[inline(always)]
    fn pressure_pa(&self, distance_m: f64) -> f64 {
        self.touch.dent.pressure_pa(distance_m, self.at(distance_m).deflection_m)
    }
}

/// Displacement of the free fabric at an element, along its frame and its normal, and the gradient in its plane.
#[derive(Default)]
struct Moved {
    along_m: [f64; 3],
    /// `[i][j]`: component `i` along `j`.
    gradient: [[f64; 2]; 3],
}

impl Moved {
    #[inline(always)]
    fn add(&mut self, tile: &Tile, touch: &Placed, from: &From, felt: &Felt, half_m: f64) {
        let within = |v: Vector| tile.frame.map(|axis| dot(axis, v));
        let Felt { slope, across, areal_strain, deflection_m, .. } = *felt;
        let (r, [x, y, _]) = (from.distance_m, within(from.outward));
        let (outward, normal) = ([x, y], within(touch.seat.normal));
        let bend = from.per_m * (areal_strain - 0.5 * slope * slope - 2.0 * across);
        self.shift(within(from.offset_m), across, bend, outward);
        for (i, row) in self.gradient.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry += across * (if i == j { 1.0 } else { 0.0 } - normal[i] * normal[j]);
            }
        }
        self.shift(normal, -deflection_m, -slope, outward);
        if touch.drag_m != [0.0; 3] && r < half_m {
            let fall = if r > touch.dent.contact_radius_m { -from.per_m } else { 0.0 };
            self.shift(within(touch.drag_m), felt.dragged, fall, outward);
        }
    }

    /// Adds a displacement along a vector, whose amount has the gradient `rise` along `outward`.
    #[inline(always)]
    fn shift(&mut self, along_m: [f64; 3], amount: f64, rise: f64, outward: [f64; 2]) {
        for (i, part_m) in along_m.into_iter().enumerate() {
            self.along_m[i] += amount * part_m;
            self.gradient[i] = [0, 1].map(|j| self.gradient[i][j] + rise * part_m * outward[j]);
        }
    }

    #[inline(always)]
    fn strain(&self, tile: &Tile) -> Strain {
        let Tile { follows, rise, .. } = tile;
        let d: [[f64; 2]; 3] = std::array::from_fn(|i| {
            [0, 1].map(|j| follows * self.gradient[i][j] + self.along_m[i] * rise[j])
        });
        let twice_green = |i: usize, j: usize| {
            d[i][j] + d[j][i] + d.iter().map(|row| row[i] * row[j]).sum::<f64>()
        };
        let [c11, c22, c12] = [1.0 + twice_green(0, 0), 1.0 + twice_green(1, 1), twice_green(0, 1)];
        // half the logarithm of a symmetric matrix, by its eigenvalues
        let (mean, half) = (0.5 * (c11 + c22), 0.5 * (c11 - c22));
        let square = (half * half + c12 * c12) / (mean * mean);
        let dilation = 0.25 * (mean * mean * (1.0 - square)).ln();
        // atanh(x) / x, by its series up to x = 0.3, to 1e-5
        let ratio = match square < 0.09 {
            true => 1.0 + square * (1.0 / 3.0 + square * (0.2 + square / 7.0)),
            false => square.sqrt().atanh() / square.sqrt(),
        };
        let part = 0.5 * ratio / mean;
        let turn = 0.5 * (d[1][0] - d[0][1]);
        [dilation + part * half, dilation - part * half, part * c12, turn]
    }
}

fn tiles(fabric: &Fabric) -> Vec<Tile> {
    let surface = fabric.mesh.surface();
    let grains = fabric.model.anisotropy().map(|a| a.grains());
    let tile = |(t, nodes): (usize, &[u32; 3])| {
        let corners = surface.corners(t);
        let (middle_m, size_m) = fabric.elements.middle(t);
        let up = unit(normal(corners));
        let first = unit(sub(corners[1], corners[0]));
        let frame = [first, cross(up, first), up];
        let follows = nodes.map(|n| fabric.motion.follows(n));
        // gradient of the linear function of its corners
        let (e1, e2) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let (f1, f2) = (follows[1] - follows[0], follows[2] - follows[0]);
        let double_area = norm(cross(e1, e2));
        let gradient =
            scaled(1.0 / double_area, along(scaled(f1, cross(e2, up)), f2, cross(up, e1)));
        let shear = |strain: Strain| {
            let pull = |v: Vector| {
                let [x, y, _] = frame.map(|axis| dot(axis, v));
                let [s11, s22, s12, turn] = strain;
                let pulled = scaled(s11 * x + (s12 - turn) * y, frame[0]);
                along(pulled, (s12 + turn) * x + s22 * y, frame[1])
            };
            let vectors = corners.map(|corner| pull(sub(corner, corners[0])));
            crate::derivatives::movement::strain(corners, vectors, grains.map(|grains| &grains[t]))
        };
        let unit = |k: usize| std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
        let units: [[f64; 2]; 4] = std::array::from_fn(|k| shear(unit(k)));
        Tile {
            middle_m,
            size_m,
            frame,
            follows: follows.iter().sum::<f64>() / 3.0,
            rise: [0, 1].map(|k| dot(frame[k], gradient)),
            shears: [0, 1].map(|k| units.map(|unit| unit[k])),
        }
    };
    surface.triangles().iter().enumerate().map(tile).collect()
}

/// Weights of the strains of elements in the relative stretch of each electrode.
fn stretches(mesh: &Mesh, tiles: &[Tile]) -> Vec<Vec<(usize, Strain)>> {
    let surface = mesh.surface();
    let place = |n: u32| surface.nodes()[n as usize];
    let of_edge = |[a, b]: &[u32; 2]| {
        let beside = surface.triangles().iter().position(|t| t.contains(a) && t.contains(b))?;
        let edge = sub(place(*b), place(*a));
        let [x, y, _] = tiles[beside].frame.map(|axis| dot(axis, unit(edge)));
        Some((beside, norm(edge), [x * x, y * y, 2.0 * x * y, 0.0]))
    };
    let of_electrode = |electrode: &Electrode| {
        let parts: Vec<(usize, f64, Strain)> = match electrode {
            Electrode::Rim(edges) => edges.iter().filter_map(of_edge).collect(),
            Electrode::Patch(triangles) => {
                let part =
                    |&t: &u32| (t as usize, surface.areas_m2()[t as usize], [1.0, 1.0, 0.0, 0.0]);
                triangles.iter().map(part).collect()
            }
        };
        let whole: f64 = parts.iter().map(|part| part.1).sum();
        let weighted = |(e, measure, weights): (usize, f64, Strain)| {
            (e, weights.map(|weight| weight * measure / whole))
        };
        parts.into_iter().map(weighted).collect()
    };
    mesh.electrodes().iter().map(of_electrode).collect()
}
