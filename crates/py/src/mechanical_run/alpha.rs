//! The extended HHT-α method and its relatives.

use super::Begin;
use super::control::{Control, refused};
use super::launch::{launch, launch_controlled};
use crate::errors;
use crate::second_order::SecondOrder;
use liouville_base::tableau;
use liouville_base::tape::Tape;
use liouville_mechanics::alpha::{Alpha, Reactions};
use liouville_mechanics::problem::{Observer, SecondOrderModel};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Coefficients and reactions of such a method, as Python says them.
pub(crate) fn read(method: &Bound<'_, PyAny>) -> PyResult<(tableau::Alpha, Reactions)> {
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
    Ok((weights, reactions))
}

pub(super) fn alpha<'py>(
    py: Python<'py>,
    problem: &SecondOrder,
    method: &Bound<'_, PyAny>,
    observer: Tape,
    begin: &Begin<'_>,
) -> PyResult<Bound<'py, PyAny>> {
    let (weights, reactions) = read(method)?;
    let n = problem.0.mechanical.n;
    begin.check(n, problem.0.mechanical.stage.inputs()[3], &observer, 3)?;
    begin.control.check(n)?;
    let tolerance = match &begin.control {
        Control::Fixed => None,
        Control::Error { tolerance, .. } => Some(tolerance.clone()),
        Control::Reversible { .. } => return Err(refused("reversible")),
    };
    let (t0, t1, ..) = begin.span;
    let model = SecondOrderModel::new(problem.0.clone(), begin.params);
    let general = model.general.clone();
    let observer = Observer::new(general, begin.params, observer, begin.states);
    let mut stepper = Alpha::new(model, weights, reactions, tolerance);
    let (y, z, a) = (begin.start[0], begin.start[1], begin.start.get(2).copied());
    let state = match stepper.start(t0, y, z, a) {
        Ok(state) => state,
        Err(error) => return Ok(errors::error(py, &error)?.into_any()),
    };
    match begin.control {
        Control::Error { first, least, .. } => {
            let first = if first > 0.0 {
                first
            } else {
                stepper.first_step(&state, t1 - t0)
            };
            launch_controlled(py, begin, stepper, observer, state, (first, least))
        }
        _ => launch(py, begin, stepper, observer, state),
    }
}
