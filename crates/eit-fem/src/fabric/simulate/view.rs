//! What the images of the truth are made on.

use crate::fabric::conductivity::pixel_seats;
use crate::fabric::seat::Seat;
use eit_mesh::{Raster, Surface};

/// Pixels of the truth's images.
pub(super) struct View<'a> {
    pub raster: &'a Raster,
    /// Where the masked pixels are on the skin.
    pub seats: Vec<Option<Seat>>,
}

impl<'a> View<'a> {
    pub(super) fn new(raster: &'a Raster, surface: &Surface) -> Self {
        Self { raster, seats: pixel_seats(raster, surface) }
    }
}
