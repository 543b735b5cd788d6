//! Tests of the crate, in one program; those of one file: `cargo test --release -p eit-cli --test all FILE::`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]
#![allow(clippy::print_stdout, reason = "tests")]

mod common;

mod accuracy;
mod bad_input;
mod body;
mod calibrate;
mod check;
mod commands;
mod conventions;
mod demo;
mod denoise;
mod electrode_movement;
mod geometry;
mod hydrogel;
mod init;
mod instruments;
mod learn;
mod learn_live;
mod learn_real;
mod memory;
mod methods;
mod missing_values;
mod publish;
mod reactive;
mod readme;
mod real_data;
mod recordings;
mod report;
mod shell;
mod silence;
mod simulate;
mod validation;
