//! Cotangents of a trajectory between steps, taken to the knots of its polynomials: the transpose of their tangents.

use super::super::hermite::Newton;
use super::super::{Carried, Dynamics};
use super::{Path, by_closeness};
use liouville_base::linalg::{add_scaled, dot};

/// Derivatives of a function of a run by the values at a knot: y, y' and y'', z and z' where they are interpolated by
/// themselves, and its time.
#[derive(Clone, Debug, Default)]
pub struct KnotCotangents {
    /// By y, y' and y''.
    pub y: [Vec<f64>; 3],
    /// By z and z'.
    pub z: [Vec<f64>; 2],
    /// By its time.
    pub t: f64,
}

impl KnotCotangents {
    /// Adds others.
    pub fn add(&mut self, other: &Self) {
        let own = self.y.iter_mut().chain(&mut self.z);
        for (own, other) in own.zip(other.y.iter().chain(&other.z)) {
            own.resize(other.len(), 0.0);
            add_scaled(own, 1.0, other);
        }
        self.t += other.t;
    }
}

/// The polynomials of a path, and those through ones and zeros, whose values are the weights of the values at knots.
#[derive(Clone, Debug, Default)]
pub struct PathAdjoint {
    of_y: Newton,
    of_z: Newton,
    weights_y: Newton,
    weights_z: Newton,
}

impl PathAdjoint {
    /// Takes cotangents of y and z where a path has gone to, its time held, to its knots: the last one first.
    pub fn pull<M: Dynamics>(
        &mut self,
        path: &Path<M>,
        (of_y, of_z): (&[f64], &[f64]),
    ) -> Vec<KnotCotangents> {
        let ((start, h), n) = (path.last_step(), path.y().len());
        let knots = by_closeness(&path.knots);
        let places = knots.clone().map(|knot| (knot.t - start) / h);
        let (at, count) = ((path.t - start) / h, path.knots.len());
        let own_z = path.has_own_z;
        (self.of_y).fit(h, &places.clone().zip(knots.clone().map(|knot| &knot.y)));
        (self.weights_y).fit(h, &places.clone().zip(&units::<3>(count)));
        if own_z {
            (self.of_z).fit(h, &places.clone().zip(knots.clone().map(|knot| &knot.z)));
            (self.weights_z).fit(h, &places.clone().zip(&units::<2>(count)));
        }
        let mut found = vec![KnotCotangents::default(); count];
        for (place, (knot, x)) in knots.zip(places).enumerate() {
            let own = &mut found[backs(count, place)];
            for (level, out) in own.y.iter_mut().enumerate() {
                let (weight, slope) = self.weights_y.at(3 * place + level, at);
                out.resize(n, 0.0);
                add_scaled(out, weight, of_y);
                if !own_z {
                    add_scaled(out, slope / h, of_z);
                }
                own.t -= match knot.y.get(level + 1) {
                    Some(slope) => dot(out, slope),
                    None => along::<3>(&self.of_y, x, h, out),
                };
            }
            for (level, out) in own.z.iter_mut().enumerate().filter(|_| own_z) {
                let weight = self.weights_z.at(2 * place + level, at).0;
                out.resize(of_z.len(), 0.0);
                add_scaled(out, weight, of_z);
                own.t -= match knot.z.get(level + 1) {
                    Some(slope) => dot(out, slope),
                    None => along::<2>(&self.of_z, x, h, out),
                };
            }
        }
        found
    }
}

/// How many knots before the last one is the knot in this place of their order by closeness.
fn backs(count: usize, place: usize) -> usize {
    match place {
        0 if count > 1 => 1,
        0 | 1 => 0,
        _ => place,
    }
}

/// The derivative of order `D` by time, along a vector.
fn along<const D: usize>(of: &Newton, x: f64, h: f64, vector: &[f64]) -> f64 {
    let derivatives = (0..vector.len()).map(|k| of.derivative::<D>(k, x));
    let sum: f64 = derivatives.zip(vector).map(|(d, x)| d * x).sum();
    (0..D).fold(sum, |found, _| found / h)
}

/// Unit values: one at each knot in turn, and zero at the others.
fn units<const K: usize>(count: usize) -> Vec<[Vec<f64>; K]> {
    let unit = |own: usize| {
        let mut values = vec![0.0; count * K];
        values[own] = 1.0;
        values
    };
    let knots = 0..count;
    knots
        .map(|knot| std::array::from_fn(|level| unit(knot * K + level)))
        .collect()
}
