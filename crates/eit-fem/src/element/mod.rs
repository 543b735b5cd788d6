//! Finite elements: scaled gradients and stiffness of linear and quadratic triangles.
//!
//! The energy of an element with `n` nodes vanishes only for constants, so it is a sum of `n - 1`
//! squares. The terms that are squared form the scaled gradient of the nodal values `u`:
//!
//! ```text
//! g_c = sum over i <= c of a_ci (u_(i+1) - u_0),   c = 0 .. n - 2
//! ```
//!
//! An element of conductivity `sigma` contributes `sigma g(u) . g(w)` to the energy, and its
//! Jacobian entry is `-g(u) . g(w)`. Assembly and Jacobian both use these `n (n - 1) / 2`
//! coefficients, on flat and curved skins.
//!
//! **Linear**: 3 nodes and 3 coefficients. In the plane of the triangle, let `e1 = p1 - p0` lie on
//! the first axis, `l = |e1|`, and `e2 = p2 - p0 = (c, h)`. The gradient of the nodal values `u`,
//! times the square root of the area `A = l h / 2`, is
//!
//! ```text
//! g = sqrt(A) grad u = ( alpha (u1 - u0),  beta (u2 - u0) - gamma (u1 - u0) )
//! alpha = sqrt(A) / l,   beta = sqrt(A) / h,   gamma = sqrt(A) c / (h l)
//! ```
//!
//! (See any finite element text, for example Hughes, The Finite Element Method, section 3.)
//!
//! **Quadratic**: 6 nodes and 15 coefficients; see [`quadratic`].

pub(crate) mod gradient;
pub(crate) mod linear;
pub(crate) mod midside_nodes;
mod order;
pub(crate) mod quadratic;

pub use order::ElementOrder;
