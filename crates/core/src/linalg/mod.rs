//! Matrices as the steppers need them: small and dense, sparsity patterns, and their factorisations.
//!
//! Everything is sized once and then overwritten; nothing a step calls allocates.

mod assembly;
mod elimination;
mod factor;
mod gram;
mod kernels;
mod matrix;
mod pattern;
mod rows;
mod sparse;
mod tridiagonal;

pub use assembly::Assembly;
pub use factor::{Factor, Lu, Singular, dependencies, dependent_rows};
pub use gram::Gram;
pub use kernels::{add_scaled, carry, combine, copy, copy_scaled, dot, gather, max_norm};
pub use matrix::Matrix;
pub use pattern::{Pattern, PatternError};
pub use rows::Rows;
pub use sparse::Sparse;
pub use tridiagonal::Tridiagonal;
