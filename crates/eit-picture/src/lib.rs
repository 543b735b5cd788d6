#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

mod animation;
mod axis;
mod backend;
mod canvas;
mod colormap;
mod error;
#[cfg(test)]
mod fixtures_for_tests;
#[cfg(feature = "mesh")]
mod from_mesh;
mod mesh;
mod numbers;
mod page;
mod panel;
mod plot;
mod scale;
mod settings;
mod sheet;
mod skin;
mod text;
mod ticks;
mod tracks;
#[cfg(feature = "mesh")]
mod view;

/// ndarray, in the version of this crate's interface.
pub use ndarray;

pub use animation::write_gif;
pub use canvas::Canvas;
pub use colormap::ColorMap;
pub use error::{PictureError, PointOf};
pub use mesh::{MeshDrawing, draw_mesh};
pub use plot::{Plot, Series, draw_plot};
pub use settings::{FrameLabels, PictureSettings};
pub use sheet::draw_sheet;
pub use skin::{ElectrodeDrawing, Extent, SkinDrawing};
pub use tracks::{Track, TracksPanel, draw_tracks};
#[cfg(feature = "mesh")]
pub use view::View;
