//! The iteration ends at roundoff, and says early when it will not.

use liouville_base::cancel::{self, CancelToken};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::Matrix;
use liouville_base::newton::{
    Attempts, Backoff, BranchAttempts, Broyden, Continuation, Equations, Member, Slot, Solved,
    Start, Stop, attempt, solve_each, solve_full,
};

/// Corrects with one matrix, and counts.
fn solve(equations: &mut impl Equations, most: usize) -> Result<usize, StepError> {
    liouville_base::newton::solve(equations, most).map(|solved| solved.iterations)
}

/// Equations in one unknown: `step` gives the correction of x.
struct Scalar<F> {
    x: f64,
    made: usize,
    step: F,
}

impl<F: FnMut(f64) -> f64> Equations for Scalar<F> {
    fn correct(&mut self) -> Result<f64, StepError> {
        let correction = (self.step)(self.x);
        self.x += correction;
        self.made += 1;
        Ok((correction / self.x).abs())
    }
}

fn scalar<F: FnMut(f64) -> f64>(x: f64, step: F) -> Scalar<F> {
    Scalar { x, made: 0, step }
}

/// Corrections of prescribed sizes.
struct StepSizes<'a> {
    sizes: &'a [f64],
    made: usize,
}

impl Equations for StepSizes<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        self.made += 1;
        Ok(self.sizes[self.made - 1])
    }
}

fn after(sizes: &[f64], most: usize) -> (Result<usize, StepError>, usize) {
    let mut equations = StepSizes { sizes, made: 0 };
    (solve(&mut equations, most), equations.made)
}

fn not_converged(iterations: usize, size: f64) -> Result<usize, StepError> {
    Err(StepError::NotConverged { iterations, size })
}

#[test]
fn newton_s_method_finds_roots_to_roundoff() {
    for square in [2.0_f64, 3.0, 1e-6, 1e12] {
        let mut equations = scalar(1.3 * square.sqrt(), |x| (square - x * x) / (2.0 * x));
        let iterations = solve(&mut equations, 20).expect("quadratic convergence");
        assert!(iterations <= 6, "{iterations} corrections for {square}");
        assert!((equations.x / square.sqrt() - 1.0).abs() <= f64::EPSILON);
    }
}

#[test]
fn a_simplified_iteration_ends_without_a_confirming_correction() {
    // x = cos x by x -> cos x contracts by 0.67; with the slope frozen near the root by 0.02
    let mut equations = scalar(0.7, |x: f64| (x.cos() - x) / (1.0 + 0.7_f64.sin()));
    let iterations = solve(&mut equations, 20).expect("contracts");
    assert!((equations.x.cos() - equations.x).abs() <= f64::EPSILON);
    assert!(iterations <= 10, "{iterations} corrections");
    let exact = [1.0, 1e-4, 1e-8, 1e-12, 1e-17, f64::NAN];
    assert_eq!(after(&exact, 6), (Ok(5), 5));
}

#[test]
fn a_linear_problem_takes_the_correction_and_a_look() {
    assert_eq!(after(&[0.3, 1e-17], 10), (Ok(2), 2));
    assert_eq!(after(&[0.0], 10), (Ok(1), 1));
    assert_eq!(after(&[1e-17, 0.0], 10), (Ok(2), 2));
}

#[test]
fn corrections_within_the_noise_end_the_iteration() {
    for noise in [[3e-14, 2e-14], [1e-14, 4e-14], [2e-16, 2e-16]] {
        let shrinking = [1e-11, 1e-12, 1e-13].into_iter();
        let sizes: Vec<f64> = shrinking
            .chain(noise.into_iter().cycle().take(20))
            .collect();
        let (outcome, made) = after(&sizes, 20);
        assert_eq!(outcome, Ok(made));
        assert!(made <= 12, "{made} corrections");
    }
}

#[test]
fn what_the_noise_hides_is_corrected_too() {
    // a top's: the ratio creeps up to 0.02 before all is noise, so two more leave 1e-22
    let sizes = [
        1.2e-9, 1.5e-10, 1.7e-12, 2.4e-14, 4.9e-16, 3e-17, 3e-17, 3e-17,
    ];
    assert_eq!(after(&sizes, 20), (Ok(8), 8));
    assert_eq!(after(&sizes, 8), (Ok(8), 8));
    assert_eq!(after(&sizes, 6), (not_converged(6, 3e-17), 6));
}

#[test]
fn noise_is_no_excuse_for_corrections_of_size() {
    let constant = [1e-10; 20];
    let (outcome, made) = after(&constant, 20);
    assert!(outcome.is_err() && made <= 5, "gave up after {made}");
}

#[test]
fn growth_is_given_up_at_once() {
    assert_eq!(after(&[1e-3, 3e-3], 30), (not_converged(2, 3e-3), 2));
}

#[test]
fn a_second_correction_of_more_than_half_the_first_is_left_to_full_newton() {
    let sizes = |second| [1e-4, second, 1e-9, 1e-20];
    assert_eq!(after(&sizes(6e-5), 9), (not_converged(2, 6e-5), 2));
    assert_eq!(after(&sizes(4e-5), 9), (Ok(4), 4));
}

#[test]
fn a_rate_too_slow_for_what_is_left_is_given_up_early() {
    let slow: Vec<f64> = (0..16).map(|k| 0.4_f64.powi(k)).collect();
    let (outcome, made) = after(&slow, 16);
    assert_eq!(outcome, not_converged(made, slow[made - 1]));
    assert!(made <= 4, "gave up after {made}");
}

#[test]
fn a_rate_that_is_enough_is_given_its_time() {
    let steady: Vec<f64> = (0..40).map(|k| 0.2_f64.powi(k)).collect();
    let (outcome, made) = after(&steady, 30);
    assert_eq!(outcome, Ok(made));
    assert!((20..=30).contains(&made), "{made} corrections");
    let late = [1.0, 0.4, 0.1, 1e-3, 1e-8, 1e-17];
    assert_eq!(after(&late, 16), (Ok(6), 6));
}

#[test]
fn no_more_corrections_are_made_than_allowed() {
    for most in 1..4 {
        let sizes = [1.0, 0.5, 0.25, 0.125];
        assert_eq!(
            after(&sizes, most),
            (not_converged(most, sizes[most - 1]), most)
        );
    }
    assert_eq!(after(&[], 0), (not_converged(0, f64::INFINITY), 0));
}

#[test]
fn a_correction_that_is_not_finite_ends_the_iteration() {
    for bad in [f64::NAN, f64::INFINITY] {
        for sizes in [vec![bad], vec![1.0, 1e-5, bad]] {
            let (outcome, made) = after(&sizes, 9);
            let Err(StepError::NotConverged { iterations, size }) = outcome else {
                panic!("{outcome:?}");
            };
            assert_eq!((iterations, made), (sizes.len(), sizes.len()));
            assert!(!size.is_finite());
        }
    }
}

#[test]
fn a_trouble_of_the_equations_is_passed_on() {
    struct Broken(StepError);
    impl Equations for Broken {
        fn correct(&mut self) -> Result<f64, StepError> {
            Err(self.0.clone())
        }
    }
    let error = StepError::NotFinite {
        quantity: Quantity::Force,
        index: 2,
        t: 0.5,
    };
    assert_eq!(error.to_string(), "force 2 is not finite at t = 0.5");
    assert_eq!(solve(&mut Broken(error.clone()), 5), Err(error));
}

/// A linear system whose matrix is known only roughly, corrected with Broyden's update or without.
struct Roughly {
    x: Vec<f64>,
    broyden: Option<Broyden>,
}

impl Equations for Roughly {
    fn correct(&mut self) -> Result<f64, StepError> {
        let n = self.x.len();
        // A = I + B with |B| about 0.6; the rough matrix is I, the solution (1, …, 1)
        let entry =
            |i: usize, j: usize| 0.6 * f64::sin((3 * i + 7 * j + 1) as f64) / (n as f64).sqrt();
        let row = |i: usize, x: &[f64]| x[i] + (0..n).map(|j| entry(i, j) * x[j]).sum::<f64>();
        let ones = vec![1.0; n];
        let mut d: Vec<f64> = (0..n).map(|i| row(i, &ones) - row(i, &self.x)).collect();
        if let Some(broyden) = &mut self.broyden {
            broyden.improve(&mut d);
        }
        self.x.iter_mut().zip(&d).for_each(|(x, d)| *x += d);
        Ok(d.iter().fold(0.0_f64, |most, d| most.max(d.abs())))
    }

    fn stop(&self) -> Stop {
        Stop {
            tolerance: f64::EPSILON,
            has_steady_rate: false,
            min_rate: 0.1,
        }
    }
}

#[test]
fn broyden_s_update_makes_a_rough_matrix_good_enough() {
    let iterations = |broyden| {
        let x = vec![0.7; 4];
        let mut equations = Roughly { x, broyden };
        let made = solve(&mut equations, 200).expect("a rate below one");
        assert!(equations.x.iter().all(|x| (x - 1.0).abs() < 1e-14));
        made
    };
    let (with, without) = (iterations(Some(Broyden::new(4, 4))), iterations(None));
    assert!(
        3 * with < without,
        "{with} corrections with it, {without} without"
    );
}

#[test]
fn a_correction_that_broyden_s_update_would_stretch_too_far_is_taken_as_it_is() {
    // along the last one, of 1 and this ratio to it, it would be stretched 2 and 5 times
    for (ratio, taken) in [(0.5, 1.0), (0.8, 0.8)] {
        let mut broyden = Broyden::new(1, 1);
        let (mut first, mut next) = ([1.0], [ratio]);
        broyden.improve(&mut first);
        broyden.improve(&mut next);
        assert_eq!((first, next), ([1.0], [taken]));
    }
}

/// Corrections of prescribed sizes, in a yardstick of 1, with a floor and a verdict on the residual.
struct Watched<'a> {
    sizes: &'a [f64],
    made: usize,
    deviation: f64,
    floor: f64,
    is_solved: bool,
    matrices: usize,
}

impl<'a> Watched<'a> {
    fn new(sizes: &'a [f64]) -> Self {
        Self {
            sizes,
            made: 0,
            deviation: 0.0,
            floor: 0.0,
            is_solved: true,
            matrices: 0,
        }
    }

    fn outcome(&mut self) -> Result<Solved, StepError> {
        liouville_base::newton::solve(self, self.sizes.len())
    }
}

impl Equations for Watched<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        self.made += 1;
        Ok(self.sizes[self.made - 1])
    }

    fn scaled_size(&self, size: f64) -> f64 {
        size
    }

    fn deviation(&self) -> f64 {
        self.deviation
    }

    fn refresh(&mut self) {
        self.matrices += 1;
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        Ok(self.is_solved)
    }

    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        Ok(self.floor)
    }
}

#[test]
fn what_is_far_from_its_start_is_not_near() {
    let near = |sizes: &[f64], moved| {
        let mut equations = Watched::new(sizes);
        equations.deviation = moved;
        equations.outcome().expect("it converges").is_near
    };
    let small = [0.05, 1e-3, 1e-6, 1e-12, 0.0];
    assert!(near(&small, 0.1) && !near(&small, 0.6));
    assert!(!near(&[250.0, 4e-11, 1e-30], 0.0));
}

#[test]
fn one_ratio_is_believed_after_small_corrections_only() {
    for (sizes, made) in [
        (&[0.05, 1e-20, 1e-20][..], Some(3)),
        (&[1e-4, 1e-20, 1e-20], Some(2)),
        (&[0.05, 1e-14, 0.05, 1.0, 2.0, 4.0], None),
    ] {
        let outcome = Watched::new(sizes).outcome();
        assert_eq!(
            outcome.ok().map(|solved| solved.iterations),
            made,
            "{sizes:?}"
        );
        let mut members = [Member::Active];
        let each = solve_each(&mut Watched::new(sizes), sizes.len(), &mut members);
        let iterations = match members {
            [Member::Converged(iterations)] => Some(iterations),
            _ => None,
        };
        assert_eq!((each.is_ok(), iterations), (true, made), "{sizes:?}");
    }
}

#[test]
fn corrections_that_stall_at_the_floor_have_converged() {
    let sizes = [1e-5, 1e-9, 0.9e-9, 1e-9, 1e-9, 1e-9];
    for (floor, converges) in [(2e-10, true), (1e-11, false)] {
        let mut equations = Watched::new(&sizes);
        equations.floor = floor;
        assert_eq!(equations.outcome().is_ok(), converges, "{floor}");
    }
    let mut equations = Watched::new(&sizes);
    (equations.floor, equations.is_solved) = (2e-10, false);
    assert!(equations.outcome().is_err(), "the residual is no roundoff");
}

#[test]
fn full_newton_goes_on_while_corrections_fall() {
    // the residual of a stiff force is roundoff at 5e-7 already
    let sizes = [1e-3, 5e-7, 1e-12, 1e-17];
    let solved = solve_full(&mut Watched::new(&sizes)).expect("corrections fall");
    assert_eq!(solved.iterations, 3);
}

#[test]
fn full_newton_lets_corrections_grow() {
    let sizes = [2e-5, 5e-3, 6e-6, 6e-6, 9e-12];
    let mut equations = Watched::new(&sizes);
    let solved = solve_full(&mut equations).expect("the residual is roundoff");
    assert_eq!((solved.iterations, solved.is_near), (5, true));
    assert_eq!(equations.matrices, 5);
    let slow: Vec<f64> = (0..40).map(|k| 0.65_f64.powi(k)).collect();
    let mut equations = Watched::new(&slow);
    let solved = solve_full(&mut equations).expect("in the end");
    assert_eq!((solved.is_near, equations.matrices), (false, 12));
    equations = Watched::new(&slow);
    equations.is_solved = false;
    assert!(solve_full(&mut equations).is_err());
    let halves: Vec<f64> = (0..40).map(|k| 1e-5 * 0.5_f64.powi(k)).collect();
    assert!(
        solve_full(&mut Watched::new(&halves)).is_err(),
        "a double root"
    );
}

#[test]
fn stages_of_another_step_are_on_the_polynomial_of_the_one_there_is() {
    for c in [&[0.1, 0.5, 0.9][..], &[0.0, 0.5, 1.0]] {
        let of = |t: f64| 1.0 + t * (2.0 - t * (0.5 - 0.1 * f64::from(u8::from(c[0] > 0.0)) * t));
        for (from, to) in [(0.8, 0.4), (0.8, 1.6), (-0.3, -0.1)] {
            let stages = Matrix::from_fn(c.len(), 1, |i, _| of(c[i] * from));
            let mut out = vec![0.0; c.len()];
            Continuation::new(c, 1).extend([from, to], &[of(0.0)], &stages, &mut out);
            for (out, c) in out.iter().zip(c) {
                assert!((out - of(c * to)).abs() < 1e-14, "{c} of {to}");
            }
        }
    }
}

/// A step of which all parts up to the first eighth are solved: continuation tries many that are longer.
#[derive(Default)]
struct Folded {
    backoff: Backoff,
    tried: usize,
}

impl Attempts for Folded {
    fn start(&mut self, _: f64, start: Start) -> Result<bool, StepError> {
        Ok(start != Start::Extrapolated)
    }

    fn iterate(&mut self, _: f64) -> Result<bool, StepError> {
        let (iterations, size) = (1, 1.0);
        Err(StepError::NotConverged { iterations, size })
    }

    fn count_cold_start(&mut self) {}
}

impl BranchAttempts for Folded {
    fn iterate_full(&mut self, h: f64) -> Result<Solved, StepError> {
        self.tried += 1;
        let (iterations, size) = (1, 1.0);
        if h > 0.125 {
            return Err(StepError::NotConverged { iterations, size });
        }
        Ok(Solved {
            iterations,
            is_near: true,
            is_straight: true,
        })
    }

    fn keep(&mut self, _: f64, _: Slot) {}

    fn put_back(&mut self, _: f64, _: Slot) {}

    fn distance(&mut self, _: f64, _: Slot) -> (f64, usize) {
        (0.0, 0)
    }

    fn backoff(&mut self) -> &mut Backoff {
        &mut self.backoff
    }
}

#[test]
fn a_continuation_is_cancelled_between_its_parts() {
    let mut whole = Folded::default();
    let too_large = attempt(&mut whole, 1.0);
    assert!(
        matches!(too_large, Err(StepError::StepTooLarge { .. })),
        "{too_large:?}"
    );
    assert!(whole.tried > 10, "{} parts", whole.tried);
    let mut step = Folded::default();
    let found = cancel::within(CancelToken::new(|| true), || {
        std::thread::sleep(std::time::Duration::from_millis(41));
        attempt(&mut step, 1.0)
    });
    assert_eq!((found, step.tried), (Err(StepError::Interrupted), 0));
}
