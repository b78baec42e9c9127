//! H(t) on a window as a polynomial in time: weights of groups of terms, and a potential.
//!
//! Functions of time are interpolated at Chebyshev's nodes, the ends among them, and their series are cut where the rest
//! is below a tolerance: nothing but their values is needed.

use super::looks::LookPoints;
use super::polynomials::{DEGREE, NODES, chebyshev_node, coefficients, powers, settle};
use super::scan::{BESIDE, Scan};
use crate::method::term_bounds::{Interval, TermBounds};
use crate::problem::{
    DensityRegisters, Drive, Hamiltonian, Nonlinearity, Potential, PotentialRegisters,
};
use liouville_base::cancel;
use liouville_base::error::StepError;
use liouville_base::tape::Registers;
use std::sync::Arc;

/// Times that are looked at between two polls for cancellation.
const POLL: usize = 64;

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
    density: Option<DensityRegisters>,
    /// The potential at all points, and at some of them, and which these are.
    pub(super) potentials: [Option<(Potential, PotentialRegisters)>; 2],
    pub(super) looked: Vec<usize>,
    weights: Vec<f64>,
    /// Values at the nodes, then coefficients of Chebyshev's polynomials.
    pub(super) samples: Vec<f64>,
    pub(super) series: Vec<f64>,
    /// The length of a row of them.
    width: usize,
}

fn bound(potential: Potential) -> (Potential, PotentialRegisters) {
    let registers = potential.bind();
    (potential, registers)
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
    ///
    /// # Errors
    /// It was interrupted.
    pub(in crate::method) fn new(
        hamiltonian: Arc<Hamiltonian>,
        bounds: TermBounds,
    ) -> Option<Result<Self, StepError>> {
        if !bounds.is_fitting(hamiltonian.terms().len()) {
            return None;
        }
        let mut next = 0;
        let mut first = |count: &usize| {
            next += count;
            next - count
        };
        let potential = hamiltonian.potential();
        let looked = match LookPoints::of(&hamiltonian, bounds.span) {
            Ok(looked) => looked,
            Err(error) => return Some(Err(error)),
        };
        let found = Self {
            firsts: bounds.groups.iter().map(&mut first).collect(),
            drive: hamiltonian.drive().map(Drive::bind),
            density: hamiltonian.nonlinearity().map(Nonlinearity::bind),
            potentials: [potential.cloned().map(bound), None],
            looked: Vec::new(),
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
        };
        Some(Ok(found.looking_at(looked)))
    }

    /// The same looking at these points of the potential, and at those before, if it has one.
    fn looking_at(mut self, points: Vec<usize>) -> Self {
        self.look_at(points);
        self
    }

    /// Looks at these points of the potential, too.
    pub(super) fn look_at(&mut self, points: Vec<usize>) {
        self.looked.extend(points);
        let all = self.hamiltonian.potential();
        self.potentials[1] = all.map(|potential| bound(potential.at_points(&self.looked)));
    }

    /// Whether some points of the potential are not looked at.
    pub(super) fn is_thinned(&self) -> bool {
        let [all, some] = (self.potentials.each_ref())
            .map(|each| each.as_ref().map_or(0, |(potential, _)| potential.size()));
        some < all
    }

    /// The same for parts that are differences from the first, or not.
    pub(super) fn with_differences(self, by_differences: bool) -> Self {
        Self {
            by_differences,
            ..self
        }
    }

    /// The same for an H that may jump at some times, in the order of the run.
    pub(in crate::method) fn with_breaks(mut self, breaks: &[f64]) -> Self {
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
        let is_driven = self.drive.is_some()
            || self.potentials[1].is_some()
            || !self.bounds.densities.is_empty();
        if !is_driven || start.to_bits() == end.to_bits() {
            return Ok(self);
        }
        let scan = Some(self.hamiltonian.scan().get(
            |scan: &Scan| scan.is_of(&self.bounds),
            || Scan::new(&self.bounds, |times| self.clone().rows(times)),
            Scan::is_small,
        )?);
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
            let weights = self.hamiltonian.drive().map(|drive| drive.at(times));
            let width = self.weights.len();
            for (k, t) in times.iter().enumerate() {
                match &weights {
                    Some(rows) => self.weights.copy_from_slice(&rows[k * width..][..width]),
                    None => self.weights.fill(1.0),
                }
                self.add_row(*t);
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
        let series = &self.series[..terms * self.width];
        let is_fine = |apart: &[f64]| self.bounds.size(apart) <= tolerance;
        let is_missed = scan.is_missed((t, h), (series, self.width), &mut apart, is_fine);
        self.apart = apart;
        is_missed
    }

    /// Ends of parts of an interval; see [`Scan::strata`].
    pub(in crate::method) fn strata(&self, interval: (f64, f64), count: usize) -> Vec<f64> {
        match &self.scan {
            Some(scan) => scan.strata(interval, count),
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

    /// Adds a row of values at t: weights of the groups, then the potential at some points and that of some densities.
    fn sample(&mut self, t: f64) {
        self.weights.fill(1.0);
        if let (Some(drive), Some(registers)) = (self.hamiltonian.drive(), &mut self.drive) {
            self.weights.fill(0.0);
            drive.add(registers, 1.0, t, &mut self.weights);
        }
        self.add_row(t);
    }

    /// Adds a row of values at t, with these weights.
    fn add_row(&mut self, t: f64) {
        let weights = &self.weights;
        let of_groups = self.firsts.iter().map(|first| weights[*first]);
        self.samples.extend(of_groups);
        if let Some((potential, registers)) = &mut self.potentials[1] {
            let start = self.samples.len();
            self.samples.resize(start + potential.size(), 0.0);
            potential.add(registers, (1.0, t), 0, &mut self.samples[start..]);
        }
        if let (Some(nonlinearity), Some(registers)) =
            (self.hamiltonian.nonlinearity(), &mut self.density)
        {
            let densities = &self.bounds.densities;
            nonlinearity.values(registers, t, densities, &mut self.samples);
        }
    }

    /// Interval of H at the start of a window.
    pub(super) fn bounds_at(&mut self, window: (f64, f64)) -> Interval {
        self.samples.clear();
        self.sample(self.within(window, 0.0));
        self.bounds.at(&self.samples)
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

    /// Looks at a window: none where no degree leaves less than `tolerance`, in energies.
    pub(super) fn look(&mut self, t: f64, h: f64, tolerance: f64) -> Option<Look> {
        let first = self.bounds_at((t, h));
        let width = self.interpolate((t, h), NODES);
        let rows = self.samples.chunks(width).map(|row| self.bounds.at(row));
        let hull = |a: Interval, b: Interval| (a.0.min(b.0), a.1.max(b.1));
        let (low, high) = rows.fold(first, hull);
        let rows = self.samples.chunks(width).map(|row| {
            let (weights, potential) = row.split_at(self.groups());
            self.bounds.of_parts(weights, potential)
        });
        let wider = rows.reduce(hull)?;
        let largest = (self.samples.chunks(width))
            .fold(0.0, |most: f64, row| most.max(self.bounds.size(row)));
        let rests: Vec<f64> = self
            .series
            .chunks(width)
            .map(|row| self.bounds.size(row))
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
        let sizes = fit.chunks(width).skip(1).map(|row| self.bounds.size(row));
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
}
