//! The Newton matrices of the α family, frozen and factored. Corrections h² η of y1 and h ζ of z1
//! decouple when M, r_λ and g_y at both ends of a step are taken to be the same:
//!
//!     [ M      −r_λ ] [ d ]   [ … ]
//!     [ g_y      0  ] [ ν ] = [ … ],     d = ζ − (γ/β) η
//!
//!     [ M − γ c h F_z − β c h² (F − M u)_y + ω h² (M a − r)_y    −r_λ ] [ η ]   [ … ]
//!     [ g_y                                                        0  ] [ μ ] = [ … ]
//!
//! with c = (1 − α_f)/(1 − α_m) and ω the weight of the last reaction in y1. No entry of either
//! grows as h → 0: both tend to the matrix of the acceleration-level solve.

use super::solve::{Solver, Step};
use crate::linalg::{Assembly, Factor, copy};
use crate::problem::mechanical::{Mass, Model, Saddle, SecondOrderModel};
use crate::trouble::Trouble;

/// The factors, with the derivatives they came from.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    /// The first matrix.
    pub(super) saddle: Saddle,
    /// M alone.
    pub(super) mass: Mass,
    matrix: Assembly,
    factor: Factor,
    mass_values: Vec<f64>,
    /// (F − M u)_y
    pub(super) j_y: Vec<f64>,
    /// F_z
    pub(super) j_z: Vec<f64>,
    /// The step they are for; 0 when they are of no use.
    pub(super) h: f64,
    momentum: Vec<f64>,
    none: Vec<f64>,
}

impl Frozen {
    pub(super) fn new(model: &SecondOrderModel) -> Self {
        let (problem, general) = (&model.problem, &model.general);
        let (n, m, at) = (general.problem.n, general.problem.m, &problem.patterns);
        let matrix = Assembly::new(
            (n + m, n + m),
            &[
                (&at.mass, 0, 0),
                (&at.j_z, 0, 0),
                (&at.j_y, 0, 0),
                (&at.n_y, 0, 0),
                (&general.problem.patterns.r_lam, 0, n),
                (&general.problem.patterns.g_y, n, 0),
            ],
        );
        Self {
            saddle: Saddle::new(general),
            mass: Mass::new(general),
            factor: Factor::new(matrix.pattern()),
            matrix,
            mass_values: vec![0.0; at.mass.len()],
            j_y: vec![0.0; at.j_y.len()],
            j_z: vec![0.0; at.j_z.len()],
            h: 0.0,
            momentum: vec![0.0; n],
            none: vec![0.0; m],
        }
    }

    /// Factors both at the solver's unknowns.
    pub(super) fn update(
        &mut self,
        model: &mut SecondOrderModel,
        solver: &mut Solver,
        step: Step,
    ) -> Result<(), Trouble> {
        self.h = 0.0;
        solver.place(step.h);
        let (t, h) = (step.t + step.h, step.h);
        let Solver {
            y,
            z,
            phi,
            coupling,
            reactions,
            ..
        } = &*solver;
        let [_, last] = reactions;
        self.saddle.update(&mut model.general, t, y, z, &last.lam)?;
        self.mass.update(&mut model.general, t, y, z)?;
        let [mass, j_y, j_z] = model.jacobian(t, y, z, phi)?;
        copy(&mut self.mass_values, mass);
        copy(&mut self.j_y, j_y);
        copy(&mut self.j_z, j_z);
        self.matrix.clear();
        self.matrix.add(0, &self.mass_values, 1.0);
        self.matrix.add(1, &self.j_z, -coupling.phi[1] * h);
        self.matrix.add(2, &self.j_y, -coupling.phi[0] * h * h);
        if coupling.moving != 0.0 {
            let n_y = model.reaction_jacobian(t, y, &last.a, &last.lam)?;
            self.matrix.add(3, n_y, coupling.moving * h * h);
        }
        self.matrix.add(4, self.saddle.r_lam(), -1.0);
        self.matrix.add(5, self.saddle.g_y(), 1.0);
        self.factor
            .factor(self.matrix.pattern(), self.matrix.values())
            .map_err(|_| Trouble::SingularNewton)?;
        self.h = h;
        Ok(())
    }

    /// Solves with the second matrix in place: η over μ.
    pub(super) fn solve(&mut self, x: &mut [f64]) {
        self.factor.solve(x);
    }

    /// `x = P x`, with P the projection along r_λ onto what the constraints leave free.
    pub(super) fn project(&mut self, model: &mut Model, x: &mut [f64]) {
        if self.none.is_empty() {
            return;
        }
        self.momentum.fill(0.0);
        let pattern = &model.problem.patterns.p_z;
        pattern.multiply_add(&self.mass_values, 1.0, x, &mut self.momentum);
        self.none.fill(0.0);
        self.saddle.solve(model, &mut self.momentum, &mut self.none);
        copy(x, &self.momentum);
    }
}
