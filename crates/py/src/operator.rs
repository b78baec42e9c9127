//! Terms of a Hamiltonian in, products out.

use crate::caught::{Caught, attending};
use crate::convert::{Rows, Tape};
use crate::errors::refused;
use liouville_base::error::StepError;
use liouville_base::simd::InstructionSet;
use liouville_waves::method::Sweeper;
use liouville_waves::problem::{
    Bond, Coupling, Dense, Diagonals, Drive, HamiltonianAt, Kinetic, Nonlinearity, Potential, Spins,
};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use std::sync::Arc;

/// One real symmetric matrix, by its products.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct Operator {
    inner: liouville_waves::problem::Operator,
    caught: Option<Caught>,
}

impl From<liouville_waves::problem::Operator> for Operator {
    fn from(inner: liouville_waves::problem::Operator) -> Self {
        let caught = None;
        Self { inner, caught }
    }
}

/// Products that a Python function makes, of x alone or of weights, times and x.
struct Callable {
    n: usize,
    function: Py<PyAny>,
    is_driven: bool,
    caught: Caught,
}

/// A copy as an array, which NumPy makes: where there is no memory for it, it raises a `MemoryError`.
fn array_of<'py>(py: Python<'py>, x: &[f64]) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let numpy = py.import(intern!(py, "numpy"))?;
    let made = numpy.call_method1(intern!(py, "empty"), (x.len(),))?;
    let array = made.cast_into::<PyArray1<f64>>()?;
    array.readwrite().as_slice_mut()?.copy_from_slice(x);
    Ok(array)
}

impl liouville_waves::problem::Product for Callable {
    fn size(&self) -> usize {
        self.n
    }

    fn is_driven(&self) -> bool {
        self.is_driven
    }

    fn multiply(&self, nodes: &[(f64, f64)], x: &[f64], out: &mut [f64]) -> bool {
        self.caught.is_fine(Python::attach(|py| {
            let (argument, function) = (array_of(py, x)?, self.function.bind(py));
            let product = if self.is_driven {
                function.call1((nodes.to_vec(), argument))?
            } else {
                function.call1((argument,))?
            };
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
        liouville_waves::problem::Operator::sparse(rows.0.clone()).into()
    }

    /// A matrix of n rows by its diagonals: `values[k][i]` is H[i, i + offsets[k]] and H[i + offsets[k], i].
    #[staticmethod]
    fn diagonals(
        n: usize,
        offsets: Vec<usize>,
        values: Vec<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let is_fitting = offsets.iter().zip(&values).all(|(d, x)| d + x.len() == n);
        let mut distinct = offsets.clone();
        distinct.sort_unstable();
        distinct.dedup();
        if offsets.len() != values.len() || distinct.len() != offsets.len() || !is_fitting {
            return Err(PyValueError::new_err("diagonals of n - offset values each"));
        }
        let diagonals: Vec<(usize, Vec<f64>)> = offsets
            .into_iter()
            .zip(&values)
            .map(|(offset, values)| Ok((offset, values.as_slice()?.to_vec())))
            .collect::<PyResult<_>>()?;
        let diagonals = Diagonals::new(n, &diagonals);
        Ok(liouville_waves::problem::Operator::Diagonals(Arc::new(diagonals)).into())
    }

    /// A dense matrix.
    #[staticmethod]
    fn dense(matrix: PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        let [rows, cols] = [matrix.shape()[0], matrix.shape()[1]];
        if rows != cols {
            return Err(PyValueError::new_err("a square matrix"));
        }
        let dense = Dense::new(rows, matrix.as_slice()?);
        Ok(liouville_waves::problem::Operator::Dense(Arc::new(dense)).into())
    }

    /// Spins with bonds (i, j, xy, z), the sum over them of xy (S^x_i S^x_j + S^y_i S^y_j) + z S^z_i S^z_j, and
    /// fields along z; all states, or those with so many spins up.
    #[staticmethod]
    #[pyo3(signature = (bonds, fields, up))]
    fn spins(
        bonds: Vec<(u32, u32, f64, f64)>,
        fields: Vec<f64>,
        up: Option<u32>,
    ) -> PyResult<Self> {
        let length = fields.len();
        let is_inside = |i: u32| (i as usize) < length;
        let mut ends = bonds.iter().map(|(i, j, ..)| (*i, *j));
        if length > 32
            || up.is_some_and(|up| up as usize > length)
            || !ends.all(|(i, j)| i != j && is_inside(i) && is_inside(j))
        {
            return Err(PyValueError::new_err(
                "at most 32 spins, with bonds between them",
            ));
        }
        let bond = |(i, j, xy, z)| Bond {
            sites: (i, j),
            xy,
            z,
        };
        let bonds: Vec<Bond> = bonds.into_iter().map(bond).collect();
        let spins = Spins::new(&bonds, &fields, up);
        Ok(liouville_waves::problem::Operator::Spins(Arc::new(spins)).into())
    }

    /// Kinetic energy on a periodic grid, with these energies along each axis in the order of a transform.
    #[staticmethod]
    fn kinetic(energies: Vec<PyReadonlyArray1<'_, f64>>) -> PyResult<Self> {
        let energies: Vec<Vec<f64>> = energies
            .iter()
            .map(|energies| Ok(energies.as_slice()?.to_vec()))
            .collect::<PyResult<_>>()?;
        let unfit = || PyValueError::new_err("even energies along one to three axes");
        let kinetic = Kinetic::new(&energies).ok_or_else(unfit)?;
        Ok(liouville_waves::problem::Operator::Kinetic(Arc::new(kinetic)).into())
    }

    /// A function that makes products of n numbers: an array in, an array out; of a driven one pairs (a, t) of the sum
    /// of a H(t) come first.
    #[staticmethod]
    #[pyo3(signature = (n, function, is_driven = false))]
    fn product(n: usize, function: Py<PyAny>, is_driven: bool) -> Self {
        let caught = Caught::of_model();
        let product = Callable {
            n,
            function,
            is_driven,
            caught: caught.clone(),
        };
        Self {
            inner: liouville_waves::problem::Operator::Product(Arc::new(product)),
            caught: Some(caught),
        }
    }

    /// A symmetric matrix between components of so many points, with these eigenvalues, and eigenvectors as columns.
    #[staticmethod]
    fn coupling(
        points: usize,
        levels: PyReadonlyArray1<'_, f64>,
        vectors: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let unfit = || PyValueError::new_err("an eigenvector for each eigenvalue");
        let coupling = Coupling::new(points, levels.as_slice()?, vectors.as_slice()?);
        let coupling = Arc::new(coupling.ok_or_else(unfit)?);
        Ok(liouville_waves::problem::Operator::Coupling(coupling).into())
    }

    /// The same matrix on each of so many parts of a state.
    fn repeated(&self, times: usize) -> Self {
        let inner = Arc::new(self.inner.clone());
        Self {
            inner: liouville_waves::problem::Operator::Repeated(inner, times),
            caught: self.caught.clone(),
        }
    }

    /// Number of rows.
    #[getter]
    fn size(&self) -> usize {
        self.inner.size()
    }
}

/// A tape of t and parameters, and the parameters.
type Driven<'py> = (PyRef<'py, Tape>, PyReadonlyArray1<'py, f64>);

/// Tapes of g(t, parameters) and of V(g, u, parameters), the parameters, and the values u of all points.
type Moving<'py> = (
    PyRef<'py, Tape>,
    PyRef<'py, Tape>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
);

/// Tapes of W(t, ρ) and of its energy, with parameters, the parameters, and the volume of a point.
type OfDensity<'py> = (
    PyRef<'py, Tape>,
    PyRef<'py, Tape>,
    PyReadonlyArray1<'py, f64>,
    f64,
);

/// A sum of operators of the same size.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Hamiltonian {
    pub(crate) inner: Arc<liouville_waves::problem::Hamiltonian>,
    pub(crate) caught: Vec<Caught>,
}

#[pymethods]
impl Hamiltonian {
    /// A sum of terms, with weights that depend on time if there is a `drive`, (tape of t and parameters, the
    /// parameters), and a diagonal that does if there is a `potential`, (tape of t and parameters
    /// for g, tape of g, u and parameters, the parameters, the values u of all points), a potential of the density if there is a `nonlinearity`, and −i times a diagonal if there is an
    /// `absorber`. A doubled one is [[A, -B], [B, A]] of a complex H = A + iB,
    /// and acts on (q, p).
    #[new]
    #[pyo3(signature = (terms, is_doubled = false, drive = None, potential = None, nonlinearity = None, absorber = None))]
    fn new(
        terms: Vec<PyRef<'_, Operator>>,
        is_doubled: bool,
        drive: Option<Driven<'_>>,
        potential: Option<Moving<'_>>,
        nonlinearity: Option<OfDensity<'_>>,
        absorber: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
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
        let mut inner = liouville_waves::problem::Hamiltonian::new(terms);
        if is_doubled {
            if !inner.size().is_multiple_of(2) {
                return Err(PyValueError::new_err("a doubled matrix of even order"));
            }
            inner = inner.doubled();
        }
        let unfit = || PyValueError::new_err("a drive or a potential of another size");
        if let Some((tape, params)) = drive {
            let weights = inner.terms().len();
            let drive = Drive::new(tape.0.clone(), params.as_slice()?, weights);
            inner = inner.with_drive(drive.ok_or_else(unfit)?);
        }
        if let Some((of_time, tape, params, points)) = potential {
            let tapes = (of_time.0.clone(), tape.0.clone());
            let potential = Potential::new(tapes, params.as_slice()?, points.as_slice()?);
            let potential = potential.filter(|potential| potential.size() == inner.size());
            inner = inner.with_potential(potential.ok_or_else(unfit)?);
        }
        if let Some((potential, energy, params, cell)) = nonlinearity {
            let (potential, energy) = (potential.0.clone(), energy.0.clone());
            let nonlinearity = Nonlinearity::new(potential, energy, params.as_slice()?, cell);
            let places = inner.places();
            let nonlinearity = nonlinearity.filter(|each| places.is_multiple_of(each.components()));
            inner = inner.with_nonlinearity(nonlinearity.ok_or_else(unfit)?);
        }
        if let Some(absorber) = absorber {
            let absorber = absorber.as_slice()?;
            if absorber.len() != inner.places() || !absorber.iter().all(|w| *w >= 0.0) {
                return Err(unfit());
            }
            inner = inner.with_absorber(absorber.into());
        }
        let inner = Arc::new(inner);
        Ok(Self { inner, caught })
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
            let scratch = &mut liouville_waves::problem::ProductScratch::default();
            (self.inner.sum()).multiply(InstructionSet::default(), x, &mut out, scratch)
        });
        outcome.map_err(|error| self.explained(error))?;
        Ok(PyArray1::from_vec(py, out))
    }

    /// The smallest and the largest Ritz value after so many Lanczos steps from a random vector, and the least and
    /// the largest number within its residual of any Ritz value; terms may have weights.
    #[pyo3(signature = (steps, seed, weights=None))]
    fn ritz(
        &self,
        py: Python<'_>,
        steps: usize,
        seed: u64,
        weights: Option<Vec<f64>>,
    ) -> PyResult<(f64, f64, f64, f64)> {
        let mut sweeper = Sweeper::new(self.inner.clone());
        if let Some(weights) = weights {
            let current = HamiltonianAt::new(&self.inner).with_weights(weights);
            let wrong = || refused("there is a weight for each term");
            sweeper.current = Some(current.ok_or_else(wrong)?);
        }
        let found = attending(py, || {
            liouville_waves::method::ritz(&mut sweeper, steps.max(1), seed)
        })?;
        let found = found.map_err(|error| self.explained(error))?;
        Ok((found.low.0, found.high.0, found.outer.0, found.outer.1))
    }

    /// |x H y − y H x| / (|x| |H y|) of two random vectors, which is nothing where H is symmetric.
    fn asymmetry(&self, py: Python<'_>, seed: u64) -> PyResult<f64> {
        let mut sweeper = Sweeper::new(self.inner.clone());
        let found = attending(py, || {
            liouville_waves::method::asymmetry(&mut sweeper, seed)
        })?;
        found.map_err(|error| self.explained(error))
    }
}

impl Hamiltonian {
    /// The exception of a function that makes products, or else this error.
    fn explained(&self, error: StepError) -> PyErr {
        let raised = self.caught.iter().find_map(Caught::take);
        raised.unwrap_or_else(|| match error {
            StepError::NoMemory => PyMemoryError::new_err("products with H do not fit in memory"),
            error => refused(error),
        })
    }
}
