//! Matrices as the steppers need them: small and dense, sparsity patterns, and their factorisations.
//!
//! Everything is sized once and then overwritten; nothing a step calls allocates.

mod assembly;
mod blocks;
pub mod choice;
mod dependent;
mod factor;
mod fill;
mod kernels;
mod lu;
mod matrix;
mod members;
mod node_block;
mod node_gram;
mod pattern;
mod product;
mod rows;
mod sparse;
mod tridiagonal;

pub use assembly::Assembly;
pub use blocks::{BlockPlan, Blocks};
pub(crate) use choice::prefers_sparse;
pub use dependent::{IndependentRows, dependencies, dependent_rows, independent_rows};
pub use factor::Factor;
pub use kernels::{
    add_compensated, add_scaled, all_finite, as_is, combine, combine_rows, copy, copy_scaled, dot,
    furthest, max_norm, scale_each, sum_compensated,
};
pub use lu::{Lu, Singular, inverse};
pub use matrix::Matrix;
pub use members::SparseOf;
pub use node_gram::{GramPlan, NodeGram};
pub use pattern::{Pattern, PatternError};
pub use product::Product;
pub use rows::Rows;
pub use sparse::Sparse;
pub(crate) use sparse::inverse_power;
pub use tridiagonal::Tridiagonal;
