//! Derivatives by time and parameters of systems made without a front end.

use super::{Expr, FOURTH, Functions, LAM, PARAMS, T, Y, Z, dot, inputs, jacobian, tape};
use liouville_base::linalg::Pattern;
use liouville_index2::semi_explicit::{
    SemiExplicit, SemiExplicitSensitivity, SemiExplicitSensitivityPatterns,
};
use liouville_problem::{Mechanical, Sensitivity, SensitivityPatterns};
use std::sync::Arc;

/// λ and the parameters where a tape takes z' too.
const FIFTH: usize = 4;
const SIXTH: usize = 5;

impl Functions {
    /// The derivatives that tangents of this system need, the system being `problem`.
    pub fn sensitivity(&self, problem: &Arc<Mechanical>) -> Arc<Sensitivity> {
        let (n, m, params) = (self.p.len(), self.g.len(), self.params);
        let reaction = self.r.clone().unwrap_or_else(|| self.ideal_reaction());
        let velocity = self.v.clone().unwrap_or_else(|| inputs(Z, n));
        let hidden: Vec<_> = self.g.iter().map(|g| rate(g, &velocity)).collect();
        let stage = |of: &[Expr]| by_tau(of, n, PARAMS, params);
        let (p_tau, f_tau) = (stage(&self.p), stage(&self.f));
        let v_tau = stage(self.v.as_deref().unwrap_or(&[]));
        let (g_tau, r_tau) = (by_tau(&self.g, m, PARAMS, params), stage(&reaction));
        let (w_y, w_tau) = (
            jacobian(&hidden, Y, m, n),
            by_tau(&hidden, m, PARAMS, params),
        );

        let far = |of: &[Expr]| {
            of.iter()
                .map(|x| x.moved(PARAMS, SIXTH))
                .collect::<Vec<_>>()
        };
        let (p, f, v, w) = (far(&self.p), far(&self.f), far(&velocity), far(&hidden));
        let r: Vec<_> = far(&reaction).iter().map(|r| r.moved(LAM, FIFTH)).collect();
        let u = inputs(FOURTH, n);
        let along = |x: &Expr| {
            let slopes: Vec<_> = (0..n).map(|k| x.d(Z, k)).collect();
            rate(x, &v) + dot(&slopes, &u)
        };
        let residual: Vec<_> = (0..n).map(|k| along(&p[k]) - &f[k] - &r[k]).collect();
        let rates: Vec<_> = w.iter().map(along).collect();
        let by = |of: &[Expr], rows| {
            let own = [jacobian(of, Y, rows, n), jacobian(of, Z, rows, n)];
            let [y, z] = own;
            [y, z, by_tau(of, rows, SIXTH, params)]
        };
        let (motion, rate) = (by(&residual, n), by(&rates, m));
        let values = |parts: &[&(Pattern, Vec<Expr>)]| {
            let parts = parts.iter().map(|part| part.1.clone());
            parts.flatten().collect::<Vec<_>>()
        };
        let six: Vec<_> = motion.iter().chain(&rate).collect();
        let found = Sensitivity {
            mechanical: problem.clone(),
            stage: tape([1, n, n, params], &values(&[&p_tau, &f_tau, &v_tau])),
            node: tape([1, n, m, params], &values(&[&g_tau, &r_tau])),
            hidden: tape([1, n, n, params], &values(&[&w_y, &w_tau])),
            motion: tape([1, n, n, n, m, params], &values(&six)),
            nonholonomic: None,
            patterns: SensitivityPatterns {
                nonholonomic: None,
                p_tau: p_tau.0,
                f_tau: f_tau.0,
                v_tau: self.v.as_ref().map(|_| v_tau.0),
                g_tau: g_tau.0,
                r_tau: r_tau.0,
                w_y: w_y.0,
                w_tau: w_tau.0,
                motion: motion.map(|part| part.0),
                rate: rate.map(|part| part.0),
            },
        };
        Arc::new(found.checked().expect("tapes and patterns fit together"))
    }
}

/// The derivatives by time of a semi-explicit system without parameters, (f, k).
pub fn semi_explicit_sensitivity(
    f: &[Expr],
    k: &[Expr],
    system: &Arc<SemiExplicit>,
) -> Arc<SemiExplicitSensitivity> {
    let (n, l) = (f.len(), k.len());
    let w: Vec<_> = k.iter().map(|k| rate(k, f)).collect();
    let by_t = |of: &[Expr], rows| jacobian(of, T, rows, 1);
    let (f_tau, k_tau) = (by_t(f, n), by_t(k, l));
    let (w_y, w_tau) = (jacobian(&w, Y, l, n), by_t(&w, l));
    let found = SemiExplicitSensitivity {
        system: system.clone(),
        field: tape([1, n, l, 0], &f_tau.1),
        constraint: tape([1, n, 0], &k_tau.1),
        hidden: tape([1, n, l, 0], &[w_y.1, w_tau.1].concat()),
        patterns: SemiExplicitSensitivityPatterns {
            f_tau: f_tau.0,
            k_tau: k_tau.0,
            w_y: w_y.0,
            w_tau: w_tau.0,
        },
    };
    Arc::new(found.checked().expect("tapes and patterns fit together"))
}

/// x_t + x_y v
fn rate(x: &Expr, v: &[Expr]) -> Expr {
    let slopes: Vec<_> = (0..v.len()).map(|k| x.d(Y, k)).collect();
    x.d(T, 0) + dot(&slopes, v)
}

/// Derivatives by time, then by the parameters in this group.
fn by_tau(of: &[Expr], rows: usize, group: usize, params: usize) -> (Pattern, Vec<Expr>) {
    let (by_t, by_params) = (jacobian(of, T, rows, 1), jacobian(of, group, rows, params));
    let shifted = by_params.0.entries().iter().map(|(i, j)| (*i, j + 1));
    let entries = by_t.0.entries().iter().copied().chain(shifted);
    let pattern = Pattern::new(rows, 1 + params, entries.collect()).expect("entries lie inside");
    (pattern, [by_t.1, by_params.1].concat())
}
