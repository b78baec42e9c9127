//! Runs, as Python drives them: a slice of time, then a look at the signals.

use crate::errors;
use liouville_core::run::{Advance, Status};
use liouville_core::trouble::Trouble;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Duration;

/// A run of any system by any method.
#[pyclass(module = "liouville._core")]
pub(crate) struct Run {
    run: Box<dyn Advance + Sync>,
    shape: Vec<usize>,
}

impl Run {
    /// A run whose records have this shape, or the trouble of starting it, for Python.
    pub(crate) fn handed<'py, A: Advance + Sync + 'static>(
        py: Python<'py>,
        run: Result<A, Trouble>,
        shape: &[usize],
    ) -> PyResult<Bound<'py, PyAny>> {
        match run {
            Ok(run) => {
                let (run, shape) = (Box::new(run), shape.to_vec());
                Ok(Bound::new(py, Self { run, shape })?.into_any())
            }
            Err(trouble) => Ok(errors::trouble(py, &trouble)?.into_any()),
        }
    }
}

#[pymethods]
impl Run {
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

    /// The time reached.
    #[getter]
    fn t(&self) -> f64 {
        self.run.time()
    }

    /// What the stepper has done.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (stats, rejected) = self.run.stats();
        let dict = PyDict::new(py);
        dict.set_item("iterations", stats.iterations)?;
        dict.set_item("evaluations", stats.evaluations)?;
        dict.set_item("factorizations", stats.factorizations)?;
        dict.set_item("newton_steps", stats.newton_steps)?;
        dict.set_item("cold_starts", stats.cold_starts)?;
        dict.set_item("rejected", rejected)?;
        Ok(dict)
    }

    /// Times and rows of the records; the run keeps none. A section has rows of its own times.
    #[allow(clippy::type_complexity)]
    fn take<'py>(
        &mut self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let (times, rows) = self.run.take();
        let count = match self.shape.iter().product() {
            0 => times.len(),
            width => rows.len() / width,
        };
        let shape = [&[count], self.shape.as_slice()].concat();
        Ok((
            PyArray1::from_vec(py, times),
            PyArray1::from_vec(py, rows).reshape(shape)?,
        ))
    }
}
