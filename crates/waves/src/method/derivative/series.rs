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

use super::majorant::Majorant;
use super::potential::PotentialPull;
use super::powers::TransposedPowers;
use super::{AtNodes, Wanted, copied, inner, turn};
use crate::method::driven::choice::{Form, LARGEST, Window};
use crate::method::driven::factors::Factors;
use crate::method::driven::fit::Fit;
use crate::method::driven::polynomials::{NodeMap, by_nodes};
use crate::method::driven::terms::Terms;
use crate::problem::Update;
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;

/// A state within a window: where, and the factors of the terms.
pub(in crate::method) struct Output {
    pub(in crate::method) s: f64,
    pub(in crate::method) factors: Vec<f64>,
}

/// A window as it was made.
pub(in crate::method) struct SeriesPiece {
    /// e^{i phase} ψ at its start.
    pub(in crate::method) start: Vec<f64>,
    pub(in crate::method) phase: f64,
    pub(in crate::method) window: Window,
    pub(in crate::method) fit: Fit,
    /// |h| times the norm of each power of the fit from the first on.
    pub(in crate::method) sizes: Vec<f64>,
    /// A bound of the terms that are left out, relative to the state.
    pub(in crate::method) tail: f64,
    /// Times, and the coefficients of the fit by the weights of H there.
    pub(in crate::method) nodes: Vec<f64>,
    pub(in crate::method) map: NodeMap,
    /// The ends of steps, and at last the end of the window.
    pub(in crate::method) outputs: Vec<Output>,
    pub(in crate::method) steps: usize,
    /// Whether the fit has a weight for each term, not for each group of terms.
    pub(in crate::method) is_by_terms: bool,
}

impl SeriesPiece {
    fn count(&self) -> usize {
        let counts = self.outputs.iter().map(|output| output.factors.len());
        counts.max().unwrap_or(0)
    }

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

    /// See [`super::Derivative::raise`].
    pub(super) fn raise(&mut self, degree: usize) {
        let powers = self.fit.degree + 1;
        if degree < powers {
            return;
        }
        for values in [&mut self.fit.weights, &mut self.fit.potential] {
            values.resize(values.len() / powers * (degree + 1), 0.0);
        }
        self.fit.degree = degree;
        self.map = by_nodes(degree);
    }

    /// See [`super::Derivative::lengthen`].
    pub(super) fn lengthen(&mut self, changes: &[f64], tolerance: f64) -> Option<bool> {
        let (degree, form) = (self.fit.degree, self.window.form);
        let width = changes.len() / self.nodes.len();
        if width == 0 && degree == 0 && form == Form::Bessel {
            return Some(false); // bounds of the spectrum are for all states
        }
        let found = match (width, degree) {
            (0, _) => Vec::new(),
            (_, 0) => vec![1.0],
            _ => self.map.apply(changes, width, degree),
        };
        let sizes = found.chunks(width.max(1));
        let sizes = sizes.map(|row| row.iter().fold(0.0, |most: f64, x| most.max(x.abs())));
        let majorant = Majorant {
            theta: self.window.beta * self.window.h.abs(),
            sizes: self.sizes.clone(),
            changes: sizes.collect(),
            tolerances: (self.tail, tolerance),
        };
        let powers = || Some((Form::Powers, majorant.powers()?));
        let own = match form {
            Form::Powers => powers(),
            // bounds of the spectrum are for the terms of all states
            Form::Bessel if degree == 0 => Majorant {
                tolerances: (f64::INFINITY, tolerance),
                ..majorant.clone()
            }
            .bessel()
            .map(|length| (form, length)),
            Form::Bessel => majorant.bessel().map(|length| (form, length)),
        };
        let best = match own {
            Some((Form::Bessel, length)) if length.largest > LARGEST => {
                powers().filter(|(_, other)| other.largest < length.largest)
            }
            Some(_) => None,
            None => powers(),
        };
        let (form, length) = best.or(own)?;
        if form == self.window.form && length.count <= self.count() {
            return Some(false);
        }
        self.window.form = form;
        for output in &mut self.outputs {
            let factors = Factors::new(&self.window, output.s);
            output.factors = (0..length.count)
                .map(|n| factors.of(&self.window, n))
                .collect();
        }
        Some(true)
    }

    /// See [`super::Derivative::keep_ends`].
    pub(super) fn keep_start(
        &mut self,
        terms: &mut Terms,
        state: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        self.start.copy_from_slice(state);
        turn(&mut self.start, self.phase);
        self.repeat(terms, state, &AtNodes::default())?;
        Ok(())
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

    /// See [`super::Derivative::pull`].
    pub(super) fn pull(
        &self,
        terms: &mut Terms,
        cotangent: &mut Vec<f64>,
        of_steps: &[Vec<f64>],
        wanted: Wanted,
    ) -> Result<AtNodes, StepError> {
        let (window, fit, count) = (&self.window, &self.fit, self.count());
        let (form, size) = (window.form, cotangent.len());
        let is_wanted = wanted.weights;
        let kept = if wanted == Wanted::default() {
            Vec::new()
        } else {
            self.terms_of(terms)?
        };
        let outputs = self.turned(cotangent, of_steps);
        let groups = fit.weights.len() / (fit.degree + 1);
        let has_power = |k: usize| (1..=fit.degree).any(|l| fit.weights[l * groups + k] != 0.0);
        // the weight of the first group is 1 at all times; another may change where it is zero
        let may_change = |k: usize| is_wanted && k > 0;
        let degree_of = |k: usize| {
            if has_power(k) || may_change(k) {
                fit.degree
            } else {
                0
            }
        };
        let mut powers: Vec<TransposedPowers> = (0..groups)
            .map(|k| TransposedPowers::new(form, degree_of(k), size))
            .collect();
        let sizes = (size, terms.places());
        let mut potential = PotentialPull::new(fit, form, sizes, wanted.potential);
        let mut weights = vec![0.0; fit.weights.len()];
        let mut later = [vec![0.0; size], vec![0.0; size]];
        let mut r = vec![0.0; size];
        for m in (0..count).rev() {
            // in place of the cotangent of the term m + 2
            let [even, odd] = &mut later;
            let (now, next) = if m % 2 == 0 { (even, odd) } else { (odd, even) };
            let keep = match form {
                Form::Powers => 0.0,
                Form::Bessel => f64::from(if m == 0 { 2 } else { 1 }),
            };
            for x in now.iter_mut() {
                *x *= keep;
            }
            for (output, x) in self.outputs.iter().rev().zip(outputs.iter().rev()) {
                if let Some(factor) = output.factors.get(m) {
                    add_scaled(now, *factor, x);
                }
            }
            if m + 1 == count {
                continue;
            }
            let scale = match form {
                Form::Powers => window.h / (m + 1) as f64,
                Form::Bessel => 2.0 / window.beta,
            };
            times_i(scale, next, &mut r);
            for (k, own) in powers.iter_mut().enumerate() {
                let diagonal = if k == 0 { -window.sigma } else { 0.0 };
                if degree_of(k) == 0 && !may_change(k) {
                    let factor = fit.weights[k];
                    let update = Update {
                        keep: 1.0,
                        factor,
                        diagonal,
                    };
                    terms.multiply_by(k, update, &mut r, now)?;
                    continue;
                }
                let set = Update {
                    keep: 0.0,
                    ..Update::added(1.0)
                };
                terms.multiply_by(k, set, &mut r, own.begin(window, m))?;
                add_scaled(now, diagonal, &r);
                for l in 0..=degree_of(k) {
                    let (u, weight) = (own.power(form, l), fit.weights[l * groups + k]);
                    if weight != 0.0 {
                        add_scaled(now, weight, u);
                    }
                    if may_change(k) {
                        weights[l * groups + k] += inner(u, &kept[m]);
                    }
                }
            }
            potential.add((window, fit, m), &r, now, kept.get(m));
        }
        *cotangent = std::mem::take(&mut later[0]);
        turn(cotangent, -self.phase);
        let at_nodes =
            |values: &[f64], width: usize| self.map.transposed(values, width, fit.degree);
        let mut found = AtNodes::default();
        if wanted.weights {
            found.weights = at_nodes(&weights, groups);
        }
        if wanted.potential {
            found.potential = at_nodes(&potential.found, potential.places);
        }
        Ok(found)
    }

    /// All terms of the series.
    fn terms_of(&self, terms: &mut Terms) -> Result<Vec<Vec<f64>>, StepError> {
        terms.begin(&self.window, self.fit.degree, &self.start);
        let mut kept = vec![copied(terms.newest(), 0)?];
        while kept.len() < self.count() {
            terms.advance(&self.window, &self.fit)?;
            kept.push(copied(terms.newest(), 0)?);
        }
        Ok(kept)
    }

    /// The cotangents of all outputs, without phases.
    fn turned(&self, cotangent: &[f64], of_steps: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut found = of_steps.to_vec();
        if self.steps < self.outputs.len() {
            found.push(cotangent.to_vec());
        } else if let Some(end) = found.last_mut() {
            add_scaled(end, 1.0, cotangent);
        }
        for (output, x) in self.outputs.iter().zip(&mut found) {
            turn(x, self.angle(output));
        }
        found
    }
}

/// Sets `out` to i times a multiple of `x`.
fn times_i(scale: f64, x: &[f64], out: &mut [f64]) {
    let half = x.len() / 2;
    let ((x_q, x_p), (q, p)) = (x.split_at(half), out.split_at_mut(half));
    for (out, x) in q.iter_mut().zip(x_p) {
        *out = -scale * x;
    }
    for (out, x) in p.iter_mut().zip(x_q) {
        *out = scale * x;
    }
}
