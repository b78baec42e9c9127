//! Energies that jump or rise, against every place where they can be parted.

use liouville_base::checkpoint::Checkpoint;
use liouville_problem::EnergyWatch;

/// Looks at energies one after another, with this kinetic energy, at the times 0, 1, 2, …
fn watched(falls: bool, kinetic: f64, energies: &[f64], noise: f64) -> EnergyWatch {
    let mut watch = EnergyWatch::new(falls);
    for (n, energy) in energies.iter().enumerate() {
        watch.look(n as f64, [*energy, kinetic], &[], || noise);
        if n == energies.len() / 2 {
            let mut saved = Vec::new();
            watch.save(0, &mut saved);
            watch = EnergyWatch::new(falls);
            watch.restore(0, &mut saved.as_slice()).expect("its own");
        }
    }
    watch
}

/// Energies that change at few of 200 places, and somewhere jump.
fn energies(seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut next = move |below: u64| {
        state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
        (state >> 33) % below
    };
    let (jump, size) = (20 + next(160), [0.0, 0.3][(seed % 2) as usize]);
    let mut energy = 1.0;
    let moves = (0..200).map(|n| {
        energy += (next(1000) as f64 - 500.0) * 1e-9;
        if n == jump {
            energy += size;
        }
        energy
    });
    moves.collect()
}

/// The widest gap between all energies before a place and all after it.
fn widest(energies: &[f64]) -> (f64, usize) {
    let fold = |part: &[f64], f: fn(f64, f64) -> f64, from| part.iter().copied().fold(from, f);
    let gap = |place: usize| {
        let (before, after) = energies.split_at(place);
        let lowest = fold(after, f64::min, f64::INFINITY);
        (lowest - fold(before, f64::max, f64::NEG_INFINITY), place)
    };
    let gaps = (1..energies.len()).map(gap);
    gaps.max_by(|a, b| a.0.total_cmp(&b.0))
        .expect("many places")
}

#[test]
fn a_jump_is_found_where_all_energies_are_parted_also_after_a_pause() {
    for seed in 0..100 {
        let energies = energies(seed);
        let found = watched(seed % 4 == 1, 100.0, &energies, 0.0).found();
        let (gap, place) = widest(&energies);
        let is_jump = seed % 2 == 1;
        assert_eq!(found.is_some(), is_jump, "{seed}: {found:?}");
        if let Some((kind, numbers)) = found {
            assert_eq!(kind, "jump");
            assert_eq!(numbers[..2], [place as f64 - 1.0, place as f64]);
            assert!((numbers[2] * 100.0 - gap).abs() < 1e-12, "{seed}: {gap}");
        }
    }
}

#[test]
fn a_change_among_changes_like_it_is_no_jump_nor_is_one_that_goes_back() {
    let steady: Vec<f64> = (0..100).map(|n| 1.0 + 1e-2 * f64::from(n)).collect();
    assert_eq!(watched(false, 2.0, &steady, 0.0).found(), None);
    let spike: Vec<f64> = (0..100).map(|n| if n == 50 { 1.1 } else { 1.0 }).collect();
    assert_eq!(watched(false, 2.0, &spike, 0.0).found(), None);
    let jump: Vec<f64> = (0..100).map(|n| if n < 50 { 1.0 } else { 1.1 }).collect();
    let found = watched(false, 2.0, &jump, 0.0).found().expect("a jump");
    assert_eq!((found.0, &found.1[..2]), ("jump", &[49.0, 50.0][..]));
}

#[test]
fn an_energy_that_can_only_fall_may_not_rise_step_by_step() {
    let energies: Vec<f64> = (0..=100)
        .map(|n| 1.0 + f64::from(n - 40_i32).abs() / 100.0)
        .collect();
    let rise = ("rise", vec![40.0, 100.0, 1.0, 1.6]);
    assert_eq!(watched(true, 1.0, &energies, 0.0).found(), Some(rise));
    assert_eq!(watched(false, 1.0, &energies, 0.0).found(), None);
}

#[test]
fn changes_that_roundings_make_do_not_count_and_larger_ones_do() {
    for (change, is_said) in [(1e-35, false), (0.9e-30, false), (1.1e-30, true)] {
        for falls in [false, true] {
            for energies in [[0.0, 0.0, change, change], [0.0, change, 0.0, change]] {
                let found = watched(falls, 0.0, &energies, 1e-30).found();
                assert_eq!(found.is_some(), is_said, "{change}");
            }
        }
    }
}

#[test]
fn a_reset_and_a_force_that_adds_to_the_energy_are_no_changes() {
    let mut watch = EnergyWatch::new(false);
    watch.look(0.0, [1.0, 1.0], &[], || 0.0);
    watch.restart(9.0);
    watch.look(1.0, [9.0, 1.0], &[], || 0.0);
    assert_eq!(watch.found(), None);
    watch.look(2.0, [99.0, 1.0], &[-1.0, 0.0], || 0.0);
    assert_eq!(watch.found().map(|found| found.0), Some("change"));
    watch.look(3.0, [99.0, 1.0], &[1.0, -1.0], || 0.0);
    assert_eq!(watch.found(), None);
}
