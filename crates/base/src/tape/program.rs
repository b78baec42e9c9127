//! A program: instructions one after another, or in the steps of its batches.

use super::execute::{Instr, Strided, execute, execute_strided};
use crate::real::Real;
use crate::simd::dispatch_simd_long;
use std::ops::Range;

/// What an evaluation runs.
#[derive(Clone, Debug)]
pub(super) enum Program {
    /// One after another.
    Plain(Vec<Instr>),
    /// In steps, which refer to the instructions that are written out.
    Batched {
        instrs: Vec<Instr>,
        steps: Vec<Step>,
    },
}

/// What is done at once.
#[derive(Clone, Debug)]
pub(super) enum Step {
    /// These instructions, one after another.
    Mixed(Range<usize>),
    /// Instructions that are not written out.
    Strided(Strided),
}

impl Program {
    /// Number of instructions.
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Plain(instrs) => instrs.len(),
            Self::Batched { instrs, steps } => {
                let strided = steps.iter().map(|step| match step {
                    Step::Strided(batch) => batch.count,
                    Step::Mixed(_) => 0,
                });
                instrs.len() + strided.sum::<usize>()
            }
        }
    }

    /// Runs the program over the registers that `Tape::new` laid out for it.
    #[inline]
    pub(super) fn run<R: Real>(&self, registers: &mut [R]) {
        match self {
            Self::Plain(instrs) => execute(instrs, registers),
            Self::Batched { instrs, steps } => run_steps(instrs, steps, registers),
        }
    }
}

#[inline(never)]
fn run_steps<R: Real>(instrs: &[Instr], steps: &[Step], registers: &mut [R]) {
    dispatch_simd_long::<R, _>(
        registers.len(),
        #[inline(always)]
        || {
            for step in steps {
                match step {
                    Step::Mixed(range) => execute(&instrs[range.clone()], registers),
                    Step::Strided(batch) => execute_strided(batch, registers),
                }
            }
        },
    );
}
