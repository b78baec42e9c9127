//! The matrix of an index-1 solve as it stands, sparse:
//!
//!     [ p_z    0   −u r_λ  −u r_ν ]
//!     [ v_z   −1      0       0   ]
//!     [  0    g_y     0       0   ]
//!     [ k_z    0      0       0   ]
//!
//! with V = v_z x for a further unknown, where v is not z, and u the unit of the multipliers.

use super::{Mechanical, NonholonomicPatterns};
use liouville_base::linalg::{Assembly, Factor, Pattern, Singular, copy_scaled, max_norm};
use liouville_base::real::Real;

/// Where the blocks of the matrix are not zero.
#[derive(Clone, Copy)]
pub(super) struct KktPatterns<'a> {
    pub(super) p_z: &'a Pattern,
    pub(super) v_z: Option<&'a Pattern>,
    pub(super) g_y: &'a Pattern,
    pub(super) r_lam: &'a Pattern,
    pub(super) nonholonomic: Option<&'a NonholonomicPatterns>,
}

/// The blocks of nonholonomic constraints.
#[derive(Clone, Debug)]
pub(super) struct NonholonomicBlocks<R> {
    pub(super) k_z: Vec<R>,
    pub(super) r_nu: Vec<R>,
}

/// The KKT matrix, factored.
#[derive(Clone, Debug)]
pub(super) struct KktMatrix<R = f64> {
    matrix: Assembly<R>,
    factor: Factor<R>,
    /// x, V where there is a `v_z`, and μ in its unit.
    unknowns: Vec<R>,
    /// −1 of V, where there is a `v_z`.
    minus_one: Vec<R>,
    /// The unit of μ.
    unit: R,
}

impl<R: Real> KktMatrix<R> {
    /// Memory for the matrix of a system.
    pub(super) fn of(problem: &Mechanical) -> Self {
        let at = &problem.patterns;
        Self::new(KktPatterns {
            p_z: &at.p_z,
            v_z: at.v_z.as_ref(),
            g_y: &at.g_y,
            r_lam: &at.r_lam,
            nonholonomic: problem.nonholonomic.as_ref().map(|own| &own.patterns),
        })
    }

    /// Memory for the matrix of these blocks.
    pub(super) fn new(at: KktPatterns) -> Self {
        let (m, n) = at.g_y.shape();
        let one = Pattern::diagonal(n);
        let end = if at.v_z.is_some() { 2 * n } else { n };
        let mut blocks = vec![(at.p_z, 0, 0), (at.r_lam, 0, end), (at.g_y, end, end - n)];
        if let Some(v_z) = at.v_z {
            blocks.extend([(v_z, n, 0), (&one, n, n)]);
        }
        let mut order = end + m;
        if let Some(own) = at.nonholonomic {
            blocks.extend([(&own.r_nu, 0, order), (&own.k_z, order, 0)]);
            order += own.k_z.shape().0;
        }
        let matrix = Assembly::new((order, order), &blocks);
        Self {
            factor: Factor::new(matrix.pattern()),
            matrix,
            unknowns: vec![R::splat(0.0); order],
            minus_one: vec![R::splat(-1.0); end - n],
            unit: R::splat(1.0),
        }
    }

    /// Factors the matrix with these values of its blocks.
    pub(super) fn factor(
        &mut self,
        [p_z, v_z]: [&[R]; 2],
        g_y: &[R],
        r_lam: &[R],
        nonholonomic: Option<&NonholonomicBlocks<R>>,
    ) -> Result<(), Singular> {
        let r_nu = nonholonomic.map_or(R::splat(0.0), |own| max_norm(&own.r_nu));
        let unit = max_norm(p_z) / max_norm(r_lam).zip(r_nu, f64::max);
        self.unit = unit.map(|unit| if unit.is_normal() { unit } else { 1.0 });
        self.matrix.clear();
        self.matrix.add(0, p_z, 1.0);
        self.matrix.add(1, r_lam, -self.unit);
        self.matrix.add(2, g_y, 1.0);
        if !self.minus_one.is_empty() {
            self.matrix.add(3, v_z, 1.0);
            self.matrix.add(4, &self.minus_one, 1.0);
        }
        if let Some(own) = nonholonomic {
            let next = if self.minus_one.is_empty() { 3 } else { 5 };
            self.matrix.add(next, &own.r_nu, -self.unit);
            self.matrix.add(next + 1, &own.k_z, 1.0);
        }
        self.factor
            .factor(self.matrix.pattern(), self.matrix.values())
    }

    /// Solves in place: `a` becomes x, `b` becomes μ.
    pub(super) fn solve(&mut self, a: &mut [R], b: &mut [R]) {
        let end = self.unknowns.len() - b.len();
        self.unknowns[..a.len()].copy_from_slice(a);
        self.unknowns[a.len()..end].fill(R::splat(0.0));
        self.unknowns[end..].copy_from_slice(b);
        self.factor.solve(&mut self.unknowns);
        a.copy_from_slice(&self.unknowns[..a.len()]);
        copy_scaled(b, self.unit, &self.unknowns[end..]);
    }

    /// Solves with the transposed matrix in place.
    pub(super) fn solve_transposed(&mut self, x: &mut [R], mu: &mut [R]) {
        let end = self.unknowns.len() - mu.len();
        self.unknowns[..x.len()].copy_from_slice(x);
        self.unknowns[x.len()..end].fill(R::splat(0.0));
        copy_scaled(&mut self.unknowns[end..], self.unit, mu);
        self.factor.solve_transposed(&mut self.unknowns);
        x.copy_from_slice(&self.unknowns[..x.len()]);
        mu.copy_from_slice(&self.unknowns[end..]);
    }
}
