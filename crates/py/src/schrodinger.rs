//! Jobs of Schrödinger equations: a method, wave functions and observables in, a run out.

use crate::caught::{Caught, attending};
use crate::convert::Values;
use crate::derivative::WaveRecord;
use crate::errors::refused;
use crate::operator::Hamiltonian;
use crate::wave_method::{DrivenMethod, SplitBeginning, SplitMethod, WaveMethod};
use liouville_base::run::{Advance, StartError};
use liouville_waves::method::{DrivenCost, Observable};
use liouville_waves::run;
use numpy::{Complex64, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

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

/// The beginning of a run by a split operator to a tolerance from a state, with so many flows of T or more, up to its first
/// output.
#[pyfunction]
pub(crate) fn split_beginning(
    py: Python<'_>,
    hamiltonian: PyRef<'_, Hamiltonian>,
    method: SplitMethod,
    interval: (f64, f64),
    flows: usize,
    psi: PyReadonlyArray2<'_, Complex64>,
) -> PyResult<SplitBeginning> {
    let (method, psi) = (method.read(&hamiltonian)?, parts(&psi)?);
    let begun = attending(py, || method.begin(interval, flows, psi))?;
    begun.map(SplitBeginning).map_err(refused)
}
