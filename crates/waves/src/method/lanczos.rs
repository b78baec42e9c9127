//! Short iterative Lanczos: ψ(t + τ) ≈ |ψ| V e^{−iτT} e_1 with an orthonormal basis V of the Krylov space
//! of H and ψ, and H V = V T + β v eᵀ with T real, symmetric and tridiagonal.
//!
//! The approximation solves the equation up to a residual of β |[e^{−isT}]_{m1}|, whose integral bounds the error; τ is the
//! longest step on which it stays below the tolerance. This holds for the computed V, orthogonal or not, as
//! H V = V T + β v eᵀ does: there is no reorthogonalisation.
//! Source: parklight1986; hochbruck1997.

use super::observe::dot;
use super::{Move, Sink, Sweeper, Wave, check_norm, squares};
use crate::problem::Update;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::{Tridiagonal, add_scaled};
use liouville_base::method::{Stats, Stepper};

/// Real parts, then imaginary parts.
type ComplexVector = Vec<f64>;

/// Phase of its fastest part between two evaluations of the residual.
const APART: f64 = 0.25;

/// Parts of H below this, relatively, are lost in rounding errors.
pub(super) const LOST: f64 = 8.0 * f64::EPSILON;

/// Bisections for the end of a step between the last two evaluations.
const BISECTIONS: usize = 4;

/// Steps by Krylov spaces, in substeps as long as the error allows.
#[derive(Clone)]
pub struct Lanczos {
    sweeper: Sweeper<f64>,
    dimension: usize,
    rate: f64,
    guard: f64,
    basis: Vec<ComplexVector>,
    alpha: Vec<f64>,
    beta: Vec<f64>,
    small: Tridiagonal,
    /// The state before the step, restored where the step fails.
    before: ComplexVector,
}

impl Lanczos {
    /// Krylov spaces of at most this dimension, off by `rate` in each unit of time; the norm may be off by
    /// `guard`, relatively, before a state is refused.
    ///
    /// # Panics
    /// When the dimension is below 2.
    pub fn new(sweeper: Sweeper<f64>, dimension: usize, rate: f64, guard: f64) -> Self {
        assert!(dimension >= 2, "dimension of a Krylov space: {dimension}");
        Self {
            sweeper,
            dimension,
            rate,
            guard,
            basis: vec![ComplexVector::default(); dimension + 1],
            alpha: Vec::with_capacity(dimension),
            beta: Vec::with_capacity(dimension),
            small: Tridiagonal::new(dimension),
            before: ComplexVector::default(),
        }
    }

    /// The sweeper of the products.
    pub fn sweeper_mut(&mut self) -> &mut Sweeper<f64> {
        &mut self.sweeper
    }

    /// A basis from ψ on, until it is large enough for a time `span` or as large as it may be; returns the part of `span`
    /// that is safe for any residual.
    fn build(&mut self, t: f64, state: &Wave<f64>, norm: f64, span: f64) -> Result<f64, StepError> {
        self.alpha.clear();
        self.beta.clear();
        let v = &mut self.basis[0];
        v.clear();
        v.extend(state.q.iter().chain(&state.p).map(|x| x / norm));
        // ln of β_1 .. β_m span^m / m!, a bound of the error
        let mut ln_error = 0.0;
        let mut largest = 0.0_f64;
        let mut before = 0.0;
        for j in 0..self.dimension {
            let (old, new) = self.basis.split_at_mut(j + 1);
            if j > 0 {
                new[0].clone_from(&old[j - 1]);
            } else {
                new[0].clear();
                new[0].resize(2 * state.q.len(), 0.0);
            }
            let (alpha, beta) = three_terms(&mut self.sweeper, before, &mut old[j], &mut new[0])?;
            if !(alpha.is_finite() && beta.is_finite()) {
                let start = norm;
                return Err(StepError::Norm {
                    norm: beta,
                    start,
                    t,
                });
            }
            self.alpha.push(alpha);
            self.beta.push(beta);
            before = beta;
            largest = largest.max(alpha.abs()).max(beta);
            ln_error += (beta * span / (j + 1) as f64).ln();
            let is_invariant = beta <= self.rate.max(LOST * largest);
            if is_invariant || ln_error <= (self.rate * span).ln() {
                return Ok(span);
            }
        }
        let order = self.dimension as f64 - 1.0;
        Ok(span
            * (((self.rate * span).ln() - ln_error) / order)
                .exp()
                .min(1.0))
    }

    /// The part of `span` that the basis is large enough for, at least `sure`.
    fn reach(&mut self, sure: f64, span: f64) -> f64 {
        self.small.solve(&self.alpha, &self.beta);
        if sure >= span {
            return span;
        }
        let m = self.alpha.len();
        let values = self.small.values();
        let apart = APART / (0.5 * (values[m - 1] - values[0]));
        let rate = self.rate.max(LOST / apart);
        let residual = |s: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, value) in values.iter().enumerate() {
                let u = self.small.vector(k);
                let (sin, cos) = (value * s).sin_cos();
                re += u[0] * u[m - 1] * cos;
                im += u[0] * u[m - 1] * sin;
            }
            self.beta[m - 1] * f64::hypot(re, im)
        };
        let mut s = 0.5 * sure;
        let mut error = rate * s * 0.5_f64.powf(m as f64 - 1.0);
        let mut now = residual(s);
        let mut width = apart;
        let mut left = BISECTIONS;
        while s < span && left > 0 {
            let next = (s + width).min(span);
            let then = residual(next);
            let sum = error + 0.5 * (now + then) * (next - s);
            if sum <= rate * next {
                (s, now, error) = (next, then, sum);
            } else {
                left -= 1;
                width *= 0.5;
            }
        }
        s.max(sure)
    }

    /// Sets ψ to ψ(t + τ).
    fn combine(&mut self, tau: f64, norm: f64, state: &mut Wave<f64>) {
        let parts = [&mut state.q, &mut state.p];
        for part in parts {
            part.fill(0.0);
        }
        for j in 0..self.alpha.len() {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, value) in self.small.values().iter().enumerate() {
                let u = self.small.vector(k);
                let (sin, cos) = (value * tau).sin_cos();
                re += u[0] * u[j] * cos;
                im -= u[0] * u[j] * sin;
            }
            let factor = [norm * re, norm * im];
            add_times(factor, &self.basis[j], &mut state.q, &mut state.p);
        }
    }

    fn walk(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let mut left = h.abs();
        while left > 0.0 {
            let norm = squares(&state.q, &state.p).sqrt();
            if norm == 0.0 {
                break;
            }
            let sure = self.build(t, state, norm, left)?;
            let most = self.reach(sure, left);
            let next = left - left / (left / most).ceil();
            // rounded so that all substeps add up to h
            let tau = left - next;
            self.combine(tau.copysign(h), norm, state);
            left = next;
        }
        check_norm(t + h, self.guard, state)
    }
}

/// q + ip ← q + ip + (re + i im) v
pub(super) fn add_times([re, im]: [f64; 2], v: &[f64], q: &mut [f64], p: &mut [f64]) {
    let (v_q, v_p) = v.split_at(q.len());
    add_scaled(q, re, v_q);
    add_scaled(q, -im, v_p);
    add_scaled(p, re, v_p);
    add_scaled(p, im, v_q);
}

/// w ← H v + `keep` w
///
/// A real H multiplies real and imaginary parts, a complex one all of a vector.
pub(super) fn multiply(
    sweeper: &mut Sweeper<f64>,
    keep: f64,
    v: &mut [f64],
    w: &mut [f64],
) -> Result<(), StepError> {
    let update = Update {
        keep,
        factor: 1.0,
        diagonal: 0.0,
    };
    let size = sweeper.hamiltonian().size();
    for (v, w) in v.chunks_mut(size).zip(w.chunks_mut(size)) {
        sweeper.run(&[Move::new(true, update)], v, w, Sink::Nothing)?;
    }
    Ok(())
}

/// w ← (H v − α v − β w)/β' for w the vector before v, and (α, β').
pub(super) fn three_terms(
    sweeper: &mut Sweeper<f64>,
    beta: f64,
    v: &mut [f64],
    w: &mut [f64],
) -> Result<(f64, f64), StepError> {
    multiply(sweeper, -beta, v, w)?;
    let size = sweeper.hamiltonian().size();
    let parts = v.chunks(size).zip(w.chunks(size));
    let alpha = parts.fold(0.0, |sum, (v, w)| sum + dot(v, w));
    let mut square = 0.0;
    for (v, w) in v.chunks(size).zip(w.chunks_mut(size)) {
        add_scaled(w, -alpha, v);
        square += dot(w, w);
    }
    let next = square.sqrt();
    if next > 0.0 {
        for x in w {
            *x /= next;
        }
    }
    Ok((alpha, next))
}

impl Stepper for Lanczos {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        state.keep(&mut self.before);
        self.walk(t, h, state)
            .inspect_err(|_| state.put_back(&self.before))
    }

    fn stats(&self) -> Stats {
        Stats {
            evaluations: self.sweeper.products(),
            ..Stats::default()
        }
    }
}

impl Checkpoint for Lanczos {}
