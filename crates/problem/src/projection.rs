//! Start values moved onto their constraints by the least change in the mass metric.
//!
//! Gauss–Newton on c(x) = 0: each correction is the smallest in the metric W,
//!
//!     [ W    −cᵀ_x ] [ dx ]   [  0 ]
//!     [ c_x    0   ] [ μ  ] = [ −c ]
//!
//! in units of x that make the diagonal of W one, and units of c that make its gradients so.
//!
//! Where some equations imply others, their gradients are dependent at a solution and only nearly so beside it. Those
//! that are dependent as far as the distance from the solution lets one tell are left out of a correction.

use super::diagnose_rank;
use super::kkt::{KktMatrix, KktPatterns};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::choice::LARGEST_DENSE_RANK;
use liouville_base::linalg::{Factor, Matrix, Pattern, independent_rows, max_norm};
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

/// The least part of a gradient's length that counts as its own, where the equations hold ...
const CUTOFF: f64 = 1e-10;
/// ... and, in units of what is missing, before they do: dependent gradients differ by a part of that.
const SPREAD: f64 = 4.0;
/// More than this is always a gradient's own.
const LARGEST_CUTOFF: f64 = 0.1;
/// Largest residual of dependent equations, relative to x, where the independent ones hold.
const CONTRADICTION: f64 = 1e-9;
/// Corrections below this part of x are near a solution.
const NEAR: f64 = 0.1;
/// The most damped corrections on the way there.
const MOST_DAMPED: usize = 100;
/// Least accepted reduction, relative to that of the linear model (Armijo).
const GAIN: f64 = 0.1;
/// Half of a correction with a lesser reduction is tried, down to this part.
const LEAST_PART: f64 = 1.0 / (1 << 20) as f64;

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
    /// c in its units.
    c: Vec<f64>,
    metric: Factor,
    /// Whether rows that depend on others are left out, as far from the equations as the point is.
    leaves_out: bool,
    /// The rows in the matrix.
    rows: Vec<usize>,
    kkt: KktMatrix,
    dx: Vec<f64>,
    mu: Vec<f64>,
}

/// The point nearest to `x` where the projection's equations hold; some of them may imply the others.
///
/// # Errors
/// The equations are not finite, contradict one another, or no such point is found near `x`.
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
    let mut equations = ConstraintEquations::new(projection, x, held, params);
    let Err(error) = equations.meet(x) else {
        return Ok(equations.x);
    };
    let may_depend = matches!(
        error,
        StepError::SingularNewton
            | StepError::DependentConstraints { .. }
            | StepError::NotConverged { .. }
    );
    if !may_depend || rows * n > LARGEST_DENSE_RANK {
        return Err(error);
    }
    equations.leaves_out = true;
    let found = equations.meet(x);
    if found.is_err() || max_norm(&equations.c) > CONTRADICTION * equations.size() {
        return Err(error);
    }
    Ok(equations.x)
}

/// Solves with the matrix of a correction at `x`, `[W, −c_xᵀ; c_x, 0]`, or where it `is_transposed` with its transpose:
/// `rows` are right-hand sides one after another, and become solutions.
///
/// # Errors
/// A value is not finite, or some equations depend on others.
///
/// # Panics
/// When an argument has not the size of the tapes' input.
pub fn project_linear(
    projection: &Projection,
    (x, held, params): (&[f64], &[f64], &[f64]),
    rows: &mut [f64],
    is_transposed: bool,
) -> Result<(), StepError> {
    let mut equations = ConstraintEquations::new(projection, x, held, params);
    equations.factor()?;
    let (units, kkt) = (&equations.units, &mut equations.kkt);
    let (of_x, of_c) = units.split_at(x.len());
    for row in rows.chunks_exact_mut(units.len()) {
        let (x, c) = row.split_at_mut(x.len());
        let scale = |x: &mut [f64], c: &mut [f64]| {
            x.iter_mut().zip(of_x).for_each(|(x, unit)| *x *= unit);
            c.iter_mut().zip(of_c).for_each(|(c, unit)| *c /= unit);
        };
        scale(x, c);
        if is_transposed {
            kkt.solve_transposed(x, c);
        } else {
            kkt.solve(x, c);
        }
        scale(x, c);
    }
    Ok(())
}

/// The matrix of a metric and of rows of `c_x`.
fn matrix(metric: &Pattern, rows: &Pattern) -> KktMatrix {
    KktMatrix::new(KktPatterns {
        p_z: metric,
        v_z: None,
        g_y: rows,
        r_lam: &rows.transposed(),
        nonholonomic: None,
    })
}

impl<'a> ConstraintEquations<'a> {
    fn new(projection: &'a Projection, x: &[f64], held: &'a [f64], params: &[f64]) -> Self {
        let (rows, n) = projection.pattern.shape();
        let tapes = [
            &projection.residual,
            &projection.jacobian,
            &projection.metric,
        ];
        let metric = &projection.metric_pattern;
        Self {
            projection,
            registers: tapes.map(|tape| tape.bind(params)),
            held,
            scale: max_norm(x),
            x: x.to_vec(),
            blocks: [metric, &projection.pattern].map(|pattern| vec![0.0; pattern.len()]),
            units: vec![0.0; n + rows],
            c: vec![0.0; rows],
            metric: Factor::new(metric),
            leaves_out: false,
            rows: (0..rows).collect(),
            kkt: matrix(metric, &projection.pattern),
            dx: vec![0.0; n],
            mu: vec![0.0; rows],
        }
    }

    /// Evaluates c, `c_x` and the metric, and scales them.
    fn evaluate(&mut self) -> Result<(), StepError> {
        let args: [&[f64]; 2] = [&self.x, self.held];
        let [residual, jacobian, metric] = &mut self.registers;
        let c = self.projection.residual.eval(residual, args);
        let c_x = self.projection.jacobian.eval(jacobian, args);
        let metric = self.projection.metric.eval(metric, args);
        check_finite(c, Quantity::Constraint)?;
        check_finite(c_x, Quantity::Derivative)?;
        check_finite(metric, Quantity::Derivative)?;
        let [w, scaled] = &mut self.blocks;
        w.copy_from_slice(metric);
        scaled.copy_from_slice(c_x);
        let (at_c, at_w) = (&self.projection.pattern, &self.projection.metric_pattern);
        let (of_x, of_c) = self.units.split_at_mut(self.x.len());
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
        // an equation that nothing moves, as a hidden one at rest, has no unit of its own
        of_c.iter_mut()
            .filter(|unit| **unit == 0.0)
            .for_each(|unit| *unit = 1.0);
        for (&(i, _), c_x) in at_c.entries().iter().zip(&mut *scaled) {
            *c_x /= of_c[i];
        }
        for ((out, c), unit) in self.c.iter_mut().zip(c).zip(of_c) {
            *out = c / *unit;
        }
        Ok(())
    }

    /// The size of x in its units.
    fn size(&self) -> f64 {
        let units = self.x.iter().zip(&self.units);
        units.fold(f64::MIN_POSITIVE, |size, (x, unit)| {
            size.max((x / unit).abs())
        })
    }

    /// Takes the rows that are independent, as far as roundoff allows to decide.
    fn leave_out(&mut self) {
        let at = &self.projection.pattern;
        let mut gradients = Matrix::zeros(at.shape().0, at.shape().1);
        at.add_to(&self.blocks[1], 1.0, &mut gradients, 0, 0);
        let missing = max_norm(&self.c) / self.size();
        let cutoff = (SPREAD * missing).clamp(CUTOFF, LARGEST_CUTOFF);
        let kept = independent_rows(gradients, cutoff).kept;
        if kept != self.rows {
            let own = at.of_rows(&kept);
            self.kkt = matrix(&self.projection.metric_pattern, &own);
            self.rows = kept;
        }
    }
}

fn check_finite(values: &[f64], quantity: Quantity) -> Result<(), StepError> {
    let bad = values.iter().position(|value| !value.is_finite());
    bad.map_or(Ok(()), |index| {
        Err(StepError::NotFinite {
            quantity,
            index,
            t: f64::NAN,
        })
    })
}

impl ConstraintEquations<'_> {
    /// Finds the point nearest to `x`, by damped corrections where whole ones do not lead to it.
    fn meet(&mut self, x: &[f64]) -> Result<(), StepError> {
        self.x.copy_from_slice(x);
        let found = newton::solve(self, 100);
        let Err(StepError::NotConverged { .. }) = found else {
            return found.map(|_| ());
        };
        if self.is_met() {
            return Ok(());
        }
        self.x.copy_from_slice(x);
        if self.is_met() {
            return Ok(());
        }
        self.approach()?;
        newton::solve(self, 100).map(|_| ())
    }

    /// Whether all equations hold up to their roundings: those of their terms may be larger than x, which may be zero.
    fn is_met(&mut self) -> bool {
        let tape = &self.projection.residual;
        let args: [&[f64]; 2] = [&self.x, self.held];
        let most = tape.roundings(&self.registers[0], &args);
        let values = tape.eval(&mut self.registers[0], args);
        values.iter().zip(most).all(|(c, most)| c.abs() <= most)
    }

    /// Goes to where corrections are small, by parts of them that take away what is missing.
    fn approach(&mut self) -> Result<(), StepError> {
        let mut size = f64::INFINITY;
        for _ in 0..MOST_DAMPED {
            self.factor()?;
            self.solve();
            size = self.size_of_correction();
            if size <= NEAR {
                return Ok(());
            }
            let (from, missing) = (self.x.clone(), self.missing());
            let units = self.units[self.x.len()..].to_vec();
            let mut part = 1.0;
            loop {
                for ((x, from), dx) in self.x.iter_mut().zip(&from).zip(&self.dx) {
                    *x = from + part * dx;
                }
                if self.missing_in(&units) <= (1.0 - GAIN * part) * missing {
                    break;
                }
                part /= 2.0;
                if part < LEAST_PART {
                    let iterations = MOST_DAMPED;
                    return Err(StepError::NotConverged { iterations, size });
                }
            }
        }
        let iterations = MOST_DAMPED;
        Err(StepError::NotConverged { iterations, size })
    }

    /// The size of what is missing of the equations that are not left out, in their units.
    fn missing(&self) -> f64 {
        let squares = self.rows.iter().map(|row| self.c[*row] * self.c[*row]);
        squares.sum::<f64>().sqrt()
    }

    /// The same at the present point, in these units; infinite where the equations do not exist.
    fn missing_in(&mut self, units: &[f64]) -> f64 {
        let args: [&[f64]; 2] = [&self.x, self.held];
        let c = (self.projection.residual).eval(&mut self.registers[0], args);
        for ((out, c), unit) in self.c.iter_mut().zip(c).zip(units) {
            *out = c / unit;
        }
        let missing = self.missing();
        if missing.is_nan() {
            f64::INFINITY
        } else {
            missing
        }
    }

    /// The size of the last correction, as a part of x.
    fn size_of_correction(&self) -> f64 {
        let size = max_norm(&self.dx);
        if size == 0.0 {
            return 0.0;
        }
        size / max_norm(&self.x).max(self.scale).max(size)
    }

    /// Evaluates everything at the present point, and factors the matrix.
    fn factor(&mut self) -> Result<(), StepError> {
        self.evaluate()?;
        let (at_c, at_w) = (&self.projection.pattern, &self.projection.metric_pattern);
        let factored = self.metric.factor(at_w, &self.blocks[0]);
        factored.map_err(|singular| StepError::SingularMass {
            coordinate: singular.column,
        })?;
        if self.leaves_out {
            self.leave_out();
        }
        let [w, scaled] = &self.blocks;
        let own = at_c.entries().iter().zip(scaled);
        let own = own.filter(|((row, _), _)| self.rows.binary_search(row).is_ok());
        let own: Vec<f64> = own.map(|(_, value)| *value).collect();
        let factored = self.kkt.factor([w, &[]], &own, &own, None);
        factored.map_err(|_| diagnose_rank(at_c, scaled, StepError::SingularNewton))
    }

    /// Writes the least change of x that takes c away.
    fn solve(&mut self) {
        self.dx.fill(0.0);
        self.mu.clear();
        self.mu.extend(self.rows.iter().map(|row| -self.c[*row]));
        self.kkt.solve(&mut self.dx, &mut self.mu);
        for (dx, unit) in self.dx.iter_mut().zip(&self.units) {
            *dx *= *unit;
        }
    }
}

impl Equations for ConstraintEquations<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        self.factor()?;
        self.solve();
        for (x, dx) in self.x.iter_mut().zip(&self.dx) {
            *x += *dx;
        }
        Ok(self.size_of_correction())
    }
}
