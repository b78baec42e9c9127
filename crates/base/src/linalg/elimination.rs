//! LU of nearly symmetric sparse matrices without pivoting, in an order that keeps them sparse.

use super::fill::Plan;
use super::{Pattern, Singular};

/// Pivots below this fraction of what stood in their place are roundoff.
const TINY: f64 = 1e3 * f64::EPSILON;

/// Updates an unknown may cost on average; other methods take matrices of more fill-in.
const MOST_UPDATES: usize = 40;

/// Plan and factors of matrices of one pattern.
#[derive(Clone, Debug)]
pub(super) struct Elimination {
    plan: Plan,
    /// The diagonal, the columns below it, the rows right of it, step by step.
    values: Vec<f64>,
    x: Vec<f64>,
}

impl Elimination {
    /// Memory for matrices with symmetric pattern `couplings`; `None` where fill-in would be large.
    pub(super) fn new(couplings: &Pattern) -> Option<Self> {
        let plan = Plan::new(couplings, MOST_UPDATES)?;
        Some(Self {
            x: vec![0.0; couplings.shape().0],
            values: vec![0.0; plan.places()],
            plan,
        })
    }

    /// Where the entries of `couplings` are among the values.
    pub(super) fn slots(&self, couplings: &Pattern) -> Vec<usize> {
        self.plan.slots(couplings)
    }

    /// The values to factor, to be overwritten.
    #[inline]
    pub(super) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// The diagonal and what is below it, to be overwritten; [`Elimination::mirror`] does the rest.
    #[inline]
    pub(super) fn lower_mut(&mut self) -> &mut [f64] {
        let above = self.values.len() - self.plan.neighbours.len();
        &mut self.values[..above]
    }

    /// Writes above the diagonal what stands below.
    pub(super) fn mirror(&mut self) {
        let (m, count) = (self.plan.order.len(), self.plan.neighbours.len());
        self.values.copy_within(m..m + count, m + count);
    }

    /// Factors the matrix that was written to the values.
    ///
    /// # Errors
    /// The first unknown whose pivot is at roundoff.
    pub(super) fn factor(&mut self) -> Result<(), Singular> {
        let m = self.plan.order.len();
        let (diagonal, beside) = self.values.split_at_mut(m);
        self.x.copy_from_slice(diagonal);
        let (lower, upper) = beside.split_at_mut(self.plan.neighbours.len());
        let mut targets = &self.plan.targets[..];
        let mut start = 0;
        for (step, end) in self.plan.starts[1..].iter().enumerate() {
            let at = start..*end as usize;
            start = at.end;
            let pivot = diagonal[step];
            if !(pivot.abs() > TINY * self.x[step].abs() && pivot.is_finite()) {
                let column = self.plan.order[step] as usize;
                return Err(Singular { column });
            }
            let inverse = 1.0 / pivot;
            diagonal[step] = inverse; // solves multiply
            let (now, rest) = targets.split_at(at.len() * at.len());
            targets = rest;
            if let [target] = now {
                let factor = lower[at.start] * inverse;
                lower[at.start] = factor;
                diagonal[*target as usize] -= factor * upper[at.start];
                continue;
            }
            for (row, targets) in at.clone().zip(now.chunks_exact(at.len().max(1))) {
                let factor = lower[row] * inverse;
                lower[row] = factor;
                for (col, target) in at.clone().zip(targets) {
                    let change = factor * upper[col];
                    let target = *target as usize;
                    if let Some(place) = target.checked_sub(m) {
                        match place.checked_sub(lower.len()) {
                            Some(place) => upper[place] -= change,
                            None => lower[place] -= change,
                        }
                    } else {
                        diagonal[target] -= change;
                    }
                }
            }
        }
        Ok(())
    }

    /// Solves `A x = b` in place.
    pub(super) fn solve(&mut self, b: &mut [f64]) {
        let m = self.plan.order.len();
        let (diagonal, beside) = self.values.split_at(m);
        let (lower, upper) = beside.split_at(self.plan.neighbours.len());
        let x = &mut self.x[..];
        for (x, unknown) in x.iter_mut().zip(&self.plan.order) {
            *x = b[*unknown as usize];
        }
        let mut start = 0;
        for (step, end) in self.plan.starts[1..].iter().enumerate() {
            let at = start..*end as usize;
            start = at.end;
            let value = x[step];
            match (&self.plan.neighbours[at.clone()], &lower[at]) {
                ([k], [factor]) => x[*k as usize] -= factor * value,
                (neighbours, factors) => {
                    for (k, factor) in neighbours.iter().zip(factors) {
                        x[*k as usize] -= factor * value;
                    }
                }
            }
        }
        for (step, start) in self.plan.starts[..m].iter().enumerate().rev() {
            let at = *start as usize..self.plan.starts[step + 1] as usize;
            let mut value = x[step];
            match (&self.plan.neighbours[at.clone()], &upper[at]) {
                ([k], [factor]) => value -= factor * x[*k as usize],
                (neighbours, factors) => {
                    for (k, factor) in neighbours.iter().zip(factors) {
                        value -= factor * x[*k as usize];
                    }
                }
            }
            value *= diagonal[step];
            x[step] = value;
            b[self.plan.order[step] as usize] = value;
        }
    }
}
