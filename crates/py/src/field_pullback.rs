//! Pullbacks of runs of fields, as Python drives them: from checkpoint to checkpoint.

use crate::errors::{self, refused};
use crate::split::{self, Split};
use liouville_base::run::StartError;
use liouville_fields::run;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The pullback of a run of a split field.
#[pyclass(module = "liouville._core")]
pub(crate) struct FieldPullback(run::Pullback);

#[pymethods]
impl FieldPullback {
    /// The pullback of a run that was begun with these arguments, from the cotangents of nothing.
    #[new]
    fn new(
        split: PyRef<'_, Split>,
        method: &Bound<'_, PyAny>,
        job: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        match split::pullback(&split, method, job)? {
            Ok(inner) => Ok(Self(inner)),
            Err(StartError::Invalid(sentence)) => Err(refused(sentence)),
            Err(StartError::Failed(error)) => Err(refused(error)),
        }
    }

    /// Follows the steps from a saved state up to the step `last` back; rows are cotangents of x at the ends of the steps
    /// `kept`, beside these, and at times that are held. Returns None, or the error.
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        saved: PyReadonlyArray1<'py, f64>,
        last: usize,
        at_ends: (PyReadonlyArray1<'py, i64>, PyReadonlyArray2<'py, f64>),
        at_times: (PyReadonlyArray1<'py, f64>, PyReadonlyArray2<'py, f64>),
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let ((kept, rows), (times, held)) = (at_ends, at_times);
        let (width, inner) = (self.0.variables(), &mut self.0);
        if rows.shape() != [kept.len(), width] || held.shape() != [times.len(), width] {
            return Err(refused("cotangents are rows of x"));
        }
        let kept = crate::convert::indices(&kept)?;
        let given = run::Cotangents {
            kept: &kept,
            rows: rows.as_slice()?,
            times: times.as_slice()?,
            held: held.as_slice()?,
        };
        inner.restore(saved.as_slice()?).map_err(refused)?;
        match py.detach(|| inner.follow(last, given)) {
            Ok(()) => Ok(None),
            Err(error) => Ok(Some(errors::error(py, &error)?.into_any())),
        }
    }

    /// Cotangents of the variables that are stepped at the start, of all coefficients in the order of pieces, of the step
    /// size, and of the time of the start; `row` are those of the start as it is observed.
    fn end<'py>(
        &mut self,
        py: Python<'py>,
        row: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if row.len() != self.0.variables() {
            return Err(refused("cotangents are rows of x"));
        }
        Ok(PyArray1::from_vec(py, self.0.end(row.as_slice()?)))
    }
}
