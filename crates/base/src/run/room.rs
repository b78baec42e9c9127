//! Memory for records: reserved fallibly, so that a lack of it is an error instead of an abort.

use crate::error::StepError;
use std::hint::black_box;

/// Bytes that must remain for the rest of the program, which allocates without a check; at least half of those of the
/// array, since results are copies of it.
const SPARE: usize = 1 << 26;

/// Arrays of fewer bytes are reserved without a check of what remains.
const LITTLE: usize = 1 << 19;

/// Where memory is short, an array grows by this part of its length instead of doubling.
const SHORT: usize = 8;

/// Makes room for so many further numbers, and for more to come where there is memory for it.
///
/// # Errors
/// There is no memory for them, or none to spare beside them; the array is as it was.
pub fn reserve(x: &mut Vec<f64>, more: usize) -> Result<(), StepError> {
    if x.capacity() - x.len() >= more {
        return Ok(());
    }
    let sizes = [x.len().max(more), (x.len() / SHORT).max(more)];
    if sizes.into_iter().any(|size| has_grown(x, size)) {
        Ok(())
    } else {
        Err(StepError::NoMemory)
    }
}

/// Makes an array of so many equal numbers, in the memory that it has where that is enough.
///
/// # Errors
/// There is no memory for them; the array is empty.
pub fn resize<T: Copy>(x: &mut Vec<T>, length: usize, value: T) -> Result<(), StepError> {
    x.clear();
    x.try_reserve_exact(length)
        .map_err(|_| StepError::NoMemory)?;
    x.resize(length, value);
    Ok(())
}

/// Makes an array of these parts, one after another, in the memory that it has where that is enough.
///
/// # Errors
/// There is no memory for them; the array is empty.
pub fn refill<T: Copy>(x: &mut Vec<T>, parts: &[&[T]]) -> Result<(), StepError> {
    x.clear();
    let length = parts.iter().map(|part| part.len()).sum();
    x.try_reserve_exact(length)
        .map_err(|_| StepError::NoMemory)?;
    for part in parts {
        x.extend_from_slice(part);
    }
    Ok(())
}

/// Refuses work that takes so many bytes in arrays that are made without a check, where there is no memory for them.
///
/// # Errors
/// There is none.
pub fn check(bytes: usize) -> Result<(), StepError> {
    if bytes < LITTLE || is_available(bytes) {
        Ok(())
    } else {
        Err(StepError::NoMemory)
    }
}

/// The same of the bytes that must remain for the rest of the program.
///
/// # Errors
/// There are fewer.
pub fn check_spare() -> Result<(), StepError> {
    check(SPARE)
}

/// Makes room for exactly so many further numbers, unless nothing would be left to spare.
fn has_grown(x: &mut Vec<f64>, more: usize) -> bool {
    if x.try_reserve_exact(more).is_err() {
        return false;
    }
    let size = size_of::<f64>() * x.capacity();
    let is_spare = size < LITTLE || is_available(SPARE.max(size / 2));
    if !is_spare {
        x.shrink_to_fit();
    }
    is_spare
}

/// Whether there is memory for so many bytes.
fn is_available(bytes: usize) -> bool {
    let mut probe = Vec::<u8>::new();
    let is_there = probe.try_reserve_exact(bytes).is_ok();
    // an unused allocation may be optimised away
    black_box(&mut probe);
    is_there
}
