//! The skins whose forward problem is measured, and the scenes of the report: a skin with or without
//! the race of its images.

use super::case::{CASES, Case};
use crate::error::ReportError;
use crate::settings::ReportSettings;

/// A built-in skin and the sheet that its forward problem is solved for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skin {
    /// Built-in scene.
    pub scene: &'static str,
    /// What is special about it.
    pub what: &'static str,
    /// Relative change of conductivity under two soft fingers; `None`: nothing touches the skin.
    pub change: Option<f64>,
    /// Picture of the report: error of the voltages over time.
    pub file: &'static str,
}

pub(super) const PAPER_DISC: Skin = Skin {
    scene: "paper-disc",
    what: "the paper's skin",
    change: None,
    file: "forward_paper_disc.png",
};
pub(super) const STIFF_CONTACT: Skin = Skin {
    scene: "stiff-contact",
    what: "contact impedances over nine decades",
    change: None,
    file: "forward_stiff_contact.png",
};
pub(super) const HIGH_CONTRAST: Skin = Skin {
    scene: "high-contrast",
    what: "conductivity up to eleven times higher under two soft fingers, one value an element",
    change: Some(10.0),
    file: "forward_high_contrast.png",
};
pub(super) const GENERAL_32: Skin = Skin {
    scene: "general-32",
    what: "32 electrodes, currents on all of them at once",
    change: None,
    file: "forward_general_32.png",
};
pub(super) const SINGLE_FRAME: Skin = Skin {
    scene: "single-frame",
    what: "the paper's skin, currents through opposite electrodes",
    change: None,
    file: "forward_single_frame.png",
};
const PLATE_WITH_HOLE: Skin = Skin {
    scene: "plate-with-hole",
    what: "corners, a hole, electrodes of two widths on both rims",
    change: None,
    file: "forward_plate_with_hole.png",
};
const PATCHES: Skin = Skin {
    scene: "patches",
    what: "16 round patches inside the skin",
    change: None,
    file: "forward_patches.png",
};
pub(super) const HEMISPHERE: Skin = Skin {
    scene: "hemisphere",
    what: "a dome with the paper's electrodes on its rim",
    change: None,
    file: "forward_hemisphere.png",
};

/// Every skin, the paper's first.
pub const SKINS: [Skin; 8] = [
    PAPER_DISC,
    STIFF_CONTACT,
    HIGH_CONTRAST,
    GENERAL_32,
    SINGLE_FRAME,
    PLATE_WITH_HOLE,
    PATCHES,
    HEMISPHERE,
];

/// A scene of the report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    pub skin: Skin,
    /// The race of its images; what is only another shape has none.
    pub case: Option<Case>,
}

impl Entry {
    /// Key in files.
    pub fn name(&self) -> &'static str {
        self.case.map_or(self.skin.scene, |case| case.name)
    }
}

/// Every scene, those with images first.
fn all() -> Vec<Entry> {
    let raced = CASES.into_iter().map(|case| Entry { skin: case.skin, case: Some(case) });
    let is_raced = |skin: &Skin| CASES.iter().any(|case| case.skin == *skin);
    let others = SKINS.into_iter().filter(|skin| !is_raced(skin));
    raced.chain(others.map(|skin| Entry { skin, case: None })).collect()
}

/// The scenes of the command line, all without; of them what the command asks for.
pub(super) fn chosen(args: &ReportSettings) -> Result<Vec<Entry>, ReportError> {
    let all = all();
    let find = |name: &String| {
        all.iter().find(|entry| entry.name() == name).copied().ok_or_else(|| {
            let known: Vec<&str> = all.iter().map(Entry::name).collect();
            ReportError::input(format!("--scenes {name}: the scenes are {}", known.join(", ")))
        })
    };
    let mut entries = match args.scenes.is_empty() {
        true => all.clone(),
        false => args.scenes.iter().map(find).collect::<Result<_, _>>()?,
    };
    if args.plans {
        // a plan promises images
        entries.retain(|entry| entry.case.is_some());
        if entries.is_empty() {
            let names = args.scenes.join(", ");
            return Err(ReportError::input(format!(
                "--plans: the report makes no images of {names}, and compares no plan with them"
            )));
        }
    }
    if args.forward {
        let mut skins: Vec<Entry> = Vec::new();
        for Entry { skin, .. } in entries {
            if skins.iter().all(|known| known.skin != skin) {
                skins.push(Entry { skin, case: None });
            }
        }
        return Ok(skins);
    }
    Ok(entries)
}
