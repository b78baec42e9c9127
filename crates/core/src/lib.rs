//! The numerical core of liouville: structure-preserving time integrators.
//!
//! The path, walked once: a model arrives as [`tape::Tape`]s, which make a read-only
//! [`problem`]; a [`method`] steps it; a [`run::Run`] is the one loop, and records.
//!
//! Floors, lowest first; a module uses only floors below its own:
//!
//! 0. `bracket`, `elementary`, `parallel`, `patience`, `trouble`
//! 1. `real`
//! 2. `memory`, `vector`
//! 3. `dual`, `linalg`
//! 4. `tape`, `tableau`
//! 5. `newton`
//! 6. `problem`
//! 7. `method`
//! 8. `run`
//! 9. `ensemble`

pub mod bracket;
pub mod dual;
pub mod elementary;
pub mod ensemble;
pub mod linalg;
pub mod memory;
pub mod method;
pub mod newton;
pub mod parallel;
pub mod patience;
pub mod problem;
pub mod real;
pub mod run;
pub mod tableau;
pub mod tape;
pub mod trouble;
pub mod vector;
