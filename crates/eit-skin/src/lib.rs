#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

mod arrangement;
#[cfg(feature = "hw")]
pub mod connect;
#[cfg(feature = "denoise")]
pub mod denoise;
#[cfg(not(feature = "denoise"))]
#[path = "denoise_absent.rs"]
mod denoise;
mod displacement;
#[cfg(feature = "hw")]
pub mod emulate;
mod error;
pub mod faults;
#[cfg(feature = "first-scene")]
pub mod first_scene;
mod fitted;
pub mod frames;
pub mod health;
#[cfg(feature = "learn")]
pub mod learn;
#[cfg(not(feature = "learn"))]
#[path = "learn_absent.rs"]
mod learn;
mod limits;
mod linearised;
pub mod live;
pub mod method;
mod movement;
mod noise;
pub mod one_step;
#[cfg(feature = "plan")]
pub mod plan;
#[cfg(any(feature = "first-scene", feature = "learn"))]
mod press_watch;
mod pressure;
mod progress;
#[cfg(feature = "complex")]
pub mod reactive;
pub mod reconstruct;
#[cfg(feature = "recording")]
pub mod recording;
pub mod scene;
pub mod sequence;
#[cfg(feature = "fabric")]
pub mod simulate;
mod skin;
mod stop;
mod synthetic_touch;
pub mod text;
pub mod total_variation;
pub mod touches;
#[cfg(feature = "base")]
pub mod train;
pub mod twins;
mod weave;

// re-exported so that a robot's program needs no further dependency
#[cfg(feature = "mint")]
#[cfg_attr(docsrs, doc(cfg(feature = "mint")))]
pub use eit_inverse::mint;
pub use eit_inverse::touch::{LearntTouch, Touch, TouchState};
pub use {eit_denoise, eit_fem, eit_hw, eit_inverse, eit_mesh, ndarray};

pub use error::SkinError;
pub use fitted::FittedFrames;
pub use limits::{check_images, check_pixel_jacobian, rounding_warning};
pub use linearised::LinearisedSkin;
pub use live::{
    LiveModel, LiveObserver, LiveStream, Next, Sensor, SkinState, TouchFields, TouchFrame,
};
pub use movement::WithoutMovement;
pub use pressure::{MeanPressure, Pressures};
pub use progress::{Observer, Progress, Silent, StageTime, Steps};
pub use reconstruct::{ImageSolver, Images, Reconstruction};
pub use scene::Scene;
pub use skin::{MeshOverride, Skin, SkinModel};
pub use stop::StopFlag;
pub use weave::{FoundWeave, Weave};

/// Compiles the program of the guide.
#[cfg(all(doctest, feature = "hw"))]
#[doc = include_str!("../../../docs/BUILD_A_SKIN.md")]
struct Guide;
