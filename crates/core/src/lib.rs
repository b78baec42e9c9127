//! The numerical core of liouville: structure-preserving time integrators.
//!
//! The path, walked once: a model arrives as [`tape::Tape`]s, which make a read-only
//! [`problem`]; a [`method`] steps it; a [`run::Run`] is the one loop, and records.
//!
//! Floors, lowest first; a module uses only floors below its own:
//!
//! 0. `real`, `trouble`
//! 1. `linalg`
//! 2. `tape`, `tableau`
//! 3. `newton`
//! 4. `problem`
//! 5. `method`
//! 6. `run`
//! 7. `ensemble`

pub mod elementary;
pub mod ensemble;
pub mod linalg;
pub mod method;
pub mod newton;
pub mod problem;
pub mod real;
pub mod run;
pub mod tableau;
pub mod tape;
pub mod trouble;
pub mod vector;
