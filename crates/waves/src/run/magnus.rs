//! Magnus methods that fit their Hamiltonians, and what they come to.

use super::method::Method;
use super::prepared::{Prepared, Single, shears};
use crate::method::{MagnusCost, MagnusSteps, Nodes, ShearProgram, TermBounds};
use crate::problem::Hamiltonian;
use liouville_base::run::StartError;
use std::sync::Arc;

impl Prepared {
    /// A Magnus method for this Hamiltonian.
    pub(super) fn magnus(
        method: Method,
        hamiltonian: &Hamiltonian,
        is_back: bool,
    ) -> Result<Self, StartError> {
        Ok(match method {
            Method::Magnus {
                scheme,
                coefficients,
                theta,
                tolerance,
                bounds,
            } => Self::Magnus {
                nodes: nodes(scheme)?,
                exponential: ShearProgram {
                    program: shears(&coefficients, is_back),
                    theta,
                    tolerance,
                },
                bounds: fitting(bounds, hamiltonian)?,
            },
            Method::MagnusSeries {
                scheme,
                rate,
                tolerance,
                bounds,
            } => Self::MagnusSeries {
                nodes: nodes(scheme)?,
                rate,
                tolerance,
                bounds: fitting(bounds, hamiltonian)?,
            },
            Method::MagnusSteps {
                scheme,
                tolerance,
                bounds,
                breaks,
            } => Self::Single(Single::MagnusSteps {
                nodes: nodes(scheme)?,
                tolerance,
                bounds: fitting(bounds, hamiltonian)?,
                breaks,
            }),
            _ => return Err(StartError::invalid("a Magnus method")),
        })
    }
}

/// The Magnus method of an order with so many exponentials.
fn nodes((order, exponentials): (usize, usize)) -> Result<Nodes, StartError> {
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
        scheme,
        tolerance,
        bounds,
        ..
    } = method
    else {
        return Err(StartError::invalid("the steps of a Magnus method"));
    };
    let bounds = fitting(bounds, hamiltonian)?;
    let cost = MagnusSteps::cost(hamiltonian, nodes(scheme)?, bounds, tolerance, times);
    Ok(cost.unwrap_or_else(|| unreachable!("bounds that have been checked"))?)
}

/// Bounds, if they are those of the terms of H.
pub(super) fn fitting(
    bounds: TermBounds,
    hamiltonian: &Hamiltonian,
) -> Result<TermBounds, StartError> {
    if bounds.is_fitting(hamiltonian.terms().len()) {
        Ok(bounds)
    } else {
        Err(StartError::invalid(
            "parts are all terms, each with its bounds",
        ))
    }
}
