//! `eit report --touches --quick`: every part runs, and its numbers are plausible relative to the bound.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{succeed, text};
use serde_json::Value;

/// Rows of a table.
fn rows<'a>(report: &'a Value, name: &str) -> &'a Vec<Value> {
    let tables = report["tables"].as_array().unwrap();
    let table = tables.iter().find(|table| table["name"] == name);
    table.unwrap_or_else(|| panic!("no table {name}"))["rows"].as_array().unwrap()
}

fn number(row: &Value, column: &str) -> f64 {
    row[column].as_f64().unwrap_or_else(|| panic!("{column} of {row}"))
}

#[test]
fn touch_figures_are_sane_against_the_bound() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    succeed(&["report", "--touches", "--quick", "--out", text(&out)]);
    for file in
        ["touches.md", "touches.csv", "reliability.png", "position_centre.png", "position_rim.png"]
    {
        assert!(std::fs::metadata(out.join(file)).unwrap().len() > 1000, "{file}");
    }
    let json = std::fs::read_to_string(out.join("touches.json")).unwrap();
    let report: Value = serde_json::from_str(&json).unwrap();

    // first the false touches: none on an untouched skin, and at most one in a hundred of 200 touches and
    // more; measured none of 315
    assert_eq!(report["tables"][0]["name"], "reliability");
    let [untouched, all, said @ ..] = rows(&report, "reliability").as_slice() else { panic!() };
    assert_eq!(number(untouched, "without a finger"), 0.0, "{untouched}");
    let [wrong, reported] = ["without a finger", "reported"].map(|column| number(all, column));
    assert!(reported > 200.0 && wrong <= 0.01 * reported, "{all}");
    let of_ranges: f64 = said.iter().map(|row| number(row, "reported")).sum();
    assert_eq!(of_ranges, reported);

    // 60 dB: at every ring all touches are found, and the fit is at its bound
    let positions = rows(&report, "position");
    assert_eq!(positions.len(), 9);
    for row in positions {
        assert_eq!(number(row, "found"), 1.0, "{row}");
        // the root mean square of four lengths in a plane: 0.33 to 1.8 of its expectation, except once in
        // five hundred
        if row["method"] == "fit" {
            let ratio = number(row, "rms, mm") / number(row, "bound, mm");
            assert!((0.3..2.0).contains(&ratio), "{row}");
        }
        // a tenth of the radius: the error of one-step images near a rim
        assert!(number(row, "median, mm") < 10.0, "{row}");
    }
    // the bound is smallest near the electrodes
    let bounds: Vec<f64> = positions.iter().map(|row| number(row, "bound, mm")).collect();
    assert!(bounds[0] > bounds[3] && bounds[3] > bounds[6], "{bounds:?}");

    // electrodes pulled along by a sliding finger cost the fit near the rim more than noise does
    let rim = |fabric: &str| {
        let wanted = |row: &&Value| {
            number(row, "ring") == 0.8 && row["fabric"] == fabric && row["method"] == "fit"
        };
        number(rows(&report, "movement").iter().find(wanted).unwrap(), "median, mm")
    };
    assert!(rim("rim gives way, sliding") > 2.0 * rim("nothing moves"));

    // removing movement from the data removes most of its effect; measured 0.005 of 0.331 for total
    // variation, whose spots vanish, and 0.056 of 0.279 for one-step, whose ringing stays (0.054 if nothing
    // moves)
    let image = |script: &str, of: &str, key: &str, column: &str| {
        let wanted = |row: &&Value| row["script"] == script && row["of"] == of && row["key"] == key;
        number(rows(&report, "electrodes").iter().find(wanted).unwrap(), column)
    };
    let both = |of, column| ["-", "0.2 mm"].map(|key| image("one finger", of, key, column));
    for (method, part) in [("st-tv", 0.1), ("gauss-newton", 0.4)] {
        let [without, with] = both(method, "away");
        assert!(with < part * without, "{method}: {without} {with}");
    }
    for of in ["st-tv", "gauss-newton"] {
        let [without, with] = both(of, "position, mm");
        assert!(with < without, "{of}: {without} {with} mm");
        // found, within one frame in thirty
        let [without, with] = both(of, "found");
        assert!(with >= without - 0.04, "{of}: {without} {with}");
        // measured 0.9 to 1.2 per frame without
        let [without, with] = both(of, "invented a frame");
        assert!(without > 0.3 && with < 0.3 * without, "{of}: {without} {with}");
    }
    // touches allow for electrode movement whatever the images do: measured none invented in 30 frames, nor
    // in 300 of ten other seeds, 1.6 mm
    let invented = both("touches", "invented a frame");
    let position = both("touches", "position, mm");
    let found = both("touches", "found");
    assert!(invented.iter().all(|x| *x < 0.05), "{invented:?}");
    assert!(position.iter().all(|x| *x < 4.0), "{position:?}");
    assert!(found.iter().all(|x| *x > 0.95), "{found:?}");
    // if nothing moves, the removed directions cost a millimetre or two: measured 1.3 and 1.8 mm for total
    // variation, 3.7 and 5.3 for one-step
    for method in ["st-tv", "gauss-newton"] {
        let [without, with] =
            ["-", "0.2 mm"].map(|key| image("one finger, rigid rim", method, key, "position, mm"));
        assert!(with < without + 3.0, "{method}: {without} {with} mm");
    }

    // the fit separates what images do not
    for row in rows(&report, "two_points") {
        let [image, fit] =
            ["one-step image", "fit"].map(|method| row[method].as_f64().unwrap_or(f64::INFINITY));
        assert!(fit <= image, "{row}");
    }
    // moving electrodes hide fingers from ST-TV; one-step images lose few
    for row in rows(&report, "tracks").iter().filter(|row| row["method"] == "one-step") {
        assert!(number(row, "found") > 0.5, "{row}");
    }
    for row in rows(&report, "greit") {
        // GREIT asks for a uniform amplitude response; a bell is wide enough to appear at its size
        assert!((0.6..1.4).contains(&number(row, "AR")), "{row}");
    }
    for row in rows(&report, "latency") {
        let [median, worst] = ["median", "worst"].map(|column| number(row, column));
        assert!(median > 0.0 && median <= worst, "{row}");
        assert!(number(row, "touched") > 0.5, "{row}");
    }
}

#[test]
fn parts_are_chosen_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    succeed(&["report", "--touches=latency", "--quick", "--out", text(&out)]);
    let json = std::fs::read_to_string(out.join("touches.json")).unwrap();
    let report: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(report["tables"].as_array().unwrap().len(), 1);
    assert!(!out.join("position_centre.png").exists());
}
