//! The polynomials of a window at all points of a potential, some at a time.

use super::choice::Window;
use super::fit::Sampler;
use super::polynomials::{NODES, chebyshev_node, coefficients, powers};
use crate::problem::{AT_ONCE, Potential, PotentialRegisters};
use liouville_base::cancel;
use liouville_base::error::StepError;
use liouville_base::real::WIDTH;

/// Parts of a grid in each of which a point is found that is to be looked at.
const PARTS: usize = 16;

/// Values of a potential at times, one row after another, at so many points from the first on.
fn sampled(
    potential: &Potential,
    registers: &mut PotentialRegisters,
    times: &[f64],
    first: usize,
    count: usize,
    samples: &mut Vec<f64>,
) {
    samples.clear();
    samples.resize(times.len() * count, 0.0);
    for (t, values) in times.iter().zip(samples.chunks_mut(count)) {
        potential.add(registers, (1.0, *t), first, values);
    }
}

/// The polynomials of a window in y = s/h: coefficients of each power, one power after another.
#[derive(Clone, Debug, Default)]
pub(in crate::method) struct Fit {
    pub(in crate::method) degree: usize,
    /// Weights of each group.
    pub(in crate::method) weights: Vec<f64>,
    /// At each point, empty without a potential.
    pub(in crate::method) potential: Vec<f64>,
}

impl Sampler {
    /// Fits a window by polynomials of a degree.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn fit(
        &mut self,
        (t, h): (f64, f64),
        degree: usize,
        fit: &mut Fit,
    ) -> Result<(), StepError> {
        let (width, groups) = (self.interpolate((t, h), NODES), self.groups());
        fit.degree = degree;
        fit.weights.clear();
        for row in powers(&self.series, degree, width).chunks(width) {
            fit.weights.extend_from_slice(&row[..groups]);
        }
        if self.by_differences {
            // B_0 + Σ f_k (B_k − B_0) by products with each B_k
            for row in fit.weights.chunks_mut(groups) {
                row[0] -= row[1..].iter().sum::<f64>();
            }
        }
        self.fit_potential((t, h), degree, &mut fit.potential)
    }

    /// Points of the potential at which polynomials of a degree leave out more than a tolerance, the worst one of each part of
    /// the grid.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn misfits(
        &mut self,
        (t, h): (f64, f64),
        degree: usize,
        tolerance: f64,
    ) -> Result<Vec<usize>, StepError> {
        let mut found = Vec::new();
        if !self.is_thinned() {
            return Ok(found);
        }
        let times = self.nodes((t, h));
        let Some((potential, registers)) = &mut self.potentials[0] else {
            return Ok(found);
        };
        let size = potential.size();
        let each = AT_ONCE.min(size.div_ceil(PARTS).next_multiple_of(WIDTH));
        let (mut samples, mut series) = (Vec::new(), Vec::new());
        for first in (0..size).step_by(each) {
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let count = each.min(size - first);
            sampled(potential, registers, &times, first, count, &mut samples);
            coefficients(&samples, count, &mut series);
            let mut rests = vec![0.0; count];
            for row in series.chunks(count).skip(degree + 1) {
                for (rest, x) in rests.iter_mut().zip(row) {
                    *rest += x.abs();
                }
            }
            let worst = rests.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            // what is not finite is refused there
            found.extend(worst.and_then(|(k, rest)| {
                let is_fine = *rest <= tolerance;
                (!is_fine).then_some(first + k)
            }));
        }
        found.retain(|point| !self.looked.contains(point));
        Ok(found)
    }

    /// The times of the nodes of a window.
    fn nodes(&self, window: (f64, f64)) -> Vec<f64> {
        let time = |node| self.within(window, chebyshev_node(node, NODES));
        (0..NODES).map(time).collect()
    }

    fn fit_potential(
        &mut self,
        (t, h): (f64, f64),
        degree: usize,
        fitted: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        fitted.clear();
        let times = self.nodes((t, h));
        let Some((potential, registers)) = &mut self.potentials[0] else {
            return Ok(());
        };
        let size = potential.size();
        fitted.resize((degree + 1) * size, 0.0);
        let (mut samples, mut series) = (Vec::new(), Vec::new());
        for first in (0..size).step_by(AT_ONCE) {
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let count = AT_ONCE.min(size - first);
            sampled(potential, registers, &times, first, count, &mut samples);
            coefficients(&samples, count, &mut series);
            let powers = powers(&series, degree, count);
            for (own, all) in powers.chunks(count).zip(fitted.chunks_mut(size)) {
                all[first..first + count].copy_from_slice(own);
            }
        }
        Ok(())
    }

    /// Norms of the powers from the first on, in energies, of the window that was fitted last.
    pub(super) fn sizes(&self, fit: &Fit) -> Vec<f64> {
        let (width, norms) = (self.samples.len() / NODES, self.bounds().norms());
        let weights = powers(&self.series, fit.degree, width);
        let of_weights = weights.chunks(width).map(|row| -> f64 {
            let pairs = row.iter().zip(&norms);
            pairs.map(|(weight, norm)| weight.abs() * norm).sum()
        });
        let each = (fit.potential.len() / (fit.degree + 1)).max(1);
        let rows = fit.potential.chunks(each);
        let of_potential = rows.map(|row| row.iter().fold(0.0, |most: f64, v| most.max(v.abs())));
        let of_potential = of_potential.chain(std::iter::repeat(0.0));
        let sizes = of_weights.zip(of_potential).skip(1);
        sizes.map(|(weights, most)| weights + most).collect()
    }

    /// The same times the length of the window, behind that of H less σ at its start.
    pub(super) fn sizes_from_start(&mut self, t: f64, window: &Window, fit: &Fit) -> Vec<f64> {
        // the last node is the start
        let last = self.samples.len() - self.samples.len() / NODES;
        let mut row = self.samples[last..][..self.groups()].to_vec();
        let t = self.within((t, window.h), 0.0);
        if let Some((potential, registers)) = &mut self.potentials[0] {
            let groups = row.len();
            row.resize(groups + potential.size(), 0.0);
            potential.add(registers, (1.0, t), 0, &mut row[groups..]);
        }
        let (low, high) = self.bounds().at(&row);
        let first = (high - window.sigma).abs().max((low - window.sigma).abs());
        let sizes = std::iter::once(first).chain(self.sizes(fit));
        sizes.map(|size| size * window.h.abs()).collect()
    }
}
