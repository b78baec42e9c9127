//! Terms of a Hamiltonian in, products out.

use crate::caught::Caught;
use crate::convert::Rows;
use crate::errors::refused;
use liouville_core::problem::quantum;
use liouville_core::vector::Machine;
use numpy::{PyArray1, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// One real symmetric matrix, by its products.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct Operator {
    inner: quantum::Operator,
    caught: Option<Caught>,
}

impl From<quantum::Operator> for Operator {
    fn from(inner: quantum::Operator) -> Self {
        let caught = None;
        Self { inner, caught }
    }
}

/// Products that a Python function makes.
struct Callable {
    n: usize,
    function: Py<PyAny>,
    caught: Caught,
}

impl quantum::Product for Callable {
    fn size(&self) -> usize {
        self.n
    }

    fn multiply(&self, x: &[f64], out: &mut [f64]) -> bool {
        self.caught.is_fine(Python::attach(|py| {
            let argument = PyArray1::from_slice(py, x);
            let product = self.function.bind(py).call1((argument,))?;
            let product: PyReadonlyArray1<'_, f64> = product.extract()?;
            if product.len() != out.len() {
                let wanted = out.len();
                return Err(PyValueError::new_err(format!(
                    "a product has {} numbers, not {wanted}",
                    product.len()
                )));
            }
            for (out, value) in out.iter_mut().zip(product.as_array()) {
                *out = *value;
            }
            Ok(())
        }))
    }
}

#[pymethods]
impl Operator {
    /// A sparse matrix.
    #[staticmethod]
    fn rows(rows: PyRef<'_, Rows>) -> Self {
        quantum::Operator::Rows(rows.0.clone()).into()
    }

    /// A function that makes products of n numbers: an array in, an array out.
    #[staticmethod]
    fn product(n: usize, function: Py<PyAny>) -> Self {
        let caught = Caught::default();
        let product = Callable {
            n,
            function,
            caught: caught.clone(),
        };
        Self {
            inner: quantum::Operator::Product(Arc::new(product)),
            caught: Some(caught),
        }
    }

    /// Number of rows.
    #[getter]
    fn size(&self) -> usize {
        self.inner.size()
    }
}

/// A sum of operators of the same size.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Hamiltonian {
    pub(crate) inner: Arc<quantum::Hamiltonian>,
    pub(crate) caught: Vec<Caught>,
}

#[pymethods]
impl Hamiltonian {
    #[new]
    fn new(terms: Vec<PyRef<'_, Operator>>) -> PyResult<Self> {
        let is_uniform = terms
            .windows(2)
            .all(|pair| pair[0].size() == pair[1].size());
        if terms.is_empty() || !is_uniform {
            return Err(PyValueError::new_err(
                "terms of the same size, at least one",
            ));
        }
        let caught = terms
            .iter()
            .filter_map(|term| term.caught.clone())
            .collect();
        let terms = terms.iter().map(|term| term.inner.clone()).collect();
        Ok(Self {
            inner: Arc::new(quantum::Hamiltonian::new(terms)),
            caught,
        })
    }

    /// Number of rows.
    #[getter]
    fn size(&self) -> usize {
        self.inner.size()
    }

    /// The product with a real vector.
    fn multiply<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if x.len() != self.inner.size() {
            return Err(PyValueError::new_err("a vector as long as the operator"));
        }
        let (x, mut out) = (x.as_slice()?, vec![0.0; x.len()]);
        let outcome = py.detach(|| {
            let scratch = &mut quantum::Scratch::default();
            (self.inner.sum()).multiply(Machine::default(), x, &mut out, scratch)
        });
        outcome.map_err(|trouble| self.raised().unwrap_or_else(|| refused(trouble)))?;
        Ok(PyArray1::from_vec(py, out))
    }
}

impl Hamiltonian {
    /// What a function raised that makes products.
    fn raised(&self) -> Option<PyErr> {
        self.caught.iter().find_map(Caught::take)
    }
}
