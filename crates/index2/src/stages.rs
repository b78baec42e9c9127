//! The stage equations of one step, evaluated; see the module above for the letters.

use crate::semi_explicit::{SemiExplicitModel, SemiExplicitState};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, add_scaled, combine, copy, copy_scaled, max_norm};
use liouville_base::tableau::{Spark, lagrange, moments};
use liouville_problem::finite;

/// The step being made.
pub(super) type CollocationStep<'a> = liouville_base::method::Step<'a, SemiExplicitState>;

/// Unknowns and values at the stages (rows 0..s), and y1 and k(t1, y1) below them.
#[derive(Clone, Debug)]
pub(super) struct CollocationStages {
    pub(super) c: Vec<f64>,
    pub(super) b: Vec<f64>,
    pub(super) a: Matrix,
    /// b_j P_{i−1}(c_j), s − 1 by s.
    pub(super) moments: Matrix,
    pub(super) v: Matrix,
    pub(super) z: Matrix,
    pub(super) y: Matrix,
    /// V_i − f(T_i, Y_i, Z_i)
    pub(super) residual: Matrix,
    /// The moments of k, and k(t1, y1).
    pub(super) defect: Matrix,
    pub(super) evaluations: usize,
    /// The velocity that moves the coordinates by their size at the start, which no iterate changes.
    pub(super) yardstick: f64,
    /// Unknowns, and residuals or corrected unknowns, before they were moved; made when it is first wanted.
    pub(super) probe: Option<Box<(KeptCollocation, KeptCollocation)>>,
    k: Matrix,
    /// h b_j V_j
    pub(super) displacements: Matrix,
    /// a_ij / b_j, and below it ones.
    pub(super) weights: Matrix,
    /// The stages' basis polynomials at 1.
    ends: Matrix,
}

/// Unknowns kept beside the present ones.
#[derive(Clone, Debug)]
pub(super) struct KeptCollocation {
    pub(super) h: f64,
    pub(super) v: Matrix,
    pub(super) z: Matrix,
}

impl KeptCollocation {
    pub(super) fn new(stages: &CollocationStages) -> Self {
        Self {
            h: f64::NAN,
            v: stages.v.clone(),
            z: stages.z.clone(),
        }
    }

    pub(super) fn copy_from(&mut self, stages: &CollocationStages) {
        copy(self.v.flat_mut(), stages.v.flat());
        copy(self.z.flat_mut(), stages.z.flat());
    }

    pub(super) fn put_back(&self, stages: &mut CollocationStages) {
        copy(stages.v.flat_mut(), self.v.flat());
        copy(stages.z.flat_mut(), self.z.flat());
    }
}

impl CollocationStages {
    pub(super) fn new(model: &SemiExplicitModel, tableau: &Spark) -> Self {
        let s = tableau.stages;
        let (n, l) = (model.problem.n, model.problem.l);
        let mut ends = Matrix::zeros(1, s);
        let all: Vec<usize> = (0..s).collect();
        lagrange(&tableau.c, &all, std::iter::once(1.0), &mut ends);
        let weight = |i, j| if i < s { tableau.mu_f[(i, j)] } else { 1.0 };
        Self {
            weights: Matrix::from_fn(s + 1, s, weight),
            moments: moments(&tableau.b, &tableau.c),
            a: tableau.a_f.clone(),
            b: tableau.b.clone(),
            c: tableau.c.clone(),
            v: Matrix::zeros(s, n),
            z: Matrix::zeros(s, l),
            y: Matrix::zeros(s + 1, n),
            residual: Matrix::zeros(s, n),
            defect: Matrix::zeros(s, l),
            evaluations: 0,
            yardstick: 0.0,
            probe: None,
            k: Matrix::zeros(s, l),
            displacements: Matrix::zeros(s, n),
            ends,
        }
    }

    /// The number of stages.
    pub(super) fn count(&self) -> usize {
        self.c.len()
    }

    /// Time of stage `i`, and of the end at i = s.
    pub(super) fn time(&self, t: f64, h: f64, i: usize) -> f64 {
        t + self.c.get(i).map_or(h, |c| c * h)
    }

    /// y1
    pub(super) fn end(&self) -> &[f64] {
        self.y.row(self.count())
    }

    /// Evaluates the model at the current unknowns, and the residuals of (I1)–(I3).
    pub(super) fn evaluate(
        &mut self,
        model: &mut SemiExplicitModel,
        step: CollocationStep,
    ) -> Result<(), StepError> {
        self.move_points(step);
        let s = self.count();
        for i in 0..s {
            let t = self.time(step.t, step.h, i);
            let f = model.field(t, self.y.row(i), self.z.row(i));
            finite(f, Quantity::Field, t)?;
            let out = self.residual.row_mut(i);
            copy(out, self.v.row(i));
            add_scaled(out, -1.0, f);
            if i + 1 < s {
                let k = model.constraint(t, self.y.row(i));
                finite(k, Quantity::Constraint, t)?;
                copy(self.k.row_mut(i), k);
            }
        }
        self.evaluations += s;
        self.weigh(model, step)
    }

    fn weigh(
        &mut self,
        model: &mut SemiExplicitModel,
        step: CollocationStep,
    ) -> Result<(), StepError> {
        let s = self.count();
        for i in [s - 1, s] {
            let t = self.time(step.t, step.h, i);
            let k = model.constraint(t, self.y.row(i));
            finite(k, Quantity::Constraint, t)?;
            if i < s {
                copy(self.k.row_mut(i), k);
            } else {
                copy(self.defect.row_mut(s - 1), k);
            }
        }
        if s > 1 {
            let out = self.defect.flat_mut();
            combine(out, &self.moments, &self.k, |_, _, _| ());
        }
        Ok(())
    }

    /// Y_i = y0 + Σ (a_ij / b_j) (h b_j V_j) and y1, the low part of y0 first.
    pub(super) fn move_points(&mut self, step: CollocationStep) {
        for (j, b) in self.b.iter().enumerate() {
            copy_scaled(self.displacements.row_mut(j), step.h * b, self.v.row(j));
        }
        let SemiExplicitState { y, y_low, .. } = step.state;
        combine(
            self.y.flat_mut(),
            &self.weights,
            &self.displacements,
            |_, k, sums| {
                let at = k..k + sums.len();
                for ((sum, y), low) in sums.iter_mut().zip(&y[at.clone()]).zip(&y_low[at]) {
                    *sum = y + (low + *sum);
                }
            },
        );
    }

    /// The polynomial through the Z_i, at t1.
    pub(super) fn end_of_z(&self, z: &mut [f64]) {
        combine(z, &self.ends, &self.z, |_, _, _| ());
    }

    /// Adds y1 − y0 to `sum`.
    pub(super) fn add_moves(&self, sum: &mut [f64]) {
        for j in 0..self.count() {
            add_scaled(sum, 1.0, self.displacements.row(j));
        }
    }

    /// The size of a correction of V, relative to what moves the coordinates by their own size.
    pub(super) fn relative(&self, correction: f64, step: CollocationStep) -> f64 {
        if correction == 0.0 {
            return 0.0;
        }
        correction / self.speed(step)
    }

    /// The speed that corrections are relative to.
    fn speed(&self, step: CollocationStep) -> f64 {
        max_norm(self.v.flat()) + max_norm(&step.state.y) / step.h.abs()
    }

    /// A relative size in the yardstick of the step; from rest at the origin there is none.
    pub(super) fn scaled_size(&self, size: f64, step: CollocationStep) -> f64 {
        if size == 0.0 || self.yardstick == 0.0 {
            return 0.0;
        }
        size * (self.speed(step) / self.yardstick)
    }

    /// How far the stages are from where the velocity at the start leads, in the yardstick.
    pub(super) fn deviation(&self, velocity: &[f64], step: CollocationStep) -> f64 {
        let mut largest = 0.0_f64;
        for (i, c) in self.c.iter().enumerate() {
            let start = step.state.y.iter().zip(velocity);
            for (y, (y0, v0)) in self.y.row(i).iter().zip(start) {
                largest = largest.max((y - y0 - c * step.h * v0).abs());
            }
        }
        let unit = self.yardstick * step.h.abs();
        if unit == 0.0 { 0.0 } else { largest / unit }
    }
}
