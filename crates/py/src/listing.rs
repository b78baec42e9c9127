//! Programs for people to read.

use crate::convert::Tape;
use liouville_base::tape::Operation;
use pyo3::prelude::*;

/// An operation's name, the register that it writes, and those that it reads.
type Line = (&'static str, usize, Vec<usize>);

fn line((op, out, operands): Operation) -> Line {
    (op.name(), out, operands[..op.arity()].to_vec())
}

/// What a tape runs: registers of constants with their values, what runs once for its parameters, and what every
/// evaluation runs. Registers of the inputs come first, then those of the outputs. Terms are not among them.
#[pyfunction]
pub(crate) fn listing(tape: PyRef<'_, Tape>) -> (Vec<(usize, f64)>, Vec<Line>, Vec<Line>) {
    let found = tape.0.listing();
    let lines = |operations: Vec<Operation>| operations.into_iter().map(line).collect();
    (found.constants, lines(found.once), lines(found.each))
}
