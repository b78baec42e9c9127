//! The derivative of each flow, by the variables, by the coefficients of its piece, and by its length.
//!
//! The derivative of a flow x ↦ x' is a product of elementary linear maps ([`LinearMap`]), of a vector that consists of
//!
//!     dx,   dc, the changes of all coefficients,   dh,   and intermediate results.
//!
//! Tangents go through it forwards, cotangents through its transpose, so each formula is written once. Coefficients and h
//! change nothing but what follows from them, and they are there only where they are wanted.

mod affine;
mod map;
mod pieces;
mod steps;
mod triangular;
mod turn;

use crate::problem::{Formula, Function, Piece, Polynomials, Split};
use affine::AffineFlows;
use liouville_base::error::StepError;
use liouville_base::real::Number;
use liouville_base::tape::Registers;
use liouville_gridded::Memory;
use map::LinearMap;
use std::sync::Arc;
pub(crate) use steps::LinearSteps;

/// The derivatives of the flows of a split.
#[derive(Clone, Debug)]
struct LinearFlows {
    split: Arc<Split>,
    /// Whether by coefficients and h too.
    has_coefficients: bool,
    /// The place of the first coefficient of each piece, and behind those of the last.
    first: Vec<usize>,
    /// Where functions are, and where other intermediate results are; behind the latter the vector ends.
    functions: usize,
    results: usize,
    width: usize,
    scratch: LinearScratch,
}

/// Memory of derivatives.
#[derive(Clone, Debug, Default)]
struct LinearScratch {
    /// The values of variables and functions, the factors of terms, and their places in the vector.
    values: Vec<f64>,
    places: Vec<usize>,
    /// Registers of the value of each tape of a piece, and of its slopes.
    registers: Vec<Vec<Option<[Registers<f64>; 2]>>>,
    arguments: Vec<f64>,
    /// Of stages: K_r and Z_r of each variable of a piece, and which of its variables is each.
    stages: [Vec<f64>; 2],
    order: Vec<usize>,
    affine: AffineFlows,
    /// Memory of each piece that is a plane, and columns of the derivative of its flow.
    planes: Vec<Memory<f64>>,
    columns: Vec<[f64; 2]>,
}

/// A flow whose derivative is wanted.
#[derive(Clone, Copy, Debug)]
struct LinearFlow {
    part: usize,
    is_adjoint: bool,
    t: f64,
    /// Its length, and the derivative of that by the step.
    h: f64,
    weight: f64,
}

/// No place in an order.
const NOWHERE: usize = usize::MAX;

/// How many coefficients a piece has: those of its terms, rates, entries of a matrix row by row and a vector, or the
/// parameters of a plane.
fn coefficients(piece: &Piece, n: usize) -> usize {
    match piece {
        Piece::Natural { change, .. }
        | Piece::Shear { change, .. }
        | Piece::Scaling { rate: change, .. }
        | Piece::Turn { change, .. }
        | Piece::Triangular { change, .. } => change.terms(),
        Piece::Exponential { rates, .. } => rates.len(),
        Piece::Affine { .. } => n * n + n,
        Piece::Plane { plane, .. } => plane.params().len(),
    }
}

/// How many coefficients all pieces have.
pub(crate) fn count_coefficients(split: &Split) -> usize {
    let pieces = split.pieces().iter();
    pieces.map(|piece| coefficients(piece, split.n())).sum()
}

impl LinearFlows {
    fn new(split: Arc<Split>, has_coefficients: bool) -> Self {
        let n = split.n();
        let mut first = vec![n];
        for piece in split.pieces() {
            let own = if has_coefficients {
                coefficients(piece, n)
            } else {
                0
            };
            first.push(first[first.len() - 1] + own);
        }
        let functions = first[first.len() - 1] + 1;
        let most = |count: &dyn Fn(&Piece) -> usize| split.pieces().iter().map(count).max();
        let most_functions = most(&|piece| piece.functions().len()).unwrap_or(0);
        let results = functions + most_functions;
        let width = results + most(&|piece| pieces::results(piece, n)).unwrap_or(0);
        let bound = |function: &Function| match &function.formula {
            Formula::Tape { value, slopes, .. } => Some([value.bind(&[]), slopes.bind(&[])]),
            Formula::Cosine { .. } => None,
        };
        let registers = split.pieces().iter();
        let registers =
            registers.map(|piece| piece.functions().iter().map(bound).collect::<Vec<_>>());
        let scratch = LinearScratch {
            values: vec![0.0; n + most_functions],
            places: (0..n).chain(functions..results).collect(),
            registers: registers.collect(),
            order: vec![NOWHERE; n],
            planes: split.pieces().iter().map(pieces::memory).collect(),
            ..LinearScratch::default()
        };
        Self {
            split,
            has_coefficients,
            first,
            functions,
            results,
            width,
            scratch,
        }
    }

    /// How many numbers the vector has, of which those of the variables are the first.
    fn width(&self) -> usize {
        self.width
    }

    /// Where the numbers of coefficients and h are.
    fn constants(&self) -> std::ops::Range<usize> {
        let end = if self.has_coefficients {
            self.functions
        } else {
            self.split.n()
        };
        self.split.n()..end
    }

    /// The values of the variables.
    fn x(&mut self) -> &mut [f64] {
        &mut self.scratch.values[..self.split.n()]
    }

    /// Makes a flow from where the variables are, and appends its derivative to `map`.
    ///
    /// # Errors
    /// A function is not finite, or the flow cannot be made.
    fn linearise(&mut self, flow: LinearFlow, map: &mut LinearMap) -> Result<(), StepError> {
        let split = Arc::clone(&self.split);
        let piece = &split.pieces()[flow.part];
        self.evaluate(piece, flow, map)?;
        match piece {
            Piece::Natural { rows, change, .. } => self.natural((rows, change), flow, map),
            Piece::Shear {
                places,
                direction,
                change,
                ..
            } => self.shear((places, direction, change), flow, map),
            Piece::Scaling { rows, rate, .. } => self.scaling((rows, rate), flow, map),
            Piece::Exponential {
                rows,
                rates,
                monomial,
                ..
            } => return self.exponential((rows, rates, monomial), flow, map),
            Piece::Triangular {
                order,
                change,
                a,
                b,
            } => {
                let method = (a.as_slice(), b.as_slice());
                if flow.is_adjoint {
                    self.substitution((order, change), method, flow, map);
                } else {
                    self.runge_kutta((order, change), method, flow, map);
                }
            }
            Piece::Turn {
                rows,
                change,
                is_cayley,
                ..
            } => self.turn((rows, change, *is_cayley), flow, map),
            Piece::Affine { matrix, vector } => self.affine((matrix, vector), flow, map),
            Piece::Plane { plane, variables } => {
                return self.plane((plane, variables), flow, map);
            }
        }
        Ok(())
    }

    /// Evaluates the functions of a piece, and appends their derivatives.
    fn evaluate(
        &mut self,
        piece: &Piece,
        flow: LinearFlow,
        map: &mut LinearMap,
    ) -> Result<(), StepError> {
        let n = self.split.n();
        for (q, function) in piece.functions().iter().enumerate() {
            let (at, scratch) = (self.functions + q, &mut self.scratch);
            let x = function.places.iter().map(|place| scratch.values[*place]);
            scratch.arguments.clear();
            scratch.arguments.extend(x);
            map.scale(at, 0.0);
            let registers = &mut scratch.registers[flow.part][q];
            let value = match (&function.formula, registers) {
                (Formula::Cosine { k, phase }, _) => {
                    let terms = k.iter().zip(&scratch.arguments).map(|(k, x)| k * x);
                    let argument = terms.sum::<f64>() + phase;
                    let (sine, cosine) = argument.sin_and_cos();
                    for (place, k) in function.places.iter().zip(k) {
                        map.add(at, *place, -k * sine);
                    }
                    cosine
                }
                (
                    Formula::Tape {
                        value,
                        slopes,
                        output,
                    },
                    Some([own, of_slopes]),
                ) => {
                    let slopes = slopes.eval(of_slopes, [&scratch.arguments]);
                    let slopes = &slopes[output * function.places.len()..];
                    for (place, slope) in function.places.iter().zip(slopes) {
                        map.add(at, *place, *slope);
                    }
                    value.eval(own, [&scratch.arguments])[*output]
                }
                (Formula::Tape { .. }, None) => unreachable!("each tape has its memory"),
            };
            if !value.is_finite() {
                return Err(StepError::Function {
                    piece: flow.part,
                    function: q,
                    member: 0,
                    t: flow.t,
                });
            }
            scratch.values[n + q] = value;
        }
        Ok(())
    }

    /// Appends y[to] += scale d(row), and returns the value of the row; `slot` is the place of the first coefficient.
    fn row(
        &self,
        (to, scale): (usize, f64),
        (rows, row): (&Polynomials, usize),
        slot: usize,
        map: &mut LinearMap,
    ) -> f64 {
        let LinearScratch { values, places, .. } = &self.scratch;
        let mut sum = 0.0;
        for ((c, factors), term) in rows.row(row).zip(rows.first(row)..) {
            let of = |factor: u32| values[factor as usize];
            let mut by = |factor: u32, slope: f64| {
                map.add(to, places[factor as usize], scale * c * slope);
            };
            let product = match *factors {
                [] => 1.0,
                [a] => {
                    by(a, 1.0);
                    of(a)
                }
                [a, b] => {
                    by(a, of(b));
                    by(b, of(a));
                    of(a) * of(b)
                }
                _ => {
                    let product = |factors: &[u32]| factors.iter().map(|f| of(*f)).product::<f64>();
                    for (k, factor) in factors.iter().enumerate() {
                        by(*factor, product(&factors[..k]) * product(&factors[k + 1..]));
                    }
                    product(factors)
                }
            };
            if self.has_coefficients {
                map.add(to, slot + term, scale * product);
            }
            sum += c * product;
        }
        sum
    }

    /// The place of h.
    fn length(&self) -> usize {
        self.functions - 1
    }
}
