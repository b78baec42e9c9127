//! The Newton matrix: blocks of the stages, of the nodes and of the end, and what dV adds to them.

use super::{Places, Solve};
use crate::problem::{diagnose_rank_all, finite};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Pattern, add_scaled, copy};

impl Solve<'_> {
    pub(super) fn freeze(&mut self) -> Result<(), StepError> {
        self.solver.coupling.clear();
        self.solver.newton.matrix_mut().clear();
        if let Some(lu) = &mut self.solver.elimination {
            lu.matrix_mut().clear();
            (0..lu.order()).for_each(|k| lu.matrix_mut()[(k, k)] = 1.0);
        }
        for j in 0..self.stages.tableau.stages {
            self.add_motion(j)?;
            self.add_rolling(j)?;
        }
        if self.model.problem.m > 0 {
            for node in 0..=self.stages.tableau.intervals {
                self.add_node(node)?;
            }
        }
        self.add_end()?;
        self.close()
    }

    /// What comes from p, f and v of stage `j`.
    fn add_motion(&mut self, j: usize) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let (n, s, h) = (model.problem.n, stages.tableau.stages, step.h);
        let problem = model.problem.clone();
        let (at, tableau) = (&problem.patterns, &stages.tableau);
        let end = solver.places.p;
        let (newton, coupling) = (solver.newton.matrix_mut(), &mut solver.coupling);
        let (t, y, z) = (
            stages.stage_time(*step, j),
            stages.y.row(j),
            stages.unknowns.z.row(j),
        );
        let [p_z, v_z] = model.stage_blocks(t, y, z);
        finite(p_z, Quantity::Derivative, t)?;
        finite(v_z, Quantity::Derivative, t)?;
        at.p_z.add_to(p_z, 1.0, newton, j * n, j * n);
        if let Some(pattern) = &at.v_z {
            solver.v_z[j].clear();
            pattern.add_to(v_z, 1.0, &mut solver.v_z[j], 0, 0);
        }
        let [p_y, f_y, f_z, v_y] = model.stage_jacobian(t, y, z);
        for values in [p_y, f_y, f_z, v_y] {
            finite(values, Quantity::Derivative, t)?;
        }
        for i in 0..s {
            let moved = h * tableau.a_v[(j, i)];
            at.p_y.add_to(p_y, moved, coupling, j * n, i * n);
            if let Some(lu) = &mut solver.elimination {
                at.v_y.add_to(v_y, -moved, lu.matrix_mut(), j * n, i * n);
            }
            let pushed = -h * tableau.a_f[(i, j)];
            at.f_z.add_to(f_z, pushed, newton, i * n, j * n);
            for q in 0..s {
                let factor = pushed * h * tableau.a_v[(j, q)];
                at.f_y.add_to(f_y, factor, coupling, i * n, q * n);
            }
            let factor = -h * tableau.b[j] * moved;
            at.f_y.add_to(f_y, factor, coupling, end, i * n);
        }
        let pushed = -h * tableau.b[j];
        at.f_z.add_to(f_z, pushed, newton, end, j * n);
        Ok(())
    }

    /// What comes from k and its reactions at stage `j`.
    fn add_rolling(&mut self, j: usize) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let problem = model.problem.clone();
        let Some(own) = &problem.nonholonomic else {
            return Ok(());
        };
        let (n, l, s, h) = (problem.n, own.l, stages.tableau.stages, step.h);
        let (at, tableau, places) = (&own.patterns, &stages.tableau, solver.places);
        let (newton, coupling) = (solver.newton.matrix_mut(), &mut solver.coupling);
        let t = stages.stage_time(*step, j);
        let unknowns = &stages.unknowns;
        let [k_y, k_z, r_y, r_z, r_nu] =
            model.nonholonomic_blocks(t, stages.y.row(j), unknowns.z.row(j), unknowns.nu.row(j));
        for values in [k_y, k_z, r_y, r_z, r_nu] {
            finite(values, Quantity::Derivative, t)?;
        }
        copy(solver.r_nu.row_mut(j), r_nu);
        let stage_rows = (0..s).map(|i| (i * n, tableau.a_r[(i, j)]));
        for (row, weight) in stage_rows.chain([(places.p, tableau.b[j])]) {
            at.r_z.add_to(r_z, -h * weight, newton, row, j * n);
            let column = places.nu + j * l;
            at.r_nu.add_to(r_nu, -weight, newton, row, column);
            for i in 0..s {
                let factor = -h * weight * h * tableau.a_v[(j, i)];
                at.r_y.add_to(r_y, factor, coupling, row, i * n);
            }
        }
        for q in 0..solver.moments.rows() {
            let (row, weight) = (places.moments + q * l, solver.moments[(q, j)]);
            at.k_z.add_to(k_z, weight, newton, row, j * n);
            for i in 0..s {
                let factor = weight * h * tableau.a_v[(j, i)];
                at.k_y.add_to(k_y, factor, coupling, row, i * n);
            }
        }
        Ok(())
    }

    /// What comes from g and r at a node.
    fn add_node(&mut self, node: usize) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let problem = model.problem.clone();
        let (n, m, h) = (problem.n, problem.m, step.h);
        let (at, tableau, places) = (&problem.patterns, &stages.tableau, solver.places);
        let (s, k) = (tableau.stages, tableau.intervals);
        let (newton, coupling) = (solver.newton.matrix_mut(), &mut solver.coupling);
        let t = stages.node_time(*step, node);
        let (y, lam) = (stages.node_y.row(node), stages.unknowns.lam.row(node));
        let [g_y, r_lam] = model.node_blocks(t, y, lam);
        finite(g_y, Quantity::Derivative, t)?;
        finite(r_lam, Quantity::Derivative, t)?;
        copy(solver.r_lam.row_mut(node), r_lam);
        if node > 0 {
            let row = places.g + (node - 1) * m;
            for j in 0..s {
                let weight = tableau.a_bar[(node, j)];
                at.g_y.add_to(g_y, weight, coupling, row, j * n);
            }
        }
        let column = if node < k {
            places.lam + node * m
        } else {
            places.last_lam
        };
        let stage_rows = (0..s).map(|i| (i * n, tableau.a_hat[(i, node)]));
        let rows = stage_rows.chain([(places.p, tableau.b_hat[node])]);
        let rows = rows.filter(|(_, weight)| *weight != 0.0);
        for (row, weight) in rows.clone() {
            at.r_lam.add_to(r_lam, -weight, newton, row, column);
        }
        let r_y = model.node_jacobian(t, y, lam);
        finite(r_y, Quantity::Derivative, t)?;
        for (row, weight) in rows {
            for j in 0..s {
                let factor = -h * weight * h * tableau.a_bar[(node, j)];
                at.r_y.add_to(r_y, factor, coupling, row, j * n);
            }
        }
        Ok(())
    }

    /// What comes from p, w and k at the end, which moves by h b_j dV_j.
    fn add_end(&mut self) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            z1,
            ..
        } = self;
        let problem = model.problem.clone();
        let Some(own) = &problem.nonholonomic else {
            return Ok(());
        };
        let (n, at, at_own) = (problem.n, &problem.patterns, &own.patterns);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (
            Places {
                k: row,
                p,
                w,
                z1: column,
                ..
            },
            y1,
        ) = (solver.places, stages.node_y.row(k));
        let (newton, coupling) = (solver.newton.matrix_mut(), &mut solver.coupling);
        let t = stages.node_time(*step, k);
        let mut add_moved = |pattern: &Pattern, values: &[f64], row: usize| {
            for (j, b) in stages.tableau.b.iter().enumerate() {
                pattern.add_to(values, step.h * b, coupling, row, j * n);
            }
            finite(values, Quantity::Derivative, t)
        };
        let [p_z, v_z] = model.stage_blocks(t, y1, z1);
        finite(p_z, Quantity::Derivative, t)?;
        finite(v_z, Quantity::Derivative, t)?;
        at.p_z.add_to(p_z, 1.0, newton, p, column);
        if let Some(pattern) = &at.v_z {
            solver.v_z[s].clear();
            pattern.add_to(v_z, 1.0, &mut solver.v_z[s], 0, 0);
        }
        let [p_y, ..] = model.stage_jacobian(t, y1, z1);
        add_moved(&at.p_y, p_y, p)?;
        let [k_y, k_z, ..] = model.nonholonomic_blocks(t, y1, z1, stages.unknowns.nu.row(s - 1));
        finite(k_z, Quantity::Derivative, t)?;
        at_own.k_z.add_to(k_z, 1.0, newton, row, column);
        add_moved(&at_own.k_y, k_y, row)?;
        add_moved(&at_own.w_y, model.hidden_jacobian(t, y1, z1), w)?;
        let [g_y, _] = model.node_blocks(t, y1, stages.unknowns.lam.row(k));
        for (&(i, j), g_y) in at.g_y.entries().iter().zip(g_y) {
            let out = &mut newton.row_mut(w + i)[column..column + n];
            add_scaled(out, *g_y, solver.v_z[s].row(j));
        }
        Ok(())
    }

    /// Eliminates dV and factors.
    fn close(&mut self) -> Result<(), StepError> {
        let (solver, n) = (&mut *self.solver, self.z1.len());
        if let Some(lu) = &mut solver.elimination {
            lu.factor().map_err(|_| StepError::SingularNewton)?;
        }
        for row in 0..solver.coupling.rows() {
            if let Some(lu) = &solver.elimination {
                lu.solve_transposed(solver.coupling.row_mut(row));
            }
            let out = solver.newton.matrix_mut().row_mut(row);
            for (place, factor) in solver.coupling.row(row).iter().enumerate() {
                if *factor != 0.0 {
                    let (j, k) = (place / n, place % n);
                    add_scaled(&mut out[j * n..(j + 1) * n], *factor, solver.v_z[j].row(k));
                }
            }
        }
        let is_regular = solver.newton.factor().is_ok();
        if is_regular && self.model.problem.is_linear {
            return Ok(());
        }
        let (stages, model, z1) = (&*self.stages, &mut *self.model, &*self.z1);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (t, y1) = (stages.node_time(self.step, k), stages.node_y.row(k));
        solver.mass.update(model, t, y1, z1)?;
        if is_regular {
            return Ok(());
        }
        let nu = stages.unknowns.nu.row(s - 1);
        let k_z = model.nonholonomic_blocks(t, y1, z1, nu)[1].to_vec();
        let problem = model.problem.clone();
        let [g_y, _] = model.node_blocks(t, y1, stages.unknowns.lam.row(k));
        Err(diagnose_rank_all(&problem, &solver.mass, g_y, &k_z))
    }
}
