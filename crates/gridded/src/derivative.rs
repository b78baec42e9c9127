//! The derivative of a flow by the coordinates at its start, at the solution of its equation:
//!
//!     (1 − σ F_eu) du1 = du0 + h U' dc + σ (F_ee de0 + F_ec dc)
//!     de1 = de0 + h V' dc − σ (F_ue de0 + F_uu du1 + F_uc dc)
//!
//! with σ = ∓h, U and V the mean flow of u and e, and c the frozen coordinates.

use crate::basis::MOST;
use crate::plane::{Fault, PlaneFlow};

/// Derivatives of F at a place, and the mean flow.
#[derive(Default)]
struct Jet {
    by_e: f64,
    by_u: f64,
    by_ee: f64,
    by_eu: f64,
    by_uu: f64,
    /// F_ec and F_uc for each frozen coordinate c.
    by_ec: [f64; 2],
    by_uc: [f64; 2],
    /// The mean flow, and its derivatives by the last frozen coordinate.
    mean: [f64; 2],
    mean_by_c: [f64; 2],
}

impl PlaneFlow<'_> {
    /// The derivatives of v and w `after` the flow by the frozen coordinates, v and w before it, and then by its length.
    ///
    /// # Errors
    /// A coordinate is outside its axis.
    pub fn derivative(&self, after: [f64; 2]) -> Result<[[f64; 5]; 2], Fault> {
        let (plane, h) = (self.plane, self.h);
        let frozen = plane.frozen();
        let (e, u) = (usize::from(self.is_adjoint), usize::from(!self.is_adjoint));
        let sign = if self.is_adjoint { 1.0 } else { -1.0 };
        let sigma = sign * h;
        let jet = self.jet(after[u])?;
        let mut rows = [[0.0; 5]; 2];
        for column in 0..frozen + 3 {
            let (mut of_u, mut of_e) = (0.0, 0.0);
            if column < frozen {
                of_u += sigma * jet.by_ec[column];
                of_e -= sigma * jet.by_uc[column];
            } else if column == frozen + e {
                of_u += sigma * jet.by_ee;
                of_e += 1.0 - sigma * jet.by_eu;
            } else if column == frozen + u {
                of_u += 1.0;
            } else {
                of_u += jet.mean[u] + sign * jet.by_e;
                of_e += jet.mean[e] - sign * jet.by_u;
            }
            if column + 1 == frozen {
                of_u += h * jet.mean_by_c[u];
                of_e += h * jet.mean_by_c[e];
            }
            of_u /= 1.0 - sigma * jet.by_eu;
            rows[u][column] = of_u;
            rows[e][column] = of_e - sigma * jet.by_uu * of_u;
        }
        Ok(rows)
    }

    /// The derivatives of F where the implicit coordinate is `now`.
    fn jet(&self, now: f64) -> Result<Jet, Fault> {
        let (plane, frozen) = (self.plane, self.plane.frozen());
        let is_adjoint = self.is_adjoint;
        // one function, whose value is 1, in place of a frozen coordinate that there is not
        let mut weights = [[[0.0; MOST]; 3]; 2];
        let (mut cells, mut counts, mut strides) = ([0; 2], [1; 2], [0; 2]);
        weights[0][0][0] = 1.0;
        weights[1][0][0] = 1.0;
        let mut stride = plane.axes[0].functions() * plane.axes[1].functions();
        for k in (0..frozen).rev() {
            let basis = &plane.frozen[k];
            let place = basis.locate(self.x[k]).ok_or(Fault::Outside(k))?;
            (weights[k], cells[k], counts[k]) = (basis.jet(place), place.cell, basis.degree() + 1);
            strides[k] = stride;
            stride *= basis.functions();
        }
        let explicit = usize::from(is_adjoint);
        let mut places = [plane.axes[0].find(now), plane.axes[1].find(now)];
        let fixed = plane.axes[explicit].locate(self.x[frozen + explicit]);
        places[explicit] = fixed.ok_or(Fault::Outside(frozen + explicit))?;
        let jets = [0, 1].map(|k| plane.axes[k].jet(places[k]));
        let width = plane.axes[1].functions();
        let mut found = Jet::default();
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                let first = (cells[0] + i) * strides[0] + (cells[1] + j) * strides[1];
                let corner = first + places[0].cell * width + places[1].cell;
                let by = |p: usize, q: usize| {
                    let rows = jets[0][p][..=plane.axes[0].degree()].iter().enumerate();
                    rows.map(|(a, value)| {
                        let own = &plane.coefficients[corner + a * width..];
                        let own = own[..=plane.axes[1].degree()].iter();
                        value * own.zip(&jets[1][q]).map(|(c, x)| c * x).sum::<f64>()
                    })
                    .sum::<f64>()
                };
                let of = |p: usize, q: usize| if is_adjoint { by(q, p) } else { by(p, q) };
                let weight = weights[0][0][i] * weights[1][0][j];
                found.by_e += weight * of(1, 0);
                found.by_u += weight * of(0, 1);
                found.by_ee += weight * of(2, 0);
                found.by_eu += weight * of(1, 1);
                found.by_uu += weight * of(0, 2);
                let slopes = [
                    weights[0][1][i] * weights[1][0][j],
                    weights[0][0][i] * weights[1][1][j],
                ];
                for k in 0..frozen {
                    found.by_ec[k] += slopes[k] * of(1, 0);
                    found.by_uc[k] += slopes[k] * of(0, 1);
                }
            }
        }
        for k in 0..2 {
            let mean = &plane.mean[k];
            found.mean[k] = mean[0];
            if mean.len() > 1 {
                let last = frozen - 1;
                let own = &mean[cells[last]..][..counts[last]];
                let sum = |functions: &[f64]| own.iter().zip(functions).map(|(c, x)| c * x).sum();
                found.mean[k] = sum(&weights[last][0]);
                found.mean_by_c[k] = sum(&weights[last][1]);
            }
        }
        Ok(found)
    }
}
