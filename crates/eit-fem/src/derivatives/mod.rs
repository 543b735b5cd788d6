//! Derivatives of the voltages with respect to conductivity, contact impedances and node positions.
//!
//! The discrete model is `A x = b`, where the currents `b` do not depend on any parameter. A
//! measurement is `factor x_g . A x_f`, with the fields `f` and `g` of its product
//! ([`crate::protocol`]). So for every parameter `p` of the matrix
//!
//! ```text
//! dV/dp = -factor x_g . (dA/dp) x_f
//! ```
//!
//! exactly. All derivatives use the fields that the Jacobian with respect to conductivity needs and
//! require no further solve. Only `dA/dp` differs: [`contact`] has one number per electrode,
//! [`movement`] the strain of triangles and the stretch of electrode parts. [`electrode_motion`]
//! computes how nodes move when an electrode does.

pub(crate) mod anisotropy;
pub(crate) mod conductivity;
pub(crate) mod contact;
pub(crate) mod displacement;
mod electrode_motion;
pub(crate) mod movement;
mod places;
pub(crate) mod solved_fields;

pub use conductivity::JacobianValue;
pub use displacement::Displacement;
pub use electrode_motion::ElectrodeMotion;
