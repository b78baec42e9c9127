//! Where a potential jumps in time: by bisection of an interval in which it changes.

use super::kicks::Kicks;
use liouville_base::error::StepError;

/// An interval is looked at in so many parts first.
const PARTS: u8 = 16;

/// After so many halves the change of a jump is above the root of that of a smooth function, 2⁻ᵏ, if it ever is.
const HALVES: i32 = 8;

/// Times this many roundings beside a jump are on their side, as a step takes V at times that are rounded.
const BESIDE: f64 = 8.0;

/// A jump of the potential: times before and after it, and how long steps are then.
#[derive(Clone, Copy)]
pub(super) struct Jump {
    pub(super) before: f64,
    pub(super) after: f64,
    pub(super) next: f64,
}

/// Memory of a search: the potential at both ends and within.
#[derive(Clone, Default)]
pub(super) struct JumpSearch {
    low: Vec<f64>,
    middle: Vec<f64>,
    high: Vec<f64>,
}

impl JumpSearch {
    /// Times before and after a jump within a step from t, as near as roundings allow, if the largest change of the
    /// potential is a jump of more than `least`.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn find(
        &mut self,
        kicks: &mut Kicks,
        (t, h): (f64, f64),
        least: f64,
    ) -> Result<Option<(f64, f64)>, StepError> {
        let (mut a, mut b, largest) = self.steepest(kicks, (t, h))?;
        if largest <= least {
            return Ok(None);
        }
        kicks.values(a, &mut self.low)?;
        kicks.values(b, &mut self.high)?;
        let near = f64::EPSILON * h.abs().max(t.abs()).max((t + h).abs());
        let mut halves = 0;
        while (b - a).abs() > near {
            let m = a + 0.5 * (b - a);
            kicks.values(m, &mut self.middle)?;
            let (first, second) = (
                change(&self.low, &self.middle),
                change(&self.middle, &self.high),
            );
            // the first of jumps that are as large
            let is_first = first >= 0.5 * second;
            if is_first {
                b = m;
                std::mem::swap(&mut self.middle, &mut self.high);
            } else {
                a = m;
                std::mem::swap(&mut self.middle, &mut self.low);
            }
            halves += 1;
            let left = if is_first { first } else { second };
            if halves >= HALVES && left <= largest * 0.5_f64.powi(halves / 2) {
                return Ok(None);
            }
        }
        let beside = BESIDE * near.copysign(h);
        let is_first = (a - t).abs() <= beside.abs();
        Ok(Some((if is_first { t } else { a - beside }, b + beside)))
    }

    /// Times beside `edge` on the way to `end`, if the potential changes by more than `least` between them.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn around(
        &mut self,
        kicks: &mut Kicks,
        (t, edge, end): (f64, f64, f64),
        least: f64,
    ) -> Result<Option<(f64, f64)>, StepError> {
        let beside = (BESIDE * f64::EPSILON * t.abs().max(edge.abs())).copysign(edge - t);
        let (before, after) = (edge - beside, edge + beside);
        let is_past = (after - t).abs() >= (end - t).abs();
        let after = if is_past { end } else { after };
        if (edge - t).abs() <= 2.0 * beside.abs() {
            return Ok(None);
        }
        kicks.values(before, &mut self.low)?;
        kicks.values(after, &mut self.high)?;
        Ok((change(&self.low, &self.high) > least).then_some((before, after)))
    }

    /// The part of a step in which the potential changes most, and by how much.
    fn steepest(
        &mut self,
        kicks: &mut Kicks,
        (t, h): (f64, f64),
    ) -> Result<(f64, f64, f64), StepError> {
        let mut found = (t, t + h, 0.0);
        let mut start = t;
        kicks.values(t, &mut self.low)?;
        for k in 1..=PARTS {
            let part = f64::from(k) / f64::from(PARTS);
            let end = t + part * h;
            kicks.values(end, &mut self.high)?;
            let size = change(&self.low, &self.high);
            if size > found.2 {
                found = (start, end, size);
            }
            start = end;
            std::mem::swap(&mut self.low, &mut self.high);
        }
        Ok(found)
    }
}

/// The largest difference of two potentials.
fn change(a: &[f64], b: &[f64]) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}
