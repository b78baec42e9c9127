//! Triangular pieces, stepped by explicit Runge-Kutta methods (A, b), whose adjoints are explicit too.
//!
//! The step is the usual one. Its adjoint Φ* = (Φ_{−h})⁻¹ by forward substitution, z the result,
//!
//!     K_r = F_i(Z_r),   z_i = x_i + h Σ b_r K_r,   Z_{r,i} = z_i − h Σ_{q<r} A_rq K_q,
//!
//! variable after variable. Variables that do not depend on one another are one level. Forward Euler
//! needs no stages: levels backwards are the step, forwards its adjoint.

use super::layout::SplitLayout;
use super::rows::PolynomialRows;
use crate::problem::Polynomials;

/// A piece with a Runge-Kutta method.
#[derive(Clone, Debug)]
pub(super) struct Triangular {
    /// Rows that depend on earlier levels only.
    pub(super) levels: Vec<PolynomialRows>,
    /// Number of stages.
    pub(super) stages: usize,
    /// A, row by row.
    pub(super) a: Vec<f64>,
    pub(super) b: Vec<f64>,
}

impl Triangular {
    pub(super) fn new(
        layout: &SplitLayout<'_>,
        order: &[usize],
        change: &Polynomials,
        a: &[f64],
        b: &[f64],
    ) -> Self {
        let mut level = vec![0_usize; layout.split.n()];
        let mut levels: Vec<Vec<(usize, usize)>> = Vec::new();
        let mut is_done = vec![false; layout.split.n()];
        for (row, &variable) in order.iter().enumerate() {
            let earlier = change
                .row_factors(row)
                .iter()
                .map(|factor| *factor as usize);
            let earlier = earlier.filter(|factor| is_done[*factor]);
            let mine = earlier.map(|factor| level[factor] + 1).max().unwrap_or(0);
            is_done[variable] = true;
            level[variable] = mine;
            if levels.len() <= mine {
                levels.resize(mine + 1, Vec::new());
            }
            levels[mine].push((row, layout.order.place_of(variable)));
        }
        let compiled = levels.iter_mut().map(|level| {
            level.sort_unstable_by_key(|(_, place)| *place);
            layout.compiled(change, level)
        });
        Self {
            levels: compiled.collect(),
            stages: b.len(),
            a: a.to_vec(),
            b: b.to_vec(),
        }
    }

    /// Whether the method is x + h F(x).
    #[allow(clippy::float_cmp)] // as it was given
    pub(super) fn is_euler(&self) -> bool {
        self.b == [1.0]
    }
}
