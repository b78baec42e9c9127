//! Members in lock-step: each is a run of its own bit for bit, in any block, whether the others stay on the
//! common path, step by themselves or fail.

use liouville_base::ensemble::{Ensemble, RecordLayout};
use liouville_base::error::StepError;
use liouville_base::real::{BATCH, Lanes, Scalar};
use liouville_base::run::{Advance, Fixed, Run, Span, Status};
use liouville_base::tableau;
use liouville_base::tape::Tape;
use liouville_problem::{Mechanical, Model, Observer, Observers};
use liouville_spark::{Solver, Spark, SparkBatch};
use liouville_tests::properties::properties;
use liouville_tests::{Functions, PARAMS, Y, Z, dot, input, inputs, tape};
use proptest::prelude::*;
use std::sync::Arc;
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);
const N: usize = 3;
const H: f64 = 0.05;
const STEPS: usize = 20;
const EVERY: usize = 3;
/// y, z, λ and a quantity.
const WIDTH: usize = 8;

/// A bob on a rod of length 1, held by a spring beside it; its parameters are gravity and the spring's stiffness.
fn held() -> Functions {
    let (y, z) = (inputs(Y, N), inputs(Z, N));
    let [gravity, stiffness] = [0, 1].map(|k| input(PARAMS, k));
    Functions {
        v: None,
        p: z,
        f: vec![-(&stiffness * (&y[0] - 0.6)), 0.0.into(), -gravity],
        r: None,
        g: vec![(dot(&y, &y) - 1.0) * 0.5],
        params: 2,
    }
}

/// Parameters, coordinates and velocities of a member.
#[derive(Clone, Copy, Debug)]
struct Member {
    params: [f64; 2],
    y: [f64; N],
    z: [f64; N],
}

/// A stiffness that node Schur does not stand, and a gravity that no solver does at this step size.
const STIFF: f64 = 1e7;
const HEAVY: f64 = 1e5;

/// What becomes of one member.
#[derive(Clone, Copy, Debug)]
enum Odd {
    Out,
    Stiff,
    Fails,
}

fn member() -> impl Strategy<Value = Member> {
    (0.5..2.0, 0.0..10.0, prop::array::uniform3(-0.5..0.5_f64)).prop_map(|(g, k, v)| {
        let y = [0.6, 0.0, -0.8];
        let along: f64 = y.iter().zip(&v).map(|(y, v)| y * v).sum();
        Member {
            params: [g, k],
            y,
            z: std::array::from_fn(|i| v[i] - along * y[i]),
        }
    })
}

/// Some members, and one among them that is not like the others.
fn members() -> impl Strategy<Value = Vec<Member>> {
    let odd = prop_oneof![Just(Odd::Out), Just(Odd::Stiff), Just(Odd::Fails)];
    let some = prop::collection::vec(member(), 1..=BATCH + 4);
    (some, any::<prop::sample::Index>(), odd).prop_map(|(mut members, place, odd)| {
        let place = place.index(members.len());
        let one = &mut members[place];
        match odd {
            Odd::Out => {}
            Odd::Stiff => one.params[1] = STIFF,
            Odd::Fails => one.params[0] = HEAVY,
        }
        members
    })
}

type Begun = Result<Box<dyn Advance>, StepError>;

/// A quantity that is recorded beside the states.
fn observed() -> Arc<Tape> {
    let quantity = (input(Y, 0) * input(Z, 1) * input(PARAMS, 0)).sin();
    tape([1, N, N, 2], &[quantity]).into()
}

fn observer(problem: &Arc<Mechanical>, params: &[f64]) -> Observer {
    let model = Model::new(problem.clone(), params);
    Observer::new(model, params, observed(), true)
}

fn alone(problem: &Arc<Mechanical>, s: usize, member: &Member) -> Begun {
    let mut model = Model::new(problem.clone(), &member.params);
    let state = model.state(0.0, &member.y, &member.z);
    let stepper = Box::new(Spark::new(model, s, Solver::Auto));
    let control = Box::new(Fixed::new(stepper, 0.0, H, STEPS));
    let observer = Box::new(observer(problem, &member.params));
    Ok(Box::new(Run::new(control, observer, state, (EVERY, 0))?))
}

fn together(problem: &Arc<Mechanical>, s: usize, members: &[Member]) -> Begun {
    let last = members.len() - 1;
    let lanes = |value: &dyn Fn(&Member) -> f64| {
        let mut lanes = Lanes::<BATCH>::splat(0.0);
        (0..BATCH).for_each(|place| lanes.set_member(place, value(&members[place.min(last)])));
        lanes
    };
    let params = [0, 1].map(|k| lanes(&|member| member.params[k]));
    let [y, z] = [0, 1].map(|part| {
        let of = |member: &Member| if part == 0 { member.y } else { member.z };
        [0, 1, 2].map(|i| lanes(&|member| of(member)[i]))
    });
    let (tableau, filled) = (tableau::Spark::gauss(s), (&params[..], members.len()));
    let mut stepper = SparkBatch::of(problem, filled, tableau, Solver::Auto);
    let state = stepper.state(0.0, &y, &z);
    let observers = Box::new(Observers::new(problem, filled, (observed(), true)));
    let control = Box::new(Fixed::new(Box::new(stepper), 0.0, H, STEPS));
    let run = Run::new(control, observers, state, (EVERY, 0))?;
    Ok(Box::new(run.of_members(members.len())))
}

#[test]
fn the_odd_ones_step_by_full_newton_or_not_at_all() {
    let problem = held().build();
    let (y, z) = ([0.6, 0.0, -0.8], [0.1, 0.2, 0.075]);
    let status = |params| {
        let mut run = alone(&problem, 2, &Member { params, y, z }).expect("a start");
        (run.advance(ALL_DAY), run.stats().0.newton_steps > 0)
    };
    assert_eq!(status([1.0, 1.0]), (Status::Done, false));
    assert_eq!(status([1.0, STIFF]), (Status::Done, true));
    assert!(matches!(status([HEAVY, 1.0]).0, Status::Failed { .. }));
}

proptest! {
    #![proptest_config(properties(60))]

    #[test]
    fn a_member_has_the_bits_that_it_has_alone(all in members(), s in 1..4_usize) {
        let problem = held().build();
        let span = Span { t0: 0.0, t1: STEPS as f64 * H, steps: STEPS, every: EVERY };
        let (count, times) = (all.len(), span.times().expect("few"));
        let layout = RecordLayout::Aligned { times: times.clone(), width: WIDTH };
        let (shared, of) = (problem.clone(), all.clone());
        let begin = move |places: &[usize]| match places {
            [one] => alone(&shared, s, &of[*one]),
            _ => together(&shared, s, &places.iter().map(|k| of[*k]).collect::<Vec<_>>()),
        };
        let mut ensemble = Ensemble::new(Box::new(begin), (count, BATCH), 1, layout, 0.0);
        prop_assert_eq!(ensemble.advance(ALL_DAY), Status::Done);
        let failures = ensemble.failures();
        let (_, rows) = ensemble.take();
        for (place, member) in all.iter().enumerate() {
            let mut run = alone(&problem, s, member).expect("a start");
            let failure = failures.iter().find(|failure| failure.member == place);
            match run.advance(ALL_DAY) {
                Status::Failed { n, t, error } => {
                    let failure = failure.expect("it fails in a block too");
                    prop_assert_eq!(&failure.error, &error);
                    prop_assert_eq!(failure.step, Some((n, t)));
                }
                status => prop_assert_eq!((status, failure), (Status::Done, None)),
            }
            let (own_times, own) = run.take();
            for (k, row) in rows.chunks_exact(count * WIDTH).enumerate() {
                let found = row[place * WIDTH..][..WIDTH].iter().map(|x| x.to_bits());
                if own_times.get(k).is_some_and(|t| t.to_bits() == times[k].to_bits()) {
                    let wanted = own[k * WIDTH..][..WIDTH].iter().map(|x| x.to_bits());
                    prop_assert!(found.eq(wanted), "member {}, record {}", place, k);
                } else {
                    prop_assert!(row[place * WIDTH..][..WIDTH].iter().all(|x| x.is_nan()));
                }
            }
        }
    }
}
