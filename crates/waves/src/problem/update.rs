//! What becomes of a product, for whatever a window sees.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::Update;
use liouville_base::simd::{Number, SimdView};

/// Updates `out[to]`, or what follows it, by a product with what is at `x[from]`.
#[inline(always)]
pub(super) fn update<W: SimdView>(
    window: W,
    by: Update,
    (x, from): (&[W::Stored], usize),
    (out, to): (&mut [W::Stored], usize),
    product: W::Number,
) {
    let mut change = product.scaled(by.factor);
    if by.diagonal != 0.0 {
        change = change + window.load(x, from).scaled(by.diagonal);
    }
    if by.keep != 0.0 {
        change = window.load(out, to).scaled(by.keep) + change;
    }
    window.store(out, to, change);
}
