//! Inputs of a run that is to be differentiated, and its record.

use super::majorant::Majorant;
use super::{Piece, Terms, copied};
use crate::method::Sweeper;
use crate::method::driven::choice::Form;
use crate::method::driven::{Driven, DrivenSeries};
use liouville_base::error::StepError;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most bytes of terms that are kept beyond those of one window.
const ROOM: usize = 1 << 26;

/// All terms of a window, by the place of its piece.
pub(super) type KeptTerms = VecDeque<(usize, Vec<Vec<f64>>)>;

/// Pieces, and all terms of the last ones.
#[derive(Default)]
struct Left {
    pieces: Vec<Piece>,
    kept: KeptTerms,
    bytes: usize,
}

/// A place where a run leaves its pieces; clones are the same place.
///
/// Series are as long as derivatives need, so that what is differentiated is the run itself.
#[derive(Clone, Default)]
pub struct Recorder {
    left: Arc<Mutex<Left>>,
    /// Tolerance of derivatives by H, relative to what its change makes in a window; none where there are none.
    tolerance: Option<f64>,
    /// Whether the run leaves nothing: another one will, which takes the same terms.
    is_closed: bool,
}

impl Recorder {
    /// A place for a run whose derivatives by H have a tolerance, or which has none.
    pub fn new(tolerance: Option<f64>) -> Self {
        Self {
            tolerance,
            ..Self::default()
        }
    }

    /// The same, where the run is to leave nothing.
    #[must_use]
    pub fn closed(self) -> Self {
        Self {
            is_closed: true,
            ..self
        }
    }

    fn left(&self) -> MutexGuard<'_, Left> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lays out the pieces of a run by series in time with these outputs; none where the parts do not fit.
    ///
    /// # Errors
    /// H is not finite, or there is no memory.
    pub fn lay_out(
        &self,
        sweeper: &Sweeper<f64>,
        driven: Driven,
        t0: f64,
        times: Vec<f64>,
    ) -> Option<Result<(), StepError>> {
        let series = DrivenSeries::new(sweeper, driven, times)?;
        let pieces = series.and_then(|series| series.pieces(t0));
        Some(pieces.map(|pieces| self.left().pieces = pieces))
    }

    /// Number of pieces.
    pub fn count(&self) -> usize {
        self.left().pieces.len()
    }

    /// The times of the nodes of a piece.
    ///
    /// # Panics
    /// There is no such piece.
    pub fn nodes(&self, piece: usize) -> Vec<f64> {
        match &self.left().pieces[piece] {
            Piece::Series(piece) => piece.nodes.clone(),
            Piece::Shears(piece) => piece.nodes.clone(),
        }
    }

    /// Lets H change within a piece by polynomials of a degree, if it has polynomials of less.
    ///
    /// # Panics
    /// There is no such piece.
    pub fn raise(&self, piece: usize, degree: usize) {
        if let Piece::Series(piece) = &mut self.left().pieces[piece] {
            piece.raise(degree);
        }
    }

    /// Takes as many terms in a piece as its derivatives need, by any state and by changes of H at its nodes: as columns,
    /// each in units of the largest it has in the run. False where there is no series.
    ///
    /// # Panics
    /// There is no such piece.
    pub fn lengthen(&self, piece: usize, changes: &[f64]) -> bool {
        match &mut self.left().pieces[piece] {
            Piece::Series(piece) => {
                piece.lengthen(changes, self.tolerance.unwrap_or(f64::INFINITY))
            }
            Piece::Shears(_) => true, // as many as there are
        }
    }

    /// How many terms of a series in Bessel functions derivatives need at least, over a time in units of 1/β in which H
    /// does not depend on time.
    pub(in crate::method) fn least(&self, theta: f64) -> usize {
        let of_changes = |tolerance: f64| Majorant::of_constant(theta, tolerance).bessel();
        let found = self.tolerance.and_then(of_changes);
        found.map_or(0, |length| length.count)
    }

    /// Begins a piece that was laid out at a state, and gives its form, how many terms it takes, and which part of a
    /// planned window it is.
    ///
    /// # Errors
    /// There is no memory for the state.
    pub(in crate::method) fn begin(
        &self,
        piece: usize,
        start: &[f64],
        phase: f64,
    ) -> Result<(Form, usize, f64), StepError> {
        match self.left().pieces.get_mut(piece) {
            Some(Piece::Series(series)) => {
                if !self.is_closed {
                    series.start = copied(start, 0)?;
                    series.phase = phase;
                }
                Ok((series.window.form, series.count(), series.parts))
            }
            _ => Err(StepError::Interrupted),
        }
    }

    /// Keeps all terms of a piece in place of those before it for which there is no room, whose memory is used again.
    pub(in crate::method) fn keep(&self, piece: usize, all: Vec<Vec<f64>>, terms: &mut Terms) {
        if self.is_closed {
            terms.reuse(all);
            return;
        }
        let mut left = self.left();
        let bytes = |all: &[Vec<f64>]| all.iter().map(|x| size_of_val(&x[..])).sum::<usize>();
        left.bytes += bytes(&all);
        left.kept.push_back((piece, all));
        while left.bytes > ROOM && left.kept.len() > 1 {
            let first = left.kept.pop_front();
            let first = first.map_or_else(Vec::new, |(_, all)| all);
            left.bytes -= bytes(&first);
            terms.reuse(first);
        }
    }

    /// Adds a piece.
    ///
    /// # Errors
    /// There is no memory for one more, or it has no series for its derivatives.
    pub(in crate::method) fn add(&self, mut piece: Piece) -> Result<(), StepError> {
        if let (Piece::Series(series), Some(tolerance)) = (&mut piece, self.tolerance) {
            let theta = series.window.beta * series.window.h.abs();
            if !series.lengthen(&[1.0], tolerance) {
                let (most, t) = (theta, series.nodes[0]);
                return Err(StepError::Spectrum { theta, most, t });
            }
        }
        if self.is_closed {
            return Ok(());
        }
        let mut left = self.left();
        left.pieces
            .try_reserve(1)
            .map_err(|_| StepError::NoMemory)?;
        left.pieces.push(piece);
        Ok(())
    }

    /// Changes the pieces from one on.
    pub(in crate::method) fn change(&self, first: usize, change: impl FnMut(&mut Piece)) {
        self.left().pieces[first..].iter_mut().for_each(change);
    }

    /// Takes what the run has left.
    pub(super) fn taken(&self) -> (Vec<Piece>, KeptTerms) {
        let Left { pieces, kept, .. } = std::mem::take(&mut *self.left());
        (pieces, kept)
    }
}
