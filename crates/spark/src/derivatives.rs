//! Derivatives of the equations of one step, at its stages and nodes.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::stages::Stages;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, Pattern, all_finite, copy};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_base::tableau;
use liouville_problem::{Mechanical, Model, NonholonomicPatterns, Points, Step, Times, finite};

/// A row a stage, or a node.
#[derive(Clone, Debug)]
pub(super) struct Derivatives<R = f64> {
    pub(super) p_z: Matrix<R>,
    pub(super) v_z: Matrix<R>,
    pub(super) p_y: Matrix<R>,
    pub(super) f_y: Matrix<R>,
    pub(super) f_z: Matrix<R>,
    pub(super) v_y: Matrix<R>,
    pub(super) g_y: Matrix<R>,
    pub(super) r_lam: Matrix<R>,
    pub(super) r_y: Matrix<R>,
    /// Derivatives of nonholonomic constraints, and at the end of the step, which is solved for with them.
    pub(super) own: Option<Box<NonholonomicDerivatives<R>>>,
    /// Whether those that are constants are there.
    is_ready: bool,
}

/// Of nonholonomic constraints k and their reactions, a row a stage; those of r_n are called by `r`.
#[derive(Clone, Debug)]
pub(super) struct NonholonomicDerivatives<R = f64> {
    pub(super) k_y: Matrix<R>,
    pub(super) k_z: Matrix<R>,
    pub(super) r_y: Matrix<R>,
    pub(super) r_z: Matrix<R>,
    pub(super) r_nu: Matrix<R>,
    pub(super) end: EndDerivatives<R>,
}

/// At the end of the step.
#[derive(Clone, Debug)]
pub(super) struct EndDerivatives<R = f64> {
    pub(super) p_z: Vec<R>,
    pub(super) v_z: Vec<R>,
    pub(super) p_y: Vec<R>,
    pub(super) k_y: Vec<R>,
    pub(super) k_z: Vec<R>,
    pub(super) w_y: Vec<R>,
    pub(super) g_y: Vec<R>,
}

impl<R: Real> NonholonomicDerivatives<R> {
    fn new(problem: &Mechanical, own: &NonholonomicPatterns, s: usize) -> Self {
        let at = &problem.patterns;
        let rows = |pattern: &Pattern| Matrix::zeros(s, pattern.len());
        let row = |pattern: &Pattern| vec![R::splat(0.0); pattern.len()];
        Self {
            k_y: rows(&own.k_y),
            k_z: rows(&own.k_z),
            r_y: rows(&own.r_y),
            r_z: rows(&own.r_z),
            r_nu: rows(&own.r_nu),
            end: EndDerivatives {
                p_z: row(&at.p_z),
                v_z: at.v_z.as_ref().map_or_else(Vec::new, row),
                p_y: row(&at.p_y),
                k_y: row(&own.k_y),
                k_z: row(&own.k_z),
                w_y: row(&own.w_y),
                g_y: row(&at.g_y),
            },
        }
    }

    fn evaluate(
        &mut self,
        model: &mut Model<R>,
        stages: &Stages<R>,
        step: Step<R>,
        z1: &[R],
    ) -> Result<(), StepError> {
        let unknowns = &stages.unknowns;
        for j in 0..stages.y.rows() {
            let t = stages.stage_time(step, j);
            let (z, nu) = (unknowns.z.row(j), unknowns.nu.row(j));
            let rows = [
                &mut self.k_y,
                &mut self.k_z,
                &mut self.r_y,
                &mut self.r_z,
                &mut self.r_nu,
            ];
            let blocks = model.nonholonomic_blocks(t, stages.y.row(j), z, nu);
            for (out, values) in rows.into_iter().zip(blocks) {
                finite(values, Quantity::Derivative, t)?;
                copy(out.row_mut(j), values);
            }
        }
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (t, y1) = (stages.node_time(step, k), stages.node_y.row(k));
        let end = &mut self.end;
        let [p_z, v_z] = model.stage_blocks(t, y1, z1);
        copy(&mut end.p_z, p_z);
        copy(&mut end.v_z, v_z);
        copy(&mut end.p_y, model.stage_jacobian(t, y1, z1)[0]);
        let nu = unknowns.nu.row(s - 1);
        let [k_y, k_z, ..] = model.nonholonomic_blocks(t, y1, z1, nu);
        copy(&mut end.k_y, k_y);
        copy(&mut end.k_z, k_z);
        copy(&mut end.w_y, model.hidden_jacobian(t, y1, z1));
        copy(
            &mut end.g_y,
            model.node_blocks(t, y1, unknowns.lam.row(k))[0],
        );
        let EndDerivatives {
            p_z,
            v_z,
            p_y,
            k_y,
            k_z,
            w_y,
            g_y,
        } = end;
        let mut all = [p_z, v_z, p_y, k_y, k_z, w_y, g_y].into_iter();
        all.try_for_each(|values| finite(values, Quantity::Derivative, t))
    }
}

impl<R: Real> Derivatives<R> {
    /// Memory for those of a system.
    pub(super) fn new(problem: &Mechanical, tableau: &tableau::Spark) -> Self {
        let at = &problem.patterns;
        let (s, nodes) = (tableau.stages, tableau.intervals + 1);
        Self {
            p_z: Matrix::zeros(s, at.p_z.len()),
            v_z: Matrix::zeros(s, at.v_z.as_ref().map_or(0, Pattern::len)),
            p_y: Matrix::zeros(s, at.p_y.len()),
            f_y: Matrix::zeros(s, at.f_y.len()),
            f_z: Matrix::zeros(s, at.f_z.len()),
            v_y: Matrix::zeros(s, at.v_y.len()),
            g_y: Matrix::zeros(nodes, at.g_y.len()),
            r_lam: Matrix::zeros(nodes, at.r_lam.len()),
            r_y: Matrix::zeros(nodes, at.r_y.len()),
            own: (problem.nonholonomic.as_ref())
                .map(|own| NonholonomicDerivatives::new(problem, &own.patterns, s).into()),
            is_ready: false,
        }
    }

    /// Evaluates all where the stages are and z1 at the end of the step, r_y at the first `nodes` nodes.
    pub(super) fn evaluate(
        &mut self,
        model: &mut Model<R>,
        stages: &Stages<R>,
        (step, z1): (Step<R>, &[R]),
        nodes: usize,
    ) -> Result<(), StepError> {
        if let Some(own) = &mut self.own {
            own.evaluate(model, stages, step, z1)?;
        }
        let times = stages.stage_times(step);
        let (y, z) = (&stages.y, &stages.unknowns.z);
        let out = [&mut self.p_z, &mut self.v_z];
        take(
            out,
            times,
            model.stages_blocks((times, [y, z])),
            (y.rows(), self.is_ready),
        )?;
        let out = [&mut self.p_y, &mut self.f_y, &mut self.f_z, &mut self.v_y];
        take(
            out,
            times,
            model.stages_jacobian((times, [y, z])),
            (y.rows(), self.is_ready),
        )?;
        if model.problem.m == 0 {
            self.is_ready = true;
            return Ok(());
        }
        let times = stages.node_times(step);
        let (y, lam) = (&stages.node_y, &stages.unknowns.lam);
        let out = [&mut self.g_y, &mut self.r_lam];
        take(
            out,
            times,
            model.nodes_blocks((times, [y, lam])),
            (y.rows(), self.is_ready),
        )?;
        let points = model.nodes_jacobian((times, [y, lam]));
        take([&mut self.r_y], times, points, (nodes, self.is_ready))?;
        self.is_ready = true;
        Ok(())
    }
}

/// Copies values at so many points, which have to be finite; constants once.
pub(super) fn take<R: Real, const N: usize>(
    out: [&mut Matrix<R>; N],
    times: Times,
    mut points: Points<'_, N, R>,
    (count, is_ready): (usize, bool),
) -> Result<(), StepError> {
    if is_ready && points.is_constant() {
        return Ok(());
    }
    let mut out = out;
    let is_finite = dispatch_simd::<R, _>(
        #[inline(always)]
        || {
            for i in 0..count {
                for (out, values) in out.iter_mut().zip(points.at(i)) {
                    if !values.is_empty() {
                        copy(out.row_mut(i), values);
                    }
                }
            }
            out.iter().all(|out| all_finite(out.flat()))
        },
    );
    if is_finite {
        return Ok(());
    }
    let mut rows = (0..count).flat_map(|i| out.iter().map(move |out| (times.at(i), out.row(i))));
    rows.try_for_each(|(t, values)| finite(values, Quantity::Derivative, t))
}
