//! The derivatives of Runge-Kutta steps of triangular pieces, and of their adjoints.

use super::{LinearFlow, LinearFlows, LinearMap, NOWHERE};
use crate::problem::Polynomials;

impl LinearFlows {
    /// Z_r = x + h Σ_{q<r} a_rq K_q,   K_r = F(Z_r),   x += h Σ b_r K_r
    pub(super) fn runge_kutta(
        &mut self,
        (order, change): (&[usize], &Polynomials),
        (a, b): (&[f64], &[f64]),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        let (s, count, slot) = (b.len(), order.len(), self.first[flow.part]);
        let rate = |r: usize, k: usize| place_of(r, k, count);
        let of_rate = |results: usize, r: usize, k: usize| results + rate(r, k);
        let results = self.results;
        let of_stage = |k: usize| results + s * count + k;
        let [mut rates, mut start] = std::mem::take(&mut self.scratch.stages);
        rates.clear();
        rates.resize(s * count, 0.0);
        start.clear();
        start.extend(order.iter().map(|i| self.scratch.values[*i]));
        for r in 0..s {
            for (k, &i) in order.iter().enumerate() {
                map.scale(of_stage(k), 0.0);
                map.add(of_stage(k), i, 1.0);
                let mut sum = 0.0;
                for q in 0..r {
                    map.add(of_stage(k), of_rate(results, q, k), flow.h * a[r * s + q]);
                    sum += a[r * s + q] * rates[rate(q, k)];
                }
                self.by_length(of_stage(k), flow.weight * sum, map);
                self.scratch.values[i] = start[k] + flow.h * sum;
                self.scratch.places[i] = of_stage(k);
            }
            for k in 0..count {
                let to = of_rate(results, r, k);
                map.scale(to, 0.0);
                rates[rate(r, k)] = self.row((to, 1.0), (change, k), slot, map);
            }
        }
        for (k, &i) in order.iter().enumerate() {
            self.scratch.places[i] = i;
            let mut sum = 0.0;
            for r in 0..s {
                map.add(i, of_rate(results, r, k), flow.h * b[r]);
                sum += b[r] * rates[rate(r, k)];
            }
            self.by_length(i, flow.weight * sum, map);
            self.scratch.values[i] = start[k] + flow.h * sum;
        }
        self.scratch.stages = [rates, start];
    }

    /// K_r = F_i(Z_r),   x_i += h Σ b_r K_r,   Z_{r,i} = x_i − h Σ_{q<r} a_rq K_q, variable after variable.
    pub(super) fn substitution(
        &mut self,
        (order, change): (&[usize], &Polynomials),
        (a, b): (&[f64], &[f64]),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        let (s, count, slot) = (b.len(), order.len(), self.first[flow.part]);
        let results = self.results;
        let place = |r: usize, k: usize| place_of(r, k, count);
        let (of_rate, of_stage) = (
            |r: usize, k: usize| results + place(r, k),
            |r: usize, k: usize| results + s * count + place(r, k),
        );
        let [mut rates, mut stages] = std::mem::take(&mut self.scratch.stages);
        for values in [&mut rates, &mut stages] {
            values.clear();
            values.resize(s * count, 0.0);
        }
        for (k, &i) in order.iter().enumerate() {
            let start = self.scratch.values[i];
            for r in 0..s {
                for &factor in change.row_factors(k) {
                    let earlier = self.scratch.order.get(factor as usize);
                    if let Some(&earlier) = earlier
                        && earlier != NOWHERE
                    {
                        self.scratch.values[factor as usize] = stages[place(r, earlier)];
                        self.scratch.places[factor as usize] = of_stage(r, earlier);
                    }
                }
                map.scale(of_rate(r, k), 0.0);
                rates[place(r, k)] = self.row((of_rate(r, k), 1.0), (change, k), slot, map);
            }
            let mut sum = 0.0;
            for r in 0..s {
                map.add(i, of_rate(r, k), flow.h * b[r]);
                sum += b[r] * rates[place(r, k)];
            }
            self.by_length(i, flow.weight * sum, map);
            let end = start + flow.h * sum;
            for r in 0..s {
                map.scale(of_stage(r, k), 0.0);
                map.add(of_stage(r, k), i, 1.0);
                let mut sum = 0.0;
                for q in 0..r {
                    map.add(of_stage(r, k), of_rate(q, k), -flow.h * a[r * s + q]);
                    sum += a[r * s + q] * rates[place(q, k)];
                }
                self.by_length(of_stage(r, k), -flow.weight * sum, map);
                stages[place(r, k)] = end - flow.h * sum;
            }
            self.scratch.order[i] = k;
        }
        for (k, &i) in order.iter().enumerate() {
            self.scratch.order[i] = NOWHERE;
            self.scratch.places[i] = i;
            // the first stage is at the end
            self.scratch.values[i] = stages[place(0, k)];
        }
        self.scratch.stages = [rates, stages];
    }
}

/// The place of variable k of a piece in stage r.
fn place_of(r: usize, k: usize, count: usize) -> usize {
    r * count + k
}
