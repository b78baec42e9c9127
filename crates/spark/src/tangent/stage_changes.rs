//! The changes of points, impulses and residuals that derivatives by y, z and λ lead to, or cotangents of these.
//!
//! The points move by V_j, the impulses h b_j f_j, h b̂_j r_j and h b_j r_n by the points and by Z_j, Λ_j and ν_j, and the
//! residuals by points and impulses:
//!
//!     Σ_j μᶠ_ij d(h b_j f_j) + Σ_{j<k} μ̂_ij d(h b̂_j r_j) − p_y dY_i,   −g_y dŶ_j / h,   v_y dY_i
//!
//! Each function is called forwards or transposed.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::super::derivatives::Derivatives;
use super::super::full_newton::Offsets;
use liouville_base::linalg::Matrix;
use liouville_base::linear::{RowWeights, add, add_product, in_order, set};
use liouville_base::real::Real;
use liouville_base::tableau;
use liouville_problem::Mechanical;

/// The memory of these changes.
#[derive(Clone, Debug)]
pub(super) struct StageChanges<R = f64> {
    pub(super) tableau: tableau::Spark,
    pub(super) offsets: Offsets,
    /// μᵛ with μ̄ below, and μᶠ with μ̂ and μʳ behind.
    to_points: RowWeights,
    to_momenta: RowWeights,
    /// dY_i, and dŶ_j below.
    pub(super) points: Matrix<R>,
    pub(super) impulses: Matrix<R>,
    /// A row a stage.
    own: Matrix<R>,
}

/// Derivatives of the equations of a step of size h.
#[derive(Clone, Copy)]
pub(super) struct StageSlopes<'a, R> {
    pub(super) problem: &'a Mechanical,
    pub(super) of: &'a Derivatives<R>,
    pub(super) h: f64,
}

impl<R: Real> StageChanges<R> {
    /// Memory for a method whose impulses have these weights in momenta.
    pub(super) fn new(
        problem: &Mechanical,
        tableau: &tableau::Spark,
        force_weights: &Matrix,
    ) -> Self {
        let (n, s, k) = (problem.n, tableau.stages, tableau.intervals);
        let to_point = |i, j| {
            if i < s {
                tableau.mu_v[(i, j)]
            } else {
                tableau.mu_bar[(i - s, j)]
            }
        };
        Self {
            to_points: RowWeights::new(Matrix::from_fn(s + k + 1, s, to_point)),
            to_momenta: RowWeights::new(force_weights.clone()),
            points: Matrix::zeros(s + k + 1, n),
            impulses: Matrix::zeros(s + k + 1 + if problem.l() > 0 { s } else { 0 }, n),
            own: Matrix::zeros(s, n),
            offsets: Offsets::new(problem, tableau),
            tableau: tableau.clone(),
        }
    }

    /// Sets the numbers to zero that are added to: the impulses, and transposed the points too.
    #[inline(always)]
    pub(super) fn clear<const TRANSPOSED: bool>(&mut self) {
        self.impulses.clear();
        if TRANSPOSED {
            self.points.clear();
        }
    }

    /// Points by V_j.
    #[inline(always)]
    pub(super) fn move_points<const TRANSPOSED: bool>(&mut self, h: f64, unknowns: &mut [R]) {
        let n = self.own.cols();
        for part in in_order::<TRANSPOSED>(2) {
            if part == 1 {
                let (points, own) = (self.points.flat_mut(), self.own.flat_mut());
                (self.to_points).combine::<TRANSPOSED, _>(points, 1.0, own, n);
                continue;
            }
            let rows = unknowns[self.offsets.v..].chunks_exact_mut(n);
            for (j, (v, b)) in rows.zip(&self.tableau.b).enumerate() {
                set::<TRANSPOSED, _>(self.own.row_mut(j), h * b, v);
            }
        }
    }

    /// Impulses by the points.
    #[inline(always)]
    pub(super) fn add_forces<const TRANSPOSED: bool>(&mut self, slopes: StageSlopes<R>) {
        let StageSlopes { problem, of, h } = slopes;
        let (points, impulses, tableau) = (&mut self.points, &mut self.impulses, &self.tableau);
        let (at, s, first_own) = (&problem.patterns, tableau.stages, points.rows());
        for (i, b) in tableau.b.iter().enumerate() {
            let (dy, f) = (points.row_mut(i), (&at.f_y, of.f_y.row(i)));
            add_product::<TRANSPOSED, _>(impulses.row_mut(i), f, h * b, dy);
            if let (Some(own), Some(of)) = (&problem.nonholonomic, &of.own) {
                let (out, r) = (impulses.row_mut(first_own + i), &own.patterns.r_y);
                add_product::<TRANSPOSED, _>(out, (r, of.r_y.row(i)), h * b, dy);
            }
        }
        for (j, b) in tableau.b_hat.iter().enumerate() {
            let (dy, r) = (points.row_mut(s + j), (&at.r_y, of.r_y.row(j)));
            add_product::<TRANSPOSED, _>(impulses.row_mut(s + j), r, h * b, dy);
        }
    }

    /// Impulses by Z_j, Λ_j and ν_j.
    #[inline(always)]
    pub(super) fn add_unknowns<const TRANSPOSED: bool>(
        &mut self,
        slopes: StageSlopes<R>,
        unknowns: &mut [R],
    ) {
        let StageSlopes { problem, of, h } = slopes;
        let (impulses, tableau, offsets) = (&mut self.impulses, &self.tableau, self.offsets);
        let (at, s, first_own) = (&problem.patterns, tableau.stages, self.points.rows());
        let (z, rest) = unknowns.split_at_mut(offsets.lam);
        let (lam, nu) = rest.split_at_mut(offsets.nu - offsets.lam);
        let (n, m, l) = (problem.n, problem.m, problem.l());
        for (j, (z, b)) in z.chunks_exact_mut(n).zip(&tableau.b).enumerate() {
            let f = (&at.f_z, of.f_z.row(j));
            add_product::<TRANSPOSED, _>(impulses.row_mut(j), f, h * b, z);
            if let (Some(own), Some(of)) = (&problem.nonholonomic, &of.own) {
                let (out, at) = (impulses.row_mut(first_own + j), &own.patterns);
                add_product::<TRANSPOSED, _>(out, (&at.r_z, of.r_z.row(j)), h * b, z);
                let nu = &mut nu[j * l..(j + 1) * l];
                add_product::<TRANSPOSED, _>(out, (&at.r_nu, of.r_nu.row(j)), *b, nu);
            }
        }
        for (j, (lam, b)) in lam
            .chunks_exact_mut(m.max(1))
            .zip(&tableau.b_hat)
            .enumerate()
        {
            let r = (&at.r_lam, of.r_lam.row(j));
            add_product::<TRANSPOSED, _>(impulses.row_mut(s + j), r, *b, lam);
        }
    }

    /// Residuals of momenta, which are set, of constraints and of velocities, times 1 or −1.
    #[inline(always)]
    pub(super) fn add_residuals<const TRANSPOSED: bool>(
        &mut self,
        slopes: StageSlopes<R>,
        sign: f64,
        residuals: &mut [R],
    ) {
        let StageSlopes { problem, of, h } = slopes;
        let (at, n, s) = (&problem.patterns, problem.n, self.tableau.stages);
        let (momenta, impulses) = (&mut residuals[..s * n], self.impulses.flat_mut());
        (self.to_momenta).combine::<TRANSPOSED, _>(momenta, sign, impulses, n);
        for i in 0..s {
            let (dy, p) = (self.points.row_mut(i), (&at.p_y, of.p_y.row(i)));
            add_product::<TRANSPOSED, _>(&mut residuals[i * n..(i + 1) * n], p, -sign, dy);
            if at.v_z.is_some() {
                let (first, v) = (self.offsets.v + i * n, (&at.v_y, of.v_y.row(i)));
                add_product::<TRANSPOSED, _>(&mut residuals[first..first + n], v, sign, dy);
            }
        }
        for j in 1..=self.tableau.intervals {
            let (first, g) = (
                self.offsets.lam + (j - 1) * problem.m,
                (&at.g_y, of.g_y.row(j)),
            );
            let (out, dy) = (
                &mut residuals[first..first + problem.m],
                self.points.row_mut(s + j),
            );
            add_product::<TRANSPOSED, _>(out, g, -sign / h, dy);
        }
    }

    /// The matrix J of the stage equations, of its derivatives alone: `out = J x`, or `out = Jᵀ x`.
    ///
    ///     p_z dZ_i, 0, dV_i − v_z dZ_i,  less the residuals by V_j, Z_j and Λ_j
    pub(super) fn multiply<const TRANSPOSED: bool>(
        &mut self,
        slopes: StageSlopes<R>,
        x: &mut [R],
        out: &mut [R],
    ) {
        out.fill(R::splat(0.0));
        self.clear::<TRANSPOSED>();
        for part in in_order::<TRANSPOSED>(3) {
            let (unknowns, residuals) = directed::<TRANSPOSED, _>(x, out);
            match part {
                0 => self.move_points::<TRANSPOSED>(slopes.h, unknowns),
                1 => {
                    self.add_forces::<TRANSPOSED>(slopes);
                    self.add_unknowns::<TRANSPOSED>(slopes, unknowns);
                }
                _ => self.add_residuals::<TRANSPOSED>(slopes, -1.0, residuals),
            }
        }
        let (unknowns, residuals) = directed::<TRANSPOSED, _>(x, out);
        let StageSlopes { problem, of, .. } = slopes;
        let (n, v) = (problem.n, self.offsets.v);
        for i in 0..self.tableau.stages {
            let (z, p_z) = (i * n..(i + 1) * n, (&problem.patterns.p_z, of.p_z.row(i)));
            add_product::<TRANSPOSED, _>(
                &mut residuals[z.clone()],
                p_z,
                1.0,
                &mut unknowns[z.clone()],
            );
            let Some(v_z) = &problem.patterns.v_z else {
                continue;
            };
            let rate = v + z.start..v + z.end;
            let (out, v_z) = (&mut residuals[rate.clone()], (v_z, of.v_z.row(i)));
            add_product::<TRANSPOSED, _>(out, v_z, -1.0, &mut unknowns[z]);
            add::<TRANSPOSED, _>(out, 1.0, &mut unknowns[rate]);
        }
    }
}

/// What a map leads from, and what to.
fn directed<'a, const TRANSPOSED: bool, R>(
    x: &'a mut [R],
    out: &'a mut [R],
) -> (&'a mut [R], &'a mut [R]) {
    if TRANSPOSED { (out, x) } else { (x, out) }
}
