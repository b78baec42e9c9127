//! Programs for people to read.

use crate::convert::Tape;
use liouville_base::tape::Operation;
use pyo3::prelude::*;

/// An operation's name, the register that it writes, and those that it reads.
type Line = (&'static str, usize, Vec<usize>);

fn line((op, out, operands): Operation) -> Line {
    (op.name(), out, operands[..op.arity()].to_vec())
}

/// A tape as registers of constants with their values, instructions that run once for its parameters, and instructions
/// of every evaluation. Registers of the inputs come first, then those of the outputs. Terms are left out.
#[pyfunction]
pub(crate) fn listing(tape: PyRef<'_, Tape>) -> (Vec<(usize, f64)>, Vec<Line>, Vec<Line>) {
    let found = tape.0.listing();
    let lines = |operations: Vec<Operation>| operations.into_iter().map(line).collect();
    (found.constants, lines(found.once), lines(found.each))
}
