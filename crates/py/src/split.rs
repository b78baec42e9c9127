//! Split polynomial fields, and their jobs: pieces and start values in, a run out.

use crate::convert::{self, Values};
use crate::errors::refused;
use crate::gridded::Plane;
use crate::job::{Watch, detection};
use crate::tableau::scheme_named;
use liouville_base::run::{Advance, Span, StartError};
use liouville_base::tape::Tape;
use liouville_fields::problem::{Formula, Function, Piece, Polynomials};
use liouville_fields::run::{self, Method, Recorded};
use liouville_fields::volume::{self, Direction, UserVariables};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::Arc;

type Index<'py> = PyReadonlyArray1<'py, i64>;

/// A function among the factors of terms, with the variables that it depends on.
#[derive(FromPyObject)]
enum Factor<'py> {
    /// cos(k · x + phase)
    Cosine(Index<'py>, Values<'py>, f64),
    /// A tape, another of its partial derivatives, and the number of its output.
    Tape(
        Index<'py>,
        PyRef<'py, convert::Tape>,
        PyRef<'py, convert::Tape>,
        usize,
    ),
}

/// A field as a sum of pieces.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Split(Arc<liouville_fields::problem::Split>);

#[pymethods]
impl Split {
    /// Pieces of n variables are tuples, their kind first:
    ///
    ///     ("natural", rows, term_rows, coefficients, factors, functions)
    ///     ("shear", places, direction, term_rows, coefficients, factors, functions)
    ///     ("scaling", rows, term_rows, coefficients, factors, functions)
    ///     ("exponential", rows, rates, monomial, functions)
    ///     ("triangular", order, term_rows, coefficients, factors, a, b)
    ///     ("affine", matrix, vector)
    ///     ("turn", rows, term_rows, coefficients, factors, functions, is_cayley)
    ///     ("plane", plane, variables)
    ///
    /// `factors` has a row for each term, −1 where there are fewer; functions are cosines (places, k, phase), or tapes
    /// (places, value, slopes, output).
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
            let (rows, change, functions) = rows_of(n, &rest)?;
            Ok(Piece::Natural {
                rows,
                change,
                functions,
            })
        }
        "shear" => {
            let (places, direction, terms, c, factors, functions): (
                Index<'_>,
                Values<'_>,
                Index<'_>,
                Values<'_>,
                PyReadonlyArray2<'_, i64>,
                Vec<Factor<'_>>,
            ) = rest.extract()?;
            Ok(Piece::Shear {
                places: convert::indices(&places)?,
                direction: direction.as_slice()?.to_vec(),
                change: terms_of(1, n + functions.len(), &terms, &c, &factors)?,
                functions: functions_of(&functions)?,
            })
        }
        "scaling" => {
            let (rows, rate, functions) = rows_of(n, &rest)?;
            Ok(Piece::Scaling {
                rows,
                rate,
                functions,
            })
        }
        "exponential" => {
            let (rows, rates, monomial, functions): (
                Index<'_>,
                Values<'_>,
                Index<'_>,
                Vec<Factor<'_>>,
            ) = rest.extract()?;
            Ok(Piece::Exponential {
                rows: convert::indices(&rows)?,
                rates: rates.as_slice()?.to_vec(),
                monomial: convert::indices(&monomial)?,
                functions: functions_of(&functions)?,
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
        "turn" => turn_of(n, &rest),
        "plane" => {
            let (plane, variables): (PyRef<'_, Plane>, Index<'_>) = rest.extract()?;
            Ok(Piece::Plane {
                plane: plane.0.clone(),
                variables: convert::indices(&variables)?,
            })
        }
        other => Err(PyValueError::new_err(format!(
            "there is no piece {other:?}"
        ))),
    }
}

/// A turn of three variables.
fn turn_of(n: usize, piece: &Bound<'_, PyTuple>) -> PyResult<Piece> {
    let (rows, terms, c, factors, functions, is_cayley): (
        Index<'_>,
        Index<'_>,
        Values<'_>,
        PyReadonlyArray2<'_, i64>,
        Vec<Factor<'_>>,
        bool,
    ) = piece.extract()?;
    Ok(Piece::Turn {
        rows: convert::indices(&rows)?,
        change: terms_of(6, n + functions.len(), &terms, &c, &factors)?,
        functions: functions_of(&functions)?,
        is_cayley,
    })
}

/// Rows, what is of each, and the functions among the factors.
fn rows_of(
    n: usize,
    piece: &Bound<'_, PyTuple>,
) -> PyResult<(Vec<usize>, Polynomials, Vec<Function>)> {
    let (rows, terms, c, factors, functions): (
        Index<'_>,
        Index<'_>,
        Values<'_>,
        PyReadonlyArray2<'_, i64>,
        Vec<Factor<'_>>,
    ) = piece.extract()?;
    let rows = convert::indices(&rows)?;
    let change = terms_of(rows.len(), n + functions.len(), &terms, &c, &factors)?;
    Ok((rows, change, functions_of(&functions)?))
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

fn functions_of(functions: &[Factor<'_>]) -> PyResult<Vec<Function>> {
    let function = |factor: &Factor<'_>| {
        let (places, formula) = match factor {
            Factor::Cosine(places, k, phase) => {
                let (k, phase) = (k.as_slice()?.to_vec(), *phase);
                (places, Formula::Cosine { k, phase })
            }
            Factor::Tape(places, value, slopes, output) => {
                let [value, slopes] = [value, slopes].map(|tape| Arc::clone(&tape.0));
                let output = *output;
                let formula = Formula::Tape {
                    value,
                    slopes,
                    output,
                };
                (places, formula)
            }
        };
        let places = convert::indices(places)?;
        Ok(Function { places, formula })
    };
    functions.iter().map(function).collect()
}

/// A method, by the attributes of its dataclass.
#[derive(FromPyObject)]
struct FieldMethod {
    composition: String,
    compensated: bool,
}

/// Records: outputs of a tape, points where trajectories pass a plane (normal, offset, period, 1 up or −1 down or 0
/// both), or "determinants".
#[derive(FromPyObject)]
enum RecordedOf<'py> {
    Observables(PyRef<'py, convert::Tape>),
    Section(Values<'py>, f64, Option<f64>, i8),
    Named(String),
}

/// A job, by the attributes of its dataclass: `start` has rows of values, `seen` is how many variables the user has,
/// and the matrix A of x = A y if y is what is stepped; `tangents` are directions, rows of values too, and behind these,
/// where they are wanted, changes of all coefficients in the order of pieces, of the step size, and of the time of the
/// start; `varied` are the
/// splits of members, where these have different parameters; `watch` has given times and events, whose functions are of (t, x, params).
#[derive(FromPyObject)]
struct FieldJob<'py> {
    start: (PyReadonlyArray2<'py, f64>,),
    varied: Vec<PyRef<'py, Split>>,
    params: PyReadonlyArrayDyn<'py, f64>,
    seen: (usize, Option<PyReadonlyArray2<'py, f64>>),
    tangents: Option<PyReadonlyArray2<'py, f64>>,
    span: (f64, f64, usize, usize),
    watch: Option<Watch<'py>>,
    observer: RecordedOf<'py>,
    states: bool,
    threads: usize,
    is_ensemble: bool,
}

impl FieldJob<'_> {
    fn read(&self, n: usize) -> PyResult<run::Job> {
        let x = &self.start.0;
        if x.shape()[1] != n {
            return Err(refused(format!("trajectories are rows of {n} values")));
        }
        let basis = self.seen.1.as_ref();
        let basis = basis.map(|basis| basis.as_slice().map(<[f64]>::to_vec));
        let (mut directions, mut constants, mut starts) = (Vec::new(), Vec::new(), Vec::new());
        if let Some(rows) = &self.tangents {
            for row in rows.as_slice()?.chunks(rows.shape()[1].max(1)) {
                let (own, rest) = row.split_at(n.min(row.len()));
                directions.extend_from_slice(own);
                if let Some((start, rest)) = rest.split_last() {
                    constants.extend_from_slice(rest);
                    starts.push(*start);
                }
            }
        }
        let (t0, t1, steps, every) = self.span;
        let watch = self.watch.as_ref().map(detection).transpose()?;
        let (times, events) = match watch {
            Some(watch) => (watch.times.unwrap_or_default(), watch.events),
            None => (Vec::new(), Vec::new()),
        };
        Ok(run::Job {
            x: x.as_slice()?.to_vec(),
            members: self.is_ensemble.then(|| x.shape()[0]),
            varied: self.varied.iter().map(|split| split.0.clone()).collect(),
            variables: UserVariables {
                n: self.seen.0,
                basis: basis.transpose()?,
            },
            span: Span {
                t0,
                t1,
                steps,
                every,
            },
            recorded: self.recorded()?,
            times,
            events: (events.into_iter())
                .map(|event| (event.tape, event.rule))
                .collect(),
            directions,
            constants,
            starts,
            threads: self.threads,
        })
    }

    fn recorded(&self) -> PyResult<Recorded> {
        match &self.observer {
            RecordedOf::Observables(tape) => Ok(Recorded::Observables {
                tape: Tape::clone(&tape.0),
                params: self.params.as_slice()?.to_vec(),
                states: self.states,
            }),
            RecordedOf::Section(normal, offset, period, direction) => {
                Ok(Recorded::Section(volume::Plane {
                    normal: normal.as_slice()?.to_vec(),
                    offset: *offset,
                    period: *period,
                    direction: match direction {
                        1 => Direction::Up,
                        -1 => Direction::Down,
                        _ => Direction::Both,
                    },
                }))
            }
            RecordedOf::Named(name) if name == "determinants" => Ok(Recorded::Determinants),
            RecordedOf::Named(name) => Err(refused(format!("there is no record of {name:?}"))),
        }
    }
}

/// A run of a split field.
pub(crate) fn start(
    split: &Split,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
) -> PyResult<Result<Box<dyn Advance>, StartError>> {
    let (method, job) = read(split, method, job)?;
    Ok(run::start(split.0.clone(), method, job))
}

/// The pullback of such a run.
pub(crate) fn pullback(
    split: &Split,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
) -> PyResult<Result<run::Pullback, StartError>> {
    let (method, job) = read(split, method, job)?;
    Ok(run::Pullback::new(split.0.clone(), method, job))
}

fn read(
    split: &Split,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
) -> PyResult<(Method, run::Job)> {
    let method: FieldMethod = method.extract()?;
    let method = Method {
        scheme: scheme_named(&method.composition)?,
        is_compensated: method.compensated,
    };
    Ok((method, job.extract::<FieldJob<'_>>()?.read(split.0.n())?))
}
