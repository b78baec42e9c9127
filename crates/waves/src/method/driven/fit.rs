//! H(t) on a window as a polynomial in time: weights of groups of terms, and a potential.
//!
//! Functions of time are interpolated at Chebyshev's nodes, the ends among them, and their series are cut where the rest
//! is below a tolerance: nothing but their values is needed.

use super::polynomials::{DEGREE, NODES, coefficients, node_at, powers};
use crate::method::term_bounds::{Interval, TermBounds, range};
use crate::problem::{Drive, Hamiltonian, Potential};
use liouville_base::real::Lanes;
use liouville_base::tape::Registers;
use std::sync::Arc;

/// Points at which a potential is looked at before it is fitted at all of them.
const LOOKS: usize = 8;

/// Rounding errors of a fit, relative to what is fitted.
const ROUNDING: f64 = 1e-14;

/// The polynomials of a window in y = s/h: coefficients of each power, one power after another.
#[derive(Clone, Debug, Default)]
pub(in crate::method) struct Fit {
    pub(in crate::method) degree: usize,
    /// Of each group.
    pub(in crate::method) weights: Vec<f64>,
    /// At each point, empty without a potential.
    pub(in crate::method) potential: Vec<f64>,
}

/// The part of a Hamiltonian that depends on time, and how large it is.
#[derive(Clone)]
pub(super) struct Sampler {
    hamiltonian: Arc<Hamiltonian>,
    /// The first term of each group: terms of a group have their weight in common.
    firsts: Vec<usize>,
    bounds: TermBounds,
    by_differences: bool,
    drive: Option<Registers<f64>>,
    /// The potential at all points, and at some of them.
    potentials: [Option<(Potential, Registers<Lanes>)>; 2],
    weights: Vec<f64>,
    /// Values at the nodes, then coefficients of Chebyshev's polynomials.
    samples: Vec<f64>,
    series: Vec<f64>,
}

/// A window as it was looked at: the degree that it takes, and sizes.
#[derive(Clone, Debug, Default)]
pub(super) struct Look {
    pub(super) degree: usize,
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

/// A Hamiltonian of two levels, of polynomials of time: ± those of the diagonal, and what is beside it.
#[derive(Clone, Debug, Default)]
pub(super) struct TwoLevels {
    pub(super) diagonal: Vec<f64>,
    pub(super) beside: Vec<f64>,
    /// Real and imaginary part of each level.
    pub(super) start: [f64; 4],
}

impl TwoLevels {
    /// `out += factor * H_l x`
    pub(super) fn add_product(&self, l: usize, factor: f64, x: &[f64; 4], out: &mut [f64; 4]) {
        let (a, b) = (factor * self.diagonal[l], factor * self.beside[l]);
        for part in 0..2 {
            out[part] += a * x[part] + b * x[part + 2];
            out[part + 2] += b * x[part] - a * x[part + 2];
        }
    }
}

impl Sampler {
    /// For terms in groups, with bounds of the eigenvalues of each; none where these do not fit.
    pub(super) fn new(hamiltonian: Arc<Hamiltonian>, bounds: TermBounds) -> Option<Self> {
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
            by_differences: false,
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

    /// Number of groups.
    pub(super) fn groups(&self) -> usize {
        self.firsts.len()
    }

    /// Adds a row of values at t: weights of the groups, then the potential at all points or at some.
    fn sample(&mut self, t: f64, is_look: bool) {
        self.weights.fill(1.0);
        if let (Some(drive), Some(registers)) = (self.hamiltonian.drive(), &mut self.drive) {
            self.weights.fill(0.0);
            drive.add(registers, 1.0, t, &mut self.weights);
        }
        let weights = &self.weights;
        let of_groups = self.firsts.iter().map(|first| weights[*first]);
        self.samples.extend(of_groups);
        if let Some((potential, registers)) = &mut self.potentials[usize::from(is_look)] {
            let start = self.samples.len();
            self.samples.resize(start + potential.size(), 0.0);
            potential.add(registers, 1.0, t, &mut self.samples[start..]);
        }
    }

    /// Interval of H with such weights and potential, by those of its parts.
    fn added(&self, row: &[f64]) -> Interval {
        let (weights, potential) = row.split_at(self.groups());
        self.bounds.at(weights, potential)
    }

    /// Interval of H at t.
    pub(super) fn bounds_at(&mut self, t: f64) -> Interval {
        self.samples.clear();
        self.sample(t, true);
        self.added(&self.samples)
    }

    /// Chebyshev's coefficients of all rows on a window, and the length of a row.
    fn interpolate(&mut self, t: f64, h: f64, is_look: bool) -> usize {
        self.samples.clear();
        for node in 0..NODES {
            self.sample(t + h * node_at(node), is_look);
        }
        let width = self.samples.len() / NODES;
        coefficients(&self.samples, width, &mut self.series);
        width
    }

    /// The norm of a row of coefficients, in energies.
    fn size(&self, row: &[f64]) -> f64 {
        let of_groups = row.iter().zip(&self.bounds.parts);
        let sum: f64 = of_groups
            .map(|(weight, (low, high))| weight.abs() * low.abs().max(high.abs()))
            .sum();
        let potential = row[self.groups()..].iter();
        sum + potential.fold(0.0, |most: f64, v| most.max(v.abs()))
    }

    /// Looks at a window: none where no degree leaves less than `tolerance`, in energies.
    pub(super) fn look(&mut self, t: f64, h: f64, tolerance: f64) -> Option<Look> {
        let first = self.bounds_at(t);
        let width = self.interpolate(t, h, true);
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
        let tolerance = tolerance.max(ROUNDING * largest);
        let rests: Vec<f64> = self
            .series
            .chunks(width)
            .map(|row| self.size(row))
            .collect();
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

    /// Norms of the powers from the first on, in energies, of the window that was fitted last.
    pub(super) fn sizes(&self, degree: usize) -> Vec<f64> {
        let (width, norms) = (self.samples.len() / NODES, self.bounds.norms());
        let powers = powers(&self.series, degree, width);
        let of_row = |row: &[f64]| {
            let (weights, potential) = row.split_at(norms.len());
            let sum: f64 = weights.iter().zip(&norms).map(|(w, x)| w.abs() * x).sum();
            sum + potential.iter().fold(0.0, |most: f64, v| most.max(v.abs()))
        };
        powers.chunks(width).skip(1).map(of_row).collect()
    }

    /// Fits a window by polynomials of a degree.
    pub(super) fn fit(&mut self, t: f64, h: f64, degree: usize, fit: &mut Fit) {
        let width = self.interpolate(t, h, false);
        let powers = powers(&self.series, degree, width);
        let groups = self.groups();
        fit.degree = degree;
        fit.weights.clear();
        fit.potential.clear();
        for row in powers.chunks(width) {
            fit.weights.extend_from_slice(&row[..groups]);
            fit.potential.extend_from_slice(&row[groups..]);
        }
        if self.by_differences {
            // B_0 + Σ f_k (B_k − B_0) by products with each B_k
            for row in fit.weights.chunks_mut(groups) {
                row[0] -= row[1..].iter().sum::<f64>();
            }
        }
    }
}
