//! Position and force learnt from presses on the simulated fabric, and their file.

use crate::common::*;
use eit_skin::Progress;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::learn::{Frame, LearnedSkin, PressFrames, PressTable};
use eit_skin::touches::Touches;
use std::f64::consts::TAU;

/// Number of presses of each script that are learnt.
const LEARNT: usize = 12;
const TESTED: usize = 28;
/// Presses reach to 0.85 of the radius.
const WITHIN_M: f64 = 0.085;
const FIRST_FRAME: usize = 42;
/// Frames from one press to the next; its force rises in 4, stays for 14 and falls in 4.
const EACH: usize = 32;

/// Presses of 0.2 to 3 N; the learnt ones cover the forces, at places as a person would choose them.
fn presses(seed: u64) -> Vec<([f64; 2], f64)> {
    let mut random = Random::named(seed, "presses", 0);
    let press = |k: usize| {
        let (radius, turn) = match k {
            0..4 => (0.03, (k as f64 + 0.5) / 4.0),
            4..LEARNT => (0.075, (k as f64 - 4.0) / 8.0),
            _ => return (anywhere(&mut random), random.log_between(0.2, 3.0)),
        };
        let force_n = 0.2 * 15.0_f64.powf((5 * k % LEARNT) as f64 / (LEARNT - 1) as f64);
        (polar(radius, turn * TAU), force_n)
    };
    (0..LEARNT + TESTED).map(press).collect()
}

fn anywhere(random: &mut Random) -> [f64; 2] {
    loop {
        let place = [0; 2].map(|_| random.between(-WITHIN_M, WITHIN_M));
        if place[0].hypot(place[1]) <= WITHIN_M {
            return place;
        }
    }
}

/// Frames in which a press is steady.
fn held(press: usize) -> std::ops::Range<usize> {
    let begin = FIRST_FRAME + press * EACH;
    begin + 11..begin + 17
}

/// Errors in the steady frames of tested presses: of positions, metres, and of forces, relative.
fn errors(presses: &[([f64; 2], f64)], touches: &Touches) -> [Vec<f64>; 2] {
    let (mut places, mut forces) = (Vec::new(), Vec::new());
    for (k, (place, force)) in presses.iter().enumerate().skip(LEARNT) {
        for row in held(k).filter_map(|frame| strongest(&touches.rows, frame)) {
            places.push(off_m(&row.touch, *place));
            forces.extend(row.touch.force_n().map(|force_n| (force_n / force - 1.0).abs()));
        }
    }
    [places, forces]
}

#[test]
fn twelve_presses_give_newtons() {
    for seed in 1..=3 {
        let presses = presses(seed);
        let [recording] = PAPER.draw([seed], 1, |drawn, _| {
            presses.iter().for_each(|(place, force)| _ = drawn.press_at(&[*place], *force..*force));
        });
        let fitted = PAPER.fit(&recording);
        let line = |k: usize| {
            let begin = FIRST_FRAME + k * EACH;
            press(presses[k].0, presses[k].1, held(k), begin - 4..begin)
        };
        let table = PressTable::new((0..LEARNT).map(line).collect(), "table").unwrap();
        let pressed = PressFrames::new(&table, &fitted.frames).unwrap();
        let silent = &mut Progress::silent();
        let learned = LearnedSkin::learn(&fitted, &pressed, Frame::Scene, None, silent);
        let learned = learned.unwrap().skin;
        // its file is identical except for the last digit of numbers, which JSON may lose
        let read = LearnedSkin::from_bytes(&learned.to_bytes().unwrap()).unwrap();
        let [whole, wanted] =
            [&read, &learned].map(|l| (&l.channels, &l.fingerprint, l.measurements, l.places_by));
        assert_eq!(whole, wanted);
        let (found, wanted) = (&read.presses.frames, &learned.presses.frames);
        assert_eq!(found.dim(), (LEARNT, wanted.ncols()));
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= 1e-15 * b.abs()));
        let [before, none] = errors(&presses, &touches_of(&fitted));
        assert!(none.is_empty());
        let [after, forces] = errors(&presses, &touches_with(&fitted, &learned));
        // measured: 0.027 to 0.041 (median), 0.079 to 0.090 (90 % quantile), positions as without learning
        let (middle, most) = (median(&forces), eit_core::quantile(&forces, 0.9).unwrap());
        println!("seed {seed}: force median {middle:.3}, 90 % {most:.3} of {}", forces.len());
        assert!(middle < 0.05 && most < 0.1, "seed {seed}: {middle}, {most}");
        let [before, after] = [before, after].map(|errors_m| median(&errors_m));
        assert!(after <= 1.1 * before, "seed {seed}: {after} m learnt, {before} m untrained");
    }
}
