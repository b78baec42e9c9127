//! Poincaré sections: where trajectories pass through a plane.
//!
//! With s(x) = a · x − c, a trajectory passes in a step where s changes its sign, or crosses multiples of the period
//! where there is one, one after another. A step of θ h by the same method from the state before, with s = 0 at its end, leads to the
//! point, which has the order of the method and lies in the plane to roundoff. θ is found by the iteration of
//! [`liouville_base::bracket`]. Two passages of a plane within a step are missed. Source: oliveira2020.

use super::{State, UserVariables, Volume};
use liouville_base::bracket::Bracket;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::observe::Observe;
use liouville_base::real::Real;
use liouville_base::simd::Stored;

/// The direction of a passage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// s grows.
    Up,
    /// s falls.
    Down,
    /// Either way.
    Both,
}

/// s(x) = a · x − c, and the passages wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// a, for the variables that the user sees.
    pub normal: Vec<f64>,
    /// c
    pub offset: f64,
    /// Distance of parallel planes, where there are several.
    pub period: Option<f64>,
    /// The direction of passages.
    pub direction: Direction,
}

impl Plane {
    /// The values that s passes from `before` to `after`, in this order, both included but the first; `None` where there
    /// are more than [`MOST_PASSED`].
    fn passed(&self, before: f64, after: f64) -> Option<impl Iterator<Item = f64> + use<>> {
        let is_up = before < after;
        let (unwanted, period) = if is_up {
            (Direction::Down, self.period)
        } else {
            (Direction::Up, self.period.map(|period| -period))
        };
        let first = period.map_or(0.0, |period| (before / period).floor() + 1.0);
        let most = match period {
            _ if self.direction == unwanted => 0.0,
            None => 1.0,
            // one more, for roundoff
            Some(period) => (after / period).floor() - first + 2.0,
        };
        let levels = (0..=MOST_PASSED)
            .map(f64::from)
            .take_while(move |k| *k < most)
            .map(move |k| period.map_or(0.0, |period| period * (first + k)))
            .filter(move |level| {
                if is_up {
                    before < *level && *level <= after
                } else {
                    after <= *level && *level < before
                }
            });
        (most.is_nan() || most <= f64::from(MOST_PASSED)).then_some(levels)
    }
}

/// The most planes that are passed within a step.
const MOST_PASSED: u32 = 10_000;

/// Records (member, t, x) for each passage of a plane; it must observe every step.
#[derive(Clone, Debug)]
pub struct Section<S: Stored, M> {
    volume: Volume<S>,
    plane: Plane,
    /// The numbers of the members.
    members: Vec<usize>,
    passage: Passage<M>,
    /// Time, variables and s at the last step, if there was one, and the variables at this.
    last: Option<(f64, S)>,
    before: Vec<S>,
    now: Vec<S>,
}

/// The search for the plane within a step.
#[derive(Clone, Debug)]
struct Passage<M> {
    single: Volume<f64>,
    stepper: M,
    variables: UserVariables,
    /// a and c for the variables that are stepped: places where a is not zero, and its values there.
    normal: Vec<(usize, f64)>,
    offset: f64,
    y: Vec<f64>,
    x: Vec<f64>,
}

impl<S: Stored + Real, M: Stepper<State = State<f64>>> Section<S, M> {
    /// Sections of the first trajectories that `volume` steps, with the numbers `members`. `stepper` makes the same steps
    /// of one trajectory, a state of `single`.
    ///
    /// # Panics
    /// When the plane's normal has not as many numbers as the user's variables, or there are not so many members.
    pub fn new(
        volume: Volume<S>,
        (single, stepper): (Volume<f64>, M),
        variables: UserVariables,
        members: Vec<usize>,
        plane: Plane,
    ) -> Self {
        assert!(members.len() <= S::MEMBERS, "members of a section");
        let n = volume.split().n();
        Self {
            passage: Passage {
                single,
                stepper,
                normal: variables.normal_of_split(&plane.normal, n),
                offset: plane.offset,
                y: vec![0.0; n],
                x: vec![0.0; variables.n],
                variables,
            },
            before: vec![S::splat(0.0); n],
            now: vec![S::splat(0.0); n],
            last: None,
            volume,
            plane,
            members,
        }
    }

    /// Appends a row for each member that passes between the last step and this.
    fn append(&mut self, t: f64, after: S, row: &mut Vec<f64>) -> Result<(), StepError> {
        let Some((t0, before)) = self.last else {
            return Ok(());
        };
        for (member, number) in self.members.iter().enumerate() {
            let (before, after) = (before.member(member), after.member(member));
            let h = t - t0;
            let levels = self.plane.passed(before, after).ok_or_else(|| {
                let planes = (after - before).abs() / self.plane.period.unwrap_or(f64::INFINITY);
                let error = StepError::StepTooLarge {
                    h,
                    coordinate: 0,
                    solved: h * f64::from(MOST_PASSED) / planes,
                };
                error.of_member(member)
            })?;
            for level in levels {
                for (y, value) in self.passage.y.iter_mut().zip(&self.before) {
                    *y = value.member(member);
                }
                let ends = (before - level, after - level);
                let found = self.passage.find(t0, h, ends, level);
                let part = found.map_err(|error| error.of_member(member))?;
                row.extend([*number as f64, t0 + part * h]);
                row.extend_from_slice(&self.passage.x);
            }
        }
        Ok(())
    }
}

/// Tolerance of θ.
const TOLERANCE: f64 = f64::EPSILON / 2.0;
/// Halvings from the whole step to the tolerance; the iteration may take one more.
const HALVINGS: i32 = 52;

impl<M: Stepper<State = State<f64>>> Passage<M> {
    /// The part of the step h from t, and from `y`, after which s is `level`; leaves `x` there.
    fn find(&mut self, t: f64, h: f64, ends: (f64, f64), level: f64) -> Result<f64, StepError> {
        let start = self.single.state(&self.y);
        let mut state = start.clone();
        let mut bracket = Bracket {
            a: (0.0, ends.0),
            b: (1.0, ends.1),
        };
        let size = ends.0.abs() + ends.1.abs() + self.offset.abs() + level.abs();
        let noise = f64::EPSILON * size;
        let mut part = 1.0;
        for halving in (0..=HALVINGS + 1).rev() {
            if bracket.b.1 != 0.0 {
                part = bracket.estimate(halving, TOLERANCE);
            }
            state.clone_from(&start);
            self.stepper.step(t, part * h, &mut state)?;
            self.stepper.synchronize(&mut state)?;
            let s = self.height(&state, level);
            let is_narrow = bracket.width() <= 2.0 * TOLERANCE;
            if s.abs() <= noise || bracket.b.1 == 0.0 || is_narrow {
                break;
            }
            bracket.tighten(part, s);
        }
        self.variables.write(&self.y, &mut self.x);
        Ok(part)
    }

    /// s above the level at a state; leaves its variables in `y`.
    fn height(&mut self, state: &State<f64>, level: f64) -> f64 {
        self.single.values(state, &mut self.y);
        height(&self.normal, self.offset, &self.y) - level
    }
}

/// s for the variables that are stepped.
fn height<S: Real>(normal: &[(usize, f64)], offset: f64, y: &[S]) -> S {
    normal
        .iter()
        .fold(S::splat(-offset), |sum, (i, a)| sum + y[*i] * S::splat(*a))
}

impl<S: Stored + Real, M: Stepper<State = State<f64>>> Observe<State<S>> for Section<S, M> {
    fn width(&self, _: &State<S>) -> usize {
        2 + self.passage.x.len()
    }

    fn observe(&mut self, t: f64, state: &State<S>, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.volume.values(state, &mut self.now);
        let after = height(&self.passage.normal, self.plane.offset, &self.now);
        self.append(t, after, row)
            .inspect_err(|_| row.truncate(start))?;
        std::mem::swap(&mut self.before, &mut self.now);
        self.last = Some((t, after));
        Ok(())
    }
}

/// The end of the last step.
impl<S: Stored, M: Checkpoint> Checkpoint for Section<S, M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        let last = self.last.map(|(t, s)| (t, s.member(member)));
        last.save(member, out);
        self.before.save(member, out);
        self.passage.stepper.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut last = Some((0.0, 0.0));
        last.restore(member, saved)?;
        self.last = last.map(|(t, value)| {
            let mut s = self.last.map_or_else(|| S::splat(value), |(_, s)| s);
            s.set_member(member, value);
            (t, s)
        });
        self.before.restore(member, saved)?;
        self.passage.stepper.restore(member, saved)
    }
}
