//! The acceleration-level solve A(t, y, z): the index-1 form of the system, for z' and λ.
//!
//!     p_z z' + p_y v + p_t = f + r(t, y, λ) + r_n(t, y, z, ν)
//!     w_z z' + w_y v + w_t = 0
//!     k_z z' + k_y v + k_t = 0
//!
//! It gives the multipliers at full order and the cold start of an integration.

use super::MemberLanes;
use super::consistency::SMALL;
use super::model::{finite, finite_k};
use super::redundant::LeastNorm;
use super::{Model, Saddle};
use liouville_base::compiled;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::max_norm;
use liouville_base::newton::{Borne, Damped, solve_damped};
use liouville_base::real::{Real, Scalar};

/// The solver, with its memory.
#[derive(Clone, Debug)]
pub struct Acceleration<R = f64> {
    saddle: Saddle<R>,
    /// z', as last solved for.
    pub z_dot: Vec<R>,
    /// λ, then ν, as last solved for; the start of the next solve where r is nonlinear in it.
    pub lam: Vec<R>,
    /// By [`Acceleration::begin`], and by [`Acceleration::finds_length`].
    pub borne: Borne<R>,
    force: Vec<R>,
    drift: Vec<R>,
    /// The correction of λ as last found, and that which is taken, with λ where it was found.
    correction: Vec<R>,
    taken: [Vec<R>; 2],
    /// The acceleration by forces alone.
    alone: Vec<R>,
    /// z' and λ of the start, while those of another time are looked at.
    kept: [Vec<R>; 2],
    least_norm: Option<Box<LeastNorm>>,
}

struct AccelerationEquations<'a, R> {
    at: &'a mut Acceleration<R>,
    model: &'a mut Model<R>,
    point: (f64, &'a [R], &'a [R]),
    /// The largest acceleration by forces and reactions at first.
    unit: Option<R>,
}

impl<R: Real> Acceleration<R> {
    /// Memory for this model.
    #[inline(never)]
    pub fn new(model: &Model<R>) -> Self {
        let (n, m) = (model.problem.n, model.problem.multipliers());
        Self {
            saddle: Saddle::new(model),
            z_dot: vec![R::splat(0.0); n],
            lam: vec![R::splat(0.0); m],
            borne: Borne::nothing(),
            force: vec![R::splat(0.0); n],
            drift: vec![R::splat(0.0); m],
            correction: vec![R::splat(0.0); m],
            taken: [m, m].map(|len| vec![R::splat(0.0); len]),
            alone: vec![R::splat(0.0); n],
            kept: [n, m].map(|len| vec![R::splat(0.0); len]),
            least_norm: LeastNorm::new(&model.problem).map(Box::new),
        }
    }

    /// Forgets all of a run.
    pub fn reset(&mut self) {
        self.lam.fill(R::splat(0.0));
        self.borne = Borne::nothing();
    }

    /// [`Acceleration::solve`] for the start of an integration by a step of h, and b, the largest acceleration that is
    /// borne:
    ///
    ///     b = max_k min(|a_f,k|, |a_r,k|),   M a_f = f − p_y v − p_t,   a_r = z' − a_f
    ///
    /// Roundoff of f + r moves velocities by ε h b. Where nothing is borne at t, b is that at t + h: a force may grow from
    /// zero.
    ///
    /// # Errors
    /// As [`Acceleration::solve`].
    #[inline(never)]
    pub fn begin(
        &mut self,
        model: &mut Model<R>,
        (t, h): (f64, f64),
        y: &[R],
        z: &[R],
    ) -> Result<(), StepError> {
        self.solve(model, t, y, z)?;
        self.borne.acceleration = R::splat(0.0);
        if self.lam.is_empty() {
            return Ok(());
        }
        self.borne.acceleration = self.balanced();
        if self.borne.acceleration.all(|borne| borne > 0.0) {
            return Ok(());
        }
        self.kept[0].copy_from_slice(&self.z_dot);
        self.kept[1].copy_from_slice(&self.lam);
        if self.solve(model, t + h, y, z).is_ok() {
            let first = |borne, later| if borne > 0.0 { borne } else { later };
            self.borne.acceleration = self.borne.acceleration.zip(self.balanced(), first);
        }
        self.z_dot.copy_from_slice(&self.kept[0]);
        self.lam.copy_from_slice(&self.kept[1]);
        Ok(())
    }

    /// The largest acceleration that forces and reactions take from one another, as last solved for.
    fn balanced(&mut self) -> R {
        self.saddle.mass.solve(&mut self.force);
        let mut found = R::splat(0.0);
        for (of_force, sum) in self.force.iter().zip(&self.z_dot) {
            let of_reaction = *sum - *of_force;
            let both = of_force.zip(of_reaction, |f, r| f.abs().min(r.abs()));
            found = found.zip(both, f64::max);
        }
        found
    }

    /// Solves for `z_dot` and `lam` at (t, y, z).
    ///
    /// # Errors
    /// A value that is not finite, a singular matrix, or no convergence where reactions are nonlinear
    /// in their multipliers.
    #[inline(never)]
    pub fn solve(
        &mut self,
        model: &mut Model<R>,
        t: f64,
        y: &[R],
        z: &[R],
    ) -> Result<(), StepError> {
        let m = model.problem.m;
        let [force, drift, _] = model.acceleration(t, y, z);
        finite(force, Quantity::Force, t)?;
        finite(&drift[..m], Quantity::Hidden, t)?;
        finite_k(&drift[m..], m, t)?;
        self.force.copy_from_slice(force);
        self.drift.copy_from_slice(drift);
        let is_linear = model.problem.is_linear;
        if is_linear {
            self.lam.fill(R::splat(0.0));
        }
        let mut solve = AccelerationEquations {
            at: self,
            model,
            point: (t, y, z),
            unit: None,
        };
        if is_linear {
            solve.find(true)?;
        } else {
            let mut found = solve_damped(&mut solve);
            if found.is_err() {
                // multipliers of another point may be worse than none
                solve.at.lam.fill(R::splat(0.0));
                found = solve_damped(&mut solve);
            }
            found.map_err(|error| match error {
                StepError::NotConverged { .. } | StepError::SingularNewton => {
                    StepError::NoMultipliers
                }
                other => other,
            })?;
        }
        for (lam, d) in self.lam.iter_mut().zip(&self.correction) {
            *lam += *d;
        }
        Ok(())
    }
}

impl Acceleration {
    /// [`Acceleration::solve`], and [`Acceleration::multipliers`] too.
    ///
    /// # Errors
    /// As [`Acceleration::solve`].
    pub fn solve_all(
        &mut self,
        model: &mut Model,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), StepError> {
        self.solve(model, t, y, z)?;
        match &mut self.least_norm {
            Some(found) => found.solve((model, &mut self.saddle), (t, y, z), &self.lam),
            None => Ok(()),
        }
    }

    /// Finds the length of [`Model::constraint_length`] for a step of h that has failed, where the motion is small beside it:
    /// at coordinates of zero, terms of constraints may be of any size. Says whether it was missing.
    #[cold]
    pub fn finds_length(
        &mut self,
        model: &mut Model,
        (t, h): (f64, f64),
        (y, v): (&[f64], &[f64]),
    ) -> bool {
        if self.borne.length > 0.0 || model.problem.m == 0 {
            return false;
        }
        let length = match self.borne.length {
            // not 0, which is not yet known
            0.0 => model.constraint_length(t, y).max(f64::MIN_POSITIVE),
            known => -known,
        };
        let motion = max_norm(y) + h.abs() * (max_norm(v) + self.borne.speed(h));
        let is_missing = motion < SMALL * length;
        self.borne.length = if is_missing { length } else { -length };
        is_missing
    }

    /// λ, then ν, of all constraints, those left out too, as last solved for.
    pub fn multipliers(&self) -> &[f64] {
        self.least_norm
            .as_ref()
            .map_or(&self.lam, |found| &found.lam)
    }
}

impl<R: Real> Damped<R> for AccelerationEquations<'_, R> {
    /// A correction by its acceleration, M⁻¹ r_λ δλ: that is also the size of the residual.
    fn find(&mut self, is_new: bool) -> Result<R, StepError> {
        let (t, y, z) = self.point;
        let at = &mut *self.at;
        if is_new {
            at.saddle.update(self.model, t, y, z, &at.lam)?;
        }
        at.z_dot.copy_from_slice(&at.force);
        let (lam, nu) = at.lam.split_at(self.model.problem.m);
        if !lam.is_empty() {
            let [_, r] = self.model.node(t, y, lam);
            finite(r, Quantity::Reaction, t)?;
            at.z_dot.iter_mut().zip(r).for_each(|(out, r)| *out += *r);
        }
        if !nu.is_empty() {
            let [_, r] = self.model.nonholonomic(t, y, z, nu);
            finite(r, Quantity::Reaction, t)?;
            at.z_dot.iter_mut().zip(r).for_each(|(out, r)| *out += *r);
        }
        at.correction
            .iter_mut()
            .zip(&at.drift)
            .for_each(|(out, drift)| *out = -*drift);
        at.saddle
            .solve(self.model, &mut at.z_dot, &mut at.correction);
        if self.model.problem.is_linear {
            return Ok(R::splat(0.0));
        }
        if is_new {
            at.taken[0].copy_from_slice(&at.lam);
            at.taken[1].copy_from_slice(&at.correction);
        }
        let size = at.saddle.velocity_of(self.model, &at.correction);
        let unit = *self.unit.get_or_insert_with(|| {
            let alone = &mut at.alone;
            alone.copy_from_slice(&at.force);
            at.saddle.mass.solve_velocity(alone);
            size + max_norm(alone) + at.saddle.velocity_of(self.model, &at.lam)
        });
        let relative = |size: f64, unit: f64| if size == 0.0 { 0.0 } else { size / unit };
        Ok(size.zip(unit, relative))
    }

    fn take(&mut self, part: f64) {
        let at = &mut *self.at;
        let [from, taken] = &at.taken;
        for (lam, (from, d)) in at.lam.iter_mut().zip(from.iter().zip(taken)) {
            *lam = *from + *d * part;
        }
    }
}
// Multipliers, where the next solve starts from, and the unit of corrections.
liouville_base::checkpoint!([R: Scalar] Acceleration<R> { lam, borne });

compiled!(R in [f64, MemberLanes] {
    Acceleration::<R>::new as fn(_) -> _,
    Acceleration::<R>::solve as fn(_, _, _, _, _) -> _,
    Acceleration::<R>::begin as fn(_, _, _, _, _) -> _,
});
