//! Inputs of a run that is to be differentiated, and its record.

use super::majorant::{Majorant, SeriesPiece};
use crate::method::driven::choice::Form;
use crate::method::driven::polynomials::NodeMap;
use liouville_base::error::StepError;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most bytes of terms that are kept beyond those of one window.
const ROOM: usize = 1 << 26;

/// A part of a run with choices of its own.
pub(in crate::method) enum Piece {
    Series(SeriesPiece),
    Shears(ShearsPiece),
}

impl Piece {
    /// Gives it the nodes of its weights, as an average of those there with these factors, and says whether a step ends
    /// with it.
    pub(in crate::method) fn average(&mut self, times: Vec<f64>, row: &[f64], is_end: bool) {
        let (nodes, map, steps) = match self {
            Self::Series(piece) => (&mut piece.nodes, &mut piece.map, &mut piece.steps),
            Self::Shears(piece) => (&mut piece.nodes, &mut piece.map, &mut piece.steps),
        };
        *nodes = times;
        map.series = row.to_vec();
        map.powers = vec![1.0];
        *steps = usize::from(is_end);
    }

    /// How many steps of the run end in it.
    pub(super) fn steps(&self) -> usize {
        match self {
            Self::Series(piece) => piece.steps,
            Self::Shears(piece) => piece.steps,
        }
    }

    /// Takes the weights of groups of terms, which begin at these, for those of all terms.
    pub(super) fn group(&mut self, firsts: &[usize]) {
        let weights = match self {
            Self::Series(piece) if !piece.is_by_terms => return,
            Self::Series(piece) => &mut piece.fit.weights,
            Self::Shears(piece) => &mut piece.weights,
        };
        *weights = firsts.iter().map(|first| weights[*first]).collect();
    }
}

/// Steps of shears as they were made: the same ones in each step.
pub(in crate::method) struct ShearsPiece {
    /// Whether p is updated, not q, and a.
    pub(in crate::method) shears: Vec<(bool, f64)>,
    /// How many times.
    pub(in crate::method) repeats: usize,
    pub(in crate::method) shift: f64,
    /// Angles by which ψ is turned before and after them.
    pub(in crate::method) angles: (f64, f64),
    /// The parts before and after them, where H may change.
    pub(in crate::method) ends: [Vec<f64>; 2],
    /// Weights of all terms, or of groups of them.
    pub(in crate::method) weights: Vec<f64>,
    pub(in crate::method) potential: Vec<f64>,
    /// Times, and the weights by those of H there.
    pub(in crate::method) nodes: Vec<f64>,
    pub(in crate::method) map: NodeMap,
    pub(in crate::method) steps: usize,
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

    /// Has these pieces for a run that is yet to be made.
    pub(in crate::method) fn set(&self, pieces: Vec<Piece>) {
        self.left().pieces = pieces;
    }

    fn left(&self) -> MutexGuard<'_, Left> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
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

    /// Keeps all terms of a piece in place of those before it for which there is no room, and returns these.
    pub(in crate::method) fn keep(&self, piece: usize, all: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if self.is_closed {
            return all;
        }
        let mut unkept = Vec::new();
        let mut left = self.left();
        let bytes = |all: &[Vec<f64>]| all.iter().map(|x| size_of_val(&x[..])).sum::<usize>();
        left.bytes += bytes(&all);
        left.kept.push_back((piece, all));
        while left.bytes > ROOM && left.kept.len() > 1 {
            let first = left.kept.pop_front();
            let first = first.map_or_else(Vec::new, |(_, all)| all);
            left.bytes -= bytes(&first);
            unkept.extend(first);
        }
        unkept
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
