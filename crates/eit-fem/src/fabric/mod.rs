//! Simulated fabric: frames of a touched skin, with ground truth.
//!
//! A [`TouchScript`] moves fingers over a skin. Each touch dents the stretched fabric
//! ([`Indentation`]: a membrane on a soft layer, in closed form). Pressure and strain change the
//! sheet conductivity, with hysteresis and relaxation ([`PiezoLaw`]). The dent pulls nodes and
//! electrodes towards it and changes their contact impedances, which causes the artefacts seen on
//! real skins. The fabric is uneven and drifts. It is measured by an instrument with noise, gain
//! errors, a converter and bad contacts. Every frame is a full non-linear solve on the deformed
//! mesh. `docs/FABRIC.md` in the repository describes the model, its parameters and their sources.
//!
//! With a [`LinearResponse`] ([`FabricSettings::linear`]) there are no mechanics: the conductivity
//! change has the shape of the fingers, and the voltages follow from that image alone. It serves to
//! compare reconstruction methods.
//!
//! Simulate on a finer mesh than the one used for reconstruction.
//!
//! Places are stated as seen from +z. On a curved skin each touch dents the tangent plane of its place, which holds for
//! touches much smaller than the radius of curvature; the truth's images are those seen from +z. Frames are bit-identical for any number of threads. An effect
//! whose amplitude is zero is not computed and does not change the others. The script is sampled at
//! frame times only, or four times a frame where the drives of a scan take turns, so a shorter tap may be missed, as with a
//! real instrument.
//!
//! # Example
//! ```
//! use eit_fem::fabric::{Fabric, FabricSettings, PlayCircle, SimulationSettings, TouchScript};
//! use eit_fem::PairProtocol;
//! use eit_mesh::{MeshSettings, Raster, RimElectrodes, SkinShape, generate};
//!
//! let skin = SkinShape::Disc { radius_m: 0.1 };
//! let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
//! let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.01))?;
//! let protocol = PairProtocol::default().protocol()?;
//! let fabric = Fabric::new(&mesh, &protocol, 1e-5, &[1e3; 16], &FabricSettings::default())?;
//! let mut script = TouchScript::built_in("one-finger", &PlayCircle::of(&mesh), 1)?;
//! script.frames = 30;
//! let raster = Raster::new(mesh.surface(), 32)?;
//! let made = fabric.simulate(&script, &raster, &SimulationSettings::default(), &mut |_| {})?;
//! assert_eq!(made.frames_v.dim(), (30, 208));
//! // 20 quiet frames come first
//! assert!(made.truth.touches.iter().all(|touch| touch.frame >= 20));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bessel;
mod conductivity;
mod contact;
mod fabric_model;
mod instrument;
mod library;
mod linear;
mod motion;
mod paths;
mod piezo;
mod pixels;
mod play_circle;
mod print;
mod random_field;
mod script;
mod seat;
mod settings;
mod simulate;
mod stream;
mod truth;

pub use contact::{Dent, Indentation, Tip};
pub use eit_core::Random;
pub use fabric_model::Fabric;
pub use paths::RandomPaths;
pub use piezo::PiezoLaw;
pub use play_circle::PlayCircle;
pub use script::{Finger, Interpolation, Key, Touch, TouchScript};
pub use settings::{
    Drift, FabricSettings, Instrument, LinearResponse, Membrane, Piezoresistance, Print, Rim, Weave,
};
pub use simulate::{Contact, SimulatedFrame, SimulatedSkin, SimulationSettings};
pub use truth::{Simulation, SimulationReport, TrueQuality, TrueTouch, Truth};
