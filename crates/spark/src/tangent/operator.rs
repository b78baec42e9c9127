//! The matrix J of a linearised step as an operator, of its derivatives alone, and its transpose. With dY_i and dŶ_k
//! the changes of the points by V_j,
//!
//!     p_z dZ_i + p_y dY_i − h Σ_j aᶠ_ij (f_z dZ_j + f_y dY_j) − Σ_k â_ik (r_λ dΛ_k + h r_y dŶ_k)
//!     g_y dŶ_k / h
//!     dV_i − v_z dZ_i − v_y dY_i

use super::super::derivatives::Derivatives;
use liouville_base::linalg::{Matrix, add_scaled, as_is, combine, copy, copy_scaled};
use liouville_base::tableau;
use liouville_problem::Mechanical;

/// Coefficients, and the memory of a product.
#[derive(Clone, Debug)]
pub(super) struct Operator {
    /// aᵛ and ā below each other, and aᶠ and â side by side.
    to_points: Matrix,
    to_momenta: Matrix,
    from_points: Matrix,
    from_momenta: Matrix,
    /// A row a stage.
    own: Matrix,
    /// A row a stage, and a row a node.
    points: Matrix,
    /// The last node has no impulse among the unknowns.
    impulses: Matrix,
}

impl Operator {
    pub(super) fn new(n: usize, tableau: &tableau::Spark) -> Self {
        let (s, k) = (tableau.stages, tableau.intervals);
        let to_point = |i: usize, j: usize| {
            if i < s {
                tableau.a_v[(i, j)]
            } else {
                tableau.a_bar[(i - s, j)]
            }
        };
        let to_momentum = |i: usize, j: usize| {
            if j < s {
                tableau.a_f[(i, j)]
            } else {
                tableau.a_hat[(i, j - s)]
            }
        };
        Self {
            to_points: Matrix::from_fn(s + k + 1, s, to_point),
            from_points: Matrix::from_fn(s, s + k + 1, |j, i| to_point(i, j)),
            to_momenta: Matrix::from_fn(s, s + k, to_momentum),
            from_momenta: Matrix::from_fn(s + k, s, |j, i| to_momentum(i, j)),
            own: Matrix::zeros(s, n),
            points: Matrix::zeros(s + k + 1, n),
            impulses: Matrix::zeros(s + k, n),
        }
    }

    /// `out = J x`
    pub(super) fn apply(
        &mut self,
        (problem, of, h): (&Mechanical, &Derivatives, f64),
        x: &[f64],
        out: &mut [f64],
    ) {
        let (at, n, m, s) = (&problem.patterns, problem.n, problem.m, self.own.rows());
        let (z, rest) = x.split_at(s * n);
        let (lam, v) = rest.split_at((self.points.rows() - s - 1) * m);
        let (momenta, rest) = out.split_at_mut(s * n);
        let (g, velocities) = rest.split_at_mut(lam.len());
        copy_scaled(self.own.flat_mut(), h, if v.is_empty() { z } else { v });
        combine(self.points.flat_mut(), &self.to_points, &self.own, as_is);
        self.impulses.clear();
        for (j, z) in z.chunks_exact(n).enumerate() {
            let (dy, out) = (self.points.row(j), self.impulses.row_mut(j));
            at.f_z.multiply_add(of.f_z.row(j), h, z, out);
            at.f_y.multiply_add(of.f_y.row(j), h, dy, out);
        }
        for (k, lam) in lam.chunks_exact(m.max(1)).enumerate() {
            let (dy, out) = (self.points.row(s + k), self.impulses.row_mut(s + k));
            at.r_lam.multiply_add(of.r_lam.row(k), 1.0, lam, out);
            at.r_y.multiply_add(of.r_y.row(k), h, dy, out);
        }
        combine(momenta, &self.to_momenta, &self.impulses, |_, _, sums| {
            for x in sums {
                *x = -*x;
            }
        });
        for (i, out) in momenta.chunks_exact_mut(n).enumerate() {
            let (z, dy) = (&z[i * n..(i + 1) * n], self.points.row(i));
            at.p_z.multiply_add(of.p_z.row(i), 1.0, z, out);
            at.p_y.multiply_add(of.p_y.row(i), 1.0, dy, out);
        }
        g.fill(0.0);
        for (k, out) in (1..).zip(g.chunks_exact_mut(m.max(1))) {
            let dy = self.points.row(s + k);
            at.g_y.multiply_add(of.g_y.row(k), 1.0 / h, dy, out);
        }
        let Some(v_z) = &at.v_z else { return };
        copy(velocities, v);
        for (i, out) in velocities.chunks_exact_mut(n).enumerate() {
            let (z, dy) = (&z[i * n..(i + 1) * n], self.points.row(i));
            v_z.multiply_add(of.v_z.row(i), -1.0, z, out);
            at.v_y.multiply_add(of.v_y.row(i), -1.0, dy, out);
        }
    }

    /// `out = Jᵀ x`
    pub(super) fn apply_transposed(
        &mut self,
        (problem, of, h): (&Mechanical, &Derivatives, f64),
        x: &[f64],
        out: &mut [f64],
    ) {
        let (at, n, m, s) = (&problem.patterns, problem.n, problem.m, self.own.rows());
        let (eta, rest) = x.split_at(s * n);
        let (nu, sigma) = rest.split_at((self.points.rows() - s - 1) * m);
        let (of_z, rest) = out.split_at_mut(s * n);
        let (of_lam, of_v) = rest.split_at_mut(nu.len());
        copy(self.own.flat_mut(), eta);
        let impulses = &mut self.impulses;
        combine(impulses.flat_mut(), &self.from_momenta, &self.own, as_is);
        self.points.clear();
        of_z.fill(0.0);
        for (i, eta) in eta.chunks_exact(n).enumerate() {
            let (force, dy) = (impulses.row(i), self.points.row_mut(i));
            at.p_y.multiply_add_transposed(of.p_y.row(i), 1.0, eta, dy);
            at.f_y.multiply_add_transposed(of.f_y.row(i), -h, force, dy);
            let out = &mut of_z[i * n..(i + 1) * n];
            at.p_z.multiply_add_transposed(of.p_z.row(i), 1.0, eta, out);
            at.f_z
                .multiply_add_transposed(of.f_z.row(i), -h, force, out);
            if let (Some(v_z), Some(sigma)) = (&at.v_z, sigma.chunks_exact(n).nth(i)) {
                at.v_y
                    .multiply_add_transposed(of.v_y.row(i), -1.0, sigma, dy);
                v_z.multiply_add_transposed(of.v_z.row(i), -1.0, sigma, out);
            }
        }
        of_lam.fill(0.0);
        for (k, out) in of_lam.chunks_exact_mut(m.max(1)).enumerate() {
            let (impulse, dy) = (impulses.row(s + k), self.points.row_mut(s + k));
            at.r_lam
                .multiply_add_transposed(of.r_lam.row(k), -1.0, impulse, out);
            at.r_y
                .multiply_add_transposed(of.r_y.row(k), -h, impulse, dy);
        }
        for (k, nu) in (1..).zip(nu.chunks_exact(m.max(1))) {
            let dy = self.points.row_mut(s + k);
            at.g_y
                .multiply_add_transposed(of.g_y.row(k), 1.0 / h, nu, dy);
        }
        combine(self.own.flat_mut(), &self.from_points, &self.points, as_is);
        if sigma.is_empty() {
            add_scaled(of_z, h, self.own.flat());
        } else {
            copy(of_v, sigma);
            add_scaled(of_v, h, self.own.flat());
        }
    }
}
