//! Methods that fit their Hamiltonians, and their steppers.

use super::magnus::fitting;
use super::method::{Method, PROCESSOR_ERROR, turns};
use crate::method::{
    Chebyshev, Doubled, Driven, DrivenSeries, Lanczos, Magnus, MagnusSteps, MagnusTolerance, Nodes,
    Phases, Processed, Processor, ShearProgram, Shears, Sweeper, TermBounds, Wave, Windows,
};
use crate::problem::Hamiltonian;
use liouville_base::cancel::CancelToken;
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::run::StartError;
use liouville_base::simd::Stored;
use liouville_base::tableau::{Purpose, Stable, Turn};
use std::sync::Arc;

/// The norm of a kernel without its processor may grow so many times; where it is not stable it grows without end.
const KERNEL_NORM: f64 = 100.0;

/// A method that fits its Hamiltonian.
pub(super) enum Prepared {
    Shears {
        program: Vec<Flow>,
        shift: f64,
        tolerance: f64,
    },
    Chebyshev {
        bounds: (f64, f64),
        rate: f64,
        tolerance: f64,
        windows: Windows,
    },
    Processed {
        program: Vec<Flow>,
        processor: Processor,
        shift: f64,
        tolerance: f64,
    },
    Magnus {
        nodes: Nodes,
        exponential: ShearProgram,
        bounds: TermBounds,
    },
    MagnusSeries {
        nodes: Nodes,
        rate: f64,
        tolerance: f64,
        bounds: TermBounds,
    },
    /// For single wave functions only.
    Single(Single),
}

pub(super) enum Single {
    Lanczos {
        dimension: usize,
        rate: f64,
        tolerance: f64,
    },
    Driven {
        driven: Driven,
        times: Vec<f64>,
    },
    MagnusSteps {
        nodes: Nodes,
        tolerance: MagnusTolerance,
        bounds: TermBounds,
        breaks: Vec<f64>,
    },
    Splitting {
        program: Vec<Flow>,
        phases: Box<Phases>,
    },
}

impl Prepared {
    /// The method for this Hamiltonian, and outputs at these times; shears back in time are undone, last to first.
    pub(super) fn new(
        method: Method,
        hamiltonian: &Arc<Hamiltonian>,
        times: Vec<f64>,
        is_back: bool,
    ) -> Result<Self, StartError> {
        let is_plain = hamiltonian.nonlinearity().is_none() && hamiltonian.absorber().is_empty();
        if !is_plain && !matches!(method, Method::Splitting { .. }) {
            return Err(StartError::invalid(
                "a method for a linear equation that keeps the norm",
            ));
        }
        Ok(match method {
            Method::Shears {
                coefficients,
                shift,
                tolerance,
            } => Self::Shears {
                program: shears(&coefficients, is_back),
                shift,
                tolerance,
            },
            Method::Chebyshev {
                bounds,
                rate,
                tolerance,
                windows,
            } => {
                let unfit = || StartError::invalid("windows have all outputs, each at least one");
                Self::Chebyshev {
                    bounds,
                    rate,
                    tolerance,
                    windows: Windows::new(times, windows).ok_or_else(unfit)?,
                }
            }
            Method::Lanczos {
                dimension,
                rate,
                tolerance,
            } => Self::Single(Single::Lanczos {
                dimension,
                rate,
                tolerance,
            }),
            Method::Processed {
                order,
                stages,
                shift,
                theta,
                tolerance,
            } => {
                let stable = Stable::find(Purpose::Stability, order, stages).ok_or_else(|| {
                    StartError::invalid("there is no such method for the longest stable steps")
                })?;
                let too_long = || {
                    StartError::invalid("a step so near to the limit of stability has no processor")
                };
                Self::Processed {
                    program: shears(&stable.coefficients, is_back),
                    processor: Processor::new(stable, theta, PROCESSOR_ERROR)
                        .ok_or_else(too_long)?,
                    shift,
                    tolerance,
                }
            }
            Method::Magnus { .. } | Method::MagnusSeries { .. } | Method::MagnusSteps { .. } => {
                Self::magnus(method, hamiltonian, is_back)?
            }
            Method::Driven(driven) => {
                let bounds = fitting(driven.bounds, hamiltonian)?;
                let driven = Driven { bounds, ..driven };
                Self::Single(Single::Driven { driven, times })
            }
            Method::Splitting { name, tolerance } => {
                let phases = Phases::new(hamiltonian.clone(), tolerance);
                let no_grid = || StartError::invalid("H is no kinetic energy and a potential");
                Self::Single(Single::Splitting {
                    program: turns(&name)?.into_iter().map(flow).collect(),
                    phases: phases.ok_or_else(no_grid)?.into(),
                })
            }
        })
    }

    /// The most states of which a stepper has memory.
    pub(super) fn states(&self) -> usize {
        match self {
            Self::Chebyshev { windows, .. } => windows.most(),
            _ => 1,
        }
    }

    /// The part of all energies that is left out of H.
    pub(super) fn shift(&self) -> f64 {
        match self {
            Self::Shears { shift, .. } | Self::Processed { shift, .. } => *shift,
            _ => 0.0,
        }
    }

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
            Self::Single(Single::Splitting { program, phases }) => {
                let phases = phases.as_ref().clone().with_cancel(cancel);
                Box::new(Composed::following(phases, program.clone()))
            }
            Self::Single(Single::Driven { driven, times }) => {
                let sweeper = sweeper.with_cancel(cancel);
                match DrivenSeries::new(&sweeper, driven.clone(), times.clone()) {
                    Some(series) => Box::new(series),
                    None => unreachable!("parts that have been checked"),
                }
            }
            Self::Single(Single::MagnusSteps {
                nodes,
                tolerance,
                bounds,
                breaks,
            }) => {
                let (nodes, bounds) = (nodes.clone(), bounds.clone());
                let sweeper = sweeper.with_cancel(cancel);
                match MagnusSteps::new(sweeper, nodes, bounds, *tolerance) {
                    Some(steps) => Box::new(steps?.with_breaks(breaks.clone())),
                    None => unreachable!("bounds that have been checked"),
                }
            }
            Self::Single(Single::Lanczos {
                dimension,
                rate,
                tolerance,
            }) => Box::new(Lanczos::new(
                sweeper.with_cancel(cancel),
                *dimension,
                *rate,
                *tolerance,
            )),
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
            Self::Single(_) => unreachable!("a method for single wave functions"),
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

/// Shears of q and p in turn; back in time they are undone, last to first.
pub(super) fn shears(coefficients: &[f64], is_back: bool) -> Vec<Flow> {
    let shear = |(k, weight): (usize, &f64)| Flow {
        part: k % 2,
        is_adjoint: false,
        weight: *weight,
        offset: 0.0,
    };
    let mut program: Vec<Flow> = coefficients.iter().enumerate().map(shear).collect();
    if is_back {
        program.reverse();
    }
    program
}

fn flow(turn: Turn) -> Flow {
    Flow {
        part: usize::from(turn.is_kick),
        is_adjoint: false,
        weight: turn.weight,
        offset: turn.offset,
    }
}
