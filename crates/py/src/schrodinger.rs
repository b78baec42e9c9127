//! Schrödinger equations: a Hamiltonian, a method and wave functions in, runs out.

use crate::caught::Caught;
use crate::operator::Hamiltonian;
use crate::run::Run;
use liouville_core::ensemble::{Ensemble, Layout};
use liouville_core::method::schrodinger::{Observable, Observer, Shears, Sweeper, Wave};
use liouville_core::method::{Composed, Flow, Stepper};
use liouville_core::patience::Patience;
use liouville_core::problem::quantum;
use liouville_core::real::{Lanes, WIDTH};
use liouville_core::run::{self, Advance, Listed};
use liouville_core::trouble::Trouble;
use liouville_core::vector::Stored;
use numpy::{Complex64, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

type Values<'py> = PyReadonlyArray1<'py, f64>;

/// A method and its numbers.
#[derive(Clone)]
enum Method {
    /// A list of shears.
    Shears {
        program: Vec<Flow>,
        shift: f64,
        tolerance: f64,
    },
}

/// Methods are tuples, their kind first:
///
///     ("shears", coefficients of q and p in turn, shift, how far the norm may be off)
fn method_of(method: &Bound<'_, PyTuple>) -> PyResult<Method> {
    let kind: String = method.get_item(0)?.extract()?;
    let rest = method.get_slice(1, method.len());
    match kind.as_str() {
        "shears" => {
            let (coefficients, shift, tolerance): (Values<'_>, f64, f64) = rest.extract()?;
            Ok(Method::Shears {
                program: program_of(coefficients.as_slice()?),
                shift,
                tolerance,
            })
        }
        other => Err(PyValueError::new_err(format!(
            "there is no method {other:?}"
        ))),
    }
}

/// Shears of q and p in turn.
fn program_of(coefficients: &[f64]) -> Vec<Flow> {
    let shear = |(k, weight): (usize, &f64)| Flow {
        part: k % 2,
        is_adjoint: false,
        weight: *weight,
        offset: 0.0,
    };
    coefficients.iter().enumerate().map(shear).collect()
}

/// Observables are tuples: ("diagonal", values), ("symmetric", Hamiltonian) or ("overlap", q, p).
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
    hamiltonian: Arc<quantum::Hamiltonian>,
    method: Method,
    observables: Vec<Observable>,
    states: bool,
    t0: f64,
    stops: Vec<(f64, usize)>,
}

type Member = (Box<dyn Advance + Sync>, usize);

impl Begin {
    /// A run of these wave functions in lock-step.
    fn run<S: Stored>(
        &self,
        threads: usize,
        patience: Patience,
        psi: &[&[Complex64]],
    ) -> Result<Box<dyn Advance + Sync>, Trouble> {
        let sweeper = Sweeper::<S>::new(self.hamiltonian.clone())
            .with_threads(threads)
            .with_patience(patience);
        match self.method.clone() {
            Method::Shears {
                program,
                shift,
                tolerance,
            } => {
                let shears = Shears::new(sweeper, shift, tolerance);
                self.started(Composed::following(shears, program), psi)
            }
        }
    }

    fn started<S: Stored, M>(
        &self,
        stepper: M,
        psi: &[&[Complex64]],
    ) -> Result<Box<dyn Advance + Sync>, Trouble>
    where
        M: Stepper<State = Wave<S>> + Sync + 'static,
    {
        let observer = Observer::new(psi.len(), self.states, self.observables.clone());
        let pace = Listed::new(self.t0, self.stops.clone());
        let (state, records) = (side_by_side(psi), self.stops.len() + 1);
        let run = run::Run::new(stepper, observer, state, pace, 1, records)?;
        Ok(Box::new(run))
    }

    /// Runs of several wave functions each.
    fn blocks<S: Stored>(&self, psi: &[&[Complex64]]) -> Result<Vec<Member>, Trouble> {
        let blocks = psi.chunks(S::MEMBERS).enumerate();
        let member = |(place, block): (usize, &[&[Complex64]])| {
            let run = self.run::<S>(1, Patience::default(), block);
            let run = run.map_err(|trouble| trouble.of_member(place * S::MEMBERS))?;
            Ok((run, block.len()))
        };
        blocks.map(member).collect()
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
/// and imaginary parts in turn, then the norm and the observables. Returns the run, or the trouble of starting.
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
    let begin = Begin {
        hamiltonian: hamiltonian.inner.clone(),
        method: method_of(&method)?,
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
        let run = begin.run::<f64>(threads, signals.patience(), &rows[..1]);
        caught.push(signals);
        return Run::caught(py, run, &[width], caught);
    }
    let runs = if begin.hamiltonian.reach().is_some() && rows.len() > 1 {
        begin.blocks::<Lanes<WIDTH>>(&rows)
    } else {
        begin.blocks::<f64>(&rows)
    };
    let ensemble = runs.map(|runs| {
        let ensemble = Ensemble::new(runs, threads, Layout::Together);
        Box::new(ensemble) as Box<dyn Advance + Sync>
    });
    Run::caught(py, ensemble, &[rows.len(), width], caught)
}
