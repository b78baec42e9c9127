//! Derivatives of runs, of the discrete map itself: by the state at the start, and by H at nodes in time.
//!
//! A run that is to be differentiated leaves pieces, one after another: what was chosen for them, and the state where they
//! begin. Choices are held, and a piece is then a polynomial in the state and in the weights of the terms of H. Tangents
//! follow the pieces from the first to the last, cotangents from the last to the first. Vectors are real parts, then
//! imaginary parts, and pairings are sums of products: Re ⟨cotangent|change⟩.

mod majorant;
mod potential;
mod powers;
mod pull;
mod recorder;
mod series;
mod shears;

use super::driven::polynomials::NodeMap;
pub use super::driven::polynomials::{AtNodes, Wanted};
use super::driven::terms::Terms;
use super::{Sweeper, Wave};
use liouville_base::error::StepError;
use liouville_base::simd::Stored;
pub(super) use majorant::{Output, SeriesPiece};
use pull::SeriesPull;
pub use recorder::Recorder;
use recorder::{KeptTerms, copied};
pub(super) use recorder::{Piece, ShearsPiece};
use std::ops::Range;

/// The parts of the first member, one after the other.
///
/// # Errors
/// There is no memory for them.
pub(super) fn flat<S: Stored>(state: &Wave<S>) -> Result<Vec<f64>, StepError> {
    let mut found = copied(&[], state.q.len() + state.p.len())?;
    found.extend(state.q.iter().chain(&state.p).map(|x| x.member(0)));
    Ok(found)
}

/// The derivatives of a run, piece by piece.
pub struct Derivative {
    pieces: Vec<Piece>,
    terms: Terms,
    /// Terms of changes, one direction after another.
    moved: Vec<Terms>,
    pull: SeriesPull,
    /// All terms of the last windows of series.
    kept: KeptTerms,
}

impl Derivative {
    /// The derivatives of a run that is over, of a Hamiltonian with so many terms in each group.
    pub fn new(sweeper: &Sweeper<f64>, groups: &[usize], recorder: &Recorder) -> Self {
        let (mut pieces, kept) = recorder.taken();
        let firsts = groups.iter().scan(0, |next, count| {
            *next += count;
            Some(*next - count)
        });
        let firsts: Vec<usize> = firsts.collect();
        for piece in &mut pieces {
            piece.group(&firsts);
        }
        Self {
            pieces,
            terms: Terms::new(sweeper, groups),
            moved: Vec::new(),
            pull: SeriesPull::default(),
            kept,
        }
    }

    /// Number of pieces.
    pub fn count(&self) -> usize {
        self.pieces.len()
    }

    /// How many steps of the run end in a piece, and the times of its nodes.
    pub fn piece(&self, piece: usize) -> (usize, &[f64]) {
        let piece = &self.pieces[piece];
        let (Piece::Series(SeriesPiece { nodes, .. }) | Piece::Shears(ShearsPiece { nodes, .. })) =
            piece;
        (piece.steps(), nodes)
    }

    /// Adds steps of shears q ← q + c h (H − shift) p and p ← p − c h (H − shift) q in turn, of an H that does not change,
    /// from t on, which count as one; back in time they are undone.
    pub fn add_shears(
        &mut self,
        coefficients: &[f64],
        shift: f64,
        (t, h): (f64, f64),
        repeats: usize,
    ) {
        let mut shears: Vec<(bool, f64)> = (coefficients.iter().enumerate())
            .map(|(k, c)| (k % 2 == 1, c * h))
            .collect();
        if h < 0.0 {
            shears.reverse();
        }
        let groups = self.terms.groups();
        self.pieces.push(Piece::Shears(ShearsPiece {
            shears,
            repeats,
            shift,
            angles: (shift * t, -shift * (t + h * repeats as f64)),
            ends: [Vec::new(), Vec::new()],
            weights: vec![1.0; groups],
            potential: Vec::new(),
            nodes: vec![t],
            map: NodeMap::constant(),
            steps: 1,
        }));
    }

    /// Makes all shears of an H that does not change from the state where the first begin, which is replaced by that where
    /// the last end, and keeps both of each, which derivatives by H take.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn keep_ends(&mut self, state: &mut [f64]) -> Result<(), StepError> {
        for piece in &mut self.pieces {
            if let Piece::Shears(piece) = piece {
                piece.keep_ends(&mut self.terms, state)?;
            }
        }
        Ok(())
    }

    /// Replaces a state where a piece begins by that where it ends, by the same choices, with H changed at its nodes. Returns
    /// it at the ends of its steps, too.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn repeat(
        &mut self,
        piece: usize,
        state: &mut Vec<f64>,
        change: &AtNodes,
    ) -> Result<Vec<Vec<f64>>, StepError> {
        match &self.pieces[piece] {
            Piece::Series(piece) => piece.repeat(&mut self.terms, state, change),
            Piece::Shears(piece) => piece.repeat(&mut self.terms, state, change),
        }
    }

    /// Replaces changes of the state where a piece begins, one of each direction, by those where it ends, given those of H
    /// at its nodes. Returns them at the ends of its steps, too, all directions of the first step before those of the next.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn follow(
        &mut self,
        piece: usize,
        changes: &mut [Vec<f64>],
        of_nodes: &[AtNodes],
    ) -> Result<Vec<Vec<f64>>, StepError> {
        let piece = match &self.pieces[piece] {
            Piece::Series(piece) => piece,
            Piece::Shears(piece) => return piece.follow(&mut self.terms, changes, of_nodes),
        };
        while self.moved.len() < changes.len() {
            self.moved.push(self.terms.clone());
        }
        piece.follow(
            (&mut self.terms, &mut self.moved[..changes.len()]),
            changes,
            of_nodes,
        )
    }

    /// Replaces a cotangent of the state where the last of these pieces ends by that where the first begins, given those of
    /// the states where some steps end, which are counted through the run; returns those of H at their nodes, as far as they
    /// are wanted.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn pull(
        &mut self,
        pieces: Range<usize>,
        cotangent: &mut [f64],
        (steps, rows): (&[usize], &[Vec<f64>]),
        wanted: Wanted,
    ) -> Result<AtNodes, StepError> {
        let mut before: usize = self.pieces[..pieces.end].iter().map(Piece::steps).sum();
        let mut each = Vec::with_capacity(pieces.len());
        for piece in pieces.rev() {
            let count = self.pieces[piece].steps();
            before -= count;
            let here = steps.partition_point(|step| *step < before)
                ..steps.partition_point(|step| *step < before + count);
            let mut of_steps = Vec::new();
            if !here.is_empty() {
                of_steps.resize(count, vec![0.0; cotangent.len()]);
            }
            for (step, row) in steps[here.clone()].iter().zip(&rows[here]) {
                of_steps[step - before].copy_from_slice(row);
            }
            each.push(self.pull_piece(piece, cotangent, &of_steps, wanted)?);
        }
        let mut found = AtNodes::default();
        for own in each.iter().rev() {
            found.weights.extend(&own.weights);
            found.potential.extend(&own.potential);
        }
        Ok(found)
    }

    /// The same of one piece, given cotangents of the ends of all its steps, or none.
    fn pull_piece(
        &mut self,
        piece: usize,
        cotangent: &mut [f64],
        of_steps: &[Vec<f64>],
        wanted: Wanted,
    ) -> Result<AtNodes, StepError> {
        let terms = &mut self.terms;
        let is_kept = self.kept.back().is_some_and(|(place, _)| *place == piece);
        let last = if is_kept { self.kept.pop_back() } else { None };
        match &self.pieces[piece] {
            Piece::Series(series) => {
                let kept = last.map_or_else(Vec::new, |(_, kept)| kept);
                let memory = (terms, &mut self.pull);
                let (found, kept) = series.pull(memory, cotangent, of_steps, (wanted, kept))?;
                self.terms.reuse(kept);
                Ok(found)
            }
            Piece::Shears(piece) => piece.pull(terms, cotangent, of_steps, wanted),
        }
    }
}
