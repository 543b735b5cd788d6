//! What the touch list of a real skin shows after `eit learn`: the first presses of a robot are learnt, later ones are
//! held in a recording that is reconstructed with the learnt file. Differences are the robot's; the steady level and its
//! noise, a thousandth of each level, are ours, because the data have no sequences.

use crate::common::*;
use crate::hydrogel::{superpose500, write_quadruples};
use fixtures::Random;
use fixtures::hydrogel::quantile;
use std::fmt::Write as _;

const RADIUS_M: f64 = 0.085;
const QUIET: usize = 60;
const TESTED: std::ops::Range<usize> = 300..360;
/// Part of a press in each of its frames, after eight frames without one.
const PARTS: [f64; 12] = [0.3, 0.7, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.7, 0.3];
const EACH: usize = 8 + PARTS.len();

/// The presses of a skin: pressed and untouched frames, and places around their middle.
struct Presses {
    folder: Folder,
    pressed: Array2<f64>,
    before: Array2<f64>,
    places_m: Vec<[f64; 2]>,
}

impl Presses {
    fn superpose500() -> Option<Self> {
        let data = fixtures::shared_data("hydrogel_superpose500")?;
        let (folder, ([pressed, before], places_m)) = (Folder::new(), superpose500(&data));
        write_quadruples(&folder, &data);
        Some(Self { folder, pressed, before, places_m })
    }

    /// What a press changes.
    fn change(&self, press: usize) -> Array1<f64> {
        &self.pressed.row(press) - &self.before.row(press)
    }

    fn scene(&self, name: &str, more: &str) -> String {
        let text = format!(
            "[skin]\nshape = \"disc\"\nradius_m = {RADIUS_M}\nconductivity_s = 1e-3\n\
             [electrodes]\ncount = 16\nwidth_m = 0.01\ncontact_impedance_ohm_m = 1e-2\n\
             [protocol]\nquadruples_file = \"quadruples.csv\"\ncurrent_a = 1e-3\n{more}"
        );
        self.folder.write(name, text)
    }

    /// Learns the first presses; returns the answer and the file.
    fn learn(&self, count: usize) -> (Value, String) {
        let frames = Array2::from_shape_fn((2 * count, self.before.ncols()), |(frame, i)| {
            [&self.before, &self.pressed][frame % 2][[frame / 2, i]]
        });
        let file = self.folder.write_array("learn.npy", &frames);
        let mut table = "x_m,y_m,first_frame,before_first\n".to_owned();
        for (k, [x, y]) in self.places_m[..count].iter().enumerate() {
            // a robot's own origin
            writeln!(table, "{},{},{},{}", x + 0.3, y - 0.4, 2 * k + 1, 2 * k).unwrap();
        }
        let (table, out) = (self.folder.write("p.csv", table), self.folder.path("s.learned"));
        let scene = self.scene("learn.toml", "");
        let data = format!("--frames {file} --presses {table}");
        (parse(&run(&format!("learn {scene} {data} --fit-frame --out {out} --json"))), out)
    }

    /// Valid touches of each frame of a recording, metres.
    fn shown(&self, recording: &Recording, learned: &str) -> Vec<Vec<[f64; 2]>> {
        let out = self.folder.path("out");
        let values = recording.frames.concat();
        let values = Array2::from_shape_vec((recording.frames.len(), self.before.ncols()), values);
        let file = self.folder.write_array("live.npy", &values.unwrap());
        // images are not looked at
        let keys = format!(
            "[recording]\nreference = \"0..{QUIET}\"\nframe_rate_hz = 10\n\
             [touch]\nlearned = {learned:?}\n[reconstruction]\npixels = 16\n"
        );
        let scene = self.scene("live.toml", &keys);
        run(&format!("reconstruct {scene} --frames {file} --method gauss-newton --out {out}"));
        let mut shown = vec![Vec::new(); recording.frames.len()];
        for row in rows(format!("{out}/touches.csv")) {
            if row["state"] != "end" && row["valid"] == "true" {
                let place = ["x_m", "y_m"].map(|name| row[name].parse().unwrap());
                shown[row["frame"].parse::<usize>().unwrap()].push(place);
            }
        }
        shown
    }
}

/// Frames at a level, with noise, after quiet ones.
struct Recording {
    level: Array1<f64>,
    frames: Vec<Vec<f64>>,
    random: Random,
}

impl Recording {
    fn at(level: ArrayView1<'_, f64>) -> Self {
        let mut made = Self { frames: Vec::new(), random: Random::new(1), level: level.to_owned() };
        let none = &made.level * 0.0;
        (0..QUIET).for_each(|_| made.push(&none, 0.0));
        made
    }

    fn push(&mut self, change: &Array1<f64>, part: f64) {
        let values = self.level.iter().zip(change);
        let noisy = |(v, c): (&f64, &f64)| v + part * c + 1e-3 * v.abs() * self.random.normal();
        self.frames.push(values.map(noisy).collect());
    }
}

/// What a command prints; such skins have notes, too.
fn run(line: &str) -> String {
    let output = eit(line);
    ended(&output, 0);
    stdout(&output)
}

/// Held presses of a skin that was learnt are in its touch list at the robot's places, and nothing else is. Two presses
/// at once, as sums of two single ones more than half a radius apart: both are shown in most, never three.
#[test]
fn held_presses_of_a_real_skin_are_shown() {
    let Some(presses) = Presses::superpose500() else { return };
    let mut recording = Recording::at(presses.before.row(300));
    for k in TESTED {
        let change = presses.change(k) / presses.before.row(k) * &recording.level;
        [0.0; 8].into_iter().chain(PARTS).for_each(|part| recording.push(&change, part));
    }
    // presses learnt; parts of the held frames that are shown, and that are shown within 15 % of the diameter
    for (learnt, least_shown, least_found) in [(25, 0.85, 0.85), (100, 0.95, 0.95)] {
        let (answer, learned) = presses.learn(learnt);
        let shown = presses.shown(&recording, &learned);
        let stated_m = number(&answer["held_out"]["presses"], "median_m");
        let (mut held, mut ghosts, mut extra, mut errors) = (0, 0, 0, Vec::new());
        for (k, at) in TESTED.map(|k| presses.places_m[k]).enumerate() {
            let begin = QUIET + k * EACH;
            ghosts += shown[begin..begin + 8].iter().filter(|touches| !touches.is_empty()).count();
            for touches in &shown[begin + 10..begin + 18] {
                held += 1;
                extra += touches.len().saturating_sub(1);
                errors.extend(touches.first().map(|touch| distance_m(*touch, at)));
            }
        }
        let found = errors.iter().filter(|error| **error <= 0.3 * RADIUS_M).count();
        let [seen, found, extra] =
            [errors.len(), found, extra].map(|count| count as f64 / f64::from(held));
        let median_m = quantile(&errors, 0.5);
        println!(
            "{learnt} presses: shown {seen:.3}, found {found:.3}, {:.1} mm, stated {:.1} mm, beside {extra:.3}, {ghosts} \
             ghosts",
            1e3 * median_m,
            1e3 * stated_m
        );
        assert!(seen >= least_shown && found >= least_found, "{seen} {found}");
        // one single press in a hundred may show another touch beside it: at most two of these 60
        assert!(ghosts == 0 && extra <= 0.034, "{ghosts} {extra}");
        // the skin changes between learning and use: half as much again, and one sixth for medians of 60 and of 100 presses;
        // 25 presses do not tell yet how far they are off
        assert!(learnt < 100 || median_m <= 1.75 * stated_m, "{median_m} {stated_m}");
    }
    two_presses_are_two(&presses, &presses.folder.path("s.learned"));
}

fn two_presses_are_two(presses: &Presses, learned: &str) {
    let mut recording = Recording::at(presses.before.row(100));
    let mut pairs = Vec::new();
    while pairs.len() < 100 {
        let [one, other] = [0; 2].map(|_| 100 + recording.random.below(400));
        if distance_m(presses.places_m[one], presses.places_m[other]) < 0.5 * RADIUS_M {
            continue;
        }
        let change = presses.change(one) + presses.change(other);
        [0.0; 6].into_iter().chain([1.0; 3]).for_each(|part| recording.push(&change, part));
        pairs.push((recording.frames.len() - 1, [one, other]));
    }
    let shown = presses.shown(&recording, learned);
    let is_near = |touch, press: usize| distance_m(touch, presses.places_m[press]) < 0.015;
    let is_both = |(frame, [one, other]): &(usize, [usize; 2])| match shown[*frame][..] {
        [a, b] => {
            (is_near(a, *one) && is_near(b, *other)) || (is_near(a, *other) && is_near(b, *one))
        }
        _ => false,
    };
    let both = pairs.iter().filter(|pair| is_both(pair)).count();
    let most = pairs.iter().map(|(frame, _)| shown[*frame].len()).max();
    println!("{both} of 100 pairs are shown as two within 15 mm, at most {most:?} touches");
    // found 71, less two standard deviations of a hundred draws
    assert!(both >= 62 && most == Some(2), "{both} {most:?}");
}
