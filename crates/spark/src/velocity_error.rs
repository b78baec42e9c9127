//! The error that a step adds to the velocities.
//!
//! In an oscillation of frequency ω the defects e of the velocities and D of the accelerations at the ends of a step,
//! see [`super::kinks`], are a quarter of a period apart, and D is ωh e. The error of the velocity is then
//!
//!     e min(1, (ωh)^(s+1) s! / (2s+1)!),
//!
//! of the order 2s + 1 where stages resolve it, and about e where they do not. The largest of several frequencies
//! counts for all of e, so where they are resolved that is an upper bound, about ten times the error. ωh is D over the
//! largest e of late, as e has zeros. The unit is rtol times the largest velocity so far with atol in the longest step
//! so far, and the roundoff of positions in this step.

use liouville_base::checkpoint;
use liouville_base::linalg::{Matrix, max_norm};
use liouville_base::method::Tolerance;

/// The part of the defect of a step that the next one counts as its own at least.
const KEPT: f64 = 0.9;
/// Roundings of the positions in a step that velocities may be off.
const ROUNDINGS: f64 = 256.0;
/// The part of the upper bound that is taken for the error.
const PART: f64 = 0.1;

/// The place of the longest step of those that stand, of the defect e of the last of them with its length, and of those
/// of the step that may yet be undone.
const LONGEST: usize = 0;
const DEFECT: usize = 1;
const LENGTH: usize = 2;
const LAST_DEFECT: usize = 3;
const LAST_LENGTH: usize = 4;

/// Measures of the velocities of the steps so far.
#[derive(Clone, Debug, Default)]
pub(super) struct VelocityError {
    /// The largest velocities of the steps that stand, and those of the last one, which may yet be undone.
    fastest: Vec<f64>,
    last: Vec<f64>,
    /// By the places above.
    memory: Vec<f64>,
}

impl VelocityError {
    /// Memory for the steps of a system with so many coordinates.
    pub(super) fn new(n: usize) -> Self {
        Self {
            fastest: vec![0.0; n],
            last: vec![0.0; n],
            memory: vec![0.0; LAST_LENGTH + 1],
        }
    }

    /// Forgets the defects of the steps before, as of another motion.
    pub(super) fn forget(&mut self) {
        self.begin();
        self.hold(DEFECT, [0.0; 2]);
    }

    /// Leaves out the last step, which was rejected.
    pub(super) fn undo(&mut self) {
        self.last.fill(0.0);
        self.hold(LAST_DEFECT, [0.0; 2]);
    }

    /// Begins to measure a step: the one before stands.
    pub(super) fn begin(&mut self) {
        for (fastest, last) in self.fastest.iter_mut().zip(&self.last) {
            *fastest = fastest.max(*last);
        }
        if let [longest, .., e, h] = self.memory[..]
            && h > 0.0
        {
            self.memory[LONGEST] = longest.max(h);
            self.hold(DEFECT, [e, h]);
        }
        self.undo();
    }

    /// Holds a defect and its length, where errors control the steps.
    fn hold(&mut self, place: usize, defect: [f64; 2]) {
        if let Some(held) = self.memory.get_mut(place..place + 2) {
            held.copy_from_slice(&defect);
        }
    }

    /// The error in units of the tolerance, and the power of h with which it falls; `of` has the defects of the
    /// velocity and, times h, of the acceleration by end and coordinate, `y` the positions at both ends.
    pub(super) fn measure(
        &mut self,
        velocities: &Matrix,
        h: f64,
        (y, tolerance): ([&[f64]; 2], &Tolerance),
        of: impl Fn(usize, usize) -> [f64; 2],
    ) -> (f64, f64) {
        let (rows, n, h) = (velocities.rows(), velocities.cols(), h.abs());
        let longest = self.memory[LONGEST].max(h);
        let largest = max_norm(y[1]);
        let mut sums = [[0.0; 2]; 2];
        for k in 0..n {
            let speeds = (0..rows).map(|i| velocities[(i, k)].abs());
            self.last[k] = speeds.fold(0.0, f64::max);
            let speed = self.fastest[k].max(self.last[k]);
            let roundoff = ROUNDINGS * tolerance.roundoff(y, k, largest) / h;
            let unit = tolerance.rtol * speed + tolerance.atol[k] / longest + roundoff;
            for (end, sums) in sums.iter_mut().enumerate() {
                for (sum, x) in sums.iter_mut().zip(of(end, k)) {
                    *sum += (x / unit).powi(2);
                }
            }
        }
        let [e, d] = [0, 1].map(|which| (sums[0][which].max(sums[1][which]) / n as f64).sqrt());
        let s = i32::try_from(rows - 2).unwrap_or(i32::MAX);
        let (before, length) = (self.memory[DEFECT], self.memory[LENGTH]);
        let ratio = if length > 0.0 {
            (h / length).min(1.0)
        } else {
            0.0
        };
        let e = e.max(KEPT * before * ratio.powi(s));
        self.hold(LAST_DEFECT, [e, h]);
        if e == 0.0 {
            return (0.0, 1.0);
        }
        let factorials: f64 = (s + 1..=2 * s + 1).map(f64::from).product();
        let resolved = (d / e).powi(s + 1) / factorials;
        let order = if resolved < 1.0 { 2 * s + 1 } else { 2 };
        (PART * e * resolved.min(1.0), f64::from(order))
    }
}

// Empty where errors do not control the steps.
checkpoint!(VelocityError {
    fastest,
    last,
    memory
});
