//! States after a jump, moved to their constraints by impulses.
//!
//! Coordinates are moved by v_z p_z⁻¹ r_λ μ until g = 0. Then the impulses of all constraints, and of an impact
//! along the gradient e_y of a function, change the momenta at once:
//!
//!     p(t, y, z⁺) = p(t, y, z) + e_yᵀ Λ + r_λ μ + r_ν ν
//!     0 = w(t, y, z⁺),   0 = k(t, y, z⁺),   e_y (v(t, y, z⁺) − v(t, y, z⁻)) = c
//!
//! which is the least change in the mass metric where reactions are ideal. Source: glocker2001.

use super::consistency::{Kind, Tolerances, Violation};
use super::model::{finite, finite_k};
use super::{Model, Saddle, State};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy, max_norm};
use liouville_base::newton::{Equations, solve_full};

/// Corrections of this part are roundoff; those of the second are, where they do not become smaller.
const ROUNDOFF: [f64; 2] = [2.0 * f64::EPSILON, 1e-10];
/// A gradient yields where so much of it is not along the constraints.
const YIELDS: f64 = 1e-12;
/// How far constraints may be missed, as at the start of a run.
const TOLERANCES: Tolerances<'static> = Tolerances {
    relative: 1e-10,
    floor: 1e-14,
    kinds: &[],
};

/// An impact along the gradient of a function.
#[derive(Clone, Copy, Debug)]
pub struct Impact<'a> {
    /// `e_y`
    pub gradient: &'a [f64],
    /// By how much its rate changes.
    pub change: f64,
}

/// Why a motion cannot go on from a state.
#[derive(Clone, Debug, PartialEq)]
pub enum Refused {
    /// It misses a constraint, however it is moved.
    Violated(Violation),
    /// The constraints allow no motion along the gradient of an impact.
    Locked,
    /// Another error.
    Failed(StepError),
}

impl From<StepError> for Refused {
    fn from(error: StepError) -> Self {
        Self::Failed(error)
    }
}

/// Starts a method anew from other coordinates and velocities.
pub trait Restart<S>: Checkpoint {
    /// Moves (y, z) to the constraints at t, y only if they have jumped, and makes `state` that there; the other
    /// parts of the carried state are those of `before`.
    ///
    /// # Errors
    /// There is no such state.
    fn restart(&mut self, t: f64, before: &S, jump: Jump<'_>, state: &mut S)
    -> Result<(), Refused>;
}

/// Coordinates and velocities after a jump, as they are wanted.
#[derive(Debug)]
pub struct Jump<'a> {
    /// Coordinates.
    pub y: &'a mut [f64],
    /// Velocities or momenta, before an impact.
    pub z: &'a mut [f64],
    /// An impact.
    pub impact: Option<Impact<'a>>,
}

/// The impulses of constraints, with the memory to find them.
#[derive(Clone, Debug)]
pub struct Impulse {
    model: Model,
    saddle: Saddle,
    /// The reactions are linear in their multipliers near none of them.
    none: Vec<f64>,
    /// p and v before, and the impulses so far.
    p: Vec<f64>,
    v: Vec<f64>,
    sum: Vec<f64>,
    /// Changes of z and of velocities, and multipliers.
    x: Vec<f64>,
    dv: Vec<f64>,
    mu: Vec<f64>,
    /// Changes of z and multipliers of a unit impact.
    unit: [Vec<f64>; 2],
}

// The solution depends on the arguments alone.
impl Checkpoint for Impulse {}

impl Impulse {
    /// Memory for this model.
    pub fn new(model: Model) -> Self {
        let (n, all) = (model.problem.n, model.problem.multipliers());
        let zeros = || vec![0.0; n];
        Self {
            saddle: Saddle::new(&model),
            none: vec![0.0; all],
            p: zeros(),
            v: zeros(),
            sum: zeros(),
            x: zeros(),
            dv: zeros(),
            mu: vec![0.0; all],
            unit: [zeros(), vec![0.0; all]],
            model,
        }
    }

    /// Moves a state to the constraints: `y` where `has_moved` says so, and `z`, which an impact changes too.
    ///
    /// # Errors
    /// There is no such state near it.
    pub fn apply(&mut self, t: f64, jump: &mut Jump, has_moved: bool) -> Result<(), Refused> {
        let mut found = Ok(());
        if has_moved {
            found = self.move_positions(t, jump.y, jump.z);
        }
        let found = found
            .map_err(Refused::Failed)
            .and_then(|()| self.move_velocities(t, jump));
        match self.model.violation(t, (jump.y, jump.z), TOLERANCES, true) {
            Some(missed) if !matches!(found, Err(Refused::Locked)) => {
                Err(Refused::Violated(missed))
            }
            _ => found,
        }
    }

    fn move_positions(&mut self, t: f64, y: &mut [f64], z: &[f64]) -> Result<(), StepError> {
        if self.model.problem.m == 0 {
            return Ok(());
        }
        let sizes = Sizes::of(y);
        let mut positions = Positions {
            of: self,
            t,
            y,
            z,
            sizes,
        };
        solve_full(&mut positions).map(|_| ())
    }

    fn move_velocities(&mut self, t: f64, jump: &mut Jump) -> Result<(), Refused> {
        if jump.impact.is_none() && self.none.is_empty() {
            return Ok(());
        }
        let [p, _, v] = self.model.end(t, jump.y, jump.z);
        copy(&mut self.p, p);
        copy(&mut self.v, if v.is_empty() { &*jump.z } else { v });
        self.sum.fill(0.0);
        let sizes = Sizes::of(jump.z);
        let mut velocities = Velocities {
            of: self,
            t,
            jump,
            sizes,
            is_locked: false,
        };
        match solve_full(&mut velocities) {
            Err(_) if velocities.is_locked => Err(Refused::Locked),
            solved => Ok(solved.map(|_| ())?),
        }
    }

    /// Adds what changes the rate along a gradient by so much, less what the present changes do to it; or not, where the
    /// constraints allow no motion along it.
    fn add_impact(&mut self, gradient: &[f64], rate: f64) -> bool {
        let [x, mu] = &mut self.unit;
        let dv = &mut self.dv;
        let mut along = |saddle: &Saddle, x: &[f64]| {
            dv.fill(0.0);
            saddle.mass.add_velocity(x, dv);
            gradient.iter().zip(&*dv).map(|(e, v)| e * v).sum::<f64>()
        };
        let left = rate - along(&self.saddle, &self.x);
        copy(x, gradient);
        self.saddle.mass.solve(x);
        let free = along(&self.saddle, x);
        copy(x, gradient);
        mu.fill(0.0);
        self.saddle.solve(&self.model, x, mu);
        let yields = along(&self.saddle, x);
        if yields.is_nan() || yields <= YIELDS * free {
            return false;
        }
        let size = left / yields;
        add_scaled(&mut self.x, size, x);
        add_scaled(&mut self.mu, size, mu);
        add_scaled(&mut self.sum, size, gradient);
        true
    }
}

/// g = 0, of coordinates that are moved.
struct Positions<'a> {
    of: &'a mut Impulse,
    t: f64,
    y: &'a mut [f64],
    z: &'a [f64],
    sizes: Sizes,
}

impl Equations for Positions<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        let Impulse {
            model,
            saddle,
            none,
            x,
            dv,
            mu,
            ..
        } = &mut *self.of;
        let (m, t) = (model.problem.m, self.t);
        saddle.update(model, t, self.y, self.z, none)?;
        let g = model.node(t, self.y, &none[..m])[0];
        finite(g, Quantity::Constraint, t)?;
        mu.fill(0.0);
        add_scaled(&mut mu[..m], -1.0, g);
        x.fill(0.0);
        saddle.solve(model, x, mu);
        dv.fill(0.0);
        saddle.mass.add_velocity(x, dv);
        add_scaled(self.y, 1.0, dv);
        Ok(self.sizes.next(dv, self.y))
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        Ok(self.sizes.are_roundoff())
    }
}

/// The momenta, w = 0, k = 0 and the rate along an impact, of velocities that are changed.
struct Velocities<'a, 'b> {
    of: &'a mut Impulse,
    t: f64,
    jump: &'a mut Jump<'b>,
    sizes: Sizes,
    is_locked: bool,
}

impl Equations for Velocities<'_, '_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        let Impulse {
            model,
            saddle,
            none,
            p: momenta,
            v: rates,
            sum,
            x,
            mu,
            ..
        } = &mut *self.of;
        let (m, t, y, z) = (model.problem.m, self.t, &*self.jump.y, &*self.jump.z);
        saddle.update(model, t, y, z, none)?;
        let k = model.nonholonomic(t, y, z, &none[m..])[0];
        finite_k(k, m, t)?;
        mu.fill(0.0);
        add_scaled(&mut mu[m..], -1.0, k);
        let [p, w, v] = model.end(t, y, z);
        finite(p, Quantity::Momentum, t)?;
        finite(w, Quantity::Hidden, t)?;
        add_scaled(&mut mu[..m], -1.0, w);
        for (k, x) in x.iter_mut().enumerate() {
            *x = momenta[k] + sum[k] - p[k];
        }
        let v = if v.is_empty() { z } else { v };
        let rate = self.jump.impact.map_or(0.0, |impact| {
            let changes = v.iter().zip(&*rates).zip(impact.gradient);
            impact.change
                - changes
                    .map(|((v, before), e)| e * (v - before))
                    .sum::<f64>()
        });
        saddle.solve(model, x, mu);
        if let Some(impact) = self.jump.impact
            && !self.of.add_impact(impact.gradient, rate)
        {
            self.is_locked = true;
            return Ok(f64::NAN);
        }
        let Impulse {
            model,
            saddle,
            x,
            mu,
            sum,
            ..
        } = &mut *self.of;
        let (lam, nu) = mu.split_at(m);
        saddle.add_reaction(model, lam, sum);
        saddle.add_nonholonomic(model, nu, sum);
        add_scaled(self.jump.z, 1.0, x);
        Ok(self.sizes.next(x, self.jump.z))
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        Ok(self.sizes.are_roundoff())
    }
}

impl Restart<State> for Impulse {
    fn restart(
        &mut self,
        t: f64,
        before: &State,
        mut jump: Jump<'_>,
        state: &mut State,
    ) -> Result<(), Refused> {
        let has_moved = *jump.y != before.y[..];
        self.apply(t, &mut jump, has_moved)?;
        copy(&mut state.y, jump.y);
        copy(&mut state.z, jump.z);
        copy(&mut state.p, self.model.end(t, jump.y, jump.z)[0]);
        state.y_low.fill(0.0);
        state.p_low.fill(0.0);
        if !has_moved {
            copy(&mut state.y_low, &before.y_low);
        }
        Ok(())
    }
}

/// Sizes of the last two corrections, relative to what is corrected.
#[derive(Debug)]
pub struct Sizes {
    start: f64,
    last: [f64; 2],
}

impl Sizes {
    /// Before the first correction of this.
    #[must_use]
    pub fn of(start: &[f64]) -> Self {
        Self {
            start: max_norm(start),
            last: [f64::INFINITY; 2],
        }
    }

    /// The relative size of another correction, of what is this now.
    pub fn next(&mut self, correction: &[f64], now: &[f64]) -> f64 {
        let size = max_norm(correction);
        let unit = self.start.max(max_norm(now));
        let relative = if size == 0.0 { 0.0 } else { size / unit };
        self.last = [self.last[1], relative];
        relative
    }

    /// Whether the last correction was nothing but roundoff.
    #[must_use]
    pub fn are_roundoff(&self) -> bool {
        let [before, last] = self.last;
        last <= ROUNDOFF[0] || last <= ROUNDOFF[1] && last >= before / 2.0
    }
}

impl Violation {
    /// The violated quantity, as in errors; nonholonomic constraints are counted after the m holonomic ones.
    pub fn quantity(&self) -> Quantity {
        match self.kind {
            Kind::Holonomic => Quantity::Constraint,
            Kind::Hidden => Quantity::Hidden,
            Kind::Nonholonomic => Quantity::Nonholonomic,
        }
    }
}
