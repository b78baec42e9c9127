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
pub(in crate::method) struct Terms {
    /// Products with each group of terms.
    groups: Vec<Sweeper<f64>>,
    /// The terms c_n, of powers as many as are needed, of Bessel functions the last two.
    c: Vec<Flat>,
    /// w^l, of even n and of odd n.
    w: Vec<[Flat; 2]>,
    sum: Flat,
    product: Flat,
    /// Products H ψ made, and those that a term takes.
    pub(in crate::method) products: usize,
    each: usize,
    n: usize,
}

impl Terms {
    /// Memory for terms of a Hamiltonian in groups of so many.
    pub(in crate::method) fn new(sweeper: &Sweeper<f64>, counts: &[usize]) -> Self {
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
            each: hamiltonian.products(),
            n: 0,
        }
    }

    /// The sweeper whose threads add terms to outputs.
    pub(in crate::method) fn sweeper(&mut self) -> &mut Sweeper<f64> {
        &mut self.groups[0]
    }

    /// Number of groups.
    pub(in crate::method) fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Number of rows of H.
    pub(in crate::method) fn places(&self) -> usize {
        self.groups[0].hamiltonian().size()
    }

    /// Begins with a state.
    pub(in crate::method) fn begin(&mut self, window: &Window, degree: usize, start: &[f64]) {
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

    /// The number of terms.
    pub(in crate::method) fn count(&self) -> usize {
        self.n + 1
    }

    /// The newest term.
    pub(in crate::method) fn newest(&self) -> &[f64] {
        &self.c[self.n % self.c.len()]
    }

    /// Makes the next term.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub(in crate::method) fn advance(
        &mut self,
        window: &Window,
        fit: &Fit,
    ) -> Result<(), StepError> {
        self.advance_from(window, fit, None)
    }

    /// Makes the next term, with that of other terms by another fit in the product: those that this is a change of.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub(in crate::method) fn advance_from(
        &mut self,
        window: &Window,
        fit: &Fit,
        other: Option<(&Self, &Fit)>,
    ) -> Result<(), StepError> {
        self.multiply(window, fit, other)?;
        self.products += self.each;
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
    fn multiply(
        &mut self,
        window: &Window,
        fit: &Fit,
        other: Option<(&Self, &Fit)>,
    ) -> Result<(), StepError> {
        let mut product = std::mem::take(&mut self.product);
        for k in 0..self.groups.len() {
            let mut sum = std::mem::take(&mut self.sum);
            sum.fill(0.0);
            self.add_powers(window, fit, k, &mut sum);
            if let Some((terms, fit)) = other {
                terms.add_powers(window, fit, k, &mut sum);
            }
            let update = Update {
                keep: if k == 0 { 0.0 } else { 1.0 },
                ..Update::added(1.0)
            };
            let made = self.multiply_by(k, update, &mut sum, &mut product);
            self.sum = sum;
            made?;
        }
        self.add_potential(window, fit, &mut product);
        if let Some((terms, fit)) = other {
            terms.add_potential(window, fit, &mut product);
        }
        self.product = product;
        Ok(())
    }

    /// Adds Σ_l g_lk y^l to `sum`.
    fn add_powers(&self, window: &Window, fit: &Fit, k: usize, sum: &mut [f64]) {
        for l in 0..=fit.degree.min(self.n) {
            let weight = fit.weights[l * self.groups.len() + k];
            if weight != 0.0 {
                let (factor, power) = self.power(window, l);
                add_scaled(sum, weight * factor, power);
            }
        }
    }

    /// y^l_n of the newest n, as a factor and a vector.
    pub(in crate::method) fn power(&self, window: &Window, l: usize) -> (f64, &[f64]) {
        let (n, count) = (self.n, self.c.len());
        match (window.form, l) {
            (_, 0) => (1.0, &self.c[n % count]),
            (Form::Powers, l) => (1.0, &self.c[(n - l) % count]),
            (Form::Bessel, l) => {
                let newer = 2.0 * n as f64 / (window.beta * window.h);
                (newer, &self.w[l - 1][(n + 1) % 2])
            }
        }
    }

    /// Updates `out` by the product of the group k with `x`, which is left as it is.
    ///
    /// # Errors
    /// The product failed, or the run was cancelled.
    pub(in crate::method) fn multiply_by(
        &mut self,
        k: usize,
        update: Update,
        x: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), StepError> {
        let step = [Move::new(true, update)];
        let size = self.groups[k].hamiltonian().size();
        for (x, out) in x.chunks_mut(size).zip(out.chunks_mut(size)) {
            self.groups[k].run(&step, x, out, Sink::Nothing)?;
        }
        Ok(())
    }

    fn add_potential(&self, window: &Window, fit: &Fit, product: &mut [f64]) {
        let size = self.places();
        for (l, v) in fit.potential.chunks(size).enumerate().take(self.n + 1) {
            let (factor, x) = self.power(window, l);
            for (out, x) in product.chunks_mut(size).zip(x.chunks(size)) {
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
