//! The estimate of the error of a step of the α family, which controls the next.

use super::state::AlphaState;
use super::unknowns::AlphaStep;
use super::{Alpha, Reactions};
use liouville_base::method::Estimating;

impl Alpha {
    /// The weights of a1 − a0 and of A1 − A0 in the estimate.
    pub(super) fn error_weights(&self) -> [f64; 2] {
        let constant = self.weights.error_constant();
        let of_reactions = match self.reactions {
            Reactions::Extended { b, .. } if (1.0 / 6.0 - b / 2.0).abs() > constant.abs() => {
                1.0 / 6.0 - b / 2.0
            }
            Reactions::Extended { .. } => constant,
            Reactions::Position => 0.0,
        };
        [constant, of_reactions]
    }

    /// The local error of y, to leading order, along the constraints:
    ///
    ///     h² P ((1/6 − Δ/2 − β) (a1 − a0) + (1/6 − b/2) (A1 − A0)),   P = I − M⁻¹ r_λ (g_y M⁻¹ r_λ)⁻¹ g_y
    ///
    /// Around b = 1/3, where the reactions' part of it vanishes, what they leave in z counts: they are
    /// weighted as a is.
    pub(super) fn estimate(&mut self, step: AlphaStep) {
        let [constant, of_reactions] = self.error_weights();
        let h2 = step.h * step.h;
        let [first, last] = &self.kept;
        for (k, error) in self.local_error.iter_mut().enumerate() {
            let by_a = constant * (self.other.a[k] - self.solver.a[k]);
            *error = h2 * (by_a + of_reactions * (last.a[k] - first.a[k]));
        }
        let error = &mut self.local_error;
        self.matrix.project(&self.model, error);
        let error = self.tolerance.as_ref().map(|tolerance| {
            let ends = [&step.state.y[..], &self.other.y];
            tolerance.weigh(ends, self.local_error.iter().copied())
        });
        self.error = error.filter(|e| !e.is_nan()).unwrap_or(f64::INFINITY);
    }
}

impl Estimating for Alpha {
    fn error(&self) -> f64 {
        self.error
    }

    fn error_order(&self) -> f64 {
        3.0
    }

    fn undo(&mut self, state: &mut AlphaState) {
        std::mem::swap(state, &mut self.other);
        self.restore_carried(state);
    }

    fn most_corrections(&self) -> f64 {
        self.solver.stop().most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.insists = insists;
    }
}
