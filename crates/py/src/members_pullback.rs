//! Pullbacks of members of an ensemble in lock-step.

use crate::caught::attending;
use crate::convert::indices;
use crate::errors::refused;
use crate::job;
use crate::mechanical::{Mechanical, Sensitivity};
use liouville_base::real::BATCH;
use liouville_base::run::StartError;
use liouville_mechanics::run::{self, KeptRows};
use liouville_problem::Cotangents;
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// The pullbacks of members of an ensemble in lock-step.
#[pyclass(module = "liouville._core", frozen)]
pub(crate) struct MembersPullback {
    inner: run::MembersPullback,
    width: usize,
}

/// Cotangents of y, of z, and of time and parameters, a row for each member, and by which part of themselves the steps
/// become longer.
type CotangentRows<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// The pullbacks of the members of an ensemble with these arguments; None where these do not run in lock-step.
#[pyfunction]
pub(crate) fn members_pullback(
    problem: PyRef<'_, Mechanical>,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
    sensitivity: PyRef<'_, Sensitivity>,
) -> PyResult<Option<MembersPullback>> {
    let problem = run::Problem::General(problem.0.clone(), problem.1.clone());
    let own = &sensitivity.0;
    let width = 2 * own.mechanical.n + own.mechanical.multipliers();
    match job::members_pullback(problem, method, job, own)? {
        Ok(inner) => Ok(inner.map(|inner| MembersPullback { inner, width })),
        Err(StartError::Invalid(sentence)) => Err(refused(sentence)),
        Err(StartError::Failed(_)) => Ok(None),
    }
}

#[pymethods]
impl MembersPullback {
    /// At most so many members are pulled back at once.
    #[classattr]
    #[allow(non_upper_case_globals)] // as Python names an attribute
    const most: usize = BATCH;

    /// Lets all pullbacks under way end, which return None, and those to come.
    fn stop(&self) {
        self.inner.stop();
    }

    /// Takes cotangents of (y, z, lam) at the ends of the steps `kept`, the last of which is `last` or one before, to the
    /// starts of some members; None where one of them fails.
    fn pull<'py>(
        &self,
        py: Python<'py>,
        members: Vec<usize>,
        last: usize,
        kept: PyReadonlyArray1<'py, i64>,
        rows: PyReadonlyArray3<'py, f64>,
    ) -> PyResult<Option<CotangentRows<'py>>> {
        let is_fitting = rows.shape() == [kept.len(), members.len(), self.width];
        if !is_fitting || !(1..=BATCH).contains(&members.len()) || kept.is_empty() {
            return Err(refused(
                "cotangents are rows of (y, z, lam) for each member",
            ));
        }
        if members.iter().any(|member| *member >= self.inner.members()) {
            return Err(refused("members are those of the ensemble"));
        }
        let (steps, rows) = (indices(&kept)?, rows.as_slice()?);
        let kept = KeptRows {
            steps: &steps,
            rows,
        };
        match attending(py, || self.inner.pull(&members, last, kept))? {
            Ok(found) => Ok(Some(read(py, &found)?)),
            Err(_) => Ok(None),
        }
    }
}

fn read<'py>(py: Python<'py>, found: &[Cotangents]) -> PyResult<CotangentRows<'py>> {
    let rows = |of: fn(&Cotangents) -> &Vec<f64>| {
        let flat: Vec<f64> = found.iter().flat_map(of).copied().collect();
        let width = flat.len() / found.len();
        PyArray1::from_vec(py, flat).reshape([found.len(), width])
    };
    let stretch = found.iter().map(|of| of.stretch).collect();
    Ok((
        rows(|of| &of.y)?,
        rows(|of| &of.z)?,
        rows(|of| &of.tau)?,
        PyArray1::from_vec(py, stretch),
    ))
}
