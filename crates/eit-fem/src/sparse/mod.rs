//! Repeated factorisation of sparse symmetric matrices with the same pattern.
//!
//! This module is independent of finite elements. It has graphs, fill-reducing elimination orders,
//! and the factorisation itself, in memory that the caller owns.
//!
//! | file | content |
//! |---|---|
//! | `graph` | adjacency lists |
//! | `pattern` | [`Pattern`]: sparsity pattern of a symmetric matrix |
//! | `elimination_tree` | parents, column counts, postorder |
//! | `ordering` | minimum degree and nested dissection |
//! | `cholesky` | [`Cholesky`]: multifrontal factorisation, right-hand sides in the last unknowns |
//! | `ldl` | `L D L^T` in any precision (`real`) |
//! | `arithmetic` | real and complex numbers in planes of `f64` |
//!
//! ```
//! use eit_fem::sparse::Cholesky;
//! use eit_fem::{ForwardModel, PairProtocol};
//! use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
//!
//! let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
//! let skin = SkinShape::Disc { radius_m: 0.1 };
//! let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.02))?;
//! let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;
//! let matrix = model.system_matrix(&vec![1e-5; model.elements()])?;
//!
//! let cholesky = Cholesky::new(&matrix.pattern, matrix.nodes)?;
//! let mut factor = cholesky.memory()?;
//! cholesky.factorise(&matrix.values, &mut factor, 1.0)?;
//! // one ampere into electrode 1 and out of the grounded last one: potentials of all unknowns
//! let mut potentials_v = vec![0.0; matrix.pattern.unknowns()];
//! potentials_v[matrix.nodes] = 1.0;
//! cholesky.solve(&mut factor, &mut potentials_v, 1)?;
//! assert!(potentials_v.iter().all(|u| *u > 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub(crate) mod arithmetic;
mod cholesky;
mod elimination_tree;
mod error;
pub(crate) mod graph;
pub(crate) mod ldl;
pub(crate) mod ordering;
mod pattern;
pub(crate) mod real;
mod scalar;

pub use cholesky::{Cholesky, Factor};
pub use error::SparseError;
pub use pattern::Pattern;
pub use scalar::Scalar;
