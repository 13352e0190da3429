//! A code without fringes: what the finer bits say of a coarser one.

use super::code_dirt::Coded;
use super::*;

/// The first bit is dark on the whole part, as it may be; the second one is not, and no coarser bit changes that could contradict it.
#[test]
fn a_black_frame_is_named_where_the_finer_bits_say_that_it_changes() {
    let (findings, _, _) = Coded::alone(false).decode().unwrap();
    assert!(findings.is_empty(), "{findings:?}");
    for (value, name) in [(2.0, "black"), (60.0, "dim")] {
        let mut coded = Coded::alone(false);
        coded.put(1, |_| value);
        let error = coded.decode().expect_err(name).to_string();
        assert!(error.contains("frame 2 of set 1"), "{name}: {error}");
    }
}

/// A wide stripe keeps its contrast when it is blurred; its edges do not.
#[test]
fn a_frame_with_soft_edges_is_named() {
    for inverse in [false, true] {
        for bit in [1, 2] {
            let mut coded = Coded::alone(inverse);
            let old = coded.values(bit);
            let mean = |i: usize| {
                let (row, column) = (i / 320, i % 320);
                let along = column.saturating_sub(9)..(column + 10).min(320);
                let count = along.len() as f64;
                along.map(|column| old[row * 320 + column]).sum::<f64>() / count
            };
            coded.put(bit, mean);
            let (findings, _, _) = coded.decode().unwrap();
            let blurred = |found: &&Finding| {
                found.step == Some(bit) && matches!(found.fault, Fault::Blurred(share) if share < 0.6)
            };
            assert_eq!(findings.iter().filter(blurred).count(), 1, "{bit}, {inverse}: {findings:?}");
        }
    }
}

/// A surface that a turned camera sees run back, from frames that are right: at most a warning.
#[test]
fn stripes_that_turn_back_on_a_face_are_not_refused() {
    let mut coded = Coded::alone(false);
    for (i, x) in coded.scene.coordinates_px.iter_mut().enumerate() {
        let column = (i % 320) as f64;
        *x = 20.0 + 0.7 * if column < 230.0 { column } else { 460.0 - column };
    }
    coded.frames = coded.scene.frames(&coded.sequence);
    let (findings, wrong, _) = coded.decode().unwrap();
    assert_eq!(wrong, 0);
    assert!(findings.iter().all(|found| found.remedy == Remedy::Doubted), "{findings:?}");
}
