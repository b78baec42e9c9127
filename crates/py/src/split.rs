//! Split polynomial fields: pieces in, runs out.

use crate::convert;
use crate::errors::refused;
use crate::run::Run;
use crate::tableau::scheme_named;
use liouville_base::composition::Composed;
use liouville_base::ensemble::{Ensemble, Layout};
use liouville_base::error::StepError;
use liouville_base::real::Lanes;
use liouville_base::run::{self, Advance, Fixed};
use liouville_base::simd::Stored;
use liouville_base::tableau::Scheme;
use liouville_fields::problem::{CosineFactor, Piece, Polynomials};
use liouville_fields::volume::{
    Determinant, Direction, Observer, Plane, Section, UserVariables, Volume,
};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

/// How many trajectories advance in lock-step: many hide what deciding on their next flow costs ...
const BLOCK: usize = 128;
/// ... but where there are few, a block would be mostly empty, or threads would have none.
const SMALL_BLOCK: usize = 16;

type Index<'py> = PyReadonlyArray1<'py, i64>;
type Values<'py> = PyReadonlyArray1<'py, f64>;
type Waves<'py> = Vec<(Index<'py>, Values<'py>, f64)>;

/// A field as a sum of pieces.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Split(Arc<liouville_fields::problem::Split>);

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
        let split = liouville_fields::problem::Split::new(n, pieces).map_err(refused)?;
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
        other => Err(PyValueError::new_err(format!(
            "there is no piece {other:?}"
        ))),
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

fn waves_of(waves: &Waves<'_>) -> PyResult<Vec<CosineFactor>> {
    let wave = |(places, k, phase): &(Index<'_>, Values<'_>, f64)| {
        Ok(CosineFactor {
            places: convert::indices(places)?,
            k: k.as_slice()?.to_vec(),
            phase: *phase,
        })
    };
    waves.iter().map(wave).collect()
}

/// Trajectories in lock-step; places without one follow the last.
fn side_by_side<S: Stored>(x: &[&[f64]]) -> Vec<S> {
    let mut start = vec![S::splat(0.0); x[0].len()];
    for (i, value) in start.iter_mut().enumerate() {
        for member in 0..S::MEMBERS {
            value.set_member(member, x[member.min(x.len() - 1)][i]);
        }
    }
    start
}

/// What every run of a split field begins with.
struct Begin {
    split: Arc<liouville_fields::problem::Split>,
    scheme: &'static Scheme,
    seen: UserVariables,
    observer: liouville_base::tape::Tape,
    params: Vec<f64>,
    /// (t0, t1, steps, every)
    span: (f64, f64, usize, usize),
    is_compensated: bool,
    states: bool,
    /// Rows of n values.
    x: Vec<f64>,
}

type Single<S> = run::Run<Composed<Volume<S>>, Observer<S>, Fixed>;

impl Begin {
    /// What steps all of them.
    fn stepper<S: Stored>(&self, threads: usize) -> Composed<Volume<S>> {
        let volume = Volume::new(self.split.clone(), self.is_compensated).with_threads(threads);
        Composed::new(volume, self.scheme)
    }

    /// A run of these members in lock-step.
    fn run<S: Stored>(
        &self,
        stepper: Composed<Volume<S>>,
        members: &[usize],
    ) -> Result<Single<S>, StepError> {
        let (t0, t1, steps, every) = self.span;
        let volume = stepper.parts();
        let state = volume.state(&side_by_side(&rows_of(&self.x, self.split.n(), members)));
        let observer = Observer::new(
            volume.clone(),
            self.seen.clone(),
            members.len(),
            self.observer.clone(),
            &self.params,
            self.states,
        );
        let control = Fixed::new(t0, (t1 - t0) / steps as f64, steps);
        run::Run::new(stepper, observer, state, control, every, steps / every + 2)
    }

    /// All members, in blocks.
    fn ensemble(self, width: usize, threads: usize) -> Ensemble {
        let members = self.x.len() / self.split.n();
        let block = if members < BLOCK * threads {
            SMALL_BLOCK
        } else {
            BLOCK
        };
        let times = run::times(self.span);
        let t0 = self.span.0;
        let many = self.stepper::<Lanes<BLOCK>>(1);
        let few = self.stepper::<Lanes<SMALL_BLOCK>>(1);
        let begin = move |members: &[usize]| -> Result<Box<dyn Advance + Sync>, StepError> {
            Ok(if members.len() > SMALL_BLOCK {
                Box::new(self.run(many.clone(), members)?)
            } else {
                Box::new(self.run(few.clone(), members)?)
            })
        };
        let layout = Layout::Aligned { times, width };
        Ensemble::new(Box::new(begin), (members, block), threads, layout, t0)
    }
}

/// Rows of these members.
fn rows_of<'a>(x: &'a [f64], n: usize, members: &[usize]) -> Vec<&'a [f64]> {
    let row = |member: &usize| &x[member * n..(member + 1) * n];
    members.iter().map(row).collect()
}

/// A run about to start, of one trajectory or an ensemble, which are the rows of `x`.
///
/// `seen` is how many variables the user has, and the matrix A of x = A y if y is what is stepped;
/// `span` is (t0, t1, steps, every); `options` are whether sums are compensated and states kept.
/// Returns the run, or the error of starting.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (split, scheme, observer, params, x, seen, span, options, threads, is_ensemble))]
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
    threads: usize,
    is_ensemble: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let n = split.0.n();
    let seen = seen_of(&seen, n)?;
    let fits = x.shape()[1] == n
        && x.shape()[0] > 0
        && span.2 > 0
        && span.3 > 0
        && observer.0.inputs() == [1, seen.n, params.len()];
    if !fits {
        return Err(malformed(n));
    }
    let width = observer.0.outputs() + if options.1 { seen.n } else { 0 };
    let begin = Begin {
        split: split.0.clone(),
        scheme: scheme_named(scheme)?,
        seen,
        observer: liouville_base::tape::Tape::clone(&observer.0),
        params: params.as_slice()?.to_vec(),
        span,
        is_compensated: options.0,
        states: options.1,
        x: x.as_slice()?.to_vec(),
    };
    if !is_ensemble {
        let run = begin.run(begin.stepper::<f64>(threads), &[0]);
        return Run::handed(py, run, &[width]);
    }
    let shape = [x.shape()[0], width];
    Run::handed(py, Ok(begin.ensemble(width, threads)), &shape)
}

/// How a plane crosses the border: (normal, offset, period, 1 up or −1 down or 0 both).
type Cut<'py> = (Values<'py>, f64, Option<f64>, i8);

/// Sections of an ensemble, whose trajectories are the rows of `x`, by a plane.
///
/// The records are rows (member, t, x); `span` is (t0, t1, steps), the rest as for `split_run`.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (split, scheme, x, seen, plane, span, is_compensated, threads))]
pub(crate) fn section_run<'py>(
    py: Python<'py>,
    split: PyRef<'py, Split>,
    scheme: &str,
    x: PyReadonlyArray2<'py, f64>,
    seen: (usize, Option<PyReadonlyArray2<'py, f64>>),
    plane: Cut<'py>,
    span: (f64, f64, usize),
    is_compensated: bool,
    threads: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let n = split.0.n();
    let seen = seen_of(&seen, n)?;
    let (normal, offset, period, direction) = plane;
    let plane = Plane {
        normal: normal.as_slice()?.to_vec(),
        offset,
        period,
        direction: match direction {
            1 => Direction::Up,
            -1 => Direction::Down,
            _ => Direction::Both,
        },
    };
    if x.shape()[1] != n || x.shape()[0] == 0 || span.2 == 0 || plane.normal.len() != seen.n {
        return Err(malformed(n));
    }
    let scheme = scheme_named(scheme)?;
    let (width, members) = (2 + seen.n, x.shape()[0]);
    let x = x.as_slice()?.to_vec();
    let many = Volume::<Lanes<SMALL_BLOCK>>::new(split.0.clone(), is_compensated);
    let one = Volume::<f64>::new(split.0.clone(), is_compensated);
    let cut = move |members: &[usize]| -> Result<Box<dyn Advance + Sync>, StepError> {
        let (volume, single) = (many.clone(), one.clone());
        let state = volume.state(&side_by_side(&rows_of(&x, n, members)));
        let scalar = (single.clone(), Composed::new(single, scheme));
        let (seen, plane) = (seen.clone(), plane.clone());
        let observer = Section::new(volume.clone(), scalar, seen, members.to_vec(), plane);
        let control = Fixed::new(span.0, (span.1 - span.0) / span.2 as f64, span.2);
        let stepper = Composed::new(volume, scheme);
        Ok(Box::new(run::Run::new(
            stepper, observer, state, control, 1, 0,
        )?))
    };
    let blocks = (members, SMALL_BLOCK);
    let ensemble = Ensemble::new(Box::new(cut), blocks, threads, Layout::Ragged, span.0);
    Run::handed(py, Ok(ensemble), &[width])
}

/// The variables the user sees.
fn seen_of(seen: &(usize, Option<PyReadonlyArray2<'_, f64>>), n: usize) -> PyResult<UserVariables> {
    let basis = match &seen.1 {
        Some(basis) => Some(basis.as_slice()?.to_vec()),
        None => None,
    };
    let fits = seen.0 <= n && basis.as_ref().is_none_or(|basis| basis.len() == n * n);
    if fits {
        Ok(UserVariables { n: seen.0, basis })
    } else {
        Err(malformed(n))
    }
}

fn malformed(n: usize) -> PyErr {
    PyValueError::new_err(format!(
        "trajectories are rows of {n} values, and steps at least one"
    ))
}

/// A run of one trajectory with the determinants of its steps: rows (x, ln |det|, largest |det − 1|).
///
/// The arguments are as for `split_run`.
#[pyfunction]
#[pyo3(signature = (split, scheme, x, seen, span, is_compensated))]
pub(crate) fn determinant_run<'py>(
    py: Python<'py>,
    split: PyRef<'py, Split>,
    scheme: &str,
    x: PyReadonlyArray1<'py, f64>,
    seen: (usize, Option<PyReadonlyArray2<'py, f64>>),
    span: (f64, f64, usize, usize),
    is_compensated: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let n = split.0.n();
    let (seen, x) = (seen_of(&seen, n)?, x.as_slice()?);
    let (t0, t1, steps, every) = span;
    if x.len() != n || steps == 0 || every == 0 {
        return Err(malformed(n));
    }
    let width = seen.n + 2;
    let stepper = Determinant::new(split.0.clone(), scheme_named(scheme)?, is_compensated);
    let control = Fixed::new(t0, (t1 - t0) / steps as f64, steps);
    let state = stepper.state(x);
    let run = run::Run::new(stepper, seen, state, control, every, steps / every + 2);
    Run::handed(py, run, &[width])
}
