//! Rows of a product with a sparse matrix.

use super::{Block, Update};
use crate::linalg::Rows;
use crate::vector::{Machine, Stored};

/// Updates a block of rows.
pub(super) fn act<S: Stored>(rows: &Rows, _: Machine, update: Update, block: Block<'_, S>) {
    let Block { row, out, place, x } = block;
    for (k, out) in out.iter_mut().enumerate() {
        let i = row + k;
        for member in 0..S::MEMBERS {
            let product = rows.entries(i).fold(0.0, |sum, (col, value)| {
                sum + value * x[col - place].member(member)
            });
            let change = update.factor * product + update.diagonal * x[i - place].member(member);
            out.set_member(member, update.keep * out.member(member) + change);
        }
    }
}
