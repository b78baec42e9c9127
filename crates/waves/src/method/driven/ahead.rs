//! The windows of a run that is to be differentiated, laid out before it begins.

use super::choice::{Form, Window};
use super::factors::Factors;
use super::polynomials::{by_nodes, nodes};
use super::{Driven, DrivenSeries};
use crate::method::Sweeper;
use crate::method::derivative::{Output, Piece, Recorder, SeriesPiece};
use liouville_base::cancel;
use liouville_base::error::StepError;

/// Most parts of a planned window.
const MOST_PARTS: f64 = 1024.0;

impl DrivenSeries {
    /// The pieces of a run from t0 without their states, with as many terms as bounds of the spectrum alone say.
    pub(in crate::method) fn pieces(mut self, t0: f64) -> Result<Vec<Piece>, StepError> {
        let mut pieces = Vec::new();
        (self.t0, self.end.t) = (t0, t0);
        while self.behind < self.times.len() {
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            (self.start.t, self.first) = (self.end.t, self.behind);
            let (planned, end, share) = self.planned()?;
            let mut parts = 1.0;
            loop {
                let mut window = planned;
                window.h /= parts;
                let next = self.lay_out(self.start.t, end, window);
                window.h = self.factors[self.factors.len() - 1].s;
                let piece = self.piece(&window, share.tail(window.h), parts)?;
                // windows are planned by two levels, of which terms may be shorter than bounds for all states
                if piece.ends() || parts >= MOST_PARTS {
                    pieces.push(Piece::Series(piece));
                    self.finish(&window, next);
                    break;
                }
                parts *= 2.0;
            }
        }
        Ok(pieces)
    }

    /// A window as a piece, one in so many parts of what was planned.
    fn piece(&mut self, window: &Window, tail: f64, parts: f64) -> Result<SeriesPiece, StepError> {
        let at = (self.start.t, window.h);
        self.sampler.fit(at, window.degree, &mut self.fit)?;
        let is_by_bounds = window.form == Form::Bessel && self.fit.degree == 0;
        let count = if is_by_bounds { window.last + 1 } else { 0 };
        let sizes = self.sampler.sizes(&self.fit).into_iter();
        let output = |factors: &Factors| Output {
            s: factors.s,
            factors: (0..count).map(|n| factors.of(window, n)).collect(),
        };
        Ok(SeriesPiece {
            start: Vec::new(),
            phase: 0.0,
            window: *window,
            fit: self.fit.clone(),
            sizes: sizes.map(|size| size * window.h.abs()).collect(),
            tail,
            nodes: (nodes().iter().map(|y| self.sampler.within(at, *y))).collect(),
            map: by_nodes(self.fit.degree),
            outputs: self.factors.iter().map(output).collect(),
            steps: self.factors.len() - 1,
            parts,
            is_by_terms: false,
        })
    }
}

impl Recorder {
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
        Some(pieces.map(|pieces| self.set(pieces)))
    }
}
