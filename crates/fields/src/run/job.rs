//! Jobs: what a run begins with beside its split and its method.

use crate::problem::{Piece, Split};
use crate::volume::{Plane, UserVariables, count_coefficients};
use liouville_base::run::{EventRule, Span, StartError};
use liouville_base::tape::Tape;
use std::sync::Arc;

/// Records of the trajectories.
#[derive(Clone, Debug)]
pub enum Recorded {
    /// The states, if they are wanted, and the outputs of a tape (t, x, params).
    Observables {
        /// The tape.
        tape: Tape,
        /// Its parameters, a row for all members or one for each.
        params: Vec<f64>,
        /// Whether states are recorded.
        states: bool,
    },
    /// Rows (member, t, x) where the members of an ensemble pass a plane.
    Section(Plane),
    /// Rows (x, ln |det|, largest |det − 1|) of the steps of one trajectory.
    Determinants,
}

/// A run, or an ensemble of runs.
#[derive(Clone, Debug)]
pub struct Job {
    /// Start values: rows of the members, one after another.
    pub x: Vec<f64>,
    /// The number of members of an ensemble; none for a single run.
    pub members: Option<usize>,
    /// The split of each member of an ensemble, where they have different parameters; empty where all have one.
    pub varied: Vec<Arc<Split>>,
    /// The variables of the user.
    pub variables: UserVariables,
    /// From where to where; a section looks at every step.
    pub span: Span,
    /// Its records.
    pub recorded: Recorded,
    /// When runs are recorded, in their order; every so many steps where this is empty.
    pub times: Vec<f64>,
    /// Functions of (t, x, params) whose zeros are events, of runs with observables.
    pub events: Vec<(Tape, EventRule)>,
    /// Directions of tangents, row by row, which are recorded behind observables; empty without.
    pub directions: Vec<f64>,
    /// Changes along with these of the coefficients of all pieces and of the step size, row by row; empty without.
    pub constants: Vec<f64>,
    /// Changes along with these of the time of the start, which times that are given or found do not follow.
    pub starts: Vec<f64>,
    /// Threads: of an ensemble, or of one large state.
    pub threads: usize,
}

impl Job {
    pub(super) fn check(&self, split: &Split) -> Result<(), StartError> {
        let n = split.n();
        let UserVariables { n: visible, basis } = &self.variables;
        let members = self.members.unwrap_or(1);
        let fits = self.x.len() == members * n
            && members > 0
            && self.span.steps > 0
            && self.span.every > 0
            && *visible <= n
            && basis.as_ref().is_none_or(|basis| basis.len() == n * n)
            && self.directions.len().is_multiple_of(n)
            && (self.constants.is_empty()
                || self.constants.len()
                    == self.directions.len() / n * (count_coefficients(split) + 1))
            && (self.varied.is_empty() || self.varied.len() == members && self.members.is_some())
            && self.varied.iter().all(|split| split.n() == n)
            && (self.constants.is_empty() || self.starts.len() == self.directions.len() / n)
            && match &self.recorded {
                Recorded::Observables { tape, params, .. } => {
                    let rows = if self.varied.is_empty() { 1 } else { members };
                    let mut tapes = self.events.iter().map(|(tape, _)| tape).chain([tape]);
                    tapes.all(|tape| tape.inputs() == [1, *visible, params.len() / rows])
                }
                Recorded::Section(plane) => {
                    plane.normal.len() == *visible && self.members.is_some() && self.is_plain()
                }
                Recorded::Determinants => self.members.is_none() && self.is_plain(),
            };
        if fits {
            return Ok(());
        }
        Err(StartError::Invalid(format!(
            "trajectories are rows of {n} values, and steps at least one"
        )))
    }

    /// Whether there are neither tangents nor events nor given times.
    fn is_plain(&self) -> bool {
        self.directions.is_empty() && self.events.is_empty() && self.times.is_empty()
    }

    /// The parameters of a member.
    pub(super) fn params_of<'a>(&self, params: &'a [f64], member: usize) -> &'a [f64] {
        let width = params.len() / self.varied.len().max(1);
        let row = if self.varied.is_empty() { 0 } else { member };
        &params[row * width..(row + 1) * width]
    }

    /// The variable that functions of it alone need once for all members: it moves evenly from the same start.
    pub(super) fn clock(&self, split: &Split) -> Option<usize> {
        let functions = split.pieces().iter().flat_map(Piece::functions);
        let mut alone = functions.filter_map(|function| match function.places[..] {
            [variable] => Some(variable),
            _ => None,
        });
        alone.find(|&variable| {
            let mut starts = self.x.chunks(split.n()).map(|x| x[variable].to_bits());
            let first = starts.next();
            starts.all(|start| Some(start) == first) && split.is_clock(variable)
        })
    }
}
