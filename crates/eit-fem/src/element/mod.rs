//! Elements: scaled gradients and stiffness of linear and quadratic triangles.
//!
//! The energy of an element of `n` nodes vanishes for constants only: it is a sum of `n - 1` squares.
//! Its components, the scaled gradient of nodal values `u`, are
//!
//! ```text
//! g_c = sum over i <= c of a_ci (u_(i+1) - u_0),   c = 0 .. n - 2
//! ```
//!
//! so that an element of conductivity `sigma` contributes `sigma g(u) . g(w)` to the energy, and
//! `-g(u) . g(w)` is its Jacobian entry. The `n (n - 1) / 2` coefficients of an element serve
//! assembly and Jacobian, on flat and curved skins alike.
//!
//! **Linear**, 3 nodes and 3 coefficients. In the triangle's own plane let `e1 = p1 - p0` lie on the
//! first axis, `l = |e1|`, and let `e2 = p2 - p0 = (c, h)`. The gradient of nodal values `u`, times
//! the square root of the area `A = l h / 2`, is
//!
//! ```text
//! g = sqrt(A) grad u = ( alpha (u1 - u0),  beta (u2 - u0) - gamma (u1 - u0) )
//! alpha = sqrt(A) / l,   beta = sqrt(A) / h,   gamma = sqrt(A) c / (h l)
//! ```
//!
//! (Linear triangle: any finite element text, for example Hughes, The Finite Element Method, section
//! 3.) **Quadratic**, 6 nodes and 15 coefficients: [`quadratic`].

pub(crate) mod gradient;
pub(crate) mod linear;
pub(crate) mod midside_nodes;
mod order;
pub(crate) mod quadratic;

pub use order::ElementOrder;
