//! The terms of the series of a window, each from those before it by one product with every part of H.
//!
//!     powers:  ψ = e^{−iσs} Σ c_n (s/h)^n,    c_{n+1} = −ih/(n + 1) [Σ_k B_k Σ_l g_lk c_{n−l} − σ c_n]
//!     Bessel:  ψ = e^{−iσs} Σ c_n J_n(βs),    c_{n+1} = (1 + δ_n1) c_{n−1} − (2i/β) [Σ_k B_k Σ_l g_lk y^l_n − σ c_n]
//!
//! with y^l_n the coefficients of (s/h)^l ψ, to which multiplication by s gives higher n only:
//!
//!     y^0_n = c_n,   y^l_n = (2n/βh) w^{l−1}_{n−1},   w^l_n = y^l_n − w^l_{n−2}

use super::choice::{Form, Window};
use super::whole::Fit;
use crate::method::blocks::{
    Scaled, add_all, add_i, add_products, by_blocks, keep_times, take_from,
};
use crate::method::{Move, Sink, Sweeper};
use crate::problem::Update;
use liouville_base::error::StepError;
use std::sync::Arc;

/// A vector: real parts, then imaginary parts.
type Flat = Vec<f64>;

/// The recurrence of a window.
#[derive(Clone)]
pub(in crate::method) struct Terms {
    /// Products with each group of terms.
    groups: Vec<Sweeper<f64>>,
    /// The terms c_n: as many of the last ones as are needed, or all.
    c: Vec<Flat>,
    /// w^l, of even n and of odd n.
    w: Vec<[Flat; 2]>,
    /// Σ_l g_lk y^l of each group that has powers of the time.
    sums: Vec<Flat>,
    /// Σ_l V_l y^l
    forced: Flat,
    product: Flat,
    /// Products H ψ made, and those that a term takes.
    pub(in crate::method) products: usize,
    each: usize,
    n: usize,
}

/// The newest term times powers of the time.
struct Powers<'a> {
    n: usize,
    c: &'a [Flat],
    /// 2n/βh and w^l_{n−1} of a series in Bessel functions.
    bessel: Option<(f64, Vec<&'a Flat>)>,
}

impl<'a> Powers<'a> {
    fn new(window: &Window, n: usize, c: &'a [Flat], before: Vec<&'a Flat>) -> Self {
        let newer = 2.0 * n as f64 / (window.beta * window.h);
        let is_bessel = window.form == Form::Bessel;
        let bessel = is_bessel.then_some((newer, before));
        Self { n, c, bessel }
    }

    /// y^l_n, of l up to n.
    fn of(&self, l: usize) -> Scaled<'a> {
        match (&self.bessel, l) {
            (Some((newer, w)), 1..) => (*newer, w[l - 1]),
            _ => (1.0, &self.c[(self.n - l) % self.c.len()]),
        }
    }

    /// Vectors whose sum is Σ_l g_lk y^l.
    fn sum(&self, fit: &Fit, k: usize) -> Vec<Scaled<'a>> {
        let groups = fit.weights.len() / (fit.degree + 1);
        let weights = fit
            .weights
            .chunks(groups)
            .take(self.n + 1)
            .map(|row| row[k]);
        let each = weights.enumerate().filter(|(_, weight)| *weight != 0.0);
        let scaled = |(l, weight): (usize, f64)| (weight * self.of(l).0, self.of(l).1);
        each.map(scaled).collect()
    }

    /// V_l and y^l.
    fn forced<'b>(&self, fit: &'b Fit, places: usize) -> Vec<(&'b [f64], Scaled<'a>)> {
        let each = fit.potential.chunks(places).take(self.n + 1).enumerate();
        each.map(|(l, v)| (v, self.of(l))).collect()
    }
}

/// Whether the weight of a group depends on time.
pub(in crate::method) fn varies(fit: &Fit, k: usize) -> bool {
    let groups = fit.weights.len() / (fit.degree + 1);
    fit.weights.chunks(groups).skip(1).any(|row| row[k] != 0.0)
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
            sums: vec![Vec::new(); counts.len()],
            forced: Vec::new(),
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
        self.begin_keeping(0, window, degree, start);
    }

    /// The same, and keeps so many terms, whose memory [`Terms::reuse`] takes back.
    pub(in crate::method) fn begin_keeping(
        &mut self,
        count: usize,
        window: &Window,
        degree: usize,
        start: &[f64],
    ) {
        let (terms, sums) = match window.form {
            Form::Powers => ((degree + 1).max(2), 0),
            Form::Bessel => (2, degree),
        };
        self.n = 0;
        self.c.resize_with(terms.max(count), Vec::new);
        self.w.resize_with(sums, Default::default);
        for x in &mut self.c {
            x.resize(start.len(), 0.0);
        }
        for x in self.w.iter_mut().flatten() {
            x.clear();
            x.resize(start.len(), 0.0);
        }
        self.c[0].copy_from_slice(start);
    }

    /// Makes terms from a state on, whose memory [`Terms::reuse`] takes back.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub(in crate::method) fn all(
        &mut self,
        count: usize,
        window: &Window,
        fit: &Fit,
        start: &[f64],
    ) -> Result<Vec<Flat>, StepError> {
        self.begin_keeping(count, window, fit.degree, start);
        while self.count() < count {
            self.advance(window, fit)?;
        }
        Ok(self.taken())
    }

    /// All terms since [`Terms::begin_keeping`].
    pub(in crate::method) fn taken(&mut self) -> Vec<Flat> {
        std::mem::take(&mut self.c)
    }

    /// Takes the memory of terms that are of no more use, where there are more than here.
    pub(in crate::method) fn reuse(&mut self, terms: Vec<Flat>) {
        if terms.len() > self.c.len() {
            self.c = terms;
        }
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
        self.products += self.each;
        let (n, count) = (self.n, self.c.len());
        let (scale, keep) = match window.form {
            Form::Powers => (window.h / (n + 1) as f64, 0.0),
            Form::Bessel if n == 0 => (2.0 / window.beta, 0.0),
            Form::Bessel => (2.0 / window.beta, if n == 1 { 2.0 } else { 1.0 }),
        };
        self.add_powers(window, fit, other);
        // the array of the next term has the oldest one
        let (before, now, next) = ((n + count - 1) % count, n % count, (n + 1) % count);
        let mut newest = std::mem::take(&mut self.c[now]);
        let mut out = std::mem::take(&mut self.c[next]);
        if keep != 0.0 && before != next {
            out.copy_from_slice(&self.c[before]);
        }
        let mut keep = keep;
        for k in 0..self.groups.len() {
            let mut sum = std::mem::take(&mut self.sums[k]);
            let diagonal = if k == 0 { -window.sigma } else { 0.0 };
            if sum.is_empty() && k > 0 && fit.weights[k] == 0.0 {
                self.products -= self.groups[k].hamiltonian().calls();
                continue;
            }
            if sum.is_empty() {
                let factor = fit.weights[k];
                let update = Update {
                    keep,
                    factor,
                    diagonal,
                };
                self.add_times_i(k, -scale, update, &mut newest, &mut out)?;
            } else {
                let update = Update {
                    keep,
                    factor: 1.0,
                    diagonal: 0.0,
                };
                self.add_times_i(k, -scale, update, &mut sum, &mut out)?;
                add_i(-scale * diagonal, &newest, &mut out);
            }
            (self.sums[k], keep) = (sum, 1.0);
        }
        if !self.forced.is_empty() {
            add_i(-scale, &self.forced, &mut out);
        }
        (self.c[now], self.c[next]) = (newest, out);
        self.n += 1;
        Ok(())
    }

    /// Sets `sums` and `forced`, which the products of the next term are with, and makes w^l_n in place of w^l_{n−2}.
    fn add_powers(&mut self, window: &Window, fit: &Fit, other: Option<(&Self, &Fit)>) {
        let (n, size, places) = (self.n, self.newest().len(), self.places());
        let sides = self.w.iter_mut().map(|[even, odd]| match n % 2 {
            0 => (&*odd, even),
            _ => (&*even, odd),
        });
        let (before, mut now): (Vec<&Flat>, Vec<&mut Flat>) = sides.unzip();
        let own = Powers::new(window, n, &self.c, before);
        let other = other.map(|(terms, fit)| (terms.powers(window), fit));
        let mut of_potential = own.forced(fit, places);
        if let Some((powers, fit)) = &other {
            of_potential.extend(powers.forced(fit, places));
        }
        let of_group = |k: usize| {
            let mut all = other
                .as_ref()
                .map_or_else(Vec::new, |(powers, fit)| powers.sum(fit, k));
            if varies(fit, k) || !all.is_empty() {
                all.extend(own.sum(fit, k));
            }
            all
        };
        let vectors: Vec<Vec<Scaled<'_>>> = (0..self.groups.len()).map(of_group).collect();
        for (sum, vectors) in self.sums.iter_mut().zip(&vectors) {
            sum.resize(if vectors.is_empty() { 0 } else { size }, 0.0);
        }
        by_blocks(
            size,
            #[inline(always)]
            |rows| {
                for (sum, vectors) in self.sums.iter_mut().zip(&vectors) {
                    if let Some(sum) = sum.get_mut(rows.clone()) {
                        sum.fill(0.0);
                        add_all(sum, vectors, rows.clone());
                    }
                }
                for (l, out) in now.iter_mut().enumerate() {
                    let (factor, y) = own.of(l);
                    take_from(&mut out[rows.clone()], factor, &y[rows.clone()]);
                }
            },
        );
        self.forced
            .resize(if of_potential.is_empty() { 0 } else { size }, 0.0);
        let forced = &mut self.forced;
        by_blocks(
            if of_potential.is_empty() { 0 } else { places },
            #[inline(always)]
            |rows| {
                for part in (0..size).step_by(places) {
                    let here = part + rows.start..part + rows.end;
                    let out = &mut forced[here.clone()];
                    out.fill(0.0);
                    for (v, (factor, y)) in &of_potential {
                        add_products(out, *factor, &v[rows.clone()], &y[here.clone()]);
                    }
                }
            },
        );
    }

    fn powers(&self, window: &Window) -> Powers<'_> {
        let before = self.w.iter().map(|sides| &sides[(self.n + 1) % 2]);
        Powers::new(window, self.n, &self.c, before.collect())
    }

    /// Sets `out` to keep·out + i·scale·(factor·B_k + diagonal) x, and leaves x as it is.
    ///
    /// # Errors
    /// The product failed, or the run was cancelled.
    pub(in crate::method) fn add_times_i(
        &mut self,
        k: usize,
        scale: f64,
        update: Update,
        x: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), StepError> {
        let half = x.len() / 2;
        if self.groups[k].hamiltonian().size() > half {
            let mut product = std::mem::take(&mut self.product);
            product.resize(x.len(), 0.0);
            let made = self.multiply_by(
                k,
                Update {
                    keep: 0.0,
                    ..update
                },
                x,
                &mut product,
            );
            keep_times(out, update.keep);
            add_i(scale, &product, out);
            self.product = product;
            return made;
        }
        let ((x_q, x_p), (q, p)) = (x.split_at_mut(half), out.split_at_mut(half));
        for (x, out, scale) in [(x_p, q, -scale), (x_q, p, scale)] {
            let update = Update {
                factor: scale * update.factor,
                diagonal: scale * update.diagonal,
                ..update
            };
            self.multiply_by(k, update, x, out)?;
        }
        Ok(())
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
        self.groups[k].run(&step, x, out, Sink::Nothing)
    }
}
