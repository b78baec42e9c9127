//! The derivatives of shears by a real H, q ← q + a (H − σ) p and p ← p − a (H − σ) q: the transpose of a shear is one of
//! the other kind.
//!
//!     q ← q + a (H − σ) p:   cotangent of w_k += a q̄·B_k p,   p̄ ← p̄ + a (H − σ) q̄
//!     p ← p − a (H − σ) q:   cotangent of w_k −= a p̄·B_k q,   q̄ ← q̄ − a (H − σ) p̄
//!
//! A potential is a group of each of its places x: the cotangent of V(x) gets a q̄(x) p(x), or −a p̄(x) q(x). A shear is undone by that of −a, so that no state between is kept.

use super::recorder::ShearsPiece;
use crate::method::blocks::{inner, turn};
use crate::method::driven::polynomials::{AtNodes, Wanted};
use crate::method::driven::terms::Terms;
use crate::problem::Update;
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;

/// Adds a (Σ w_k B_k x + V x − σ x) to `out`.
fn add_product(
    terms: &mut Terms,
    (weights, potential, shift): (&[f64], &[f64], f64),
    a: f64,
    (out, x): (&mut [f64], &mut [f64]),
) -> Result<(), StepError> {
    for (k, weight) in weights.iter().enumerate() {
        let update = Update {
            keep: 1.0,
            factor: a * weight,
            diagonal: if k == 0 { -a * shift } else { 0.0 },
        };
        terms.multiply_by(k, update, x, out)?;
    }
    for ((out, v), x) in out.iter_mut().zip(potential).zip(x) {
        *out += a * v * *x;
    }
    Ok(())
}

/// The same, and calls `each` with the product B_k x of each group that may change: all but the first.
fn add_products(
    terms: &mut Terms,
    (weights, potential, shift): (&[f64], &[f64], f64),
    a: f64,
    (out, x): (&mut [f64], &mut [f64]),
    mut each: impl FnMut(usize, &[f64]),
    part: &mut [f64],
) -> Result<(), StepError> {
    add_product(terms, (&weights[..1], potential, shift), a, (out, x))?;
    for (k, weight) in weights.iter().enumerate().skip(1) {
        let set = Update {
            keep: 0.0,
            ..Update::added(1.0)
        };
        terms.multiply_by(k, set, x, part)?;
        each(k, part);
        add_scaled(out, a * weight, part);
    }
    Ok(())
}

/// The part that a shear updates, and the other one.
fn split(x: &mut [f64], into_second: bool) -> (&mut [f64], &mut [f64]) {
    let (q, p) = x.split_at_mut(x.len() / 2);
    if into_second { (p, q) } else { (q, p) }
}

/// The factor of the product in a shear.
fn signed((into_second, a): (bool, f64)) -> f64 {
    if into_second { -a } else { a }
}

impl ShearsPiece {
    fn all(&self) -> impl DoubleEndedIterator<Item = (bool, f64)> {
        (0..self.repeats).flat_map(|_| self.shears.iter().copied())
    }

    fn sum(&self) -> (&[f64], &[f64], f64) {
        (&self.weights, &self.potential, self.shift)
    }

    /// The changes of H in these shears, by those at the nodes.
    fn change_of(&self, of_nodes: &AtNodes) -> AtNodes {
        let applied = |values: &[f64]| match values {
            [] => Vec::new(),
            _ => self.map.apply(values, values.len() / self.nodes.len(), 0),
        };
        AtNodes {
            weights: applied(&of_nodes.weights),
            potential: applied(&of_nodes.potential),
        }
    }

    /// See [`super::Derivative::repeat`].
    pub(super) fn repeat(
        &self,
        terms: &mut Terms,
        state: &mut [f64],
        change: &AtNodes,
    ) -> Result<Vec<Vec<f64>>, StepError> {
        let (mut weights, mut potential) = (self.weights.clone(), self.potential.clone());
        let change = self.change_of(change);
        if !change.weights.is_empty() {
            add_scaled(&mut weights, 1.0, &change.weights);
        }
        if potential.is_empty() {
            potential = change.potential;
        } else if !change.potential.is_empty() {
            add_scaled(&mut potential, 1.0, &change.potential);
        }
        turn(state, self.angles.0);
        for shear in self.all() {
            let parts = split(state, shear.0);
            add_product(
                terms,
                (&weights, &potential, self.shift),
                signed(shear),
                parts,
            )?;
        }
        turn(state, self.angles.1);
        Ok(vec![state.to_vec(); self.steps])
    }

    /// See [`super::Derivative::keep_ends`].
    pub(super) fn keep_ends(
        &mut self,
        terms: &mut Terms,
        state: &mut [f64],
    ) -> Result<(), StepError> {
        let turned = |state: &[f64], angle: f64| {
            let mut found = state.to_vec();
            turn(&mut found, angle);
            found
        };
        self.ends[0] = turned(state, self.angles.0);
        self.repeat(terms, state, &AtNodes::default())?;
        self.ends[1] = turned(state, -self.angles.1);
        Ok(())
    }

    /// See [`super::Derivative::follow`].
    pub(super) fn follow(
        &self,
        terms: &mut Terms,
        changes: &mut [Vec<f64>],
        of_nodes: &[AtNodes],
    ) -> Result<Vec<Vec<f64>>, StepError> {
        let moved: Vec<AtNodes> = of_nodes.iter().map(|own| self.change_of(own)).collect();
        let mut state = self.ends[0].clone();
        // where the ends were not kept, nothing changes H
        let is_moved = !state.is_empty() && moved.iter().any(|own| *own != AtNodes::default());
        let mut part = vec![0.0; state.len() / 2];
        for change in &mut *changes {
            turn(change, self.angles.0);
        }
        for shear in self.all() {
            let a = signed(shear);
            for change in &mut *changes {
                add_product(terms, self.sum(), a, split(change, shear.0))?;
            }
            if is_moved {
                let parts = split(&mut state, shear.0);
                for (change, moved) in changes.iter_mut().zip(&moved) {
                    let (out, _) = split(change, shear.0);
                    for ((out, v), x) in out.iter_mut().zip(&moved.potential).zip(&*parts.1) {
                        *out += a * v * *x;
                    }
                }
                let each = |k: usize, part: &[f64]| {
                    for (change, moved) in changes.iter_mut().zip(&moved) {
                        if let Some(weight) = moved.weights.get(k) {
                            add_scaled(split(change, shear.0).0, a * weight, part);
                        }
                    }
                };
                add_products(terms, self.sum(), a, parts, each, &mut part)?;
            }
        }
        for change in &mut *changes {
            turn(change, self.angles.1);
        }
        Ok(if self.steps > 0 {
            changes.to_vec()
        } else {
            Vec::new()
        })
    }

    /// See [`super::Derivative::pull`].
    pub(super) fn pull(
        &self,
        terms: &mut Terms,
        cotangent: &mut [f64],
        of_steps: &[Vec<f64>],
        wanted: Wanted,
    ) -> Result<AtNodes, StepError> {
        for x in of_steps {
            add_scaled(cotangent, 1.0, x);
        }
        let mut state = self.ends[1].clone();
        let mut found = vec![0.0; self.weights.len()];
        let mut part = vec![0.0; cotangent.len() / 2];
        let mut potential = Vec::new();
        if wanted.potential {
            potential.resize(part.len(), 0.0);
        }
        turn(cotangent, -self.angles.1);
        for shear in self.all().rev() {
            let a = signed(shear);
            let (sum, (now, other)) = (self.sum(), split(cotangent, shear.0));
            if wanted != Wanted::default() && !state.is_empty() {
                let parts = split(&mut state, shear.0);
                for ((found, now), x) in potential.iter_mut().zip(&*now).zip(&*parts.1) {
                    *found += a * now * *x;
                }
                let each = |k: usize, part: &[f64]| found[k] += a * inner(now, part);
                add_products(terms, sum, -a, parts, each, &mut part)?;
            }
            add_product(terms, sum, a, (other, now))?;
        }
        turn(cotangent, -self.angles.0);
        let at_nodes = |values: &[f64]| self.map.transposed(values, values.len(), 0);
        let mut of_nodes = AtNodes::default();
        if wanted.weights {
            of_nodes.weights = at_nodes(&found);
        }
        if wanted.potential {
            of_nodes.potential = at_nodes(&potential);
        }
        Ok(of_nodes)
    }
}
