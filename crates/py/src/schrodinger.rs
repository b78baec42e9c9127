//! Jobs of Schrödinger equations: a method, wave functions and observables in, a run out.

use crate::caught::{Caught, attending};
use crate::convert::Values;
use crate::derivative::WaveRecord;
use crate::errors::refused;
use crate::operator::Hamiltonian;
use liouville_base::run::{Advance, StartError};
use liouville_waves::method::{
    Driven, DrivenCost, Eigenpairs, MagnusTolerance, Observable, ShearProgram, SplitTolerance,
    TermBounds, Windows,
};
use liouville_waves::run::{self, Method};
use numpy::{Complex64, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

/// A method, by the attributes of its dataclass; `norm_tol` is how far the norm may be off.
#[derive(FromPyObject)]
enum WaveMethod<'py> {
    Shears {
        coefficients: Values<'py>,
        shift: f64,
        norm_tol: f64,
    },
    Chebyshev {
        bounds: (f64, f64),
        rate: f64,
        norm_tol: f64,
        windows: Vec<usize>,
    },
    Diagonal {
        energies: Values<'py>,
        real: Values<'py>,
        imaginary: Values<'py>,
        norm_tol: f64,
    },
    Lanczos {
        dimension: usize,
        rate: f64,
        norm_tol: f64,
    },
    Processed {
        order: usize,
        stages: usize,
        shift: f64,
        theta: f64,
        norm_tol: f64,
    },
    Magnus {
        scheme: (usize, usize),
        coefficients: Values<'py>,
        theta: f64,
        norm_tol: f64,
        parts: Parts,
    },
    MagnusSteps {
        scheme: (usize, usize),
        rate: f64,
        tol: f64,
        norm_tol: f64,
        parts: Parts,
        breaks: Vec<f64>,
    },
    MagnusSeries {
        scheme: (usize, usize),
        rate: f64,
        norm_tol: f64,
        parts: Parts,
    },
    Driven(DrivenMethod),
    SplitSteps(SplitMethod),
    Splitting {
        scheme: String,
        norm_tol: f64,
    },
}

/// A split operator to a tolerance.
#[derive(FromPyObject)]
pub(crate) struct SplitMethod {
    scheme: String,
    order: usize,
    rate: f64,
    beta: f64,
    first: f64,
    longest: f64,
    breaks: Vec<f64>,
    norm_tol: f64,
}

impl SplitMethod {
    fn read(self, hamiltonian: &Hamiltonian) -> PyResult<Method> {
        let tolerance = SplitTolerance {
            order: self.order,
            rate: self.rate,
            beta: self.beta,
            first: self.first,
            longest: self.longest,
            breaks: self.breaks,
        };
        let (norm, tolerance) = (self.norm_tol, Some(tolerance));
        let found = Method::splitting(&self.scheme, &hamiltonian.inner, norm, tolerance);
        found.map_err(refused)
    }
}

/// Series in time for H(t).
#[derive(FromPyObject)]
pub(crate) struct DrivenMethod {
    parts: Parts,
    breaks: Vec<f64>,
    rate: f64,
    norm_tol: f64,
    by_differences: bool,
}

impl DrivenMethod {
    pub(crate) fn read(self) -> Driven {
        Driven {
            bounds: term_bounds(self.parts),
            by_differences: self.by_differences,
            breaks: self.breaks,
            rate: self.rate,
            tolerance: self.norm_tol,
        }
    }
}

/// An interval of energies.
type Bounds = (f64, f64);

/// The parts of H(t): how many terms each has, bounds of each and of H, a grid of weights with bounds at its corners, and
/// start, end, knots and outputs of the run.
type Parts = (
    Vec<usize>,
    Vec<Bounds>,
    Option<Bounds>,
    Vec<Vec<f64>>,
    Vec<Bounds>,
    (f64, f64, Vec<f64>, Vec<f64>),
);

fn term_bounds((groups, parts, given, axes, corners, run): Parts) -> TermBounds {
    let (start, end, knots, outputs) = run;
    TermBounds {
        groups,
        parts,
        given,
        axes,
        corners,
        span: (start, end),
        knots,
        outputs,
    }
}

/// Energies, and eigenvectors as rows of real and imaginary parts.
fn eigenpairs(parts: [Values<'_>; 3]) -> PyResult<Eigenpairs> {
    let [energies, real, imaginary] = parts.map(|part| part.as_slice().map(<[f64]>::to_vec));
    let levels = Eigenpairs::new(energies?, real?, imaginary?);
    levels.ok_or_else(|| refused("each level has an energy and a vector as long"))
}

impl WaveMethod<'_> {
    /// The method, for runs of this Hamiltonian.
    fn read(self, hamiltonian: &Hamiltonian) -> PyResult<Method> {
        let found = match self {
            Self::Shears {
                coefficients,
                shift,
                norm_tol: tolerance,
            } => Method::Shears {
                program: run::shears(coefficients.as_slice()?),
                shift,
                tolerance,
            },
            Self::Chebyshev {
                bounds,
                rate,
                norm_tol: tolerance,
                windows,
            } => Method::Chebyshev {
                bounds,
                rate,
                tolerance,
                windows: Windows::new(windows),
            },
            Self::Diagonal {
                energies,
                real,
                imaginary,
                norm_tol: tolerance,
            } => Method::Diagonal {
                levels: Arc::new(eigenpairs([energies, real, imaginary])?),
                tolerance,
            },
            Self::Lanczos {
                dimension,
                rate,
                norm_tol: tolerance,
            } => Method::Lanczos {
                dimension,
                rate,
                tolerance,
            },
            Self::Processed {
                order,
                stages,
                shift,
                theta,
                norm_tol,
            } => Method::processed((order, stages), shift, theta, norm_tol).map_err(refused)?,
            Self::Magnus {
                scheme,
                coefficients,
                theta,
                norm_tol: tolerance,
                parts,
            } => Method::Magnus {
                nodes: run::nodes(scheme).map_err(refused)?,
                exponential: ShearProgram {
                    program: run::shears(coefficients.as_slice()?),
                    theta,
                    tolerance,
                },
                bounds: term_bounds(parts),
            },
            Self::MagnusSteps {
                scheme,
                rate,
                tol: whole,
                norm_tol: norm,
                parts,
                breaks,
            } => Method::MagnusSteps {
                nodes: run::nodes(scheme).map_err(refused)?,
                tolerance: MagnusTolerance { rate, whole, norm },
                bounds: term_bounds(parts),
                breaks,
            },
            Self::MagnusSeries {
                scheme,
                rate,
                norm_tol: tolerance,
                parts,
            } => Method::MagnusSeries {
                nodes: run::nodes(scheme).map_err(refused)?,
                rate,
                tolerance,
                bounds: term_bounds(parts),
            },
            Self::Driven(driven) => Method::Driven {
                driven: driven.read(),
                times: Vec::new(),
            },
            Self::SplitSteps(method) => method.read(hamiltonian)?,
            Self::Splitting { scheme, norm_tol } => {
                Method::splitting(&scheme, &hamiltonian.inner, norm_tol, None).map_err(refused)?
            }
        };
        Ok(found)
    }
}

/// Observables are tuples: ("diagonal", values), ("symmetric", Hamiltonian), ("overlap", q, p) or ("start",),
/// the overlap with the state at the start.
fn observable(observable: &Bound<'_, PyTuple>) -> PyResult<Observable> {
    let kind: String = observable.get_item(0)?.extract()?;
    let rest = observable.get_slice(1, observable.len());
    match kind.as_str() {
        "diagonal" => {
            let (values,): (Values<'_>,) = rest.extract()?;
            Ok(Observable::Diagonal(values.as_slice()?.to_vec()))
        }
        "symmetric" => {
            let (operator,): (PyRef<'_, Hamiltonian>,) = rest.extract()?;
            Ok(Observable::Symmetric(operator.inner.clone()))
        }
        "start" => Ok(Observable::Start),
        "overlap" => {
            let (q, p): (Values<'_>, Values<'_>) = rest.extract()?;
            let (q, p) = (q.as_slice()?.to_vec(), p.as_slice()?.to_vec());
            Ok(Observable::Overlap(q, p))
        }
        other => Err(refused(format!("there is no observable {other:?}"))),
    }
}

/// A job, by the attributes of its dataclass: `start` has the rows of wave functions, `span` is the start and (time,
/// steps to it) of each state that is recorded.
#[derive(FromPyObject)]
struct WaveJob<'py> {
    start: (PyReadonlyArray2<'py, Complex64>,),
    span: (f64, Vec<(f64, usize)>),
    observer: Vec<Bound<'py, PyTuple>>,
    states: bool,
    threads: usize,
    is_ensemble: bool,
    records: Vec<PyRef<'py, WaveRecord>>,
}

/// Real and imaginary parts of rows.
fn parts(psi: &PyReadonlyArray2<'_, Complex64>) -> PyResult<[Vec<f64>; 2]> {
    let values = psi.as_slice()?;
    let real = values.iter().map(|z| z.re).collect();
    Ok([real, values.iter().map(|z| z.im).collect()])
}

impl WaveJob<'_> {
    fn read(self) -> PyResult<run::Job> {
        let psi = &self.start.0;
        let (t0, stops) = self.span;
        let observables = self.observer.iter().map(observable);
        Ok(run::Job {
            psi: parts(psi)?,
            members: self.is_ensemble.then(|| psi.shape()[0]),
            n: psi.shape()[1],
            t0,
            stops,
            observables: observables.collect::<PyResult<_>>()?,
            states: self.states,
            recorders: (self.records.iter())
                .map(|record| record.0.clone())
                .collect(),
            threads: self.threads,
        })
    }
}

type Started = Result<Box<dyn Advance>, StartError>;

/// A run of a Schrödinger equation, and where exceptions that Python raises inside its steps wait.
pub(crate) fn start(
    py: Python<'_>,
    hamiltonian: &Hamiltonian,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
) -> PyResult<(Started, Vec<Caught>)> {
    let method = method.extract::<WaveMethod<'_>>()?.read(hamiltonian)?;
    let job = job.extract::<WaveJob<'_>>()?.read()?;
    let (signals, mut caught) = (Caught::default(), hamiltonian.caught.clone());
    let (inner, cancel) = (hamiltonian.inner.clone(), signals.cancel_step());
    let run = attending(py, || run::start(inner, method, job, cancel))?;
    caught.push(signals);
    Ok((run, caught))
}

/// A member of an ensemble of Schrödinger equations: its Hamiltonian, method and job.
pub(crate) type Member<'py> = (
    PyRef<'py, Hamiltonian>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
);

/// Runs of Schrödinger equations, each by a method of its own, and where exceptions raised inside their steps wait.
pub(crate) fn start_each(
    py: Python<'_>,
    members: &[Member<'_>],
    threads: usize,
) -> PyResult<(Started, Vec<Caught>)> {
    let (mut runs, mut caught) = (Vec::new(), Vec::new());
    for (hamiltonian, method, job) in members {
        let method = method.extract::<WaveMethod<'_>>()?.read(hamiltonian)?;
        let job = job.extract::<WaveJob<'_>>()?.read()?;
        caught.extend(hamiltonian.caught.iter().cloned());
        runs.push((hamiltonian.inner.clone(), method, job));
    }
    let run = attending(py, || run::start_each(runs, threads))?;
    Ok((run, caught))
}

/// The products that a processor takes, or none if it takes too many.
#[pyfunction]
pub(crate) fn processor_degree(order: usize, stages: usize, theta: f64) -> Option<usize> {
    run::processor_degree(order, stages, theta)
}

/// The degree of the Chebyshev series of e^{−iθx} on [−1, 1] that leaves out at most `tolerance`.
#[pyfunction]
pub(crate) fn chebyshev_degree(theta: f64, tolerance: f64) -> usize {
    run::chebyshev_degree(theta, tolerance)
}

/// The windows of series in time from `t` to `end`, in powers and in Bessel functions, their products, and the longest
/// window in units of 1/β, and errors beyond the tolerance that roundings may add up to.
#[pyfunction]
pub(crate) fn driven_cost(
    py: Python<'_>,
    hamiltonian: PyRef<'_, Hamiltonian>,
    method: DrivenMethod,
    t: f64,
    end: f64,
) -> PyResult<(usize, usize, usize, f64, f64)> {
    let (driven, hamiltonian) = (method.read(), hamiltonian.inner.clone());
    let cost = attending(py, || driven.cost(&hamiltonian, (t, end)))?;
    let cost = cost.ok_or_else(|| refused("parts are all terms, each with its bounds"))?;
    let cost = cost.map_err(refused)?;
    let DrivenCost {
        powers,
        bessel,
        products,
        theta,
        beyond,
    } = cost;
    Ok((powers, bessel, products, theta, beyond))
}

/// The steps of a Magnus method from each time to the next, their products, at most as far as estimates hold, the longest
/// step in units of 1/β, and whether steps were counted in parts of the run alone.
#[pyfunction]
pub(crate) fn magnus_cost(
    py: Python<'_>,
    hamiltonian: PyRef<'_, Hamiltonian>,
    method: &Bound<'_, PyAny>,
    times: Vec<f64>,
) -> PyResult<(f64, f64, f64, bool)> {
    let method = method.extract::<WaveMethod<'_>>()?.read(&hamiltonian)?;
    let hamiltonian = hamiltonian.inner.clone();
    let cost = attending(py, || run::magnus_cost(&hamiltonian, method, &times))?;
    let cost = cost.map_err(refused)?;
    Ok((cost.steps, cost.products, cost.theta, cost.is_sampled))
}

/// The flows of a splitting of T + V: whether a kick, its weight, and the weights of the drifts before it.
#[pyfunction]
pub(crate) fn split_program(name: &str) -> PyResult<Vec<(bool, f64, f64)>> {
    let turns = run::turns(name).map_err(refused)?.into_iter();
    Ok(turns
        .map(|turn| (turn.is_kick, turn.weight, turn.offset))
        .collect())
}

/// The first step of a split operator to a tolerance from a state, the flows of T that it took to find it, and where these
/// lead; so many flows are made or more, up to the end.
#[pyfunction]
pub(crate) fn split_pilot(
    py: Python<'_>,
    hamiltonian: PyRef<'_, Hamiltonian>,
    method: SplitMethod,
    interval: (f64, f64),
    flows: usize,
    psi: PyReadonlyArray2<'_, Complex64>,
) -> PyResult<(f64, usize, f64)> {
    let (method, psi) = (method.read(&hamiltonian)?, parts(&psi)?);
    attending(py, || method.pilot(interval, flows, psi))?.map_err(refused)
}
