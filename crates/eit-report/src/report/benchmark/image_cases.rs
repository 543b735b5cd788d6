//! The scenes whose images are compared: a built-in skin, what touches it, and the noise of its
//! instrument.

use super::forward_cases::{
    ForwardCase, GENERAL_32, HIGH_CONTRAST, PAPER_DISC, SINGLE_FRAME, STIFF_CONTACT,
};
use crate::simulate::{Finger, FingerShape, SLOW_M, SequenceSettings};

/// A scene whose images are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ImageCase {
    /// Key in output files.
    pub name: &'static str,
    /// Built-in skin.
    pub forward: ForwardCase,
    /// What distinguishes it.
    pub what: &'static str,
    /// Noise, decibels below the voltages.
    pub noise_db: f64,
    /// Relative change of conductivity at the centre of a finger.
    pub change: f64,
    /// Whether it is a single stationary frame instead of a sequence.
    pub is_still: bool,
    /// Whether it is the paper's experiments on the simulated fabric, which determines noise and
    /// change.
    pub is_fabric: bool,
    /// File names of its plots: curves, and one frame of each recording by every solver.
    pub files: [&'static str; 3],
}

/// All cases, starting with the paper's.
pub(super) const IMAGE_CASES: [ImageCase; 7] = [
    ImageCase {
        name: "paper-disc-60",
        forward: PAPER_DISC,
        what: "the paper's skin, a good instrument",
        noise_db: 60.0,
        change: 0.5,
        is_still: false,
        is_fabric: false,
        files: [
            "error_paper_disc_60.png",
            "images_paper_disc_60_bell.png",
            "images_paper_disc_60_pad.png",
        ],
    },
    ImageCase {
        name: "paper-disc-40",
        forward: PAPER_DISC,
        what: "the paper's skin, a poor instrument",
        noise_db: 40.0,
        change: 0.5,
        is_still: false,
        is_fabric: false,
        files: [
            "error_paper_disc_40.png",
            "images_paper_disc_40_bell.png",
            "images_paper_disc_40_pad.png",
        ],
    },
    ImageCase {
        name: "paper-fabric",
        forward: PAPER_DISC,
        what: "the paper's experiments on the simulated fabric: electrodes move with the finger",
        noise_db: f64::NAN,
        change: f64::NAN,
        is_still: false,
        is_fabric: true,
        files: [
            "error_paper_fabric.png",
            "images_paper_fabric_one.png",
            "images_paper_fabric_two.png",
        ],
    },
    ImageCase {
        name: "stiff-contact",
        forward: STIFF_CONTACT,
        what: "contact impedances over nine decades",
        noise_db: 60.0,
        change: 0.5,
        is_still: false,
        is_fabric: false,
        files: [
            "error_stiff_contact.png",
            "images_stiff_contact_bell.png",
            "images_stiff_contact_pad.png",
        ],
    },
    ImageCase {
        name: "high-contrast",
        forward: HIGH_CONTRAST,
        what: "conductivity up to eleven times higher under a finger",
        noise_db: 60.0,
        change: 10.0,
        is_still: false,
        is_fabric: false,
        files: [
            "error_high_contrast.png",
            "images_high_contrast_bell.png",
            "images_high_contrast_pad.png",
        ],
    },
    ImageCase {
        name: "general-32",
        forward: GENERAL_32,
        what: "32 electrodes, currents on all of them at once",
        noise_db: 60.0,
        change: 0.5,
        is_still: false,
        is_fabric: false,
        files: ["error_general_32.png", "images_general_32_bell.png", "images_general_32_pad.png"],
    },
    ImageCase {
        name: "single-frame",
        forward: SINGLE_FRAME,
        what: "one frame, nothing in time",
        noise_db: 60.0,
        change: 0.5,
        is_still: true,
        is_fabric: false,
        files: [
            "error_single_frame.png",
            "images_single_frame_bell.png",
            "images_single_frame_pad.png",
        ],
    },
];

/// Number of fingers on every skin.
pub(super) const FINGERS: usize = 2;

impl ImageCase {
    /// Settings of the sequence for one shape of finger; each `take` has its own paths and noise.
    pub fn sequence(&self, shape: FingerShape, frames: usize, take: u64) -> SequenceSettings {
        SequenceSettings {
            touches: FINGERS,
            frames: if self.is_still { 1 } else { frames },
            step_m: SLOW_M,
            finger: Finger { shape, change: self.change, ..Default::default() },
            noise_db: self.noise_db,
            path_seed: 1 + take,
            noise_seed: 1 + take,
            ..Default::default()
        }
    }
}
