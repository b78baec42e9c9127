//! Split polynomial fields: pieces in, runs out.

use crate::convert;
use crate::errors::refused;
use crate::run::Run;
use liouville_core::ensemble::Ensemble;
use liouville_core::method::composition::Composed;
use liouville_core::method::volume::{Observer, Seen, Volume};
use liouville_core::problem::polynomial::{self, Piece, Polynomials, Wave};
use liouville_core::real::{Lanes, Scalar};
use liouville_core::run::{self, Equal};
use liouville_core::tableau::Scheme;
use liouville_core::trouble::Trouble;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

/// How many trajectories advance in lock-step.
const BLOCK: usize = 32;

type Index<'py> = PyReadonlyArray1<'py, i64>;
type Values<'py> = PyReadonlyArray1<'py, f64>;
type Waves<'py> = Vec<(Index<'py>, Values<'py>, f64)>;

/// A field as a sum of pieces.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Split(Arc<polynomial::Split>);

#[pymethods]
impl Split {
    /// Pieces of n variables are tuples, their kind first:
    ///
    ///     ("natural", rows, term_rows, coefficients, factors, waves)
    ///     ("shear", places, direction, term_rows, coefficients, factors, waves)
    ///     ("scaling", rows, term_rows, coefficients, factors)
    ///     ("exponential", rows, rates, monomial)
    ///     ("triangular", order, term_rows, coefficients, factors, a, b)
    ///     ("affine", matrix, vector)
    ///
    /// `factors` has a row for each term, −1 where there are fewer; waves are (places, k, phase).
    #[new]
    fn new(n: usize, pieces: Vec<Bound<'_, PyTuple>>) -> PyResult<Self> {
        let pieces = pieces
            .iter()
            .map(|piece| parsed(n, piece))
            .collect::<PyResult<Vec<_>>>()?;
        let split = polynomial::Split::new(n, pieces).map_err(refused)?;
        Ok(Self(Arc::new(split)))
    }
}

fn parsed(n: usize, piece: &Bound<'_, PyTuple>) -> PyResult<Piece> {
    let kind: String = piece.get_item(0)?.extract()?;
    let rest = piece.get_slice(1, piece.len());
    match kind.as_str() {
        "natural" => {
            let (rows, terms, c, factors, waves): (
                Index<'_>,
                Index<'_>,
                Values<'_>,
                PyReadonlyArray2<'_, i64>,
                Waves<'_>,
            ) = rest.extract()?;
            let rows = convert::indices(&rows)?;
            let change = terms_of(rows.len(), n + waves.len(), &terms, &c, &factors)?;
            let waves = waves_of(&waves)?;
            Ok(Piece::Natural {
                rows,
                change,
                waves,
            })
        }
        "shear" => {
            let (places, direction, terms, c, factors, waves): (
                Index<'_>,
                Values<'_>,
                Index<'_>,
                Values<'_>,
                PyReadonlyArray2<'_, i64>,
                Waves<'_>,
            ) = rest.extract()?;
            Ok(Piece::Shear {
                places: convert::indices(&places)?,
                direction: direction.as_slice()?.to_vec(),
                change: terms_of(1, n + waves.len(), &terms, &c, &factors)?,
                waves: waves_of(&waves)?,
            })
        }
        "scaling" => {
            let (rows, terms, c, factors): (
                Index<'_>,
                Index<'_>,
                Values<'_>,
                PyReadonlyArray2<'_, i64>,
            ) = rest.extract()?;
            let rows = convert::indices(&rows)?;
            let rate = terms_of(rows.len(), n, &terms, &c, &factors)?;
            Ok(Piece::Scaling { rows, rate })
        }
        "exponential" => {
            let (rows, rates, monomial): (Index<'_>, Values<'_>, Index<'_>) = rest.extract()?;
            Ok(Piece::Exponential {
                rows: convert::indices(&rows)?,
                rates: rates.as_slice()?.to_vec(),
                monomial: convert::indices(&monomial)?,
            })
        }
        "triangular" => {
            let (order, terms, c, factors, a, b): (
                Index<'_>,
                Index<'_>,
                Values<'_>,
                PyReadonlyArray2<'_, i64>,
                PyReadonlyArray2<'_, f64>,
                Values<'_>,
            ) = rest.extract()?;
            let order = convert::indices(&order)?;
            let change = terms_of(order.len(), n, &terms, &c, &factors)?;
            let (a, b) = (a.as_slice()?.to_vec(), b.as_slice()?.to_vec());
            Ok(Piece::Triangular {
                order,
                change,
                a,
                b,
            })
        }
        "affine" => {
            let (matrix, vector): (PyReadonlyArray2<'_, f64>, Values<'_>) = rest.extract()?;
            Ok(Piece::Affine {
                matrix: matrix.as_slice()?.to_vec(),
                vector: vector.as_slice()?.to_vec(),
            })
        }
        other => Err(PyValueError::new_err(format!("there is no piece {other:?}"))),
    }
}

fn terms_of(
    rows: usize,
    variables: usize,
    term_rows: &Index<'_>,
    coefficients: &Values<'_>,
    factors: &PyReadonlyArray2<'_, i64>,
) -> PyResult<Polynomials> {
    let term_rows = convert::indices(term_rows)?;
    let width = factors.shape()[1];
    let (coefficients, factors) = (coefficients.as_slice()?, factors.as_slice()?);
    Polynomials::new(rows, variables, &term_rows, coefficients, factors, width).map_err(refused)
}

fn waves_of(waves: &Waves<'_>) -> PyResult<Vec<Wave>> {
    let wave = |(places, k, phase): &(Index<'_>, Values<'_>, f64)| {
        Ok(Wave {
            places: convert::indices(places)?,
            k: k.as_slice()?.to_vec(),
            phase: *phase,
        })
    };
    waves.iter().map(wave).collect()
}

/// What every run of a split field begins with.
struct Begin<'a> {
    split: &'a Arc<polynomial::Split>,
    scheme: Scheme,
    seen: Seen,
    observer: liouville_core::tape::Tape,
    params: &'a [f64],
    /// (t0, t1, steps, every)
    span: (f64, f64, usize, usize),
    is_compensated: bool,
    states: bool,
}

type Single<S> = run::Run<Composed<Volume<S>>, Observer<S>, Equal>;

impl Begin<'_> {
    /// A run of these trajectories, which are rows of n values, in lock-step.
    fn run<S: Scalar>(&self, x: &[&[f64]]) -> Result<Single<S>, Trouble> {
        let (t0, t1, steps, every) = self.span;
        let volume = Volume::<S>::new(self.split.clone(), self.is_compensated);
        let mut start = vec![S::splat(0.0); self.split.n()];
        for (i, value) in start.iter_mut().enumerate() {
            for member in 0..S::MEMBERS {
                // places without a trajectory follow the last one
                value.set_member(member, x[member.min(x.len() - 1)][i]);
            }
        }
        let state = volume.state(&start);
        let observer = Observer::new(
            volume.clone(),
            self.seen.clone(),
            x.len(),
            self.observer.clone(),
            self.params,
            self.states,
        );
        let stepper = Composed::new(volume, &self.scheme);
        let pace = Equal::new(t0, (t1 - t0) / steps as f64, steps);
        run::Run::new(stepper, observer, state, pace, every, steps / every + 2)
    }
}

/// A run about to start, of one trajectory or an ensemble, which are the rows of `x`.
///
/// `seen` is how many variables the user has, and the matrix A of x = A y if y is what is stepped;
/// `span` is (t0, t1, steps, every); `options` are whether sums are compensated and states kept.
/// Returns the run, or the trouble of starting.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (split, scheme, observer, params, x, seen, span, options, threads))]
pub(crate) fn split_run<'py>(
    py: Python<'py>,
    split: PyRef<'py, Split>,
    scheme: &str,
    observer: &convert::Tape,
    params: PyReadonlyArray1<'py, f64>,
    x: PyReadonlyArray2<'py, f64>,
    seen: (usize, Option<PyReadonlyArray2<'py, f64>>),
    span: (f64, f64, usize, usize),
    options: (bool, bool),
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let n = split.0.n();
    let basis = match &seen.1 {
        Some(basis) => Some(basis.as_slice()?.to_vec()),
        None => None,
    };
    let fits = x.shape()[1] == n
        && x.shape()[0] > 0
        && span.2 > 0
        && span.3 > 0
        && seen.0 <= n
        && basis.as_ref().is_none_or(|basis| basis.len() == seen.0 * n)
        && observer.0.inputs() == [1, seen.0, params.len()?];
    if !fits {
        return Err(PyValueError::new_err(format!(
            "trajectories are rows of {n} values, and steps at least one"
        )));
    }
    let scheme = Scheme::named(scheme)
        .ok_or_else(|| PyValueError::new_err(format!("there is no scheme {scheme:?}")))?;
    let begin = Begin {
        split: &split.0,
        scheme,
        seen: Seen { n: seen.0, basis },
        observer: liouville_core::tape::Tape::clone(&observer.0),
        params: params.as_slice()?,
        span,
        is_compensated: options.0,
        states: options.1,
    };
    let width = begin.observer.outputs() + if options.1 { seen.0 } else { 0 };
    let rows: Vec<&[f64]> = x.as_slice()?.chunks(n).collect();
    match threads {
        None => Run::handed(py, begin.run::<f64>(&rows), &[width]),
        Some(threads) => {
            let runs = rows
                .chunks(BLOCK)
                .map(|block| begin.run::<Lanes<BLOCK>>(block))
                .collect::<Result<Vec<_>, _>>();
            let ensemble = runs.map(|runs| Ensemble::new(runs, threads));
            Run::handed(py, ensemble, &[rows.len(), width])
        }
    }
}
