//! Derivatives of runs, of the discrete map itself: by the state at the start, and by H at nodes in time.
//!
//! A run that is to be differentiated leaves pieces, one after another: what was chosen for them, and the state where they
//! begin. Choices are held, and a piece is then a polynomial in the state and in the weights of the terms of H. Tangents
//! follow the pieces from the first to the last, cotangents from the last to the first. Vectors are real parts, then
//! imaginary parts, and pairings are sums of products: Re ⟨cotangent|change⟩.

mod powers;
mod series;

use super::driven::terms::Terms;
use super::{Sweeper, Wave};
use liouville_base::error::StepError;
pub(super) use series::{Output, SeriesPiece};
use std::sync::{Arc, Mutex, PoisonError};

/// A place where a run leaves its pieces; clones are the same place.
#[derive(Clone, Default)]
pub struct Recorder(Arc<Mutex<Vec<SeriesPiece>>>);

impl Recorder {
    /// Adds a piece.
    ///
    /// # Errors
    /// There is no memory for one more.
    pub(super) fn add(&self, piece: SeriesPiece) -> Result<(), StepError> {
        let mut pieces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        pieces.try_reserve(1).map_err(|_| StepError::NoMemory)?;
        pieces.push(piece);
        Ok(())
    }

    /// Number of pieces.
    pub(super) fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Changes the pieces from one on.
    pub(super) fn change(&self, first: usize, change: impl FnMut(&mut SeriesPiece)) {
        let mut pieces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        pieces[first..].iter_mut().for_each(change);
    }

    fn taken(&self) -> Vec<SeriesPiece> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A copy of a vector, with room for so many numbers at least.
///
/// # Errors
/// There is no memory for it.
pub(super) fn copied(x: &[f64], size: usize) -> Result<Vec<f64>, StepError> {
    let mut found = Vec::new();
    found
        .try_reserve_exact(x.len().max(size))
        .map_err(|_| StepError::NoMemory)?;
    found.extend_from_slice(x);
    Ok(found)
}

/// The derivatives of a run, piece by piece.
pub struct Derivative {
    pieces: Vec<SeriesPiece>,
    terms: Terms,
    /// Those of changes, one direction after another.
    moved: Vec<Terms>,
}

impl Derivative {
    /// The derivatives of a run that is over, of a Hamiltonian with so many terms in each group.
    pub fn new(sweeper: &Sweeper<f64>, groups: &[usize], recorder: &Recorder) -> Self {
        let mut pieces = recorder.taken();
        let firsts = groups.iter().scan(0, |next, count| {
            *next += count;
            Some(*next - count)
        });
        let firsts: Vec<usize> = firsts.collect();
        for piece in pieces.iter_mut().filter(|piece| piece.is_by_terms) {
            let weights = &mut piece.fit.weights;
            *weights = firsts.iter().map(|first| weights[*first]).collect();
        }
        Self {
            pieces,
            terms: Terms::new(sweeper, groups),
            moved: Vec::new(),
        }
    }

    /// Number of pieces.
    pub fn count(&self) -> usize {
        self.pieces.len()
    }

    /// How many steps of the run end in a piece, and the times of its nodes.
    pub fn piece(&self, piece: usize) -> (usize, &[f64]) {
        let SeriesPiece { steps, nodes, .. } = &self.pieces[piece];
        (*steps, nodes)
    }

    /// Lets H change within a piece by polynomials of a degree, if it has polynomials of less.
    pub fn raise(&mut self, piece: usize, degree: usize) {
        self.pieces[piece].raise(degree);
    }

    /// Replaces a state where a piece begins by that where it ends, by the same choices, with weights of H changed at its nodes.
    /// Returns it at the ends of its steps, too.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn repeat(
        &mut self,
        piece: usize,
        state: &mut Vec<f64>,
        change: &[f64],
    ) -> Result<Vec<Vec<f64>>, StepError> {
        self.pieces[piece].repeat(&mut self.terms, state, change)
    }

    /// Replaces changes of the state where a piece begins, one of each direction, by those where it ends, given those of
    /// the weights of H at its nodes, of all groups at one after another; none are given where there are none. Returns them at the ends of its steps, too, all directions of the first step before those of the next.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn follow(
        &mut self,
        piece: usize,
        changes: &mut [Vec<f64>],
        of_nodes: &[Vec<f64>],
    ) -> Result<Vec<Vec<f64>>, StepError> {
        while self.moved.len() < changes.len() {
            self.moved.push(self.terms.clone());
        }
        let piece = &self.pieces[piece];
        piece.follow(
            (&mut self.terms, &mut self.moved[..changes.len()]),
            changes,
            of_nodes,
        )
    }

    /// Replaces a cotangent of the state where a piece ends by that where it begins, given those of the ends of its
    /// steps; returns those of the weights of H at its nodes, where they are wanted.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled.
    pub fn pull(
        &mut self,
        piece: usize,
        cotangent: &mut Vec<f64>,
        of_steps: &[Vec<f64>],
        is_wanted: bool,
    ) -> Result<Vec<f64>, StepError> {
        self.pieces[piece].pull(&mut self.terms, cotangent, of_steps, is_wanted)
    }
}

/// Multiplies a vector by e^{i angle}.
fn turn(x: &mut [f64], angle: f64) {
    let (q, p) = x.split_at_mut(x.len() / 2);
    let mut wave = Wave {
        q: q.to_vec(),
        p: p.to_vec(),
        phase: -angle,
        start: 0.0,
    };
    wave.remove_phase();
    q.copy_from_slice(&wave.q);
    p.copy_from_slice(&wave.p);
}
