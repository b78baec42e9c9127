//! Tangents of a trajectory between steps, at times that are held.
//!
//! A polynomial P with P⁽ˡ⁾(t_k) = Y_k⁽ˡ⁾ changes with its knots, times and values, by the polynomial of the same degree with
//!
//!     dP⁽ˡ⁾(t_k) = dY_k⁽ˡ⁾ − P⁽ˡ⁺¹⁾(t_k) dt_k,
//!
//! as the derivative of that equation says.

use super::super::hermite::Newton;
use super::super::tangents::AccelerationTangents;
use super::super::{Acceleration, Directions, Model, SensitivityModel, TangentView, model::finite};
use super::by_closeness;
use super::knot::{Knot, KnotTangents, PointTangents};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, add_scaled, copy};

/// What finds the tangents of knots, and the polynomials through them.
#[derive(Clone, Debug)]
pub struct PathTangents {
    acceleration: AccelerationTangents,
    solver: Acceleration,
    directions: Directions,
    /// Tangents of z', in one direction after another.
    rates: Vec<f64>,
    /// What the polynomials have at each knot.
    moved: Vec<KnotTangents>,
    of_y: Newton,
    of_z: Newton,
    is_fitted: bool,
}

impl PathTangents {
    /// Tangents in these directions of paths of a model.
    pub fn new(model: Model, sensitivity: SensitivityModel, directions: Directions) -> Self {
        Self {
            solver: Acceleration::new(&model),
            rates: vec![0.0; directions.count() * model.problem.n],
            acceleration: AccelerationTangents::new(model, sensitivity),
            directions,
            moved: Vec::new(),
            of_y: Newton::default(),
            of_z: Newton::default(),
            is_fitted: false,
        }
    }

    /// Memory of a knot.
    pub(super) fn knot(&self, has_own_z: bool) -> KnotTangents {
        let zeros = || vec![0.0; self.rates.len()];
        let z = || if has_own_z { zeros() } else { Vec::new() };
        KnotTangents {
            y: [zeros(), zeros(), zeros()],
            z: [z(), z()],
            t: vec![0.0; self.directions.count()],
        }
    }

    /// Memory of a point.
    pub(super) fn point(&self) -> PointTangents {
        let count = self.directions.count();
        let rows = || Matrix::zeros(count, self.acceleration.model.problem.n);
        PointTangents {
            y: rows(),
            z: rows(),
            t: vec![0.0; count],
        }
    }

    /// The knots are others.
    pub(super) fn forget(&mut self) {
        self.is_fitted = false;
    }

    /// Writes the tangents of a knot at a point, from those of its state.
    pub(super) fn push(
        &mut self,
        (t, y, z): (f64, &[f64], &[f64]),
        of: TangentView<'_>,
        knot: &mut Knot,
    ) -> Result<(), StepError> {
        let Some(out) = &mut knot.tangents else {
            return Ok(());
        };
        let (n, solver) = (y.len(), &mut self.solver);
        solver.solve(&mut self.acceleration.model, t, y, z)?;
        let (rates, point) = (&mut self.rates, [y, z, &solver.z_dot, &solver.lam]);
        let along = (of, &mut self.directions);
        self.acceleration
            .solve((t, point), along, |direction, rate, _| {
                copy(&mut rates[direction * n..(direction + 1) * n], rate);
            })?;
        // a state may have a row more, of a direction that is not recorded
        let (count, all) = (out.t.len(), rates.len());
        copy(&mut out.t, &of.t[..count]);
        copy(&mut out.y[0], &of.y.flat()[..all]);
        if let [z, z_dot] = &mut out.z
            && !z.is_empty()
        {
            copy(z, &of.z.flat()[..all]);
            copy(z_dot, rates);
        }
        let [_, velocities, accelerations] = &mut out.y;
        if self.acceleration.sensitivity.problem.velocity.is_some() {
            velocities.fill(0.0);
            accelerations.fill(0.0);
            self.add_velocities((t, y, z), of, [velocities, accelerations]);
        } else {
            copy(velocities, &of.z.flat()[..all]);
            copy(accelerations, rates);
        }
        finite(velocities, Quantity::Derivative, t)?;
        finite(accelerations, Quantity::Derivative, t)
    }

    /// Adds the tangents of y' and y'' where v is not z.
    fn add_velocities(
        &mut self,
        (t, y, z): (f64, &[f64], &[f64]),
        of: TangentView<'_>,
        [velocities, accelerations]: [&mut [f64]; 2],
    ) {
        let (n, count) = (y.len(), self.directions.count());
        let own = |k: usize| k * n..(k + 1) * n;
        let AccelerationTangents {
            model, sensitivity, ..
        } = &mut self.acceleration;
        let problem = sensitivity.problem.clone();
        let (at, by_tau) = (&problem.mechanical.patterns, &problem.patterns);
        let [_, v_z] = model.stage_blocks(t, y, z);
        if let Some(pattern) = &at.v_z {
            for k in 0..count {
                pattern.multiply_add(v_z, 1.0, of.z.row(k), &mut velocities[own(k)]);
                pattern.multiply_add(v_z, 1.0, &self.rates[own(k)], &mut accelerations[own(k)]);
            }
        }
        let [_, _, _, v_y] = model.stage_jacobian(t, y, z);
        for k in 0..count {
            at.v_y
                .multiply_add(v_y, 1.0, of.y.row(k), &mut velocities[own(k)]);
        }
        let [_, _, v_tau] = sensitivity.stage(t, y, z);
        if let Some(pattern) = &by_tau.v_tau {
            for k in 0..count {
                let tau = self.directions.tau(k, of.t[k]);
                pattern.multiply_add(v_tau, 1.0, tau, &mut velocities[own(k)]);
            }
        }
        let slopes = sensitivity.velocity(t, [y, z, &self.solver.z_dot]);
        if let (Some(slopes), Some(patterns)) = (slopes, &by_tau.velocity) {
            for k in 0..count {
                let tau = self.directions.tau(k, of.t[k]);
                let along = [of.y.row(k), of.z.row(k), tau];
                for ((pattern, values), x) in patterns.iter().zip(slopes).zip(along) {
                    pattern.multiply_add(values, 1.0, x, &mut accelerations[own(k)]);
                }
            }
        }
    }

    /// Writes the tangents at time `t`, of polynomials in (t − start)/h through these knots.
    pub(super) fn move_to(
        &mut self,
        t: f64,
        (start, h): (f64, f64),
        (knots, polynomials): (&[Knot], [&Newton; 2]),
        of: &mut PointTangents,
    ) {
        if !std::mem::replace(&mut self.is_fitted, true) {
            self.fit((start, h), (knots, polynomials));
        }
        let (x, has_own_z) = ((t - start) / h, !knots[0].z[0].is_empty());
        for (k, (y, z)) in of.y.flat_mut().iter_mut().zip(of.z.flat_mut()).enumerate() {
            let (value, slope) = self.of_y.at(k, x);
            *y = value;
            *z = if has_own_z {
                self.of_z.at(k, x).0
            } else {
                slope / h
            };
        }
    }

    fn fit(&mut self, (start, h): (f64, f64), (knots, [of_y, of_z]): (&[Knot], [&Newton; 2])) {
        let mut count = 0;
        for knot in by_closeness(knots) {
            let Some(of) = &knot.tangents else { return };
            if count == self.moved.len() {
                self.moved.push(of.clone());
            }
            let (moved, n, x) = (
                &mut self.moved[count],
                knot.y[0].len(),
                (knot.t - start) / h,
            );
            moved.copy_from(of);
            for (direction, dt) in of.t.iter().enumerate() {
                let own = direction * n..(direction + 1) * n;
                for (level, moved) in moved.y.iter_mut().enumerate() {
                    let out = &mut moved[own.clone()];
                    if let Some(slope) = knot.y.get(level + 1) {
                        add_scaled(out, -dt, slope);
                        continue;
                    }
                    for (k, out) in out.iter_mut().enumerate() {
                        *out -= dt * of_y.derivative::<3>(k, x) / h.powi(3);
                    }
                }
                let [z, z_dot] = &mut moved.z;
                if !z.is_empty() {
                    add_scaled(&mut z[own.clone()], -dt, &knot.z[1]);
                    for (k, out) in z_dot[own].iter_mut().enumerate() {
                        *out -= dt * of_z.derivative::<2>(k, x) / h.powi(2);
                    }
                }
            }
            count += 1;
        }
        let places = by_closeness(knots).map(|knot| (knot.t - start) / h);
        let known = places.zip(&self.moved);
        (self.of_y).fit(h, &known.clone().map(|(x, moved)| (x, &moved.y)));
        if !knots[0].z[0].is_empty() {
            self.of_z.fit(h, &known.map(|(x, moved)| (x, &moved.z)));
        }
    }
}
