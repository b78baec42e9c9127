//! The Newton matrix of (I1)–(I3), factored, and kept as long as that pays.
//!
//! Corrections dV_j and dZ_j solve
//!
//!     [ δ_ij − h a_ij f_y(i)                      −δ_ij f_z(i) ] [ dV ]     [ residual of (I1)     ]
//!     [ Σ_m b_m P_{i−1}(c_m) a_mj k_y(m), i < s        0       ] [ dZ ] = − [ that of (I2), (I3) / h ]
//!     [ b_j k_y(t1),                      i = s        0       ]
//!
//! each stage with its own derivatives. No entry grows as h → 0, where the Schur complement is a constant
//! matrix times k_y f_z. Factors serve until a step with them takes more corrections than the average one
//! since they were made, their own price counted in.

use super::stages::{Stages, Step};
use crate::problem::finite;
use crate::semi_explicit::{Model, State};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Assembly, Factor, Matrix, Pattern, add_scaled, copy, max_norm};

/// What factors of a sparse matrix cost, in corrections.
const SPARSE_PRICE: f64 = 10.0;
/// The same of a dense one, for each row.
const DENSE_PRICE: f64 = 1.0 / 6.0;

/// Corrections with the same factors that a step takes in any case.
const LEAST_PATIENCE: f64 = 10.0;

/// The factors, and what they have cost since.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    matrix: Assembly,
    factor: Factor,
    /// f_z of each stage.
    f_z: Vec<Vec<f64>>,
    /// dZ is solved for in this unit.
    unit: f64,
    /// The step they are for; 0 when they are of no use.
    h: f64,
    price: f64,
    cost: f64,
    steps: f64,
    /// Where they were made: t, and y and z of the stages.
    t: f64,
    y: Matrix,
    z: Matrix,
    unknowns: Vec<f64>,
    effect: Vec<f64>,
}

impl Frozen {
    pub(super) fn new(model: &Model, stages: &Stages) -> Self {
        let (n, l, s) = (model.problem.n, model.problem.l, stages.count());
        let at = &model.problem.patterns;
        let (order, identity) = (s * (n + l), Pattern::diagonal(n));
        let places = |pattern, row: usize, height: usize| {
            (0..s * s).map(move |k| (pattern, row + k / s * height, k % s * n))
        };
        let own = (0..s).map(|i| (&identity, i * n, i * n));
        let pushed = (0..s).map(|i| (&at.f_z, i * n, s * n + i * l));
        let blocks: Vec<(&Pattern, usize, usize)> = places(&at.f_y, 0, n)
            .chain(places(&at.k_y, s * n, l))
            .chain(own)
            .chain(pushed)
            .collect();
        let matrix = Assembly::new((order, order), &blocks);
        let factor = Factor::new(matrix.pattern());
        Self {
            price: match &factor {
                Factor::Sparse(_) => SPARSE_PRICE,
                _ => DENSE_PRICE * order as f64,
            },
            factor,
            matrix,
            f_z: vec![vec![0.0; at.f_z.len()]; s],
            unit: 1.0,
            h: 0.0,
            cost: 0.0,
            steps: 0.0,
            t: 0.0,
            y: stages.y.clone(),
            z: stages.z.clone(),
            unknowns: vec![0.0; order],
            effect: vec![0.0; n],
        }
    }

    /// Whether there are factors for a step of this size.
    pub(super) fn serves(&self, h: f64) -> bool {
        h.to_bits() == self.h.to_bits()
    }

    /// The factors are of no use any more.
    pub(super) fn discard(&mut self) {
        self.h = 0.0;
    }

    /// After so many corrections in a step new factors are worth their price.
    pub(super) fn max_iterations(&self) -> f64 {
        LEAST_PATIENCE + self.price
    }

    /// A step took so many corrections.
    pub(super) fn served(&mut self, iterations: usize) {
        self.cost += iterations as f64;
        self.steps += 1.0;
        if iterations as f64 * self.steps > self.cost {
            self.discard();
        }
    }

    /// Factors the matrix at the present unknowns.
    pub(super) fn update(
        &mut self,
        model: &mut Model,
        stages: &Stages,
        step: Step,
    ) -> Result<(), StepError> {
        self.discard();
        self.matrix.clear();
        self.add_fields(model, stages, step)?;
        self.add_constraints(model, stages, step)?;
        self.factor
            .factor(self.matrix.pattern(), self.matrix.values())
            .map_err(|_| StepError::SingularNewton)?;
        (self.h, self.cost, self.steps) = (step.h, self.price, 0.0);
        self.t = step.t;
        copy(self.y.flat_mut(), stages.y.flat());
        copy(self.z.flat_mut(), stages.z.flat());
        Ok(())
    }

    /// Makes the factors again where they were made before; the stages are left there.
    pub(super) fn remake(
        &mut self,
        model: &mut Model,
        stages: &mut Stages,
    ) -> Result<(), CheckpointMismatch> {
        if self.h == 0.0 {
            return Ok(());
        }
        let (cost, steps) = (self.cost, self.steps);
        copy(stages.y.flat_mut(), self.y.flat());
        copy(stages.z.flat_mut(), self.z.flat());
        let none = State {
            y: Vec::new(),
            z: Vec::new(),
            y_low: Vec::new(),
        };
        let step = Step {
            t: self.t,
            h: self.h,
            state: &none,
        };
        self.update(model, stages, step)
            .map_err(|_| CheckpointMismatch)?;
        (self.cost, self.steps) = (cost, steps);
        Ok(())
    }

    fn add_fields(
        &mut self,
        model: &mut Model,
        stages: &Stages,
        step: Step,
    ) -> Result<(), StepError> {
        let s = stages.count();
        for i in 0..s {
            let t = stages.time(step, i);
            let (f_y, f_z) = model.field_jacobian(t, stages.y.row(i), stages.z.row(i));
            finite(f_y, Quantity::Derivative, t)?;
            finite(f_z, Quantity::Derivative, t)?;
            for j in 0..s {
                self.matrix.add(i * s + j, f_y, -step.h * stages.a[(i, j)]);
            }
            copy(&mut self.f_z[i], f_z);
        }
        let largest = self.f_z.iter().map(|x| max_norm(x)).fold(0.0, f64::max);
        let unit = 1.0 / largest;
        self.unit = if unit.is_normal() { unit } else { 1.0 };
        for (i, f_z) in self.f_z.iter().enumerate() {
            self.matrix.add(2 * s * s + s + i, f_z, -self.unit);
            self.effect.fill(1.0);
            self.matrix.add(2 * s * s + i, &self.effect, 1.0);
        }
        Ok(())
    }

    fn add_constraints(
        &mut self,
        model: &mut Model,
        stages: &Stages,
        step: Step,
    ) -> Result<(), StepError> {
        let s = stages.count();
        for m in 0..=s {
            let t = stages.time(step, m);
            let k_y = model.constraint_jacobian(t, stages.y.row(m));
            finite(k_y, Quantity::Derivative, t)?;
            for j in 0..s {
                if m == s {
                    self.matrix.add(s * s + (s - 1) * s + j, k_y, stages.b[j]);
                    continue;
                }
                for i in 0..s - 1 {
                    let weight = stages.moments[(i, m)] * stages.a[(m, j)];
                    self.matrix.add(s * s + i * s + j, k_y, weight);
                }
            }
        }
        Ok(())
    }

    /// Corrects the unknowns, and returns the largest change of V or of what Z makes of it.
    pub(super) fn correct(&mut self, model: &Model, stages: &mut Stages, h: f64) -> f64 {
        let at = &model.problem.patterns;
        let (head, tail) = self.unknowns.split_at_mut(stages.v.flat().len());
        copy(head, stages.residual.flat());
        for (out, defect) in tail.iter_mut().zip(stages.defect.flat()) {
            *out = defect / h;
        }
        self.factor.solve(&mut self.unknowns);
        let (d_v, d_z) = self.unknowns.split_at_mut(stages.v.flat().len());
        add_scaled(stages.v.flat_mut(), -1.0, d_v);
        add_scaled(stages.z.flat_mut(), -self.unit, d_z);
        let mut size = max_norm(d_v);
        for (f_z, d_z) in self.f_z.iter().zip(d_z.chunks_exact(model.problem.l)) {
            self.effect.fill(0.0);
            at.f_z.multiply_add(f_z, self.unit, d_z, &mut self.effect);
            size = size.max(max_norm(&self.effect));
        }
        size
    }
}

// What the factors have cost, and where they were made.
liouville_base::checkpoint!(Frozen {
    h,
    cost,
    steps,
    t,
    y,
    z
});
