//! Cotangents of a potential: each of its places is a group whose matrix has a one there.

use super::powers::TransposedPowers;
use crate::method::driven::choice::{Form, Window};
use crate::method::driven::fit::Fit;

/// The part of a potential in cotangents of the state, and the cotangents of the potential.
pub(super) struct PotentialPull {
    /// Powers of r, where there is a potential or its cotangents are wanted.
    powers: Option<TransposedPowers>,
    /// Cotangents of its coefficients, empty where they are not wanted.
    pub(super) found: Vec<f64>,
    pub(super) places: usize,
}

impl PotentialPull {
    /// Begins with nothing, for vectors of a size of an H with so many rows.
    pub(super) fn new(
        fit: &Fit,
        form: Form,
        (size, places): (usize, usize),
        is_wanted: bool,
    ) -> Self {
        let is_there = is_wanted || !fit.potential.is_empty();
        let count = if is_wanted { fit.degree + 1 } else { 0 };
        Self {
            powers: is_there.then(|| TransposedPowers::new(form, fit.degree, size)),
            found: vec![0.0; count * places],
            places,
        }
    }

    /// Adds Σ_l V_l u^l of the next lower m to `now`, and to the cotangents of V_l what u^l has with the term c_m.
    pub(super) fn add(
        &mut self,
        (window, fit, m): (&Window, &Fit, usize),
        r: &[f64],
        now: &mut [f64],
        term: Option<&Vec<f64>>,
    ) {
        let (Some(powers), form) = (&mut self.powers, window.form) else {
            return;
        };
        powers.begin(window, m).copy_from_slice(r);
        for (l, v) in fit.potential.chunks(self.places).enumerate() {
            add_product(now, v, powers.power(form, l));
        }
        for (l, found) in self.found.chunks_mut(self.places).enumerate() {
            if let Some(term) = term {
                add_inner(found, powers.power(form, l), term);
            }
        }
    }
}

/// Adds what the parts of u and x at each place have as their inner product to `out`.
fn add_inner(out: &mut [f64], u: &[f64], x: &[f64]) {
    let size = out.len();
    for (u, x) in u.chunks(size).zip(x.chunks(size)) {
        for ((out, u), x) in out.iter_mut().zip(u).zip(x) {
            *out += u * x;
        }
    }
}

/// Adds the product with a diagonal to `out`.
fn add_product(out: &mut [f64], v: &[f64], u: &[f64]) {
    for (out, u) in out.chunks_mut(v.len()).zip(u.chunks(v.len())) {
        for ((out, v), u) in out.iter_mut().zip(v).zip(u) {
            *out += v * u;
        }
    }
}
