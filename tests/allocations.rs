//! The hot path of the stages allocates nothing once it is warm: counted by an allocator that a feature puts in.
//!
//! `cargo test --features count-allocations --test main allocations`

use crate::running::{Cell, results, text};

/// Cycles until every buffer has its size: the part stands a little differently in each.
const WARM_UP: usize = 4;

/// Proves: from the fifth cycle on, no thread of these stages calls the allocator between two reports of the stage, its sends
/// and receives included. The inspection is left out: its adjustments allocate, and it has no plan here.
#[test]
fn warm_stages_allocate_nothing() {
    let cell = Cell::new("alloc");
    let output = cell.run("cell.toml", &["--cycles", "12"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    for result in &results(&cell.out())[WARM_UP..] {
        for stage in result["stages"].as_array().unwrap() {
            let name = stage["name"].as_str().unwrap();
            assert_eq!(stage["allocations"], 0, "{name} in cycle {}: {stage}", result["cycle"]);
        }
    }
}
