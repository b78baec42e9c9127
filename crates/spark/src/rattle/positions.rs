//! The equation for λ: y1 meets its constraints.

use super::mass::ConstantMass;
use super::reactions::RattleReactions;
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, max_norm};
use liouville_base::newton::Equations;
use liouville_problem::{SeparableModel, State};

/// The step being made.
pub(super) type RattleStep<'a> = liouville_base::method::Step<'a, State>;

/// λ, and y1 with it.
#[derive(Clone, Debug)]
pub(super) struct Positions {
    pub(super) lam: Vec<f64>,
    d_lam: Vec<f64>,
    y: Vec<f64>,
    /// The rounding error of p, with the impulse of the forces.
    low: Vec<f64>,
    /// The move without reactions.
    free: Vec<f64>,
    /// −G0ᵀ λ, and its moves.
    reaction: Vec<f64>,
    moves: Vec<f64>,
}

/// The equation, with the parts that solve it.
pub(super) struct PositionEquations<'a> {
    at: &'a mut Positions,
    model: &'a mut SeparableModel,
    mass: &'a mut ConstantMass,
    reactions: &'a mut RattleReactions,
    step: RattleStep<'a>,
    /// The size of the coordinates and of the move itself, to measure corrections by.
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
            low: zeros.clone(),
            free: zeros.clone(),
            reaction: zeros.clone(),
            moves: zeros,
        }
    }

    /// The equation of one step with forces `force` at its start, from the λ there is.
    pub(super) fn start<'a>(
        &'a mut self,
        model: &'a mut SeparableModel,
        mass: &'a mut ConstantMass,
        reactions: &'a mut RattleReactions,
        force: &[f64],
        step: RattleStep<'a>,
    ) -> PositionEquations<'a> {
        let (
            h,
            State {
                p, p_low, y_low, ..
            },
        ) = (step.h, step.state);
        for ((out, low), f) in self.low.iter_mut().zip(p_low).zip(force) {
            *out = low + 0.5 * h * f;
        }
        mass.velocity(p, &self.low, &mut self.free);
        for (free, low) in self.free.iter_mut().zip(y_low) {
            *free = low + h * *free;
        }
        self.reaction.fill(0.0);
        reactions.apply_gt(&self.lam, -1.0, &mut self.reaction);
        PositionEquations {
            at: self,
            model,
            mass,
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

    pub(super) fn y_mut(&mut self) -> &mut Vec<f64> {
        &mut self.y
    }

    /// The impulse of forces and reactions over the time `half`, with the rounding error of p.
    pub(super) fn impulse(&self, half: f64, out: &mut [f64]) {
        for ((out, low), r) in out.iter_mut().zip(&self.low).zip(&self.reaction) {
            *out = low + half * r;
        }
    }
}

impl PositionEquations<'_> {
    /// y1 with the reactions there are.
    fn move_coordinates(&mut self) {
        let (at, y) = (&mut *self.at, &self.step.state.y);
        let time = 0.5 * self.step.h * self.step.h;
        let from = y.iter().zip(&at.free);
        if let Some(inverse_mass) = self.mass.inverse_mass() {
            let moves = at.reaction.iter().zip(inverse_mass);
            for ((out, (y, free)), (r, inverse_mass)) in at.y.iter_mut().zip(from).zip(moves) {
                *out = y + (free + time * (inverse_mass * r));
            }
        } else {
            copy(&mut at.moves, &at.reaction);
            self.mass.apply_inverse(&mut at.moves);
            for ((out, (y, free)), moved) in at.y.iter_mut().zip(from).zip(&at.moves) {
                *out = y + (free + time * moved);
            }
        }
    }
}

impl Equations for PositionEquations<'_> {
    /// Sizes are relative to the start of the step already.
    fn scaled_size(&self, size: f64) -> f64 {
        size
    }

    fn deviation(&self) -> f64 {
        let (at, Some(scale)) = (&*self.at, self.scale) else {
            return 0.0;
        };
        let free = self.step.state.y.iter().zip(&at.free);
        let moved =
            at.y.iter()
                .zip(free)
                .fold(0.0, |moved: f64, (y, (y0, free))| {
                    moved.max((y - y0 - free).abs())
                });
        if moved == 0.0 { 0.0 } else { moved / scale }
    }

    fn correct(&mut self) -> Result<f64, StepError> {
        if self.at.lam.is_empty() {
            return Ok(0.0);
        }
        self.move_coordinates();
        let (at, RattleStep { t, h, state }) = (&mut *self.at, self.step);
        let time = 0.5 * h * h;
        copy(&mut at.d_lam, self.model.constraint(t + h, &at.y)?);
        let scale = if let Some(scale) = self.scale {
            scale
        } else {
            let reactions = &mut *self.reactions;
            self.factorizations += reactions.factor_at(self.model, t + h, &at.y)?;
            *self.scale.insert(max_norm(&state.y) + max_norm(&at.free))
        };
        self.reactions.solve_positions(self.model, &mut at.d_lam);
        add_scaled(&mut at.lam, 1.0 / time, &at.d_lam);
        let moved = (&mut at.reaction[..], &mut at.moves[..]);
        let reactions = &self.reactions;
        let size = reactions.correct(self.mass, &at.d_lam, 1.0 / time, moved);
        Ok(if size == 0.0 { 0.0 } else { size / scale })
    }
}
