//! Coefficients, computed from their definitions; long sums in double-double arithmetic, rounded once.

mod alpha;
mod collocation;
pub mod composition;
mod known;
mod ladder;
mod lagrange;
mod lobatto;
mod moments;
mod radau;
mod spark;
pub mod splitting;
mod stability;

pub use alpha::Alpha;
pub use composition::Scheme;
pub use known::{Force, Key, Known};
pub use ladder::Ladder;
pub use lagrange::lagrange;
pub use moments::moments;
pub use spark::{Coefficients, Spark};
pub use splitting::{Turn, split_program};
pub use stability::{Purpose, Stable};
