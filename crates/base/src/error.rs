//! Errors of a step, in numbers; the front end adds the user's names.

/// A function of the user's model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// v(t, y, z)
    Velocity,
    /// p(t, y, z)
    Momentum,
    /// f(t, y, z)
    Force,
    /// y' = f(t, y, z) of a system without momenta.
    Field,
    /// r(t, y, λ)
    Reaction,
    /// g(t, y)
    Constraint,
    /// g_t + g_y v
    Hidden,
    /// k(t, y, z); its index counts the holonomic constraints first
    Nonholonomic,
    /// A derivative of one of them.
    Derivative,
    /// The rate at which forces without a potential put energy in.
    Power,
    /// An invariant or another quantity to be recorded.
    Observable,
    /// A function whose zeros are events.
    Event,
    /// The state after an event.
    Reset,
}

impl Quantity {
    /// The name of the quantity in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Momentum => "momentum",
            Self::Force => "force",
            Self::Field => "field",
            Self::Reaction => "reaction",
            Self::Constraint => "constraint",
            Self::Hidden => "hidden constraint",
            Self::Nonholonomic => "nonholonomic constraint",
            Self::Derivative => "derivative",
            Self::Power => "power",
            Self::Observable => "observable",
            Self::Event => "event",
            Self::Reset => "reset",
        }
    }
}

/// Why an event has no derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// Its function does not change along the motion where it is zero.
    Flat,
    /// Its function jumps over zero.
    Jump,
    /// The zeros of its function are on two surfaces, one before and one after it.
    Kink,
}

impl Obstacle {
    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Jump => "jump",
            Self::Kink => "kink",
        }
    }
}

/// Why a step could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum StepError {
    #[error("{} {index} is not finite at t = {t}", quantity.name())]
    NotFinite {
        quantity: Quantity,
        index: usize,
        t: f64,
    },
    #[error("the mass matrix p_z is singular in coordinate {coordinate}")]
    SingularMass { coordinate: usize },
    #[error("the gradients of constraints {constraints:?} are linearly dependent")]
    DependentConstraints { constraints: Vec<usize> },
    #[error("constraint {constraint} no longer follows from the others")]
    Contradiction { constraint: usize },
    #[error("the hidden constraint does not determine unknown {unknown}")]
    SingularHidden { unknown: usize },
    #[error("no multipliers were found, in which reactions are not linear")]
    NoMultipliers,
    #[error("the Newton matrix of the stages is singular")]
    SingularNewton,
    #[error(
        "the iteration did not converge: after {iterations} the last correction was {size:e} of the state"
    )]
    NotConverged { iterations: usize, size: f64 },
    #[error(
        "a step of {h:e} is too large for coordinate {coordinate}: solutions lead on to {solved:e} only"
    )]
    StepTooLarge {
        h: f64,
        coordinate: usize,
        solved: f64,
    },
    #[error(
        "a step of {h:e} would be needed, below the least: the last one had {error:e} of the tolerance"
    )]
    StepTooSmall { h: f64, error: f64 },
    #[error("the monitor is {value} and changes at the rate {rate} at t = {t}")]
    Monitor { value: f64, rate: f64, t: f64 },
    #[error("the flow of piece {piece} reaches infinity within the step from t = {t}")]
    Singular { piece: usize, member: usize, t: f64 },
    #[error("function {function} of piece {piece} is not finite at t = {t}")]
    Function {
        piece: usize,
        function: usize,
        member: usize,
        t: f64,
    },
    #[error("variable {index} is not finite at t = {t}")]
    Overflow { index: usize, member: usize, t: f64 },
    #[error("variable {index} has left the grid at t = {t}")]
    Outside { index: usize, member: usize, t: f64 },
    #[error("the norm is {norm} at t = {t}, where it was {start}")]
    Norm { norm: f64, start: f64, t: f64 },
    #[error("a share of {share:e} of psi is in the upper third of the wave numbers at t = {t}")]
    Unresolved { share: f64, t: f64 },
    #[error("the step at t = {t} spans {theta} of the spectrum, the method takes {most}")]
    Spectrum { theta: f64, most: f64, t: f64 },
    #[error("event {event} at t = {t} has a reset that leads to no state of the system")]
    Reset {
        event: usize,
        t: f64,
        /// The constraint that is missed, and by how much; none where the constraints block the impact.
        missed: Option<(Quantity, usize, f64)>,
    },
    #[error("event {event} at t = {t} has no derivative")]
    Undifferentiable { event: usize, t: f64, why: Obstacle },
    #[error("interrupted")]
    Interrupted,
    #[error("there is no memory for more records")]
    NoMemory,
    #[error("member {member}: {error}")]
    Member {
        member: usize,
        error: Box<StepError>,
    },
}

impl StepError {
    /// The same error of one member among several.
    pub fn member(&self) -> Option<usize> {
        match self {
            Self::Singular { member, .. }
            | Self::Function { member, .. }
            | Self::Overflow { member, .. }
            | Self::Outside { member, .. }
            | Self::Member { member, .. } => Some(*member),
            _ => None,
        }
    }

    /// The error without its member.
    #[must_use]
    pub fn itself(self) -> Self {
        match self {
            Self::Member { error, .. } => *error,
            own => own,
        }
    }

    /// The error as one of a group of members that begins with this one.
    #[must_use]
    pub fn of_member(mut self, first: usize) -> Self {
        match &mut self {
            Self::Singular { member, .. }
            | Self::Function { member, .. }
            | Self::Overflow { member, .. }
            | Self::Outside { member, .. }
            | Self::Member { member, .. } => {
                *member += first;
                self
            }
            _ => Self::Member {
                member: first,
                error: Box::new(self),
            },
        }
    }
}
