//! Start values moved onto their constraints by the least change in the mass metric.
//!
//! Gauss–Newton on c(x) = 0: each correction is the smallest in the metric W,
//!
//!     [ W    −cᵀ_x ] [ dx ]   [  0 ]
//!     [ c_x    0   ] [ μ  ] = [ −c ]
//!
//! in units of x that make the diagonal of W one, and units of c that make its gradients so.

use super::diagnose_rank;
use super::kkt::{KktMatrix, KktPatterns};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, Pattern, max_norm};
use liouville_base::newton::{self, Equations};
use liouville_base::tape::{Registers, Tape};

/// Equations to be met, by tapes (x, held, params) → c, `c_x` and the metric.
#[derive(Clone, Debug)]
pub struct Projection {
    /// (x, held) → c
    pub residual: Tape,
    /// (x, held) → `c_x` on its pattern
    pub jacobian: Tape,
    /// Where `c_x` is not zero.
    pub pattern: Pattern,
    /// (x, held) → W on its pattern
    pub metric: Tape,
    /// Where W is not zero.
    pub metric_pattern: Pattern,
}

struct ConstraintEquations<'a> {
    projection: &'a Projection,
    registers: [Registers<f64>; 3],
    held: &'a [f64],
    /// The size of the start: the point found may be zero.
    scale: f64,
    x: Vec<f64>,
    /// W and `c_x`, in units of x and of c.
    blocks: [Vec<f64>; 2],
    /// Units of x, then of c.
    units: Vec<f64>,
    metric: Factor,
    kkt: KktMatrix,
    dx: Vec<f64>,
    mu: Vec<f64>,
}

/// The point nearest to `x` where the projection's equations hold.
///
/// # Errors
/// The equations are not finite or dependent, or no such point is found near `x`.
///
/// # Panics
/// When an argument has not the size of the tapes' input.
pub fn project(
    projection: &Projection,
    x: &[f64],
    held: &[f64],
    params: &[f64],
) -> Result<Vec<f64>, StepError> {
    let (rows, n) = projection.pattern.shape();
    let (c_x, metric) = (&projection.pattern, &projection.metric_pattern);
    let kkt = KktMatrix::new(KktPatterns {
        p_z: metric,
        v_z: None,
        g_y: c_x,
        r_lam: &c_x.transposed(),
        nonholonomic: None,
    });
    let mut equations = ConstraintEquations {
        projection,
        registers: [
            &projection.residual,
            &projection.jacobian,
            &projection.metric,
        ]
        .map(|tape| tape.bind(params)),
        held,
        scale: max_norm(x),
        x: x.to_vec(),
        blocks: [metric, c_x].map(|pattern| vec![0.0; pattern.len()]),
        units: vec![0.0; n + rows],
        metric: Factor::new(metric),
        kkt,
        dx: vec![0.0; n],
        mu: vec![0.0; rows],
    };
    newton::solve(&mut equations, 100)?;
    Ok(equations.x)
}

impl Equations for ConstraintEquations<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        let (_, n) = self.projection.pattern.shape();
        let args: [&[f64]; 2] = [&self.x, self.held];
        let [residual, jacobian, metric] = &mut self.registers;
        let c = self.projection.residual.eval(residual, args);
        let c_x = self.projection.jacobian.eval(jacobian, args);
        let metric = self.projection.metric.eval(metric, args);
        let not_finite = |quantity| {
            move |index| StepError::NotFinite {
                quantity,
                index,
                t: f64::NAN,
            }
        };
        if let Some(index) = c.iter().position(|c| !c.is_finite()) {
            return Err(not_finite(Quantity::Constraint)(index));
        }
        if let Some(index) = c_x
            .iter()
            .chain(metric)
            .position(|value| !value.is_finite())
        {
            return Err(not_finite(Quantity::Derivative)(index));
        }
        let [w, scaled] = &mut self.blocks;
        w.copy_from_slice(metric);
        scaled.copy_from_slice(c_x);
        let (at_c, at_w) = (&self.projection.pattern, &self.projection.metric_pattern);
        let (of_x, of_c) = self.units.split_at_mut(n);
        of_x.fill(1.0);
        for (&(i, j), w) in at_w.entries().iter().zip(&*w) {
            let unit = w.abs().sqrt().recip();
            if i == j && unit.is_normal() {
                of_x[i] = unit;
            }
        }
        for (&(i, j), w) in at_w.entries().iter().zip(&mut *w) {
            *w *= of_x[i] * of_x[j];
        }
        of_c.fill(0.0);
        for (&(i, j), c_x) in at_c.entries().iter().zip(&mut *scaled) {
            *c_x *= of_x[j];
            of_c[i] = c_x.abs().max(of_c[i]);
        }
        for (&(i, _), c_x) in at_c.entries().iter().zip(&mut *scaled) {
            *c_x /= of_c[i];
        }
        let factored = self.metric.factor(at_w, w);
        factored.map_err(|singular| StepError::SingularMass {
            coordinate: singular.column,
        })?;
        let factored = self.kkt.factor([w, &[]], scaled, scaled, None);
        factored.map_err(|_| diagnose_rank(at_c, c_x, StepError::SingularNewton))?;
        self.dx.fill(0.0);
        for ((out, c), unit) in self.mu.iter_mut().zip(c).zip(of_c) {
            *out = -c / *unit;
        }
        self.kkt.solve(&mut self.dx, &mut self.mu);
        for ((x, dx), unit) in self.x.iter_mut().zip(&mut self.dx).zip(of_x) {
            *dx *= *unit;
            *x += *dx;
        }
        let size = max_norm(&self.dx);
        Ok(if size == 0.0 {
            0.0
        } else {
            size / max_norm(&self.x).max(self.scale).max(size)
        })
    }
}
