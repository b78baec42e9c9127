//! Runs of mechanical systems: a problem, a method and start values become a stepper in the loop.

mod alpha;
mod launch;
mod rattle;
mod spark;

use crate::convert::{self, Mechanical};
use crate::second_order::{SecondOrder, Separable};
use crate::watch::{Asked, Watching};
use liouville_core::tape::Tape;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// How errors control the steps: rtol, atol, the first step or 0, the least step.
type Control<'a> = (f64, &'a [f64], f64, f64);

/// What every run begins with.
struct Begin<'a> {
    params: &'a [f64],
    start: &'a [&'a [f64]],
    span: (f64, f64, usize, usize),
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
/// `span` is (t0, t1, steps, every); `control`, for steps of their own choice instead of equal
/// ones, is (rtol, atol, first step or 0, least step); `watch` is what else is looked at. Returns the
/// run, or the trouble of starting.
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
    control: Option<(f64, PyReadonlyArray1<'py, f64>, f64, f64)>,
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
        states,
        watch: watch
            .as_ref()
            .map(|asked| Watching::read(asked, params))
            .transpose()?,
    };
    if let Ok(problem) = problem.extract::<PyRef<'_, SecondOrder>>() {
        let control = control
            .as_ref()
            .map(|(rtol, atol, h, least)| PyResult::Ok((*rtol, atol.as_slice()?, *h, *least)))
            .transpose()?;
        alpha::alpha(py, &problem, method, observer, &begin, control)
    } else if let Ok(problem) = problem.extract::<PyRef<'_, Separable>>() {
        rattle::rattle(py, &problem, method, observer, &begin)
    } else {
        let problem = problem.extract::<PyRef<'_, Mechanical>>()?;
        spark::spark(py, &problem, method, observer, &begin)
    }
}
