//! The derivative of a flow by the coordinates at its start, at the solution of its equation:
//!
//!     (1 − σ F_eu) du1 = du0 + h U' dc + σ (F_ee de0 + F_ec dc)
//!     de1 = de0 + h V' dc − σ (F_ue de0 + F_uu du1 + F_uc dc)
//!
//! with σ = ∓h, U and V the mean flow of u and e, and c the frozen coordinates.

use crate::basis::MOST;
use crate::equation::Fault;
use crate::flow::PlaneFlow;
use crate::plane::{Kept, Plane};
use crate::spline::Spline;
use crate::traced::{Programs, Traced};

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

impl PlaneFlow<'_, f64> {
    /// The derivatives of v and w `after` the flow by the frozen coordinates, v and w before it, then by its length, and
    /// by the parameters: `columns` of two numbers each.
    ///
    /// # Errors
    /// A coordinate is outside its axis.
    ///
    /// # Panics
    /// When the memory is that of another plane.
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
        let jet = match (self.plane, &mut self.memory.0) {
            (Plane::Spline(spline), _) => {
                spline.jet(*self.x, self.is_adjoint, after[u], columns)?
            }
            (Plane::Traced(traced), Kept::Programs(programs)) => {
                let mut x = *self.x;
                x[frozen + u] = after[u];
                traced.derivatives(x, self.is_adjoint, programs, columns)
            }
            _ => panic!("memory of another plane"),
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
        programs: &mut Programs<f64>,
        columns: &mut [[f64; 2]],
    ) -> Jet {
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        let jet = self.jet(x, programs);
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

/// Values and derivatives of the functions of the frozen coordinates in their cells, and where their coefficients are.
struct FrozenFunctions {
    weights: [[[f64; MOST]; 3]; 2],
    cells: [usize; 2],
    counts: [usize; 2],
    strides: [usize; 2],
}

impl FrozenFunctions {
    /// A mean flow with these coefficients, and its derivative by the last frozen coordinate.
    fn mean(&self, frozen: usize, coefficients: &[f64]) -> [f64; 2] {
        let last = match frozen.checked_sub(1) {
            Some(last) if coefficients.len() > 1 => last,
            _ => return [coefficients[0], 0.0],
        };
        let own = &coefficients[self.cells[last]..][..self.counts[last]];
        let sum = |functions: &[f64]| own.iter().zip(functions).map(|(c, x)| c * x).sum();
        [sum(&self.weights[last][0]), sum(&self.weights[last][1])]
    }
}

impl Spline {
    /// The functions of the frozen coordinates.
    ///
    /// # Errors
    /// The number of a coordinate that is outside its axis.
    fn frozen_functions(&self, x: &[f64; 4]) -> Result<FrozenFunctions, Fault> {
        // one function, whose value is 1, in place of a frozen coordinate that there is not
        let mut weights = [[[0.0; MOST]; 3]; 2];
        let (mut cells, mut counts, mut strides) = ([0; 2], [1; 2], [0; 2]);
        weights[0][0][0] = 1.0;
        weights[1][0][0] = 1.0;
        let mut stride = self.axes[0].functions() * self.axes[1].functions();
        for k in (0..self.frozen()).rev() {
            let basis = &self.frozen[k];
            let place = basis.locate(x[k]).ok_or(Fault::Outside(k))?;
            (weights[k], cells[k], counts[k]) = (basis.jet(place), place.cell, basis.degree() + 1);
            strides[k] = stride;
            stride *= basis.functions();
        }
        Ok(FrozenFunctions {
            weights,
            cells,
            counts,
            strides,
        })
    }

    /// F, v' and w' at frozen coordinates, v and w.
    ///
    /// # Errors
    /// The number of a coordinate that is outside its axis.
    pub(crate) fn sample(&self, x: [f64; 4]) -> Result<[f64; 3], Fault> {
        if self.axes[0].degree() == 3 {
            self.sampled::<4>(x)
        } else {
            self.sampled::<6>(x)
        }
    }

    fn sampled<const N: usize>(&self, x: [f64; 4]) -> Result<[f64; 3], Fault> {
        let functions = self.frozen_functions(&x)?;
        let FrozenFunctions {
            weights,
            cells,
            counts,
            strides,
        } = &functions;
        let frozen = self.frozen();
        let mut corner = cells[0] * strides[0] + cells[1] * strides[1];
        let width = self.axes[1].functions();
        let mut jets = [[[0.0; MOST]; 3]; 2];
        for (k, axis) in self.axes.iter().enumerate() {
            let place = axis
                .locate(x[frozen + k])
                .ok_or(Fault::Outside(frozen + k))?;
            jets[k] = axis.jet(place);
            corner += place.cell * if k == 0 { width } else { 1 };
        }
        let [of_v, of_w] = jets;
        let (mut value, mut by_v, mut by_w) = (0.0, 0.0, 0.0);
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                let weight = weights[0][0][i] * weights[1][0][j];
                for a in 0..N {
                    let first = corner + i * strides[0] + j * strides[1] + a * width;
                    let own = &self.coefficients[first..][..N];
                    let (mut sum, mut slope) = (0.0, 0.0);
                    for b in 0..N {
                        sum += own[b] * of_w[0][b];
                        slope += own[b] * of_w[1][b];
                    }
                    value += weight * of_v[0][a] * sum;
                    by_v += weight * of_v[1][a] * sum;
                    by_w += weight * of_v[0][a] * slope;
                }
            }
        }
        let [mean_v, mean_w] = [0, 1].map(|k| functions.mean(frozen, &self.mean[k])[0]);
        Ok([value, mean_v + by_w, mean_w - by_v])
    }

    /// The derivatives of F where the implicit coordinate is `now`, and those by frozen coordinates to their `columns`.
    fn jet(
        &self,
        x: [f64; 4],
        is_adjoint: bool,
        now: f64,
        columns: &mut [[f64; 2]],
    ) -> Result<Jet, Fault> {
        let (spline, frozen) = (self, self.frozen());
        let functions = self.frozen_functions(&x)?;
        let FrozenFunctions {
            weights,
            cells,
            counts,
            strides,
        } = &functions;
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
            [found.mean[k], found.mean_by_c[k]] = functions.mean(frozen, &spline.mean[k]);
        }
        Ok(found)
    }
}
