//! The skins whose forward problem is benchmarked.

/// A built-in skin and the conductivity used for its forward problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ForwardCase {
    /// Name of the built-in scene.
    pub scene: &'static str,
    /// What distinguishes it.
    pub what: &'static str,
    /// Relative change of conductivity under two soft fingers; `None` if nothing touches the skin.
    pub change: Option<f64>,
    /// File name of its plot of voltage error against time.
    pub file: &'static str,
}

pub(super) const PAPER_DISC: ForwardCase = ForwardCase {
    scene: "paper-disc",
    what: "the paper's skin",
    change: None,
    file: "forward_paper_disc.png",
};
pub(super) const STIFF_CONTACT: ForwardCase = ForwardCase {
    scene: "stiff-contact",
    what: "contact impedances over nine decades",
    change: None,
    file: "forward_stiff_contact.png",
};
pub(super) const HIGH_CONTRAST: ForwardCase = ForwardCase {
    scene: "high-contrast",
    what: "conductivity up to eleven times higher under two soft fingers, one value per element",
    change: Some(10.0),
    file: "forward_high_contrast.png",
};
pub(super) const GENERAL_32: ForwardCase = ForwardCase {
    scene: "general-32",
    what: "32 electrodes, currents on all of them at once",
    change: None,
    file: "forward_general_32.png",
};
pub(super) const SINGLE_FRAME: ForwardCase = ForwardCase {
    scene: "single-frame",
    what: "the paper's skin, currents through opposite electrodes",
    change: None,
    file: "forward_single_frame.png",
};
const PLATE_WITH_HOLE: ForwardCase = ForwardCase {
    scene: "plate-with-hole",
    what: "corners, a hole, electrodes of two widths on both rims",
    change: None,
    file: "forward_plate_with_hole.png",
};
const PATCHES: ForwardCase = ForwardCase {
    scene: "patches",
    what: "16 round patches inside the skin",
    change: None,
    file: "forward_patches.png",
};
pub(super) const HEMISPHERE: ForwardCase = ForwardCase {
    scene: "hemisphere",
    what: "a dome with the paper's electrodes on its rim",
    change: None,
    file: "forward_hemisphere.png",
};

/// All skins, starting with the paper's.
pub(super) const FORWARD_CASES: [ForwardCase; 8] = [
    PAPER_DISC,
    STIFF_CONTACT,
    HIGH_CONTRAST,
    GENERAL_32,
    SINGLE_FRAME,
    PLATE_WITH_HOLE,
    PATCHES,
    HEMISPHERE,
];
