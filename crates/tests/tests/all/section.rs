//! Poincaré sections: points of the method, in the plane, at the times of the motion.

use liouville_base::composition::Composed;
use liouville_base::ensemble::{BeginBlock, Ensemble, RecordLayout};
use liouville_base::real::{Lanes, Real, Scalar};
use liouville_base::run::{Advance, Fixed, Run, Status};
use liouville_base::simd::Stored;
use liouville_base::tableau::Scheme;
use liouville_fields::problem::{Piece, Polynomials, Split};
use liouville_fields::volume::{Direction, Plane, Section, State, UserVariables, Volume};
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);

const LANES: usize = <Lanes as Scalar>::MEMBERS;

/// Natural shears x_i' = c x_j x_k .., one for each (i, c, [j, k, ..]).
fn shears(n: usize, terms: &[(usize, f64, Vec<i64>)]) -> Arc<Split> {
    let pieces = terms
        .iter()
        .map(|(row, coefficient, factors)| Piece::Natural {
            rows: vec![*row],
            change: Polynomials::new(1, n, &[0], &[*coefficient], factors, factors.len())
                .expect("a polynomial"),
            functions: vec![],
        });
    Arc::new(Split::new(n, pieces.collect()).expect("a split"))
}

/// x' = y, y' = −x
fn circle() -> Arc<Split> {
    shears(2, &[(0, 1.0, vec![1]), (1, -1.0, vec![0])])
}

/// Euler's equations with moments of inertia 1, 2, 3.
fn body() -> Arc<Split> {
    let third = 1.0 / 3.0;
    shears(
        3,
        &[
            (0, -1.0, vec![1, 2]),
            (1, 1.0, vec![0, 2]),
            (2, -third, vec![0, 1]),
        ],
    )
}

fn plane(normal: &[f64], offset: f64, direction: Direction) -> Plane {
    Plane {
        normal: normal.to_vec(),
        offset,
        period: None,
        direction,
    }
}

/// What is stepped, by which scheme, and how it is seen.
struct Motion {
    split: Arc<Split>,
    scheme: &'static str,
    basis: Option<Vec<f64>>,
}

fn motion(split: Arc<Split>, scheme: &'static str) -> Motion {
    Motion {
        split,
        scheme,
        basis: None,
    }
}

/// Members numbered from `first` on, and their starts.
type Starts<'a> = (usize, &'a [&'a [f64]]);

type Sections<S> = Run<State<S>>;

/// Steps of `h` of so many members as a scalar has.
fn run<S: Stored + Real>(
    motion: &Motion,
    plane: &Plane,
    (first, starts): Starts<'_>,
    (h, steps): (f64, usize),
) -> Sections<S> {
    let split = &motion.split;
    let scheme = Scheme::named(motion.scheme).expect("a scheme");
    let volume = Volume::<S>::new(Arc::clone(split), false);
    let single = Volume::<f64>::new(Arc::clone(split), false);
    let seen = UserVariables {
        n: split.n(),
        basis: motion.basis.clone(),
    };
    let stepper = Composed::new(single.clone(), scheme);
    let members = (first..first + starts.len()).collect();
    let section = Section::new(
        volume.clone(),
        (single, stepper),
        seen,
        members,
        plane.clone(),
    );
    let mut x = vec![S::splat(0.0); split.n()];
    for member in 0..S::MEMBERS {
        let start = starts[member.min(starts.len() - 1)];
        for (x, value) in x.iter_mut().zip(start) {
            x.set_member(member, *value);
        }
    }
    let state = volume.state(&x);
    let stepper = Box::new(Composed::new(volume, scheme));
    let control = Box::new(Fixed::new(stepper, 0.0, h, steps));
    Run::new(control, Box::new(section), state, (1, 0)).expect("a start")
}

/// The passages (member, t, x) of trajectories stepped one by one.
fn passages(
    motion: &Motion,
    plane: &Plane,
    starts: &[&[f64]],
    control: (f64, usize),
) -> Vec<Vec<f64>> {
    let runs = starts.iter().enumerate().flat_map(|(member, start)| {
        let mut run = run::<f64>(motion, plane, (member, &[start]), control);
        assert_eq!(run.advance(ALL_DAY), Status::Done);
        let (times, rows) = run.take();
        let width = 2 + motion.split.n();
        assert_eq!(rows.len(), width * times.len());
        let rows: Vec<Vec<f64>> = rows.chunks(width).map(<[f64]>::to_vec).collect();
        for (t, row) in times.iter().zip(&rows) {
            // seen at the end of the step it lies in
            assert!((t - row[1]) / control.0 > -1e-12 && (t - row[1]) / control.0 < 1.0);
        }
        rows
    });
    runs.collect()
}

#[test]
fn a_circle_passes_its_diameter_every_half_turn() {
    for direction in [Direction::Both, Direction::Up, Direction::Down] {
        // y = 0, from (cos 1, −sin 1) at t = 0: up where x = −1, and down where x = 1
        let plane = plane(&[0.0, 1.0], 0.0, direction);
        let start = [1.0_f64.cos(), -1.0_f64.sin()];
        for h in [0.125, -0.125] {
            let rows = passages(&motion(circle(), "SS10s35"), &plane, &[&start], (h, 240));
            let turn = |t: f64| (t * h.signum() + if h > 0.0 { 1.0 } else { -1.0 }) / PI;
            let (step, count) = match direction {
                Direction::Both => (1.0, if h > 0.0 { 9 } else { 10 }),
                _ => (
                    2.0,
                    if h > 0.0 && direction == Direction::Down {
                        4
                    } else {
                        5
                    },
                ),
            };
            assert_eq!(rows.len(), count, "{direction:?} {h}");
            for pair in rows.windows(2) {
                assert!((turn(pair[1][1]) - turn(pair[0][1]) - step).abs() < 1e-14);
            }
            for row in &rows {
                let x = (turn(row[1]).round() * PI).cos();
                assert!(
                    (turn(row[1]) - turn(row[1]).round()).abs() < 2e-14,
                    "{row:?}"
                );
                assert!(
                    (row[2] - x).abs() < 1e-13 && row[3].abs() < 1e-15,
                    "{row:?}"
                );
            }
        }
    }
}

/// K(m), by the arithmetic-geometric mean.
fn elliptic_k(m: f64) -> f64 {
    let (mut a, mut b) = (1.0, (1.0 - m).sqrt());
    for _ in 0..8 {
        (a, b) = (f64::midpoint(a, b), (a * b).sqrt());
    }
    PI / (2.0 * a)
}

#[test]
fn a_rigid_body_comes_back_after_its_period() {
    // from ω = (1, 0, 1): 2 E = 4, L² = 10, so that ω_2 = √m' sn(t, 1/3) with period 4 K(1/3)
    let period = 4.0 * elliptic_k(1.0 / 3.0);
    let up = plane(&[0.0, 1.0, 0.0], 0.0, Direction::Up);
    let start = [1.0, 0.0, 1.0];
    let errors = [0.2, 0.1].map(|h: f64| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let steps = (36.0 / h).round() as usize;
        let rows = passages(&motion(body(), "SS8s21"), &up, &[&start], (h, steps));
        assert_eq!(rows.len(), 5);
        let last = &rows[4];
        assert!(last[3].abs() < 1e-15, "in the plane: {last:?}");
        let gap = (last[2] - 1.0).hypot(last[4] - 1.0);
        (last[1] - 5.0 * period).abs().max(gap)
    });
    assert!(
        errors[1] < 1e-12 && errors[0] > 100.0 * errors[1],
        "{errors:?}"
    );
}

#[test]
fn members_in_lock_step_and_in_ensembles_pass_as_they_do_alone() {
    let starts: Vec<[f64; 3]> = (0..11)
        .map(|k| {
            let angle = 0.3 + 0.25 * f64::from(k);
            [angle.cos(), angle.sin(), 0.6]
        })
        .collect();
    let kept = starts.clone();
    let starts: Vec<&[f64]> = starts.iter().map(|x| &x[..]).collect();
    let oblique = plane(&[0.5, 0.7, -0.2], 0.1, Direction::Both);
    let control = (0.1, 300);
    let motion = motion(body(), "BM4");
    let alone = passages(&motion, &oblique, &starts, control);
    assert!(alone.len() > 50);
    for row in &alone {
        let s = 0.5 * row[2] + 0.7 * row[3] - 0.2 * row[4] - 0.1;
        assert!(s.abs() < 1e-15, "{s:e} from the plane");
    }
    let begin: Box<BeginBlock> = Box::new(move |members: &[usize]| {
        let chunk: Vec<&[f64]> = members.iter().map(|member| &kept[*member][..]).collect();
        let run = run::<Lanes>(&motion, &oblique, (members[0], &chunk), control);
        Ok(Box::new(run) as Box<dyn Advance>)
    });
    let mut ensemble = Ensemble::new(
        begin,
        (11, LANES),
        2,
        RecordLayout::Ragged { width: 5 },
        0.0,
    );
    assert_eq!(ensemble.advance(ALL_DAY), Status::Done);
    let mut together: Vec<Vec<f64>> = ensemble.take().1.chunks(5).map(<[f64]>::to_vec).collect();
    together.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    assert_eq!(together, alone);
}

#[test]
fn parallel_planes_are_passed_one_after_another() {
    // x' = ±1, a row at each multiple of 0.75, the start's apart; several in a step too
    for (velocity, start, first, count, control) in [
        (1.0, 0.0, 0.75, 13, (0.25, 40)),
        (-1.0, 0.0, -0.75, 13, (0.25, 40)),
        (1.0, -1.6, -1.5, 14, (0.25, 40)),
        (1.0, -1.6, -1.5, 14, (2.5, 4)),
        (-1.0, 0.1, 0.0, 14, (2.0, 5)),
    ] {
        let split = shears(2, &[(0, velocity, vec![-1])]);
        let planes = Plane {
            period: Some(0.75),
            ..plane(&[1.0, 0.0], 0.0, Direction::Both)
        };
        let rows = passages(&motion(split, "S2"), &planes, &[&[start, 3.0]], control);
        assert_eq!(rows.len(), count);
        for (k, row) in rows.iter().enumerate() {
            #[allow(clippy::cast_precision_loss)]
            let wanted = first + 0.75 * k as f64 * velocity;
            assert!((row[2] - wanted).abs() < 1e-14, "{row:?}");
            assert!(
                (row[1] - (wanted - start) * velocity).abs() < 1e-14,
                "{row:?}"
            );
        }
    }
}

#[test]
fn a_plane_is_one_of_what_is_seen() {
    // x = (2 y_2, y_1 - y_2)
    let seen = Motion {
        basis: Some(vec![0.0, 2.0, 1.0, -1.0]),
        ..motion(circle(), "SS6s11")
    };
    let plain = motion(circle(), "SS6s11");
    let (start, control): (&[f64], _) = (&[0.3, 0.8], (0.2, 100));
    // 0.25 x_1 + 0.5 x_2 = y_1 / 2
    let found = passages(
        &seen,
        &plane(&[0.25, 0.5], 0.1, Direction::Up),
        &[start],
        control,
    );
    let wanted = passages(
        &plain,
        &plane(&[0.5, 0.0], 0.1, Direction::Up),
        &[start],
        control,
    );
    assert_eq!((found.len(), wanted.len()), (3, 3));
    for (found, wanted) in found.iter().zip(&wanted) {
        assert!((found[1] - wanted[1]).abs() < 1e-14);
        assert!((found[2] - 2.0 * wanted[3]).abs() < 1e-14);
        assert!((found[3] - (wanted[2] - wanted[3])).abs() < 1e-14);
    }
}
