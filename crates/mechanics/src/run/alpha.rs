//! Runs of the α family.

use super::member::Member;
use super::{Begun, Control, MethodStart, Starter};
use liouville_alpha::{Alpha, AlphaRestart, AlphaState, Reactions};
use liouville_base::error::StepError;
use liouville_base::method::Estimating;
use liouville_base::run::{Reversible, StepControl};
use liouville_base::tableau;
use liouville_problem::{Carried, Kinetic, SecondOrder, SecondOrderModel};
use std::sync::Arc;

/// The least and the most steps of a trial by which reversible steps meet a tolerance ...
const TRIAL: [usize; 2] = [20, 500];
/// ... and this many coordinates in all beyond the least: a trial of a large system takes no minutes.
const TRIAL_COORDINATES: usize = 100_000;
/// The part of the tolerance of errors that equations are solved to: the estimate feels a quarter of it.
const PART_OF_ERRORS: f64 = 0.1;

/// A system of second order, the weights of a method, its reactions, and the tolerance of its equations.
pub(super) type AlphaOf<'a> = (&'a Arc<SecondOrder>, tableau::Alpha, Reactions, Option<f64>);

impl Starter {
    pub(super) fn alpha(&self, method: AlphaOf, member: usize) -> Begun {
        let (stepper, state, sizes) = self.alpha_at(method, member)?;
        let tangents = self.job.tangents.as_ref();
        if let Some((tangents, slopes)) = tangents.and_then(|of| Some((of, of.alpha.clone()?))) {
            let start = (stepper, state, sizes);
            return self.alpha_tangents(start, (tangents, slopes), member);
        }
        let (copy, of) = (self.copy(&stepper), self.alpha_member(member, &stepper));
        let trial = Box::new(stepper.clone());
        let control = self.alpha_control((stepper, trial), sizes, member, &state);
        self.launch(control, copy, of, state)
    }

    /// A method of the α family where a member starts.
    pub(super) fn alpha_at(
        &self,
        (problem, weights, reactions, newton_tol): AlphaOf,
        member: usize,
    ) -> Result<MethodStart<Alpha, AlphaState>, StepError> {
        let span = self.job.span;
        let model = SecondOrderModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.part(0, member), self.part(1, member));
        let a = self.has_accelerations().then(|| self.part(2, member));
        let (tolerance, sizes) = match &self.job.control {
            Control::Adaptive {
                tolerance,
                h_first,
                h_min,
            } => (Some(tolerance.clone()), Some((*h_first, *h_min))),
            _ => (None, None),
        };
        let solved = self.tolerance(newton_tol, PART_OF_ERRORS, reactions.roundoff());
        let mut stepper = Alpha::new(model, weights, reactions, tolerance).to_tolerance(solved);
        let state = stepper.start(span.t0, y, z, a)?;
        let sizes = sizes.map(|(h_first, h_min)| {
            let h_first = h_first.unwrap_or_else(|| stepper.first_step(&state));
            (h_first, h_min)
        });
        Ok((stepper, state, sizes))
    }

    /// Whether accelerations are given at the start.
    pub(super) fn has_accelerations(&self) -> bool {
        self.job.start.len() > 2
    }

    /// The control of a method of the α family: equal steps, or those that its errors allow. `trial` is the method
    /// again, by which reversible steps are found.
    pub(super) fn alpha_control<S>(
        &self,
        (stepper, trial): (S, Box<dyn Estimating<State = S::State>>),
        sizes: Option<(f64, f64)>,
        member: usize,
        state: &S::State,
    ) -> Box<dyn StepControl<S::State>>
    where
        S: Estimating + 'static,
        S::State: Carried + Clone,
    {
        let span = self.job.span;
        let Some(sizes) = sizes else {
            return Box::new(self.fixed_steps(Box::new(stepper)));
        };
        if !self.job.is_reversible {
            return self.adaptive_control(stepper, sizes);
        }
        let monitor = Box::new(Kinetic::new(self.model(member)));
        let most = TRIAL[1].min(TRIAL[0] + TRIAL_COORDINATES / self.system.mechanical().n);
        let (ends, pair) = ((span.t0, span.t1), [Box::new(stepper) as _, trial]);
        let control = Reversible::within_tolerance(pair, most, ends, sizes, monitor, state);
        Box::new(control)
    }

    /// A member whose states have accelerations of their own.
    pub(super) fn alpha_member(&self, number: usize, stepper: &Alpha) -> Member<AlphaState> {
        let impulse = self.impulse(number);
        let restart = |impulse| Box::new(AlphaRestart::new(impulse, stepper.clone())) as _;
        Member {
            number,
            model: self.model(number),
            restart: impulse.map(restart),
        }
    }
}
