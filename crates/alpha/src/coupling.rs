//! How position and velocity at the end of a step depend on its unknowns.

use super::Reactions;
use liouville_base::tableau::Alpha;

/// How y1 and z1 depend on the unknowns, with c = da1/dφ1, and A0 and A1 apart where there are any:
///
///     y1 = … + h² (y_φ φ1 + y_0 A0 + y_1 A1),      y_φ = β c,  y_0 = (1 − b)/2,  y_1 = b/2
///     z1 = … + h (z_φ φ1 + A0/2 + A1/2),           z_φ = γ c
///     z_i = 1/2 − (γ/β) y_i
#[derive(Clone, Copy, Debug)]
pub(super) struct Coupling {
    /// y_φ, z_φ
    pub(super) phi: [f64; 2],
    /// y_0, y_1
    pub(super) y: [f64; 2],
    /// z_0, z_1
    pub(super) z: [f64; 2],
    /// γ/β
    pub(super) slope: f64,
}

impl Coupling {
    pub(super) fn new(weights: Alpha, reactions: Reactions) -> Self {
        let c = weights.share();
        let slope = weights.gamma / weights.beta;
        let y = match reactions {
            Reactions::Extended { b, .. } => [(1.0 - b) / 2.0, b / 2.0],
            Reactions::Position => [0.0; 2],
        };
        Self {
            phi: [weights.beta * c, weights.gamma * c],
            y,
            z: y.map(|y| 0.5 - slope * y),
            slope,
        }
    }

    /// x_0 and x_1 from y_0 x_0 + y_1 x_1 and z_0 x_0 + z_1 x_1.
    pub(super) fn apart(&self, by_y: f64, by_z: f64) -> [f64; 2] {
        let determinant = self.y[0] * self.z[1] - self.y[1] * self.z[0]; // (1 − 2 b)/4
        [
            (self.z[1] * by_y - self.y[1] * by_z) / determinant,
            (self.y[0] * by_z - self.z[0] * by_y) / determinant,
        ]
    }
}
