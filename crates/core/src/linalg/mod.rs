//! Matrices as the steppers need them: small and dense, a sparsity pattern, and two factorisations.
//!
//! Everything is sized once and then overwritten; nothing a step calls allocates.

mod assembly;
mod factor;
mod kernels;
mod matrix;
mod pattern;

pub use assembly::Assembly;
pub use factor::{Factor, Lu, Singular, dependent_rows};
pub use kernels::{add_scaled, combine, copy, copy_scaled, dot, max_norm};
pub use matrix::Matrix;
pub use pattern::{Pattern, PatternError};
