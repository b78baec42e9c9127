//! Cotangents of a motion: the derivatives of a function of it by its states, by time and by parameters.

use super::sensitivity::SensitivityModel;
use super::{
    Acceleration, Carried, Model, ObservePoint, Saddle, Side, model::finite, rates_beside,
};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Pattern, add_scaled, dot};
use liouville_base::real::Real;

/// Derivatives of a function of a run: by the state at a point, and by all else from there on.
#[derive(Clone, Debug, PartialEq)]
pub struct Cotangents<R = f64> {
    /// By coordinates.
    pub y: Vec<R>,
    /// By z where the run is observed; other derivatives by z may be in `carried`.
    pub z: Vec<R>,
    /// By the other parts of the carried state: p, or accelerations.
    pub carried: Vec<R>,
    /// By τ = (t, θ), the time being that of the point.
    pub tau: Vec<R>,
    /// By the part of themselves by which the steps become longer.
    pub stretch: R,
}

impl<R: Real> Cotangents<R> {
    /// Zeros, for so many numbers of y, z and the carried state, and of τ.
    pub fn zeros([y, z, carried]: [usize; 3], width: usize) -> Self {
        Self {
            y: vec![R::splat(0.0); y],
            z: vec![R::splat(0.0); z],
            carried: vec![R::splat(0.0); carried],
            tau: vec![R::splat(0.0); width],
            stretch: R::splat(0.0),
        }
    }

    /// Makes cotangents of zero, with the sizes of these.
    #[must_use]
    pub fn like(&self) -> Self {
        let sizes = [&self.y, &self.z, &self.carried].map(Vec::len);
        Self::zeros(sizes, self.tau.len())
    }

    /// Adds so many times others.
    pub fn add_scaled(&mut self, factor: f64, other: &Self) {
        let own = [&mut self.y, &mut self.z, &mut self.carried, &mut self.tau];
        let others = [&other.y, &other.z, &other.carried, &other.tau];
        for (own, other) in own.into_iter().zip(others) {
            add_scaled(own, factor, other);
        }
        self.stretch += other.stretch * factor;
    }
}

impl<R: Real> Cotangents<R> {
    /// Returns the cotangents of one member.
    #[must_use]
    pub fn member(&self, member: usize) -> Cotangents {
        let of = |x: &[R]| x.iter().map(|x| x.member(member)).collect();
        Cotangents {
            y: of(&self.y),
            z: of(&self.z),
            carried: of(&self.carried),
            tau: of(&self.tau),
            stretch: self.stretch.member(member),
        }
    }
}

/// The adjoint of the values at a point: y, z and the multipliers of the accelerations there.
#[derive(Clone, Debug)]
pub struct PointAdjoint<R = f64> {
    /// The model.
    pub model: Model<R>,
    /// Its derivatives by time and parameters.
    pub sensitivity: SensitivityModel<R>,
    acceleration: Acceleration<R>,
    matrix: Saddle<R>,
    a: Vec<R>,
    b: Vec<R>,
}

impl<R: Real> PointAdjoint<R> {
    /// Memory for this model.
    pub fn new(model: Model<R>, sensitivity: SensitivityModel<R>) -> Self {
        Self {
            acceleration: Acceleration::new(&model),
            matrix: Saddle::new(&model),
            a: vec![R::splat(0.0); model.problem.n],
            b: vec![R::splat(0.0); model.problem.multipliers()],
            model,
            sensitivity,
        }
    }

    /// Adds cotangents `row` of (y, z, λ) at a point.
    ///
    /// # Errors
    /// As [`ObservePoint::observe`].
    pub fn observe_at(
        &mut self,
        at: (f64, &[R], &[R]),
        row: &[R],
        of: &mut Cotangents<R>,
    ) -> Result<(), StepError> {
        let n = self.a.len();
        add_scaled(&mut of.y, 1.0, &row[..n]);
        add_scaled(&mut of.z, 1.0, &row[n..2 * n]);
        self.a.fill(R::splat(0.0));
        self.b.copy_from_slice(&row[2 * n..]);
        self.accelerations(at, of)
    }

    /// Takes cotangents `a` and `b` of z' and λ to the point.
    fn accelerations(
        &mut self,
        (t, y, z): (f64, &[R], &[R]),
        of: &mut Cotangents<R>,
    ) -> Result<(), StepError> {
        if (self.a.iter().chain(&self.b)).all(|x| x.all(|x| x == 0.0)) {
            return Ok(());
        }
        self.acceleration.solve(&mut self.model, t, y, z)?;
        let Acceleration { z_dot, lam, .. } = &self.acceleration;
        self.matrix.update(&mut self.model, t, y, z, lam)?;
        (self.matrix).solve_transposed(&self.model, &mut self.a, &mut self.b);
        let problem = self.sensitivity.problem.clone();
        let at = &problem.patterns;
        let values = self.sensitivity.motion(t, [y, z, z_dot, lam]);
        for part in values {
            finite(part, Quantity::Derivative, t)?;
        }
        let (motion, rate) = values.split_at(3);
        let out = [&mut of.y, &mut of.z, &mut of.tau];
        for (k, out) in out.into_iter().enumerate() {
            subtract(&at.motion[k], motion[k], &self.a, out);
            subtract(&at.rate[k], rate[k], &self.b, out);
        }
        Ok(())
    }

    /// Takes cotangents of p, where a method carries p, at the start of a motion to y, z and τ there.
    ///
    /// # Errors
    /// A derivative that is not finite.
    pub fn leave_momenta(
        &mut self,
        (t, y, z): (f64, &[R], &[R]),
        of: &mut Cotangents<R>,
    ) -> Result<(), StepError> {
        let problem = self.sensitivity.problem.clone();
        let at = &problem.mechanical.patterns;
        let [p_tau, ..] = self.sensitivity.stage(t, y, z);
        let [p_z, _] = self.model.stage_blocks(t, y, z);
        (at.p_z).multiply_add_transposed(p_z, 1.0, &of.carried, &mut of.z);
        let by_tau = &problem.patterns.p_tau;
        by_tau.multiply_add_transposed(p_tau, 1.0, &of.carried, &mut of.tau);
        let [p_y, ..] = self.model.stage_jacobian(t, y, z);
        at.p_y
            .multiply_add_transposed(p_y, 1.0, &of.carried, &mut of.y);
        of.carried.fill(R::splat(0.0));
        for values in [&of.y, &of.z, &of.tau] {
            finite(values, Quantity::Derivative, t)?;
        }
        Ok(())
    }
}

impl PointAdjoint {
    /// Adds cotangents of z' at a point.
    ///
    /// # Errors
    /// As [`ObservePoint::observe`].
    pub fn observe_rate(
        &mut self,
        (t, point): (f64, &impl Carried),
        rate: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.a.copy_from_slice(rate);
        self.b.fill(0.0);
        self.accelerations((t, point.y(), point.z()), of)
    }
}

impl ObservePoint for PointAdjoint {
    type Model = Model;

    fn observe(
        &mut self,
        (t, point): (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.observe_at((t, point.y(), point.z()), row, of)
    }

    fn rate(
        &mut self,
        (t, point): (f64, &impl Carried),
        side: Side,
        of: &Cotangents,
    ) -> Result<f64, StepError> {
        let by = (&mut self.model, &mut self.acceleration);
        let [y_dot, z_dot] = rates_beside(by, (t, point.y(), point.z()), side)?;
        Ok(of.tau[0] + dot(&of.y, &y_dot) + dot(&of.z, &z_dot))
    }
}

/// out −= Aᵀ x
fn subtract<R: Real>(pattern: &Pattern, values: &[R], x: &[R], out: &mut [R]) {
    pattern.multiply_add_transposed(values, -1.0, x, out);
}
