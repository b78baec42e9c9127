//! Polynomial vector fields without divergence, stepped by volume-preserving splitting.

pub mod problem;
pub mod run;
pub mod volume;
