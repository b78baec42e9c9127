//! The equation for λ: y1 meets its constraints.

use super::inertia::Inertia;
use super::reactions::Reactions;
use crate::linalg::{add_scaled, copy, max_norm};
use crate::newton::Equations;
use crate::problem::mechanical::{SeparableModel, State};
use crate::trouble::Trouble;

/// The step being made: from `state` at `t` over `h`.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) state: &'a State,
}

/// λ, and y1 with it.
#[derive(Clone, Debug)]
pub(super) struct Positions {
    pub(super) lam: Vec<f64>,
    d_lam: Vec<f64>,
    y: Vec<f64>,
    v: Vec<f64>,
    /// What p has lost to rounding, with the impulse of the forces.
    low: Vec<f64>,
    /// −G0ᵀ λ, and its change.
    reaction: Vec<f64>,
    change: Vec<f64>,
    momenta: Vec<f64>,
}

/// The equation in the middle of being solved.
pub(super) struct Solve<'a> {
    at: &'a mut Positions,
    model: &'a mut SeparableModel,
    inertia: &'a mut Inertia,
    reactions: &'a mut Reactions,
    step: Step<'a>,
    /// The velocity that moves the coordinates by their own size, and those there are.
    scale: Option<f64>,
    pub(super) factorizations: usize,
}

impl Positions {
    pub(super) fn new(n: usize, m: usize) -> Self {
        let zeros = vec![0.0; n];
        Self {
            lam: vec![0.0; m],
            d_lam: vec![0.0; m],
            y: zeros.clone(),
            v: zeros.clone(),
            low: zeros.clone(),
            reaction: zeros.clone(),
            change: zeros.clone(),
            momenta: zeros,
        }
    }

    /// The equation of one step with forces `force` at its start, from the λ there is.
    pub(super) fn start<'a>(
        &'a mut self,
        model: &'a mut SeparableModel,
        inertia: &'a mut Inertia,
        reactions: &'a mut Reactions,
        force: &[f64],
        step: Step<'a>,
    ) -> Solve<'a> {
        copy(&mut self.low, &step.state.p_low);
        add_scaled(&mut self.low, 0.5 * step.h, force);
        self.reaction.fill(0.0);
        reactions.push(&self.lam, -1.0, &mut self.reaction);
        Solve {
            at: self,
            model,
            inertia,
            reactions,
            step,
            scale: None,
            factorizations: 0,
        }
    }

    /// y1, once it is found.
    pub(super) fn y(&self) -> &[f64] {
        &self.y
    }

    pub(super) fn y_mut(&mut self) -> &mut [f64] {
        &mut self.y
    }

    /// What forces and reactions add to p over the time `half`, with what p has lost to rounding.
    pub(super) fn impulse(&self, half: f64, out: &mut [f64]) {
        for ((out, low), r) in out.iter_mut().zip(&self.low).zip(&self.reaction) {
            *out = low + half * r;
        }
    }
}

impl Equations for Solve<'_> {
    fn correct(&mut self) -> Result<f64, Trouble> {
        let (at, Step { t, h, state }) = (&mut *self.at, self.step);
        if at.lam.is_empty() {
            return Ok(0.0);
        }
        let half = 0.5 * h;
        let mut momenta = std::mem::take(&mut at.momenta);
        at.impulse(half, &mut momenta);
        self.inertia.velocity(&state.p, &momenta, &mut at.v);
        at.momenta = momenta;
        let from = state.y.iter().zip(&state.y_low);
        for (out, ((y, low), v)) in at.y.iter_mut().zip(from.zip(&at.v)) {
            *out = y + (low + h * v);
        }
        copy(&mut at.d_lam, self.model.constraint(t + h, &at.y)?);
        let scale = if let Some(scale) = self.scale {
            scale
        } else {
            let reactions = &mut *self.reactions;
            self.factorizations += reactions.factor_at(self.model, t + h, &at.y)?;
            *self
                .scale
                .insert(max_norm(&at.v) + max_norm(&state.y) / h.abs())
        };
        self.reactions.solve_positions(self.model, &mut at.d_lam);
        let unit = 1.0 / (half * h);
        add_scaled(&mut at.lam, unit, &at.d_lam);
        at.change.fill(0.0);
        self.reactions.push(&at.d_lam, -unit, &mut at.change);
        add_scaled(&mut at.reaction, 1.0, &at.change);
        self.inertia.move_by(&mut at.change);
        let size = half.abs() * max_norm(&at.change);
        Ok(if size == 0.0 { 0.0 } else { size / scale })
    }
}
