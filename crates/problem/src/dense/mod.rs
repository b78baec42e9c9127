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

mod adjoint;
mod around;
mod knot;
mod tangents;

pub use adjoint::{KnotCotangents, PathAdjoint};
pub use around::Nearby;
pub use knot::Point;
pub use tangents::PathTangents;

use super::hermite::Newton;
use super::{Carried, Dynamics, Model, TangentView};
use knot::Knot;
use liouville_base::error::StepError;
use liouville_base::linalg::copy;

/// The last few knots of a trajectory, and its polynomials through them.
#[derive(Debug)]
pub struct Path<M: Dynamics = Model> {
    model: M,
    solver: M::Solver,
    most: usize,
    is_coarse: bool,
    /// Whether z is interpolated by itself.
    has_own_z: bool,
    knots: Vec<Knot>,
    spare: Vec<Knot>,
    /// Which of the knots of a known trajectory is the last one.
    followed: Option<usize>,
    is_fitted: bool,
    of_y: Newton,
    of_z: Newton,
    t: f64,
    point: Point,
    tangents: Option<Box<PathTangents>>,
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
            carried: None,
            tangents: None,
        };
        Self {
            solver: model.solver(),
            most,
            is_coarse: order <= 2,
            has_own_z,
            knots: Vec::with_capacity(most),
            spare: vec![knot; most],
            followed: None,
            is_fitted: false,
            of_y: Newton::default(),
            of_z: Newton::default(),
            t: 0.0,
            point: Point {
                y: zeros(),
                z: vec![0.0; l],
                carried: None,
                tangents: None,
            },
            tangents: None,
            model,
        }
    }

    /// The same path of states that carry tangents.
    #[must_use]
    pub fn with_tangents(mut self, tangents: PathTangents) -> Self {
        for knot in &mut self.spare {
            knot.tangents = Some(tangents.knot(self.has_own_z));
        }
        self.point.tangents = Some(tangents.point());
        self.tangents = Some(Box::new(tangents));
        self
    }

    /// Whether the method is of so low an order that its steps tell from the polynomials at first sight.
    pub fn is_coarse(&self) -> bool {
        self.is_coarse
    }

    /// Whether there are as many knots as the path takes into account.
    pub fn is_full(&self) -> bool {
        self.knots.len() == self.most
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
        if let Some((a, work)) = state.accelerations() {
            let (kept, sum) = knot.carried.get_or_insert_with(|| (a.to_vec(), work));
            copy(kept, a);
            *sum = work;
        }
        if let (Some(tangents), Some(of)) = (&mut self.tangents, state.tangents()) {
            tangents.push((t, y, z), of, &mut knot)?;
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

    /// Goes to the point at time `t` of a trajectory of which all steps are known: their ends `times`, and
    /// y and z there, one row a time. The times asked for in turn follow the trajectory.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    pub fn follow(
        &mut self,
        t: f64,
        times: &[f64],
        (y, z): (&[f64], &[f64]),
    ) -> Result<(), StepError> {
        let [n, l, _] = self.model.sizes();
        let is_forward = times.first() <= times.last();
        let end = times.partition_point(|end| if is_forward { *end < t } else { *end > t });
        let last = end.max(self.most - 1).min(times.len() - 1);
        let next = self
            .followed
            .filter(|held| *held <= last && held + self.most > last);
        let first = if let Some(held) = next {
            held + 1
        } else {
            self.spare.append(&mut self.knots);
            (last + 1).saturating_sub(self.most)
        };
        for k in first..=last {
            copy(&mut self.point.y, &y[k * n..(k + 1) * n]);
            copy(&mut self.point.z, &z[k * l..(k + 1) * l]);
            let point = self.point.clone();
            self.push(times[k], &point)?;
        }
        self.followed = Some(last);
        self.move_to(t);
        Ok(())
    }

    /// The time of the last knot.
    pub fn end(&self) -> f64 {
        self.knots.last().map_or(f64::NAN, |knot| knot.t)
    }

    /// Goes to the point at time `t`, which is best between the last two knots; at a knot, to what was given
    /// there.
    #[allow(clippy::float_cmp)] // a knot is met or not
    pub fn move_to(&mut self, t: f64) {
        self.carry(t);
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

    /// Finds the tangents where the path has gone to, its time held, if states carry some.
    pub fn move_tangents(&mut self) {
        let (start, h) = self.last_step();
        self.fit(start, h);
        let (knots, polynomials) = (&self.knots, [&self.of_y, &self.of_z]);
        if let (Some(tangents), Some(of)) = (&mut self.tangents, &mut self.point.tangents) {
            tangents.move_to(self.t, (start, h), (knots, polynomials), of);
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
        if let Some(tangents) = &mut self.tangents {
            tangents.forget();
        }
        if self.has_own_z {
            self.of_z.fit(h, &knots.map(|knot| (at(knot), &knot.z)));
        }
    }

    /// Interpolates the other values that a method carries linearly between knots, as they are of second order.
    fn carry(&mut self, t: f64) {
        let pairs = self.knots.windows(2).rev();
        let mut pairs = pairs.filter(|pair| (t - pair[0].t) * (t - pair[1].t) <= 0.0);
        let [before, after] = match pairs.next() {
            Some([before, after]) => [before, after],
            _ => match self.knots.last() {
                Some(last) => [last, last],
                None => return,
            },
        };
        if let (Some((a0, work0)), Some((a1, work1))) = (&before.carried, &after.carried) {
            let whole = after.t - before.t;
            let part = if whole == 0.0 {
                0.0
            } else {
                (t - before.t) / whole
            };
            let (a, work) = self
                .point
                .carried
                .get_or_insert_with(|| (a0.clone(), *work0));
            for ((a, a0), a1) in a.iter_mut().zip(a0).zip(a1) {
                *a = (1.0 - part) * a0 + part * a1;
            }
            *work = (1.0 - part) * work0 + part * work1;
        }
    }
}

/// Knots, the last step's first.
fn by_closeness(knots: &[Knot]) -> impl Iterator<Item = &Knot> + Clone {
    let count = knots.len();
    let order = [2, 1, 3, 4].into_iter();
    order
        .filter(move |back| *back <= count)
        .map(move |back| &knots[count - back])
}

impl<M: Dynamics> Carried for Path<M> {
    fn y(&self) -> &[f64] {
        self.point.y()
    }

    fn z(&self) -> &[f64] {
        self.point.z()
    }

    fn accelerations(&self) -> Option<(&[f64], f64)> {
        self.point.accelerations()
    }

    fn tangents(&self) -> Option<TangentView<'_>> {
        self.point.tangents()
    }
}
