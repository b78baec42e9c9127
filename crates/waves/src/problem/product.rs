//! Products by a function of the user.

/// A real symmetric matrix, known by its products only.
pub trait Product: Send + Sync {
    /// Number of rows.
    fn size(&self) -> usize;

    /// Makes `out` the product with `x`; false where the function failed, which keeps the reason.
    fn multiply(&self, x: &[f64], out: &mut [f64]) -> bool;
}
