//! The tapes of the derivatives of a step.

use super::Reactions;
use liouville_base::linalg::Pattern;
use liouville_base::tape::Tape;

/// Tapes of the derivatives of a step; their last input is the parameters.
#[derive(Clone, Debug)]
pub struct AlphaSlopes {
    /// (t0, h, y0, z0, a0, φ0, u) → E_u, on its pattern.
    pub matrix: Tape,
    /// Where E_u is not zero.
    pub pattern: Pattern,
    /// (t0, h, y0, z0, a0, φ0, u, dx) → E_x dx
    pub equations: Tape,
    /// (t0, h, y0, z0, a0, φ0, u, dx, du) → (dy1, dz1, da1)
    pub end: Tape,
    /// (t, y, z, φ, d(t, y, z, θ)) → (F − M φ)_x dx
    pub start: Tape,
}

impl AlphaSlopes {
    /// Whether they are those of a system with n coordinates, m constraints and so many parameters.
    #[must_use]
    pub fn fit(&self, (n, m, params): (usize, usize, usize), reactions: Reactions) -> bool {
        let unknowns = match reactions {
            Reactions::Position => n + m,
            Reactions::Extended { .. } if m > 0 => 3 * n + 2 * m,
            Reactions::Extended { .. } => n,
        };
        let x = 2 + 4 * n + params;
        let point = [1, 1, n, n, n, n, unknowns];
        let takes = |tape: &Tape, more: &[usize], outputs: usize| {
            let wanted = point.iter().chain(more).chain([&params]);
            tape.inputs().iter().eq(wanted) && tape.outputs() == outputs
        };
        self.pattern.shape() == (unknowns, unknowns)
            && takes(&self.matrix, &[], self.pattern.len())
            && takes(&self.equations, &[x], unknowns)
            && takes(&self.end, &[x, unknowns], 3 * n)
            && self.start.inputs() == [1, n, n, n, 1 + 2 * n + params, params]
            && self.start.outputs() == n
    }
}
