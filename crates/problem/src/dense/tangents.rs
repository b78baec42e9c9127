//! Tangents of a trajectory between steps, at times that are held.
//!
//! A polynomial P with P⁽ˡ⁾(t_k) = Y_k⁽ˡ⁾ changes with its knots, times and values, by the polynomial of the same degree with
//!
//!     dP⁽ˡ⁾(t_k) = dY_k⁽ˡ⁾ − P⁽ˡ⁺¹⁾(t_k) dt_k,
//!
//! as the derivative of that equation says.

use super::super::hermite::Newton;
use super::super::{Directions, RateTangents, TangentView, model::finite};
use super::by_closeness;
use super::knot::{Knot, KnotTangents, PointTangents};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, add_scaled, copy};

/// The tangents of knots, and the polynomials through them.
#[derive(Debug)]
pub struct PathTangents {
    point: Box<dyn RateTangents>,
    sizes: [usize; 2],
    directions: Directions,
    /// Tangents of z', in one direction after another.
    rates: Vec<f64>,
    /// The values of the polynomials at each knot.
    moved: Vec<KnotTangents>,
    of_y: Newton,
    of_z: Newton,
    is_fitted: bool,
}

impl PathTangents {
    /// Tangents in these directions of paths with so many numbers of y and z.
    pub fn new(point: Box<dyn RateTangents>, sizes: [usize; 2], directions: Directions) -> Self {
        Self {
            rates: vec![0.0; directions.count() * sizes[1]],
            point,
            sizes,
            directions,
            moved: Vec::new(),
            of_y: Newton::default(),
            of_z: Newton::default(),
            is_fitted: false,
        }
    }

    /// Memory of a knot.
    pub(super) fn knot(&self, has_own_z: bool) -> KnotTangents {
        let count = self.directions.count();
        let [n, l] = self.sizes;
        let zeros = || vec![0.0; count * n];
        let z = || vec![0.0; if has_own_z { count * l } else { 0 }];
        KnotTangents {
            y: [zeros(), zeros(), zeros()],
            z: [z(), z()],
            t: vec![0.0; count],
        }
    }

    /// Memory of a point.
    pub(super) fn point(&self) -> PointTangents {
        let count = self.directions.count();
        let [y, z] = self.sizes.map(|size| Matrix::zeros(count, size));
        let t = vec![0.0; count];
        PointTangents { y, z, t }
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
        // a state may have a row more, of a direction that is not recorded
        let count = out.t.len();
        copy(&mut out.t, &of.t[..count]);
        let [values, velocities, accelerations] = &mut out.y;
        let all = values.len();
        copy(values, &of.y.flat()[..all]);
        let along = (of, &mut self.directions);
        let rates = [
            &mut velocities[..],
            &mut accelerations[..],
            &mut self.rates[..],
        ];
        self.point.rates((t, y, z), along, rates)?;
        if let [z, z_dot] = &mut out.z
            && !z.is_empty()
        {
            copy(z, &of.z.flat()[..self.rates.len()]);
            copy(z_dot, &self.rates);
        }
        finite(velocities, Quantity::Derivative, t)?;
        finite(accelerations, Quantity::Derivative, t)
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
        for (k, y) in of.y.flat_mut().iter_mut().enumerate() {
            let (value, slope) = self.of_y.at(k, x);
            *y = value;
            if !has_own_z {
                of.z.flat_mut()[k] = slope / h;
            }
        }
        if has_own_z {
            for (k, z) in of.z.flat_mut().iter_mut().enumerate() {
                *z = self.of_z.at(k, x).0;
            }
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
                    let l = self.sizes[1];
                    let own = direction * l..(direction + 1) * l;
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
