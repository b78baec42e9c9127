//! Where a frozen matrix was made: with it the matrix is made again, to the same bits.

use super::State;
use super::solve::{Reaction, Solver, Step};

/// The step and the unknowns that a frozen matrix belongs to.
#[derive(Clone, Debug)]
pub(super) struct Origin {
    t: f64,
    state: State,
    phi: Vec<f64>,
    reactions: [Reaction; 2],
}

impl Origin {
    pub(super) fn new(solver: &Solver) -> Self {
        let none = || vec![0.0; solver.phi.len()];
        Self {
            t: 0.0,
            state: State {
                y: none(),
                z: none(),
                a: none(),
                phi: none(),
                h: 0.0,
                work: 0.0,
                power: 0.0,
            },
            phi: none(),
            reactions: solver.reactions.clone(),
        }
    }

    /// Keeps the step and the unknowns.
    pub(super) fn keep(&mut self, solver: &Solver, step: Step) {
        self.t = step.t;
        self.state.clone_from(step.state);
        self.phi.clone_from(&solver.phi);
        for (kept, reaction) in self.reactions.iter_mut().zip(&solver.reactions) {
            kept.a.clone_from(&reaction.a);
            kept.lam.clone_from(&reaction.lam);
        }
    }

    /// Puts a solver there again, and says for which step of h.
    pub(super) fn put_back(&self, solver: &mut Solver, h: f64) -> Step<'_> {
        let (t, state) = (self.t, &self.state);
        let step = Step { t, h, state };
        solver.prepare(step);
        solver.phi.clone_from(&self.phi);
        solver.reactions.clone_from(&self.reactions);
        step
    }
}

liouville_base::checkpoint!(Origin {
    t,
    state,
    phi,
    reactions
});
