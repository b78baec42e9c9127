//! One step as a linear map: from changes of its start, of τ and of h to those of its end, or back from cotangents.
//!
//! With e(F) the change of F by y0, τ and h at fixed V_i, Z_i and λ_j, and Λ = h λ:
//!
//!     J (dZ, dΛ, dV) = (dp0 − e(p_i) + Σ_j d(h aᶠ_ij f_j) + Σ_{j<k} d(h â_ij r_j),  −e(g_j)/h,  e(v_i))
//!
//! J being the matrix of full Newton, in the order of its equations. Then dY_i = e(Y_i) + h Σ_j aᵛ_ij dV_j, the nodes
//! alike, dy1 = dŶ_k, and
//!
//!     dp1 = dp0 + Σ_j d(h b_j f_j) + Σ_j d(h b̂_j r_j),     p_z dz1 = dp1 − e(p1),   w_z dz1 = −e(w1)
//!
//! give dz1 and dΛ_k. It is λ that stays where h changes, not Λ.
//!
//! With nonholonomic constraints the matrix has the end in it, and with it come the right-hand sides −e(k) by their
//! moments, dp0 + Σ .. − e(p1), −e(w1) and −e(k1), the reactions r_n being further impulses.
//!
//! The transposed map is the adjoint of the step. By the symplecticity of the coefficients that is the same method on the
//! adjoint equations; with nonholonomic constraints it is another one, whose multipliers and constraints change places.
//! Source: sanzserna2016.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::super::stages::Stages;
use super::equations::StepMatrix;
use super::linear_step::LinearStep;
use super::stage_changes::StageChanges;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, Pattern};
use liouville_base::linear::{add, add_column, add_product, in_order, set};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_problem::Model;
use std::ops::Range;
use std::slice::from_mut;

/// Changes through a step, or cotangents of them.
#[derive(Clone, Debug)]
pub(super) struct StepChanges<R = f64> {
    pub(super) start: EndChanges<R>,
    pub(super) end: EndChanges<R>,
    pub(super) clock: Clock<R>,
    stages: StageChanges<R>,
    /// Of k, a row a stage.
    rolling: Matrix<R>,
    /// Right-hand sides in the order of full Newton, then its unknowns; at the end of the step those of momenta, then z1,
    /// and of hidden constraints, then Λ_k, are behind them where they are solved for apart.
    pub(super) right: Vec<R>,
    pub(super) momentum: Range<usize>,
    hidden: Range<usize>,
}

/// Changes of an end of the step.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub(super) struct EndChanges<R> {
    pub(super) y: Vec<R>,
    pub(super) p: Vec<R>,
}

/// Changes of the time where the step begins and ends, of h by its part, and of τ = (t, θ) at a point.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub(super) struct Clock<R> {
    pub(super) t0: R,
    pub(super) t1: R,
    pub(super) stretch: R,
    pub(super) tau: Vec<R>,
}

impl<R: Real> Clock<R> {
    /// `to += weight A τ` at a point, whose time is behind the start by `moved`; transposed, the clock takes Aᵀ to.
    #[inline(always)]
    fn add_product<const TRANSPOSED: bool>(
        &mut self,
        to: &mut [R],
        by_tau: (&Pattern, &[R]),
        weight: f64,
        moved: f64,
    ) {
        if TRANSPOSED {
            self.tau[0] = R::splat(0.0);
        } else {
            self.tau[0] = self.t0 + self.stretch * moved;
        }
        add_product::<TRANSPOSED, _>(to, by_tau, weight, &mut self.tau);
        if TRANSPOSED {
            self.t0 += self.tau[0];
            self.stretch += self.tau[0] * moved;
        }
    }
}

impl<R: Real> StepChanges<R> {
    pub(super) fn new(linear: &LinearStep<R>, stages: &Stages<R>) -> Self {
        let (problem, tableau) = (&linear.problem, &stages.tableau);
        let (n, s, l) = (problem.n, tableau.stages, problem.l());
        let (offsets, count) = linear.places();
        let (momentum, hidden) = if l > 0 {
            (s * n, offsets.lam + tableau.intervals * problem.m)
        } else {
            (count, count + n)
        };
        let values = |len| vec![R::splat(0.0); len];
        let end = EndChanges {
            y: values(n),
            p: values(n),
        };
        Self {
            start: end.clone(),
            end,
            clock: Clock {
                t0: R::splat(0.0),
                t1: R::splat(0.0),
                stretch: R::splat(0.0),
                tau: values(linear.sensitivity.problem.width()),
            },
            stages: StageChanges::new(problem, tableau, &stages.force_weights),
            rolling: Matrix::zeros(s, l),
            right: values(count.max(hidden + problem.m)),
            momentum: momentum..momentum + n,
            hidden: hidden..hidden + problem.m,
        }
    }

    /// Takes changes from the start of a linearised step to its end, or cotangents back.
    ///
    /// # Errors
    /// A singular matrix.
    pub(super) fn pass<const TRANSPOSED: bool>(
        &mut self,
        (linear, matrix): (&mut LinearStep<R>, &mut impl StepMatrix<R>),
        (model, stages): (&Model<R>, &Stages<R>),
        h: f64,
    ) -> Result<(), StepError> {
        let (end, t) = if TRANSPOSED {
            (&mut self.start, &mut self.clock.t0)
        } else {
            (&mut self.end, &mut self.clock.t1)
        };
        *t = R::splat(0.0);
        end.y.fill(R::splat(0.0));
        end.p.fill(R::splat(0.0));
        for part in in_order::<TRANSPOSED>(4) {
            match part {
                0 => dispatch_simd::<R, _>(
                    #[inline(always)]
                    || self.leave_start::<TRANSPOSED>(linear, stages, h),
                ),
                1 => {
                    let x = &mut self.right[..linear.places().1];
                    matrix.solve_at::<TRANSPOSED>((model, stages), &linear.derivatives, x)?;
                }
                2 => dispatch_simd::<R, _>(
                    #[inline(always)]
                    || self.leave_stages::<TRANSPOSED>(linear, h),
                ),
                _ if linear.problem.l() == 0 => self.solve_end::<TRANSPOSED>(linear, model, h),
                _ => {}
            }
        }
        Ok(())
    }

    /// From the start to the right-hand sides, and to what the end takes from it.
    #[inline(always)]
    fn leave_start<const TRANSPOSED: bool>(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        h: f64,
    ) {
        self.stages.clear::<TRANSPOSED>();
        self.rolling.clear();
        for part in in_order::<TRANSPOSED>(6) {
            match part {
                0 => self.move_start::<TRANSPOSED>(linear),
                1 => self.vary_forces::<TRANSPOSED>(linear, stages, h),
                2 => self.add_to_end::<TRANSPOSED>(),
                3 => self.set_right::<TRANSPOSED>(linear, h),
                4 => self.set_moments::<TRANSPOSED>(linear),
                _ if linear.problem.l() > 0 => self.set_end::<TRANSPOSED>(linear, h),
                _ => {}
            }
        }
    }

    /// From V_j, Z_j, Λ_j and ν_j to the end.
    #[inline(always)]
    fn leave_stages<const TRANSPOSED: bool>(&mut self, linear: &LinearStep<R>, h: f64) {
        self.stages.clear::<TRANSPOSED>();
        for part in in_order::<TRANSPOSED>(3) {
            let (stages, slopes) = (&mut self.stages, linear.slopes(h));
            match part {
                0 => stages.move_points::<TRANSPOSED>(h, &mut self.right),
                1 => {
                    stages.add_forces::<TRANSPOSED>(slopes);
                    stages.add_unknowns::<TRANSPOSED>(slopes, &mut self.right);
                }
                _ => self.add_to_end::<TRANSPOSED>(),
            }
        }
    }

    /// z1 and Λ_k, and the last reaction, which p1 has of it.
    fn solve_end<const TRANSPOSED: bool>(
        &mut self,
        linear: &mut LinearStep<R>,
        model: &Model<R>,
        h: f64,
    ) {
        for part in in_order::<TRANSPOSED>(3) {
            match part {
                0 => dispatch_simd::<R, _>(
                    #[inline(always)]
                    || self.set_end::<TRANSPOSED>(linear, h),
                ),
                1 => {
                    let of_end = &mut self.right[self.momentum.start..];
                    let (momentum, hidden) = of_end.split_at_mut(self.momentum.len());
                    let matrix = &mut linear.end.matrix;
                    if TRANSPOSED {
                        matrix.solve_transposed(model, momentum, hidden);
                    } else {
                        matrix.solve(model, momentum, hidden);
                    }
                }
                _ => {
                    let r = (&model.problem.patterns.r_lam, linear.end.matrix.r_lam());
                    let hidden = &mut self.right[self.hidden.clone()];
                    add_product::<TRANSPOSED, _>(&mut self.end.p, r, 1.0, hidden);
                }
            }
        }
    }

    /// e(Y_i) and e(Ŷ_j), and dp0 in dp1.
    #[inline(always)]
    fn move_start<const TRANSPOSED: bool>(&mut self, linear: &LinearStep<R>) {
        let (start, points) = (&mut self.start, &mut self.stages.points);
        add::<TRANSPOSED, _>(&mut self.end.p, 1.0, &mut start.p);
        for part in in_order::<TRANSPOSED>(2) {
            if part == 1 {
                let (moved, stretch) = (linear.moved.flat(), &mut self.clock.stretch);
                add_column::<TRANSPOSED, _>(points.flat_mut(), 1.0, moved, stretch);
                continue;
            }
            for dy in points.flat_mut().chunks_exact_mut(start.y.len()) {
                set::<TRANSPOSED, _>(dy, 1.0, &mut start.y);
            }
        }
    }

    /// Impulses by the points, by τ and by h.
    #[inline(always)]
    fn vary_forces<const TRANSPOSED: bool>(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        h: f64,
    ) {
        let (by_tau, tableau) = (&linear.sensitivity.problem.patterns, &stages.tableau);
        let (first_node, first_own) = (tableau.stages, self.stages.points.rows());
        self.stages.add_forces::<TRANSPOSED>(linear.slopes(h));
        let (impulses, clock) = (&mut self.stages.impulses, &mut self.clock);
        let (out, stretch) = (impulses.flat_mut(), &mut clock.stretch);
        add_column::<TRANSPOSED, _>(out, 1.0, stages.impulses.flat(), stretch);
        for (i, (b, c)) in tableau.b.iter().zip(&tableau.c).enumerate() {
            let (out, f) = (impulses.row_mut(i), (&by_tau.f_tau, linear.f_tau.row(i)));
            clock.add_product::<TRANSPOSED>(out, f, h * b, c * h);
            if let Some(own) = linear.nonholonomic() {
                let (out, r) = (impulses.row_mut(first_own + i), own.rn_tau.row(i));
                clock.add_product::<TRANSPOSED>(out, (&own.by_tau[1], r), h * b, c * h);
            }
        }
        for (j, (b, c)) in tableau.b_hat.iter().zip(&tableau.c_hat).enumerate() {
            let (out, r) = (impulses.row_mut(first_node + j), linear.r_tau.row(j));
            clock.add_product::<TRANSPOSED>(out, (&by_tau.r_tau, r), h * b, c * h);
        }
    }

    /// dy1 by the last point, and dp1 by all impulses.
    #[inline(always)]
    fn add_to_end<const TRANSPOSED: bool>(&mut self) {
        let (end, moved) = (&mut self.end, &mut self.stages);
        let (points, impulses) = (&mut moved.points, &mut moved.impulses);
        add::<TRANSPOSED, _>(&mut end.y, 1.0, points.row_mut(points.rows() - 1));
        for impulse in impulses.flat_mut().chunks_exact_mut(end.p.len()) {
            add::<TRANSPOSED, _>(&mut end.p, 1.0, impulse);
        }
    }

    /// Right-hand sides of the stages and nodes, and the changes of k at the stages.
    #[inline(always)]
    fn set_right<const TRANSPOSED: bool>(&mut self, linear: &LinearStep<R>, h: f64) {
        let (by_tau, own) = (&linear.sensitivity.problem.patterns, linear.nonholonomic());
        let (n, m, offsets) = (linear.problem.n, linear.problem.m, linear.places().0);
        let (right, clock) = (&mut self.right, &mut self.clock);
        self.stages
            .add_residuals::<TRANSPOSED>(linear.slopes(h), 1.0, right);
        let (tableau, points) = (&self.stages.tableau, &mut self.stages.points);
        for (i, c) in tableau.c.iter().enumerate() {
            let (out, p) = (
                &mut right[i * n..(i + 1) * n],
                (&by_tau.p_tau, linear.p_tau.row(i)),
            );
            add::<TRANSPOSED, _>(out, 1.0, &mut self.start.p);
            clock.add_product::<TRANSPOSED>(out, p, -1.0, c * h);
            if let Some(v_tau) = &by_tau.v_tau {
                let (first, v) = (offsets.v + i * n, (v_tau, linear.v_tau.row(i)));
                clock.add_product::<TRANSPOSED>(&mut right[first..first + n], v, 1.0, c * h);
            }
            if let Some(own) = own {
                let (out, dy) = (self.rolling.row_mut(i), points.row_mut(i));
                let (k_y, k_tau) = ((&own.at.k_y, own.of.k_y.row(i)), own.k_tau.row(i));
                add_product::<TRANSPOSED, _>(out, k_y, 1.0, dy);
                clock.add_product::<TRANSPOSED>(out, (&own.by_tau[0], k_tau), 1.0, c * h);
            }
        }
        for (j, c) in tableau.c_hat.iter().enumerate().skip(1) {
            let (first, g) = (
                offsets.lam + (j - 1) * m,
                (&by_tau.g_tau, linear.g_tau.row(j)),
            );
            clock.add_product::<TRANSPOSED>(&mut right[first..first + m], g, -1.0 / h, c * h);
        }
    }

    /// Right-hand sides of the moments of k.
    #[inline(always)]
    fn set_moments<const TRANSPOSED: bool>(&mut self, linear: &LinearStep<R>) {
        let (Some(own), offsets) = (linear.nonholonomic(), linear.places().0) else {
            return;
        };
        let l = self.rolling.cols();
        for (i, out) in self.right[offsets.nu..offsets.order - l]
            .chunks_exact_mut(l)
            .enumerate()
        {
            for (j, weight) in own.moments.row(i).iter().enumerate() {
                add::<TRANSPOSED, _>(out, -weight, self.rolling.row_mut(j));
            }
        }
    }

    /// Right-hand sides of the end, and its time.
    #[inline(always)]
    fn set_end<const TRANSPOSED: bool>(&mut self, linear: &LinearStep<R>, h: f64) {
        let (at, of) = (&linear.problem.patterns, &linear.end);
        let (by_tau, own) = (&linear.sensitivity.problem.patterns, linear.nonholonomic());
        let (end, right, clock) = (&mut self.end, &mut self.right, &mut self.clock);
        let t1 = from_mut(&mut clock.t1);
        add::<TRANSPOSED, _>(t1, 1.0, from_mut(&mut clock.t0));
        add::<TRANSPOSED, _>(t1, h, from_mut(&mut clock.stretch));
        let out = &mut right[self.momentum.clone()];
        add::<TRANSPOSED, _>(out, 1.0, &mut end.p);
        add_product::<TRANSPOSED, _>(out, (&at.p_y, &of.p_y), -1.0, &mut end.y);
        clock.add_product::<TRANSPOSED>(out, (&by_tau.p_tau, &of.p_tau), -1.0, h);
        let out = &mut right[self.hidden.clone()];
        add_product::<TRANSPOSED, _>(out, (&by_tau.w_y, &of.w_y), -1.0, &mut end.y);
        clock.add_product::<TRANSPOSED>(out, (&by_tau.w_tau, &of.w_tau), -1.0, h);
        if let Some(own) = own {
            let order = linear.places().0.order;
            let out = &mut right[order - linear.problem.l()..order];
            let k_y = (&own.at.k_y, &own.of.end.k_y[..]);
            add_product::<TRANSPOSED, _>(out, k_y, -1.0, &mut end.y);
            clock.add_product::<TRANSPOSED>(out, (&own.by_tau[0], own.end_k_tau), -1.0, h);
        }
    }
}
