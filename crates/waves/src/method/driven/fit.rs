//! H(t) on a window as a polynomial in time: weights of groups of terms, and a potential.
//!
//! Functions of time are interpolated at Chebyshev's nodes, the ends among them, and their series are cut where the rest
//! is below a tolerance: nothing but their values is needed.

use super::choice::TwoLevels;
use super::polynomials::{DEGREE, NODES, chebyshev_node, coefficients, powers, settle};
use super::scan::Scan;
use crate::method::term_bounds::{Interval, TermBounds, range};
use crate::problem::{Drive, Hamiltonian, Potential};
use liouville_base::cancel;
use liouville_base::error::StepError;
use liouville_base::real::Lanes;
use liouville_base::tape::Registers;
use std::sync::Arc;

/// Points at which a potential is looked at before it is fitted at all of them.
const LOOKS: usize = 8;

/// Times that are looked at between two polls for cancellation.
const POLL: usize = 64;

/// A window that ends at a break takes H so many roundings of the time within it, where a jump is on its other side.
pub(super) const BESIDE: f64 = 8.0 * f64::EPSILON;

/// Rounding errors of a fit, relative to what is fitted.
const ROUNDING: f64 = 1e-14;

/// The part of a Hamiltonian that depends on time, and how large it is.
#[derive(Clone)]
pub(in crate::method) struct Sampler {
    hamiltonian: Arc<Hamiltonian>,
    /// The first term of each group: terms of a group have their weight in common.
    firsts: Vec<usize>,
    bounds: TermBounds,
    /// Times at which H may jump, from the first to the last.
    breaks: Vec<f64>,
    pub(super) by_differences: bool,
    /// Values at many times of the run, and memory for what a series misses of them.
    scan: Option<Arc<Scan>>,
    apart: Vec<f64>,
    drive: Option<Registers<f64>>,
    /// The potential at all points, and at some of them.
    pub(super) potentials: [Option<(Potential, Registers<Lanes>)>; 2],
    weights: Vec<f64>,
    /// Values at the nodes, then coefficients of Chebyshev's polynomials.
    pub(super) samples: Vec<f64>,
    pub(super) series: Vec<f64>,
    /// The length of a row of them.
    width: usize,
}

/// A window as it was looked at: the degree that it takes, and sizes.
#[derive(Clone, Debug, Default)]
pub(super) struct Look {
    pub(super) degree: usize,
    /// The largest remainder, in energies.
    pub(super) left_out: f64,
    /// Of H, over the window.
    pub(super) bounds: Interval,
    /// Of H, at its start.
    pub(super) first: Interval,
    /// The norm of the part of each power from the first on, in energies.
    pub(super) sizes: Vec<f64>,
    /// The same by the bounds of its parts alone.
    pub(super) wider: Interval,
    /// Coefficients of each power at the points that are looked at.
    pub(super) fit: Vec<f64>,
}

impl Sampler {
    /// For terms in groups, with bounds of the eigenvalues of each; none where these do not fit.
    pub(in crate::method) fn new(
        hamiltonian: Arc<Hamiltonian>,
        bounds: TermBounds,
    ) -> Option<Self> {
        if !bounds.is_fitting(hamiltonian.terms().len()) {
            return None;
        }
        let mut next = 0;
        let mut first = |count: &usize| {
            next += count;
            next - count
        };
        let bound = |potential: Potential| {
            let registers = potential.bind();
            (potential, registers)
        };
        let potential = hamiltonian.potential();
        Some(Self {
            firsts: bounds.groups.iter().map(&mut first).collect(),
            drive: hamiltonian.drive().map(Drive::bind),
            potentials: [
                potential.cloned().map(bound),
                potential.map(|potential| bound(potential.thinned(LOOKS))),
            ],
            weights: vec![0.0; hamiltonian.terms().len()],
            samples: Vec::new(),
            series: Vec::new(),
            width: 0,
            by_differences: false,
            breaks: Vec::new(),
            scan: None,
            apart: Vec::new(),
            bounds,
            hamiltonian,
        })
    }

    /// The same for parts that are differences from the first, or not.
    pub(super) fn with_differences(self, by_differences: bool) -> Self {
        Self {
            by_differences,
            ..self
        }
    }

    /// The same for an H that may jump at some times, in the order of the run.
    pub(super) fn with_breaks(mut self, breaks: &[f64]) -> Self {
        self.set_breaks(breaks);
        self
    }

    /// Sets the times at which H may jump, in the order of the run.
    pub(in crate::method) fn set_breaks(&mut self, breaks: &[f64]) {
        self.breaks = breaks.to_vec();
        self.breaks.sort_by(f64::total_cmp);
    }

    /// The time at a part of a window, on its side of breaks at its ends.
    pub(in crate::method) fn within(&self, (t, h): (f64, f64), part: f64) -> f64 {
        let end = t + h;
        let near = (BESIDE * t.abs().max(end.abs())).min(0.25 * h.abs());
        let at = t + h * part;
        let beside = |edge: f64| (at - edge).abs() < near && self.is_break(edge, near);
        if beside(t) {
            t + near.copysign(h)
        } else if beside(end) {
            end - near.copysign(h)
        } else {
            at
        }
    }

    /// Whether a break is as near as that.
    fn is_break(&self, t: f64, near: f64) -> bool {
        let place = self.breaks.partition_point(|time| *time <= t - near);
        self.breaks.get(place).is_some_and(|time| *time < t + near)
    }

    /// The same with all functions of time looked at over the run, where there are any.
    ///
    /// # Errors
    /// It was interrupted.
    pub(in crate::method) fn with_scan(self) -> Result<Self, StepError> {
        let (start, end) = self.bounds.span;
        if self.drive.is_none() && self.potentials[1].is_none() || start.to_bits() == end.to_bits()
        {
            return Ok(self);
        }
        let scan = Some(Scan::of(&self)?);
        Ok(Self { scan, ..self })
    }

    /// Bounds of the parts.
    pub(super) fn bounds(&self) -> &TermBounds {
        &self.bounds
    }

    /// Returns the Hamiltonian that is fitted.
    pub(super) fn hamiltonian(&self) -> &Arc<Hamiltonian> {
        &self.hamiltonian
    }

    /// Rows of values at times: weights of the groups, then the potential at some points.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn rows(&mut self, times: &[f64]) -> Result<Vec<f64>, StepError> {
        self.samples.clear();
        for times in times.chunks(POLL) {
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            for t in times {
                self.sample(*t);
            }
        }
        Ok(std::mem::take(&mut self.samples))
    }

    /// Whether so many terms of the polynomials by Chebyshev's nodes of an interval are off by more than `tolerance`, in
    /// energies, at any time that was looked at.
    pub(in crate::method) fn passes_over(
        &mut self,
        (t, h): (f64, f64),
        (nodes, terms): (usize, usize),
        tolerance: f64,
    ) -> bool {
        let Some(scan) = self.scan.clone().filter(|scan| !scan.is_empty((t, h))) else {
            return false;
        };
        self.interpolate((t, h), nodes);
        let mut apart = std::mem::take(&mut self.apart);
        apart.resize(self.width, 0.0);
        let series = &self.series[..terms * self.width];
        let is_fine = |apart: &[f64]| self.size(apart) <= tolerance;
        let is_missed = scan.is_missed((t, h), series, &mut apart, is_fine);
        self.apart = apart;
        is_missed
    }

    /// Ends of parts of an interval; see [`Scan::strata`].
    pub(in crate::method) fn strata(&self, interval: (f64, f64), count: usize) -> Vec<f64> {
        match &self.scan {
            Some(scan) => scan.strata(self, interval, count),
            None => vec![interval.0, interval.1],
        }
    }

    /// The length to the next knot, at which a spline bends, before the end.
    pub(super) fn to_knot(&self, t: f64, left: f64) -> Option<f64> {
        let knots = &self.bounds.knots;
        let next = if left > 0.0 {
            knots.get(knots.partition_point(|knot| *knot <= t))
        } else {
            knots[..knots.partition_point(|knot| *knot < t)].last()
        };
        let h = next? - t;
        (h.abs() < left.abs()).then_some(h)
    }

    /// Number of groups.
    pub(super) fn groups(&self) -> usize {
        self.firsts.len()
    }

    /// Adds a row of values at t: weights of the groups, then the potential at some points.
    fn sample(&mut self, t: f64) {
        self.weights.fill(1.0);
        if let (Some(drive), Some(registers)) = (self.hamiltonian.drive(), &mut self.drive) {
            self.weights.fill(0.0);
            drive.add(registers, 1.0, t, &mut self.weights);
        }
        let weights = &self.weights;
        let of_groups = self.firsts.iter().map(|first| weights[*first]);
        self.samples.extend(of_groups);
        if let Some((potential, registers)) = &mut self.potentials[1] {
            let start = self.samples.len();
            self.samples.resize(start + potential.size(), 0.0);
            potential.add(registers, (1.0, t), 0, &mut self.samples[start..]);
        }
    }

    /// Interval of H with such weights and potential, by those of its parts.
    pub(super) fn added(&self, row: &[f64]) -> Interval {
        let (weights, potential) = row.split_at(self.groups());
        self.bounds.at(weights, potential)
    }

    /// Interval of H at the start of a window.
    pub(super) fn bounds_at(&mut self, window: (f64, f64)) -> Interval {
        self.samples.clear();
        self.sample(self.within(window, 0.0));
        self.added(&self.samples)
    }

    /// Chebyshev's coefficients of all rows on a window, and the length of a row.
    pub(super) fn interpolate(&mut self, (t, h): (f64, f64), count: usize) -> usize {
        self.samples.clear();
        for node in 0..count {
            self.sample(self.within((t, h), chebyshev_node(node, count)));
        }
        self.width = self.samples.len() / count;
        coefficients(&self.samples, self.width, &mut self.series);
        for group in 0..self.groups() {
            settle(group, &self.samples, self.width, &mut self.series);
        }
        self.width
    }

    /// The norm of a row of coefficients, in energies.
    pub(super) fn size(&self, row: &[f64]) -> f64 {
        let of_groups = row.iter().zip(&self.bounds.parts);
        let sum: f64 = of_groups
            .map(|(weight, (low, high))| weight.abs() * low.abs().max(high.abs()))
            .sum();
        let potential = row[self.groups()..].iter();
        sum + potential.fold(0.0, |most: f64, v| most.max(v.abs()))
    }

    /// Looks at a window: none where no degree leaves less than `tolerance`, in energies.
    pub(super) fn look(&mut self, t: f64, h: f64, tolerance: f64) -> Option<Look> {
        let first = self.bounds_at((t, h));
        let width = self.interpolate((t, h), NODES);
        let rows = self.samples.chunks(width).map(|row| self.added(row));
        let hull = |a: Interval, b: Interval| (a.0.min(b.0), a.1.max(b.1));
        let (low, high) = rows.fold(first, hull);
        let rows = self.samples.chunks(width).map(|row| {
            let (weights, potential) = row.split_at(self.groups());
            self.bounds.of_parts(weights, potential)
        });
        let wider = rows.reduce(hull)?;
        let largest =
            (self.samples.chunks(width)).fold(0.0, |most: f64, row| most.max(self.size(row)));
        let rests: Vec<f64> = self
            .series
            .chunks(width)
            .map(|row| self.size(row))
            .collect();
        // a time is known to its rounding, and functions to their slopes times that
        let slopes = rests
            .iter()
            .enumerate()
            .map(|(j, size)| 2.0 * j as f64 * size);
        let rounded = f64::EPSILON * t.abs().max((t + h).abs()) / h.abs();
        let tolerance = tolerance.max(ROUNDING * largest + rounded * slopes.sum::<f64>());
        let mut rest = 0.0;
        let mut degree = NODES;
        while degree > 0 && rest <= tolerance {
            degree -= 1;
            rest += rests[degree];
        }
        // not a number is no tail below the tolerance
        if degree > DEGREE || !rest.is_finite() || !(low.is_finite() && high.is_finite()) {
            return None;
        }
        let degree = if rest <= tolerance { 0 } else { degree };
        let fit = powers(&self.series, degree, width);
        let sizes = fit.chunks(width).skip(1).map(|row| self.size(row));
        let sizes = sizes.collect();
        Some(Look {
            degree,
            left_out: tolerance,
            bounds: (low, high),
            first,
            sizes,
            wider,
            fit,
        })
    }

    /// How levels might change with time: energies by the ends of the first group with those of the others, where the
    /// potential changes most, and a pair of levels at the ends of the spectrum that all changes couple.
    pub(super) fn levels(&self, fit: &[f64], (low, high): Interval) -> Vec<TwoLevels> {
        let (groups, middle) = (self.groups(), f64::midpoint(low, high));
        let row_width = self.samples.len() / NODES;
        let width = 0.5 * (high - low);
        let changes = |place: usize| -> f64 {
            let rows = fit.chunks(row_width).skip(1);
            rows.map(|row| row[place].abs()).sum()
        };
        let most = (groups..row_width).max_by(|a, b| changes(*a).total_cmp(&changes(*b)));
        let end = |(low, high): Interval, is_high: bool| if is_high { high } else { low };
        let mut found = Vec::new();
        for is_high in [true, false] {
            for others in [true, false] {
                let of_power = |(l, row): (usize, &[f64])| {
                    let parts = row.iter().zip(&self.bounds.parts).enumerate();
                    let sum: f64 = parts
                        .map(|(k, (weight, bounds))| {
                            weight * end(*bounds, if k == 0 { is_high } else { others })
                        })
                        .sum();
                    let potential = most.map_or(0.0, |place| row[place]);
                    match l {
                        // closer bounds than those of the parts are those of H at the start, too
                        0 => (sum + potential - middle).clamp(-width, width),
                        _ => sum + potential,
                    }
                };
                let diagonal: Vec<f64> = fit.chunks(row_width).enumerate().map(of_power).collect();
                found.push(TwoLevels {
                    beside: vec![0.0; diagonal.len()],
                    diagonal,
                    start: [1.0, 0.0, 0.0, 0.0],
                });
            }
        }
        let changing = fit.chunks(row_width).skip(1).map(|row| {
            let parts = row.iter().zip(&self.bounds.parts);
            let sum: f64 = parts.map(|(w, (low, high))| w * 0.5 * (high - low)).sum();
            let (least, largest) = range(&row[groups..]);
            sum + 0.5 * (largest - least)
        });
        let beside: Vec<f64> = std::iter::once(0.0).chain(changing).collect();
        let mut diagonal = vec![0.0; beside.len()];
        diagonal[0] = width;
        for start in [[1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.8]] {
            found.push(TwoLevels {
                diagonal: diagonal.clone(),
                beside: beside.clone(),
                start,
            });
        }
        found
    }
}
