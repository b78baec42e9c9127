//! The numerical core of liouville: structure-preserving time integrators.
//!
//! The path, walked once: a model arrives as [`tape::Tape`]s, which make a read-only
//! [`problem`]; a [`method`] steps it; a [`run::Run`] is the one loop, and records.
//!
//! Floors, lowest first; a module uses only floors below its own:
//!
//! 0. `real`, `linalg`, `tableau`, `trouble`, `tape`
//! 1. `newton`, `problem`
//! 2. `method`
//! 3. `run`

pub mod linalg;
pub mod method;
pub mod newton;
pub mod problem;
pub mod real;
pub mod run;
pub mod tableau;
pub mod tape;
pub mod trouble;
