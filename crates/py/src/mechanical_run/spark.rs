//! SPARK methods, alone or composed.

use super::Begin;
use super::control::{Control, refused};
use super::launch::{launch, launch_controlled, launch_reversible};
use crate::convert::Mechanical;
use crate::errors;
use crate::tableau::{gauss_of, lobatto_named, scheme_named};
use liouville_core::method::composition::Composed;
use liouville_core::method::spark::{Solver, Spark};
use liouville_core::problem::mechanical::{MechanicalMonitor, Model, Observer, TimeScale, Traced};
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
        None => gauss_of(stages)?,
    };
    begin.check(problem.0.n, problem.0.stage.inputs()[3], &observer, 2)?;
    let mut model = Model::new(problem.0.clone(), begin.params);
    let observer = Observer::new(model.clone(), begin.params, observer, begin.states);
    let state = model.state(begin.span.0, begin.start[0], begin.start[1]);
    begin.control.check(problem.0.n)?;
    let own = model.clone();
    let mut stepper = Spark::of(model, tableau, solver);
    match (&begin.control, scheme) {
        (Control::Equal, None) => launch(py, begin, stepper, observer, state),
        (Control::Equal, Some(scheme)) => {
            let stepper = Composed::of_symmetric(stepper, scheme).map_err(errors::refused)?;
            launch(py, begin, stepper, observer, state)
        }
        (
            Control::Error {
                tolerance,
                first,
                least,
            },
            None,
        ) => {
            stepper = stepper.estimating(tolerance.clone());
            let (t0, t1, ..) = begin.span;
            let first = match first {
                0.0 => stepper.first_step(t0, &state, t1 - t0),
                _ => Ok(*first),
            };
            match first {
                Ok(first) => {
                    launch_controlled(py, begin, stepper, observer, state, (first, *least))
                }
                Err(trouble) => Ok(errors::trouble(py, &trouble)?.into_any()),
            }
        }
        (Control::Error { .. }, Some(_)) => Err(refused("error")),
        (
            Control::Reversible {
                first,
                least,
                monitor,
            },
            _,
        ) => {
            let monitor = monitor_of(own, begin, monitor.as_ref(), *first);
            let steps = (*first, *least);
            match scheme {
                Some(scheme) => {
                    let stepper =
                        Composed::of_symmetric(stepper, scheme).map_err(errors::refused)?;
                    launch_reversible(py, begin, stepper, observer, state, monitor, steps)
                }
                None => launch_reversible(py, begin, stepper, observer, state, monitor, steps),
            }
        }
    }
}

/// The monitor of a run: the user's, or that of the acceleration.
fn monitor_of(
    model: Model,
    begin: &Begin<'_>,
    monitor: Option<&(Tape, bool)>,
    first: f64,
) -> MechanicalMonitor {
    let (t0, t1, ..) = begin.span;
    match monitor {
        Some((tape, of_acceleration)) => MechanicalMonitor::Traced(Box::new(Traced::new(
            model,
            begin.params,
            tape.clone(),
            *of_acceleration,
        ))),
        None => MechanicalMonitor::Own(Box::new(TimeScale::new(
            model,
            t1 - t0,
            (t0, begin.start[0], begin.start[1]),
            first,
        ))),
    }
}
