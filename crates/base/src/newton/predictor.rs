//! Start values of a step: polynomials through the values of the step before, evaluated one step on.
//!
//! A polynomial goes through the first node, the last one and those strictly between them. A value at
//! a node that repeats an end (a stage at 0 or 1, beside z0 or z1) is off the polynomial; how far
//! scales as h to the degree.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
#![allow(clippy::float_cmp)] // origin is 0 or 1

use crate::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use crate::linalg::{Matrix, as_is, combine, copy};
use crate::real::Real;
use crate::tableau::lagrange;

/// The relative error of a rounded number.
const ROUNDING: f64 = f64::EPSILON / 2.0;

/// Values at the nodes of a step, and the weights that extrapolate them to the next.
#[derive(Clone, Debug)]
pub struct Polynomial<R = f64> {
    nodes: Vec<f64>,
    /// The nodes that the polynomial goes through.
    knots: Vec<usize>,
    targets: Vec<f64>,
    weights: Matrix,
    end_weights: Matrix,
    /// One row a node.
    pub values: Matrix<R>,
}

impl<R: Real> Polynomial<R> {
    /// Rows of `width` values at `nodes`, to be extrapolated to `targets`, both in fractions of their step.
    pub fn new(nodes: &[f64], targets: &[f64], width: usize) -> Self {
        let count = nodes.len();
        let least = nodes.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let is_inside = |x: f64| least < x && x < largest;
        let is_knot = |k: &usize| *k == 0 || *k + 1 == count || is_inside(nodes[*k]);
        Self {
            nodes: nodes.to_vec(),
            knots: (0..count).filter(is_knot).collect(),
            targets: targets.to_vec(),
            weights: Matrix::zeros(targets.len(), count),
            end_weights: Matrix::zeros(1, count),
            values: Matrix::zeros(count, width),
        }
    }

    /// Writes the values at the targets.
    #[inline(always)]
    pub fn extrapolate(&self, out: &mut [R]) {
        if !out.is_empty() {
            combine(out, &self.weights, &self.values, as_is);
        }
    }

    /// Writes other values of the same nodes, extrapolated by the same weights.
    #[inline(always)]
    pub fn extrapolate_other(&self, values: &Matrix<R>, out: &mut [R]) {
        combine(out, &self.weights, values, as_is);
    }

    /// Writes the values at the end of the step.
    #[inline(always)]
    pub fn extrapolate_end(&self, out: &mut [R]) {
        combine(out, &self.end_weights, &self.values, as_is);
    }

    /// The weights of the values at the targets, a row for each, and at the end of the step.
    pub fn weights(&self) -> [&Matrix; 2] {
        [&self.weights, &self.end_weights]
    }

    /// Goes through the first `count` nodes alone.
    fn pass_through(&mut self, count: usize) {
        self.knots.clear();
        self.knots.extend(0..count);
    }

    /// How much roundings of values at the nodes grow at most on the way to the targets and to the end.
    fn growth(&self) -> f64 {
        let size = |row: &[f64]| row.iter().map(|weight| weight.abs()).sum();
        let targets = (0..self.weights.rows()).map(|i| size(self.weights.row(i)));
        targets.fold(size(self.end_weights.flat()), f64::max)
    }

    /// Makes the weights for steps that are `ratio` times as long as the one held, and begin at its fraction `origin`.
    fn update_weights(&mut self, origin: f64, ratio: f64) {
        let (nodes, knots) = (&self.nodes, &self.knots);
        let place = |x: &f64| origin + ratio * x;
        let targets = self.targets.iter().map(place);
        self.weights.clear();
        lagrange(nodes, knots, targets, &mut self.weights);
        let end = std::iter::once(place(&1.0));
        lagrange(nodes, knots, end, &mut self.end_weights);
        let (first, last) = (0, nodes.len() - 1);
        let degree = i32::try_from(knots.len().saturating_sub(1)).expect("a small degree");
        for (i, target) in self.targets.iter().enumerate() {
            let is_off = |k: &usize| !knots.contains(k) && nodes[*k].to_bits() == target.to_bits();
            let Some(off) = (first..last).find(is_off) else {
                continue;
            };
            let end = if *target < 0.5 { first } else { last };
            let shift = ratio.powi(degree);
            self.weights[(i, off)] = shift;
            self.weights[(i, end)] -= shift;
        }
    }
}

/// The polynomials of the last step, by which the start values of the next one are extrapolated.
#[derive(Clone, Debug)]
pub struct Predictor<R = f64> {
    /// The size of the step held, and the ratio the weights were made for.
    h: Option<f64>,
    ratio: f64,
    /// Whether the values extrapolated by these weights are more than their roundings.
    is_meaningful: bool,
    /// Where the next step begins: at the end of the one held, 1, or after a rejected step at its start, 0.
    origin: f64,
    /// The polynomials.
    pub curves: Vec<Polynomial<R>>,
}

impl<R: Real> Predictor<R> {
    /// A predictor of these curves, without a step yet.
    pub fn new(curves: Vec<Polynomial<R>>) -> Self {
        Self {
            h: None,
            ratio: f64::NAN,
            is_meaningful: false,
            origin: 1.0,
            curves,
        }
    }

    /// Makes the weights for a step of `h`, unless they are up to date; returns false without a step to extrapolate, and
    /// where roundings would be as large as the values extrapolated: of more than twenty stages, or over steps that are
    /// much longer than the one held.
    pub fn update_weights(&mut self, h: f64) -> bool {
        let Some(last) = self.h else { return false };
        let ratio = h / last;
        if ratio.to_bits() != self.ratio.to_bits() {
            self.ratio = ratio;
            for curve in &mut self.curves {
                curve.update_weights(self.origin, ratio);
            }
            let growth = self.curves.iter().map(Polynomial::growth);
            self.is_meaningful = growth.fold(0.0, f64::max) * ROUNDING < 1.0;
        }
        self.is_meaningful
    }

    /// The start and the length of the step that the weights are for, in units of the step held.
    pub fn weights_key(&self) -> [f64; 2] {
        [self.origin, self.ratio]
    }

    /// The size of the step held.
    pub fn h(&self) -> Option<f64> {
        self.h
    }

    /// Whether the step held begins where the next one does.
    pub fn is_undone(&self) -> bool {
        self.origin == 0.0
    }

    /// Holds a finished step of `h`, whose values have been written.
    pub fn hold(&mut self, h: f64) {
        self.h = Some(h);
        if self.is_undone() {
            (self.origin, self.ratio) = (1.0, f64::NAN);
        }
    }

    /// Lets all curves go through their first `count` nodes alone.
    pub fn pass_through(&mut self, count: usize) {
        if self.curves.iter().any(|curve| curve.knots.len() != count) {
            self.curves
                .iter_mut()
                .for_each(|curve| curve.pass_through(count));
            self.ratio = f64::NAN;
        }
    }

    /// Forgets the step: the next start is cold.
    pub fn forget(&mut self) {
        self.h = None;
    }

    /// Forgets that a step was rejected, too.
    pub fn reset(&mut self) {
        (self.h, self.origin, self.ratio) = (None, 1.0, f64::NAN);
    }

    /// Lets the next step begin where the one held began, which was rejected.
    pub fn undo(&mut self) {
        (self.origin, self.ratio) = (0.0, f64::NAN);
    }
}

/// The polynomial through values at the start of a step and at its stages, by which those of a longer or shorter step
/// from the same state are extrapolated.
#[derive(Clone, Debug)]
pub struct Continuation {
    held: Predictor,
}

impl Continuation {
    /// Of rows of `width` values at the stages `c`.
    pub fn new(c: &[f64], width: usize) -> Self {
        let nodes = [&[0.0], c].concat();
        let held = Predictor::new(vec![Polynomial::new(&nodes, c, width)]);
        Self { held }
    }

    /// Writes the values at the stages of a step of `to`, from those at its start and at the stages of a step of `from`.
    pub fn extend(
        &mut self,
        [from, to]: [f64; 2],
        start: &[f64],
        stages: &Matrix,
        out: &mut [f64],
    ) {
        self.held.hold(from);
        self.held.undo();
        self.held.update_weights(to);
        let curve = &mut self.held.curves[0];
        copy(curve.values.row_mut(0), start);
        for i in 0..stages.rows() {
            copy(curve.values.row_mut(i + 1), stages.row(i));
        }
        curve.extrapolate(out);
    }
}

/// Saves the curves; weights are made again, to the same bits.
impl<R: Real> Checkpoint for Predictor<R> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.h, self.origin).save(member, out);
        for curve in &self.curves {
            curve.values.flat().save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let origin = self.origin;
        self.h.restore(member, saved)?;
        self.origin.restore(member, saved)?;
        for curve in &mut self.curves {
            curve.values.flat_mut().restore(member, saved)?;
        }
        if origin.to_bits() != self.origin.to_bits() {
            self.ratio = f64::NAN;
        }
        Ok(())
    }
}
