//! The first pass over an incoming program: every index checked, every value's home decided.

use super::{Line, Op, TapeError};

/// The instruction that wrote a slot's current value, and whether that depends on parameters alone.
#[derive(Clone, Copy)]
struct Held {
    writer: usize,
    fixed: bool,
}

/// Refuses an operation whose column is not a constant below `columns`.
fn check_column(
    lines: &[Line],
    at: (usize, Op),
    number: Held,
    columns: usize,
) -> Result<(), TapeError> {
    let (line, op) = at;
    if !matches!(op, Op::Search | Op::Entry) {
        return Ok(());
    }
    #[allow(clippy::cast_precision_loss)] // memory has not so many columns
    match lines[number.writer] {
        Line::Constant { value, .. }
            if value.fract() == 0.0 && (0.0..columns as f64).contains(&value) =>
        {
            Ok(())
        }
        _ => Err(TapeError::Column {
            line,
            op: op.name(),
            columns,
        }),
    }
}

/// A tape of more inputs and outputs than this is no model.
const MOST_VALUES: usize = 1 << 26;

/// The result of the first pass over a program.
pub(super) struct SlotPlan {
    /// How many slots the program has.
    pub(super) slots: usize,
    /// How many values need a register that is never reused.
    pub(super) pinned: usize,
    /// For each line, whether its value depends on parameters alone.
    pub(super) fixed: Vec<bool>,
    /// For each operation, the output its result may be written to at once.
    pub(super) direct: Vec<Option<usize>>,
}

impl SlotPlan {
    pub(super) fn new(
        inputs: &[usize],
        outputs: usize,
        lines: &[Line],
        columns: usize,
    ) -> Result<Self, TapeError> {
        let total = inputs
            .iter()
            .try_fold(outputs, |sum, size| sum.checked_add(*size));
        if total.is_none_or(|total| total > MOST_VALUES) {
            return Err(TapeError::TooLarge);
        }
        let mut plan = Self {
            slots: 0,
            pinned: 0,
            fixed: vec![false; lines.len()],
            direct: vec![None; lines.len()],
        };
        let mut slots: Vec<Option<Held>> = vec![None; lines.len()];
        let mut written = vec![false; outputs];
        for (k, line) in lines.iter().enumerate() {
            let write = |slots: &mut [Option<Held>], slot: usize, fixed| {
                let out_of_range = TapeError::Slot {
                    line: k,
                    slot,
                    lines: lines.len(),
                };
                let place = slots.get_mut(slot).ok_or(out_of_range)?;
                *place = Some(Held { writer: k, fixed });
                Ok(slot + 1)
            };
            let read = |slots: &[Option<Held>], slot: usize| {
                slots
                    .get(slot)
                    .copied()
                    .flatten()
                    .ok_or(TapeError::Unwritten { line: k, slot })
            };
            match *line {
                Line::Input {
                    slot,
                    group,
                    element,
                } => {
                    if inputs.get(group).is_none_or(|size| element >= *size) {
                        return Err(TapeError::Input {
                            line: k,
                            group,
                            element,
                        });
                    }
                    plan.slots =
                        plan.slots
                            .max(write(&mut slots, slot, group + 1 == inputs.len())?);
                }
                Line::Constant { slot, .. } => {
                    plan.pinned += 1;
                    plan.slots = plan.slots.max(write(&mut slots, slot, true)?);
                }
                Line::Apply { op, slot, a, b } => {
                    let mut fixed = read(&slots, a)?.fixed;
                    if op.arity() == 2 {
                        let second = read(&slots, b)?;
                        check_column(lines, (k, op), second, columns)?;
                        fixed &= second.fixed;
                    }
                    plan.fixed[k] = fixed;
                    plan.pinned += usize::from(fixed);
                    plan.slots = plan.slots.max(write(&mut slots, slot, fixed)?);
                }
                Line::Output { element, slot } => {
                    let held = read(&slots, slot)?;
                    match written.get_mut(element) {
                        None => {
                            return Err(TapeError::Output {
                                line: k,
                                element,
                                outputs,
                            });
                        }
                        Some(true) => return Err(TapeError::Twice { line: k, element }),
                        Some(unwritten) => *unwritten = true,
                    }
                    plan.fixed[k] = held.fixed;
                    let target = &mut plan.direct[held.writer];
                    if matches!(lines[held.writer], Line::Apply { .. }) && target.is_none() {
                        *target = Some(element);
                    }
                }
            }
        }
        match written.iter().position(|written| !written) {
            Some(element) => Err(TapeError::Missing { element }),
            None => Ok(plan),
        }
    }
}
