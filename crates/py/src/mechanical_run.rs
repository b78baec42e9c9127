//! Runs of mechanical systems: a problem, a method and start values become a stepper in the loop.

use crate::convert::{self, Mechanical};
use crate::errors::{self, refused};
use crate::run::Run;
use crate::second_order::SecondOrder;
use crate::tableau::scheme_named;
use liouville_core::method::alpha::{Alpha, Reactions, Tolerance};
use liouville_core::method::composition::Composed;
use liouville_core::method::spark::{Solver, Spark};
use liouville_core::problem::Observe;
use liouville_core::problem::mechanical::{Model, Observer, SecondOrderModel};
use liouville_core::run::{self, Controlled, Equal};
use liouville_core::tableau;
use liouville_core::tape::Tape;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// What every run begins with.
struct Begin<'a> {
    params: &'a [f64],
    start: &'a [&'a [f64]],
    span: (f64, f64, usize, usize),
    states: bool,
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
/// ones, is (rtol, atol, first step or 0, least step). Returns the run, or the trouble of starting.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (problem, method, observer, params, start, span, control, states))]
pub(crate) fn mechanical_run<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyAny>,
    method: &Bound<'py, PyAny>,
    observer: &convert::Tape,
    params: PyReadonlyArray1<'py, f64>,
    start: Vec<PyReadonlyArray1<'py, f64>>,
    span: (f64, f64, usize, usize),
    control: Option<(f64, PyReadonlyArray1<'py, f64>, f64, f64)>,
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
    };
    if let Ok(problem) = problem.extract::<PyRef<'_, SecondOrder>>() {
        let control = control
            .as_ref()
            .map(|(rtol, atol, h, least)| PyResult::Ok((*rtol, atol.as_slice()?, *h, *least)))
            .transpose()?;
        alpha(py, &problem, method, observer, &begin, control)
    } else {
        let problem = problem.extract::<PyRef<'_, Mechanical>>()?;
        spark(py, &problem, method, observer, &begin)
    }
}

fn spark<'py>(
    py: Python<'py>,
    problem: &Mechanical,
    method: &Bound<'_, PyAny>,
    observer: Tape,
    begin: &Begin<'_>,
) -> PyResult<Bound<'py, PyAny>> {
    let scheme = match method.getattr_opt("scheme")? {
        Some(name) => Some(scheme_named(&name.extract::<String>()?)?),
        None => None,
    };
    let base = match scheme {
        Some(_) => &method.getattr("base")?,
        None => method,
    };
    let stages: usize = base.getattr("stages")?.extract()?;
    let solver: String = base.getattr("solver")?.extract()?;
    let solver = match solver.as_str() {
        "auto" => Solver::Auto,
        "node-schur" => Solver::NodeSchur,
        "newton" => Solver::Newton,
        other => {
            return Err(PyValueError::new_err(format!(
                "there is no solver {other:?}"
            )));
        }
    };
    if stages == 0 {
        return Err(PyValueError::new_err(
            "a SPARK method has at least one stage",
        ));
    }
    begin.check(problem.0.n, problem.0.stage.inputs()[3], &observer, 2)?;
    let (t0, t1, steps, every) = begin.span;
    let mut model = Model::new(problem.0.clone(), begin.params);
    let observer = Observer::new(model.clone(), begin.params, observer, begin.states);
    let state = model.state(t0, begin.start[0], begin.start[1]);
    let width = observer.width(&state);
    let pace = Equal::new(t0, (t1 - t0) / steps as f64, steps);
    let expected = steps / every + 2;
    let stepper = Spark::new(model, stages, solver);
    if let Some(scheme) = scheme {
        let stepper = Composed::of_symmetric(stepper, scheme).map_err(refused)?;
        let run = run::Run::new(stepper, observer, state, pace, every, expected);
        return Run::handed(py, run, &[width]);
    }
    let run = run::Run::new(stepper, observer, state, pace, every, expected);
    Run::handed(py, run, &[width])
}

fn alpha<'py>(
    py: Python<'py>,
    problem: &SecondOrder,
    method: &Bound<'_, PyAny>,
    observer: Tape,
    begin: &Begin<'_>,
    control: Option<(f64, &[f64], f64, f64)>,
) -> PyResult<Bound<'py, PyAny>> {
    let (alpha_m, alpha_f, gamma, beta) = method.getattr("coefficients")?.extract()?;
    let weights = tableau::Alpha {
        alpha_m,
        alpha_f,
        gamma,
        beta,
    };
    let reaction: String = method.getattr("reaction")?.extract()?;
    let reactions = match reaction.as_str() {
        "position" => Reactions::Position,
        "extended" | "predicted" => Reactions::Extended {
            b: method.getattr("b")?.extract()?,
            predicted: reaction == "predicted",
        },
        other => {
            return Err(PyValueError::new_err(format!(
                "there is no reaction {other:?}"
            )));
        }
    };
    let n = problem.0.mechanical.n;
    begin.check(n, problem.0.mechanical.stage.inputs()[3], &observer, 3)?;
    let tolerance = control.map(|(rtol, atol, ..)| Tolerance {
        rtol,
        atol: atol.to_vec(),
    });
    if tolerance.as_ref().is_some_and(|x| x.atol.len() != n) {
        return Err(PyValueError::new_err(format!("atol has size {n}")));
    }
    let (t0, t1, steps, every) = begin.span;
    let model = SecondOrderModel::new(problem.0.clone(), begin.params);
    let general = model.general.clone();
    let observer = Observer::new(general, begin.params, observer, begin.states);
    let mut stepper = Alpha::new(model, weights, reactions, tolerance);
    let (y, z, a) = (begin.start[0], begin.start[1], begin.start.get(2).copied());
    let state = match stepper.start(t0, y, z, a) {
        Ok(state) => state,
        Err(trouble) => return Ok(errors::trouble(py, &trouble)?.into_any()),
    };
    let width = observer.width(&state);
    if let Some((_, _, first, least)) = control {
        let first = if first > 0.0 {
            first
        } else {
            stepper.first_step(&state, t1 - t0)
        };
        let pace = Controlled::new(t0, t1, first, least);
        let run = run::Run::new(stepper, observer, state, pace, every, 0);
        Run::handed(py, run, &[width])
    } else {
        let pace = Equal::new(t0, (t1 - t0) / steps as f64, steps);
        let expected = steps / every + 2;
        let run = run::Run::new(stepper, observer, state, pace, every, expected);
        Run::handed(py, run, &[width])
    }
}
