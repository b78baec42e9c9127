//! Semi-explicit differential-algebraic systems of index 2:
//!
//!     y' = f(t, y, z),   0 = k(t, y),   k_y f_z invertible
//!
//! with n coordinates y and as many unknowns z as constraints, l. The hidden constraint is
//! 0 = w(t, y, z) := k_t + k_y f, from which z follows. Source: jay2006.

mod algebraic;
mod dynamics;
mod model;
mod point;
mod restart;
mod sensitivity;

pub use algebraic::Algebraic;
pub use dynamics::RateSolver;
pub use model::SemiExplicitModel;
pub use point::SemiExplicitPoint;
pub use restart::SemiExplicitRestart;
pub use sensitivity::{
    SemiExplicitSensitivity, SemiExplicitSensitivityModel, SemiExplicitSensitivityPatterns,
};

use liouville_base::linalg::Pattern;
use liouville_base::tape::Tape;
use liouville_problem::Mismatch;

/// The tapes and patterns of a semi-explicit system; the tapes' last input is always the parameters.
#[derive(Clone, Debug)]
pub struct SemiExplicit {
    /// Number of coordinates.
    pub n: usize,
    /// Number of constraints, and of unknowns z.
    pub l: usize,
    /// f is linear in z.
    pub is_linear: bool,
    /// (t, y, z) → f
    pub field: Tape,
    /// (t, y, z) → f_y, f_z
    pub field_jacobian: Tape,
    /// (t, y) → k
    pub constraint: Tape,
    /// (t, y) → k_y
    pub constraint_jacobian: Tape,
    /// (t, y, z) → w, f
    pub hidden: Tape,
    /// (t, y, z) → w_z, f_z
    pub hidden_jacobian: Tape,
    /// (t, y, z) → `w_t + w_y f`, `f_t + f_y f`
    pub rates: Tape,
    /// Where the derivatives are not zero.
    pub patterns: SemiExplicitPatterns,
}

/// The sparsity of each derivative.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct SemiExplicitPatterns {
    pub f_y: Pattern,
    pub f_z: Pattern,
    pub k_y: Pattern,
    pub w_z: Pattern,
}

impl SemiExplicit {
    /// The system, once its parts are seen to fit together.
    ///
    /// # Errors
    /// The first tape or pattern that has not the size the others imply.
    pub fn checked(self) -> Result<Self, Mismatch> {
        let (n, l, at) = (self.n, self.l, &self.patterns);
        let params = self.field.inputs().last().copied().unwrap_or(0);
        let (point, place): (&[usize], &[usize]) = (&[1, n, l, params], &[1, n, params]);
        let tapes = [
            ("field", &self.field, point, n),
            (
                "field_jacobian",
                &self.field_jacobian,
                point,
                at.f_y.len() + at.f_z.len(),
            ),
            ("constraint", &self.constraint, place, l),
            (
                "constraint_jacobian",
                &self.constraint_jacobian,
                place,
                at.k_y.len(),
            ),
            ("hidden", &self.hidden, point, l + n),
            (
                "hidden_jacobian",
                &self.hidden_jacobian,
                point,
                at.w_z.len() + at.f_z.len(),
            ),
            ("rates", &self.rates, point, l + n),
        ];
        for (name, tape, inputs, outputs) in tapes {
            check(name, tape.inputs().len(), inputs.len())?;
            for (found, wanted) in tape.inputs().iter().zip(inputs) {
                check(name, *found, *wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        let patterns = [
            ("f_y", &at.f_y, (n, n)),
            ("f_z", &at.f_z, (n, l)),
            ("k_y", &at.k_y, (l, n)),
            ("w_z", &at.w_z, (l, l)),
        ];
        for (name, pattern, (rows, cols)) in patterns {
            check(name, pattern.shape().0, rows)?;
            check(name, pattern.shape().1, cols)?;
        }
        Ok(self)
    }
}

fn check(name: &'static str, found: usize, wanted: usize) -> Result<(), Mismatch> {
    if found == wanted {
        Ok(())
    } else {
        Err(Mismatch {
            name,
            found,
            wanted,
        })
    }
}

/// Where a semi-explicit system is, with the low part its compensated sum carries.
#[derive(Debug, PartialEq)]
pub struct SemiExplicitState {
    /// Coordinates.
    pub y: Vec<f64>,
    /// z at `y` by the hidden constraint; methods use it as a guess only.
    pub z: Vec<f64>,
    /// The rounding error of `y`.
    pub y_low: Vec<f64>,
}

liouville_base::clone_in_place!(SemiExplicitState { y, z, y_low });

liouville_base::checkpoint!(SemiExplicitState { y, z, y_low });
liouville_base::recorded!([] SemiExplicitState { y, z, y_low });
