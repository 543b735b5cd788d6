//! Built-in scenes.

/// Names and texts.
pub(super) const SCENES: [(&str, &str); 9] = [
    ("paper-disc", include_str!("builtin/paper-disc.toml")),
    ("rough-disc", include_str!("builtin/rough-disc.toml")),
    ("stiff-contact", include_str!("builtin/stiff-contact.toml")),
    ("high-contrast", include_str!("builtin/high-contrast.toml")),
    ("general-32", include_str!("builtin/general-32.toml")),
    ("single-frame", include_str!("builtin/single-frame.toml")),
    ("plate-with-hole", include_str!("builtin/plate-with-hole.toml")),
    ("patches", include_str!("builtin/patches.toml")),
    ("hemisphere", include_str!("builtin/hemisphere.toml")),
];

/// Returns the text of a built-in scene.
pub(super) fn text(name: &str) -> Option<&'static str> {
    SCENES.iter().find(|scene| scene.0 == name).map(|scene| scene.1)
}
