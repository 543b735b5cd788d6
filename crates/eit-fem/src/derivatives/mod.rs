//! Derivatives of the voltages with respect to contacts, node positions and electrodes.
//!
//! The discrete model is `A x = b` with currents `b` that no parameter changes. A measurement is
//! `factor x_g . A x_f` with the fields `f`, `g` of its product ([`crate::protocol`]), so for every
//! parameter `p` of the matrix
//!
//! ```text
//! dV/dp = -factor x_g . (dA/dp) x_f
//! ```
//!
//! exactly, and the fields that the Jacobian with respect to conductivity solves for serve all of
//! them: no further solve. What differs is `dA/dp`: [`contact`] (one number per electrode),
//! [`movement`] (strain of triangles, stretch of electrode parts). [`electrode_motion`] says how
//! nodes move when an electrode does.

pub(crate) mod conductivity;
pub(crate) mod contact;
pub(crate) mod displacement;
mod electrode_motion;
pub(crate) mod movement;
pub(crate) mod solved_fields;

pub use conductivity::JacobianValue;
pub use displacement::Displacement;
pub use electrode_motion::ElectrodeMotion;
