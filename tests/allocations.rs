//! What warm stages allocate: counted by an allocator that a feature puts in.
//!
//! `cargo test --features count-allocations --test main allocations`

use crate::control::plan;
use crate::running::{Cell, results, text};

/// Cycles until every buffer has its size: the part stands a little differently in each.
const WARM_UP: usize = 4;

/// Allocations of the inspection per cycle that are not messages: ten elements of which each fit keeps its list of points,
/// the rounds of the alignment and of the regions, nine named results. It depends on the rounds, not on the points.
const INSPECTION_AT_MOST: u64 = 1500;

/// Proves: from the fifth cycle on, no thread of a stage calls the allocator between two reports of the stage, its sends and
/// receives included, but for one thing: iceoryx2 allocates the state of every loan (48 bytes; see `ipc::port::loans`), so
/// there is exactly one allocation for each message. The inspection's adjustments allocate besides, within a bound.
#[test]
fn warm_stages_allocate_nothing_but_the_loans_of_their_messages() {
    let cell = Cell::new("alloc");
    std::fs::write(cell.small.path("part.plan.toml"), plan(-50.0, 50.0)).unwrap();
    cell.small.edit("cell.toml", "rig =", "plan = \"part.plan.toml\"\nrig =");
    let output = cell.run("cell.toml", &["--cycles", "12"]);
    let all = results(&cell.out());
    assert_eq!(all.len(), 12, "{}", text(&output.stderr));
    for result in &all[WARM_UP..] {
        assert_eq!(result["outcome"], "ok", "{result}");
        for stage in result["stages"].as_array().unwrap() {
            let (name, cycle) = (stage["name"].as_str().unwrap(), &result["cycle"]);
            let [allocations, messages] = ["allocations", "messages"]
                .map(|key| stage[key].as_u64().unwrap_or_else(|| panic!("{stage}")));
            assert!(messages > 0, "{name} in cycle {cycle}: {stage}");
            if name == "inspection" {
                println!("cycle {cycle}: {} allocations of the inspection", allocations - messages);
                assert!(
                    (1..=INSPECTION_AT_MOST).contains(&(allocations - messages)),
                    "cycle {cycle}: {stage}"
                );
            } else {
                assert_eq!(allocations, messages, "{name} in cycle {cycle}: {stage}");
            }
        }
    }
}
