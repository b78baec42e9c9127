//! Schrödinger equations: a Hamiltonian, a method and wave functions in, runs out.

mod method;

pub(crate) use method::{chebyshev_degree, processor_degree, split_program_of};

use crate::caught::Caught;
use crate::operator::Hamiltonian;
use crate::run::Run;
use liouville_base::cancel::CancelToken;
use liouville_base::composition::Composed;
use liouville_base::ensemble::{Ensemble, Layout};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::real::{Lanes, WIDTH};
use liouville_base::run::{self, Advance, Listed};
use liouville_base::simd::Stored;
use liouville_waves::method::{Lanczos, Observable, Observer, Sweeper, Wave};
use method::{Alone, Lockstep, Method};
use numpy::{Complex64, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

type Values<'py> = PyReadonlyArray1<'py, f64>;

/// Observables are tuples: ("diagonal", values), ("symmetric", Hamiltonian), ("overlap", q, p) or ("start",),
/// the overlap with the state at the start.
fn observable_of(observable: &Bound<'_, PyTuple>) -> PyResult<Observable> {
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
            Ok(Observable::Overlap(
                q.as_slice()?.to_vec(),
                p.as_slice()?.to_vec(),
            ))
        }
        other => Err(PyValueError::new_err(format!(
            "there is no observable {other:?}"
        ))),
    }
}

/// What every run begins with.
struct Begin {
    hamiltonian: Arc<liouville_waves::problem::Hamiltonian>,
    method: Method,
    observables: Vec<Observable>,
    states: bool,
    t0: f64,
    stops: Vec<(f64, usize)>,
}

impl Begin {
    /// What makes products for wave functions in lock-step.
    fn sweeper<S: Stored>(&self, threads: usize, cancel: CancelToken) -> Sweeper<S> {
        Sweeper::new(self.hamiltonian.clone())
            .with_threads(threads)
            .with_cancel(cancel)
    }

    /// A run of one wave function.
    fn single(
        &self,
        threads: usize,
        cancel: CancelToken,
        psi: &[&[Complex64]],
    ) -> Result<Box<dyn Advance + Sync>, StepError> {
        match &self.method {
            Method::Lockstep(method) => {
                let sweeper = self.sweeper::<f64>(threads, cancel);
                self.started(method.stepper(sweeper), psi)
            }
            Method::Alone(method) => match method {
                Alone::Phases { program, phases } => {
                    let phases = phases.clone().with_cancel(cancel);
                    self.started(Box::new(Composed::following(phases, program.clone())), psi)
                }
                Alone::Lanczos {
                    dimension,
                    rate,
                    tolerance,
                } => {
                    let sweeper = self.sweeper(threads, cancel);
                    let lanczos = Lanczos::new(sweeper, *dimension, *rate, *tolerance);
                    self.started(Box::new(lanczos), psi)
                }
            },
        }
    }

    fn started<S: Stored>(
        &self,
        stepper: Box<dyn Stepper<State = Wave<S>> + Sync>,
        psi: &[&[Complex64]],
    ) -> Result<Box<dyn Advance + Sync>, StepError> {
        let observer = Observer::new(psi.len(), self.states, self.observables.clone());
        let control = Listed::new(self.t0, self.stops.clone());
        let state = side_by_side(psi).with_phase(self.method.shift() * self.t0);
        let records = self.stops.len() + 1;
        let run = run::Run::new(stepper, observer, state, control, 1, records)?;
        Ok(Box::new(run))
    }

    /// A run of wave functions in lock-step.
    fn block(
        &self,
        method: &Lockstep,
        psi: &[&[Complex64]],
    ) -> Result<Box<dyn Advance + Sync>, StepError> {
        let sweeper = self.sweeper::<Lanes<WIDTH>>(1, CancelToken::default());
        self.started(method.stepper(sweeper), psi)
    }

    /// All of them, which are rows of n values: in lock-step if they share a matrix by rows and are not too few.
    fn ensemble(self, psi: Vec<Complex64>, n: usize, threads: usize) -> Ensemble {
        let members = psi.len() / n;
        let is_lockstep =
            matches!(self.method, Method::Lockstep(_)) && self.hamiltonian.reach().is_some();
        let block = if is_lockstep && 2 * members >= WIDTH {
            WIDTH
        } else {
            1
        };
        let ends = self.stops.iter().map(|(t, _)| *t);
        let layout = Layout::Aligned {
            times: std::iter::once(self.t0).chain(ends).collect(),
            width: Observer::new(1, self.states, self.observables.clone()).columns(n),
        };
        let t0 = self.t0;
        let begin = move |members: &[usize]| {
            let row = |member: &usize| &psi[member * n..(member + 1) * n];
            let rows: Vec<&[Complex64]> = members.iter().map(row).collect();
            match &self.method {
                Method::Lockstep(method) if members.len() > 1 => self.block(method, &rows),
                _ => self.single(1, CancelToken::default(), &rows),
            }
        };
        Ensemble::new(Box::new(begin), (members, block), threads, layout, t0)
    }
}

/// Wave functions in lock-step; places without one follow the last.
fn side_by_side<S: Stored>(psi: &[&[Complex64]]) -> Wave<S> {
    let part = |of: fn(&Complex64) -> f64| {
        let mut values = vec![S::splat(0.0); psi[0].len()];
        for (i, value) in values.iter_mut().enumerate() {
            for member in 0..S::MEMBERS {
                value.set_member(member, of(&psi[member.min(psi.len() - 1)][i]));
            }
        }
        values
    };
    Wave::new(part(|z| z.re), part(|z| z.im))
}

/// A run about to start, of one wave function or an ensemble, which are the rows of `psi`.
///
/// `span` is the start and (time, steps to it) of each state that is kept; a record is ψ if `states`, real
/// and imaginary parts in turn, then the norm and the observables. Returns the run, or the error of starting.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (hamiltonian, method, psi, span, observables, states, threads, is_ensemble))]
pub(crate) fn schrodinger_run<'py>(
    py: Python<'py>,
    hamiltonian: PyRef<'py, Hamiltonian>,
    method: Bound<'py, PyTuple>,
    psi: PyReadonlyArray2<'py, Complex64>,
    span: (f64, Vec<(f64, usize)>),
    observables: Vec<Bound<'py, PyTuple>>,
    states: bool,
    threads: usize,
    is_ensemble: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let n = psi.shape()[1];
    let (t0, stops) = span;
    if n == 0 || psi.shape()[0] == 0 || stops.iter().any(|(_, steps)| *steps == 0) {
        return Err(PyValueError::new_err("states and steps of a run"));
    }
    let observables: Vec<Observable> = observables
        .iter()
        .map(observable_of)
        .collect::<PyResult<_>>()?;
    let is_back = stops.first().is_some_and(|(t, _)| *t < t0);
    let begin = Begin {
        hamiltonian: hamiltonian.inner.clone(),
        method: Method::of(&method, &hamiltonian.inner, is_back)?,
        observables,
        states,
        t0,
        stops,
    };
    let width = Observer::new(1, states, begin.observables.clone()).columns(n);
    let rows: Vec<&[Complex64]> = psi.as_slice()?.chunks(n).collect();
    let mut caught = hamiltonian.caught.clone();
    if !is_ensemble {
        let signals = Caught::default();
        let run = begin.single(threads, signals.cancel(), &rows[..1]);
        caught.push(signals);
        return Run::caught(py, run, &[width], caught);
    }
    let shape = [rows.len(), width];
    let ensemble = begin.ensemble(psi.as_slice()?.to_vec(), n, threads);
    Run::caught(py, Ok(Box::new(ensemble)), &shape, caught)
}
