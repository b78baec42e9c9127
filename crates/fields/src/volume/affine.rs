//! The flow of x' = A x + c:
//!
//!     (x; 1) ↦ exp(h M) (x; 1),   M = (A c; 0 0),
//!
//! as the change D = exp(h M) − 1, by the Padé approximation of order 14, 2 U / (V − U) with odd and
//! even parts U and V, and repeated squaring D ← 2 D + D². Source: higham2005.

#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::order::Order;
use super::rows::{PolynomialRows, narrow};
use super::state::State;
use super::views::{FlowOf, add};
use liouville_base::linalg::{Lu, Matrix, combine, max_norm};
use liouville_base::simd::{ForEach, Kernel, SimdView, SimdViews};

/// An affine piece.
#[derive(Clone, Debug)]
pub(super) struct Affine {
    /// M in the order of places.
    generator: Matrix,
}

/// For matrices of this norm the approximation is exact to roundoff.
const LARGEST_NORM: f64 = 0.95;
/// Coefficients of the Padé approximation.
const PADE: [f64; 8] = [
    17_297_280.0,
    8_648_640.0,
    1_995_840.0,
    277_200.0,
    25_200.0,
    1_512.0,
    56.0,
    1.0,
];

impl Affine {
    pub(super) fn new(order: &Order, n: usize, matrix: &[f64], vector: &[f64]) -> Self {
        let entry = |i: usize, j: usize| match (i, j) {
            (i, _) if i == n => 0.0,
            (i, j) if j == n => vector[order.variable_at(i)],
            (i, j) => matrix[order.variable_at(i) * n + order.variable_at(j)],
        };
        Self {
            generator: Matrix::from_fn(n + 1, n + 1, entry),
        }
    }

    /// The change of each variable in a flow of length `h`, as rows.
    pub(super) fn change(&self, h: f64) -> PolynomialRows {
        let n = self.generator.rows() - 1;
        let change = exponential_less_one(&self.generator, h);
        let mut rows = PolynomialRows::default();
        for i in 0..n {
            let row = change.row(i);
            let entries = row[..n]
                .iter()
                .enumerate()
                .filter(|(_, entry)| **entry != 0.0);
            let linear = entries.map(|(j, entry)| (*entry, vec![narrow(j)]));
            let terms: Vec<_> = std::iter::once((row[n], Vec::new()))
                .chain(linear)
                .collect();
            rows.push(i, &terms);
        }
        rows
    }
}

/// exp(h M) − 1
pub(super) fn exponential_less_one(generator: &Matrix, h: f64) -> Matrix {
    let n = generator.rows();
    let row_sum = |i| generator.row(i).iter().map(|x| (h * x).abs()).sum();
    let sums: Vec<f64> = (0..n).map(row_sum).collect();
    let norm = max_norm(&sums);
    let mut squarings = 0;
    let mut scale = 1.0;
    while norm * scale > LARGEST_NORM && squarings < 1100 {
        squarings += 1;
        scale *= 0.5;
    }
    let b = Matrix::from_fn(n, n, |i, j| generator[(i, j)] * h * scale);
    let mut change = approximation(&b);
    for _ in 0..squarings {
        let square = product(&change, &change);
        change = Matrix::from_fn(n, n, |i, j| 2.0 * change[(i, j)] + square[(i, j)]);
    }
    change
}

/// exp(B) − 1 for a small B.
fn approximation(b: &Matrix) -> Matrix {
    let n = b.rows();
    let one = |i: usize, j: usize| f64::from(u8::from(i == j));
    let b2 = product(b, b);
    let b4 = product(&b2, &b2);
    let b6 = product(&b4, &b2);
    let even = |c: [f64; 4]| {
        Matrix::from_fn(n, n, |i, j| {
            let at = (i, j);
            c[0] * one(i, j) + c[1] * b2[at] + c[2] * b4[at] + c[3] * b6[at]
        })
    };
    let u = product(b, &even([PADE[1], PADE[3], PADE[5], PADE[7]]));
    let v = even([PADE[0], PADE[2], PADE[4], PADE[6]]);
    let mut lu = Lu::new(n);
    for (out, (v, u)) in lu
        .matrix_mut()
        .flat_mut()
        .iter_mut()
        .zip(v.flat().iter().zip(u.flat()))
    {
        *out = v - u;
    }
    if lu.factor().is_err() {
        // factors fail only for numbers that are not finite, which the check of the state reports
        return Matrix::from_fn(n, n, |_, _| f64::NAN);
    }
    let mut change = Matrix::zeros(n, n);
    let mut column = vec![0.0; n];
    for j in 0..n {
        for i in 0..n {
            column[i] = 2.0 * u[(i, j)];
        }
        lu.solve(&mut column);
        for i in 0..n {
            change[(i, j)] = column[i];
        }
    }
    change
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut out = Matrix::zeros(a.rows(), b.cols());
    combine(out.flat_mut(), a, b, |_, _, _| ());
    out
}

/// x += change
struct AddAffine<'a, S> {
    change: &'a [S],
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for AddAffine<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let change = view.load(self.change, 0);
        add(view, self.state.parts(), 0, change);
        true
    }
}

/// The change of each variable.
pub(super) struct AffineChange<'a>(pub(super) &'a PolynomialRows);

impl<S> Kernel<S> for FlowOf<'_, S, AffineChange<'_>> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self { state, scratch, .. } = self;
        self.piece.0.set(views, &state.x, &mut scratch.change);
        let change = scratch.change.as_slice();
        views.each(change.len(), &mut AddAffine { change, state });
    }
}
