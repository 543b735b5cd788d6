//! Order and counts of protocols, against an independent construction, and invalid input.

use crate::common::says;
use eit_fem::{DrivenElectrodes, FemError, Order, PairPattern, PairProtocol, Protocol};
use ndarray::{Array2, array};
use proptest::prelude::*;
use std::collections::HashSet;

/// The number of quadruples and one of them by hand; all are those of the walk around the skin.
#[test]
fn known_protocols_have_their_order() {
    let (driven_electrodes, order) = (DrivenElectrodes::Keep, Order::Ascending);
    let skip = || PairPattern::Skip(2);
    let drive = PairPattern::Pairs(vec![[4, 1], [0, 2]]);
    let measure = PairPattern::Pairs(vec![[5, 3], [3, 0], [2, 5], [3, 5]]);
    let explicit = PairProtocol { electrodes: 6, drive, measure, ..Default::default() };
    let default = PairProtocol::default;
    for (settings, count, place, quadruple) in [
        (default(), 208, 13, [1, 2, 3, 4]),
        (PairProtocol { order, ..default() }, 208, 26, [2, 3, 0, 1]),
        (PairProtocol { driven_electrodes, ..default() }, 256, 255, [15, 0, 14, 15]),
        // the pairs at d-1, d, d+7 and d+8 include a driven electrode
        (PairProtocol { drive: PairPattern::Opposite, ..default() }, 192, 6, [0, 8, 9, 10]),
        // pairs that start at d-3, d, d+3 share an electrode with the drive (d, d+3)
        (PairProtocol { drive: skip(), measure: skip(), ..default() }, 208, 2, [0, 3, 4, 7]),
        (PairProtocol { drive: PairPattern::Skip(0), ..default() }, 208, 13, [1, 2, 3, 4]),
        // by distance of the first electrode from the drive's first; ties keep their order
        (explicit, 6, 1, [4, 1, 2, 5]),
    ] {
        let found = settings.quadruples().unwrap();
        assert_eq!(found, expected(&settings).unwrap(), "{settings:?}");
        assert_eq!((found.len(), found[place]), (count, quadruple), "{settings:?}");
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
    let sensed = PairProtocol { measure: PairPattern::Pairs(vec![[0, 16]]), ..Default::default() };
    let quadruples =
        |electrodes, list: &[[u32; 4]]| Protocol::from_quadruples(electrodes, list, 1.0);
    let none = "the protocol has no measurements: keep the driven electrodes or choose other pairs";
    for (electrodes, drive, step, least) in [
        (1, PairPattern::Adjacent, 1, 2),
        (4, PairPattern::Skip(3), 4, 5),
        (0, PairPattern::Opposite, 0, 2),
    ] {
        let few = format!("a drive pair of step {step} needs at least {least}");
        let wanted = format!("{electrodes} electrodes are too few: {few}");
        says(pairs(electrodes, drive).protocol(), &wanted);
    }
    let second = quadruples(4, &[[0, 1, 2, 3], [0, 1, 2, 4]]);
    for (result, place, electrodes, last) in [
        (explicit([3, 16]), "drive pair 1 refers to electrode index 16", 16, 15),
        (sensed.protocol(), "measured pair 0 refers to electrode index 16", 16, 15),
        (second, "quadruple 1 refers to electrode index 4", 4, 3),
        (quadruples(0, &[[0, 1, 2, 3]]), "quadruple 0 refers to electrode index 0", 0, 0),
    ] {
        let range = format!("but the {electrodes} electrodes have indices 0 to {last}");
        says(result, &format!("{place}, {range}"));
    }
    for (result, count) in [
        (pairs(usize::MAX, PairPattern::Adjacent).protocol(), "18446744073709552000"),
        (quadruples(4097, &[[0, 1, 2, 3]]), "4097"),
    ] {
        says(result, &format!("the number of electrodes is {count}: it must be at most 4096"));
    }
    for (result, pattern, sum, largest) in [
        (patterns(&good, &off), "measurement pattern 1", "2.5e-1", "7.5e-1"),
        (patterns(&zero, &good), "stimulation pattern 0", "0e0", "0e0"),
    ] {
        let rule = "the entries must sum to zero and must not all be zero";
        says(result, &format!("{pattern} sums to {sum} with a largest entry of {largest}: {rule}"));
    }
    let (odd, few) = (pairs(15, PairPattern::Opposite), array![[1.0], [-1.0]]);
    for (result, wanted) in [
        (
            odd.protocol(),
            "15 electrodes have no opposite pairs: use an even number or drive = \"skip-N\"",
        ),
        (explicit([3, 3]), "drive pair 1 connects electrode index 3 with itself"),
        (quadruples(4, &[[0, 1, 2, 2]]), "quadruple 0 connects electrode index 2 with itself"),
        (quadruples(4, &[]), none),
        (pairs(3, PairPattern::Adjacent).protocol(), none),
        (with_current(0.0), "current_a is 0: it must be finite and above zero"),
        (with_current(-1e-3), "current_a is -0.001: it must be finite and above zero"),
        (with_current(f64::NAN), "current_a is NaN: it must be finite and above zero"),
        (patterns(&good, &few), "rows of the measurement pattern matrix: 2 values given, 3 needed"),
        (patterns(&nan, &good), "stimulation pattern 1 contains NaN at electrode index 1"),
        (patterns(&Array2::zeros((3, 0)), &good), none),
    ] {
        says(result, wanted);
    }
    // the sums may overflow, depending on their order, but the protocol must not contain NaN
    let usable = |p: Protocol| p.stimulations_a().iter().all(|x| x.is_finite());
    assert!(patterns(&overflow, &overflow).map_or(true, usable));
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
                driven_electrodes: if drop {
                    DrivenElectrodes::Drop
                } else {
                    DrivenElectrodes::Keep
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
        prop_assert!(found.iter().all(|&[a, b, m, n]| a != b && m != n));
        // plus and minus one amplitude: exactly zero
        for row in protocol.stimulations_a().rows() {
            prop_assert_eq!(row.sum(), 0.0);
            prop_assert_eq!(row.iter().filter(|i| **i != 0.0).count(), 2);
            prop_assert_eq!(row.fold(0.0_f64, |m, i| m.max(i.abs())), settings.current_a);
        }
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
        for ((i, j), product) in currents.dot(&currents.t()).indexed_iter() {
            // the squared norm of a pattern is L/2 I^2, or L I^2 for the alternating one
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
