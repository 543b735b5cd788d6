//! A U-net and its name.

use eit_skin::denoise::Net;

/// A U-net and its name in tables.
pub(super) struct NamedNet {
    pub name: String,
    pub net: Net,
}
