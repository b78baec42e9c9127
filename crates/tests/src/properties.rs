//! What properties are tested with: the same cases in every run, or by `make fuzz` others and more.

use proptest::test_runner::{Config, RngSeed};

/// Seed of every property, where `PROPTEST_RNG_SEED` names no other.
const SEED: u64 = 20_200_229;

/// Configuration of a property tried with `cases` cases, `FUZZ_TIMES` as many where that is set.
///
/// # Panics
/// When `FUZZ_TIMES` is not a number of times.
pub fn properties(cases: u32) -> Config {
    let times: u32 = std::env::var("FUZZ_TIMES").map_or(1, |times| match times.parse() {
        Ok(times) => times,
        Err(error) => panic!("FUZZ_TIMES is {times}: {error}"),
    });
    let read = Config::default(); // with PROPTEST_RNG_SEED, if there is one
    Config {
        cases: if cfg!(miri) {
            cases.div_ceil(100)
        } else {
            cases * times
        },
        max_global_rejects: read.max_global_rejects * times,
        failure_persistence: None,
        rng_seed: match read.rng_seed {
            RngSeed::Random => RngSeed::Fixed(SEED),
            RngSeed::Fixed(seed) => RngSeed::Fixed(seed),
        },
        ..read
    }
}
