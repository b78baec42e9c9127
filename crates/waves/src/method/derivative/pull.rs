//! The transposed recurrence of a window, from its last term to its first.

use super::majorant::SeriesPiece;
use super::potential::PotentialPull;
use super::powers::TransposedPowers;
use crate::method::blocks::{
    Scaled, add, add_all, add_and_pair, add_i, by_blocks, combine, keep_times,
};
use crate::method::driven::choice::Form;
use crate::method::driven::polynomials::Wanted;
use crate::method::driven::terms::{Terms, varies};
use crate::problem::Update;
use liouville_base::error::StepError;

/// Memory of the recurrence, and the cotangents that it has found.
#[derive(Default)]
pub(super) struct SeriesPull {
    /// λ_m of even m and of odd m.
    later: [Vec<f64>; 2],
    /// Powers B_k r of each group, and their degree: none where the weight is constant, and its cotangent is not wanted.
    groups: Vec<(TransposedPowers, Option<usize>)>,
    /// Whether cotangents of weights are wanted; that of the first group is 1 at all times.
    is_wanted: bool,
    /// Cotangents of the weights of all groups, one power after another.
    pub(super) weights: Vec<f64>,
    pub(super) potential: PotentialPull,
}

impl SeriesPull {
    /// Begins with the last term, of vectors of a size and an H with so many rows.
    pub(super) fn begin(
        &mut self,
        piece: &SeriesPiece,
        wanted: Wanted,
        (size, places): (usize, usize),
        outputs: &[Scaled<'_>],
    ) {
        let SeriesPiece { window, fit, .. } = piece;
        for x in &mut self.later {
            x.clear();
            x.resize(size, 0.0);
        }
        combine(&mut self.later[(piece.count() - 1) % 2], outputs);
        self.is_wanted = wanted.weights;
        self.weights.clear();
        self.weights.resize(fit.weights.len(), 0.0);
        let groups = fit.weights.len() / (fit.degree + 1);
        self.groups.resize_with(groups, Default::default);
        for (k, (powers, degree)) in self.groups.iter_mut().enumerate() {
            let may_change = self.is_wanted && k > 0;
            *degree = (varies(fit, k) || may_change).then_some(fit.degree);
            if let Some(degree) = *degree {
                powers.begin(window, degree, size);
            }
        }
        self.potential
            .begin((window, fit), (size, places), wanted.potential);
    }

    /// Goes on to the next lower term m: λ_m is that of the terms behind it, and of the outputs with these factors.
    pub(super) fn step(
        &mut self,
        (piece, terms): (&SeriesPiece, &mut Terms),
        m: usize,
        outputs: &[Scaled<'_>],
        term: Option<&Vec<f64>>,
    ) -> Result<(), StepError> {
        let SeriesPiece { window, fit, .. } = piece;
        let [even, odd] = &mut self.later;
        // in place of the cotangent of the term m + 2
        let (now, next) = if m.is_multiple_of(2) {
            (even, odd)
        } else {
            (odd, even)
        };
        let (scale, mut keep) = match window.form {
            Form::Powers => (window.h / (m + 1) as f64, 0.0),
            Form::Bessel => (2.0 / window.beta, if m == 0 { 2.0 } else { 1.0 }),
        };
        for (k, (powers, degree)) in self.groups.iter_mut().enumerate() {
            let diagonal = if k == 0 { -window.sigma } else { 0.0 };
            if degree.is_some() {
                let set = Update {
                    keep: 0.0,
                    ..Update::added(1.0)
                };
                terms.add_times_i(k, scale, set, next, powers.advance(m))?;
            }
            if degree.is_some() && k == 0 {
                keep_times(now, keep);
                add_i(scale * diagonal, next, now);
            } else if degree.is_none() && (k == 0 || fit.weights[k] != 0.0) {
                let update = Update {
                    keep,
                    factor: fit.weights[k],
                    diagonal,
                };
                terms.add_times_i(k, scale, update, next, now)?;
            }
            keep = 1.0;
        }
        let r = |out: &mut [f64]| {
            keep_times(out, 0.0);
            add_i(scale, next, out);
        };
        self.potential.add((fit, m), r, now, term);
        let (groups, weights) = (&mut self.groups, &mut self.weights);
        let (count, term) = (groups.len(), term.filter(|_| self.is_wanted));
        by_blocks(
            now.len(),
            #[inline(always)]
            |rows| {
                let out = &mut now[rows.clone()];
                add_all(out, outputs, rows.clone());
                for (k, (powers, degree)) in groups.iter_mut().enumerate() {
                    let Some(degree) = *degree else { continue };
                    powers.make(rows.clone());
                    for l in (0..=degree).step_by(2) {
                        let places = [l * count + k, (l + 1) * count + k];
                        let [one, two] = [l, (l + 1).min(degree)];
                        let last = if two > l { fit.weights[places[1]] } else { 0.0 };
                        let two = [
                            (fit.weights[places[0]], powers.power(one, rows.clone())),
                            (last, powers.power(two, rows.clone())),
                        ];
                        let Some(term) = term else {
                            add(out, two[0].0, two[0].1);
                            add(out, two[1].0, two[1].1);
                            continue;
                        };
                        let found = add_and_pair(out, two, &term[rows.clone()]);
                        for (place, found) in places.iter().zip(found) {
                            if let Some(weight) = weights.get_mut(*place) {
                                *weight += found;
                            }
                        }
                    }
                }
            },
        );
        Ok(())
    }

    /// The cotangent of the first term.
    pub(super) fn found(&self) -> &[f64] {
        &self.later[0]
    }
}
