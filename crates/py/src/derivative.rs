//! Derivatives of runs of Schrödinger equations, as Python drives them: from piece to piece.

use crate::caught::{Caught, attending};
use crate::errors::refused;
use crate::operator::Hamiltonian;
use crate::wave_method::DrivenMethod;
use liouville_base::error::StepError;
use liouville_waves::method::{AtNodes, Derivative, Recorder, Sweeper, Wanted};
use numpy::{
    Complex64, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;

/// Record of a run that is to be differentiated: its inputs, and a place for the data of its derivatives.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct WaveRecord(pub(crate) Recorder);

#[pymethods]
impl WaveRecord {
    /// A place for a run whose derivatives by H have a tolerance, or which has none; closed where it is to leave nothing.
    #[new]
    fn new(tolerance: Option<f64>, is_closed: bool) -> Self {
        let open = Recorder::new(tolerance);
        Self(if is_closed { open.closed() } else { open })
    }

    /// Lays out the windows of a run by series in time, before it begins.
    fn lay_out(
        &self,
        py: Python<'_>,
        hamiltonian: PyRef<'_, Hamiltonian>,
        method: DrivenMethod,
        t0: f64,
        times: Vec<f64>,
    ) -> PyResult<()> {
        let unfit = || refused("the parts of an H that depends on time, and times");
        if times.is_empty() {
            return Err(unfit());
        }
        let driven = method.read();
        let sweeper = Sweeper::new(hamiltonian.inner.clone());
        let laid_out = attending(py, || self.0.lay_out(&sweeper, driven, t0, times))?;
        let raised = || hamiltonian.caught.iter().find_map(Caught::take);
        let explained = |error| raised().unwrap_or_else(|| refused(error));
        laid_out.ok_or_else(unfit)?.map_err(explained)
    }

    /// Number of windows.
    fn __len__(&self) -> usize {
        self.0.count()
    }

    /// The times of the nodes of a window.
    fn nodes<'py>(&self, py: Python<'py>, window: usize) -> PyResult<Reals<'py>> {
        self.check(window)?;
        Ok(PyArray1::from_vec(py, self.0.nodes(window)))
    }

    /// Lets H change within a window by polynomials of this degree at least.
    fn raise_degree(&self, window: usize, degree: usize) -> PyResult<()> {
        self.check(window)?;
        self.0.raise(window, degree);
        Ok(())
    }

    /// Takes as many terms in a window as derivatives need, by changes of H at its nodes, columns in units of the largest of
    /// each, or no rows.
    fn lengthen(&self, window: usize, changes: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        self.check(window)?;
        let (nodes, rows) = (self.0.nodes(window).len(), changes.shape()[0]);
        if rows != 0 && rows != nodes {
            return Err(refused("changes of H at each node"));
        }
        if self.0.lengthen(window, changes.as_slice()?) {
            Ok(())
        } else {
            Err(refused("derivatives of a window have no series that ends"))
        }
    }
}

impl WaveRecord {
    fn check(&self, window: usize) -> PyResult<()> {
        if window < self.0.count() {
            Ok(())
        } else {
            Err(refused("there is no such window"))
        }
    }
}

/// The derivatives of a run that is over.
#[pyclass(module = "liouville._core")]
pub(crate) struct WaveDerivative {
    inner: Derivative,
    places: usize,
    groups: usize,
    /// Number of rows of H, at each of which a potential has a value.
    rows: usize,
    /// The cotangent of the state where the last piece begins.
    cotangent: (Vec<f64>, usize),
    caught: Vec<Caught>,
}

/// Real numbers.
type Reals<'py> = Bound<'py, PyArray1<f64>>;

/// States as rows of a matrix.
type States<'py> = Bound<'py, PyArray2<Complex64>>;

#[pymethods]
impl WaveDerivative {
    /// Derivatives of a run with operators in groups of so many, from what it left.
    #[new]
    fn new(
        hamiltonian: PyRef<'_, Hamiltonian>,
        groups: Vec<usize>,
        record: PyRef<'_, WaveRecord>,
        threads: usize,
    ) -> PyResult<Self> {
        let inner = &hamiltonian.inner;
        if groups.contains(&0) || groups.iter().sum::<usize>() != inner.terms().len() {
            return Err(refused("groups have all operators, each at least one"));
        }
        let (signals, mut caught) = (Caught::default(), hamiltonian.caught.clone());
        let sweeper = Sweeper::new(inner.clone()).with_threads(threads);
        let sweeper = sweeper.with_cancel(signals.cancel());
        caught.push(signals);
        Ok(Self {
            inner: Derivative::new(&sweeper, &groups, &record.0),
            places: inner.places(),
            groups: groups.len(),
            rows: inner.size(),
            cotangent: (vec![0.0; 2 * inner.places()], 0),
            caught,
        })
    }

    /// Adds steps of shears of an H without time, from t on, as one piece and one step.
    fn add_shears(
        &mut self,
        coefficients: PyReadonlyArray1<'_, f64>,
        shift: f64,
        t: f64,
        h: f64,
        steps: usize,
    ) -> PyResult<()> {
        self.inner
            .add_shears(coefficients.as_slice()?, shift, (t, h), steps);
        Ok(())
    }

    /// Number of pieces.
    fn __len__(&self) -> usize {
        self.inner.count()
    }

    /// How many steps of the run end in a piece, and the times of its nodes.
    fn piece<'py>(
        &self,
        py: Python<'py>,
        piece: usize,
    ) -> PyResult<(usize, Bound<'py, PyArray1<f64>>)> {
        self.check(piece)?;
        let (steps, nodes) = self.inner.piece(piece);
        Ok((steps, PyArray1::from_slice(py, nodes)))
    }

    /// Makes the shears of an H without time from the state where they begin, and keeps what derivatives by H take.
    fn keep_ends(
        &mut self,
        py: Python<'_>,
        state: PyReadonlyArray2<'_, Complex64>,
    ) -> PyResult<()> {
        let mut rows = self.flat(&state)?;
        let [state] = &mut rows[..] else {
            return Err(refused("one state"));
        };
        let inner = &mut self.inner;
        let made = py.detach(|| inner.keep_ends(state));
        made.map_err(|error| self.explained(error))
    }

    /// The state where a piece ends and at the ends of its steps, from that where it begins, with weights and potential of
    /// H changed at its nodes, a row for each node, or no rows.
    fn repeat<'py>(
        &mut self,
        py: Python<'py>,
        piece: usize,
        state: PyReadonlyArray2<'py, Complex64>,
        weights: PyReadonlyArray2<'py, f64>,
        potential: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(States<'py>, States<'py>)> {
        self.check(piece)?;
        let mut rows = self.flat(&state)?;
        let change = self.at_nodes(piece, weights.as_slice()?, potential.as_slice()?)?;
        let [state] = &mut rows[..] else {
            return Err(refused("one state"));
        };
        let inner = &mut self.inner;
        let found = py.detach(|| inner.repeat(piece, state, &change));
        let found = found.map_err(|error| self.explained(error))?;
        Ok((self.complex(py, &rows)?, self.complex(py, &found)?))
    }

    /// Changes of the state where a piece ends, a row for each direction, and at the ends of its steps, from those where
    /// it begins and those of the weights and of the potential, of each direction a row for each node, or no rows.
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        piece: usize,
        changes: PyReadonlyArray2<'py, Complex64>,
        weights: PyReadonlyArray3<'py, f64>,
        potential: PyReadonlyArray3<'py, f64>,
    ) -> PyResult<(States<'py>, States<'py>)> {
        self.check(piece)?;
        let mut rows = self.flat(&changes)?;
        let count = rows.len();
        if count == 0 || weights.shape()[0] != count || potential.shape()[0] != count {
            return Err(refused("changes of H for each direction"));
        }
        let (weights, potential) = (weights.as_slice()?, potential.as_slice()?);
        let of = |values: &[f64], row: usize| {
            let each = values.len() / count;
            row * each..(row + 1) * each
        };
        let of_nodes: PyResult<Vec<AtNodes>> = (0..count)
            .map(|row| {
                let (own, of_points) = (of(weights, row), of(potential, row));
                self.at_nodes(piece, &weights[own], &potential[of_points])
            })
            .collect();
        let (inner, of_nodes) = (&mut self.inner, of_nodes?);
        let found = py.detach(|| inner.follow(piece, &mut rows, &of_nodes));
        let found = found.map_err(|error| self.explained(error))?;
        Ok((self.complex(py, &rows)?, self.complex(py, &found)?))
    }

    /// Goes back through pieces from `end` to `first`, those behind them before: the cotangents of the weights of H and of
    /// the potential at their nodes, where they are wanted, given those of the states where these steps end, counted
    /// through the run and increasing; all others are zero.
    fn pull<'py>(
        &mut self,
        py: Python<'py>,
        pieces: (usize, usize),
        steps: Vec<usize>,
        of_steps: PyReadonlyArray2<'py, Complex64>,
        wanted: (bool, bool),
    ) -> PyResult<(Reals<'py>, Reals<'py>)> {
        let ((first, end), count) = (pieces, self.inner.count());
        if end == count {
            self.cotangent = (vec![0.0; 2 * self.places], count);
        }
        if first > end || self.cotangent.1 != end {
            return Err(refused("pieces from the last to the first"));
        }
        let rows = self.flat(&of_steps)?;
        if rows.len() != steps.len() {
            return Err(refused("a cotangent for each of the steps"));
        }
        let (weights, potential) = wanted;
        let wanted = Wanted { weights, potential };
        let (inner, cotangent) = (&mut self.inner, &mut self.cotangent);
        let found = py.detach(|| inner.pull(first..end, &mut cotangent.0, (&steps, &rows), wanted));
        let found = found.map_err(|error| self.explained(error))?;
        self.cotangent.1 = first;
        let weights = PyArray1::from_vec(py, found.weights);
        Ok((weights, PyArray1::from_vec(py, found.potential)))
    }

    /// The cotangent of the state where the piece begins that was gone through last.
    #[getter]
    fn cotangent<'py>(&self, py: Python<'py>) -> PyResult<States<'py>> {
        self.complex(py, std::slice::from_ref(&self.cotangent.0))
    }
}

impl WaveDerivative {
    fn check(&self, piece: usize) -> PyResult<()> {
        if piece < self.inner.count() {
            Ok(())
        } else {
            Err(refused("there is no such piece"))
        }
    }

    /// Changes of the weights and of the potential at the nodes of a piece, which may be none.
    fn at_nodes(&self, piece: usize, weights: &[f64], potential: &[f64]) -> PyResult<AtNodes> {
        let nodes = self.inner.piece(piece).1.len();
        let fits = |values: &[f64], each: usize| values.is_empty() || values.len() == nodes * each;
        if fits(weights, self.groups) && fits(potential, self.rows) {
            Ok(AtNodes {
                weights: weights.to_vec(),
                potential: potential.to_vec(),
            })
        } else {
            Err(refused(
                "changes of all weights, or of the potential at all places, at each node",
            ))
        }
    }

    /// Rows of complex numbers as real parts, then imaginary parts.
    fn flat(&self, rows: &PyReadonlyArray2<'_, Complex64>) -> PyResult<Vec<Vec<f64>>> {
        if rows.shape()[1] != self.places {
            return Err(refused("states are rows of all places"));
        }
        let of_row = |row: &[Complex64]| {
            let real = row.iter().map(|z| z.re);
            real.chain(row.iter().map(|z| z.im)).collect()
        };
        Ok(rows.as_slice()?.chunks(self.places).map(of_row).collect())
    }

    fn complex<'py>(&self, py: Python<'py>, rows: &[Vec<f64>]) -> PyResult<States<'py>> {
        let of_row = |row: &Vec<f64>| {
            let (q, p) = row.split_at(self.places);
            let pairs = q.iter().zip(p);
            pairs
                .map(|(q, p)| Complex64::new(*q, *p))
                .collect::<Vec<_>>()
        };
        let values = rows.iter().flat_map(of_row).collect();
        PyArray1::from_vec(py, values).reshape([rows.len(), self.places])
    }

    /// The exception of a function that makes products or of a signal, or else this error.
    fn explained(&self, error: StepError) -> PyErr {
        let raised = self.caught.iter().find_map(Caught::take);
        raised.unwrap_or_else(|| match error {
            StepError::NoMemory => PyMemoryError::new_err("the terms of a window do not fit"),
            error => refused(error),
        })
    }
}
