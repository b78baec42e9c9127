//! Coefficients, computed from their definitions; long sums in double-double arithmetic, rounded once.

mod alpha;
mod collocation;
mod spark;

pub use alpha::Alpha;
pub use spark::GaussLobatto;
