//! Products that somebody else makes.

/// A real symmetric matrix, known by its products only.
pub trait Product: Send + Sync {
    /// Number of rows.
    fn size(&self) -> usize;

    /// Makes `out` the product with `x`; false where that failed, for reasons that the maker knows.
    fn multiply(&self, x: &[f64], out: &mut [f64]) -> bool;
}
