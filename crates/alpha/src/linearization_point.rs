//! The point at which the modified-Newton matrix of the α family is made.

use super::reaction::Reaction;
use super::unknowns::{AlphaSolver, AlphaStep};
use liouville_base::linalg::copy;

/// Where the matrix is made: the start of a step and its unknowns.
#[derive(Clone, Debug)]
pub(super) struct LinearizationPoint {
    pub(super) t: f64,
    pub(super) y0: Vec<f64>,
    pub(super) z0: Vec<f64>,
    pub(super) predicted: Vec<f64>,
    pub(super) y1: Vec<f64>,
    pub(super) z1: Vec<f64>,
    pub(super) phi: Vec<f64>,
    pub(super) reactions: [Reaction; 2],
}

impl LinearizationPoint {
    /// The point before the first step.
    pub(super) fn new(solver: &AlphaSolver) -> Self {
        let none = || vec![0.0; solver.phi.len()];
        Self {
            t: 0.0,
            y0: none(),
            z0: none(),
            predicted: none(),
            y1: none(),
            z1: none(),
            phi: none(),
            reactions: solver.reactions.clone(),
        }
    }

    /// Moves the point to the present unknowns of a step.
    pub(super) fn move_to(&mut self, solver: &AlphaSolver, step: AlphaStep) {
        self.t = step.t;
        for (kept, x) in [
            (&mut self.y0, &step.state.y),
            (&mut self.z0, &step.state.z),
            (&mut self.predicted, &solver.predicted),
            (&mut self.y1, &solver.y),
            (&mut self.z1, &solver.z),
            (&mut self.phi, &solver.phi),
        ] {
            copy(kept, x);
        }
        for (kept, reaction) in self.reactions.iter_mut().zip(&solver.reactions) {
            copy(&mut kept.a, &reaction.a);
            copy(&mut kept.lam, &reaction.lam);
        }
    }
}

liouville_base::checkpoint!(LinearizationPoint {
    t,
    y0,
    z0,
    predicted,
    y1,
    z1,
    phi,
    reactions
});
