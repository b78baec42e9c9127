//! The time-dependent Schrödinger equation: Hamiltonians, and the methods that propagate a state.

pub mod method;
pub mod problem;
pub mod run;
