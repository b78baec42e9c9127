//! A program: instructions one after another, or in the steps of its batches.

use super::execute::{Instr, Strided, execute, execute_strided};
use crate::real::Real;
use crate::simd::dispatch_simd_long;
use std::ops::Range;

/// The instructions of an evaluation.
#[derive(Clone, Debug)]
pub(super) enum Program {
    /// One after another.
    Plain(Vec<Instr>),
    /// In steps, which refer to the instructions that are written out.
    Batched {
        instrs: Vec<Instr>,
        steps: Vec<ProgramStep>,
    },
}

/// Instructions that run as one.
#[derive(Clone, Debug)]
pub(super) enum ProgramStep {
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
                    ProgramStep::Strided(batch) => batch.count,
                    ProgramStep::Mixed(_) => 0,
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
fn run_steps<R: Real>(instrs: &[Instr], steps: &[ProgramStep], registers: &mut [R]) {
    dispatch_simd_long::<R, _>(
        registers.len(),
        #[inline(always)]
        || {
            for step in steps {
                match step {
                    ProgramStep::Mixed(range) => execute(&instrs[range.clone()], registers),
                    ProgramStep::Strided(batch) => execute_strided(batch, registers),
                }
            }
        },
    );
}
