//! The derivative of whole steps, flow by flow.

use super::{LinearFlow, LinearFlows, LinearMap};
use crate::problem::Split;
use crate::volume::Volume;
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::tableau::Scheme;
use std::sync::Arc;

/// The most elementary maps of a step that are kept; flows beyond them are made twice.
const MOST_KEPT: usize = 1 << 22;

/// Steps of a composition, with the derivative of each of their flows.
#[derive(Clone, Debug)]
pub(crate) struct LinearSteps {
    program: Vec<Flow>,
    flows: LinearFlows,
    map: LinearMap,
    beyond: LinearMap,
    /// The variables that each piece changes, and what they were before the flows of a step that are not kept.
    changed: Vec<Vec<usize>>,
    before: Vec<f64>,
}

impl LinearSteps {
    /// Of `split`, composed by `scheme`; derivatives are by coefficients and the step size too, where that is wanted.
    pub(crate) fn new(split: &Arc<Split>, scheme: &Scheme, has_coefficients: bool) -> Self {
        let volume = Volume::<f64>::new(Arc::clone(split), false);
        let pieces = split.pieces().iter();
        Self {
            program: Composed::new(volume, scheme).program().to_vec(),
            flows: LinearFlows::new(Arc::clone(split), has_coefficients),
            map: LinearMap::default(),
            beyond: LinearMap::default(),
            changed: pieces.map(|piece| piece.changes(split.n())).collect(),
            before: Vec::new(),
        }
    }

    /// How many numbers a vector has: those of the variables, the constants, and intermediate results.
    pub(crate) fn width(&self) -> usize {
        self.flows.width()
    }

    /// Where the numbers of coefficients and the step size are.
    pub(crate) fn constants(&self) -> std::ops::Range<usize> {
        self.flows.constants()
    }

    /// Takes `width` tangents y, whose numbers are side by side, through a step of h from t, which begins at `x`.
    ///
    /// # Errors
    /// A flow cannot be made, or its end is not finite.
    pub(crate) fn push(
        &mut self,
        (t, h): (f64, f64),
        x: &[f64],
        width: usize,
        y: &mut [f64],
    ) -> Result<(), StepError> {
        self.flows.x().copy_from_slice(x);
        for flow in &self.program {
            self.map.clear();
            self.flows.linearise(linear(flow, t, h), &mut self.map)?;
            self.map.apply(width, y);
        }
        match self.flows.x().iter().position(|x| !x.is_finite()) {
            Some(index) => Err(StepError::Overflow {
                index,
                member: 0,
                t: t + h,
            }),
            None => Ok(()),
        }
    }

    /// Takes a cotangent y back through a step of h from t, which begins at `x`.
    ///
    /// # Errors
    /// A flow cannot be made.
    pub(crate) fn pull(
        &mut self,
        (t, h): (f64, f64),
        x: &[f64],
        y: &mut [f64],
    ) -> Result<(), StepError> {
        let Self {
            program,
            flows,
            map,
            beyond,
            changed,
            before,
        } = self;
        flows.x().copy_from_slice(x);
        map.clear();
        before.clear();
        let mut kept = 0;
        for flow in &*program {
            if map.len() < MOST_KEPT {
                flows.linearise(linear(flow, t, h), map)?;
                kept += 1;
                continue;
            }
            let x = flows.x();
            before.extend(changed[flow.part].iter().map(|variable| x[*variable]));
            beyond.clear();
            flows.linearise(linear(flow, t, h), beyond)?;
        }
        for flow in program[kept..].iter().rev() {
            let changed = &changed[flow.part];
            let rest = before.len() - changed.len();
            put_back(changed, &before[rest..], flows.x());
            beyond.clear();
            flows.linearise(linear(flow, t, h), beyond)?;
            put_back(changed, &before[rest..], flows.x());
            before.truncate(rest);
            beyond.apply_transposed(y);
        }
        map.apply_transposed(y);
        Ok(())
    }
}

/// A flow of a step.
fn linear(flow: &Flow, t: f64, h: f64) -> LinearFlow {
    LinearFlow {
        part: flow.part,
        is_adjoint: flow.is_adjoint,
        t: t + flow.offset * h,
        h: flow.weight * h,
        weight: flow.weight,
    }
}

fn put_back(changed: &[usize], before: &[f64], x: &mut [f64]) {
    for (variable, before) in changed.iter().zip(before) {
        x[*variable] = *before;
    }
}
