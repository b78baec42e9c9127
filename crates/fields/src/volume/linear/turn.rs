//! The derivative of a turn: by v its matrix, by w and e through the parts of the formula.

use super::{LinearFlow, LinearFlows, LinearMap};
use crate::problem::Polynomials;
use crate::volume::turn::parts;

/// Below this t = θ² differences of the parts lose digits.
const SMALL: f64 = 0.5;
/// Terms of their series there.
const TERMS: i32 = 12;

type Vector = [f64; 3];

/// a, b and k of a turn, their derivatives by t = θ², and those of a and b by h where that is no flow.
struct Angles {
    value: Vector,
    slope: Vector,
    by_length: Option<[f64; 2]>,
}

impl Angles {
    fn new(h: f64, t: f64, is_cayley: bool) -> Self {
        if is_cayley {
            let part = 1.0 / (1.0 + 0.25 * t);
            let (a, b) = (h * part, 0.5 * h * h * part);
            let by = part - 0.5 * t * part * part;
            return Self {
                value: [a, b, 0.0],
                slope: [-0.25 * a * part, -0.25 * b * part, 0.0],
                by_length: Some([by, h * part * (1.0 - 0.25 * t * part)]),
            };
        }
        let [first, second, third] = parts(t);
        let (of_second, of_third) = if t < SMALL {
            (slope(2, t), slope(3, t))
        } else {
            let of_first = 0.5 * ((1.0 - t * second) - first) / t;
            ((0.5 * first - second) / t, -(of_first + third) / t)
        };
        Self {
            value: [h * first, h * h * second, h * h * h * third],
            slope: [
                -h * (third + t * of_third),
                h * h * of_second,
                h * h * h * of_third,
            ],
            by_length: None,
        }
    }
}

/// The derivative of Σ (−t)^k/(2 k + first)!
fn slope(first: i32, t: f64) -> f64 {
    let (mut term, mut sum) = ((1..=first).map(f64::from).product::<f64>().recip(), 0.0);
    for k in 1..TERMS {
        term /= -f64::from((2 * k + first - 1) * (2 * k + first));
        sum += f64::from(k) * term * t.powi(k - 1);
    }
    sum
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Σ factor vector
fn sum<const K: usize>(parts: [(f64, Vector); K]) -> Vector {
    std::array::from_fn(|i| {
        parts
            .iter()
            .map(|(factor, vector)| factor * vector[i])
            .sum()
    })
}

impl LinearFlows {
    /// v1 = v + h e + a w × v + b w × (e + w × v) + k w × (w × e)
    pub(super) fn turn(
        &mut self,
        (rows, change, is_cayley): (&[usize], &Polynomials, bool),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        let (h, results) = (flow.h, self.results);
        let mut rates = [0.0; 6];
        for (row, rate) in rates.iter_mut().enumerate() {
            map.scale(results + row, 0.0);
            let slot = self.first[flow.part];
            *rate = self.row((results + row, 1.0), (change, row), slot, map);
        }
        let [w0, w1, w2, e0, e1, e2] = rates;
        let (w, e) = ([w0, w1, w2], [e0, e1, e2]);
        let mut v = [0.0; 3];
        for (v, row) in v.iter_mut().zip(rows) {
            *v = self.scratch.values[*row];
        }
        let angles = Angles::new(h, h * h * w.iter().map(|w| w * w).sum::<f64>(), is_cayley);
        let [a, b, k] = angles.value;
        let turned = |x: Vector| {
            let once = cross(w, x);
            (once, cross(w, once))
        };
        let ((wv, wwv), (we, wwe)) = (turned(v), turned(e));
        let after = sum([(1.0, v), (h, e), (a, wv), (b, we), (b, wwv), (k, wwe)]);
        for out in 0..3 {
            map.scale(results + 6 + out, 0.0);
        }
        for j in 0..3 {
            let unit: Vector = std::array::from_fn(|i| f64::from(u8::from(i == j)));
            let (wu, wwu) = turned(unit);
            let by_v = sum([(1.0, unit), (a, wu), (b, wwu)]);
            let by_e = sum([(h, unit), (b, wu), (k, wwu)]);
            let (uv, ue) = (cross(unit, v), cross(unit, e));
            let dt = 2.0 * h * h * w[j];
            let [da, db, dk] = angles.slope.map(|slope| slope * dt);
            let by_w = sum([
                (a, uv),
                (b, ue),
                (b, cross(unit, wv)),
                (b, cross(w, uv)),
                (k, cross(unit, we)),
                (k, cross(w, ue)),
                (da, wv),
                (db, we),
                (db, wwv),
                (dk, wwe),
            ]);
            for out in 0..3 {
                let to = results + 6 + out;
                map.add(to, rows[j], by_v[out]);
                map.add(to, results + j, by_w[out]);
                map.add(to, results + 3 + j, by_e[out]);
            }
        }
        let rate = match angles.by_length {
            Some([by_a, by_b]) => sum([(by_a, wv), (by_b, wwv)]),
            None => sum([(1.0, cross(w, after)), (1.0, e)]),
        };
        for (out, &row) in rows.iter().enumerate() {
            self.by_length(results + 6 + out, flow.weight * rate[out], map);
            self.scratch.values[row] = after[out];
        }
        for (out, &row) in rows.iter().enumerate() {
            map.scale(row, 0.0);
            map.add(row, results + 6 + out, 1.0);
        }
    }
}
