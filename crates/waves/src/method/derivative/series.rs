//! The derivatives of a window of a series, which is a recurrence; so is its transpose, with as many products:
//!
//!     c_{n+1} = κ_n c_{n−1} − i s_n [Σ_k B_k Σ_l g_lk y^l_n − σ c_n],       ψ_j = e^{−iσs_j} Σ_n F_jn c_n
//!     λ_n = Σ_j F_jn x_j + κ_{n+1} λ_{n+2} + Σ_lk g_lk u^lk_n − σ r_n,      r_n = i s_n λ_{n+1},  u^0k_n = B_k r_n
//!     cotangent of g_lk = Σ_n u^lk_n · c_n
//!
//! A potential is a group of each of its places, whose B is a one there: V_l(x) has the cotangent Σ_n u^l_n(x) · c_n(x) with
//! u^0_n = r_n, and
//!
//! x_j = e^{iσs_j} times the cotangent of ψ_j. Source: the transpose of the series of `driven`.

use super::majorant::{Output, SeriesPiece};
use super::pull::SeriesPull;
use crate::method::blocks::{Scaled, turn};
use crate::method::driven::polynomials::{AtNodes, Wanted};
use crate::method::driven::terms::Terms;
use crate::method::driven::whole::Fit;
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;

impl SeriesPiece {
    /// The angle of the phase that is left out at an output.
    fn angle(&self, output: &Output) -> f64 {
        self.phase + self.window.sigma * output.s
    }

    /// The fit of changes of H at the nodes, none where none are given.
    fn change_of(&self, of_nodes: &AtNodes) -> Option<Fit> {
        let degree = self.fit.degree;
        let fitted = |values: &[f64]| match values {
            [] => Vec::new(),
            _ => self
                .map
                .apply(values, values.len() / self.nodes.len(), degree),
        };
        let (mut weights, potential) = (fitted(&of_nodes.weights), fitted(&of_nodes.potential));
        if weights.is_empty() {
            weights.resize(self.fit.weights.len(), 0.0);
        }
        (*of_nodes != AtNodes::default()).then_some(Fit {
            degree,
            weights,
            potential,
        })
    }

    /// See [`super::Derivative::repeat`].
    pub(super) fn repeat(
        &self,
        terms: &mut Terms,
        state: &mut Vec<f64>,
        change: &AtNodes,
    ) -> Result<Vec<Vec<f64>>, StepError> {
        let mut fit = self.fit.clone();
        if let Some(change) = self.change_of(change) {
            add_scaled(&mut fit.weights, 1.0, &change.weights);
            if fit.potential.is_empty() {
                fit.potential = change.potential;
            } else if !change.potential.is_empty() {
                add_scaled(&mut fit.potential, 1.0, &change.potential);
            }
        }
        turn(state, self.phase);
        terms.begin(&self.window, fit.degree, state);
        let mut found = vec![vec![0.0; state.len()]; self.outputs.len()];
        for n in 0..self.count() {
            if n > 0 {
                terms.advance(&self.window, &fit)?;
            }
            for (output, out) in self.outputs.iter().zip(&mut found) {
                if let Some(factor) = output.factors.get(n) {
                    add_scaled(out, *factor, terms.newest());
                }
            }
        }
        for (output, x) in self.outputs.iter().zip(&mut found) {
            turn(x, -self.angle(output));
        }
        state.clone_from(&found[self.outputs.len() - 1]);
        found.truncate(self.steps);
        Ok(found)
    }

    /// See [`super::Derivative::follow`].
    pub(super) fn follow(
        &self,
        (terms, moved): (&mut Terms, &mut [Terms]),
        changes: &mut [Vec<f64>],
        of_nodes: &[AtNodes],
    ) -> Result<Vec<Vec<f64>>, StepError> {
        let (window, fit, count) = (&self.window, &self.fit, self.count());
        terms.begin(window, fit.degree, &self.start);
        let fits: Vec<Option<Fit>> = of_nodes.iter().map(|own| self.change_of(own)).collect();
        for (moved, change) in moved.iter_mut().zip(&mut *changes) {
            turn(change, self.phase);
            moved.begin(window, fit.degree, change);
        }
        let directions = moved.len();
        let mut found = vec![vec![0.0; self.start.len()]; self.outputs.len() * directions];
        for n in 0..count {
            for (output, found) in self.outputs.iter().zip(found.chunks_mut(directions)) {
                if let Some(factor) = output.factors.get(n) {
                    for (out, moved) in found.iter_mut().zip(&*moved) {
                        add_scaled(out, *factor, moved.newest());
                    }
                }
            }
            if n + 1 < count {
                for (moved, change) in moved.iter_mut().zip(&fits) {
                    let other = change.as_ref().map(|change| (&*terms, change));
                    moved.advance_from(window, fit, other)?;
                }
                terms.advance(window, fit)?;
            }
        }
        for (output, found) in self.outputs.iter().zip(found.chunks_mut(directions)) {
            for x in found {
                turn(x, -self.angle(output));
            }
        }
        let ends = found.split_off((self.outputs.len() - 1) * directions);
        for (change, end) in changes.iter_mut().zip(&ends) {
            change.copy_from_slice(end);
        }
        if self.steps == self.outputs.len() {
            found.extend(ends);
        }
        found.truncate(self.steps * directions);
        Ok(found)
    }

    /// See [`super::Derivative::pull`]; the terms are returned, and made where they are needed and not given.
    pub(super) fn pull(
        &self,
        (terms, pull): (&mut Terms, &mut SeriesPull),
        cotangent: &mut [f64],
        of_steps: &[Vec<f64>],
        (wanted, kept): (Wanted, Vec<Vec<f64>>),
    ) -> Result<(AtNodes, Vec<Vec<f64>>), StepError> {
        let (window, fit, count) = (&self.window, &self.fit, self.count());
        let outputs = self.turned(cotangent, of_steps);
        let kept = if kept.is_empty() && wanted != Wanted::default() {
            terms.all(count, window, fit, &self.start)?
        } else {
            kept
        };
        let scaled = |m: usize| -> Vec<Scaled<'_>> {
            let factor = |output: usize| self.outputs[output].factors.get(m);
            let each = outputs.iter();
            each.filter_map(|(output, x)| Some((*factor(*output)?, x.as_slice())))
                .collect()
        };
        let sizes = (cotangent.len(), terms.places());
        pull.begin(self, wanted, sizes, &scaled(count - 1));
        for m in (0..count - 1).rev() {
            pull.step((self, terms), m, &scaled(m), kept.get(m))?;
        }
        cotangent.copy_from_slice(pull.found());
        turn(cotangent, -self.phase);
        let at_nodes =
            |values: &[f64], width: usize| self.map.transposed(values, width, fit.degree);
        let mut found = AtNodes::default();
        if wanted.weights {
            found.weights = at_nodes(&pull.weights, terms.groups());
        }
        if wanted.potential {
            found.potential = at_nodes(&pull.potential.found, pull.potential.places);
        }
        Ok((found, kept))
    }

    /// The cotangents of outputs, without phases: those that are not zero, and that of the end.
    fn turned(&self, cotangent: &[f64], of_steps: &[Vec<f64>]) -> Vec<(usize, Vec<f64>)> {
        let (end, each) = (self.outputs.len() - 1, of_steps.iter().cloned().enumerate());
        let is_there = |(_, x): &(usize, Vec<f64>)| x.iter().any(|x| *x != 0.0);
        let mut found: Vec<(usize, Vec<f64>)> = each.filter(is_there).collect();
        match found.last_mut().filter(|(output, _)| *output == end) {
            Some((_, x)) => add_scaled(x, 1.0, cotangent),
            None => found.push((end, cotangent.to_vec())),
        }
        for (output, x) in &mut found {
            turn(x, self.angle(&self.outputs[*output]));
        }
        found
    }
}
