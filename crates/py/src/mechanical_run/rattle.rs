//! RATTLE, alone or composed.

use super::Begin;
use super::launch::launch_symmetric;
use crate::errors;
use crate::second_order::Separable;
use crate::tableau::scheme_of;
use liouville_base::composition::Composed;
use liouville_base::tape::Tape;
use liouville_mechanics::problem::{Observer, SeparableModel};
use liouville_mechanics::rattle::Rattle;
use pyo3::prelude::*;

pub(super) fn rattle<'py>(
    py: Python<'py>,
    problem: &Separable,
    method: &Bound<'_, PyAny>,
    observer: Tape,
    begin: &Begin<'_>,
) -> PyResult<Bound<'py, PyAny>> {
    let general = &problem.0.mechanical;
    begin.check(general.n, general.stage.inputs()[3], &observer, 2)?;
    let mut model = SeparableModel::new(problem.0.clone(), begin.params);
    let observer = Observer::new(model.general.clone(), begin.params, observer, begin.states);
    let state = model
        .general
        .state(begin.span.0, begin.start[0], begin.start[1]);
    let stepper = match Rattle::new(model) {
        Ok(stepper) => stepper,
        Err(error) => return Ok(errors::error(py, &error)?.into_any()),
    };
    let Some(scheme) = scheme_of(method)? else {
        return launch_symmetric(py, begin, stepper, observer, state);
    };
    let stepper = Composed::of_symmetric(stepper, scheme).map_err(errors::refused)?;
    launch_symmetric(py, begin, stepper, observer, state)
}
