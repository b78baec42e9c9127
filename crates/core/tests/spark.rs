//! x
mod support;
#[test]
fn a() {
    let _ = support::pendulum().build();
}
