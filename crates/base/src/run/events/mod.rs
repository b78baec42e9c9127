//! Events: zeros of functions within steps, of which the exact value takes a part of the step.

mod function;
mod partial;
mod parts;
mod search;
mod step;
mod trail;

pub use function::{EventRule, WatchedFunction};
pub use partial::PartialStep;
pub use parts::PartDetector;
pub use search::{Scene, Trust};
pub use step::{Crossing, Search};

/// Samples of an event's function in a step.
pub const SAMPLES: usize = 8;
/// Relative changes of a state that may be nothing but roundoff.
pub const NOISE: f64 = 256.0 * f64::EPSILON;
