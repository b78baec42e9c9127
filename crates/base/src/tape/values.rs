//! Value numbering: repeated computations of a program are made once.
//!
//! Values are numbered in the order in which they are first computed. Two lines have the same value
//! when they load the same input, hold the same bits, or apply the same operation to the same values,
//! sums and products in either order. The second is left out, and slots are given out anew: one that
//! is not read any more is the next to be written. Source: briggs1997.

use super::{Line, Op};
use std::collections::HashMap;

/// The definition of a value; operands by their numbers.
#[derive(PartialEq, Eq, Hash)]
enum Origin {
    Input(usize, usize),
    Constant(u64),
    Applied(usize, usize, usize),
}

/// Returns a checked program with each value computed once, and its slots numbered from zero.
pub(super) fn once(lines: &[Line]) -> Vec<Line> {
    let mut lines = numbered(lines);
    share_slots(&mut lines);
    lines
}

/// The program without repetitions, where every value has a slot of its own: its number.
fn numbered(lines: &[Line]) -> Vec<Line> {
    let mut numbers = HashMap::new();
    let mut held = vec![0; lines.len()];
    let mut kept = Vec::with_capacity(lines.len());
    for line in lines {
        let (mut line, slot, origin) = match *line {
            Line::Input {
                slot,
                group,
                element,
            } => (*line, slot, Origin::Input(group, element)),
            Line::Constant { slot, value } => (*line, slot, Origin::Constant(value.to_bits())),
            Line::Apply { op, slot, a, b } => {
                let a = held[a];
                let b = if op.arity() == 2 { held[b] } else { a };
                let commutes = matches!(op, Op::Add | Op::Mul);
                let (low, high) = if commutes && b < a { (b, a) } else { (a, b) };
                let origin = Origin::Applied(op as usize, low, high);
                (Line::Apply { op, slot, a, b }, slot, origin)
            }
            Line::Output { element, slot } => {
                let slot = held[slot];
                kept.push(Line::Output { element, slot });
                continue;
            }
        };
        let next = numbers.len();
        held[slot] = *numbers.entry(origin).or_insert(next);
        if held[slot] == next {
            if let Some(own) = target(&mut line) {
                *own = next;
            }
            kept.push(line);
        }
    }
    kept
}

/// Gives values that are never needed at the same time the same slots.
fn share_slots(lines: &mut [Line]) {
    let mut last = vec![0; lines.len()];
    for (k, line) in lines.iter().enumerate() {
        for value in reads(line) {
            last[value] = k;
        }
    }
    let (mut slots, mut free, mut count) = (vec![0; lines.len()], Vec::new(), 0);
    for (k, line) in lines.iter_mut().enumerate() {
        for value in reads(line) {
            if last[value] == k {
                last[value] = usize::MAX; // once, where it is both operands
                free.push(slots[value]);
            }
        }
        if let Line::Apply { a, b, .. } = line {
            (*a, *b) = (slots[*a], slots[*b]);
        }
        if let Line::Output { slot, .. } = line {
            *slot = slots[*slot];
        }
        if let Some(slot) = target(line) {
            let value = *slot;
            *slot = free.pop().unwrap_or_else(|| {
                count += 1;
                count - 1
            });
            slots[value] = *slot;
            if last[value] == 0 {
                free.push(*slot);
            }
        }
    }
}

/// The slots that a line reads.
fn reads(line: &Line) -> impl Iterator<Item = usize> + use<> {
    let (a, b) = match *line {
        Line::Apply { a, b, .. } => (Some(a), Some(b)),
        Line::Output { slot, .. } => (Some(slot), None),
        Line::Input { .. } | Line::Constant { .. } => (None, None),
    };
    a.into_iter().chain(b)
}

/// The slot that a line writes.
fn target(line: &mut Line) -> Option<&mut usize> {
    match line {
        Line::Input { slot, .. } | Line::Constant { slot, .. } | Line::Apply { slot, .. } => {
            Some(slot)
        }
        Line::Output { .. } => None,
    }
}
