//! Columns of numbers that a program looks values up in, however many there are.
//!
//! A function by pieces finds the piece of its argument by where pieces start, and looks the coefficients of that piece
//! up. Both operations have the number of a column as their second operand, a constant.

use std::sync::Arc;

/// A column of numbers, shared between tapes.
pub type Column = Arc<[f64]>;

/// How many of the increasing numbers of a column are not above x; 0 if x is no number.
#[inline]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked when the tape was made
#[allow(clippy::cast_precision_loss)] // memory has not so many numbers
pub(super) fn search(columns: &[Column], column: f64, x: f64) -> f64 {
    let starts = &columns[column as usize];
    starts.partition_point(|start| *start <= x) as f64
}

/// The number at a place of a column; NaN where it has none.
#[inline]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked when the tape was made
pub(super) fn entry(columns: &[Column], column: f64, place: f64) -> f64 {
    let numbers = &columns[column as usize];
    numbers.get(place as usize).copied().unwrap_or(f64::NAN)
}
