//! Zeros between two points where a function has opposite signs, by the ITP iteration: as fast as secants,
//! and never slower than bisection.
//!
//! The secant's zero is moved towards the middle of the bracket by a part of the bracket's square, and then
//! no further from the middle than bisection can make good. Source: oliveira2020.

/// How far an estimate of the secant is moved towards the middle, as a part of the square of the bracket.
const TRUNCATION: f64 = 0.01;

/// Two points and the function there, of opposite signs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket {
    /// The left point and the value there.
    pub a: (f64, f64),
    /// The right point and the value there.
    pub b: (f64, f64),
}

impl Bracket {
    /// How far the points are apart.
    pub fn width(&self) -> f64 {
        self.b.0 - self.a.0
    }

    /// Where to look next, with so many halvings to go until the width is twice the tolerance.
    pub fn estimate(&self, halvings: i32, tolerance: f64) -> f64 {
        let ((a, s_a), (b, s_b)) = (self.a, self.b);
        let middle = f64::midpoint(a, b);
        let secant = match (s_b * a - s_a * b) / (s_b - s_a) {
            secant if secant.is_finite() => secant,
            _ => middle,
        };
        let side = (middle - secant).signum();
        let shift = TRUNCATION * (b - a) * (b - a);
        let moved = if shift <= (middle - secant).abs() {
            secant + side * shift
        } else {
            middle
        };
        let reach = tolerance * f64::from(halvings).exp2() - (b - a) / 2.0;
        if (moved - middle).abs() <= reach {
            moved
        } else {
            middle - side * reach
        }
    }

    /// Takes in the value at a point between: it takes the place of the end where the sign is the same.
    pub fn tighten(&mut self, x: f64, value: f64) {
        if (value > 0.0) == (self.b.1 > 0.0) {
            self.b = (x, value);
        } else {
            self.a = (x, value);
        }
    }
}
