//! Pullbacks of runs, as Python drives them: from checkpoint to checkpoint.

use crate::caught::attending;
use crate::errors::{self, refused};
use crate::job;
use crate::mechanical::Mechanical;
use crate::run::Run;
use crate::second_order::SecondOrder;
use crate::semi_explicit::SemiExplicit;
use liouville_base::linalg::Matrix;
use liouville_base::run::StartError;
use liouville_mechanics::run;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The pullback of a run.
#[pyclass(module = "liouville._core")]
pub(crate) struct Pullback {
    inner: Box<dyn run::Follow>,
    width: usize,
}

/// The pullback of a run with these arguments, from the cotangents of nothing; or the error of its start.
#[pyfunction]
pub(crate) fn pullback<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyAny>,
    method: &Bound<'py, PyAny>,
    job: &Bound<'py, PyAny>,
    sensitivity: job::SensitivityOf<'py>,
    alpha: Option<job::AlphaOf<'py>>,
) -> PyResult<Bound<'py, PyAny>> {
    let width = sensitivity.width();
    let problem = if let Ok(problem) = problem.extract::<PyRef<'_, SecondOrder>>() {
        run::Problem::SecondOrder(problem.0.clone())
    } else if let Ok(problem) = problem.extract::<PyRef<'_, SemiExplicit>>() {
        run::Problem::SemiExplicit(problem.0.clone())
    } else {
        let problem = problem.extract::<PyRef<'_, Mechanical>>()?;
        run::Problem::General(problem.0.clone(), problem.1.clone())
    };
    match job::pullback(problem, &sensitivity, method, job, alpha)? {
        Ok(inner) => Ok(Bound::new(py, Pullback { inner, width })?.into_any()),
        Err(StartError::Invalid(sentence)) => Err(refused(sentence)),
        Err(StartError::Failed(error)) => Ok(errors::error(py, &error)?.into_any()),
    }
}

#[pymethods]
impl Pullback {
    /// The run, whose steps are recorded as they are made.
    #[getter]
    fn run(&self) -> Run {
        Run::of(Box::new(self.inner.run()))
    }

    /// Forgets the steps recorded so far.
    fn forget(&mut self) {
        self.inner.forget();
    }

    /// Takes cotangents of (y, z, lam) at the times given with the run, a row for each.
    fn give(&mut self, rows: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let (count, width) = (rows.shape()[0], rows.shape()[1]);
        let values = rows.as_slice()?;
        let rows = Matrix::from_fn(count, width, |i, j| values[i * width + j]);
        if self.inner.give(rows) {
            Ok(())
        } else {
            Err(refused(
                "cotangents are rows of (y, z, lam), one for each time",
            ))
        }
    }

    /// Takes cotangents of each kind of event, rows of t, y, z and lam, and of y, z and lam after a reset.
    fn give_events(&mut self, rows: Vec<PyReadonlyArray2<'_, f64>>) -> PyResult<()> {
        let each = rows.iter().map(|rows| {
            let (count, width) = (rows.shape()[0], rows.shape()[1]);
            if ![1 + self.width, 1 + 2 * self.width].contains(&width) {
                return Err(refused("cotangents of events are rows of (t, y, z, lam)"));
            }
            let values = rows.as_slice()?;
            Ok(Matrix::from_fn(count, width, |i, j| values[i * width + j]))
        });
        let rows = each.collect::<PyResult<_>>()?;
        self.inner.give_events(rows);
        Ok(())
    }

    /// Follows the steps from a saved state up to the step `last` back, or without one those recorded; rows are
    /// cotangents of (y, z, lam) at the ends of the steps `kept`. Returns None, or the error.
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        saved: Option<PyReadonlyArray1<'py, f64>>,
        last: usize,
        kept: PyReadonlyArray1<'py, i64>,
        rows: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        if rows.shape() != [kept.len(), self.width] {
            return Err(refused("cotangents are rows of (y, z, lam)"));
        }
        let kept = crate::convert::indices(&kept)?;
        let (values, width) = (rows.as_slice()?, self.width);
        let rows = Matrix::from_fn(kept.len(), width, |i, j| values[i * width + j]);
        let inner = &mut self.inner;
        if let Some(saved) = saved {
            inner.restore(saved.as_slice()?).map_err(refused)?;
        }
        match attending(py, || inner.follow(last, &kept, &rows))? {
            Ok(()) => Ok(None),
            Err(error) => Ok(Some(errors::error(py, &error)?.into_any())),
        }
    }

    /// Cotangents of y, z and of time and parameters at the start, and by which part of themselves the steps become
    /// longer; `row` are those of the start as it is observed. Or the error.
    fn end<'py>(
        &mut self,
        py: Python<'py>,
        row: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        if row.len() != self.width {
            return Err(refused("cotangents are rows of (y, z, lam)"));
        }
        match self.inner.end(row.as_slice()?) {
            Ok(found) => {
                let array = |x: &Vec<f64>| PyArray1::from_slice(py, x);
                let arrays = (
                    array(&found.y),
                    array(&found.z),
                    array(&found.tau),
                    found.stretch,
                );
                Ok(arrays.into_pyobject(py)?.into_any())
            }
            Err(error) => Ok(errors::error(py, &error)?.into_any()),
        }
    }
}
