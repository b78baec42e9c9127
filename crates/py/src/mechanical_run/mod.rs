//! Runs of mechanical systems: a problem, a method and start values become a stepper in the loop.

pub(crate) mod alpha;
mod control;
mod launch;
mod rattle;
pub(crate) mod spark;

use crate::convert::{self, Mechanical};
use crate::second_order::{SecondOrder, Separable};
use crate::watch::{Asked, Watching};
use control::Control;
use liouville_base::tape::Tape;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// What every run begins with.
struct Begin<'a> {
    params: &'a [f64],
    start: &'a [&'a [f64]],
    span: (f64, f64, usize, usize),
    control: Control,
    states: bool,
    watch: Option<Watching>,
}

impl Begin<'_> {
    /// Refuses arrays that are not of the problem's sizes, and runs of no steps.
    fn check(&self, n: usize, params: usize, observer: &Tape, most: usize) -> PyResult<()> {
        let (_, _, steps, every) = self.span;
        let fits = steps > 0
            && every > 0
            && (2..=most).contains(&self.start.len())
            && self.start.iter().all(|x| x.len() == n)
            && observer.inputs() == [1, n, n, params]
            && self.params.len() == params;
        if fits {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "a start has 2 to {most} arrays of size {n}, params has size {params}"
        )))
    }
}

/// A run about to start; `method` is read by attribute, `start` is (y, z) or (y, z, a).
///
/// `span` is (t0, t1, steps, every); `control` is None for equal steps, else ("error", rtol, atol,
/// first step or 0, least step) or ("reversible", first step, least step, monitor or None), the
/// monitor being a tape with whether it wants z'; `watch` is what else is looked at. Returns the run,
/// or the error of starting.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (problem, method, observer, params, start, span, control, watch, states))]
pub(crate) fn mechanical_run<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyAny>,
    method: &Bound<'py, PyAny>,
    observer: &convert::Tape,
    params: PyReadonlyArray1<'py, f64>,
    start: Vec<PyReadonlyArray1<'py, f64>>,
    span: (f64, f64, usize, usize),
    control: Option<Bound<'py, PyTuple>>,
    watch: Option<Asked<'py>>,
    states: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let start = start
        .iter()
        .map(|x| x.as_slice())
        .collect::<Result<Vec<_>, _>>()?;
    let (params, observer) = (params.as_slice()?, Tape::clone(&observer.0));
    let begin = Begin {
        params,
        start: &start,
        span,
        control: Control::read(control.as_ref())?,
        states,
        watch: watch
            .as_ref()
            .map(|asked| Watching::read(asked, params))
            .transpose()?,
    };
    if let Ok(problem) = problem.extract::<PyRef<'_, SecondOrder>>() {
        alpha::alpha(py, &problem, method, observer, &begin)
    } else if let Ok(problem) = problem.extract::<PyRef<'_, Separable>>() {
        rattle::rattle(py, &problem, method, observer, &begin)
    } else {
        let problem = problem.extract::<PyRef<'_, Mechanical>>()?;
        spark::spark(py, &problem, method, observer, &begin)
    }
}
