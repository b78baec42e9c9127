//! Semi-explicit systems of index 2: the problem, its runs, and z at a point.

use crate::convert::{self, Made, Recipe, item, pattern};
use crate::errors::{self, refused};
use crate::run::Run;
use crate::tableau::scheme_of;
use liouville_base::composition::Composed;
use liouville_base::method::Stepper;
use liouville_base::observe::Observe;
use liouville_base::run::{self, Fixed};
use liouville_base::tape;
use liouville_mechanics::index2::Index2;
use liouville_mechanics::semi_explicit::{self, Model, Observer, Patterns, State};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A semi-explicit system in the core's terms.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct SemiExplicit(Arc<semi_explicit::SemiExplicit>, Made);

#[pymethods]
impl SemiExplicit {
    /// Tapes and patterns by name.
    #[new]
    fn new(
        n: usize,
        l: usize,
        is_linear: bool,
        tapes: &Bound<'_, PyDict>,
        patterns: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let tape = |name: &str| -> PyResult<tape::Tape> {
            let found = item(tapes, name)?
                .extract::<PyRef<'_, convert::Tape>>()?
                .0
                .clone();
            Ok(tape::Tape::clone(&found))
        };
        let pattern = |name: &str| pattern(&item(patterns, name)?);
        let made = Made::of(tapes.py(), (n, l, is_linear, tapes, patterns))?;
        let system = semi_explicit::SemiExplicit {
            n,
            l,
            is_linear,
            field: tape("field")?,
            field_jacobian: tape("field_jacobian")?,
            constraint: tape("constraint")?,
            constraint_jacobian: tape("constraint_jacobian")?,
            hidden: tape("hidden")?,
            hidden_jacobian: tape("hidden_jacobian")?,
            patterns: Patterns {
                f_y: pattern("f_y")?,
                f_z: pattern("f_z")?,
                k_y: pattern("k_y")?,
                w_z: pattern("w_z")?,
            },
        };
        Ok(Self(Arc::new(system.checked().map_err(refused)?), made))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Recipe<'py> {
        self.1.again::<Self>(py)
    }

    /// The z that the hidden constraint gives at (t, y), from a guess, or the error of finding it.
    fn unknowns<'py>(
        &self,
        py: Python<'py>,
        t: f64,
        y: PyReadonlyArray1<'py, f64>,
        z: PyReadonlyArray1<'py, f64>,
        params: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (y, z, params) = (y.as_slice()?, z.as_slice()?, params.as_slice()?);
        self.check(y, z, params)?;
        match Model::new(self.0.clone(), params).state(t, y, z, 1.0) {
            Ok(state) => Ok(PyArray1::from_vec(py, state.z).into_any()),
            Err(error) => Ok(errors::error(py, &error)?.into_any()),
        }
    }
}

impl SemiExplicit {
    fn check(&self, y: &[f64], z: &[f64], params: &[f64]) -> PyResult<()> {
        let (n, l, sizes) = (self.0.n, self.0.l, self.0.field.inputs());
        if y.len() == n && z.len() == l && Some(&params.len()) == sizes.last() {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "y has size {n}, z has size {l}, params has size {:?}",
            sizes.last()
        )))
    }
}

/// A run about to start; `method` is read by attribute, `start` is y and a guess of z, `span` is
/// (t0, t1, steps, every). Returns the run, or the error of starting.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (problem, method, observer, params, start, span, states))]
pub(crate) fn semi_explicit_run<'py>(
    py: Python<'py>,
    problem: &SemiExplicit,
    method: &Bound<'py, PyAny>,
    observer: &convert::Tape,
    params: PyReadonlyArray1<'py, f64>,
    start: (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    span: (f64, f64, usize, usize),
    states: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let scheme = scheme_of(method)?;
    let base = match scheme {
        Some(_) => &method.getattr("base")?,
        None => method,
    };
    let stages: usize = base.getattr("stages")?.extract()?;
    let params = params.as_slice()?;
    let (y, z) = (start.0.as_slice()?, start.1.as_slice()?);
    problem.check(y, z, params)?;
    let sizes = [1, y.len(), z.len(), params.len()];
    let (t0, t1, steps, every) = span;
    if stages == 0 || steps == 0 || every == 0 || observer.0.inputs() != sizes {
        return Err(PyValueError::new_err(format!(
            "a method has a stage, a run has a step, and its observer takes {sizes:?}"
        )));
    }
    let mut model = Model::new(problem.0.clone(), params);
    let h = (t1 - t0) / steps as f64;
    let state = match model.state(t0, y, z, h) {
        Ok(state) => state,
        Err(error) => return Ok(errors::error(py, &error)?.into_any()),
    };
    let observer = Observer::new(params, tape::Tape::clone(&observer.0), states);
    let stepper = Index2::new(model, stages);
    let control = (Fixed::new(t0, h, steps), steps, every);
    match scheme {
        Some(scheme) => {
            let stepper = Composed::of_symmetric(stepper, scheme).map_err(refused)?;
            launch(py, stepper, observer, state, control)
        }
        None => launch(py, stepper, observer, state, control),
    }
}

fn launch<S>(
    py: Python<'_>,
    stepper: S,
    observer: Observer,
    state: State,
    (control, steps, every): (Fixed, usize, usize),
) -> PyResult<Bound<'_, PyAny>>
where
    S: Stepper<State = State> + Sync + 'static,
{
    let width = observer.width(&state);
    let run = run::Run::new(stepper, observer, state, control, every, steps / every + 2);
    Run::handed(py, run, &[width])
}
