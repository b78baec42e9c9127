//! The terms of the series of a window, each from those before it by one product with every part of H.
//!
//!     powers:  ψ = e^{−iσs} Σ c_n (s/h)^n,    c_{n+1} = −ih/(n + 1) [Σ_k B_k Σ_l g_lk c_{n−l} − σ c_n]
//!     Bessel:  ψ = e^{−iσs} Σ c_n J_n(βs),    c_{n+1} = (1 + δ_n1) c_{n−1} − (2i/β) [Σ_k B_k Σ_l g_lk y^l_n − σ c_n]
//!
//! with y^l_n the coefficients of (s/h)^l ψ, to which multiplication by s gives higher n only:
//!
//!     y^0_n = c_n,   y^l_n = (2n/βh) w^{l−1}_{n−1},   w^l_n = y^l_n − w^l_{n−2}

use super::choice::{Form, Window};
use super::fit::Fit;
use crate::method::{Move, Sink, Sweeper};
use crate::problem::Update;
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;
use std::sync::Arc;

/// A vector: real parts, then imaginary parts.
type Flat = Vec<f64>;

/// The recurrence of a window.
#[derive(Clone)]
pub(super) struct Terms {
    /// Products with each group of terms.
    groups: Vec<Sweeper<f64>>,
    /// The terms c_n, of powers as many as are needed, of Bessel functions the last two.
    c: Vec<Flat>,
    /// w^l, of even n and of odd n.
    w: Vec<[Flat; 2]>,
    sum: Flat,
    product: Flat,
    /// Products H ψ made.
    pub(super) products: usize,
    n: usize,
}

impl Terms {
    /// Memory for terms of a Hamiltonian in groups of so many.
    pub(super) fn new(sweeper: &Sweeper<f64>, counts: &[usize]) -> Self {
        let hamiltonian = sweeper.hamiltonian();
        let mut terms = hamiltonian.terms();
        let mut group = |count: &usize| {
            let (now, later) = terms.split_at(*count);
            terms = later;
            sweeper.clone().of(Arc::new(hamiltonian.part(now)))
        };
        Self {
            groups: counts.iter().map(&mut group).collect(),
            c: Vec::new(),
            w: Vec::new(),
            sum: Vec::new(),
            product: Vec::new(),
            products: 0,
            n: 0,
        }
    }

    /// The sweeper whose threads add terms to outputs.
    pub(super) fn sweeper(&mut self) -> &mut Sweeper<f64> {
        &mut self.groups[0]
    }

    /// Begins with a state.
    pub(super) fn begin(&mut self, window: &Window, degree: usize, start: &[f64]) {
        let size = start.len();
        let (terms, sums) = match window.form {
            Form::Powers => (degree + 1, 0),
            Form::Bessel => (2, degree),
        };
        self.n = 0;
        self.c.resize_with(terms, Vec::new);
        self.w.resize_with(sums, Default::default);
        let all = self.c.iter_mut().chain(self.w.iter_mut().flatten());
        for x in all.chain([&mut self.sum, &mut self.product]) {
            x.clear();
            x.resize(size, 0.0);
        }
        self.c[0].copy_from_slice(start);
    }

    /// The newest term.
    pub(super) fn newest(&self) -> &[f64] {
        &self.c[self.n % self.c.len()]
    }

    /// Makes the next term.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub(super) fn advance(&mut self, window: &Window, fit: &Fit) -> Result<(), StepError> {
        self.multiply(window, fit)?;
        self.products += 1;
        if window.form == Form::Bessel {
            self.advance_sums(window);
        }
        let (n, count) = (self.n, self.c.len());
        let (scale, keep) = match window.form {
            Form::Powers => (window.h / (n + 1) as f64, 0.0),
            Form::Bessel if n == 0 => (2.0 / window.beta, 0.0),
            Form::Bessel => (2.0 / window.beta, if n == 1 { 2.0 } else { 1.0 }),
        };
        let half = self.sum.len() / 2;
        // the array of the next term has the oldest one
        let (now, next) = (n % count, (n + 1) % count);
        let sigma = window.sigma;
        let product = &mut self.product;
        for (out, x) in product.iter_mut().zip(&self.c[now]) {
            *out -= sigma * x;
        }
        let (product_q, product_p) = product.split_at(half);
        let (q, p) = self.c[next].split_at_mut(half);
        if keep == 0.0 {
            q.fill(0.0);
            p.fill(0.0);
        }
        for (out, x) in q.iter_mut().zip(product_p) {
            *out = keep * *out + scale * x;
        }
        for (out, x) in p.iter_mut().zip(product_q) {
            *out = keep * *out - scale * x;
        }
        self.n += 1;
        Ok(())
    }

    /// Sets `product` to Σ_k B_k Σ_l g_lk y^l.
    fn multiply(&mut self, window: &Window, fit: &Fit) -> Result<(), StepError> {
        let (n, count) = (self.n, self.c.len());
        let theta = window.beta * window.h;
        let newer = 2.0 * n as f64 / theta;
        let groups = self.groups.len();
        let mut keep = 0.0;
        for k in 0..groups {
            let weight = |l: usize| fit.weights[l * groups + k];
            self.sum.fill(0.0);
            add_scaled(&mut self.sum, weight(0), &self.c[n % count]);
            for l in 1..=fit.degree.min(n) {
                if weight(l) == 0.0 {
                    continue;
                }
                match window.form {
                    Form::Powers => {
                        add_scaled(&mut self.sum, weight(l), &self.c[(n - l) % count]);
                    }
                    Form::Bessel => {
                        let w = &self.w[l - 1][(n + 1) % 2];
                        add_scaled(&mut self.sum, weight(l) * newer, w);
                    }
                }
            }
            let update = Update {
                keep,
                factor: 1.0,
                diagonal: 0.0,
            };
            let step = [Move::new(true, update)];
            let size = self.groups[k].hamiltonian().size();
            let parts = self.sum.chunks_mut(size).zip(self.product.chunks_mut(size));
            for (x, out) in parts {
                self.groups[k].run(&step, x, out, Sink::Nothing)?;
            }
            keep = 1.0;
        }
        self.add_potential(window, fit, newer);
        Ok(())
    }

    fn add_potential(&mut self, window: &Window, fit: &Fit, newer: f64) {
        let (n, count) = (self.n, self.c.len());
        let size = self.groups[0].hamiltonian().size();
        for (l, v) in fit.potential.chunks(size).enumerate().take(n + 1) {
            let (factor, x) = match (window.form, l) {
                (_, 0) => (1.0, &self.c[n % count]),
                (Form::Powers, l) => (1.0, &self.c[(n - l) % count]),
                (Form::Bessel, l) => (newer, &self.w[l - 1][(n + 1) % 2]),
            };
            for (out, x) in self.product.chunks_mut(size).zip(x.chunks(size)) {
                for ((out, v), x) in out.iter_mut().zip(v).zip(x) {
                    *out += factor * v * x;
                }
            }
        }
    }

    /// Makes w^l_n of all l, the highest first, in place of w^l_{n−2}.
    fn advance_sums(&mut self, window: &Window) {
        let (n, count) = (self.n, self.c.len());
        let newer = 2.0 * n as f64 / (window.beta * window.h);
        let (now, before) = (n % 2, (n + 1) % 2);
        for l in (1..self.w.len()).rev() {
            let (lower, this) = self.w.split_at_mut(l);
            for (out, x) in this[0][now].iter_mut().zip(&lower[l - 1][before]) {
                *out = newer * x - *out;
            }
        }
        if let Some(lowest) = self.w.first_mut() {
            for (out, x) in lowest[now].iter_mut().zip(&self.c[n % count]) {
                *out = x - *out;
            }
        }
    }
}
