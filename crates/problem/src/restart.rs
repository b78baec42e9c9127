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

/// Corrections that may be needed.
const MOST_ITERATIONS: usize = 50;
/// Corrections of this part are roundoff; those of the second are, where they do not become smaller.
const ROUNDOFF: [f64; 2] = [2.0 * f64::EPSILON, 1e-10];
/// A gradient yields where so much of it is not along the constraints.
const YIELDS: f64 = 1e-12;
/// How far constraints may be missed, as at the start of a run.
const TOLERANCES: Tolerances = Tolerances {
    relative: 1e-10,
    floor: 1e-14,
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

/// What a motion goes on with from a state with other coordinates and velocities.
pub trait Restart<S>: Checkpoint {
    /// Moves (y, z) to the constraints at t, y only if they have jumped, and makes `state` that there; what else a
    /// method carries is that of `before`.
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

// What it finds depends on its arguments alone.
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
        let m = self.model.problem.m;
        if m == 0 {
            return Ok(());
        }
        let mut corrections = Corrections::of(max_norm(y));
        loop {
            self.saddle.update(&mut self.model, t, y, z, &self.none)?;
            let g = self.model.node(t, y, &self.none[..m])[0];
            finite(g, Quantity::Constraint, t)?;
            self.mu.fill(0.0);
            add_scaled(&mut self.mu[..m], -1.0, g);
            self.x.fill(0.0);
            self.saddle.solve(&self.model, &mut self.x, &mut self.mu);
            self.dv.fill(0.0);
            self.saddle.mass.add_velocity(&self.x, &mut self.dv);
            add_scaled(y, 1.0, &self.dv);
            if corrections.is_last(max_norm(&self.dv), max_norm(y))? {
                return Ok(());
            }
        }
    }

    fn move_velocities(&mut self, t: f64, jump: &mut Jump) -> Result<(), Refused> {
        let (m, y) = (self.model.problem.m, &*jump.y);
        if jump.impact.is_none() && self.none.is_empty() {
            return Ok(());
        }
        let [p, _, v] = self.model.end(t, y, jump.z);
        copy(&mut self.p, p);
        copy(&mut self.v, if v.is_empty() { &*jump.z } else { v });
        self.sum.fill(0.0);
        let mut corrections = Corrections::of(max_norm(jump.z));
        loop {
            let z = &*jump.z;
            self.saddle.update(&mut self.model, t, y, z, &self.none)?;
            let k = self.model.nonholonomic(t, y, z, &self.none[m..])[0];
            finite_k(k, m, t)?;
            self.mu.fill(0.0);
            add_scaled(&mut self.mu[m..], -1.0, k);
            let [p, w, v] = self.model.end(t, y, z);
            finite(p, Quantity::Momentum, t)?;
            finite(w, Quantity::Hidden, t)?;
            add_scaled(&mut self.mu[..m], -1.0, w);
            for (k, x) in self.x.iter_mut().enumerate() {
                *x = self.p[k] + self.sum[k] - p[k];
            }
            let v = if v.is_empty() { z } else { v };
            let rate = jump.impact.map_or(0.0, |impact| {
                let changes = v.iter().zip(&self.v).zip(impact.gradient);
                impact.change
                    - changes
                        .map(|((v, before), e)| e * (v - before))
                        .sum::<f64>()
            });
            self.saddle.solve(&self.model, &mut self.x, &mut self.mu);
            if let Some(impact) = jump.impact {
                self.add_impact(impact.gradient, rate)?;
            }
            let (lam, nu) = self.mu.split_at(m);
            self.saddle.add_reaction(&self.model, lam, &mut self.sum);
            self.saddle.add_rolling(&self.model, nu, &mut self.sum);
            add_scaled(jump.z, 1.0, &self.x);
            if corrections.is_last(max_norm(&self.x), max_norm(jump.z))? {
                return Ok(());
            }
        }
    }

    /// Adds what changes the rate along a gradient by so much, less what the present changes do to it.
    fn add_impact(&mut self, gradient: &[f64], rate: f64) -> Result<(), Refused> {
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
            return Err(Refused::Locked);
        }
        let size = left / yields;
        add_scaled(&mut self.x, size, x);
        add_scaled(&mut self.mu, size, mu);
        add_scaled(&mut self.sum, size, gradient);
        Ok(())
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

/// Corrections that become smaller until they are roundoff.
#[derive(Debug)]
pub struct Corrections {
    start: f64,
    last: f64,
    count: usize,
}

impl Corrections {
    /// Of something of this size.
    #[must_use]
    pub fn of(start: f64) -> Self {
        Self {
            start,
            last: f64::INFINITY,
            count: 0,
        }
    }

    /// Whether a correction was the last one needed, of what has this size now.
    ///
    /// # Errors
    /// There were too many.
    pub fn is_last(&mut self, size: f64, now: f64) -> Result<bool, StepError> {
        let unit = self.start.max(now);
        self.count += 1;
        if size <= ROUNDOFF[0] * unit || size <= ROUNDOFF[1] * unit && size >= self.last / 2.0 {
            return Ok(true);
        }
        if self.count == MOST_ITERATIONS || !size.is_finite() {
            let (iterations, size) = (self.count, size / unit);
            return Err(StepError::NotConverged { iterations, size });
        }
        self.last = size;
        Ok(false)
    }
}

impl Violation {
    /// What is violated, as errors have it: a nonholonomic constraint comes after the m holonomic ones.
    pub fn quantity(&self) -> Quantity {
        match self.kind {
            Kind::Holonomic => Quantity::Constraint,
            Kind::Hidden => Quantity::Hidden,
            Kind::Nonholonomic => Quantity::Nonholonomic,
        }
    }
}
