//! Semi-explicit systems of index 2: the problem, and z at a point.

use crate::convert::{Made, Recipe, item, pattern, tape_of};
use crate::errors::{self, refused};
use liouville_index2::semi_explicit::{
    self, SemiExplicitModel, SemiExplicitPatterns, SemiExplicitSensitivityPatterns,
};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A semi-explicit system in the core's terms.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct SemiExplicit(pub(crate) Arc<semi_explicit::SemiExplicit>, Made);

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
        let tape = |name: &str| tape_of(tapes, name);
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
            rates: tape("rates")?,
            patterns: SemiExplicitPatterns {
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
        match SemiExplicitModel::new(self.0.clone(), params).state(t, y, z, 1.0) {
            Ok(state) => Ok(PyArray1::from_vec(py, state.z).into_any()),
            Err(error) => Ok(errors::error(py, &error)?.into_any()),
        }
    }
}

/// Derivatives of a semi-explicit system by time and parameters, and of z by a point.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct SemiExplicitSensitivity(
    pub(crate) Arc<semi_explicit::SemiExplicitSensitivity>,
    Made,
);

#[pymethods]
impl SemiExplicitSensitivity {
    /// Tapes and patterns by name.
    #[new]
    fn new(
        problem: &Bound<'_, SemiExplicit>,
        tapes: &Bound<'_, PyDict>,
        patterns: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let tape = |name: &str| tape_of(tapes, name);
        let pattern = |name: &str| pattern(&item(patterns, name)?);
        let made = Made::of(tapes.py(), (problem, tapes, patterns))?;
        let found = semi_explicit::SemiExplicitSensitivity {
            system: problem.get().0.clone(),
            field: tape("field")?,
            constraint: tape("constraint")?,
            hidden: tape("hidden")?,
            patterns: SemiExplicitSensitivityPatterns {
                f_tau: pattern("f_tau")?,
                k_tau: pattern("k_tau")?,
                w_y: pattern("w_y")?,
                w_tau: pattern("w_tau")?,
            },
        };
        Ok(Self(Arc::new(found.checked().map_err(refused)?), made))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Recipe<'py> {
        self.1.again::<Self>(py)
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
