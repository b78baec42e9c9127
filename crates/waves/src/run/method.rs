//! Methods for Schrödinger equations, by their numbers.

use crate::method::{
    Chebyshev, Driven, DrivenSeries, Lanczos, Magnus, Nodes, Phases, Processed, Processor,
    ShearProgram, Shears, Sweeper, Wave, Windows, bessel,
};
use crate::problem::Hamiltonian;
use liouville_base::cancel::CancelToken;
use liouville_base::composition::{Composed, Flow};
use liouville_base::method::Stepper;
use liouville_base::run::StartError;
use liouville_base::simd::Stored;
use liouville_base::tableau::{Purpose, Stable, Turn, split_program};
use std::sync::Arc;

/// Error of a processor, relative to the state.
const PROCESSOR_ERROR: f64 = 1e-13;
/// The norm of a kernel without its processor may grow so many times; where it is not stable it grows without end.
const KERNEL_NORM: f64 = 100.0;

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
        /// Whether H acts on real and imaginary parts one after the other.
        is_doubled: bool,
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
        /// 2 or 4.
        order: usize,
        /// Coefficients of the shears.
        coefficients: Vec<f64>,
        /// Half the width of the spectrum times a step of the shears, at most.
        theta: f64,
        /// Of the norm.
        tolerance: f64,
        /// Bounds of the spectra of all terms of H.
        bounds: Vec<(f64, f64)>,
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

impl Method {
    /// Whether H acts on real and imaginary parts one after the other.
    pub(super) fn is_doubled(&self) -> bool {
        match self {
            Self::Chebyshev { is_doubled, .. } => *is_doubled,
            Self::Driven(driven) => driven.is_doubled,
            _ => false,
        }
    }
}

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
        is_doubled: bool,
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
        bounds: Vec<(f64, f64)>,
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
                is_doubled,
                windows,
            } => {
                let unfit = || StartError::invalid("windows have all outputs, each at least one");
                Self::Chebyshev {
                    bounds,
                    rate,
                    tolerance,
                    is_doubled,
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
            Method::Magnus {
                order,
                coefficients,
                theta,
                tolerance,
                bounds,
            } => Self::Magnus {
                nodes: if order == 2 {
                    Nodes::midpoint()
                } else {
                    Nodes::gauss()
                },
                exponential: ShearProgram {
                    program: shears(&coefficients, is_back),
                    theta,
                    tolerance,
                },
                bounds,
            },
            Method::Driven(driven) => {
                let sweeper = Sweeper::new(hamiltonian.clone());
                if DrivenSeries::new(&sweeper, driven.clone(), times.clone()).is_none() {
                    return Err(StartError::invalid(
                        "parts are all terms, each with its bounds",
                    ));
                }
                Self::Single(Single::Driven { driven, times })
            }
            Method::Splitting { name, tolerance } => {
                let no_grid = || StartError::invalid("H is no kinetic energy and a potential");
                let phases = Phases::new(hamiltonian.clone(), tolerance).ok_or_else(no_grid)?;
                Self::Single(Single::Splitting {
                    program: turns(&name)?.into_iter().map(flow).collect(),
                    phases: Box::new(phases),
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
    pub(super) fn single(
        &self,
        sweeper: Sweeper<f64>,
        cancel: CancelToken,
    ) -> Box<dyn Stepper<State = Wave<f64>>> {
        match self {
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
        }
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
                let shears = Shears::new(sweeper, *shift, *tolerance);
                Box::new(Composed::following(shears, program.clone()))
            }
            Self::Chebyshev {
                bounds,
                rate,
                tolerance,
                is_doubled,
                windows,
            } => {
                let series = Chebyshev::new(sweeper, *bounds, *rate, *tolerance);
                let series = if *is_doubled {
                    series.hermitian()
                } else {
                    series
                };
                Box::new(series.with_windows(windows.clone()))
            }
            Self::Processed {
                program,
                processor,
                shift,
                tolerance,
            } => {
                // between the processor and its inverse the norm is another one
                let kernel = Shears::new(sweeper, *shift, KERNEL_NORM);
                let kernel = Composed::following(kernel, program.clone());
                Box::new(Processed::new(kernel, processor.clone(), *tolerance))
            }
            Self::Magnus {
                nodes,
                exponential,
                bounds,
            } => Box::new(Magnus::new(
                sweeper,
                nodes.clone(),
                exponential.clone(),
                bounds.clone(),
            )),
            Self::Single(_) => unreachable!("a method for single wave functions"),
        }
    }
}

/// Shears of q and p in turn; back in time they are undone, last to first.
fn shears(coefficients: &[f64], is_back: bool) -> Vec<Flow> {
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
