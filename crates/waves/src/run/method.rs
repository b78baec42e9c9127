//! Methods for Schrödinger equations, with all that a run needs beside its Hamiltonian.

use crate::method::{
    BegunRun, Driven, Eigenpairs, MagnusCost, MagnusSteps, MagnusTolerance, Nodes, Phases,
    Processor, ShearProgram, SplitSteps, SplitTolerance, TermBounds, Wave, Windows, bessel,
};
use crate::problem::Hamiltonian;
use liouville_base::composition::Flow;
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::run::StartError;
use liouville_base::tableau::{Purpose, Stable, Turn, split_program};
use std::sync::Arc;

/// Error of a processor, relative to the state.
const PROCESSOR_ERROR: f64 = 1e-13;

/// A method and its numbers; `tolerance` is how far the norm may be off, relatively.
pub enum Method {
    /// Shears of q and p in turn, by H less the middle of its spectrum.
    Shears {
        /// The shears of a step forwards.
        program: Vec<Flow>,
        /// The middle of the spectrum.
        shift: f64,
        /// Tolerance of the norm.
        tolerance: f64,
    },
    /// The same between a processor and its inverse.
    Processed {
        /// The shears of a step forwards.
        program: Vec<Flow>,
        /// The processor.
        processor: Processor,
        /// The middle of the spectrum.
        shift: f64,
        /// Tolerance of the norm.
        tolerance: f64,
    },
    /// Chebyshev series, one for the outputs of each window.
    Chebyshev {
        /// Bounds of the spectrum.
        bounds: (f64, f64),
        /// Error allowed in a unit of time.
        rate: f64,
        /// Tolerance of the norm.
        tolerance: f64,
        /// How many outputs each series makes.
        windows: Windows,
    },
    /// Products with the eigenvectors of H.
    Diagonal {
        /// Energies and eigenvectors.
        levels: Arc<Eigenpairs>,
        /// Of the norm.
        tolerance: f64,
    },
    /// A Krylov space for each step, by Arnoldi's recurrence of an H that absorbs.
    Lanczos {
        /// Its dimension.
        dimension: usize,
        /// Error allowed in a unit of time.
        rate: f64,
        /// Tolerance of the norm.
        tolerance: f64,
    },
    /// Exponentials of sums of H at nodes, each by shears.
    Magnus {
        /// Nodes and weights.
        nodes: Nodes,
        /// The shears.
        exponential: ShearProgram,
        /// Bounds of the spectra of all parts of H.
        bounds: TermBounds,
    },
    /// The same with exponentials by Chebyshev series.
    MagnusSeries {
        /// Nodes and weights.
        nodes: Nodes,
        /// Error of all exponentials allowed in a unit of time.
        rate: f64,
        /// Tolerance of the norm.
        tolerance: f64,
        /// Bounds of the spectra of all parts of H.
        bounds: TermBounds,
    },
    /// The same with steps as long as a tolerance allows.
    MagnusSteps {
        /// Nodes and weights.
        nodes: Nodes,
        /// Its tolerance.
        tolerance: MagnusTolerance,
        /// Bounds of the spectra of all parts of H.
        bounds: TermBounds,
        /// Times at which steps end besides, in the order of the run.
        breaks: Vec<f64>,
    },
    /// Series in time for H(t).
    Driven {
        /// Parts of H and the tolerance.
        driven: Driven,
        /// Times of the outputs.
        times: Vec<f64>,
    },
    /// A splitting of T + V on a grid.
    Splitting {
        /// The flows of a step.
        program: Vec<Flow>,
        /// Phases of the flows.
        phases: Box<Phases>,
        /// The tolerance by which steps are chosen; none where they are given.
        tolerance: Option<SplitTolerance>,
        /// The beginning of a run that may go on.
        begun: BegunRun,
    },
}

/// The beginning of a run by a split operator.
pub struct Beginning {
    /// For the run that goes on.
    pub begun: BegunRun,
    /// The flows of T that it took.
    pub flows: usize,
    /// The time that it reached.
    pub reached: f64,
    /// The length of the next step.
    pub next: f64,
}

impl Method {
    /// Shears with the longest stable steps and a processor, for steps of `theta` over half the width of the spectrum.
    ///
    /// # Errors
    /// There are none of this order and number, or no processor for so long steps.
    pub fn processed(
        (order, stages): (usize, usize),
        shift: f64,
        theta: f64,
        tolerance: f64,
    ) -> Result<Self, StartError> {
        let stable = Stable::find(Purpose::Stability, order, stages).ok_or_else(|| {
            StartError::invalid("there is no such method for the longest stable steps")
        })?;
        let too_long =
            || StartError::invalid("a step so near to the limit of stability has no processor");
        Ok(Self::Processed {
            program: shears(&stable.coefficients),
            processor: Processor::new(stable, theta, PROCESSOR_ERROR).ok_or_else(too_long)?,
            shift,
            tolerance,
        })
    }

    /// The splitting of this name, of a Hamiltonian on a grid.
    ///
    /// # Errors
    /// There is none, or H is another one.
    pub fn splitting(
        name: &str,
        hamiltonian: &Arc<Hamiltonian>,
        norm: f64,
        tolerance: Option<SplitTolerance>,
        begun: BegunRun,
    ) -> Result<Self, StartError> {
        let phases = Phases::new(hamiltonian.clone(), norm);
        let no_grid = || StartError::invalid("H is no kinetic energy and a potential");
        Ok(Self::Splitting {
            program: turns(name)?.into_iter().map(flow).collect(),
            phases: phases.ok_or_else(no_grid)?.into(),
            tolerance,
            begun,
        })
    }

    /// The beginning of a run by a split operator to a tolerance from this state, with so many flows of
    /// T or more, up to its first output. A step that fails is left to the run, which tells why.
    ///
    /// # Errors
    /// It is another method, or it was interrupted.
    pub fn begin(
        self,
        interval: (f64, f64),
        flows: usize,
        psi: [Vec<f64>; 2],
    ) -> Result<Beginning, StartError> {
        let Self::Splitting {
            program,
            phases,
            tolerance: Some(tolerance),
            ..
        } = self
        else {
            return Err(StartError::invalid("a split operator to a tolerance"));
        };
        let ([q, p], first) = (psi, tolerance.first);
        let steps = SplitSteps::new(*phases, program, tolerance)?;
        match steps.begin_run(interval, flows, Wave::new(q, p)) {
            Err(StepError::Interrupted) => Err(StepError::Interrupted.into()),
            Err(_) => Ok(Beginning {
                begun: BegunRun::default(),
                flows: 0,
                reached: interval.0,
                next: first,
            }),
            Ok((steps, begun, reached)) => Ok(Beginning {
                begun,
                flows: steps.stats().evaluations / 2,
                reached,
                next: steps.next(),
            }),
        }
    }

    /// The same for this Hamiltonian and outputs at these times; shears back in time are undone, last to first.
    pub(super) fn fitted(
        mut self,
        hamiltonian: &Hamiltonian,
        outputs: Vec<f64>,
        is_back: bool,
    ) -> Result<Self, StartError> {
        let (is_linear, is_absorbing) = (
            hamiltonian.nonlinearity().is_none(),
            !hamiltonian.absorber().is_empty(),
        );
        let is_taken = match &self {
            Self::Splitting { .. } => true,
            Self::Lanczos { .. } => is_linear && !(is_absorbing && is_back),
            _ => is_linear && !is_absorbing,
        };
        if !is_taken {
            return Err(StartError::invalid(
                "a method for a linear equation that keeps the norm",
            ));
        }
        if let Self::Diagonal { levels, .. } = &self
            && levels.count() != hamiltonian.places()
        {
            return Err(StartError::invalid("a level for each component"));
        }
        if let Some(bounds) = self.bounds() {
            check_parts(bounds, hamiltonian)?;
        }
        match &mut self {
            Self::Shears { program, .. }
            | Self::Processed { program, .. }
            | Self::Magnus {
                exponential: ShearProgram { program, .. },
                ..
            } if is_back => program.reverse(),
            Self::Chebyshev { windows, .. } => {
                let unfit = || StartError::invalid("windows have all outputs, each at least one");
                *windows = std::mem::take(windows).of(outputs).ok_or_else(unfit)?;
            }
            Self::Driven { times, .. } => *times = outputs,
            _ => {}
        }
        Ok(self)
    }

    /// Bounds of the parts of H(t), of methods that have some.
    fn bounds(&self) -> Option<&TermBounds> {
        match self {
            Self::Magnus { bounds, .. }
            | Self::MagnusSeries { bounds, .. }
            | Self::MagnusSteps { bounds, .. }
            | Self::Driven {
                driven: Driven { bounds, .. },
                ..
            } => Some(bounds),
            _ => None,
        }
    }

    /// Whether it steps single wave functions only.
    pub(super) fn is_single(&self) -> bool {
        matches!(
            self,
            Self::Diagonal { .. }
                | Self::Lanczos { .. }
                | Self::Driven { .. }
                | Self::MagnusSteps { .. }
                | Self::Splitting { .. }
        )
    }

    /// The most states of which a stepper has memory.
    pub(super) fn states(&self) -> usize {
        match self {
            Self::Chebyshev { windows, .. } => windows.most(),
            _ => 1,
        }
    }

    /// The part of all energies that is left out of H.
    pub(super) fn shift(&self) -> f64 {
        match self {
            Self::Shears { shift, .. } | Self::Processed { shift, .. } => *shift,
            _ => 0.0,
        }
    }
}

/// Refuses bounds that are not those of the parts of H.
fn check_parts(bounds: &TermBounds, hamiltonian: &Hamiltonian) -> Result<(), StartError> {
    let unfit = || StartError::invalid("parts are all terms, each with its bounds");
    let is_fitting = bounds.is_fitting(hamiltonian.terms().len());
    is_fitting.then_some(()).ok_or_else(unfit)
}

/// Shears of q and p in turn, with these coefficients.
pub fn shears(coefficients: &[f64]) -> Vec<Flow> {
    let shear = |(k, weight): (usize, &f64)| Flow {
        part: k % 2,
        is_adjoint: false,
        weight: *weight,
        offset: 0.0,
    };
    coefficients.iter().enumerate().map(shear).collect()
}

fn flow(turn: Turn) -> Flow {
    Flow {
        part: usize::from(turn.is_kick),
        is_adjoint: false,
        weight: turn.weight,
        offset: turn.offset,
    }
}

/// The flows of the splitting of this name.
///
/// # Errors
/// There is none.
pub fn turns(name: &str) -> Result<Vec<Turn>, StartError> {
    let unknown = || StartError::Invalid(format!("there is no splitting {name:?}"));
    split_program(name).ok_or_else(unknown)
}

/// The Magnus method of an order with so many exponentials.
///
/// # Errors
/// There is none.
pub fn nodes((order, exponentials): (usize, usize)) -> Result<Nodes, StartError> {
    let unknown = || StartError::invalid("there is no such Magnus method");
    Nodes::find(order, exponentials).ok_or_else(unknown)
}

/// The cost of a Magnus method to a tolerance; see [`MagnusSteps::cost`].
///
/// # Errors
/// It is another method, its bounds do not fit, or H is not finite.
pub fn magnus_cost(
    hamiltonian: &Arc<Hamiltonian>,
    method: Method,
    times: &[f64],
) -> Result<MagnusCost, StartError> {
    let Method::MagnusSteps {
        nodes,
        tolerance,
        bounds,
        ..
    } = method
    else {
        return Err(StartError::invalid("the steps of a Magnus method"));
    };
    check_parts(&bounds, hamiltonian)?;
    let cost = MagnusSteps::cost(hamiltonian, nodes, bounds, tolerance, times);
    Ok(cost.unwrap_or_else(|| unreachable!("bounds that have been checked"))?)
}

/// The products that a processor takes, or none if it takes too many.
pub fn processor_degree(order: usize, stages: usize, theta: f64) -> Option<usize> {
    let method = Stable::find(Purpose::Stability, order, stages)?;
    Processor::new(method, theta, PROCESSOR_ERROR).map(|processor| processor.degree())
}

/// The degree of the Chebyshev series of e^{−iθx} on [−1, 1] that leaves out at most `tolerance`.
pub fn chebyshev_degree(theta: f64, tolerance: f64) -> usize {
    bessel::series(theta, tolerance).len() - 1
}
