//! Runs the examples and checks their results.

#[path = "../../examples/difference.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod difference;

#[cfg(feature = "st-tv")]
#[path = "../../examples/stream.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod stream;

/// A tenth of the radius. Eight untouched frames bring the image to rest, and the others cost nothing.
#[cfg(feature = "st-tv")]
#[test]
fn stream_example() {
    let outcome = stream::run().unwrap();
    assert_eq!(outcome.errors_m.len(), 24);
    assert!(outcome.errors_m.iter().all(|error_m| *error_m < 0.01), "{:?}", outcome.errors_m);
    assert!(outcome.worst_gap <= 1e-2, "{}", outcome.worst_gap);
    assert_eq!(outcome.quiet, 9);
}

/// A tenth of the radius is the resolution of 16 electrodes at half the radius. The README's table matches the
/// example's results to one unit of its last digits.
#[test]
fn difference_example_and_its_table_in_the_readme() {
    let outcomes = difference::run().unwrap();
    assert_eq!(outcomes.len(), 16);
    for o in &outcomes {
        let case = format!("{}, {}, lambda {}", o.prior, o.rule, o.hyperparameter);
        assert!(o.position_error_m < 0.01, "{case}: {} m off", o.position_error_m);
        assert!(o.correlation > 0.4, "{case}: correlation {}", o.correlation);
    }
    let readme = include_str!("../../README.md");
    for name in ["Tikhonov", "NOSER", "Laplace", "Gaussian"] {
        let row = readme.lines().find(|l| l.starts_with(&format!("| {name} |"))).unwrap();
        let figures: Vec<f64> = row.split('|').filter_map(|c| c.trim().parse().ok()).collect();
        let same = |o: &&difference::Outcome| o.prior == name.to_lowercase() && o.rule == "GCV";
        let found = outcomes.iter().find(same).unwrap();
        let measured = [found.hyperparameter, 1e3 * found.position_error_m, found.correlation];
        println!("| {name} | {:.4} | {:.1} | {:.2} |", measured[0], measured[1], measured[2]);
        assert_eq!(figures.len(), 3, "{row}");
        for ((figure, measured), unit) in figures.iter().zip(measured).zip([1e-4, 0.1, 0.01]) {
            assert!((figure - measured).abs() < unit, "{row}: {measured}");
        }
    }
}
