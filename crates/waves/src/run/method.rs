//! Methods for Schrödinger equations, by their numbers.

use crate::method::{Driven, MagnusTolerance, Processor, TermBounds, bessel};
use liouville_base::run::StartError;
use liouville_base::tableau::{Purpose, Stable, Turn, split_program};

/// Error of a processor, relative to the state.
pub(super) const PROCESSOR_ERROR: f64 = 1e-13;

/// A method and its numbers; `tolerance` is how far the norm may be off, relatively.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Shears of q and p in turn.
    Shears {
        /// Their coefficients.
        coefficients: Vec<f64>,
        /// The middle of the spectrum.
        shift: f64,
        /// Of the norm.
        tolerance: f64,
    },
    /// A Chebyshev series for each step.
    Chebyshev {
        /// Bounds of the spectrum.
        bounds: (f64, f64),
        /// Error allowed in a unit of time.
        rate: f64,
        /// Of the norm.
        tolerance: f64,
        /// How many outputs each series makes.
        windows: Vec<usize>,
    },
    /// A Krylov space for each step.
    Lanczos {
        /// Its dimension.
        dimension: usize,
        /// Error allowed in a unit of time.
        rate: f64,
        /// Of the norm.
        tolerance: f64,
    },
    /// The shears with the longest stable steps, with a processor.
    Processed {
        /// Their order.
        order: usize,
        /// Their number.
        stages: usize,
        /// The middle of the spectrum.
        shift: f64,
        /// Half the width of the spectrum times a step.
        theta: f64,
        /// Of the norm.
        tolerance: f64,
    },
    /// Exponentials of sums of H at nodes, each by shears.
    Magnus {
        /// Its order, and the number of exponentials of a step.
        scheme: (usize, usize),
        /// Coefficients of the shears.
        coefficients: Vec<f64>,
        /// Half the width of the spectrum times a step of the shears, at most.
        theta: f64,
        /// Of the norm.
        tolerance: f64,
        /// Bounds of the spectra of all parts of H.
        bounds: TermBounds,
    },
    /// The same with exponentials by Chebyshev series.
    MagnusSeries {
        /// Its order, and the number of exponentials of a step.
        scheme: (usize, usize),
        /// Error of all exponentials allowed in a unit of time.
        rate: f64,
        /// Of the norm.
        tolerance: f64,
        /// Bounds of the spectra of all parts of H.
        bounds: TermBounds,
    },
    /// The same with steps as long as a tolerance allows.
    MagnusSteps {
        /// Its order, and the number of exponentials of a step.
        scheme: (usize, usize),
        /// Its tolerance.
        tolerance: MagnusTolerance,
        /// Bounds of the spectra of all parts of H.
        bounds: TermBounds,
        /// Times at which steps end besides, in the order of the run.
        breaks: Vec<f64>,
    },
    /// Series in time for H(t).
    Driven(Driven),
    /// A splitting of T + V on a grid.
    Splitting {
        /// Its name.
        name: String,
        /// Of the norm.
        tolerance: f64,
    },
}

/// The flows of the splitting of this name.
///
/// # Errors
/// There is none.
pub fn turns(name: &str) -> Result<Vec<Turn>, StartError> {
    let unknown = || StartError::Invalid(format!("there is no splitting {name:?}"));
    split_program(name).ok_or_else(unknown)
}

/// The products that a processor takes, or none if it takes too many.
pub fn processor_degree(order: usize, stages: usize, theta: f64) -> Option<usize> {
    let method = Stable::find(Purpose::Stability, order, stages)?;
    Processor::new(method, theta, PROCESSOR_ERROR).map(|processor| processor.degree())
}

/// The degree of the Chebyshev series of e^{−iθx} on [−1, 1] that leaves out at most `tolerance`.
pub fn chebyshev_degree(theta: f64, tolerance: f64) -> usize {
    bessel::series(theta, tolerance).len() - 1
}
