//! The propagator by eigenvectors: ψ(t + h) = Σ_k u_k e^{−iλ_k h} ⟨u_k|ψ(t)⟩, for few levels over long times.

use super::{Wave, check_norm};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use std::sync::Arc;

/// Eigenvalues of H, and its eigenvectors as rows of real and imaginary parts.
#[derive(Debug)]
pub struct Eigenpairs {
    energies: Vec<f64>,
    real: Vec<f64>,
    imaginary: Vec<f64>,
}

impl Eigenpairs {
    /// Eigenpairs of a Hamiltonian; none where there are not as many components of each vector as vectors.
    pub fn new(energies: Vec<f64>, real: Vec<f64>, imaginary: Vec<f64>) -> Option<Self> {
        let is_square = |part: &[f64]| part.len() == energies.len() * energies.len();
        (is_square(&real) && is_square(&imaginary)).then_some(Self {
            energies,
            real,
            imaginary,
        })
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.energies.len()
    }

    /// Each level: its energy, and the parts of its vector.
    fn each(&self) -> impl Iterator<Item = (f64, (&[f64], &[f64]))> {
        let n = self.count().max(1);
        let vectors = self
            .real
            .chunks_exact(n)
            .zip(self.imaginary.chunks_exact(n));
        self.energies.iter().copied().zip(vectors)
    }
}

/// Steps of any length by levels.
#[derive(Clone)]
pub struct Diagonal {
    levels: Arc<Eigenpairs>,
    tolerance: f64,
    q: Vec<f64>,
    p: Vec<f64>,
    made: usize,
}

impl Diagonal {
    /// Steps by these levels; the norm may be off by `tolerance`, relatively, before a state is refused.
    pub fn new(levels: Arc<Eigenpairs>, tolerance: f64) -> Self {
        let n = levels.count();
        Self {
            levels,
            tolerance,
            q: vec![0.0; n],
            p: vec![0.0; n],
            made: 0,
        }
    }
}

impl Stepper for Diagonal {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        self.q.fill(0.0);
        self.p.fill(0.0);
        for (energy, (u, v)) in self.levels.each() {
            // ⟨u + iv|q + ip⟩
            let (mut a, mut b) = (0.0, 0.0);
            for ((u, v), (q, p)) in u.iter().zip(v).zip(state.q.iter().zip(&state.p)) {
                a += u * q + v * p;
                b += u * p - v * q;
            }
            let (sin, cos) = (energy * h).sin_cos();
            let (a, b) = (a * cos + b * sin, b * cos - a * sin);
            for ((u, v), (q, p)) in u.iter().zip(v).zip(self.q.iter_mut().zip(&mut self.p)) {
                *q += u * a - v * b;
                *p += u * b + v * a;
            }
        }
        state.q.copy_from_slice(&self.q);
        state.p.copy_from_slice(&self.p);
        self.made += 1;
        check_norm(t + h, self.tolerance, state)
    }

    fn synchronize(&mut self, _: &mut Wave<f64>) -> Result<(), StepError> {
        Ok(())
    }

    /// A step is two products with the matrix of the vectors.
    fn stats(&self) -> Stats {
        Stats {
            evaluations: 4 * self.made,
            ..Stats::default()
        }
    }
}

impl Checkpoint for Diagonal {}
