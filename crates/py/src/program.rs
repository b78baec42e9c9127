//! A tape's program as bytes, a few for each line, for pickled tapes.
//!
//! A line is one byte for its kind, 0 an input, 1 a constant, 2 an output and 3 + k operation k of
//! [`Op::ALL`], then its indices in LEB128 and, of a constant, eight bytes of its value.

use liouville_base::tape::{Line, Op};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

const INPUT: u8 = 0;
const CONSTANT: u8 = 1;
const OUTPUT: u8 = 2;
const FIRST: usize = 3;

/// Writes a program down.
pub(crate) fn packed(lines: &[Line]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for line in lines {
        match *line {
            Line::Input {
                slot,
                group,
                element,
            } => write(&mut bytes, INPUT, &[slot, group, element]),
            Line::Constant { slot, value } => {
                write(&mut bytes, CONSTANT, &[slot]);
                bytes.extend(value.to_le_bytes());
            }
            Line::Output { element, slot } => write(&mut bytes, OUTPUT, &[slot, element]),
            Line::Apply { op, slot, a, b } => {
                let code = Op::ALL.iter().position(|known| *known == op);
                #[allow(clippy::cast_possible_truncation)] // there are some forty
                let kind = (FIRST + code.unwrap_or_default()) as u8;
                write(&mut bytes, kind, &[slot, a, b]);
            }
        }
    }
    bytes
}

/// Reads what [`packed`] wrote; indices are checked where a tape is made of it.
pub(crate) fn unpacked(bytes: &[u8]) -> PyResult<Vec<Line>> {
    let mut reader = Reader(bytes);
    let mut lines = Vec::new();
    while !reader.0.is_empty() {
        lines.push(reader.line().ok_or_else(malformed)?);
    }
    Ok(lines)
}

fn malformed() -> PyErr {
    PyValueError::new_err("these bytes are no program of a tape")
}

#[allow(clippy::cast_possible_truncation)] // seven bits at a time
fn write(bytes: &mut Vec<u8>, kind: u8, indices: &[usize]) {
    bytes.push(kind);
    for &index in indices {
        let mut rest = index;
        while rest >= 0x80 {
            bytes.push(0x80 | (rest & 0x7f) as u8);
            rest >>= 7;
        }
        bytes.push(rest as u8);
    }
}

/// The bytes left to read.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn line(&mut self) -> Option<Line> {
        let kind = self.byte()?;
        let slot = self.index()?;
        Some(match kind {
            INPUT => Line::Input {
                slot,
                group: self.index()?,
                element: self.index()?,
            },
            CONSTANT => {
                let (value, rest) = self.0.split_first_chunk()?;
                self.0 = rest;
                let value = f64::from_le_bytes(*value);
                Line::Constant { slot, value }
            }
            OUTPUT => Line::Output {
                element: self.index()?,
                slot,
            },
            code => Line::Apply {
                op: *Op::ALL.get(usize::from(code) - FIRST)?,
                slot,
                a: self.index()?,
                b: self.index()?,
            },
        })
    }

    fn byte(&mut self) -> Option<u8> {
        let (byte, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*byte)
    }

    fn index(&mut self) -> Option<usize> {
        let mut found = 0_usize;
        for shift in (0..usize::BITS).step_by(7) {
            let byte = self.byte()?;
            let part = usize::from(byte & 0x7f);
            if part << shift >> shift != part {
                return None;
            }
            found |= part << shift;
            if byte < 0x80 {
                return Some(found);
            }
        }
        None
    }
}
