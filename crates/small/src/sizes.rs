//! The two sizes that are compiled.

use super::{Fixed, Layout, Matrices, StepStart};
use liouville_base::linalg::Matrix;
use liouville_base::newton::{Member, Predictor, Stop};
use liouville_base::tableau;
use liouville_problem::{Model, State, Step};

/// The memory of a step of a small system, in the smaller of two sizes that holds it.
#[derive(Clone, Debug)]
pub enum Small<L: Layout> {
    /// Up to four coordinates and two constraints.
    Narrow(Box<Fixed<L, 4, 2>>),
    /// Up to eight coordinates and eight constraints, of constant mass.
    Wide(Box<Fixed<L, 8, 8>>),
}

macro_rules! each {
    ($self:expr, $small:ident => $call:expr) => {
        match $self {
            Self::Narrow($small) => $call,
            Self::Wide($small) => $call,
        }
    };
}

impl<L: Layout> Small<L> {
    /// Memory for a small system with these parameters; `None` for other systems, or where `matrices` excludes its matrix.
    pub fn new(model: &mut Model<L>, tableau: &tableau::Spark, matrices: Matrices) -> Option<Self> {
        let narrow = Fixed::new(model, tableau, matrices).map(Self::Narrow);
        narrow.or_else(|| Fixed::new(model, tableau, matrices).map(Self::Wide))
    }

    /// Whether corrections are full Newton's.
    pub fn is_newton(&self) -> bool {
        each!(self, small => small.is_newton())
    }

    /// How many pivots of the last matrix of full Newton have other signs than those of a small step.
    pub fn reversed(&self) -> L {
        each!(self, small => small.reversed())
    }

    /// Iterates from the extrapolated start, or the cold one, and finds the end of the step for members that are open;
    /// `None` where the step has to be made by `crates/spark`.
    pub fn advance(
        &mut self,
        model: &mut Model<L>,
        from: StepStart<L>,
        step: Step<L>,
        until: (usize, Stop),
        members: &mut [Member],
    ) -> Option<()> {
        each!(self, small => small.advance(model, from, step, until, members))
    }

    /// Writes the state at the end of the step, and what the next one extrapolates.
    pub fn commit(&self, held: &mut Predictor<L>, h: f64, state: &mut State<L>) {
        each!(self, small => small.commit(held, h, state));
    }

    /// Keeps the unknowns for the extrapolation of the next step, without the state.
    pub fn hold(&self, held: &mut Predictor<L>, h: f64) {
        each!(self, small => small.hold(held, h));
    }
}

impl Small<f64> {
    /// Makes full Newton's matrix at these Y and Z, Ŷ and λ, a row a stage or node.
    pub fn linearize_at(&mut self, at: (f64, f64), stages: [&Matrix; 2], nodes: [&Matrix; 2]) {
        each!(self, small => small.linearize_at(at, stages, nodes));
    }

    /// Corrects Z and λ for residuals of momenta and for g; returns the largest correction of Z.
    pub fn correct_at(
        &mut self,
        h: f64,
        residuals: [&Matrix; 2],
        unknowns: [&mut Matrix; 2],
    ) -> f64 {
        each!(self, small => small.correct_at(h, residuals, unknowns))
    }
}
