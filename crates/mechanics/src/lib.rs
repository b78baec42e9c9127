//! Runs of constrained mechanics: a system, a method and a job become one run, which may watch for events.

pub mod events;
pub mod run;
