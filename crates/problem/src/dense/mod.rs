//! Trajectories between steps: multi-point Hermite interpolation.
//!
//! At the ends of steps, the knots, y is known with y' = v and
//!
//!     y'' = v_t + v_y v + v_z z',
//!
//! with z' from the acceleration-level solve. The polynomial that agrees with all three at k successive
//! knots has degree 3k − 1 and is off by O(h^3k): degree 5 on a single step, 8 with the step before. z is its
//! derivative where v = z, hence of one order less; elsewhere z has a polynomial of its own, through z and
//! z', of degree 2k − 1, and so it has with methods of order 2, whose y is not accurate enough for that. λ comes from
//! the acceleration-level solve at the interpolated point: there the constraints hold to the order of all
//! this, no better. Source: hairer1993, II.6, for k = 2; the polynomials are in Newton's form.

mod around;
mod knot;

pub use around::Nearby;
pub use knot::Point;

use super::hermite::Newton;
use super::{Carried, Dynamics, Model};
use knot::Knot;
use liouville_base::error::StepError;
use liouville_base::linalg::copy;

/// Knots before the last step count where steps are at least as long as this part of it.
const APART: f64 = 1e-2;

/// The last few knots of a trajectory, and its polynomials through them.
#[derive(Debug)]
pub struct Path<M: Dynamics = Model> {
    model: M,
    solver: M::Solver,
    is_coarse: bool,
    /// Whether z is interpolated by itself.
    has_own_z: bool,
    knots: Vec<Knot>,
    spare: Vec<Knot>,
    is_fitted: bool,
    of_y: Newton,
    of_z: Newton,
    t: f64,
    point: Point,
}

impl<M: Dynamics> Path<M> {
    /// A path of `model`, on which a method of this order makes steps.
    pub fn new(model: M, order: usize) -> Self {
        let [n, l, _] = model.sizes();
        let has_own_z = model.has_own_z() || order <= 2;
        let most = match order {
            ..=4 => 2,
            7.. if has_own_z => 4,
            _ => 3,
        };
        let zeros = || vec![0.0; n];
        let z = || vec![0.0; if has_own_z { l } else { 0 }];
        let knot = Knot {
            t: 0.0,
            y: [zeros(), zeros(), zeros()],
            z: [z(), z()],
        };
        Self {
            solver: model.solver(),
            is_coarse: order <= 2,
            has_own_z,
            knots: Vec::with_capacity(most),
            spare: vec![knot; most],
            is_fitted: false,
            of_y: Newton::default(),
            of_z: Newton::default(),
            t: 0.0,
            point: Point {
                y: zeros(),
                z: vec![0.0; l],
            },
            model,
        }
    }

    /// Whether the method is of so low an order that its steps tell from the polynomials at first sight.
    pub fn is_coarse(&self) -> bool {
        self.is_coarse
    }

    /// Goes on to the next knot; the oldest may be forgotten.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    pub fn push(&mut self, t: f64, state: &impl Carried) -> Result<(), StepError> {
        let (y, z) = (state.y(), state.z());
        self.model.solve(&mut self.solver, t, y, z)?;
        let mut knot = match self.spare.pop() {
            Some(knot) => knot,
            None => self.knots.remove(0),
        };
        knot.t = t;
        copy(&mut knot.y[0], y);
        let [_, y_dot, y_ddot] = &mut knot.y;
        self.model
            .derivatives(&self.solver, t, (y, z), [y_dot, y_ddot])?;
        if self.has_own_z {
            copy(&mut knot.z[0], z);
            copy(&mut knot.z[1], M::z_dot(&self.solver));
        }
        self.knots.push(knot);
        self.is_fitted = false;
        Ok(())
    }

    /// Puts a knot in the place of the last one, where the motion goes on with another state.
    ///
    /// # Errors
    /// As [`Path::push`].
    pub fn end_at(&mut self, t: f64, state: &impl Carried) -> Result<(), StepError> {
        self.spare.extend(self.knots.pop());
        self.is_fitted = false;
        if self.end().to_bits() == t.to_bits() {
            return Ok(());
        }
        self.push(t, state)
    }

    /// Forgets all knots, and goes on from this one.
    ///
    /// # Errors
    /// As [`Path::push`].
    pub fn begin(&mut self, t: f64, state: &impl Carried) -> Result<(), StepError> {
        self.spare.append(&mut self.knots);
        self.push(t, state)
    }

    /// The time of the last knot.
    fn end(&self) -> f64 {
        self.knots.last().map_or(f64::NAN, |knot| knot.t)
    }

    /// Goes to the point at time `t`, which is best between the last two knots; at a knot, to what was given
    /// there.
    #[allow(clippy::float_cmp)] // a knot is met or not
    pub fn move_to(&mut self, t: f64) {
        self.t = t;
        let has_own_z = self.has_own_z;
        if let Some(knot) = self.knots.iter().find(|knot| knot.t == t) {
            copy(&mut self.point.y, &knot.y[0]);
            copy(
                &mut self.point.z,
                if has_own_z { &knot.z[0] } else { &knot.y[1] },
            );
            return;
        }
        let (start, h) = self.last_step();
        self.fit(start, h);
        let x = (t - start) / h;
        let Point { y, z, .. } = &mut self.point;
        if has_own_z {
            y.iter_mut()
                .enumerate()
                .for_each(|(k, y)| *y = self.of_y.at(k, x).0);
            z.iter_mut()
                .enumerate()
                .for_each(|(k, z)| *z = self.of_z.at(k, x).0);
            return;
        }
        for (k, (y, z)) in y.iter_mut().zip(z).enumerate() {
            let (value, slope) = self.of_y.at(k, x);
            *y = value;
            *z = slope / h;
        }
    }

    /// Goes to a state at time `t` with coordinates and velocities changed by these parts of them, in turn.
    pub fn move_near(&mut self, t: f64, state: &impl Carried, parts: [f64; 2]) {
        self.t = t;
        copy(&mut self.point.y, state.y());
        copy(&mut self.point.z, state.z());
        let values = self.point.y.iter_mut().chain(&mut self.point.z);
        for (value, part) in values.zip(parts.into_iter().cycle()) {
            *value += part * *value;
        }
    }

    /// Where the path has gone to.
    pub fn point(&self) -> &Point {
        &self.point
    }

    /// Solves for λ there, if the model has one.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    pub fn solve_there(&mut self) -> Result<(), StepError> {
        let Point { y, z, .. } = &self.point;
        self.model.solve_lam(&mut self.solver, self.t, y, z)
    }

    /// Solves for λ at a state, if the model has one.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    pub fn solve(&mut self, t: f64, state: &impl Carried) -> Result<(), StepError> {
        self.model
            .solve_lam(&mut self.solver, t, state.y(), state.z())
    }

    /// λ of all constraints, as last solved for.
    pub fn lam(&self) -> &[f64] {
        M::lam(&self.solver)
    }

    /// Start and length of the last step; of none, where there is only its start.
    fn last_step(&self) -> (f64, f64) {
        match self.knots[..] {
            [.., ref before, ref last] => (before.t, last.t - before.t),
            [ref only] => (only.t, 1.0),
            [] => (0.0, 1.0),
        }
    }

    /// The polynomials, the last step's knots first: there the differences are the smallest.
    fn fit(&mut self, start: f64, h: f64) {
        if std::mem::replace(&mut self.is_fitted, true) {
            return;
        }
        let knots = by_closeness(&self.knots);
        let at = |knot: &Knot| (knot.t - start) / h;
        let of_y = knots.clone().map(|knot| (at(knot), &knot.y));
        self.of_y.fit(h, &of_y);
        if self.has_own_z {
            self.of_z.fit(h, &knots.map(|knot| (at(knot), &knot.z)));
        }
    }
}

/// Knots, the last step's first, as far back as they are apart: third differences over a much shorter step, such as the
/// end of one that an event has cut, are roundoff.
fn by_closeness(knots: &[Knot]) -> impl Iterator<Item = &Knot> + Clone {
    let count = knots.len();
    let length = move |back: usize| (knots[count - back + 1].t - knots[count - back].t).abs();
    let order = [2, 1, 3, 4].into_iter();
    order
        .filter(move |back| *back <= count)
        .take_while(move |back| *back <= 2 || length(*back) >= APART * length(2))
        .map(move |back| &knots[count - back])
}
