//! The system, the method and the job of a run.

use super::parts::Part;
use super::pool::Pools;
use crate::events::{EventSlopes, Law};
use liouville_alpha::{AlphaSlopes, Reactions};
use liouville_base::method::Tolerance;
use liouville_base::run::{EventRule, Span};
use liouville_base::tableau::{self, Scheme};
use liouville_base::tape::Tape;
use liouville_index2::semi_explicit::{SemiExplicit, SemiExplicitSensitivity};
use liouville_problem::{Mechanical, SecondOrder, Sensitivity, Separable, Turning, Watched};
use liouville_spark::Solver;
use std::sync::Arc;

/// A system in the form that its method steps.
#[derive(Clone, Debug)]
pub enum Problem {
    /// For SPARK methods.
    General(Arc<Mechanical>, Arc<Pools>),
    /// For RATTLE, the Lobatto pair of two stages on separable systems.
    Separable(Arc<Separable>),
    /// For the α methods.
    SecondOrder(Arc<SecondOrder>),
    /// For the index-2 methods, on Gauss points.
    SemiExplicit(Arc<SemiExplicit>),
}

/// A method and its numbers.
#[derive(Clone, Debug)]
pub enum Method {
    /// A SPARK method, alone or composed; also RATTLE, and index-2 methods by its number of stages.
    Spark(Box<SparkMethod>),
    /// A method of the α family, and the tolerance of its equations as in [`SparkMethod`].
    Alpha(tableau::Alpha, Reactions, Option<f64>),
}

/// A SPARK method and its numbers.
#[derive(Clone, Debug)]
pub struct SparkMethod {
    /// Its coefficients.
    pub tableau: tableau::Spark,
    /// How its stage equations are solved.
    pub solver: Solver,
    /// To which fraction of the velocities; without one, to roundoff.
    pub newton_tol: Option<f64>,
    /// The scheme that composes it, if one does.
    pub scheme: Option<&'static Scheme>,
}

/// The control of the steps.
#[derive(Clone, Debug)]
pub enum Control {
    /// Equal steps.
    Fixed,
    /// Steps as long as the estimated errors allow.
    Adaptive {
        /// The tolerance of errors.
        tolerance: Tolerance,
        /// The first step; without one the method chooses it.
        h_first: Option<f64>,
        /// The smallest step allowed.
        h_min: f64,
    },
    /// Steps that follow a monitor of the state, by a symmetric rule.
    Reversible {
        /// About the first step.
        h_first: f64,
        /// The smallest step allowed.
        h_min: f64,
        /// A tape (t, y, z, z', params) → s, ds/dt with whether it depends on z'; without one, the time scale of the
        /// acceleration.
        monitor: Option<(Tape, bool)>,
    },
    /// Steps from the first of these times to the next ones: those of another run.
    Held(Vec<f64>),
}

impl Control {
    /// Its name in messages.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::Fixed => "none",
            Self::Adaptive { .. } => "error",
            Self::Reversible { .. } => "reversible",
            Self::Held(_) => "held",
        }
    }
}

/// An event function, and which of its zeros are events.
#[derive(Clone, Debug)]
pub struct EventFunction {
    /// A tape of (t, y, z, λ, params) with one value.
    pub tape: Tape,
    /// Which of its zeros count, and how many of them end the run.
    pub rule: EventRule,
    /// Whether it depends on λ.
    pub needs_lam: bool,
    /// The law of the state after it, and a tape of (t, y, z, params) → de/dt where it is a function of (t, y) alone.
    pub reset: Option<(Law, Option<Tape>)>,
    /// Whether it is a switch of the forces, at which controlled steps end; switches come behind all events.
    pub is_switch: bool,
    /// Its derivatives, where it is to be differentiated.
    pub slopes: Option<EventSlopes>,
}

/// Events, and times to record.
#[derive(Clone, Debug)]
pub struct Detection {
    /// The order of the method, which the polynomials of events follow.
    pub order: usize,
    /// Times of the records, if they are given.
    pub times: Option<Vec<f64>>,
    /// The events.
    pub events: Vec<EventFunction>,
}

/// Derivatives of a system by time and parameters.
#[derive(Clone, Debug)]
pub enum SystemSensitivity {
    /// Sensitivity of a mechanical system.
    Mechanical(Arc<Sensitivity>),
    /// Sensitivity of a semi-explicit system.
    SemiExplicit(Arc<SemiExplicitSensitivity>),
}

impl SystemSensitivity {
    /// Number of time and parameters.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::Mechanical(own) => own.width(),
            Self::SemiExplicit(own) => own.width(),
        }
    }
}

/// Tangents to carry along a run.
#[derive(Clone, Debug)]
pub struct Tangents {
    /// Derivatives of the system that the method does not need itself.
    pub sensitivity: SystemSensitivity,
    /// Changes of y, then of z unless that follows from y, at the start: a row for each direction, and those of members
    /// one after another.
    pub start: [Vec<f64>; 2],
    /// Changes of the start time and of the parameters, a row for each direction.
    pub tau: Vec<f64>,
    /// By which part of themselves the steps become longer, for each direction.
    pub stretch: Vec<f64>,
    /// The derivatives of a step, of methods of the α family.
    pub alpha: Option<AlphaSlopes>,
}

/// The quantities that a record has of a state.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// A tape (t, y, z, params) → quantities.
    pub tape: Arc<Tape>,
    /// Whether the states are recorded too.
    pub states: bool,
    /// Angles that are continued from step to step and recorded too.
    pub turning: Option<Turning>,
}

/// A run, or an ensemble of runs.
#[derive(Clone, Debug)]
pub struct Job {
    /// y, z and for the α methods perhaps a: rows of the members, one after another.
    pub start: Vec<Vec<f64>>,
    /// A row of parameters for each member, or one for all.
    pub params: Vec<f64>,
    /// The number of members of an ensemble; none for a single run.
    pub members: Option<usize>,
    /// Parts of steps to be made instead, each from the start of a member.
    pub parts: Vec<Part>,
    /// The ends of the run, its steps and records; only the ends are used where steps are not equal.
    pub span: Span,
    /// The control of the steps.
    pub control: Control,
    /// Whether an α method meets its tolerance by reversible steps, for systems whose energy nothing changes.
    pub is_reversible: bool,
    /// Whether the steps are differentiated, so that their equations are solved to roundoff.
    pub is_differentiated: bool,
    /// Events and times to record, if there are any.
    pub detection: Option<Detection>,
    /// Tangents, if they are wanted.
    pub tangents: Option<Tangents>,
    /// The quantities of a record.
    pub recorded: Recorded,
    /// The watch of each step.
    pub watched: Watched,
    /// Threads of an ensemble.
    pub threads: usize,
}
