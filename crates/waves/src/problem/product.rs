//! Products by a function of the user.

/// A real symmetric matrix, known by its products only.
pub trait Product: Send + Sync {
    /// Number of rows.
    fn size(&self) -> usize;

    /// Whether it is a function of time, H(t), of which products are with Σ a H(t) over pairs (a, t).
    fn is_driven(&self) -> bool {
        false
    }

    /// Makes `out` the product with `x`, at these pairs (a, t) where it is driven; false where the function failed, which
    /// keeps the reason.
    fn multiply(&self, nodes: &[(f64, f64)], x: &[f64], out: &mut [f64]) -> bool;
}
