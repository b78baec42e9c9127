//! Coefficients of the α family: Newmark's, Hilber–Hughes–Taylor's and the generalised-α methods.
//!
//!     (1 − α_m) a1 + α_m a0 = (1 − α_f) φ1 + α_f φ0
//!     y1 = y0 + h z0 + h² ((1/2 − β) a0 + β a1),   z1 = z0 + h ((1 − γ) a0 + γ a1)
//!
//! with φ the accelerations at the ends of a step, and a_n ≈ φ(t_n + Δ h), Δ = α_m − α_f. Sources:
//! newmark1959, hilber1977, chung1993.

/// The four numbers of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alpha {
    /// Weight of a0 against a1.
    pub alpha_m: f64,
    /// Weight of φ0 against φ1.
    pub alpha_f: f64,
    /// Weight of a1 in the velocity.
    pub gamma: f64,
    /// Weight of a1 in the position.
    pub beta: f64,
}

impl Alpha {
    /// Where a lies: a_n ≈ φ(t_n + Δ h).
    pub fn delta(&self) -> f64 {
        self.alpha_m - self.alpha_f
    }

    /// da1/dφ1
    pub fn share(&self) -> f64 {
        (1.0 - self.alpha_f) / (1.0 - self.alpha_m)
    }

    /// γ/β: the change of the velocity by a1 over that of the position.
    pub fn slope(&self) -> f64 {
        self.gamma / self.beta
    }

    /// The local error of y is this times h² (a1 − a0), to leading order, less its reactions' share.
    pub fn error_constant(&self) -> f64 {
        1.0 / 6.0 - self.delta() / 2.0 - self.beta
    }
}
