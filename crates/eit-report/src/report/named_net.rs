//! A U-net and what it is called.

use eit_skin::denoise::Net;

/// A U-net and what it is called in tables.
pub(super) struct NamedNet {
    pub name: String,
    pub net: Net,
}
