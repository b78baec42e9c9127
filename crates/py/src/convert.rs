//! Arrays in, core types out.

use crate::errors::refused;
use crate::program;
use liouville_base::linalg::{self, Pattern};
use liouville_base::tape::{self, Line, Op, Term};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple, PyType};
use std::sync::Arc;

/// Codes of the lines that are not operations.
const INPUT: i64 = -1;
const CONSTANT: i64 = -2;
const OUTPUT: i64 = -3;

/// A vector, as the caller holds it.
pub(crate) type Values<'py> = PyReadonlyArray1<'py, f64>;

/// The pickled form of an object: a function and its arguments.
pub(crate) type Recipe<'py> = (Bound<'py, PyAny>, Bound<'py, PyTuple>);

/// The arguments that a problem was made of, for its pickled form.
#[derive(Clone)]
pub(crate) struct Made(Arc<Py<PyTuple>>);

impl Made {
    /// Remembers the arguments, dictionaries as they are now.
    pub(crate) fn of<'py>(
        py: Python<'py>,
        args: impl IntoPyObject<'py, Target = PyTuple, Output = Bound<'py, PyTuple>, Error = PyErr>,
    ) -> PyResult<Self> {
        let args = args.into_pyobject(py)?;
        let own = args.iter().map(|arg| match arg.cast::<PyDict>() {
            Ok(dict) => dict.copy().map(Bound::into_any),
            Err(_) => Ok(arg),
        });
        let own = PyTuple::new(py, own.collect::<PyResult<Vec<_>>>()?)?;
        Ok(Self(Arc::new(own.unbind())))
    }

    /// The pickled form of the problem.
    pub(crate) fn again<'py, T: pyo3::PyTypeInfo>(&self, py: Python<'py>) -> Recipe<'py> {
        (PyType::new::<T>(py).into_any(), self.0.bind(py).clone())
    }
}

/// A column of numbers that tapes look values up in.
#[pyclass(frozen, weakref, module = "liouville._core")]
pub(crate) struct Column(tape::Column);

#[pymethods]
impl Column {
    #[new]
    fn new(numbers: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        Ok(Self(numbers.as_slice()?.into()))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Recipe<'py>> {
        let numbers = (PyArray1::from_slice(slf.py(), &slf.get().0),);
        let args = numbers.into_pyobject(slf.py())?;
        Ok((slf.get_type().into_any(), args))
    }
}

/// A validated program, with its bytes, its terms and its columns for the pickled form.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct Tape(
    pub(crate) Arc<tape::Tape>,
    Arc<[u8]>,
    Option<Arc<Py<PyTuple>>>,
    Arc<[Py<Column>]>,
);

#[pymethods]
impl Tape {
    /// Lines are rows (code, slot, a, b) with a value each: an operation by its code, −1 an input
    /// (slot, group, element), −2 a constant (slot), −3 an output (slot, element).
    #[new]
    #[pyo3(signature = (inputs, outputs, lines, values, columns = Vec::new()))]
    fn new(
        inputs: Vec<usize>,
        outputs: usize,
        lines: PyReadonlyArray2<'_, i64>,
        values: PyReadonlyArray1<'_, f64>,
        columns: Vec<Py<Column>>,
    ) -> PyResult<Self> {
        if lines.shape()[1] != 4 || lines.shape()[0] != values.len() {
            return Err(PyValueError::new_err(
                "lines are rows of four numbers, with a value each",
            ));
        }
        let program: Vec<Line> = lines
            .as_array()
            .rows()
            .into_iter()
            .zip(values.as_array())
            .map(|(row, value)| line([row[0], row[1], row[2], row[3]], *value))
            .collect::<PyResult<_>>()?;
        Self::of(&inputs, outputs, &program, columns)
    }

    /// A pickled tape: its program, the arguments of `with_terms` if it has any, and its columns.
    #[staticmethod]
    #[pyo3(signature = (inputs, outputs, program, terms = None, columns = Vec::new()))]
    fn unpacked(
        py: Python<'_>,
        inputs: Vec<usize>,
        outputs: usize,
        program: &[u8],
        terms: Option<Bound<'_, PyTuple>>,
        columns: Vec<Py<Column>>,
    ) -> PyResult<Self> {
        let tape = Self::of(&inputs, outputs, &program::unpacked(program)?, columns)?;
        match terms {
            None => Ok(tape),
            Some(terms) => {
                let (constant, products, forms) = terms.extract()?;
                tape.with_terms(py, constant, products, forms)
            }
        }
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Recipe<'py>> {
        let (py, Self(tape, program, terms, columns)) = (slf.py(), slf.get());
        let program = PyBytes::new(py, program);
        let terms = terms.as_ref().map(|terms| terms.bind(py).clone());
        let columns: Vec<_> = columns.iter().map(|column| column.bind(py)).collect();
        let args = (
            tape.inputs().to_vec(),
            tape.outputs(),
            program,
            terms,
            columns,
        );
        Ok((slf.get_type().getattr("unpacked")?, args.into_pyobject(py)?))
    }

    /// Evaluates at k points: one (k, size) array for each input group but the parameters.
    fn map<'py>(
        &self,
        py: Python<'py>,
        params: PyReadonlyArray1<'py, f64>,
        args: Vec<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let sizes = self.0.inputs();
        let k = args.first().map_or(1, |arg| arg.shape()[0]);
        let wanted = sizes.iter().take(sizes.len().saturating_sub(1));
        let fits = args.len() + 1 == sizes.len()
            && args
                .iter()
                .zip(wanted)
                .all(|(arg, size)| arg.shape() == [k, *size])
            && Some(&params.len()) == sizes.last();
        if !fits {
            return Err(PyValueError::new_err(format!(
                "the tape's inputs have sizes {sizes:?}"
            )));
        }
        let slices = args
            .iter()
            .map(|arg| arg.as_slice())
            .collect::<Result<Vec<_>, _>>()?;
        let params = params.as_slice()?;
        let values = py.detach(|| self.0.map(params, &slices, k));
        numpy::PyArray1::from_vec(py, values).reshape([k, self.0.outputs()])
    }

    /// How much the roundings of all arguments, parameters and operations may change each output at a point.
    fn roundings<'py>(
        &self,
        py: Python<'py>,
        params: PyReadonlyArray1<'py, f64>,
        args: Vec<PyReadonlyArray1<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let sizes = self.0.inputs().iter().copied();
        if !args.iter().chain([&params]).map(|arg| arg.len()).eq(sizes) {
            return Err(PyValueError::new_err(format!(
                "the tape's inputs have sizes {:?}",
                self.0.inputs()
            )));
        }
        let slices = args.iter().map(|arg| arg.as_slice());
        let slices = slices.collect::<Result<Vec<_>, _>>()?;
        let bound = self.0.bind(params.as_slice()?);
        Ok(PyArray1::from_vec(py, self.0.roundings(&bound, &slices)))
    }

    /// The same program with a constant (one value an output, or none) and terms added to its values:
    /// products (first output, input group, factor, A) add factor A x, forms (output, input group,
    /// factor, A) add factor xᵀ A x.
    fn with_terms(
        &self,
        py: Python<'_>,
        constant: PyReadonlyArray1<'_, f64>,
        products: Vec<Added>,
        forms: Vec<Added>,
    ) -> PyResult<Self> {
        let own = PyArray1::from_slice(py, constant.as_slice()?);
        let given = (own, given(py, &products), given(py, &forms)).into_pyobject(py)?;
        let products = products
            .iter()
            .map(|(first, group, factor, rows)| Term::Product {
                first: *first,
                group: *group,
                factor: *factor,
                matrix: rows.get().0.clone(),
            });
        let forms = forms
            .iter()
            .map(|(output, group, factor, rows)| Term::Form {
                output: *output,
                group: *group,
                factor: *factor,
                matrix: rows.get().0.clone(),
            });
        let tape = tape::Tape::clone(&self.0)
            .with_terms(constant.as_slice()?, products.chain(forms).collect())
            .map_err(refused)?;
        Ok(Self(
            Arc::new(tape),
            self.1.clone(),
            Some(Arc::new(given.unbind())),
            self.3.clone(),
        ))
    }

    /// The same program with columns in place of others that it has.
    fn with_columns(&self, replaced: Vec<(Py<Column>, Py<Column>)>, py: Python<'_>) -> Self {
        let new = |old: &Py<Column>| {
            let found = replaced.iter().find(|(of, _)| of.is(old));
            found.map_or(old, |(_, new)| new).clone_ref(py)
        };
        let columns: Vec<_> = self.3.iter().map(new).collect();
        let numbers = columns.iter().map(|column| column.get().0.clone());
        let tape = self.0.with_numbers(numbers.collect());
        let (program, terms) = (self.1.clone(), self.2.clone());
        Self(Arc::new(tape), program, terms, columns.into())
    }

    /// Number of instructions an evaluation runs.
    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// Sizes of the input groups; the last is the parameters.
    #[getter]
    fn inputs(&self) -> Vec<usize> {
        self.0.inputs().to_vec()
    }

    /// Number of outputs.
    #[getter]
    fn outputs(&self) -> usize {
        self.0.outputs()
    }
}

impl Tape {
    fn of(
        inputs: &[usize],
        outputs: usize,
        program: &[Line],
        columns: Vec<Py<Column>>,
    ) -> PyResult<Self> {
        let held = columns
            .iter()
            .map(|column| column.get().0.clone())
            .collect();
        let tape = tape::Tape::with_columns(inputs, outputs, program, held).map_err(refused)?;
        let program = program::packed(program).into();
        Ok(Self(Arc::new(tape), program, None, columns.into()))
    }
}

/// A term in Python's form: first output, input group, factor and matrix.
type Added = (usize, usize, f64, Py<Rows>);

fn given(py: Python<'_>, terms: &[Added]) -> Vec<Added> {
    let own = |term: &Added| (term.0, term.1, term.2, term.3.clone_ref(py));
    terms.iter().map(own).collect()
}

fn line(row: [i64; 4], value: f64) -> PyResult<Line> {
    let (slot, a, b) = (index(row[1])?, index(row[2])?, index(row[3])?);
    match row[0] {
        INPUT => Ok(Line::Input {
            slot,
            group: a,
            element: b,
        }),
        CONSTANT => Ok(Line::Constant { slot, value }),
        OUTPUT => Ok(Line::Output { slot, element: a }),
        code => match usize::try_from(code)
            .ok()
            .and_then(|code| Op::ALL.get(code))
        {
            Some(&op) => Ok(Line::Apply { op, slot, a, b }),
            None => Err(PyValueError::new_err(format!(
                "there is no operation {code}"
            ))),
        },
    }
}

/// A sparse matrix of constant values.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Rows(pub(crate) Arc<linalg::Rows>);

#[pymethods]
impl Rows {
    /// A matrix from the row, column and value of each entry.
    #[new]
    fn new(
        rows: usize,
        cols: usize,
        row: PyReadonlyArray1<'_, i64>,
        col: PyReadonlyArray1<'_, i64>,
        values: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        if row.len() != values.len() || col.len() != values.len() || u32::try_from(cols).is_err() {
            return Err(PyValueError::new_err(
                "a matrix has a row and a column below 2^32 for each value",
            ));
        }
        linalg::Rows::new(
            (rows, cols),
            &indices(&row)?,
            &indices(&col)?,
            values.as_slice()?,
        )
        .map(|rows| Self(Arc::new(rows)))
        .map_err(refused)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Recipe<'py>> {
        let (py, matrix) = (slf.py(), &slf.get().0);
        let (rows, cols) = matrix.shape();
        let (mut row, mut col, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..rows {
            let (places, found) = matrix.row(i);
            #[allow(clippy::cast_possible_wrap)] // memory has not so many rows
            row.extend(places.iter().map(|_| i as i64));
            col.extend(places.iter().map(|place| i64::from(*place)));
            values.extend_from_slice(found);
        }
        let (row, col) = (PyArray1::from_vec(py, row), PyArray1::from_vec(py, col));
        let values = PyArray1::from_vec(py, values);
        let args = (rows, cols, row, col, values).into_pyobject(py)?;
        Ok((slf.get_type().into_any(), args))
    }
}

pub(crate) fn item<'py>(dict: &Bound<'py, PyDict>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    dict.get_item(name)?
        .ok_or_else(|| PyKeyError::new_err(name.to_owned()))
}

/// The tape of this name.
pub(crate) fn tape_of(tapes: &Bound<'_, PyDict>, name: &str) -> PyResult<tape::Tape> {
    let found = item(tapes, name)?.extract::<PyRef<'_, Tape>>()?.0.clone();
    Ok(tape::Tape::clone(&found))
}

/// The entry of a dictionary by this name as `read` converts it, if there is one.
pub(crate) fn optional<T>(
    dict: &Bound<'_, PyDict>,
    name: &str,
    read: impl FnOnce(&str) -> PyResult<T>,
) -> PyResult<Option<T>> {
    dict.contains(name)?.then(|| read(name)).transpose()
}

pub(crate) fn pattern(value: &Bound<'_, PyAny>) -> PyResult<Pattern> {
    let (rows, cols, row, col): (
        usize,
        usize,
        PyReadonlyArray1<'_, i64>,
        PyReadonlyArray1<'_, i64>,
    ) = value.extract()?;
    if row.len() != col.len() {
        return Err(PyValueError::new_err(
            "a pattern has as many rows as columns of entries",
        ));
    }
    let entries = indices(&row)?.into_iter().zip(indices(&col)?);
    Pattern::new(rows, cols, entries.collect()).map_err(refused)
}

pub(crate) fn indices(values: &PyReadonlyArray1<'_, i64>) -> PyResult<Vec<usize>> {
    values.as_array().iter().map(|x| index(*x)).collect()
}

fn index(x: i64) -> PyResult<usize> {
    usize::try_from(x).map_err(|_| PyValueError::new_err(format!("{x} is not an index")))
}
