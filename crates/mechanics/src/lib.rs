//! Constrained mechanics: index-3 and index-2 problems, the methods that step them, and events.

pub mod alpha;
pub mod events;
pub mod index2;
pub mod problem;
pub mod rattle;
pub mod run;
pub mod semi_explicit;
pub mod spark;
