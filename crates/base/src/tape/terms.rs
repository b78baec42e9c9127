//! Additions to the values of a program: constants, and terms in given matrices.

use super::TapeError;
use crate::linalg::Rows;
use crate::real::Real;
use std::ops::Range;
use std::sync::Arc;

/// A term in one input group x, added to the outputs of a program.
#[derive(Clone, Debug)]
pub enum Term {
    /// `outputs[first..] += factor * A x`
    Product {
        /// The first output.
        first: usize,
        /// The input group.
        group: usize,
        /// The factor.
        factor: f64,
        /// A, shared between tapes.
        matrix: Arc<Rows>,
    },
    /// `outputs[output] += factor * xᵀ A x`
    Form {
        /// The output.
        output: usize,
        /// The input group.
        group: usize,
        /// The factor.
        factor: f64,
        /// A, shared between tapes.
        matrix: Arc<Rows>,
    },
}

/// Checked terms, and their relation to the outputs of the program.
#[derive(Clone, Debug)]
pub(super) struct Terms {
    /// Constants of outputs that the program writes once.
    once: Vec<(usize, f64)>,
    /// Constants of outputs that every evaluation writes.
    each: Vec<(usize, f64)>,
    /// Outputs written once that terms are added to; their values are kept behind all registers.
    kept: Vec<usize>,
    /// The terms, each with its input's registers.
    added: Vec<(Term, Range<usize>)>,
}

impl Terms {
    /// Checks terms against the groups' registers; `fixed` says which outputs the program writes once.
    pub(super) fn new(
        groups: &[Range<usize>],
        fixed: &[bool],
        constant: &[f64],
        terms: Vec<Term>,
    ) -> Result<Self, TapeError> {
        let outputs = fixed.len();
        if !constant.is_empty() && constant.len() != outputs {
            return Err(TapeError::Constant {
                found: constant.len(),
                outputs,
            });
        }
        let mut added = vec![false; outputs];
        let mut placed = Vec::with_capacity(terms.len());
        for (term, value) in terms.into_iter().enumerate() {
            let (first, group, matrix, is_form) = match &value {
                Term::Product {
                    first,
                    group,
                    matrix,
                    ..
                } => (*first, *group, matrix, false),
                Term::Form {
                    output,
                    group,
                    matrix,
                    ..
                } => (*output, *group, matrix, true),
            };
            let Some(registers) = groups.get(group).cloned() else {
                return Err(TapeError::Group { term, group });
            };
            let ((rows, cols), size) = (matrix.shape(), registers.len());
            if cols != size || (is_form && rows != size) {
                return Err(TapeError::Shape {
                    term,
                    rows,
                    cols,
                    size,
                });
            }
            let count = if is_form { 1 } else { rows };
            let Some(end) = first.checked_add(count).filter(|end| *end <= outputs) else {
                return Err(TapeError::Range {
                    term,
                    first,
                    count,
                    outputs,
                });
            };
            added[first..end].fill(true);
            placed.push((value, registers));
        }
        let constants = || {
            constant
                .iter()
                .copied()
                .enumerate()
                .filter(|(_, x)| *x != 0.0)
        };
        Ok(Self {
            once: constants().filter(|(k, _)| fixed[*k]).collect(),
            each: constants().filter(|(k, _)| !fixed[*k]).collect(),
            kept: (0..outputs).filter(|k| fixed[*k] && added[*k]).collect(),
            added: placed,
        })
    }

    /// How many registers they need.
    pub(super) fn registers(&self) -> usize {
        self.kept.len()
    }

    /// Whether an evaluation has nothing to add.
    pub(super) fn is_empty(&self) -> bool {
        self.each.is_empty() && self.added.is_empty()
    }

    /// Completes the outputs that the program has written once.
    pub(super) fn bind<R: Real>(&self, outputs: &mut [R], kept: &mut [R]) {
        for &(output, value) in &self.once {
            outputs[output] += R::splat(value);
        }
        for (&output, kept) in self.kept.iter().zip(kept) {
            *kept = outputs[output];
        }
    }

    /// Adds to the outputs of the program.
    pub(super) fn add<R: Real>(&self, inputs: &[R], outputs: &mut [R], kept: &[R]) {
        for (&output, kept) in self.kept.iter().zip(kept) {
            outputs[output] = *kept;
        }
        for &(output, value) in &self.each {
            outputs[output] += R::splat(value);
        }
        for (term, registers) in &self.added {
            let x = &inputs[registers.clone()];
            match term {
                Term::Product {
                    first,
                    factor,
                    matrix,
                    ..
                } => matrix.multiply_add(*factor, x, &mut outputs[*first..]),
                Term::Form {
                    output,
                    factor,
                    matrix,
                    ..
                } => outputs[*output] += R::splat(*factor) * matrix.form(x),
            }
        }
    }
}
