//! SPARK methods, alone or composed.

use super::Begin;
use super::launch::launch;
use crate::convert::Mechanical;
use crate::errors::refused;
use crate::tableau::{lobatto_named, scheme_named, spark_named};
use liouville_core::method::composition::Composed;
use liouville_core::method::spark::{Solver, Spark};
use liouville_core::problem::mechanical::{Model, Observer};
use liouville_core::tape::Tape;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub(super) fn spark<'py>(
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
    let tableau = match base.getattr_opt("force")? {
        Some(force) => lobatto_named(stages, &force.extract::<String>()?)?,
        None => spark_named(stages, &base.getattr("points")?.extract::<String>()?)?,
    };
    if scheme.is_some() && !tableau.is_symmetric() {
        return Err(PyValueError::new_err("only a symmetric method is composed"));
    }
    begin.check(problem.0.n, problem.0.stage.inputs()[3], &observer, 2)?;
    let mut model = Model::new(problem.0.clone(), begin.params);
    let observer = Observer::new(model.clone(), begin.params, observer, begin.states);
    let state = model.state(begin.span.0, begin.start[0], begin.start[1]);
    let stepper = Spark::of(model, tableau, solver);
    match scheme {
        Some(scheme) => {
            let stepper = Composed::of_symmetric(stepper, scheme).map_err(refused)?;
            launch(py, begin, stepper, observer, state)
        }
        None => launch(py, begin, stepper, observer, state),
    }
}
