//! The steppers of methods for Schrödinger equations.

use super::method::Method;
use crate::method::{
    Arnoldi, Chebyshev, Diagonal, Doubled, DrivenSeries, Lanczos, Magnus, MagnusSteps, Processed,
    Shears, SplitSteps, Sweeper, Wave,
};
use liouville_base::cancel::CancelToken;
use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::simd::Stored;

/// The norm of a kernel without its processor may grow so many times; where it is not stable it grows without end.
const KERNEL_NORM: f64 = 100.0;

impl Method {
    /// A stepper of one wave function.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn single(
        &self,
        sweeper: Sweeper<f64>,
        cancel: CancelToken,
    ) -> Result<Box<dyn Stepper<State = Wave<f64>>>, StepError> {
        Ok(match self {
            Self::Splitting {
                program,
                phases,
                tolerance,
                begun,
            } => {
                let phases = phases.as_ref().clone().with_cancel(cancel);
                let program = program.clone();
                match tolerance.clone() {
                    Some(tolerance) => {
                        let steps = SplitSteps::new(phases, program, tolerance)?;
                        Box::new(steps.after(begun.clone()))
                    }
                    None => Box::new(Composed::following(phases, program)),
                }
            }
            Self::Driven { driven, times } => {
                let sweeper = sweeper.with_cancel(cancel);
                match DrivenSeries::new(&sweeper, driven.clone(), times.clone()) {
                    Some(series) => Box::new(series?),
                    None => unreachable!("parts that have been checked"),
                }
            }
            Self::MagnusSteps {
                nodes,
                tolerance,
                bounds,
                breaks,
            } => {
                let (nodes, bounds) = (nodes.clone(), bounds.clone());
                let sweeper = sweeper.with_cancel(cancel);
                match MagnusSteps::new(sweeper, nodes, bounds, *tolerance) {
                    Some(steps) => Box::new(steps?.with_breaks(breaks.clone())),
                    None => unreachable!("bounds that have been checked"),
                }
            }
            Self::Diagonal { levels, tolerance } => {
                Box::new(Diagonal::new(levels.clone(), *tolerance))
            }
            Self::Lanczos {
                dimension,
                rate,
                tolerance,
            } => {
                let sweeper = sweeper.with_cancel(cancel);
                if sweeper.hamiltonian().absorber().is_empty() {
                    Box::new(Lanczos::new(sweeper, *dimension, *rate, *tolerance))
                } else {
                    Box::new(Arnoldi::new(sweeper, *dimension, *rate, *tolerance))
                }
            }
            _ => self.lockstep(sweeper.with_cancel(cancel)),
        })
    }

    /// A stepper of as many wave functions as `S` has members.
    ///
    /// # Panics
    /// When the method is for single ones only.
    pub(super) fn lockstep<S: Stored>(
        &self,
        sweeper: Sweeper<S>,
    ) -> Box<dyn Stepper<State = Wave<S>>> {
        match self {
            Self::Shears {
                program,
                shift,
                tolerance,
            } => {
                let at = places(&sweeper);
                let shears = Shears::new(sweeper, *shift, *tolerance);
                of_halves(Composed::following(shears, program.clone()), at)
            }
            Self::Chebyshev {
                bounds,
                rate,
                tolerance,
                windows,
            } => {
                let series = Chebyshev::new(sweeper, *bounds, *rate, *tolerance);
                Box::new(series.with_windows(windows.clone()))
            }
            Self::Processed {
                program,
                processor,
                shift,
                tolerance,
            } => {
                // between the processor and its inverse the norm is another one
                let at = places(&sweeper);
                let kernel = Shears::new(sweeper, *shift, KERNEL_NORM);
                let kernel = Composed::following(kernel, program.clone());
                of_halves(Processed::new(kernel, processor.clone(), *tolerance), at)
            }
            Self::Magnus {
                nodes,
                exponential,
                bounds,
            } => {
                let at = places(&sweeper);
                let (nodes, bounds) = (nodes.clone(), bounds.clone());
                of_halves(Magnus::new(sweeper, nodes, exponential.clone(), bounds), at)
            }
            Self::MagnusSeries {
                nodes,
                rate,
                tolerance,
                bounds,
            } => {
                let (nodes, bounds) = (nodes.clone(), bounds.clone());
                Box::new(Magnus::by_series(
                    sweeper,
                    nodes,
                    (*rate, *tolerance),
                    bounds,
                ))
            }
            _ => unreachable!("a method for single wave functions"),
        }
    }
}

/// Places of a wave function where they are half of the rows of H.
fn places<S: Stored>(sweeper: &Sweeper<S>) -> Option<usize> {
    let hamiltonian = sweeper.hamiltonian();
    (hamiltonian.is_doubled()).then(|| hamiltonian.places())
}

/// A stepper for real H, of the two halves that a complex one takes.
fn of_halves<S: Stored>(
    stepper: impl Stepper<State = Wave<S>> + 'static,
    places: Option<usize>,
) -> Box<dyn Stepper<State = Wave<S>>> {
    match places {
        Some(n) => Box::new(Doubled::new(Box::new(stepper), n)),
        None => Box::new(stepper),
    }
}
