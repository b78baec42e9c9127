//! Methods for Schrödinger equations, as tuples.

use liouville_base::composition::{Composed, Flow};
use liouville_base::method::Stepper;
use liouville_base::simd::Stored;
use liouville_base::tableau::{Purpose, Stable, Turn, split_program};
use liouville_waves::method::{
    Chebyshev, Magnus, Nodes, Phases, Processed, Processor, ShearProgram, Shears, Sweeper, Wave,
    bessel,
};
use liouville_waves::problem::Hamiltonian;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

/// To this the processor of a kernel is exact.
const PROCESSED: f64 = 1e-13;

/// The norm of what a kernel steps may be so many times larger; it grows without end where it is not stable.
const KERNEL: f64 = 100.0;

/// A method and its numbers.
pub(super) enum Method {
    /// One that steps any number of wave functions at once.
    Lockstep(Lockstep),
    /// One that steps a single wave function.
    Alone(Alone),
}

pub(super) enum Lockstep {
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
}

pub(super) enum Alone {
    Phases {
        program: Vec<Flow>,
        phases: Box<Phases>,
    },
    Lanczos {
        dimension: usize,
        rate: f64,
        tolerance: f64,
    },
}

impl Method {
    /// Methods are tuples, their kind first:
    ///
    ///     ("shears", coefficients of q and p in turn, shift, how far the norm may be off)
    ///     ("chebyshev", bounds of the spectrum, error allowed in a unit of time, how far the norm may be off,
    ///      whether H acts on real and imaginary part one after the other)
    ///     ("lanczos", dimension, error allowed in a unit of time, how far the norm may be off)
    ///     ("processed", order, stages, shift, half the width of the spectrum times a step, how far the norm
    ///      may be off)
    ///     ("magnus", order, coefficients of q and p in turn, half the width of the spectrum times a step of
    ///      them at most, how far the norm may be off, bounds of the spectra of all terms)
    ///     ("phases", name of a splitting, how far the norm may be off)
    pub(super) fn of(
        method: &Bound<'_, PyTuple>,
        hamiltonian: &Arc<Hamiltonian>,
        is_back: bool,
    ) -> PyResult<Self> {
        let kind: String = method.get_item(0)?.extract()?;
        let rest = method.get_slice(1, method.len());
        match kind.as_str() {
            "shears" => {
                let (coefficients, shift, tolerance): (PyReadonlyArray1<'_, f64>, f64, f64) =
                    rest.extract()?;
                Ok(Self::Lockstep(Lockstep::Shears {
                    program: shears(coefficients.as_slice()?, is_back),
                    shift,
                    tolerance,
                }))
            }
            "chebyshev" => {
                let (bounds, rate, tolerance, is_doubled) = rest.extract()?;
                Ok(Self::Lockstep(Lockstep::Chebyshev {
                    bounds,
                    rate,
                    tolerance,
                    is_doubled,
                }))
            }
            "lanczos" => {
                let (dimension, rate, tolerance) = rest.extract()?;
                Ok(Self::Alone(Alone::Lanczos {
                    dimension,
                    rate,
                    tolerance,
                }))
            }
            "processed" => processed(&rest, is_back).map(Self::Lockstep),
            "magnus" => magnus(&rest, is_back).map(Self::Lockstep),
            "phases" => {
                let (name, tolerance): (String, f64) = rest.extract()?;
                let no_grid = || PyValueError::new_err("H is no kinetic energy and a potential");
                let phases = Phases::new(hamiltonian.clone(), tolerance).ok_or_else(no_grid)?;
                Ok(Self::Alone(Alone::Phases {
                    program: turns(&name)?.into_iter().map(flow).collect(),
                    phases: Box::new(phases),
                }))
            }
            other => Err(PyValueError::new_err(format!(
                "there is no method {other:?}"
            ))),
        }
    }
}

impl Method {
    /// What is taken from the energies at all times.
    pub(super) fn shift(&self) -> f64 {
        match self {
            Self::Lockstep(Lockstep::Shears { shift, .. } | Lockstep::Processed { shift, .. }) => {
                *shift
            }
            _ => 0.0,
        }
    }
}

impl Lockstep {
    /// The method at work, on as many wave functions as `S` has members.
    pub(super) fn stepper<S: Stored>(
        &self,
        sweeper: Sweeper<S>,
    ) -> Box<dyn Stepper<State = Wave<S>> + Sync> {
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
            } => {
                let series = Chebyshev::new(sweeper, *bounds, *rate, *tolerance);
                Box::new(if *is_doubled {
                    series.hermitian()
                } else {
                    series
                })
            }
            Self::Processed {
                program,
                processor,
                shift,
                tolerance,
            } => {
                // between the processor and its inverse the norm is another one
                let kernel = Shears::new(sweeper, *shift, KERNEL);
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
        }
    }
}

fn processed(method: &Bound<'_, PyTuple>, is_back: bool) -> PyResult<Lockstep> {
    let (order, stages, shift, largest, tolerance) = method.extract()?;
    let unknown = || PyValueError::new_err("there is no such method for the longest stable steps");
    let method = Stable::find(Purpose::Stability, order, stages).ok_or_else(unknown)?;
    let too_long =
        || PyValueError::new_err("a step so near to the limit of stability has no processor");
    let processor = Processor::new(method, largest, PROCESSED).ok_or_else(too_long)?;
    Ok(Lockstep::Processed {
        program: shears(&method.coefficients, is_back),
        processor,
        shift,
        tolerance,
    })
}

fn magnus(method: &Bound<'_, PyTuple>, is_back: bool) -> PyResult<Lockstep> {
    let (order, coefficients, theta, tolerance, bounds): (
        usize,
        PyReadonlyArray1<'_, f64>,
        f64,
        f64,
        Vec<(f64, f64)>,
    ) = method.extract()?;
    Ok(Lockstep::Magnus {
        nodes: if order == 2 {
            Nodes::midpoint()
        } else {
            Nodes::gauss()
        },
        exponential: ShearProgram {
            program: shears(coefficients.as_slice()?, is_back),
            theta,
            tolerance,
        },
        bounds,
    })
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

fn turns(name: &str) -> PyResult<Vec<Turn>> {
    let unknown = || PyValueError::new_err(format!("there is no splitting {name:?}"));
    split_program(name).ok_or_else(unknown)
}

/// The products that a processor takes, or none if it takes too many.
#[pyfunction]
pub(crate) fn processor_degree(order: usize, stages: usize, largest: f64) -> Option<usize> {
    let method = Stable::find(Purpose::Stability, order, stages)?;
    Processor::new(method, largest, PROCESSED).map(|processor| processor.degree())
}

/// The degree of the Chebyshev series of e^{−iθx} on [−1, 1] that leaves out at most `tolerance`.
#[pyfunction]
pub(crate) fn chebyshev_degree(theta: f64, tolerance: f64) -> usize {
    bessel::series(theta, tolerance).len() - 1
}

/// The flows of a splitting of T + V: whether a kick, its weight, and the weights of the drifts before it.
#[pyfunction(name = "split_program")]
pub(crate) fn split_program_of(name: &str) -> PyResult<Vec<(bool, f64, f64)>> {
    let turns = turns(name)?.into_iter();
    Ok(turns
        .map(|turn| (turn.is_kick, turn.weight, turn.offset))
        .collect())
}
