//! The end of a step of a small system, as in `update` of `crates/spark`: one correction, since all is linear.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::layout::Layout;
use super::{Fixed, LAM, Z};
use liouville_base::compensated::Compensated;
use liouville_base::linalg::{add_compensated, max_norm, sum_compensated};
use liouville_base::newton::{self, Projection, Stop};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_problem::{Model, State, Step};

/// The state at the end, and λ_k.
#[derive(Clone, Debug)]
pub(super) struct End<L, const N: usize, const M: usize> {
    pub(super) z: [L; N],
    z0: [L; N],
    y: [L; N],
    p: [L; N],
    y_low: [L; N],
    p_low: [L; N],
    /// Rounding errors of the sums of increments.
    y_lost: [L; N],
    p_lost: [L; N],
    lam: [L; M],
}

/// G, r_λ, M⁻¹ r_λ and S = G M⁻¹ r_λ at y1.
struct EndBlocks<L, const N: usize, const M: usize> {
    gradient: [[L; N]; M],
    r_lam: [[L; N]; M],
    mass_r: [[L; N]; M],
    s: [[L; M]; M],
}

impl<L: Layout, const N: usize, const M: usize> Default for EndBlocks<L, N, M> {
    fn default() -> Self {
        let zeros = [[L::splat(0.0); N]; M];
        Self {
            gradient: zeros,
            r_lam: zeros,
            mass_r: zeros,
            s: [[L::splat(0.0); M]; M],
        }
    }
}

impl<L: Layout, const N: usize, const M: usize> End<L, N, M> {
    pub(super) fn new() -> Self {
        let zeros = [L::splat(0.0); N];
        Self {
            z: zeros,
            z0: zeros,
            y: zeros,
            p: zeros,
            y_low: zeros,
            p_low: zeros,
            y_lost: zeros,
            p_lost: zeros,
            lam: [L::splat(0.0); M],
        }
    }
}

/// Changes of V below its last bit are at most this part of the speed of the coordinates.
const LAST_BITS: f64 = 64.0 * f64::EPSILON;

impl<L: Layout, const N: usize, const M: usize> Fixed<L, N, M> {
    /// (U1)–(U3) at the last iterate; `None` where that is not finite.
    pub(super) fn finish(
        &mut self,
        model: &mut Model<L>,
        step: Step<L>,
        (loses, stop): (bool, Stop),
    ) -> Option<()> {
        dispatch_simd::<L::Row, _>(
            #[inline(always)]
            || {
                self.evaluate(step, false);
                self.accumulate(step, loses);
            },
        );
        dispatch_simd::<L, _>(
            #[inline(always)]
            || {
                self.project(model, step, Projection::new(stop));
                self.correct_end(model, step);
            },
        );
        let n = self.problem.n;
        let end = &self.end;
        let is_finite = (end.y[..n].iter().chain(&end.z[..n]).chain(&end.p[..n]))
            .fold(L::splat(0.0), |sum, x| sum + *x * 0.0)
            .all(|x| x == 0.0);
        is_finite.then_some(())
    }

    /// y1, and the increment of p without the last reaction.
    #[inline(always)]
    fn accumulate(&mut self, step: Step<L>, loses: bool) {
        let (s, k) = (self.tables.stages, self.tables.intervals);
        let (n, m) = (self.problem.n.min(N), self.problem.m);
        let State {
            y_low, p_low, z, ..
        } = step.state;
        let end = &mut self.end;
        let last_bits = (self.speed * L::splat(LAST_BITS)).every();
        for q in 0..n {
            (end.y_low[q], end.p_low[q]) = (y_low[q], p_low[q]);
            (end.y_lost[q], end.p_lost[q]) = (L::splat(0.0), L::splat(0.0));
            end.z0[q] = z[q];
            // displacements as the nodes have them: the rounded ones of the start, and the way from there
            for row in 0..L::rows(s) {
                let b = L::factor(&self.weights[0], row);
                let mut moved = self.moved[q].as_ref()[row];
                if loses {
                    // more than that is roundoff as a stiff force sees it, and no part of V
                    let lost = self.velocity[q].as_ref()[row].zip(
                        last_bits,
                        #[inline(always)]
                        |lost, most| if lost.abs() <= most { lost } else { 0.0 },
                    );
                    moved -= lost * b;
                }
                let start = self.start_of_iteration.z[q].as_ref()[row] * b;
                let sum = Compensated::sum(start, moved);
                self.displacements[q].as_mut()[row] = sum.high;
                self.moved[q].as_mut()[row] = sum.low;
            }
            for j in 0..s {
                let displacement = L::at(&self.displacements[q], j);
                add_compensated_one(&mut end.y_low[q], &mut end.y_lost[q], displacement);
                end.y_lost[q] += L::at(&self.moved[q], j);
                let impulse = L::at(&self.impulses[q], j);
                add_compensated_one(&mut end.p_low[q], &mut end.p_lost[q], impulse);
            }
            if m > 0 {
                for l in 0..k {
                    let impulse = L::at(&self.reactions[q], l);
                    add_compensated_one(&mut end.p_low[q], &mut end.p_lost[q], impulse);
                }
            }
        }
        sum_compensated(&step.state.y, &mut end.y_low[..n], &mut end.y[..n]);
        for q in 0..n {
            end.y_low[q] += end.y_lost[q];
        }
        for c in 0..m.min(M) {
            end.lam[c] = L::at(&self.lam[c], k);
        }
    }

    /// Moves y1 onto the constraints at t1, along M⁻¹ r_λ.
    #[inline(always)]
    fn project(&mut self, model: &mut Model<L>, step: Step<L>, mut projection: Projection<L>) {
        let (n, m) = (self.problem.n.min(N), self.problem.m.min(M));
        if m == 0 || !projection.is_wanted() {
            return;
        }
        let t = step.t + self.tables.c_hat.0[self.tables.intervals] * step.h;
        self.update_mass(model, t);
        let blocks = self.end_blocks(model, t);
        let end = &mut self.end;
        while projection.is_wanted() {
            let [g, _] = model.node(t, &end.y[..n], &end.lam[..m]);
            let mut sides = [L::splat(0.0); M];
            for c in 0..m {
                sides[c] = -g[c];
            }
            let impulses = solve_small(m, &blocks.s, sides);
            let mut moved = [L::splat(0.0); N];
            for q in 0..n {
                for c in 0..m {
                    moved[q] += blocks.mass_r[c][q] * impulses[c];
                }
            }
            let taken = projection.take(max_norm(&moved[..n]), max_norm(&end.y[..n]));
            for q in 0..n {
                let sum = Compensated::sum(end.y[q], end.y_low[q] + moved[q]);
                end.y[q] = taken.choose(sum.high, end.y[q]);
                end.y_low[q] = taken.choose(sum.low, end.y_low[q]);
            }
        }
    }

    /// M⁻¹ at y1, where it varies.
    #[inline(always)]
    fn update_mass(&mut self, model: &mut Model<L>, t: f64) {
        if !self.is_newton() {
            return;
        }
        let n = self.problem.n;
        let mut mass = [[L::splat(0.0); N]; N];
        let [p_z, _] = model.stage_blocks(t, &self.end.y[..n], &self.end.z[..n]);
        for (&(row, col), x) in self.problem.patterns.p_z.entries().iter().zip(p_z) {
            mass[row][col] = *x;
        }
        for q in n..N {
            mass[q][q] = L::splat(1.0);
        }
        self.inverse_mass = inverse_of(mass, n.min(N));
    }

    /// The blocks of the constraints at y1.
    #[inline(always)]
    fn end_blocks(&self, model: &mut Model<L>, t: f64) -> EndBlocks<L, N, M> {
        let (n, m) = (self.problem.n, self.problem.m.min(M));
        let mut gradient = [[L::splat(0.0); N]; M];
        let mut r_lam = gradient;
        let at = &self.problem.patterns;
        let [g_y, r] = model.node_blocks(t, &self.end.y[..n], &self.end.lam[..m]);
        for (&(c, q), x) in at.g_y.entries().iter().zip(g_y) {
            gradient[c][q] = *x;
        }
        for (&(q, c), x) in at.r_lam.entries().iter().zip(r) {
            r_lam[c][q] = *x;
        }
        let mut mass_r = [[L::splat(0.0); N]; M];
        for c in 0..m {
            mass_r[c] = self.inverse_times(&r_lam[c]);
        }
        let mut s = [[L::splat(0.0); M]; M];
        for c in 0..m {
            for d in 0..m {
                s[c][d] = dot(&gradient[c], &mass_r[d]);
            }
        }
        EndBlocks {
            gradient,
            r_lam,
            mass_r,
            s,
        }
    }

    /// z1 and λ_k from (U2) and (U3).
    #[inline(always)]
    fn correct_end(&mut self, model: &mut Model<L>, step: Step<L>) {
        let (n, m, k) = (
            self.problem.n.min(N),
            self.problem.m.min(M),
            self.tables.intervals,
        );
        let t = step.t + self.tables.c_hat.0[k] * step.h;
        let weight = self.weights[1].0[k];
        let mut reaction = [L::splat(0.0); N];
        let mut blocks = EndBlocks::default();
        self.update_mass(model, t);
        if m > 0 {
            blocks = self.end_blocks(model, t);
            let [_, r] = model.node(t, &self.end.y[..n], &self.end.lam[..m]);
            reaction[..n].copy_from_slice(r);
        }
        let end = &mut self.end;
        let mut momentum = end.p_low;
        let [p, w, _] = model.end(t, &end.y[..n], &end.z[..n]);
        for q in 0..n {
            momentum[q] += reaction[q] * weight;
            momentum[q] -= p[q] - step.state.p[q];
        }
        // S μ = −w − G M⁻¹ a
        let velocity = self.inverse_times(&momentum);
        let mut sides = [L::splat(0.0); M];
        for c in 0..m {
            sides[c] = -w[c] - dot(&blocks.gradient[c], &velocity);
        }
        let impulses = solve_small(m, &blocks.s, sides);
        let end = &mut self.end;
        for q in 0..n {
            let mut d_z = velocity[q];
            for c in 0..m {
                d_z += blocks.mass_r[c][q] * impulses[c];
                reaction[q] += blocks.r_lam[c][q] * (impulses[c] * (1.0 / weight));
            }
            end.z[q] += d_z;
            reaction[q] *= L::splat(weight);
        }
        for c in 0..m {
            end.lam[c] += impulses[c] * (1.0 / weight);
        }
        add_compensated(&mut end.p_low[..n], &mut end.p_lost[..n], &reaction[..n]);
        sum_compensated(&step.state.p, &mut end.p_low[..n], &mut end.p[..n]);
        for q in 0..n {
            end.p_low[q] += end.p_lost[q];
        }
    }

    /// M⁻¹ x
    #[inline(always)]
    fn inverse_times(&self, x: &[L; N]) -> [L; N] {
        let mut out = [L::splat(0.0); N];
        for (out, row) in out.iter_mut().zip(&self.inverse_mass) {
            *out = dot(row, x);
        }
        out
    }

    /// Writes the end of the step, and the values that the next one is extrapolated from.
    #[inline(never)]
    pub fn commit(&self, held: &mut newton::Predictor<L>, h: f64, state: &mut State<L>) {
        let (n, end) = (self.problem.n, &self.end);
        state.y.copy_from_slice(&end.y[..n]);
        state.z.copy_from_slice(&end.z[..n]);
        state.p.copy_from_slice(&end.p[..n]);
        state.y_low.copy_from_slice(&end.y_low[..n]);
        state.p_low.copy_from_slice(&end.p_low[..n]);
        self.hold(held, h);
    }

    /// Holds the polynomials that another step is extrapolated from.
    pub fn hold(&self, held: &mut newton::Predictor<L>, h: f64) {
        let (n, m, k) = (self.problem.n, self.problem.m, self.tables.intervals);
        let (end, last) = (&self.end, self.tables.stages + 1);
        let values = &mut held.curves[Z].values;
        values.row_mut(0).copy_from_slice(&end.z0[..n]);
        values.row_mut(last).copy_from_slice(&end.z[..n]);
        for i in 1..last {
            for (q, out) in values.row_mut(i).iter_mut().enumerate() {
                *out = L::at(&self.z[q], i - 1);
            }
        }
        let values = &mut held.curves[LAM].values;
        for j in 0..k {
            for (c, out) in values.row_mut(j).iter_mut().enumerate() {
                *out = L::at(&self.lam[c], j);
            }
        }
        values.row_mut(k).copy_from_slice(&end.lam[..m]);
        held.hold(h);
    }
}

#[inline(always)]
fn add_compensated_one<L: Layout>(sum: &mut L, lost: &mut L, x: L) {
    add_compensated(std::slice::from_mut(sum), std::slice::from_mut(lost), &[x]);
}

#[inline(always)]
fn dot<L: Layout, const N: usize>(a: &[L; N], b: &[L; N]) -> L {
    let mut sum = a[0] * b[0];
    for q in 1..N {
        sum += a[q] * b[q];
    }
    sum
}

/// The inverse, by Gauss and Jordan without pivots.
#[inline(always)]
fn inverse_of<L: Layout, const N: usize>(mut a: [[L; N]; N], n: usize) -> [[L; N]; N] {
    for k in 0..n {
        let inverse = L::splat(1.0) / a[k][k];
        let mut pivot = a[k];
        pivot[k] = L::splat(1.0);
        for x in &mut pivot {
            *x *= inverse;
        }
        for (i, row) in a.iter_mut().enumerate().take(n) {
            if i == k {
                continue;
            }
            let factor = row[k];
            row[k] = L::splat(0.0);
            for (x, pivot) in row.iter_mut().zip(&pivot) {
                *x -= factor * *pivot;
            }
        }
        a[k] = pivot;
    }
    a
}

/// The solution of one or two equations, by determinants; of more, by elimination with pivots, each member's own.
#[inline(always)]
fn solve_small<L: Layout, const M: usize>(m: usize, s: &[[L; M]; M], b: [L; M]) -> [L; M] {
    let mut x = b;
    match m {
        0 => {}
        1 => x[0] = b[0] / s[0][0],
        2 => {
            let determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
            x[0] = (b[0] * s[1][1] - s[0][1] * b[1]) / determinant;
            x[1] = (s[0][0] * b[1] - b[0] * s[1][0]) / determinant;
        }
        _ => eliminate(m.min(M), *s, &mut x),
    }
    x
}

#[inline(always)]
fn eliminate<L: Layout, const M: usize>(m: usize, mut a: [[L; M]; M], x: &mut [L; M]) {
    for k in 0..m {
        let (upper, lower) = a.split_at_mut(k + 1);
        let (pivot, x_k) = (&mut upper[k], &mut x[k..m]);
        for (i, row) in lower[..m - k - 1].iter_mut().enumerate() {
            let is_larger = row[k].zip(pivot[k], |x, y| f64::from(u8::from(x.abs() > y.abs())));
            for (up, down) in pivot[k..m].iter_mut().zip(&mut row[k..m]) {
                (*up, *down) = (is_larger.choose(*down, *up), is_larger.choose(*up, *down));
            }
            let (up, down) = (x_k[0], x_k[i + 1]);
            x_k[0] = is_larger.choose(down, up);
            x_k[i + 1] = is_larger.choose(up, down);
        }
        for (i, row) in lower[..m - k - 1].iter_mut().enumerate() {
            let factor = row[k] / pivot[k];
            for (x, of) in row[k + 1..m].iter_mut().zip(&pivot[k + 1..m]) {
                *x -= factor * *of;
            }
            let of = x_k[0];
            x_k[i + 1] -= factor * of;
        }
    }
    for k in (0..m).rev() {
        for j in k + 1..m {
            let of = x[j];
            x[k] -= a[k][j] * of;
        }
        x[k] = x[k] / a[k][k];
    }
}
