//! Runs, as Python drives them: a slice of time, then a look at the signals.

use crate::convert::{self, Mechanical};
use crate::errors;
use liouville_core::method::spark::{Solver, Spark};
use liouville_core::problem::mechanical::{Model, Observer};
use liouville_core::run::{Advance, Run, Span, Status};
use liouville_core::tableau::GaussLobatto;
use liouville_core::tape::Tape;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Duration;

/// A run of a mechanical system.
#[pyclass(module = "liouville._core")]
pub(crate) struct MechanicalRun {
    run: Box<dyn Advance + Sync>,
    width: usize,
}

#[pymethods]
impl MechanicalRun {
    /// A run about to start; `method` is read by attribute, `span` is (t0, h, steps, every).
    ///
    /// Returns the run, or the trouble of recording its start.
    #[staticmethod]
    #[allow(clippy::too_many_arguments)] // the whole border in one call
    fn start<'py>(
        py: Python<'py>,
        problem: &Mechanical,
        method: &Bound<'py, PyAny>,
        observer: &convert::Tape,
        params: PyReadonlyArray1<'py, f64>,
        y: PyReadonlyArray1<'py, f64>,
        z: PyReadonlyArray1<'py, f64>,
        span: (f64, f64, usize, usize),
        states: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (t0, h, steps, every) = span;
        let (n, params) = (problem.0.n, params.as_slice()?);
        let (y, z) = (y.as_slice()?, z.as_slice()?);
        let wanted = [1, n, n, problem.0.stage.inputs()[3]];
        if every == 0
            || y.len() != n
            || z.len() != n
            || observer.0.inputs() != wanted
            || params.len() != wanted[3]
        {
            return Err(PyValueError::new_err(format!(
                "y, z and params have sizes {:?}",
                &wanted[1..]
            )));
        }
        let mut model = Model::new(problem.0.clone(), params);
        let observer = Observer::new(model.clone(), params, Tape::clone(&observer.0), states);
        let width = liouville_core::problem::Observe::width(&observer);
        let state = model.state(t0, y, z);
        let stepper = spark(model, method)?;
        match Run::new(
            stepper,
            observer,
            state,
            Span {
                t0,
                h,
                steps,
                every,
            },
        ) {
            Ok(run) => Ok(Bound::new(
                py,
                Self {
                    run: Box::new(run),
                    width,
                },
            )?
            .into_any()),
            Err(trouble) => Ok(errors::trouble(py, &trouble)?.into_any()),
        }
    }

    /// Makes steps for `seconds`; "paused", "done", or the trouble with the step and its time.
    fn advance<'py>(&mut self, py: Python<'py>, seconds: f64) -> PyResult<Bound<'py, PyAny>> {
        let run = &mut self.run;
        let budget = Duration::try_from_secs_f64(seconds).map_err(errors::refused)?;
        let status = py.detach(|| run.advance(budget));
        match status {
            Status::Paused => Ok("paused".into_pyobject(py)?.into_any()),
            Status::Done => Ok("done".into_pyobject(py)?.into_any()),
            Status::Failed { n, t, trouble } => {
                let dict = errors::trouble(py, &trouble)?;
                dict.set_item("step", n)?;
                dict.set_item("start", t)?;
                Ok(dict.into_any())
            }
        }
    }

    /// Number of steps made.
    #[getter]
    fn done(&self) -> usize {
        self.run.done()
    }

    /// What the stepper has done.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stats = self.run.stats();
        let dict = PyDict::new(py);
        dict.set_item("iterations", stats.iterations)?;
        dict.set_item("evaluations", stats.evaluations)?;
        dict.set_item("newton_steps", stats.newton_steps)?;
        dict.set_item("cold_starts", stats.cold_starts)?;
        Ok(dict)
    }

    /// Times and rows of the records; the run keeps none.
    #[allow(clippy::type_complexity)]
    fn take<'py>(
        &mut self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (times, rows) = self.run.take();
        let shape = [times.len(), self.width];
        Ok((
            PyArray1::from_vec(py, times),
            PyArray1::from_vec(py, rows).reshape(shape)?,
        ))
    }
}

fn spark(model: Model, method: &Bound<'_, PyAny>) -> PyResult<Spark> {
    let stages: usize = method.getattr("stages")?.extract()?;
    let solver: String = method.getattr("solver")?.extract()?;
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
    Ok(Spark::new(model, stages, solver))
}

/// Coefficients of the s-stage Gauss–Lobatto SPARK method, by their letters.
#[pyfunction]
pub(crate) fn gauss_lobatto(py: Python<'_>, stages: usize) -> PyResult<Bound<'_, PyDict>> {
    if stages == 0 {
        return Err(PyValueError::new_err(
            "a SPARK method has at least one stage",
        ));
    }
    let tableau = GaussLobatto::new(stages);
    let dict = PyDict::new(py);
    for (name, matrix) in [
        ("a", &tableau.a),
        ("a_bar", &tableau.a_bar),
        ("a_hat", &tableau.a_hat),
    ] {
        let shape = [matrix.rows(), matrix.cols()];
        dict.set_item(
            name,
            PyArray1::from_slice(py, matrix.flat()).reshape(shape)?,
        )?;
    }
    for (name, vector) in [
        ("b", &tableau.b),
        ("c", &tableau.c),
        ("b_hat", &tableau.b_hat),
        ("c_hat", &tableau.c_hat),
    ] {
        dict.set_item(name, PyArray1::from_slice(py, vector))?;
    }
    Ok(dict)
}
