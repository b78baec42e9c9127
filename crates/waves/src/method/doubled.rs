//! Methods for real H, taken for a complex Hermitian H = A + iB by the wave function (ψ, −iψ) of two halves:
//!
//!     G = [[A, −B], [B, A]],   G (ψ, −iψ) = (Hψ, −iHψ)
//!
//! G is real and symmetric, so any method for such a matrix steps Ψ = Q + iP from Q = (q, p) and P = (p, −q). It may
//! leave the subspace of these Ψ by its own error, which the projection ψ = (Ψ_1 + iΨ_2)/2 leaves out. Both halves are kept
//! from output to output, so that a stable splitting stays bounded.

use super::Wave;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::real::Scalar;

/// A stepper of wave functions, each of two halves.
pub struct Doubled<S: Scalar> {
    inner: Box<dyn Stepper<State = Wave<S>>>,
    /// Ψ, empty before the first step.
    pair: Wave<S>,
}

impl<S: Scalar> Doubled<S> {
    /// A stepper of wave functions of `n` places, by one of twice as many.
    pub fn new(inner: Box<dyn Stepper<State = Wave<S>>>, n: usize) -> Self {
        let empty = || vec![S::splat(0.0); 2 * n];
        let pair = Wave::new(empty(), empty());
        Self { inner, pair }
    }

    fn has_begun(&self) -> bool {
        (0..S::MEMBERS).any(|m| self.pair.start.member(m) != 0.0)
    }

    fn embed(&mut self, state: &Wave<S>) {
        let n = state.q.len();
        let Wave { q, p, .. } = &mut self.pair;
        q[..n].copy_from_slice(&state.q);
        q[n..].copy_from_slice(&state.p);
        p[..n].copy_from_slice(&state.p);
        for (out, x) in p[n..].iter_mut().zip(&state.q) {
            for m in 0..S::MEMBERS {
                out.set_member(m, -x.member(m));
            }
        }
        self.pair.phase = state.phase;
        for m in 0..S::MEMBERS {
            self.pair.start.set_member(m, 2.0 * state.start.member(m));
        }
    }

    fn project(&self, state: &mut Wave<S>) {
        let n = state.q.len();
        let Wave { q, p, phase, .. } = &self.pair;
        let half = |out: &mut [S], x: &[S], y: &[S], sign: f64| {
            for ((out, x), y) in out.iter_mut().zip(x).zip(y) {
                for m in 0..S::MEMBERS {
                    out.set_member(m, 0.5 * (x.member(m) + sign * y.member(m)));
                }
            }
        };
        half(&mut state.q, &q[..n], &p[n..], -1.0);
        half(&mut state.p, &p[..n], &q[n..], 1.0);
        state.phase = *phase;
    }
}

impl<S: Scalar> Stepper for Doubled<S> {
    type State = Wave<S>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        if !self.has_begun() {
            self.embed(state);
        }
        self.inner.step(t, h, &mut self.pair)
    }

    /// The state is that of the last step only after this.
    fn synchronize(&mut self, state: &mut Wave<S>) -> Result<(), StepError> {
        if self.has_begun() {
            self.inner.synchronize(&mut self.pair)?;
            self.project(state);
        }
        Ok(())
    }

    fn stats(&self) -> Stats {
        self.inner.stats()
    }
}

liouville_base::checkpoint!([S: Scalar] Doubled<S> { inner, pair });
