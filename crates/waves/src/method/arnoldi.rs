//! Krylov spaces of an H that absorbs, A − iW with a diagonal W ≥ 0: ψ(t + τ) ≈ |ψ| V e^{−iτK} e_1 with an orthonormal
//! basis V by Arnoldi's recurrence, A V − iW V = V K + β v eᵀ, and K upper Hessenberg.
//!
//! The exact flow lengthens nothing, so the error is at most β ∫ |[e^{−isK}]_{m1}| ds, by variation of constants. The
//! small exponential is a chain of Taylor polynomials, and the sizes of their coefficients bound the integral.
//! Source: hochbruck1997.

use super::lanczos::{LOST, add_times, multiply};
use super::observe::overlap;
use super::{Sweeper, Wave, check_growth, squares};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};

/// Real and imaginary part.
type Amplitude = [f64; 2];

/// Length of a Taylor polynomial in units of 1/|K|, and its degree: it leaves out less than a rounding.
const LENGTH: f64 = 0.5;
const DEGREE: usize = 14;

/// A bound of what it leaves out, of a vector of length 1.
const REST: f64 = 5e-17;

/// Times that a polynomial is halved for the end of a step.
const HALVINGS: usize = 4;

/// Polynomials of one space; a run can be interrupted between spaces.
const MOST: usize = 4096;

/// Steps by Krylov spaces of an H that absorbs, in substeps as long as the error allows.
#[derive(Clone)]
pub struct Arnoldi {
    sweeper: Sweeper<f64>,
    dimension: usize,
    rate: f64,
    guard: f64,
    /// Vectors: real parts, then imaginary parts.
    basis: Vec<Vec<f64>>,
    /// K less the shift, by columns of the largest space.
    small: Vec<Amplitude>,
    /// The real part of K's first entry: far energies would drown those that differ from it.
    shift: f64,
    /// β of the vector beyond the space.
    beyond: f64,
    flow: Vec<Amplitude>,
    term: Vec<Amplitude>,
    next: Vec<Amplitude>,
    /// The state before the step, restored where the step fails.
    before: Vec<f64>,
}

impl Arnoldi {
    /// Krylov spaces of at most this dimension, off by `rate` in each unit of time; the norm may grow by
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
            basis: vec![Vec::default(); dimension + 1],
            small: vec![[0.0; 2]; dimension * dimension],
            shift: 0.0,
            beyond: 0.0,
            flow: Vec::with_capacity(dimension),
            term: Vec::with_capacity(dimension),
            next: Vec::with_capacity(dimension),
            before: Vec::default(),
        }
    }

    /// Finds a space from ψ on for as much of `span` as may be, e^{−iτK} e_1 in `flow`; returns τ.
    fn build(&mut self, t: f64, state: &Wave<f64>, norm: f64, span: f64) -> Result<f64, StepError> {
        let v = &mut self.basis[0];
        v.clear();
        v.extend(state.q.iter().chain(&state.p).map(|x| x / norm));
        let mut largest = 0.0_f64;
        // ln of β_1 .. β_m span^m / m!, near to the error where it is small
        let mut ln_error = 0.0;
        for j in 0..self.dimension {
            let size = self.extend(j)?;
            if !size.is_finite() {
                let start = norm;
                return Err(StepError::Norm {
                    norm: size,
                    start,
                    t,
                });
            }
            largest = largest.max(size);
            ln_error += (self.beyond * span / (j + 1) as f64).ln();
            let is_last = self.beyond == 0.0 || j + 1 == self.dimension;
            let is_close = self.beyond <= self.rate || ln_error <= (self.rate * span).ln();
            if is_last || is_close {
                let reached = self.march(j + 1, span);
                if is_last || reached >= span {
                    return Ok(reached);
                }
            }
        }
        unreachable!("a space of the largest dimension")
    }

    /// Sets column j of K, β and the next vector; returns the largest of these numbers.
    fn extend(&mut self, j: usize) -> Result<f64, StepError> {
        let (old, new) = self.basis.split_at_mut(j + 1);
        let (w, n) = (&mut new[0], old[j].len() / 2);
        w.clear();
        w.resize(2 * n, 0.0);
        multiply(&mut self.sweeper, 0.0, &mut old[j], w)?;
        let (v_q, v_p) = old[j].split_at(n);
        let (w_q, w_p) = w.split_at_mut(n);
        let absorber = self.sweeper.hamiltonian().absorber();
        for (k, x) in absorber.iter().enumerate() {
            w_q[k] += x * v_p[k];
            w_p[k] -= x * v_q[k];
        }
        if j > 0 {
            add_times([-self.shift, 0.0], &old[j], w_q, w_p);
        }
        let mut largest = 0.0_f64;
        for (i, v) in old.iter().enumerate() {
            let [re, im] = overlap([&v[..n], &v[n..]], [w_q, w_p]);
            add_times([-re, -im], v, w_q, w_p);
            self.small[j * self.dimension + i] = [re, im];
            largest = largest.max(f64::hypot(re, im));
        }
        if j == 0 {
            self.shift = std::mem::take(&mut self.small[0][0]);
        }
        self.beyond = squares(w_q, w_p).sqrt();
        largest = largest.max(self.beyond).max(self.shift.abs());
        if self.beyond <= LOST * largest {
            self.beyond = 0.0;
            return Ok(largest);
        }
        for x in w {
            *x /= self.beyond;
        }
        if j + 1 < self.dimension {
            self.small[j * self.dimension + j + 1] = [self.beyond, 0.0];
        }
        Ok(largest)
    }

    /// Sets `flow` to e^{−iτK} e_1 in the space of the first m vectors, for the largest τ up to `span` that keeps to the
    /// error; returns τ.
    fn march(&mut self, m: usize, span: f64) -> f64 {
        let mut length = LENGTH / self.norm(m).max(LENGTH / span);
        let rate = self.rate.max(LOST / length);
        self.flow.clear();
        self.flow.resize(m, [0.0; 2]);
        self.flow[0] = [1.0, 0.0];
        let (mut s, mut error, mut left) = (0.0, 0.0, HALVINGS);
        for _ in 0..MOST {
            if s >= span || left == 0 {
                break;
            }
            let then = if span - s <= length { span } else { s + length };
            let sum = error + self.beyond * self.taylor(m, then - s);
            if sum <= rate * then {
                (s, error) = (then, sum);
                std::mem::swap(&mut self.flow, &mut self.next);
            } else {
                left -= usize::from(s > 0.0);
                length *= 0.5;
            }
        }
        let (sin, cos) = (self.shift * s).sin_cos();
        for y in &mut self.flow {
            *y = [y[0] * cos + y[1] * sin, y[1] * cos - y[0] * sin];
        }
        s
    }

    /// A bound of |K|, by its columns and rows.
    fn norm(&self, m: usize) -> f64 {
        let size = |i: usize, j: usize| {
            let [re, im] = self.small[j * self.dimension + i];
            if i > j + 1 { 0.0 } else { f64::hypot(re, im) }
        };
        let all = |sum: &dyn Fn(usize) -> f64| (0..m).map(sum).fold(0.0, f64::max);
        let columns = all(&|j| (0..m).map(|i| size(i, j)).sum());
        let rows = all(&|i| (0..m).map(|j| size(i, j)).sum());
        f64::sqrt(columns * rows)
    }

    /// Sets `next` to e^{−isK} `flow`; returns a bound of the integral of the size of its last component.
    fn taylor(&mut self, m: usize, s: f64) -> f64 {
        self.term.clone_from(&self.flow);
        self.next.clone_from(&self.flow);
        let last = |term: &[Amplitude]| f64::hypot(term[m - 1][0], term[m - 1][1]);
        let mut sum = s * (last(&self.term) + REST);
        for degree in 1..=DEGREE {
            let factor = s / degree as f64;
            // row i takes components from i − 1 on: in place, from the first row on, with the one before kept
            let mut before = [0.0; 2];
            for i in 0..m {
                let own = self.term[i];
                let mut at = [0.0; 2];
                for j in i.saturating_sub(1)..m {
                    let [a, b] = self.small[j * self.dimension + i];
                    let [x, y] = if j < i { before } else { self.term[j] };
                    at[0] += a * x - b * y;
                    at[1] += a * y + b * x;
                }
                before = own;
                self.term[i] = [factor * at[1], -factor * at[0]];
            }
            for (next, term) in self.next.iter_mut().zip(&self.term) {
                next[0] += term[0];
                next[1] += term[1];
            }
            sum += s / (degree + 1) as f64 * last(&self.term);
        }
        sum
    }

    fn walk(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let mut left = h;
        while left > 0.0 {
            let norm = squares(&state.q, &state.p).sqrt();
            if norm == 0.0 {
                break;
            }
            left -= self.build(t, state, norm, left)?;
            state.q.fill(0.0);
            state.p.fill(0.0);
            for (v, y) in self.basis.iter().zip(&self.flow) {
                add_times(y.map(|y| norm * y), v, &mut state.q, &mut state.p);
            }
        }
        check_growth(t + h, self.guard, state)
    }
}

impl Stepper for Arnoldi {
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

impl Checkpoint for Arnoldi {}
