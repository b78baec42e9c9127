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
pub struct Tolerances<'a> {
    /// In units of the size of a constraint's terms.
    pub relative: f64,
    /// Coordinates that are all below this are zero but for roundoff, which is as large.
    pub floor: f64,
    /// The kind of each coordinate, those of one kind having one unit; empty where all are of one kind.
    pub kinds: &'a [usize],
}

/// A constraint may be missed by so many times what the roundings of its operations make of it.
const ROUNDINGS: f64 = 64.0;

impl Tolerances<'_> {
    /// How far each coordinate may be off, where the largest of its kind is that of `values`.
    fn of(&self, values: &[f64]) -> Vec<f64> {
        let kind = |j: usize| self.kinds.get(j).copied().unwrap_or(0);
        let mut largest = vec![0.0_f64; 1 + self.kinds.iter().max().copied().unwrap_or(0)];
        for (j, value) in values.iter().enumerate() {
            let largest = &mut largest[kind(j)];
            *largest = largest.max(value.abs());
        }
        let allowed = largest.iter().map(|size| {
            if *size <= self.floor {
                self.floor
            } else {
                self.relative * size
            }
        });
        let allowed: Vec<f64> = allowed.collect();
        (0..values.len()).map(|j| allowed[kind(j)]).collect()
    }
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
    /// Limits are sums of the sizes of a constraint's derivatives, times what coordinates or velocities may be off, and
    /// beyond that what the roundings of its operations make of it: scaled units change no verdict.
    pub fn violation(
        &mut self,
        t: f64,
        (y, z): (&[f64], &[f64]),
        tolerances: Tolerances<'_>,
        with_hidden: bool,
    ) -> Option<Violation> {
        let problem = self.problem.clone();
        let of_y = tolerances.of(y);
        let with_motion = |values: &[f64]| {
            let allowed = tolerances.of(values).into_iter().zip(&of_y);
            allowed.map(|(own, y)| own + SLOW * y).collect::<Vec<_>>()
        };
        if problem.m > 0 {
            let lam = vec![0.0; problem.m];
            let g_y = self.node_blocks(t, y, &lam)[0].to_vec();
            let limits = allowed(&problem.patterns.g_y, &g_y, &of_y);
            let g = self.node(t, y, &lam)[0].to_vec();
            let found = worst(Kind::Holonomic, &g, &limits, || {
                problem.node.roundings(&self.node.one, &[&[t], y, &lam])
            });
            if found.is_some() {
                return found;
            }
            if with_hidden {
                let [_, w, v] = self.end(t, y, z).map(<[f64]>::to_vec);
                let units = with_motion(if v.is_empty() { z } else { &v });
                let limits = allowed(&problem.patterns.g_y, &g_y, &units);
                let found = worst(Kind::Hidden, &w, &limits, || {
                    problem.end.roundings(&self.end, &[&[t], y, z])[problem.n..].to_vec()
                });
                if found.is_some() {
                    return found;
                }
            }
        }
        let own: &Nonholonomic = problem.nonholonomic.as_deref()?;
        let nu = vec![0.0; own.l];
        let [k_y, k_z, ..] = self.nonholonomic_blocks(t, y, z, &nu);
        let mut limits = allowed(&own.patterns.k_y, k_y, &of_y);
        let of_z = allowed(&own.patterns.k_z, k_z, &with_motion(z));
        limits.iter_mut().zip(of_z).for_each(|(y, z)| *y += z);
        let k = self.nonholonomic(t, y, z, &nu)[0].to_vec();
        worst(Kind::Nonholonomic, &k, &limits, || {
            let bound = self.nonholonomic.as_deref();
            bound.map_or_else(Vec::new, |bound| bound.roundings(own, &[&[t], y, z, &nu]))
        })
    }
}

/// Motions below this part of the length of constraints do not show their roundings, ...
pub(crate) const SMALL: f64 = 1.0 / 16.0;

/// ... and moving by that part may make the slopes of its constraint larger by this factor.
const STEEPER: f64 = 2.0;

impl Model {
    /// The length whose roundings change the holonomic constraints by as much as those of all their terms do; 0 near a
    /// position at which a gradient vanishes, where there is none.
    pub fn constraint_length(&mut self, t: f64, y: &[f64]) -> f64 {
        let slopes = self.slopes(t, y);
        let (problem, lam) = (&self.problem, vec![0.0; slopes.len()]);
        let roundings = problem.node.roundings(&self.node.one, &[&[t], y, &lam]);
        let lengths = slopes.iter().zip(roundings);
        let lengths = lengths.map(|(slope, rounding)| rounding / slope / f64::EPSILON);
        let finite = lengths.enumerate().filter(|(_, length)| length.is_finite());
        let Some((row, length)) = finite.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return 0.0;
        };
        let moved: Vec<f64> = y.iter().map(|y| y + SMALL * length).collect();
        if self.slopes(t, &moved)[row] <= STEEPER * slopes[row] {
            length
        } else {
            0.0
        }
    }

    /// Σ_k |G_ik| of each holonomic constraint.
    fn slopes(&mut self, t: f64, y: &[f64]) -> Vec<f64> {
        let lam = vec![0.0; self.problem.m];
        let g_y = self.node_blocks(t, y, &lam)[0].to_vec();
        allowed(&self.problem.patterns.g_y, &g_y, &vec![1.0; y.len()])
    }
}

/// A velocity may be off by this part of what coordinates may be, in a unit of time: it may be small beside them.
const SLOW: f64 = 1e-2;

/// The sums of the sizes of a derivative's entries, times what each coordinate may be off, row by row.
fn allowed(pattern: &Pattern, values: &[f64], units: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; pattern.shape().0];
    for ((row, col), value) in pattern.entries().iter().zip(values) {
        sums[*row] += value.abs() * units[*col];
    }
    sums
}

/// The value that is not finite, or else farthest beyond its limit; to limits that are exceeded roundings are added.
fn worst(
    kind: Kind,
    values: &[f64],
    limits: &[f64],
    roundings: impl FnOnce() -> Vec<f64>,
) -> Option<Violation> {
    let found = beyond(kind, values, limits)?;
    if !found.value.is_finite() || found.limit.is_nan() {
        return Some(found);
    }
    let more = roundings();
    let limits: Vec<f64> = (limits.iter().zip(more))
        .map(|(limit, rounding)| limit + ROUNDINGS * rounding)
        .collect();
    beyond(kind, values, &limits)
}

fn beyond(kind: Kind, values: &[f64], limits: &[f64]) -> Option<Violation> {
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
