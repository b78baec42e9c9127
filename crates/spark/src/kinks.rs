//! Steps within which a force jumps or bends where no stage sees it.
//!
//! The polynomial Q through v0 at 0, V_i at c_i and v1 at 1 misses the accelerations at both ends by
//!
//!     D_k = Q'(k) − h v'_k,     k = 0, 1,
//!
//! where v' is that of the index-1 form. For a smooth motion of frequency ω that is ωh times the defect e of the
//! velocities, a quarter of a period apart from it; from step to step e grows as h^s, and D as h^(s+1). A force that
//! begins after the last stage or ends before the first changes D alone, by h Δf; one that begins between makes e grow
//! by powers of ten. Either changes the velocity by about c_1 max(D, e), for as long as the time scale |y|/|v|, but no
//! longer than a thousand steps, or of a tangent the longest so far. Of tangents the same is asked where stages lie at
//! the ends: Q has the velocities of the ends there.

use super::predictor::Predictor;
use liouville_base::checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy, max_norm};
use liouville_base::tableau;
use liouville_problem::{Estimate, Model, State, StepVelocities};

/// D of a smooth motion is at most so many times what e and the step before let expect.
const SMOOTH: f64 = 20.0;
/// An error of the velocity is held against the positions for so many steps, or longer.
const HELD: f64 = 1000.0;
/// Defects count by how much they are above so many roundings of the positions in a step, those of the accelerations
/// above s² times as many.
const ROUNDINGS: f64 = 1024.0;
/// The power of h with which the error of a bend falls.
pub(super) const ORDER: f64 = 2.0;

/// Measures of the accelerations at the ends of a step.
#[derive(Clone, Debug, Default)]
pub(super) struct Kinks {
    /// Q' at 0 and at 1; none where stages lie at the ends.
    slopes: [Vec<f64>; 2],
    /// c_1.
    part: f64,
    /// v' at the ends of the last step.
    ends: [Vec<f64>; 2],
    lam: Vec<f64>,
    rate: Vec<f64>,
    /// D at both ends of the last step.
    pub(super) defects: [Vec<f64>; 2],
    /// Which end of the last step the next one begins at, one of those below; e and D of the last step in
    /// units of a tolerance times the unit, and h.
    memory: Vec<f64>,
    /// e, D and h of the step before that, to undo the last one; and whether they were replaced.
    before: [f64; 3],
    is_judged: bool,
}

/// At neither, at its start, or at its end.
const NONE: f64 = 0.0;
const START: f64 = 1.0;
const END: f64 = 2.0;

/// The quantity whose roundoff a defect may be.
#[derive(Clone, Copy, Debug)]
pub(super) enum Roundoff {
    /// Positions, in a step: of equations that are iterated to that, and of constraints.
    Positions,
    /// Velocities alone.
    Velocities,
}

/// A motion or a tangent that is judged.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judged {
    /// The unit of its tolerance, which may differ from step to step.
    pub(super) unit: f64,
    /// For how long an error of the velocity is held at least, if the time scale is as long.
    pub(super) held: f64,
    /// The quantity whose roundoff its defects may be.
    pub(super) roundoff: Roundoff,
}

const OF_MOTION: Judged = Judged {
    unit: 1.0,
    held: 0.0,
    roundoff: Roundoff::Positions,
};

impl Kinks {
    /// Memory for the steps of this method.
    pub(super) fn new(model: &Model, tableau: &tableau::Spark) -> Self {
        match tableau.c[..] {
            [first, .., last] if first > 0.0 && last < 1.0 => Self::of_tangent(model, tableau),
            [only] if 0.0 < only && only < 1.0 => Self::of_tangent(model, tableau),
            _ => Self::default(),
        }
    }

    /// The same for a tangent.
    pub(super) fn of_tangent(model: &Model, tableau: &tableau::Spark) -> Self {
        // stages at the ends stand for nothing
        let is_inner = |c: &f64| 0.0 < *c && *c < 1.0;
        let inner: Vec<f64> = tableau.c.iter().copied().filter(is_inner).collect();
        let nodes = [&[0.0], &inner[..], &[1.0]].concat();
        let first = usize::from(tableau.c.first() == Some(&0.0));
        let last = usize::from(tableau.c.last() == Some(&1.0));
        let zeros = vec![0.0; model.problem.n];
        let weights = |end: usize| {
            let mut of_rows = slopes(&nodes, end);
            let before_last = of_rows.len() - 1;
            of_rows.splice(before_last..before_last, vec![0.0; last]);
            of_rows.splice(1..1, vec![0.0; first]);
            of_rows
        };
        let is_at_end = first + last > 0;
        Self {
            slopes: [0, nodes.len() - 1].map(weights),
            part: if is_at_end { nodes[1] / 2.0 } else { nodes[1] },
            ends: [zeros.clone(), zeros.clone()],
            defects: [zeros.clone(), zeros.clone()],
            lam: vec![0.0; model.problem.multipliers()],
            rate: zeros,
            memory: vec![NONE; 4],
            before: [0.0; 3],
            is_judged: false,
        }
    }

    /// Forgets the step before.
    pub(super) fn forget(&mut self) {
        self.memory.fill(NONE);
    }

    /// Begins to estimate the error of a step.
    pub(super) fn begin(&mut self) {
        self.is_judged = false;
    }

    /// Lets the next step begin where the last one began.
    pub(super) fn undo(&mut self) {
        if std::mem::take(&mut self.is_judged) {
            self.memory[0] = START;
            self.memory[1..].copy_from_slice(&self.before);
        }
    }

    /// The error of the step from `before` at t to `after` that the defect of the velocities does not show, in units of
    /// the tolerance; zero where the motion is smooth or the accelerations cannot be solved for.
    pub(super) fn error(
        &mut self,
        (model, predictor): (&mut Model, &mut Predictor),
        (t, h): (f64, f64),
        [before, after]: [&State; 2],
        (estimate, noise): (&Estimate, &[f64]),
    ) -> f64 {
        let (mut lam, mut rate) = (
            std::mem::take(&mut self.lam),
            std::mem::take(&mut self.rate),
        );
        let are_met = self.meet(|end, out| {
            let at = [(t, before), (t + h, after)][end];
            predictor.rate(model, at, (&mut lam, &mut rate), out)
        });
        (self.lam, self.rate) = (lam, rate);
        if !are_met {
            return 0.0;
        }
        let velocities = StepVelocities {
            rows: predictor.velocities(),
            noise,
        };
        self.set_defects(velocities.rows, h);
        let y = [&before.y[..], &after.y];
        self.judge(velocities, h, y, (estimate, &OF_MOTION))
    }

    /// Finds the accelerations at the start, 0, and at the end, 1, of a step by `at`, where they are not known from the
    /// step before; says whether both are known.
    pub(super) fn meet(
        &mut self,
        mut at: impl FnMut(usize, &mut [f64]) -> Result<(), StepError>,
    ) -> bool {
        let Some(held) = self.memory.first().copied() else {
            return false;
        };
        let [first, last] = &mut self.ends;
        let is_known = if held == END {
            copy(first, last);
            true
        } else {
            held == START || at(0, first).is_ok()
        };
        self.memory[0] = NONE;
        if !is_known || at(1, last).is_err() {
            return false;
        }
        (self.memory[0], self.is_judged) = (END, true);
        true
    }

    /// Writes what the accelerations at both ends of the step last met are off, times h.
    pub(super) fn set_defects(&mut self, velocities: &Matrix, h: f64) {
        for (end, defects) in self.defects.iter_mut().enumerate() {
            for (k, defect) in defects.iter_mut().enumerate() {
                let weights = self.slopes[end].iter().enumerate();
                let slope: f64 = weights.map(|(i, weight)| weight * velocities[(i, k)]).sum();
                *defect = slope - h * self.ends[end][k];
            }
        }
    }

    /// Whether the accelerations at both ends of the last step are known.
    pub(super) fn are_known(&self) -> bool {
        self.memory.first() == Some(&END)
    }

    /// The error from what the accelerations are off.
    pub(super) fn judge(
        &mut self,
        velocities: StepVelocities,
        h: f64,
        y: [&[f64]; 2],
        (estimate, of): (&Estimate, &Judged),
    ) -> f64 {
        let (off, tolerance) = (estimate.off(), &estimate.tolerance);
        let (rows, n) = (velocities.rows.rows(), velocities.rows.cols());
        let defect = |end: usize| tolerance.weigh(y, self.defects[end].iter().copied());
        let defect = defect(0).max(defect(1));
        let [_, e, d, length] = self.memory[..] else {
            return 0.0;
        };
        let Judged { unit, .. } = *of;
        let [e, d] = [e / unit, d / unit];
        let order = (rows - 2) as f64;
        let expected = |ratio: f64| (e * ratio.powf(order)).max(d * ratio.powf(order + 1.0));
        // of the first step there is none before
        let ratio = if length > 0.0 { h.abs() / length } else { 0.0 };
        let is_sudden = length > 0.0 && off > 10_f64.powf(order.max(3.0) - 1.0) * expected(ratio);
        // a bend that was met does not allow more in a longer step
        let is_smooth = !is_sudden && defect <= SMOOTH * off.max(expected(ratio.min(1.0)));
        self.before.copy_from_slice(&self.memory[1..]);
        self.memory[1..].copy_from_slice(&[off * unit, defect * unit, h.abs()]);
        if is_smooth {
            return 0.0;
        }
        let speed = velocities.speed(tolerance, y).max(f64::MIN_POSITIVE);
        let time_scale = tolerance.weigh(y, y[1].iter().copied()) / speed;
        let largest = max_norm(y[1]);
        let above = |roundings: f64, defect: &dyn Fn(usize) -> f64| {
            let least = |k| match of.roundoff {
                Roundoff::Positions => tolerance.roundoff(y, k, largest) / h.abs(),
                Roundoff::Velocities => f64::EPSILON * velocities.largest(k),
            };
            let above = (0..n).map(|k| (defect(k).abs() - roundings * least(k)).max(0.0));
            tolerance.weigh(y, above)
        };
        let misses = [0, 1].map(|end| {
            let of_e = above(ROUNDINGS, &|k| estimate.defect(velocities, end, k));
            let most = ROUNDINGS * order.powi(2);
            of_e.max(above(most, &|k| self.defects[end][k]))
        });
        let missed = misses[0].max(misses[1]);
        self.part * missed * time_scale.clamp(h.abs(), of.held.max(HELD * h.abs()))
    }
}

/// The derivatives at a node of the Lagrange basis on all nodes.
fn slopes(nodes: &[f64], at: usize) -> Vec<f64> {
    let x = nodes[at];
    let others = |k: usize| (0..nodes.len()).filter(move |l| *l != k);
    (0..nodes.len())
        .map(|k| {
            if k == at {
                return others(k).map(|l| 1.0 / (x - nodes[l])).sum();
            }
            let product: f64 = others(k)
                .filter(|l| *l != at)
                .map(|l| (x - nodes[l]) / (nodes[k] - nodes[l]))
                .product();
            product / (nodes[k] - x)
        })
        .collect()
}

// Empty where errors do not control the steps.
checkpoint!(Kinks { ends, lam, memory });
