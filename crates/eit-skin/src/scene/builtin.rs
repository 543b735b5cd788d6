//! Built-in scenes.

/// Names of the built-in scenes.
pub const NAMES: [&str; 8] = [
    "paper-disc",
    "stiff-contact",
    "high-contrast",
    "general-32",
    "single-frame",
    "plate-with-hole",
    "patches",
    "hemisphere",
];

/// Returns the text of a built-in scene.
pub fn text(name: &str) -> Option<&'static str> {
    match name {
        "paper-disc" => Some(PAPER_DISC),
        "stiff-contact" => Some(STIFF_CONTACT),
        "high-contrast" => Some(HIGH_CONTRAST),
        "general-32" => Some(GENERAL_32),
        "single-frame" => Some(SINGLE_FRAME),
        "plate-with-hole" => Some(PLATE_WITH_HOLE),
        "patches" => Some(PATCHES),
        "hemisphere" => Some(HEMISPHERE),
        _ => None,
    }
}

/// The skin of Duan, Taurand, Soleimani, Sci. Rep. 9:8831 (2019).
const PAPER_DISC: &str = r#"# The skin of Duan, Taurand, Soleimani 2019: a conductive fabric, 16 electrodes on its rim.
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 16
width_m = 0.0196
first_angle_deg = 90.0
direction = "counterclockwise"
contact_impedance_ohm_m = 1e3

[protocol]
drive = "adjacent"
measure = "adjacent"
driven_electrodes = "drop"
order = "rotated"
current_a = 1e-4
"#;

/// Contact impedances over nine decades: soldered to barely touching.
const STIFF_CONTACT: &str = r#"# The paper's skin with contacts from soldered (1 ohm mm) to barely touching (1 Mohm m).
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 16
width_m = 0.0196
first_angle_deg = 90.0
contact_impedance_ohm_m = [1e-3, 1e6, 1e3, 1e-3, 1e6, 1e3, 1e-3, 1e6,
                           1e3, 1e-3, 1e6, 1e3, 1e-3, 1e6, 1e3, 1e-3]

[protocol]
drive = "adjacent"
measure = "adjacent"
current_a = 1e-4
"#;

/// A fabric whose conductivity rises twentyfold under a finger.
const HIGH_CONTRAST: &str = r#"# A fabric whose conductivity rises by up to twenty times under a finger: far from linear.
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 16
width_m = 0.0196
first_angle_deg = 90.0
contact_impedance_ohm_m = 1e3

[protocol]
drive = "adjacent"
measure = "adjacent"
current_a = 1e-4

[reconstruction]
lower_s = 0.0                 # pressing only raises it
upper_s = 2e-4
"#;

/// Currents on all 32 electrodes at once.
const GENERAL_32: &str = r#"# 32 electrodes, 31 trigonometric current patterns on all of them at once, 992 values a frame.
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 32
width_m = 0.01
first_angle_deg = 90.0
contact_impedance_ohm_m = 1e3

[protocol]
drive = "trigonometric"
measure = "adjacent"
driven_electrodes = "keep"    # every electrode carries current
current_a = 1e-4
"#;

/// A static picture without a time dimension.
const SINGLE_FRAME: &str = r#"# One frame of a skin at rest: nothing to couple in time, no stream, no instrument.
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 16
width_m = 0.0196
first_angle_deg = 90.0
contact_impedance_ohm_m = 1e3

[protocol]
drive = "opposite"
measure = "adjacent"
current_a = 1e-4

[reconstruction]
method = "tv"
"#;

/// A plate around a joint: corners, a hole, electrodes of two widths on both rims.
const PLATE_WITH_HOLE: &str = r#"# A rectangular skin with a hole for a joint; electrodes on the outer rim and around the hole.
[skin]
shape = "polygon"
outline = [[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]]
holes = [[[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]]]
conductivity_s = 1e-5

[electrodes]
positions_m = [[-0.1, -0.1], [0.0, -0.1], [0.1, -0.1], [0.15, 0.0],
               [0.1, 0.1], [0.0, 0.1], [-0.1, 0.1], [-0.15, 0.0],
               [0.03, 0.0], [0.0, 0.03], [-0.03, 0.0], [0.0, -0.03]]
width_m = [0.02, 0.02, 0.02, 0.03, 0.02, 0.02, 0.02, 0.03, 0.01, 0.01, 0.01, 0.01]
contact_impedance_ohm_m = 1e3

[protocol]
drive = "adjacent"
measure = "adjacent"
current_a = 1e-4
"#;

/// A grid of snap fasteners through the fabric.
const PATCHES: &str = r#"# A square skin with round snaps through the fabric: patch electrodes, 4 x 4.
[skin]
shape = "rectangle"
width_m = 0.2
height_m = 0.2
conductivity_s = 1e-5

[electrodes]
positions_m = [[-0.075, -0.075], [-0.025, -0.075], [0.025, -0.075], [0.075, -0.075],
               [0.075, -0.025], [0.025, -0.025], [-0.025, -0.025], [-0.075, -0.025],
               [-0.075, 0.025], [-0.025, 0.025], [0.025, 0.025], [0.075, 0.025],
               [0.075, 0.075], [0.025, 0.075], [-0.025, 0.075], [-0.075, 0.075]]
radius_m = 0.006
contact_impedance_ohm_m = 1.0 # of patches: ohm square metre

[protocol]
drive = "adjacent"
measure = "adjacent"
current_a = 1e-4
"#;

/// The paper's skin expanded to a dome: the same voltages, by conformal mapping.
const HEMISPHERE: &str = r#"# A dome with the paper's electrodes on its rim: on a homogeneous skin, the voltages of paper-disc.
[skin]
shape = "hemisphere"
radius_m = 0.1
conductivity_s = 1e-5

[electrodes]
count = 16
width_m = 0.0196
first_angle_deg = 90.0
contact_impedance_ohm_m = 1e3

[protocol]
drive = "adjacent"
measure = "adjacent"
current_a = 1e-4
"#;
