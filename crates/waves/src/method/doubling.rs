//! Steps made as two halves, which are kept, and as one: the difference of both tells their error.

use super::{Wave, squares};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;

/// Memory of a step that is made twice.
#[derive(Clone)]
pub(super) struct Doubling {
    before: Wave<f64>,
    coarse: Wave<f64>,
    /// The state before the last step, where it is kept.
    passed: Wave<f64>,
}

impl Doubling {
    /// Memory for states of so many places.
    pub(super) fn new(places: usize) -> Self {
        let empty = || Wave::new(vec![0.0; places], vec![0.0; places]);
        Self {
            before: empty(),
            coarse: empty(),
            passed: Wave::new(Vec::new(), Vec::new()),
        }
    }

    /// The same for steps that are kept, or made as halves alone.
    pub(super) fn keeping(self) -> Self {
        let passed = self.before.clone();
        Self { passed, ..self }
    }

    /// Keeps the state before the last step.
    pub(super) fn keep(&mut self) {
        std::mem::swap(&mut self.before, &mut self.passed);
    }

    /// Makes a step as two halves, and returns how far a step made as one is off them.
    pub(super) fn step(
        &mut self,
        stepper: &mut impl Stepper<State = Wave<f64>>,
        (t, h): (f64, f64),
        state: &mut Wave<f64>,
    ) -> Result<f64, StepError> {
        copy(state, &mut self.before);
        copy(state, &mut self.coarse);
        stepper.step(t, h, &mut self.coarse)?;
        stepper.synchronize(&mut self.coarse)?;
        halves(stepper, (t, h), state)?;
        self.coarse.remove_phase();
        let pairs = [
            (&mut self.coarse.q, &state.q),
            (&mut self.coarse.p, &state.p),
        ];
        for (coarse, fine) in pairs {
            for (x, y) in coarse.iter_mut().zip(fine) {
                *x -= y;
            }
        }
        Ok(squares(&self.coarse.q, &self.coarse.p).sqrt())
    }

    /// Makes a step as two halves alone.
    pub(super) fn pass(
        &mut self,
        stepper: &mut impl Stepper<State = Wave<f64>>,
        step: (f64, f64),
        state: &mut Wave<f64>,
    ) -> Result<(), StepError> {
        copy(state, &mut self.passed);
        halves(stepper, step, state)
    }

    /// Takes back the last step that was kept, or made as halves alone, and what was made since then.
    pub(super) fn put_back_passed(&self, state: &mut Wave<f64>) {
        copy(&self.passed, state);
    }

    /// Takes the last step back.
    pub(super) fn put_back(&self, state: &mut Wave<f64>) {
        copy(&self.before, state);
    }
}

fn halves(
    stepper: &mut impl Stepper<State = Wave<f64>>,
    (t, h): (f64, f64),
    state: &mut Wave<f64>,
) -> Result<(), StepError> {
    for at in [t, t + 0.5 * h] {
        stepper.step(at, 0.5 * h, state)?;
    }
    stepper.synchronize(state)?;
    state.remove_phase();
    Ok(())
}

fn copy(from: &Wave<f64>, to: &mut Wave<f64>) {
    to.q.copy_from_slice(&from.q);
    to.p.copy_from_slice(&from.p);
    (to.phase, to.start) = (from.phase, from.start);
}
