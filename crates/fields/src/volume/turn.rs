//! The flow of v' = w × v + e with w and e that stand still: with S = |w|, θ = S h and t = θ²,
//!
//!     v1 = v + h e + w × (a v + b e + w × (b v + k e)),
//!     a = sin θ/S,   b = (1 − cos θ)/S²,   k = (h − a)/S²,
//!
//! or for a w of |v|, which is constant then, without e. The matrix of v is a rotation: its determinant is 1. Boris's turn,
//! Cayley's map, has a = h/(1 + t/4), b = h a/2 and no e. Sources: he2015, qin2013.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::layout::SplitLayout;
use super::rows::PolynomialRows;
use super::state::State;
use super::views::{FlowOf, add, value};
use crate::problem::Polynomials;
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews};

/// A turn of three variables.
#[derive(Clone, Debug)]
pub(super) struct Turn {
    /// Their places.
    places: Vec<usize>,
    /// The rows of w, then those of e, that are not zero.
    rows: PolynomialRows,
    is_pushed: bool,
    is_cayley: bool,
}

impl Turn {
    pub(super) fn new(
        layout: &SplitLayout<'_>,
        rows: &[usize],
        change: &Polynomials,
        is_cayley: bool,
    ) -> Self {
        let has_terms = |row: &usize| change.row(*row).next().is_some();
        let own: Vec<(usize, usize)> = (0..6).filter(has_terms).map(|row| (row, row)).collect();
        Self {
            places: rows.iter().map(|row| layout.place(*row) as usize).collect(),
            is_pushed: own.iter().any(|(row, _)| *row >= 3),
            rows: PolynomialRows::new(change, &own, |factor| layout.place(factor), false),
            is_cayley,
        }
    }
}

/// A vector.
type Three<N> = [N; 3];

struct TurnFlow<'a, S> {
    piece: &'a Turn,
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for TurnFlow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let Self { piece, h, state } = self;
        let h = *h;
        let mut rates = [view.constant(0.0); 6];
        for (run, program) in piece.rows.iter() {
            rates[run.place] = value(view, program, &state.x);
        }
        // of h w and h e: a product with a rounded h² would change |v| by the same part in every step
        let [w0, w1, w2, e0, e1, e2] = rates.map(
            #[inline(always)]
            |rate| rate.scaled(h),
        );
        let (w, e) = ([w0, w1, w2], [e0, e1, e2]);
        let mut v = [view.constant(0.0); 3];
        for (v, place) in v.iter_mut().zip(&piece.places) {
            *v = view.load(&state.x, *place);
        }
        let t = w0 * w0 + w1 * w1 + w2 * w2;
        let change = if piece.is_cayley {
            let a = view.constant(1.0) / (view.constant(1.0) + t.scaled(0.25));
            cross(w, plus(times(v, a), cross(w, times(v, a.scaled(0.5)))))
        } else {
            let [a, b, k] = parts(t);
            let (mut outer, mut inner) = (times(v, a), times(v, b));
            if piece.is_pushed {
                outer = plus(outer, times(e, b));
                inner = plus(inner, times(e, k));
            }
            cross(w, plus(outer, cross(w, inner)))
        };
        for (k, &place) in piece.places.iter().enumerate() {
            let change = if piece.is_pushed {
                change[k] + e[k]
            } else {
                change[k]
            };
            add(view, state.parts(), place, change);
        }
        true
    }
}

#[inline(always)]
fn cross<N: Number>(a: Three<N>, b: Three<N>) -> Three<N> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn plus<N: Number>(a: Three<N>, b: Three<N>) -> Three<N> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn times<N: Number>(a: Three<N>, by: N) -> Three<N> {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// Below this t = θ² the series are exact to roundoff.
const SMALL: f64 = 4.0;
/// Their terms.
const TERMS: usize = 12;
const SECOND: [f64; TERMS] = {
    let mut found = inverse_factorials(2);
    // 1/24 as 1/6 is rounded: roundings that do not fit would change |v| by the same part in every step
    found[1] = 0.125 - 1.0 / 6.0;
    found
};
const THIRD: [f64; TERMS] = inverse_factorials(3);

/// (−1)^k/(2 k + first)!
const fn inverse_factorials(first: usize) -> [f64; TERMS] {
    let mut found = [0.0; TERMS];
    let (mut factorial, mut n, mut sign, mut k) = (1.0, 1, 1.0, 0);
    while k < TERMS {
        while n <= first + 2 * k {
            factorial *= n as f64;
            n += 1;
        }
        found[k] = sign / factorial;
        sign = -sign;
        k += 1;
    }
    found
}

/// sin θ/θ, (1 − cos θ)/θ² and (θ − sin θ)/θ³ of t = θ², each trajectory by its own formula.
#[inline(always)]
pub(super) fn parts<N: Number>(t: N) -> Three<N> {
    let square = t * t;
    let (second, third) = (series(t, square, &SECOND), series(t, square, &THIRD));
    let one = t.like(1.0);
    let near = [one - t * third, second, third];
    if t.is_below(SMALL) {
        return near;
    }
    let inverse = t.inverse_root(2);
    let (sine, cosine) = (t * inverse).scaled(0.5).sin_and_cos();
    let first = (sine * cosine * inverse).scaled(2.0);
    let second = (sine * inverse) * (sine * inverse);
    let far = [first, second.scaled(2.0), (one - first) / t];
    let bound = t.like(SMALL);
    [0, 1, 2].map(
        #[inline(always)]
        |k| t.if_less(bound, near[k], far[k]),
    )
}

#[inline(always)]
fn series<N: Number>(t: N, square: N, coefficients: &[f64; TERMS]) -> N {
    let mut sum = t.like(0.0);
    for pair in coefficients.rchunks_exact(2) {
        sum = sum * square + (t.like(pair[0]) + t.scaled(pair[1]));
    }
    sum
}

impl<S> Kernel<S> for FlowOf<'_, S, &Turn> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            piece, h, state, ..
        } = self;
        views.one_narrow(&mut TurnFlow { piece, h, state });
    }
}
