//! SPARK methods, alone or composed.

use super::Begin;
use super::control::{Control, refused};
use super::launch::{launch_controlled, launch_symmetric};
use crate::convert::Mechanical;
use crate::errors;
use crate::tableau::{lobatto_named, scheme_of, spark_named};
use liouville_base::composition::Composed;
use liouville_base::newton::Stop;
use liouville_base::tableau::{self, Scheme};
use liouville_base::tape::Tape;
use liouville_mechanics::problem::{Model, Observer, State};
use liouville_mechanics::spark::{Solver, Spark};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A SPARK method as Python says it, and what it is composed by.
pub(crate) struct Asked {
    pub(crate) tableau: tableau::Spark,
    pub(crate) solver: Solver,
    /// What the stage equations are solved to.
    pub(crate) tolerance: f64,
    pub(crate) scheme: Option<&'static Scheme>,
}

impl Asked {
    pub(crate) fn read(method: &Bound<'_, PyAny>) -> PyResult<Self> {
        let scheme = scheme_of(method)?;
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
        let tolerance: Option<f64> = base.getattr("newton_tol")?.extract()?;
        let tolerance = tolerance.unwrap_or(Stop::default().tolerance);
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(PyValueError::new_err("newton_tol is between 0 and 1"));
        }
        let tableau = match base.getattr_opt("force")? {
            Some(force) => lobatto_named(stages, &force.extract::<String>()?)?,
            None => spark_named(stages, &base.getattr("points")?.extract::<String>()?)?,
        };
        if scheme.is_some() && !tableau.is_symmetric() {
            return Err(PyValueError::new_err("only a symmetric method is composed"));
        }
        Ok(Self {
            tableau,
            solver,
            tolerance,
            scheme,
        })
    }

    pub(crate) fn stepper(&self, model: Model) -> Spark {
        Spark::of(model, self.tableau.clone(), self.solver).to_tolerance(self.tolerance)
    }
}

pub(super) fn spark<'py>(
    py: Python<'py>,
    problem: &Mechanical,
    method: &Bound<'_, PyAny>,
    observer: Tape,
    begin: &Begin<'_>,
) -> PyResult<Bound<'py, PyAny>> {
    let asked = Asked::read(method)?;
    begin.check(problem.0.n, problem.0.stage.inputs()[3], &observer, 2)?;
    let mut model = Model::new(problem.0.clone(), begin.params);
    let observer = Observer::new(model.clone(), begin.params, observer, begin.states);
    let state = model.state(begin.span.0, begin.start[0], begin.start[1]);
    begin.control.check(problem.0.n)?;
    let stepper = asked.stepper(model);
    match (&begin.control, asked.scheme) {
        (Control::Error { .. }, None) => estimating(py, begin, stepper, observer, state),
        (_, None) => launch_symmetric(py, begin, stepper, observer, state),
        (_, Some(scheme)) => {
            let stepper = Composed::of_symmetric(stepper, scheme).map_err(errors::refused)?;
            launch_symmetric(py, begin, stepper, observer, state)
        }
    }
}

/// A run whose steps are controlled by their errors.
fn estimating<'py>(
    py: Python<'py>,
    begin: &Begin<'_>,
    stepper: Spark,
    observer: Observer,
    state: State,
) -> PyResult<Bound<'py, PyAny>> {
    let Control::Error {
        tolerance,
        first,
        least,
    } = &begin.control
    else {
        return Err(refused("none"));
    };
    let (t0, t1, ..) = begin.span;
    let mut stepper = stepper.estimating(tolerance.clone());
    let first = if *first > 0.0 {
        *first
    } else {
        match stepper.first_step(t0, &state, t1 - t0) {
            Ok(first) => first,
            Err(error) => return Ok(errors::error(py, &error)?.into_any()),
        }
    };
    launch_controlled(py, begin, stepper, observer, state, (first, *least))
}
