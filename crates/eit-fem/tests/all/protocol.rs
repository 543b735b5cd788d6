//! Order and counts of protocols, and invalid input. The file is long because it includes an
//! independent construction of the expected order.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use eit_fem::{DrivenElectrodes, FemError, Order, PairPattern, PairProtocol, Protocol};
use ndarray::{Array2, array};
use proptest::prelude::*;
use std::collections::HashSet;

fn quadruples(protocol: &PairProtocol) -> Vec<[u32; 4]> {
    protocol.quadruples().unwrap()
}

#[test]
fn rotated_adjacent_pairs_follow_the_drive() {
    let found = quadruples(&PairProtocol::default());
    assert_eq!(found.len(), 208);
    for d in 0..16 {
        for k in 0..13 {
            let wanted = [d, d + 1, d + 2 + k, d + 3 + k].map(|e| e % 16);
            assert_eq!(found[(d * 13 + k) as usize], wanted);
        }
    }
}

#[test]
fn ascending_adjacent_pairs_start_at_electrode_one() {
    let found = quadruples(&PairProtocol { order: Order::Ascending, ..Default::default() });
    for d in 0..16u32 {
        let touches = |e: u32| e == d || e == (d + 1) % 16;
        let row = (0..16).filter(|&m| !touches(m) && !touches((m + 1) % 16));
        let wanted: Vec<_> = row.map(|m| [d, (d + 1) % 16, m, (m + 1) % 16]).collect();
        assert_eq!(found[d as usize * 13..(d as usize + 1) * 13], wanted);
    }
    assert_eq!(found[0], [0, 1, 2, 3]);
    assert_eq!(found[13], [1, 2, 3, 4]);
    assert_eq!(found[2 * 13], [2, 3, 0, 1]);
}

#[test]
fn kept_driven_electrodes_give_every_pair() {
    let keep = PairProtocol { driven_electrodes: DrivenElectrodes::Keep, ..Default::default() };
    let found = quadruples(&keep);
    assert_eq!(found.len(), 256);
    for (i, &quadruple) in found.iter().enumerate() {
        let (d, k) = (i as u32 / 16, i as u32 % 16);
        assert_eq!(quadruple, [d, d + 1, d + k, d + k + 1].map(|e| e % 16));
    }
}

#[test]
fn opposite_drives_keep_twelve_adjacent_pairs_each() {
    let opposite = PairProtocol { drive: PairPattern::Opposite, ..Default::default() };
    let found = quadruples(&opposite);
    assert_eq!(found.len(), 192);
    for d in 0..16 {
        // starts d+1 .. d+6 and d+9 .. d+14: the pairs at d-1, d, d+7 and d+8 include a driven
        // electrode
        let starts = (1..7).chain(9..15);
        for (k, start) in starts.enumerate() {
            let wanted = [d, d + 8, d + start, d + start + 1].map(|e| e % 16);
            assert_eq!(found[d as usize * 12 + k], wanted);
        }
    }
}

#[test]
fn skipping_pairs_leave_electrodes_between() {
    let skip = PairPattern::Skip(2);
    let both = PairProtocol { drive: skip.clone(), measure: skip, ..Default::default() };
    let found = quadruples(&both);
    // pairs that start at d-3, d, d+3 share an electrode with the drive (d, d+3)
    assert_eq!(found.len(), 16 * 13);
    assert_eq!(found[..3], [[0, 3, 1, 4], [0, 3, 2, 5], [0, 3, 4, 7]]);
    assert_eq!(found[13], [1, 4, 2, 5]);
    let zero = PairProtocol { drive: PairPattern::Skip(0), ..Default::default() };
    assert_eq!(quadruples(&zero), quadruples(&PairProtocol::default()));
}

#[test]
fn explicit_pairs_keep_their_order_and_sign() {
    let explicit = PairProtocol {
        electrodes: 6,
        drive: PairPattern::Pairs(vec![[4, 1], [0, 2]]),
        measure: PairPattern::Pairs(vec![[5, 3], [3, 0], [2, 5], [3, 5]]),
        ..Default::default()
    };
    // rotated: by distance of the first electrode from the drive's first electrode; ties keep their
    // order
    let wanted =
        [[4, 1, 5, 3], [4, 1, 2, 5], [4, 1, 3, 0], [4, 1, 3, 5], [0, 2, 3, 5], [0, 2, 5, 3]];
    assert_eq!(quadruples(&explicit), wanted);
}

#[test]
fn adjacent_counts_are_n_times_n_minus_three() {
    for electrodes in 4..40 {
        let adjacent = PairProtocol { electrodes, ..Default::default() };
        assert_eq!(quadruples(&adjacent).len(), electrodes * (electrodes - 3));
    }
}

#[test]
fn quadruples_are_kept_as_given_and_share_patterns() {
    let given = [[2, 0, 1, 3], [0, 1, 2, 3], [2, 0, 3, 1], [2, 0, 1, 3]];
    let protocol = Protocol::from_quadruples(4, &given, 2e-3).unwrap();
    assert_eq!(protocol.quadruples().unwrap(), given);
    assert_eq!((protocol.electrodes(), protocol.measurements()), (4, 4));
    assert_eq!(protocol.stimulations_a(), array![[-2e-3, 0.0, 2e-3, 0.0], [2e-3, -2e-3, 0.0, 0.0]]);
    let senses = array![[0.0, 1.0, 0.0, -1.0], [0.0, 0.0, 1.0, -1.0], [0.0, -1.0, 0.0, 1.0]];
    assert_eq!(protocol.measurement_patterns(), senses);
    assert_eq!(protocol.data(), [[0, 0], [1, 1], [0, 2], [0, 0]]);
}

#[test]
fn general_patterns_read_every_measurement_under_every_stimulation() {
    let stimulations = array![[1.0, 0.5], [-1.0, 0.5], [0.0, -1.0]];
    let senses = array![[1.0, 0.0, 2.0], [0.0, 1.0, -1.0], [-1.0, -1.0, -1.0]];
    let protocol = Protocol::from_patterns(stimulations.view(), senses.view()).unwrap();
    assert_eq!(protocol.stimulations_a(), stimulations.t());
    assert_eq!(protocol.measurement_patterns(), senses.t());
    assert_eq!(protocol.data(), [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2]]);
    assert_eq!(protocol.quadruples(), None);
}

/// The residual sum of a pattern with seven digits is removed, and zeros stay zero.
#[test]
fn patterns_of_few_digits_are_balanced() {
    let rounded = array![[0.333_333_3], [0.333_333_3], [-0.666_666_7], [0.0]];
    let protocol = Protocol::from_patterns(rounded.view(), rounded.view()).unwrap();
    for patterns in [protocol.stimulations_a(), protocol.measurement_patterns()] {
        // two roundings of numbers below one
        assert!(patterns.row(0).sum().abs() < 2.0 * f64::EPSILON);
        assert_eq!(patterns[[0, 3]], 0.0);
        // a third of the residual of 1e-7
        assert!((patterns[[0, 0]] - rounded[[0, 0]]).abs() < 0.34e-7);
    }
}

/// Each error message says what is wrong, where, and with which numbers, on one line.
#[test]
fn refusals_say_what_is_wrong() {
    let pairs = |electrodes, drive| PairProtocol { electrodes, drive, ..Default::default() };
    let with_current = |current_a| PairProtocol { current_a, ..Default::default() }.protocol();
    let explicit = |pair| pairs(16, PairPattern::Pairs(vec![[0, 1], pair])).protocol();
    let patterns = |s: &Array2<f64>, m: &Array2<f64>| Protocol::from_patterns(s.view(), m.view());
    let good = array![[1.0, 0.0], [-1.0, 1.0], [0.0, -1.0]];
    let off = array![[1.0, 0.5], [-1.0, 0.5], [0.0, -0.75]];
    let zero = array![[0.0], [0.0], [0.0]];
    let nan = array![[1.0, 0.0], [-1.0, f64::NAN], [0.0, -1.0]];
    // summation in eight lanes: some sums overflow to plus, others to minus infinity
    let overflow =
        Array2::from_shape_fn((32, 1), |(e, _)| if e % 2 == 0 { 1.7e308 } else { -1.7e308 });
    let measured =
        PairProtocol { measure: PairPattern::Pairs(vec![[0, 16]]), ..Default::default() };
    let cases: Vec<(Result<Protocol, FemError>, &str)> = vec![
        (
            pairs(1, PairPattern::Adjacent).protocol(),
            "1 electrodes are too few: a drive pair of step 1 needs at least 2",
        ),
        (
            pairs(4, PairPattern::Skip(3)).protocol(),
            "4 electrodes are too few: a drive pair of step 4 needs at least 5",
        ),
        (
            pairs(0, PairPattern::Opposite).protocol(),
            "0 electrodes are too few: a drive pair of step 0 needs at least 2",
        ),
        (
            pairs(15, PairPattern::Opposite).protocol(),
            "15 electrodes have no opposite pairs: use an even number or drive = \"skip-N\"",
        ),
        (
            explicit([3, 16]),
            "drive pair 1 refers to electrode index 16, but the 16 electrodes have indices 0 to 15",
        ),
        (
            measured.protocol(),
            "measured pair 0 refers to electrode index 16, but the 16 electrodes have indices 0 to 15",
        ),
        (explicit([3, 3]), "drive pair 1 connects electrode index 3 with itself"),
        (
            Protocol::from_quadruples(4, &[[0, 1, 2, 3], [0, 1, 2, 4]], 1.0),
            "quadruple 1 refers to electrode index 4, but the 4 electrodes have indices 0 to 3",
        ),
        (
            Protocol::from_quadruples(0, &[[0, 1, 2, 3]], 1.0),
            "quadruple 0 refers to electrode index 0, but the 0 electrodes have indices 0 to 0",
        ),
        (
            Protocol::from_quadruples(4, &[[0, 1, 2, 2]], 1.0),
            "quadruple 0 connects electrode index 2 with itself",
        ),
        (
            Protocol::from_quadruples(4, &[], 1.0),
            "the protocol has no measurements: keep the driven electrodes or choose other pairs",
        ),
        (
            pairs(3, PairPattern::Adjacent).protocol(),
            "the protocol has no measurements: keep the driven electrodes or choose other pairs",
        ),
        (with_current(0.0), "current_a is 0: it must be finite and above zero"),
        (with_current(-1e-3), "current_a is -0.001: it must be finite and above zero"),
        (with_current(f64::NAN), "current_a is NaN: it must be finite and above zero"),
        (
            pairs(usize::MAX, PairPattern::Adjacent).protocol(),
            "the number of electrodes is 18446744073709552000: it must be at most 4096",
        ),
        (
            Protocol::from_quadruples(4097, &[[0, 1, 2, 3]], 1.0),
            "the number of electrodes is 4097: it must be at most 4096",
        ),
        (
            patterns(&good, &array![[1.0], [-1.0]]),
            "rows of the measurement pattern matrix: 2 values given, 3 needed",
        ),
        (patterns(&nan, &good), "stimulation pattern 1 contains NaN at electrode index 1"),
        (
            patterns(&good, &off),
            "measurement pattern 1 sums to 2.5e-1 with a largest entry of 7.5e-1: the entries must \
             sum to zero and must not all be zero",
        ),
        (
            patterns(&zero, &good),
            "stimulation pattern 0 sums to 0e0 with a largest entry of 0e0: the entries must \
             sum to zero and must not all be zero",
        ),
        (
            patterns(&Array2::zeros((3, 0)), &good),
            "the protocol has no measurements: keep the driven electrodes or choose other pairs",
        ),
    ];
    for (result, wanted) in cases {
        let message = result.unwrap_err().to_string();
        assert_eq!(message, wanted);
        assert_eq!(message.lines().count(), 1);
    }
    // the sums may overflow, depending on their order, but the protocol must not contain NaN
    let usable = |p: Protocol| p.stimulations_a().iter().all(|x| x.is_finite());
    assert!(
        patterns(&overflow, &overflow).is_ok_and(usable) || patterns(&overflow, &overflow).is_err()
    );
}

fn pattern(electrodes: u32) -> impl Strategy<Value = PairPattern> {
    let pair = (0..electrodes, 1..electrodes).prop_map(move |(a, s)| [a, (a + s) % electrodes]);
    prop_oneof![
        Just(PairPattern::Adjacent),
        Just(PairPattern::Opposite),
        (0..6usize).prop_map(PairPattern::Skip),
        proptest::collection::hash_set(pair, 1..8)
            .prop_map(|pairs| PairPattern::Pairs(pairs.into_iter().collect())),
    ]
}

fn settings() -> impl Strategy<Value = PairProtocol> {
    (2..33u32).prop_flat_map(|electrodes| {
        (pattern(electrodes), pattern(electrodes), any::<bool>(), any::<bool>(), 1e-9..1e3)
            .prop_map(move |(drive, measure, drop, rotated, current_a)| PairProtocol {
                electrodes: electrodes as usize,
                drive,
                measure,
                driven_electrodes: match drop {
                    true => DrivenElectrodes::Drop,
                    false => DrivenElectrodes::Keep,
                },
                order: if rotated { Order::Rotated } else { Order::Ascending },
                current_a,
            })
    })
}

/// Pairs of a pattern, or `None` if it has none.
fn expected_pairs(pattern: &PairPattern, electrodes: u32) -> Option<Vec<[u32; 2]>> {
    let step = match pattern {
        PairPattern::Adjacent => 1,
        PairPattern::Skip(between) => *between as u32 + 1,
        PairPattern::Opposite if electrodes % 2 == 1 => return None,
        PairPattern::Opposite => electrodes / 2,
        PairPattern::Pairs(pairs) => return Some(pairs.clone()),
    };
    (step < electrodes).then(|| (0..electrodes).map(|d| [d, (d + step) % electrodes]).collect())
}

/// Expected quadruples, found by walking around the skin, or `None` if an error is expected.
fn expected(p: &PairProtocol) -> Option<Vec<[u32; 4]>> {
    let count = p.electrodes as u32;
    let (drives, senses) = (expected_pairs(&p.drive, count)?, expected_pairs(&p.measure, count)?);
    let mut all = Vec::new();
    for [a, b] in drives {
        let from = if p.order == Order::Rotated { a } else { 0 };
        for start in (0..count).map(|k| (from + k) % count) {
            for &[m, n] in senses.iter().filter(|s| s[0] == start) {
                let driven = [m, n].iter().any(|e| [a, b].contains(e));
                if p.driven_electrodes == DrivenElectrodes::Keep || !driven {
                    all.push([a, b, m, n]);
                }
            }
        }
    }
    (!all.is_empty()).then_some(all)
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn any_settings_give_the_walk_around_the_skin_or_an_error(settings in settings()) {
        let Some(wanted) = expected(&settings) else {
            let known = match settings.protocol().unwrap_err() {
                FemError::TooFewElectrodes { .. } | FemError::NoOpposite { .. } => true,
                error => error == FemError::EmptyProtocol,
            };
            prop_assert!(known);
            return Ok(());
        };
        let protocol = settings.protocol().unwrap();
        let found = protocol.quadruples().unwrap();
        prop_assert_eq!(found, &wanted[..]);
        prop_assert_eq!(found.iter().collect::<HashSet<_>>().len(), found.len());
        for &[a, b, m, n] in found {
            prop_assert!([a, b, m, n].iter().all(|&e| (e as usize) < settings.electrodes));
            prop_assert!(a != b && m != n);
            if settings.driven_electrodes == DrivenElectrodes::Drop {
                prop_assert!(![m, n].contains(&a) && ![m, n].contains(&b));
            }
        }
        // plus and minus one amplitude: exactly zero
        for row in protocol.stimulations_a().rows() {
            prop_assert_eq!(row.sum(), 0.0);
            prop_assert_eq!(row.iter().filter(|i| **i != 0.0).count(), 2);
            prop_assert_eq!(row.fold(0.0_f64, |m, i| m.max(i.abs())), settings.current_a);
        }
        // patterns agree with the quadruples
        for (&[s, p], &[a, b, m, n]) in protocol.data().iter().zip(found) {
            let drive = protocol.stimulations_a().row(s as usize).to_vec();
            let sense = protocol.measurement_patterns().row(p as usize).to_vec();
            prop_assert_eq!([drive[a as usize], drive[b as usize]], [settings.current_a, -settings.current_a]);
            prop_assert_eq!([sense[m as usize], sense[n as usize]], [1.0, -1.0]);
        }
    }
}

/// L - 1 orthogonal, balanced patterns span all balanced currents.
#[test]
fn trigonometric_currents_span_all_currents() {
    for electrodes in [2, 3, 16, 31, 32] {
        let found = Protocol::trigonometric(electrodes, &PairPattern::Adjacent, 2e-3).unwrap();
        let currents = found.stimulations_a();
        assert_eq!(currents.dim(), (electrodes - 1, electrodes));
        assert_eq!(found.measurements(), (electrodes - 1) * electrodes);
        assert!(found.quadruples().is_none());
        let products = currents.dot(&currents.t());
        for ((i, j), product) in products.indexed_iter() {
            // the squared norm of a pattern is L/2 I^2, or L I^2 for the alternating one; rounding
            // of L terms
            let energy = 4e-6 * electrodes as f64;
            assert!(if i == j { *product > 0.4 * energy } else { product.abs() < 1e-13 * energy });
        }
        assert!(currents.sum_axis(ndarray::Axis(1)).iter().all(|sum| sum.abs() < 1e-17));
        let peak = currents.iter().fold(0.0_f64, |m, i| m.max(i.abs()));
        // balancing may change each entry by a rounding error
        assert!((peak - 2e-3).abs() < 1e-15, "{peak}");
    }
    let bad = |electrodes, measure: &PairPattern, current_a| {
        Protocol::trigonometric(electrodes, measure, current_a).unwrap_err()
    };
    let adjacent = PairPattern::Adjacent;
    assert!(matches!(bad(1, &adjacent, 1.0), FemError::TooFewElectrodes { electrodes: 1, .. }));
    assert!(matches!(bad(0, &PairPattern::Pairs(vec![]), 1.0), FemError::EmptyProtocol));
    assert!(matches!(bad(16, &adjacent, f64::NAN), FemError::BadCurrent { .. }));
    let far = PairPattern::Pairs(vec![[0, 16]]);
    assert!(matches!(bad(16, &far, 1.0), FemError::UnknownElectrode { electrode: 16, .. }));
}
