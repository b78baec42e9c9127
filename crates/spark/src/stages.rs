//! The stage equations of one step, evaluated; see the module above for the letters.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, all_finite, combine, copy, copy_scaled, sum_compensated};
use liouville_base::newton::{Borne, Signs, Stop};
use liouville_base::real::Real;
use liouville_base::recorder;
use liouville_base::simd::dispatch_simd_long;
use liouville_base::tableau;
use liouville_base::tape::CompensatedTape;
use liouville_problem::{Mechanical, Model, State, Step, Times, finite, finite_k};

/// The times of nodes, given as fractions of the step.
#[inline(always)]
fn times<'c, R>(step: Step<R>, c: &'c [f64]) -> Times<'c> {
    let Step { t, h, .. } = step;
    Times { t, h, c }
}

/// The unknowns of the stage equations: Z_i, V_i and ν_i at the stages, λ_j at the nodes.
#[derive(Clone, Debug)]
pub(super) struct Unknowns<R = f64> {
    pub(super) z: Matrix<R>,
    pub(super) v: Matrix<R>,
    pub(super) lam: Matrix<R>,
    pub(super) nu: Matrix<R>,
}

impl<R: Real> Unknowns<R> {
    pub(super) fn copy_from(&mut self, other: &Self) {
        copy(self.z.flat_mut(), other.z.flat());
        copy(self.v.flat_mut(), other.v.flat());
        copy(self.lam.flat_mut(), other.lam.flat());
        copy(self.nu.flat_mut(), other.nu.flat());
    }

    /// Sets all unknowns from a slice of z, v, λ and ν one after another.
    pub(super) fn put_back(&mut self, mut numbers: &[f64]) {
        for part in [&mut self.z, &mut self.v, &mut self.lam, &mut self.nu] {
            recorder::take(part.flat_mut(), &mut numbers);
        }
    }

    /// Copies the chosen members of another.
    #[inline(always)]
    pub(super) fn copy_members(&mut self, other: &Self, chosen: R) {
        let pairs = [
            (&mut self.z, &other.z),
            (&mut self.v, &other.v),
            (&mut self.lam, &other.lam),
            (&mut self.nu, &other.nu),
        ];
        for (out, x) in pairs {
            for (out, x) in out.flat_mut().iter_mut().zip(x.flat()) {
                *out = chosen.choose(*x, *out);
            }
        }
    }
}

/// Unknowns and residuals before they were moved.
#[derive(Clone, Debug)]
pub(super) struct Probe<R> {
    pub(super) unknowns: Unknowns<R>,
    pub(super) corrected: Unknowns<R>,
    pub(super) momentum: Matrix<R>,
    pub(super) velocity: Matrix<R>,
    pub(super) g: Matrix<R>,
}

/// Unknowns and values at the stages 1..s (rows 0..s) and at the nodes 0..k.
#[derive(Clone, Debug)]
pub(super) struct Stages<R = f64> {
    pub(super) tableau: tableau::Spark,
    pub(super) unknowns: Unknowns<R>,
    /// Values at the stages.
    pub(super) y: Matrix<R>,
    pub(super) p: Matrix<R>,
    pub(super) k: Matrix<R>,
    /// Values at the nodes.
    pub(super) node_y: Matrix<R>,
    node_low: Matrix<R>,
    pub(super) g: Matrix<R>,
    /// Rounding errors of g, where its operations have them.
    pub(super) compensated: Option<Box<CompensatedTape<R>>>,
    /// Displacements h b_j V_j, and impulses: h b_j F_j, then h b̂_j R_j, j = 0..k, then those h b_j R_j of
    /// nonholonomic constraints.
    pub(super) displacements: Matrix<R>,
    pub(super) impulses: Matrix<R>,
    /// Residuals V_i − v(T_i, Y_i, Z_i) and those of the momentum equation.
    pub(super) velocity_residual: Matrix<R>,
    pub(super) momentum_residual: Matrix<R>,
    /// Parts of the displacements that the rounding of velocities has lost.
    pub(super) lost_displacements: Matrix<R>,
    pub(super) evaluations: usize,
    /// When the stage equations count as solved.
    pub(super) stop: Stop,
    /// v at the start of the step, and the yardstick of the step: the speed that moves the coordinates by their size at
    /// the start, the same for all iterates; 0 where none is needed.
    pub(super) v0: Vec<R>,
    pub(super) yardstick: R,
    pub(super) borne: Borne<R>,
    /// The meaning of the matrix's sign where there are constraints.
    pub(super) signs: Signs,
    /// Whether V and Z are the same.
    pub(super) velocity_is_z: bool,
    /// Whether the equations are linear, with one solution wherever it lies.
    pub(super) is_affine: bool,
    /// The speed that corrections are relative to, and the size of the last one.
    pub(super) speed: R,
    pub(super) size: R,
    /// 1 where the rounding errors of g are to be computed, else 0.
    pub(super) wanted: R,
    /// Memory of measuring roundoff, made at its first use.
    pub(super) probe: Option<Box<Probe<R>>>,
    /// μᶠ and μ̂ side by side, the last column of μ̂, which is zero, left out unless μʳ follows.
    pub(super) force_weights: Matrix,
}

impl<R: Real> Stages<R> {
    pub(super) fn new(model: &Model<R>, tableau: tableau::Spark) -> Self {
        let (n, m) = (model.problem.n, model.problem.m);
        let (s, k) = (tableau.stages, tableau.intervals);
        let at_stages = Matrix::zeros(s, n);
        let l = model.problem.l();
        let nonholonomic = if l > 0 { s } else { 0 };
        Self {
            unknowns: Unknowns {
                z: at_stages.clone(),
                v: at_stages.clone(),
                lam: Matrix::zeros(k + 1, m),
                nu: Matrix::zeros(s, l),
            },
            k: Matrix::zeros(s, l),
            y: at_stages.clone(),
            p: at_stages.clone(),
            node_y: Matrix::zeros(k + 1, n),
            node_low: Matrix::zeros(k + 1, n),
            compensated: model.compensated_g().map(Box::new),
            g: Matrix::zeros(k + 1, m),
            displacements: at_stages.clone(),
            impulses: Matrix::zeros(s + k + 1 + nonholonomic, n),
            velocity_residual: at_stages.clone(),
            lost_displacements: at_stages.clone(),
            momentum_residual: at_stages,
            evaluations: 0,
            stop: Stop::default(),
            v0: vec![R::splat(0.0); n],
            yardstick: R::splat(0.0),
            borne: Borne::nothing(),
            speed: R::splat(0.0),
            size: R::splat(0.0),
            wanted: R::splat(1.0),
            probe: None,
            signs: Signs::Regarded,
            velocity_is_z: model.problem.patterns.v_z.is_none(),
            is_affine: model.problem.is_affine(),
            force_weights: Matrix::from_fn(s, s + k + nonholonomic + usize::from(l > 0), |i, j| {
                if j < s {
                    tableau.mu_f[(i, j)]
                } else if j <= s + k {
                    tableau.mu_hat[(i, j - s)]
                } else {
                    tableau.mu_r[(i, j - s - k - 1)]
                }
            }),
            tableau,
        }
    }

    /// Time of stage `i`.
    pub(super) fn stage_time(&self, step: Step<R>, i: usize) -> f64 {
        times(step, &self.tableau.c).at(i)
    }

    /// Time of node `j`.
    pub(super) fn node_time(&self, step: Step<R>, j: usize) -> f64 {
        times(step, &self.tableau.c_hat).at(j)
    }

    /// Times of all stages.
    pub(super) fn stage_times(&self, step: Step<R>) -> Times<'_> {
        times(step, &self.tableau.c)
    }

    /// Times of all nodes.
    pub(super) fn node_times(&self, step: Step<R>) -> Times<'_> {
        times(step, &self.tableau.c_hat)
    }

    /// Evaluates the model at the current unknowns, and the residuals of (S1)–(S4).
    pub(super) fn evaluate(
        &mut self,
        model: &mut Model<R>,
        step: Step<R>,
    ) -> Result<(), StepError> {
        let is_finite = dispatch_simd_long::<R, _>(
            self.y.cols(),
            #[inline(always)]
            || {
                self.evaluate_each(model, step, self.tableau.intervals);
                self.compensate(step);
                self.subtract_impulses(step);
                all_finite(self.momentum_residual.flat())
                    && (model.problem.patterns.v_z.is_none()
                        || all_finite(self.velocity_residual.flat()))
                    && all_finite(self.g.flat())
                    && all_finite(self.k.flat())
            },
        );
        if is_finite {
            Ok(())
        } else {
            Err(self.not_finite(step))
        }
    }

    /// Evaluates the model at the current unknowns: points, forces, and constraints and reactions up
    /// to the node `last`.
    pub(super) fn evaluate_values(&mut self, model: &mut Model<R>, step: Step<R>, last: usize) {
        dispatch_simd_long::<R, _>(
            self.y.cols(),
            #[inline(always)]
            || self.evaluate_each(model, step, last),
        );
    }

    #[inline(always)]
    fn evaluate_each(&mut self, model: &mut Model<R>, step: Step<R>, last: usize) {
        self.move_points(step);
        let s = self.tableau.stages;
        let at = times(step, &self.tableau.c);
        let mut stages = model.stages((at, [&self.y, &self.unknowns.z]));
        for i in 0..s {
            let [p, f, v] = stages.at(i);
            let (residual, impulse) = (&mut self.velocity_residual, &mut self.impulses);
            let (unknown, weight) = (&self.unknowns.v, step.h * self.tableau.b[i]);
            copy(self.p.row_mut(i), p);
            copy_scaled(impulse.row_mut(i), weight, f);
            let both = unknown.row(i).iter().zip(v);
            for (out, (unknown, v)) in residual.row_mut(i).iter_mut().zip(both) {
                *out = *unknown - *v;
            }
        }
        self.evaluations += s;
        if self.k.cols() > 0 {
            self.evaluate_nonholonomic(model, step);
        }
        if model.problem.m > 0 {
            let at = times(step, &self.tableau.c_hat);
            let mut nodes = model.nodes((at, [&self.node_y, &self.unknowns.lam]));
            for j in 0..=last {
                let [g, r] = nodes.at(j);
                copy(self.g.row_mut(j), g);
                let impulse = self.impulses.row_mut(s + j);
                let weight = step.h * self.tableau.b_hat[j];
                copy_scaled(impulse, weight, r);
            }
        }
    }

    /// Adds to g the rounding errors of its evaluation and of the nodes. Near its root g takes so few values that the
    /// error of the iteration would not show in them; it has the same sign in each step.
    fn compensate(&mut self, step: Step<R>) {
        self.wanted = self.stop.wants_roundings(self.size);
        let Some(compensated) = &mut self.compensated else {
            return;
        };
        let (n, m) = (self.node_y.cols(), self.g.cols());
        let times = times(step, &self.tableau.c_hat);
        let points = [&self.node_y, &self.node_low].map(|points| &points.flat()[n..]);
        let g = &mut self.g.flat_mut()[m..];
        compensated.add_low(|i| times.at(i + 1), points, (g, self.wanted));
    }

    /// k and its reactions at the stages.
    fn evaluate_nonholonomic(&mut self, model: &mut Model<R>, step: Step<R>) {
        let first = self.tableau.stages + self.tableau.intervals + 1;
        for i in 0..self.k.rows() {
            let t = self.stage_time(step, i);
            let (z, nu) = (self.unknowns.z.row(i), self.unknowns.nu.row(i));
            let [k, r] = model.nonholonomic(t, self.y.row(i), z, nu);
            copy(self.k.row_mut(i), k);
            let impulse = self.impulses.row_mut(first + i);
            copy_scaled(impulse, step.h * self.tableau.b[i], r);
        }
    }

    /// Y_i = y0 + Σ μᵛ_ij (h b_j V_j) and Ŷ_i = y0 + Σ μ̄_ij (h b_j V_j), the low part of y0 first.
    #[inline(always)]
    fn move_points(&mut self, step: Step<R>) {
        for (j, b) in self.tableau.b.iter().enumerate() {
            copy_scaled(
                self.displacements.row_mut(j),
                step.h * b,
                self.unknowns.v.row(j),
            );
        }
        let State { y, y_low, .. } = step.state;
        combine(
            self.y.flat_mut(),
            &self.tableau.mu_v,
            &self.displacements,
            #[inline(always)]
            |_, k, sums| {
                let at = k..k + sums.len();
                let given = y[at.clone()].iter().zip(&y_low[at]);
                for (sum, (y, low)) in sums.iter_mut().zip(given) {
                    *sum = *y + (*low + *sum);
                }
            },
        );
        combine(
            self.node_low.flat_mut(),
            &self.tableau.mu_bar,
            &self.displacements,
            #[inline(always)]
            |_, k, sums| {
                for (sum, low) in sums.iter_mut().zip(&y_low[k..]) {
                    *sum = *low + *sum;
                }
            },
        );
        let n = y.len().max(1);
        let rows = self.node_low.flat_mut().chunks_exact_mut(n);
        for (node, low) in self.node_y.flat_mut().chunks_exact_mut(n).zip(rows) {
            sum_compensated(y, low, node);
        }
    }

    /// P_i − p0 − Σ μᶠ_ij (h b_j F_j) − Σ_{j<k} μ̂_ij (h b̂_j R_j) − Σ μʳ_ij (h b_j R_j).
    #[inline(always)]
    pub(super) fn subtract_impulses(&mut self, step: Step<R>) {
        let stage_p = &self.p;
        let out = self.momentum_residual.flat_mut();
        let State { p, p_low, .. } = step.state;
        combine(
            out,
            &self.force_weights,
            &self.impulses,
            #[inline(always)]
            |i, k, sums| {
                let at = k..k + sums.len();
                let given = stage_p.row(i)[at.clone()].iter().zip(&p[at.clone()]);
                for ((sum, (stage_p, p)), low) in sums.iter_mut().zip(given).zip(&p_low[at]) {
                    *sum = (*stage_p - *p) - (*low + *sum);
                }
            },
        );
    }

    /// Whether the displacements lost by the rounding of velocities are found. Where p depends on y, the rounding of Y_i
    /// could not be separated from them.
    pub(super) fn finds_lost_displacements(&self, problem: &Mechanical) -> bool {
        problem.patterns.p_y.is_empty() && self.stop.is_roundoff()
    }

    /// Which value is not finite.
    #[cold]
    fn not_finite(&self, step: Step<R>) -> StepError {
        let s = self.tableau.stages;
        let at_stage = |i: usize| {
            let t = self.stage_time(step, i);
            finite(self.p.row(i), Quantity::Momentum, t)?;
            finite(self.impulses.row(i), Quantity::Force, t)?;
            finite(self.velocity_residual.row(i), Quantity::Velocity, t)
        };
        let at_node = |j: usize| {
            let t = self.node_time(step, j);
            finite(self.g.row(j), Quantity::Constraint, t)?;
            finite(self.impulses.row(s + j), Quantity::Reaction, t)
        };
        let nonholonomic = |i: usize| {
            let t = self.stage_time(step, i);
            let first = s + self.tableau.intervals + 1;
            finite_k(self.k.row(i), self.g.cols(), t)?;
            finite(self.impulses.row(first + i), Quantity::Reaction, t)
        };
        let count = if self.k.cols() > 0 { s } else { 0 };
        let found = (0..s)
            .map(at_stage)
            .chain((0..=self.tableau.intervals).map(at_node))
            .chain((0..count).map(nonholonomic))
            .find_map(Result::err);
        found.unwrap_or(StepError::NotConverged {
            iterations: 0,
            size: f64::INFINITY,
        })
    }
}
