//! Derivatives of a point of a motion, forwards and transposed: of the rates there, and of its z.
//!
//! With D(t, y, z, z') = w_t + w_y f + w_z z' and R(t, y, z, z') = f_t + f_y f + f_z z', which is y'',
//!
//!     w_z dz' = −D_x dx,   dy'' = R_x dx + f_z dz',   x = (t, y, z, θ).

use super::{RateSolver, SemiExplicitModel, SemiExplicitSensitivityModel};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, add_scaled, copy, dot};
use liouville_problem::{
    Carried, Cotangents, Directions, Dynamics, KnotCotangents, MotionPoint, ObservePoint,
    RateTangents, TangentView, finite,
};

/// The derivatives at a point, with the memory to find them.
#[derive(Clone, Debug)]
pub struct SemiExplicitPoint {
    /// The model.
    pub model: SemiExplicitModel,
    /// Its derivatives by time and parameters.
    pub sensitivity: SemiExplicitSensitivityModel,
    solver: RateSolver,
    f_y: Vec<f64>,
    f_z: Vec<f64>,
    f_tau: Vec<f64>,
    along: Vec<f64>,
    z: Vec<f64>,
    z_dot: Vec<f64>,
}

impl SemiExplicitPoint {
    /// Memory for this model.
    pub fn new(model: SemiExplicitModel, sensitivity: SemiExplicitSensitivityModel) -> Self {
        let (l, at) = (model.problem.l, &model.problem.patterns);
        Self {
            solver: model.solver(),
            f_y: vec![0.0; at.f_y.len()],
            f_z: vec![0.0; at.f_z.len()],
            f_tau: vec![0.0; sensitivity.problem.patterns.f_tau.len()],
            along: Vec::new(),
            z: vec![0.0; l],
            z_dot: vec![0.0; l],
            model,
            sensitivity,
        }
    }

    /// Solves for z' at a point, and linearises f there.
    fn linearize(&mut self, (t, y, z): MotionPoint<'_>) -> Result<(), StepError> {
        self.model.solve(&mut self.solver, t, y, z)?;
        let (f_y, f_z) = self.model.field_jacobian(t, y, z);
        copy(&mut self.f_y, f_y);
        copy(&mut self.f_z, f_z);
        copy(&mut self.f_tau, self.sensitivity.field(t, y, z));
        for values in [&self.f_y, &self.f_z, &self.f_tau] {
            finite(values, Quantity::Derivative, t)?;
        }
        Ok(())
    }

    /// Adds the cotangents of y and τ by those of z, which follows from them.
    fn leave_z(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        of_z: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        if of_z.iter().all(|x| *x == 0.0) {
            return Ok(());
        }
        self.sensitivity.linearize(&mut self.model, t, (y, z))?;
        self.sensitivity.pull(of_z, &mut of.y, &mut of.tau);
        Ok(())
    }
}

impl ObservePoint for SemiExplicitPoint {
    type Model = SemiExplicitModel;

    fn observe(
        &mut self,
        (t, point): (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (of_y, of_z) = row.split_at(of.y.len());
        add_scaled(&mut of.y, 1.0, of_y);
        self.leave_z((t, point.y(), point.z()), of_z, of)
    }

    fn observe_between(
        &mut self,
        _: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (of_y, of_z) = row.split_at(of.y.len());
        add_scaled(&mut of.y, 1.0, of_y);
        add_scaled(&mut of.z, 1.0, of_z);
        Ok(())
    }

    fn observe_knot(
        &mut self,
        (t, point): (f64, &impl Carried),
        knot: &KnotCotangents,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (y, z, l) = (point.y(), point.z(), point.z().len());
        self.linearize((t, y, z))?;
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns.f_tau);
        let [by_y, by_rate, by_second] = &knot.y;
        let [by_z, by_z_dot] = &knot.z;
        add_scaled(&mut of.y, 1.0, by_y);
        of.tau[0] += knot.t;
        let mut of_z = std::mem::take(&mut self.z);
        copy(&mut of_z, by_z);
        (at.f_y).multiply_add_transposed(&self.f_y, 1.0, by_rate, &mut of.y);
        (at.f_z).multiply_add_transposed(&self.f_z, 1.0, by_rate, &mut of_z);
        by_tau.multiply_add_transposed(&self.f_tau, 1.0, by_rate, &mut of.tau);
        copy(&mut self.z_dot, by_z_dot);
        (at.f_z).multiply_add_transposed(&self.f_z, 1.0, by_second, &mut self.z_dot);
        self.solver.factor.solve_transposed(&mut self.z_dot);
        self.along.clear();
        self.along.extend(self.z_dot.iter().map(|x| -x));
        self.along.extend_from_slice(by_second);
        let rates = [y, z, &self.solver.z_dot];
        let found = self.sensitivity.rates(t, rates, &self.along, true);
        finite(found, Quantity::Derivative, t)?;
        of.tau[0] += found[0];
        let (found_y, rest) = found[1..].split_at(y.len());
        add_scaled(&mut of.y, 1.0, found_y);
        add_scaled(&mut of_z, 1.0, &rest[..l]);
        add_scaled(&mut of.tau[1..], 1.0, &rest[l..]);
        let left = self.leave_z((t, y, z), &of_z, of);
        self.z = of_z;
        left
    }

    fn rate(
        &mut self,
        (t, point): (f64, &impl Carried),
        of: &Cotangents,
    ) -> Result<f64, StepError> {
        Ok(of.tau[0] + dot(&of.y, self.model.field(t, point.y(), point.z())))
    }
}

impl RateTangents for SemiExplicitPoint {
    fn flow(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        [y_dot, z_dot]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        self.model.solve(&mut self.solver, t, y, z)?;
        copy(y_dot, self.model.field(t, y, z));
        copy(z_dot, &self.solver.z_dot);
        Ok(())
    }

    fn rates(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        (of, directions): (TangentView<'_>, &mut Directions),
        [velocities, accelerations, rates]: [&mut [f64]; 3],
    ) -> Result<(), StepError> {
        self.linearize((t, y, z))?;
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns.f_tau);
        let (n, l) = (y.len(), z.len());
        for k in 0..directions.count() {
            let (dy, dz) = (of.y.row(k), of.z.row(k));
            let tau = directions.tau(k, of.t[k]);
            let out = &mut velocities[k * n..(k + 1) * n];
            out.fill(0.0);
            at.f_y.multiply_add(&self.f_y, 1.0, dy, out);
            at.f_z.multiply_add(&self.f_z, 1.0, dz, out);
            by_tau.multiply_add(&self.f_tau, 1.0, tau, out);
            self.along.clear();
            for part in [&tau[..1], dy, dz, &tau[1..]] {
                self.along.extend_from_slice(part);
            }
            let point = [y, z, &self.solver.z_dot];
            let found = self.sensitivity.rates(t, point, &self.along, false);
            finite(found, Quantity::Derivative, t)?;
            let (hidden, rate) = found.split_at(l);
            let z_dot = &mut rates[k * l..(k + 1) * l];
            z_dot.fill(0.0);
            add_scaled(z_dot, -1.0, hidden);
            self.solver.factor.solve(z_dot);
            let out = &mut accelerations[k * n..(k + 1) * n];
            copy(out, rate);
            at.f_z.multiply_add(&self.f_z, 1.0, z_dot, out);
        }
        Ok(())
    }

    /// None: z takes their place.
    fn multipliers(
        &mut self,
        _: MotionPoint<'_>,
        _: (TangentView<'_>, &mut Directions),
        _: &mut Matrix,
    ) -> Result<(), StepError> {
        Ok(())
    }
}
