//! Events: zeros of functions within steps, of which the exact value takes a part of the step.

mod function;
mod interpolant;
mod search;
mod step;
mod substep;
mod substep_detector;

pub use function::{EventRule, WatchedFunction};
pub use search::{FunctionInStep, InterpolationAccuracy};
pub use step::{Crossing, Search, is_met_at, met_at_end, same_time};
pub use substep::Substep;
pub use substep_detector::SubstepDetector;

/// Samples of an event's function in a step.
pub const SAMPLES: usize = 8;
/// Relative changes of a state that may be nothing but roundoff.
pub const NOISE: f64 = 256.0 * f64::EPSILON;
