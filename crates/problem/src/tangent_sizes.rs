//! The tolerances that errors of tangents are measured by.
//!
//! A tangent δ of the coordinates is measured as a motion is, by `atol_k + rtol |δ_k|`, with an absolute tolerance of its
//! own: there is no size that all derivatives have. With ‖x‖ the largest |x_k| in units of the absolute tolerances
//! of the motion, α_k, and H the longest step of late,
//!
//!     atol_k = α_k (σ rtol max(‖δ‖, H ‖δv‖) + max(σ rtol, 1024 ε) (H ‖u‖ + H² ‖a‖)),     σ = 10⁻³
//!
//! u and a are what momenta and forces change by a parameter alone, as velocity and as acceleration. A derivative
//! that begins, or whose parts take one another away, is no more than their roundoff: it has the size of these parts.
//! H begins as the time in which the motion moves by its own size, √(1/rtol) first steps, but a hundredth of the run at
//! most, and is that until steps add up to it: there may be no other length that a young tangent can be held to.

use super::{Mass, SensitivityModel};
use liouville_base::checkpoint;
use liouville_base::linalg::Pattern;
use liouville_base::method::{LEAST_ROUNDINGS, SMALL, Tolerance};

/// The part of the longest step so far that the next one counts as its own at least.
const KEPT: f64 = 0.9;

/// Finds the tolerances of tangents, by the tolerance of the motion.
#[derive(Clone, Debug)]
pub struct TangentSizes {
    /// α_k in units of the largest.
    weights: Vec<f64>,
    rtol: f64,
    /// The longest H to begin with.
    longest_first: f64,
    /// H of the steps that stand, or that to begin with; the longest of those that stand; their sum; and the
    /// last step, which may yet be undone.
    memory: [f64; 4],
    part: Vec<f64>,
}

/// A tangent at both ends of a step.
#[derive(Clone, Copy, Debug)]
pub struct TangentStep<'a> {
    /// The step.
    pub h: f64,
    /// The tangents of coordinates.
    pub y: [&'a [f64]; 2],
    /// The tangents of velocities.
    pub v: [&'a [f64]; 2],
    /// ‖u‖ and ‖a‖.
    pub parts: [f64; 2],
}

impl TangentStep<'_> {
    /// ‖δ‖/‖δv‖
    pub fn time_scale(&self, sizes: &TangentSizes) -> f64 {
        let largest = |of: [&[f64]; 2]| sizes.norm(of[0]).max(sizes.norm(of[1]));
        largest(self.y) / largest(self.v).max(f64::MIN_POSITIVE)
    }
}

impl TangentSizes {
    /// Sizes of tangents, given the tolerance of their motion.
    pub fn new(tolerance: &Tolerance) -> Self {
        let atol = &tolerance.atol;
        let largest = atol.iter().copied().fold(0.0, f64::max);
        // where a tolerance is relative alone, all coordinates are alike
        let weight = |atol: &f64| if *atol > 0.0 { atol / largest } else { 1.0 };
        Self {
            weights: atol.iter().map(weight).collect(),
            rtol: tolerance.rtol,
            longest_first: tolerance.longest,
            memory: [0.0; 4],
            part: vec![0.0; atol.len()],
        }
    }

    /// Begins a step: the one before stands.
    pub fn begin(&mut self) {
        let [of_late, longest, sum, last] = self.memory;
        // steps of a young tangent may be a millionth of the first that was tried
        let is_young = sum + last < of_late;
        let kept = if is_young || last == 0.0 { 1.0 } else { KEPT };
        self.memory = [last.max(kept * of_late), longest.max(last), sum + last, 0.0];
    }

    /// Leaves out the last step, which was rejected.
    pub fn undo(&mut self) {
        self.memory[3] = 0.0;
    }

    /// The longest step so far.
    pub fn longest(&self) -> f64 {
        self.memory[1].max(self.memory[3])
    }

    /// ‖x‖
    pub fn norm(&self, x: &[f64]) -> f64 {
        let each = x
            .iter()
            .zip(&self.weights)
            .map(|(x, weight)| x.abs() / weight);
        each.fold(0.0, f64::max)
    }

    /// Writes the absolute tolerances of a tangent in a step; returns what its largest is measured by, zero where all are.
    pub fn measure(&mut self, step: TangentStep, out: &mut Tolerance) -> f64 {
        let h = step.h.abs();
        self.memory[3] = h;
        if self.memory[0] == 0.0 {
            self.memory[0] = (h / self.rtol.sqrt()).min(self.longest_first).max(h);
        }
        let longest = self.memory[0].max(h);
        let largest = |of: [&[f64]; 2]| self.norm(of[0]).max(self.norm(of[1]));
        let y = largest(step.y);
        let size = y.max(longest * largest(step.v));
        let [u, a] = step.parts;
        let parts = longest * (u + longest * a);
        let of_parts = (SMALL * self.rtol).max(LEAST_ROUNDINGS * f64::EPSILON);
        let unit = SMALL * self.rtol * size + of_parts * parts;
        for (out, weight) in out.atol.iter_mut().zip(&self.weights) {
            *out = weight * unit;
        }
        unit + self.rtol * y
    }

    /// ‖u‖ and ‖a‖ of a mechanical system at (t, y, z) and these multipliers of holonomic constraints, where τ changes by
    /// so much. The mass is factored there.
    pub fn parts(
        &mut self,
        mass: &mut Mass,
        sensitivity: &mut SensitivityModel,
        (t, [y, z, lam]): (f64, [&[f64]; 3]),
        tau: &[f64],
    ) -> [f64; 2] {
        let problem = sensitivity.problem.clone();
        let at = &problem.patterns;
        let mut x = std::mem::take(&mut self.part);
        let mut norm = |pattern: &Pattern, values: &[f64], is_velocity: bool| {
            x.fill(0.0);
            pattern.multiply_add(values, 1.0, tau, &mut x);
            if !is_velocity {
                mass.solve_velocity(&mut x);
            }
            self.norm(&x)
        };
        let [p_tau, f_tau, v_tau] = sensitivity.stage(t, y, z);
        let mut u = norm(&at.p_tau, p_tau, false);
        if let Some(pattern) = &at.v_tau {
            u += norm(pattern, v_tau, true);
        }
        let mut a = norm(&at.f_tau, f_tau, false);
        if problem.mechanical.m > 0 {
            let [_, r_tau] = sensitivity.node(t, y, lam);
            a += norm(&at.r_tau, r_tau, false);
        }
        self.part = x;
        [u, a]
    }
}

checkpoint!(TangentSizes { memory });
