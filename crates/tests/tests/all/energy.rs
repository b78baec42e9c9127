//! Energies that jump, against every place where records can be parted.

use liouville_base::checkpoint::Checkpoint;
use liouville_problem::{EnergyChange, EnergyColumns, EnergyWatch, KineticColumns};

const AT: EnergyColumns = EnergyColumns {
    energy: 0,
    kinetic: KineticColumns::Recorded(1),
};

fn watch(falls: bool) -> EnergyWatch {
    EnergyWatch::new(AT, None, 0.0, falls)
}

/// Energies of which most follow one that is the same, so that any gap is conspicuous.
fn energies(seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut next = move |below: u64| {
        state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
        (state >> 33) % below
    };
    let mut energy = 1.0;
    let moves = (0..40).map(|_| {
        if next(5) == 0 {
            let size = if next(2) == 0 { 0.01 } else { 0.3 };
            energy += (next(1000) as f64 - 500.0) / 1024.0 * size;
        }
        energy
    });
    moves.collect()
}

/// The widest gap between all energies before a record and all after it, found at every record.
fn widest(energies: &[f64], falls: bool) -> f64 {
    let lowest = |part: &[f64]| part.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = |part: &[f64]| part.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let gap = |place: usize| {
        let (before, after) = energies.split_at(place);
        let rise = lowest(after) - highest(before);
        let fall = lowest(before) - highest(after);
        if falls { rise } else { rise.max(fall) }
    };
    highest(&(1..energies.len()).map(gap).collect::<Vec<_>>())
}

/// Whether these are the times before and at a record.
fn is_at(between: [f64; 2], record: usize) -> bool {
    let times = [record - 1, record].map(|n| (n as f64).to_bits());
    between.map(f64::to_bits) == times
}

#[test]
fn the_widest_gap_is_found_while_records_come_and_after_a_pause() {
    let (mut jumps, mut none) = (0, 0);
    for seed in 0..400 {
        let (energies, falls) = (energies(seed), seed % 2 == 1);
        let (mut whole, mut parted) = (watch(falls), watch(falls));
        for (n, energy) in energies.iter().enumerate() {
            for watch in [&mut whole, &mut parted] {
                watch.add(n as f64, &[*energy, 100.0]);
            }
            if n == 20 {
                let mut saved = Vec::new();
                parted.save(0, &mut saved);
                parted = watch(falls);
                parted
                    .restore(0, &mut saved.as_slice())
                    .expect("what was saved");
            }
        }
        assert_eq!(whole.found(), parted.found());
        let (size, gap) = (100.0, widest(&energies, falls));
        match whole.found() {
            Some(EnergyChange::Jump { between, part }) => {
                assert!((part * size - gap).abs() < 1e-15, "{seed}: {part} {gap}");
                let at = (1..energies.len()).find(|at| is_at(between, *at));
                let at = at.expect("records that follow one another");
                assert!((energies[at] - energies[at - 1]).abs() >= gap, "{seed}");
                jumps += 1;
            }
            None => {
                assert!(gap <= 1e-3 * size, "{seed}: {gap}");
                none += 1;
            }
            found => panic!("{seed}: {found:?}"),
        }
    }
    assert!(jumps > 50 && none > 50, "{jumps} {none}");
}

#[test]
fn a_step_among_steps_like_it_is_no_jump_and_one_among_small_ones_is() {
    for (small, is_jump) in [(1e-2, false), (1e-7, true)] {
        let mut watch = watch(false);
        for n in 0..100 {
            let energy = 1.0 + small * f64::from(n) + if n > 50 { 0.1 } else { 0.0 };
            watch.add(f64::from(n), &[energy, 2.0]);
        }
        let found = watch.found();
        assert_eq!(found.is_some(), is_jump, "{small}: {found:?}");
        if let Some(EnergyChange::Jump { between, .. }) = found {
            assert!(is_at(between, 51));
        }
    }
}

#[test]
fn an_energy_that_can_only_fall_may_not_rise_step_by_step_after_a_pause_either() {
    for falls in [false, true] {
        let mut watch = watch(falls);
        for n in 0..=100 {
            let fallen = f64::from(n - 40).abs() / 100.0;
            watch.add(f64::from(n), &[1.0 + fallen, 1.0]);
            if n == 70 {
                let mut saved = Vec::new();
                watch.save(0, &mut saved);
                watch = self::watch(falls);
                watch.restore(0, &mut saved.as_slice()).expect("its own");
            }
        }
        let rise = EnergyChange::Rise {
            between: [40.0, 100.0],
            energies: [1.0, 1.6],
        };
        assert_eq!(watch.found(), falls.then_some(rise));
    }
}

#[test]
fn changes_that_roundings_make_do_not_count_and_larger_ones_do() {
    for (change, is_said) in [(1e-35, false), (0.9e-30, false), (1.1e-30, true)] {
        let found = |energies: [f64; 4]| {
            let mut watch = EnergyWatch::new(AT, None, 1e-30, true);
            for (n, energy) in energies.iter().enumerate() {
                watch.add(n as f64, &[*energy, 0.0]);
            }
            watch.found()
        };
        assert_eq!(found([0.0, 0.0, change, change]).is_some(), is_said);
        assert_eq!(found([0.0, change, 0.0, change]).is_some(), is_said);
    }
}
