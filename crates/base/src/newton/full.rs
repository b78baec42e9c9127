//! Full Newton: a matrix for each correction.

use super::{
    DOUBTFUL, Equations, LARGE_CORRECTION, LARGE_DEVIATION, SMALL_CORRECTION, Solved, UNMOVED,
    is_at_floor,
};
use crate::error::StepError;

/// Ratio of the first corrections of full Newton above which the start may be on another branch: half the number ω |δ| of
/// Newton and Kantorovich, of which 1/2 is allowed.
const MOST_CURVED: f64 = 0.25;
/// Corrections of full Newton that fall more slowly, once they are small, are roundoff.
const STALLED: f64 = 0.5;
/// The most matrices that full Newton makes, and the most corrections.
const MOST_MATRICES: usize = 12;
const MOST_FULL: usize = 40;
/// Newton's method converges to a double root with ratio 1/2: ratios in this range, so many in a row, are refused.
const DOUBLE_ROOT: std::ops::Range<f64> = 0.4..0.6;
const MOST_HALVINGS: usize = 4;

/// Full Newton: corrects with a matrix for each correction, until the residual is roundoff and corrections fall no more: of a
/// stiff force the residual is roundoff long before the soft directions are solved. Corrections may grow in
/// between: the first one releases the tension of a stretched spring, and the next tangent is softer.
///
/// # Errors
/// [`StepError::NotConverged`] after too many corrections, at a double root, where branches meet, or at a solution whose
/// matrix shows that it is on another branch.
pub fn solve_full(equations: &mut impl Equations) -> Result<Solved, StepError> {
    let (mut largest, mut size, mut halvings) = (0.0_f64, f64::INFINITY, 0);
    let (mut is_straight, mut is_against) = (true, false);
    let tolerance = equations.stop().tolerance.max(f64::EPSILON);
    for iterations in 1..=MOST_FULL {
        let is_fresh = iterations <= MOST_MATRICES;
        if is_fresh {
            equations.refresh();
        }
        let last = size;
        size = equations.correct()?;
        let is_halved = is_fresh && DOUBLE_ROOT.contains(&(size / last));
        halvings = if is_halved { halvings + 1 } else { 0 };
        let failed = StepError::NotConverged { iterations, size };
        let scaled = equations.scaled_size(size);
        let is_small = size.max(scaled) <= SMALL_CORRECTION;
        let is_floor = !is_small && is_at_floor(equations, size)?;
        if !size.is_finite() || halvings == MOST_HALVINGS && !is_floor {
            return Err(failed);
        }
        if iterations == 2 && largest > SMALL_CORRECTION {
            is_straight = scaled <= MOST_CURVED * largest;
        }
        largest = largest.max(scaled);
        is_against |= scaled > UNMOVED && equations.is_against();
        // of a first correction nothing is known but that the next is smaller
        let theta = if last == f64::INFINITY {
            1e-3
        } else {
            size / last
        };
        let goes_on = theta < STALLED && theta * size > tolerance && iterations < MOST_FULL;
        if (is_floor || is_small && !goes_on) && equations.is_residual_roundoff()? {
            let deviation = equations.deviation();
            if largest.max(deviation) > UNMOVED && equations.is_reversed(largest > DOUBTFUL) {
                return Err(failed);
            }
            return Ok(Solved {
                iterations,
                is_near: largest <= LARGE_CORRECTION && deviation <= LARGE_DEVIATION && !is_against,
                is_straight,
            });
        }
    }
    Err(StepError::NotConverged {
        iterations: MOST_FULL,
        size,
    })
}
