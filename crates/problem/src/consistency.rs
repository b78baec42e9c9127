//! Constraints at the start of a run: a start may violate them by the roundoff of their terms.

use super::{Model, Nonholonomic};
use liouville_base::linalg::Pattern;

/// A kind of constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// g(t, y)
    Holonomic,
    /// w(t, y, z) = `g_t` + `g_y` v
    Hidden,
    /// k(t, y, z)
    Nonholonomic,
}

/// How far constraints may be missed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// In units of the size of a constraint's terms.
    pub relative: f64,
    /// Roundoff of coordinates that are zero, in their own unit.
    pub floor: f64,
}

/// A constraint that a state violates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// Its kind.
    pub kind: Kind,
    /// Its number among those of its kind.
    pub index: usize,
    /// Its value.
    pub value: f64,
    /// The largest value allowed.
    pub limit: f64,
}

impl Model {
    /// The first kind of constraint that a state violates, and of it the first value that is not finite or else the
    /// one farthest beyond its limit.
    ///
    /// Limits are sums of the sizes of a constraint's derivatives, times those of coordinates or velocities.
    pub fn violation(
        &mut self,
        t: f64,
        (y, z): (&[f64], &[f64]),
        tolerances: Tolerances,
        with_hidden: bool,
    ) -> Option<Violation> {
        let problem = self.problem.clone();
        let Tolerances { relative, floor } = tolerances;
        let length = largest(y);
        let mut limit = Vec::new();
        if problem.m > 0 {
            let lam = vec![0.0; problem.m];
            let slopes = slopes(&problem.patterns.g_y, self.node_blocks(t, y, &lam)[0]);
            limit.extend(slopes.iter().map(|x| x * (relative * length + floor)));
            let found = worst(Kind::Holonomic, self.node(t, y, &lam)[0], &limit);
            if found.is_some() {
                return found;
            }
            if with_hidden {
                let [_, w, v] = self.end(t, y, z);
                let speed = largest(if v.is_empty() { z } else { v });
                let unit = relative * (speed + 1e-2 * length) + floor;
                limit.clear();
                limit.extend(slopes.iter().map(|x| x * unit));
                let found = worst(Kind::Hidden, w, &limit);
                if found.is_some() {
                    return found;
                }
            }
        }
        let own: &Nonholonomic = problem.nonholonomic.as_deref()?;
        let nu = vec![0.0; own.l];
        let [k_y, k_z, ..] = self.nonholonomic_blocks(t, y, z, &nu);
        let of_y = slopes(&own.patterns.k_y, k_y);
        let of_z = slopes(&own.patterns.k_z, k_z);
        let units = [
            relative * length + floor,
            relative * (largest(z) + 1e-2 * length) + floor,
        ];
        limit.clear();
        limit.extend((of_y.iter().zip(&of_z)).map(|(y, z)| y * units[0] + z * units[1]));
        worst(
            Kind::Nonholonomic,
            self.nonholonomic(t, y, z, &nu)[0],
            &limit,
        )
    }
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |size, x| size.max(x.abs()))
}

/// The sum of the sizes of a derivative's entries, row by row.
fn slopes(pattern: &Pattern, values: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; pattern.shape().0];
    for ((row, _), value) in pattern.entries().iter().zip(values) {
        sums[*row] += value.abs();
    }
    sums
}

fn worst(kind: Kind, values: &[f64], limits: &[f64]) -> Option<Violation> {
    let at = |index: usize| Violation {
        kind,
        index,
        value: values[index],
        limit: limits[index],
    };
    if let Some(index) = values.iter().position(|x| !x.is_finite()) {
        return Some(at(index));
    }
    let over = values.iter().zip(limits).map(|(x, limit)| x.abs() - limit);
    let mut worst: Option<(usize, f64)> = None;
    for (index, over) in over.enumerate() {
        // a limit that is no number allows nothing
        if over.is_nan() {
            return Some(at(index));
        }
        if over > 0.0 && worst.is_none_or(|(_, most)| over > most) {
            worst = Some((index, over));
        }
    }
    worst.map(|(index, _)| at(index))
}
