//! The foundation that mechanics, fields and waves share: numbers, tapes, linear algebra, Newton's
//! method, tableaus, and the one loop.
//!
//! Floors, lowest first; a module uses only floors below its own:
//!
//! 0. `bracket`, `cancel`, `clone`, `elementary`, `error`, `parallel`
//! 1. `real`
//! 2. `checkpoint`, `simd`
//! 3. `compensated`, `linalg`, `observe`
//! 4. `tape`, `tableau`
//! 5. `newton`
//! 6. `method`
//! 7. `composition`
//! 8. `run`
//! 9. `ensemble`

pub mod bracket;
pub mod cancel;
pub mod checkpoint;
pub mod clone;
pub mod compensated;
pub mod composition;
pub mod elementary;
pub mod ensemble;
pub mod error;
pub mod linalg;
pub mod linear;
pub mod method;
pub mod newton;
mod number;
pub mod observe;
pub mod parallel;
pub mod real;
pub mod recorder;
pub mod run;
pub mod simd;
pub mod tableau;
pub mod tape;
