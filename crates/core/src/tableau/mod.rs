//! Coefficients, computed from their definitions in double-double arithmetic and rounded once.

mod collocation;
mod spark;

pub use spark::GaussLobatto;
