//! The derivative of a flow by the coordinates at its start, at the solution of its equation:
//!
//!     (1 − σ F_eu) du1 = du0 + h U' dc + σ (F_ee de0 + F_ec dc)
//!     de1 = de0 + h V' dc − σ (F_ue de0 + F_uu du1 + F_uc dc)
//!
//! with σ = ∓h, U and V the mean flow of u and e, and c the frozen coordinates.

use crate::basis::MOST;
use crate::equation::Fault;
use crate::flow::PlaneFlow;
use crate::plane::Plane;
use crate::spline::Spline;
use crate::traced::{Memory, Traced};

/// Derivatives of F at a place, and the mean flow.
#[derive(Default)]
struct Jet {
    by_e: f64,
    by_u: f64,
    by_ee: f64,
    by_eu: f64,
    by_uu: f64,
    /// The mean flow, and its derivatives by the last frozen coordinate.
    mean: [f64; 2],
    mean_by_c: [f64; 2],
}

impl PlaneFlow<'_> {
    /// The derivatives of v and w `after` the flow by the frozen coordinates, v and w before it, then by its length, and
    /// by the parameters: `columns` of two numbers each.
    ///
    /// # Errors
    /// A coordinate is outside its axis.
    pub fn derivative(
        &mut self,
        after: [f64; 2],
        columns: &mut Vec<[f64; 2]>,
    ) -> Result<(), Fault> {
        let (frozen, h) = (self.plane.frozen(), self.h);
        let (e, u) = (usize::from(self.is_adjoint), usize::from(!self.is_adjoint));
        let sign = if self.is_adjoint { 1.0 } else { -1.0 };
        let sigma = sign * h;
        columns.clear();
        columns.resize(frozen + 3 + self.plane.params().len(), [0.0; 2]);
        let jet = match self.plane {
            Plane::Spline(spline) => spline.jet(self.x, self.is_adjoint, after[u], columns)?,
            Plane::Traced(traced) => {
                let mut x = self.x;
                x[frozen + u] = after[u];
                traced.derivatives(x, self.is_adjoint, self.memory, columns)
            }
        };
        for (number, column) in columns.iter_mut().enumerate() {
            // F_ec and F_uc of a frozen coordinate or a parameter c
            let [by_ec, by_uc] = *column;
            let (mut of_u, mut of_e) = (0.0, 0.0);
            if number == frozen + e {
                of_u += sigma * jet.by_ee;
                of_e += 1.0 - sigma * jet.by_eu;
            } else if number == frozen + u {
                of_u += 1.0;
            } else if number == frozen + 2 {
                of_u += jet.mean[u] + sign * jet.by_e;
                of_e += jet.mean[e] - sign * jet.by_u;
            } else {
                of_u += sigma * by_ec;
                of_e -= sigma * by_uc;
            }
            if number + 1 == frozen {
                of_u += h * jet.mean_by_c[u];
                of_e += h * jet.mean_by_c[e];
            }
            of_u /= 1.0 - sigma * jet.by_eu;
            column[u] = of_u;
            column[e] = of_e - sigma * jet.by_uu * of_u;
        }
        Ok(())
    }
}

impl Traced {
    /// The derivatives of F, and those by frozen coordinates and parameters to their `columns`.
    fn derivatives(
        &self,
        x: [f64; 4],
        is_adjoint: bool,
        memory: &mut Memory,
        columns: &mut [[f64; 2]],
    ) -> Jet {
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        let jet = self.jet(x, memory);
        let (own, others) = jet.split_at(5);
        let frozen = self.frozen();
        for (k, pair) in others.chunks_exact(2).enumerate() {
            columns[if k < frozen { k } else { k + 3 }] = [pair[e], pair[u]];
        }
        Jet {
            by_e: own[e],
            by_u: own[u],
            by_ee: own[2 + 2 * e],
            by_eu: own[3],
            by_uu: own[2 + 2 * u],
            ..Jet::default()
        }
    }
}

impl Spline {
    /// The derivatives of F where the implicit coordinate is `now`, and those by frozen coordinates to their `columns`.
    fn jet(
        &self,
        x: [f64; 4],
        is_adjoint: bool,
        now: f64,
        columns: &mut [[f64; 2]],
    ) -> Result<Jet, Fault> {
        let (spline, frozen) = (self, self.frozen());
        // one function, whose value is 1, in place of a frozen coordinate that there is not
        let mut weights = [[[0.0; MOST]; 3]; 2];
        let (mut cells, mut counts, mut strides) = ([0; 2], [1; 2], [0; 2]);
        weights[0][0][0] = 1.0;
        weights[1][0][0] = 1.0;
        let mut stride = spline.axes[0].functions() * spline.axes[1].functions();
        for k in (0..frozen).rev() {
            let basis = &spline.frozen[k];
            let place = basis.locate(x[k]).ok_or(Fault::Outside(k))?;
            (weights[k], cells[k], counts[k]) = (basis.jet(place), place.cell, basis.degree() + 1);
            strides[k] = stride;
            stride *= basis.functions();
        }
        let explicit = usize::from(is_adjoint);
        let mut places = [spline.axes[0].find(now), spline.axes[1].find(now)];
        let fixed = spline.axes[explicit].locate(x[frozen + explicit]);
        places[explicit] = fixed.ok_or(Fault::Outside(frozen + explicit))?;
        let jets = [0, 1].map(|k| spline.axes[k].jet(places[k]));
        let width = spline.axes[1].functions();
        let mut found = Jet::default();
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                let first = (cells[0] + i) * strides[0] + (cells[1] + j) * strides[1];
                let corner = first + places[0].cell * width + places[1].cell;
                let by = |p: usize, q: usize| {
                    let rows = jets[0][p][..=spline.axes[0].degree()].iter().enumerate();
                    rows.map(|(a, value)| {
                        let own = &spline.coefficients[corner + a * width..];
                        let own = own[..=spline.axes[1].degree()].iter();
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
                    columns[k][0] += slopes[k] * of(1, 0);
                    columns[k][1] += slopes[k] * of(0, 1);
                }
            }
        }
        for k in 0..2 {
            let mean = &spline.mean[k];
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
