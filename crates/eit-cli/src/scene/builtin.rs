//! Scenes that come with the program.

/// Names of the built-in scenes.
pub(crate) const NAMES: [&str; 1] = ["paper-disc"];

/// The text of a built-in scene.
pub(super) fn text(name: &str) -> Option<&'static str> {
    match name {
        "paper-disc" => Some(PAPER_DISC),
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
