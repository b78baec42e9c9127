//! The derivatives of shears, scalings, exponentials and planes.

use super::{LinearFlow, LinearFlows, LinearMap, LinearScratch};
use crate::problem::{Piece, Polynomials};
use liouville_base::error::StepError;
use liouville_base::real::Number;
use liouville_base::simd::InstructionSet;
use liouville_gridded::{Memory, Plane, PlaneFlow};

/// How many intermediate results the derivative of a piece's flow has.
pub(super) fn results(piece: &Piece, n: usize) -> usize {
    match piece {
        Piece::Natural { .. } | Piece::Scaling { .. } => 0,
        Piece::Shear { .. } => 1,
        Piece::Exponential { .. } | Piece::Plane { .. } => 2,
        Piece::Triangular { order, b, .. } => 2 * order.len() * b.len(),
        Piece::Affine { .. } => 2 * n,
        Piece::Turn { .. } => 9,
    }
}

/// Memory for the flows of a piece that is a plane.
pub(super) fn memory(piece: &Piece) -> Memory<f64> {
    match piece {
        Piece::Plane { plane, .. } => plane.memory(),
        _ => Memory::default(),
    }
}

impl LinearFlows {
    /// x_i += h R_i, no R_i containing an x_i of the piece.
    pub(super) fn natural(
        &mut self,
        (rows, change): (&[usize], &Polynomials),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        for (k, &row) in rows.iter().enumerate() {
            let rate = self.row((row, flow.h), (change, k), self.first[flow.part], map);
            self.by_length(row, flow.weight * rate, map);
            self.scratch.values[row] += flow.h * rate;
        }
    }

    /// x += h g a
    pub(super) fn shear(
        &mut self,
        (places, direction, change): (&[usize], &[f64], &Polynomials),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        let g = self.results;
        map.scale(g, 0.0);
        let value = self.row((g, 1.0), (change, 0), self.first[flow.part], map);
        for (&place, a) in places.iter().zip(direction) {
            map.add(place, g, flow.h * a);
            self.by_length(place, flow.weight * value * a, map);
            self.scratch.values[place] += flow.h * value * a;
        }
    }

    /// x_i *= exp(h p_i)
    pub(super) fn scaling(
        &mut self,
        (rows, rate): (&[usize], &Polynomials),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        for (k, &row) in rows.iter().enumerate() {
            let values = &self.scratch.values;
            let terms = rate.row(k).map(|(c, factors)| {
                let factors = factors.iter().map(|factor| values[*factor as usize]);
                c * factors.product::<f64>()
            });
            let growth = (terms.sum::<f64>() * flow.h).exp();
            let after = values[row] * growth;
            map.scale(row, growth);
            let slot = self.first[flow.part];
            let rate = self.row((row, flow.h * after), (rate, k), slot, map);
            self.by_length(row, flow.weight * rate * after, map);
            self.scratch.values[row] = after;
        }
    }

    /// x_i *= exp(c_i t*), t* = −ln(1 − α h m)/α, α = Σ c_i j_i.
    pub(super) fn exponential(
        &mut self,
        (rows, rates, monomial): (&[usize], &[f64], &[usize]),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) -> Result<(), StepError> {
        let LinearFlow { h, part, .. } = flow;
        let (values, places) = (&self.scratch.values, &self.scratch.places);
        let power = |row: usize| monomial.iter().filter(|factor| **factor == row).count() as f64;
        let parts = rows.iter().zip(rates).map(|(row, rate)| rate * power(*row));
        let (alpha, size) = parts.fold((0.0, 0.0), |(sum, size): (f64, f64), part| {
            (sum + part, size + part.abs())
        });
        let is_constant = alpha.abs() <= 4.0 * f64::EPSILON * size;
        let alpha = if is_constant { 0.0 } else { alpha };
        let product = |but: usize| {
            let others = monomial.iter().enumerate().filter(|(k, _)| *k != but);
            others.fold(1.0, |product, (_, f)| product * values[*f])
        };
        let (of_m, of_time) = (self.results, self.results + 1);
        map.scale(of_m, 0.0);
        for (k, factor) in monomial.iter().enumerate() {
            map.add(of_m, places[*factor], product(k));
        }
        let m = product(monomial.len());
        let z = alpha * h * m;
        if !z.is_below(1.0) {
            return Err(StepError::Singular {
                piece: part,
                member: 0,
                t: flow.t,
            });
        }
        let time = if is_constant {
            h * m
        } else {
            -(-z).ln_1p() / alpha
        };
        map.scale(of_time, 0.0);
        map.add(of_time, of_m, h / (1.0 - z));
        self.by_length(of_time, flow.weight * m / (1.0 - z), map);
        if self.has_coefficients {
            let by_alpha = (h * m).powi(2) * second_order(z);
            for (k, row) in rows.iter().enumerate() {
                map.add(of_time, self.first[part] + k, by_alpha * power(*row));
            }
        }
        for (k, (&row, rate)) in rows.iter().zip(rates).enumerate() {
            let growth = (rate * time).exp();
            let after = self.scratch.values[row] * growth;
            map.scale(row, growth);
            map.add(row, of_time, rate * after);
            self.scratch.values[row] = after;
            if self.has_coefficients {
                map.add(row, self.first[part] + k, time * after);
            }
        }
        Ok(())
    }

    /// Two variables, and the derivatives of their flow by all that it reads.
    pub(super) fn plane(
        &mut self,
        (plane, variables): (&Plane, &[usize]),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) -> Result<(), StepError> {
        let mut x = [0.0; 4];
        for (x, variable) in x.iter_mut().zip(variables) {
            *x = self.scratch.values[*variable];
        }
        let LinearScratch {
            planes, columns, ..
        } = &mut self.scratch;
        let before = x;
        let mut made = PlaneFlow {
            plane,
            memory: &mut planes[flow.part],
            x: &mut x,
            is_adjoint: flow.is_adjoint,
            h: flow.h,
        };
        let moved = made.run(InstructionSet::default());
        let moved = moved.map_err(|(fault, _)| fault);
        let found = moved.and_then(|()| {
            let after = [made.x[plane.frozen()], made.x[plane.frozen() + 1]];
            *made.x = before;
            made.derivative(after, columns)?;
            Ok(after)
        });
        // the step itself has been made before, and says more
        let Ok(after) = found else {
            return Err(StepError::Outside {
                index: variables[0],
                member: 0,
                t: flow.t,
            });
        };
        let moved = &variables[plane.frozen()..];
        let columns = &self.scratch.columns;
        let (own, others) = columns.split_at(variables.len());
        for k in 0..2 {
            map.scale(self.results + k, 0.0);
            for (variable, column) in variables.iter().zip(own) {
                map.add(self.results + k, *variable, column[k]);
            }
            self.by_length(self.results + k, flow.weight * others[0][k], map);
            if self.has_coefficients {
                for (slot, column) in (self.first[flow.part]..).zip(&others[1..]) {
                    map.add(self.results + k, slot, column[k]);
                }
            }
        }
        for (k, &variable) in moved.iter().enumerate() {
            map.scale(variable, 0.0);
            map.add(variable, self.results + k, 1.0);
            self.scratch.values[variable] = after[k];
        }
        Ok(())
    }

    /// Appends the derivative by h, where that is wanted.
    pub(super) fn by_length(&self, to: usize, factor: f64, map: &mut LinearMap) {
        if self.has_coefficients {
            map.add(to, self.length(), factor);
        }
    }
}

/// (ln(1 − z) + z/(1 − z))/z² = Σ (k + 1)/(k + 2) z^k
fn second_order(z: f64) -> f64 {
    const LARGEST: f64 = 0.3;
    const TERMS: i32 = 36;
    if z.abs() > LARGEST {
        return ((-z).ln_1p() + z / (1.0 - z)) / (z * z);
    }
    (0..TERMS)
        .rev()
        .fold(0.0, |sum, k| sum * z + f64::from(k + 1) / f64::from(k + 2))
}
