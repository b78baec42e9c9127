//! Chebyshev series of the propagator:
//!
//!     ψ(t + h) = e^{−iσh} Σ_k (2 − δ_k0) (−i)^k J_k(βh) T_k(G) ψ(t),   G = (H − σ)/β,
//!
//! with σ the middle of the bounds of the spectrum and β half their distance.
//!
//! T_{k+1} = 2 G T_k − T_{k−1} overwrites T_{k−1}: even and odd k take turns in two arrays. Even terms are
//! real multiples of the start of the series, odd ones imaginary; a real ψ thus needs one recurrence of
//! real vectors, any other ψ two, one after another. Within the bounds no T_k(G) u is longer than u;
//! one that is tells of a spectrum that reaches out of them. Source: talezer1984.

use super::bessel::series;
use super::{Move, Sweeper, Wave, guard, refuse, squares};
use crate::problem::Update;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// Tolerance of rounding errors in the length of T_k(G) u, relative to that of u.
const GROWTH: f64 = 1.01;

/// Moves between two checks of the length of T_k(G) u.
const AT_ONCE: usize = 128;

/// The coefficients of steps of one length.
#[derive(Clone, Debug)]
struct Series {
    h: f64,
    c: Vec<f64>,
}

/// Step lengths whose coefficients are kept.
const KEPT: usize = 8;

/// Steps by Chebyshev series.
#[derive(Clone)]
pub struct Chebyshev<S> {
    sweeper: Sweeper<S>,
    sigma: f64,
    beta: f64,
    rate: f64,
    guard: f64,
    is_doubled: bool,
    kept: Vec<Series>,
    moves: Vec<Move>,
    /// T_k(G) u of even k, and of odd k.
    turns: [Vec<S>; 2],
    /// The next ψ: real and imaginary part.
    next: [Vec<S>; 2],
}

impl<S: Stored> Chebyshev<S> {
    /// Series for a spectrum within bounds, off by `rate` in each unit of time; the norm may be off by
    /// `guard`, relatively, before a state is refused.
    ///
    /// # Panics
    /// When the bounds are not in order.
    pub fn new(sweeper: Sweeper<S>, bounds: (f64, f64), rate: f64, guard: f64) -> Self {
        let mut series = Self {
            sweeper,
            sigma: 0.0,
            beta: 0.0,
            rate,
            guard,
            is_doubled: false,
            kept: Vec::new(),
            moves: Vec::new(),
            turns: [Vec::new(), Vec::new()],
            next: [Vec::new(), Vec::new()],
        };
        series.set_bounds(bounds);
        series
    }

    /// The same for a Hermitian H = A + iB, of which the sweeper knows [[A, −B], [B, A]] by its products
    /// with (q, p): the terms are complex vectors then.
    #[must_use]
    pub fn hermitian(self) -> Self {
        let is_doubled = true;
        Self { is_doubled, ..self }
    }

    /// The sweeper of the products.
    pub fn sweeper_mut(&mut self) -> &mut Sweeper<S> {
        &mut self.sweeper
    }

    /// Changes the bounds of the spectrum, between two steps.
    ///
    /// # Panics
    /// When they are not in order.
    pub fn set_bounds(&mut self, (low, high): (f64, f64)) {
        assert!(low <= high, "bounds of a spectrum: {low}, {high}");
        self.sigma = f64::midpoint(low, high);
        // a spectrum of one number is known to rounding errors
        let least = (8.0 * f64::EPSILON * self.sigma.abs()).max(1e-290);
        self.beta = (0.5 * (high - low)).max(least);
        self.kept.clear();
    }

    /// The place of the coefficients for a step of h.
    fn series_for(&mut self, h: f64) -> usize {
        if let Some(place) = self
            .kept
            .iter()
            .position(|series| series.h.to_bits() == h.to_bits())
        {
            return place;
        }
        if self.kept.len() == KEPT {
            self.kept.remove(0);
        }
        let c = series(self.beta * h, self.rate * h.abs());
        self.kept.push(Series { h, c });
        self.kept.len() - 1
    }

    /// Adds the even terms of the series of u = `turns[0]` to `next[to]`, the odd ones times `sign` to the
    /// other.
    fn expand(&mut self, series: usize, to: usize, sign: f64, t: f64) -> Result<(), StepError> {
        let [u, v] = &mut self.turns;
        let c = &self.kept[series].c;
        let length = squares(u, u);
        let [first, second] = &mut self.next;
        let (even, odd) = if to == 0 {
            (first, second)
        } else {
            (second, first)
        };
        v.clear();
        v.resize(u.len(), S::splat(0.0));
        add(even, c[0], u);
        let mut k = 1;
        while k < c.len() {
            let last = c.len().min(k + AT_ONCE);
            self.moves.clear();
            for k in k..last {
                let (keep, factor) = if k == 1 { (0.0, 1.0) } else { (-1.0, 2.0) };
                let factor = factor / self.beta;
                // (−i)^k is 1, −i, −1, i and so on; the caller gives the sign of −i
                let turn = if k % 4 < 2 { 1.0 } else { -1.0 };
                let side = if k % 2 == 1 { sign } else { 1.0 };
                self.moves.push(Move {
                    into_second: k % 2 == 1,
                    update: Update {
                        keep,
                        factor,
                        diagonal: -factor * self.sigma,
                    },
                    weight: turn * side * c[k],
                });
            }
            (self.sweeper).run(&self.moves, u, v, Some((&mut *even, &mut *odd)))?;
            k = last;
            let newest = if k % 2 == 1 { &*u } else { &*v };
            refuse(squares(newest, newest), length, t, |now, start| {
                now <= GROWTH * start
            })?;
        }
        Ok(())
    }

    fn clear(&mut self, n: usize) {
        for sum in &mut self.next {
            sum.clear();
            sum.resize(n, S::splat(0.0));
        }
    }

    /// The parts of ψ are real vectors: two recurrences, or one where a part is zero.
    fn split(&mut self, series: usize, t: f64, state: &Wave<S>) -> Result<(), StepError> {
        self.clear(state.q.len());
        for (to, part) in [&state.q, &state.p].into_iter().enumerate() {
            if is_zero(part) {
                continue;
            }
            self.turns[0].clone_from(part);
            // −i q goes to −p, −i (i p) to q
            self.expand(series, to, if to == 0 { -1.0 } else { 1.0 }, t)?;
        }
        Ok(())
    }

    /// The terms are complex vectors (q, p): even ones are summed in (C, C'), odd ones in (S, S'), and
    /// ψ = C + S' + i (C' − S).
    fn double(&mut self, series: usize, t: f64, state: &Wave<S>) -> Result<(), StepError> {
        let n = state.q.len();
        self.clear(2 * n);
        self.turns[0].clone_from(&state.q);
        self.turns[0].extend_from_slice(&state.p);
        self.expand(series, 0, 1.0, t)?;
        let [even, odd] = &mut self.next;
        let (q, p) = even.split_at_mut(n);
        add(q, 1.0, &odd[n..]);
        add(p, -1.0, &odd[..n]);
        odd.clear();
        odd.extend_from_slice(p);
        even.truncate(n);
        Ok(())
    }
}

impl<S: Stored> Stepper for Chebyshev<S> {
    type State = Wave<S>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        let series = self.series_for(h);
        if self.is_doubled {
            self.double(series, t, state)?;
        } else {
            self.split(series, t, state)?;
        }
        let [q, p] = &self.next;
        guard(squares(q, p), state.start, self.guard, t + h)?;
        state.q.copy_from_slice(q);
        state.p.copy_from_slice(p);
        state.add_phase(self.sigma * h);
        Ok(())
    }

    fn stats(&self) -> Stats {
        // a product of the doubled matrix is four real ones, the counterpart of two with real H
        let each = if self.is_doubled { 2 } else { 1 };
        Stats {
            evaluations: each * self.sweeper.products(),
            ..Stats::default()
        }
    }
}

fn is_zero<S: Stored>(x: &[S]) -> bool {
    x.iter()
        .all(|x| (0..S::MEMBERS).all(|m| x.member(m) == 0.0))
}

/// `out += factor * x`
fn add<S: Stored>(out: &mut [S], factor: f64, x: &[S]) {
    for (out, x) in out.iter_mut().zip(x) {
        for m in 0..S::MEMBERS {
            out.set_member(m, out.member(m) + factor * x.member(m));
        }
    }
}

impl<S: Stored> Checkpoint for Chebyshev<S> {}
