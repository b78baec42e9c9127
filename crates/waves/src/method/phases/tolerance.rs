//! The tolerance of a split operator.

/// Where functions of time are looked at before a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Looks {
    /// Start and end of the run; equal where they are not looked at.
    pub span: (f64, f64),
    /// Times of samples, at which splines bend, in order.
    pub knots: Vec<f64>,
    /// Other times, in order.
    pub outputs: Vec<f64>,
    /// Densities at which a potential of the density is looked at, where it depends on time.
    pub densities: Vec<f64>,
}

/// The tolerance of a split operator, and what is known of its steps.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitTolerance {
    /// Order of the splitting.
    pub order: usize,
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// Half the width of the spectrum.
    pub beta: f64,
    /// How large energies of the state are, by which roundings of its phases are counted.
    pub energy: f64,
    /// The first step; infinite where a pilot is to find it.
    pub first: f64,
    /// The longest step.
    pub longest: f64,
    /// Times at which steps end besides, in the order of the run.
    pub breaks: Vec<f64>,
    /// Where functions of time are looked at.
    pub looks: Looks,
}
