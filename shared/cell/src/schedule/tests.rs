//! The schedule is complete, ordered and the same every time; graphs that cannot run are refused.

use super::topics::FRAME_BUFFER;
use super::*;
use crate::graph::{CameraNode, PairNode, ProjectorNode, Right, axes_taken};
use crate::retention::Retention;
use fringe::pattern::Axis;

/// Four cameras, two projectors, two pairs: the demo in small.
pub fn demo() -> Graph {
    let camera = |name: &str| CameraNode { name: name.into(), width_px: 160, height_px: 120 };
    let projector = |name: &str, cameras: Vec<usize>| ProjectorNode {
        trigger: crate::configuration::TriggerMode::Stepped,
        name: name.into(),
        frames: 5,
        axes: vec![Axis::X],
        cameras,
    };
    let pair = |name: &str, left: usize, projector: usize| PairNode {
        name: name.into(),
        left,
        right: Right::Camera(left + 1),
        projector,
    };
    Graph {
        cameras: ["cam1", "cam2", "cam3", "cam4"].map(camera).to_vec(),
        projectors: vec![projector("proj1", vec![0, 1]), projector("proj2", vec![2, 3])],
        groups: vec![vec![0], vec![1]],
        pairs: vec![pair("pair1", 0, 0), pair("pair2", 2, 1)],
        cores: 2,
        in_flight: 1,
        record: false,
        watch: true,
        retention: Retention::Hashes,
        rate_hz: None,
        cycle_deadline_ms: 1000,
        hosts: Vec::new(),
        here: None,
    }
}

#[test]
fn every_frame_is_shown_exposed_and_summed_once_and_ends_in_one_verdict() {
    let schedule = Schedule::new(&demo()).unwrap();
    let count = |test: fn(&Work) -> bool| schedule.activations.iter().filter(|a| test(&a.work)).count();
    assert_eq!(schedule.stages.len(), 13);
    assert_eq!(count(|w| matches!(w, Work::Project { .. })), 10);
    assert_eq!(count(|w| matches!(w, Work::Expose { .. })), 20);
    assert_eq!(count(|w| matches!(w, Work::Accumulate { .. })), 20);
    assert_eq!(count(|w| matches!(w, Work::Phase { .. })), 4);
    assert_eq!(count(|w| matches!(w, Work::Match { .. })), 2);
    assert_eq!(count(|w| matches!(w, Work::Take { .. })), 1);
    assert_eq!(schedule.activations.last().unwrap().work, Work::Inspect);
}

#[test]
fn inputs_come_before_their_use_and_everything_but_the_verdict_is_used() {
    for record in [false, true] {
        let schedule = Schedule::new(&Graph { record, ..demo() }).unwrap();
        let mut used = vec![false; schedule.activations.len()];
        for (number, activation) in schedule.activations.iter().enumerate() {
            for &input in &activation.inputs {
                assert!(input < number, "{activation:?}");
                used[input] = true;
            }
        }
        for (number, activation) in schedule.activations.iter().enumerate() {
            let end = matches!(activation.work, Work::Inspect | Work::Store);
            // The sums of all frames but the last reach the phase inside the decoder.
            let inner = matches!(activation.work, Work::Accumulate { .. });
            assert!(used[number] || end || inner, "{activation:?}");
        }
    }
}

#[test]
fn the_cores_share_the_work_without_rest_and_the_plan_is_always_the_same() {
    for cores in 1..6 {
        let graph = Graph { cores, ..demo() };
        let schedule = Schedule::new(&graph).unwrap();
        let planned: usize = schedule.lanes().iter().map(|&lane| schedule.on_lane(lane).count()).sum();
        assert_eq!(planned, schedule.activations.len());
        assert_eq!(schedule, Schedule::new(&graph).unwrap());
    }
}

#[test]
fn each_lane_has_one_order_and_a_trace_that_left_it_is_found() {
    for in_flight in [1, 2] {
        keeps_its_order(&Schedule::new(&Graph { in_flight, ..demo() }).unwrap());
    }
}

fn keeps_its_order(schedule: &Schedule) {
    let order = Order::new(schedule);
    for (lane, of) in schedule.lanes().into_iter().enumerate() {
        let on_lane: Vec<usize> = schedule.on_lane(of).map(|(number, _)| number).collect();
        for (place, &number) in on_lane.iter().enumerate() {
            assert_eq!((order.lane[number], order.place[number]), (lane, place));
            assert_eq!(order.before[number], place.checked_sub(1).map(|p| on_lane[p]));
        }
    }
    // One after another is one way to keep the order on every core.
    let interval = |activation: usize| {
        let start_ns = 10 * activation as u64;
        Interval { activation, start_ns, end_ns: start_ns + 5 }
    };
    let kept: Vec<Interval> = (0..schedule.activations.len()).map(interval).collect();
    assert_eq!(violation(schedule, &order, &kept), None);
    for number in 1..kept.len() {
        let Some(before) = order.before[number] else { continue };
        let mut early = kept.clone();
        early[number].start_ns = early[before].end_ns - 1;
        assert_eq!(violation(schedule, &order, &early), Some((before, number)));
        let mut lacking = kept.clone();
        lacking.remove(before);
        assert!(violation(schedule, &order, &lacking).is_some(), "{before} is missing");
    }
    // Whoever may begin something then is woken, but no stage wakes itself.
    for (number, activation) in schedule.activations.iter().enumerate() {
        for &earlier in activation.inputs.iter().chain(&order.before[number]) {
            let other = schedule.activations[earlier].stage != activation.stage;
            assert_eq!(order.wakes[earlier].contains(&activation.stage), other, "{earlier} {number}");
        }
    }
    // Work on another core that began before what it works on was done.
    let matched = schedule.find(Work::Match { pair: 1 }).unwrap();
    let input = schedule.activations[matched].inputs[0];
    let mut early = kept.clone();
    early[input].end_ns = early[matched].start_ns + 1;
    assert_eq!(violation(schedule, &order, &early), Some((input, matched)));
}

#[test]
fn the_halves_of_a_cycle_have_lanes_of_their_own_and_with_several_in_flight_phases_have_room_to_wait() {
    let alone = Schedule::new(&demo()).unwrap();
    let schedule = Schedule::new(&Graph { in_flight: 3, ..demo() }).unwrap();
    assert_eq!((alone.lanes().len(), schedule.lanes().len()), (4, 4));
    assert_eq!(alone.activations, schedule.activations, "what is done is the same");
    let buffer = |schedule: &Schedule| schedule.topic("phase/cam1").unwrap().size.buffer;
    assert_eq!(buffer(&schedule), 3 * buffer(&alone));
    for lane in schedule.lanes() {
        assert!(schedule.on_lane(lane).all(|(_, activation)| schedule.half(activation) == lane.half));
    }
    // The acquisition takes nothing from the evaluation: it can go ahead of it.
    for activation in schedule.activations.iter().filter(|a| schedule.half(a) == Half::Acquisition) {
        let inputs = activation.inputs.iter().map(|&input| schedule.half(&schedule.activations[input]));
        assert!(inputs.into_iter().all(|half| half == Half::Acquisition));
    }
}

/// All work that an activation waits for, directly or not: its inputs, what comes before it in its lane, and what these wait for.
fn waits_for(schedule: &Schedule, work: Work) -> Vec<Work> {
    let order = Order::new(schedule);
    let mut waited = vec![false; schedule.activations.len()];
    waited[schedule.find(work).unwrap()] = true;
    for number in (0..waited.len()).rev() {
        if !waited[number] {
            continue;
        }
        for &earlier in schedule.activations[number].inputs.iter().chain(&order.before[number]) {
            waited[earlier] = true;
        }
    }
    (0..waited.len())
        .filter(|number| waited[*number])
        .map(|number| schedule.activations[number].work)
        .collect()
}

/// Proves: the second projector waits for no match, and fusion has the first cloud before the second projector is done, whether cycles overlap or
/// not; the cloud of the last projector it takes with all others.
#[test]
fn what_a_projector_showed_is_evaluated_while_the_next_one_shows() {
    for in_flight in [1, 2] {
        let schedule = Schedule::new(&Graph { in_flight, ..demo() }).unwrap();
        let acquired = waits_for(&schedule, Work::Phase { camera: 2, projector: 1, axis: Axis::X });
        assert!(acquired.iter().any(|work| matches!(work, Work::Phase { projector: 0, .. })));
        assert!(!acquired.iter().any(|work| matches!(work, Work::Match { .. } | Work::Take { .. })));
        let taken = waits_for(&schedule, Work::Take { pair: 0 });
        assert!(taken.contains(&Work::Match { pair: 0 }));
        let second =
            |work: &Work| matches!(work, Work::Project { projector: 1, .. } | Work::Match { pair: 1 });
        assert!(!taken.iter().any(second));
        assert!(waits_for(&schedule, Work::Fuse).contains(&Work::Take { pair: 0 }));
        assert!(schedule.find(Work::Take { pair: 1 }).is_none());
    }
}

/// Proves: a cloud is not taken before one that comes earlier in the order of the pairs, and none where all projectors show together.
#[test]
fn fusion_takes_clouds_in_the_order_of_the_pairs() {
    let mut graph = demo();
    graph.pairs.swap(0, 1);
    let takes = |graph: &Graph| {
        let schedule = Schedule::new(graph).unwrap();
        schedule.activations.iter().filter(|a| matches!(a.work, Work::Take { .. })).count()
    };
    assert_eq!(takes(&graph), 0, "the first pair is lit last");
    graph.groups = vec![vec![1], vec![0]];
    assert_eq!(takes(&graph), 1);
    graph.groups = vec![vec![0, 1]];
    assert_eq!(takes(&graph), 0);
}

/// Proves: projectors of a group show frame by frame together, cameras expose when all of them show, a shorter sequence ends earlier, and
/// all that is done without groups is done with them.
#[test]
fn projectors_of_a_group_show_at_the_same_time() {
    let mut graph = Graph { groups: vec![vec![0, 1]], ..demo() };
    graph.projectors[1].frames = 3;
    let schedule = Schedule::new(&graph).unwrap();
    keeps_its_order(&schedule);
    let alone = Schedule::new(&Graph { groups: vec![vec![0], vec![1]], ..graph.clone() }).unwrap();
    let sorted = |schedule: &Schedule| {
        let mut work: Vec<String> = schedule.activations.iter().map(|a| format!("{:?}", a.work)).collect();
        work.sort_unstable();
        work
    };
    let apart: Vec<String> = sorted(&alone).into_iter().filter(|work| !work.starts_with("Take")).collect();
    assert_eq!(sorted(&schedule), apart);
    for frame in 0..3 {
        let shown = [0, 1].map(|projector| schedule.find(Work::Project { projector, frame }).unwrap());
        assert_eq!(shown[1], shown[0] + 1);
        assert_eq!(schedule.activations[shown[0]].inputs, schedule.activations[shown[1]].inputs);
        for (camera, projector) in [(0, 0), (1, 0), (2, 1), (3, 1)] {
            let exposed = schedule.find(Work::Expose { camera, projector, frame }).unwrap();
            assert_eq!(schedule.activations[exposed].inputs, shown);
        }
    }
    assert_eq!((graph.shown_frames(), alone.activations.len()), (5, schedule.activations.len() + 1));
    graph.rate_hz = Some(5.0);
    assert!(Schedule::new(&graph).is_ok(), "five frames at 5 Hz");
    graph.groups = vec![vec![0], vec![1]];
    assert!(Schedule::new(&graph).unwrap_err().to_string().contains("8 frames at 5 Hz"));
}

#[test]
fn buffers_are_priced_by_their_largest_message() {
    let schedule = Schedule::new(&demo()).unwrap();
    let frame = schedule.topic("frame/cam1").unwrap();
    assert_eq!(frame.bytes, 160 * 120 * 2);
    assert_eq!(frame.memory_bytes(), frame.bytes * (2 * (FRAME_BUFFER as u64 + 2) + 1));
    assert_eq!(schedule.topic("cloud/fused").unwrap().bytes, 2 * 160 * 120 * 56);
    assert!(schedule.memory_bytes() > frame.memory_bytes());
}

#[test]
fn a_pair_with_its_projector_takes_both_phases_of_its_camera() {
    let mut graph = demo();
    graph.projectors[0].axes = vec![Axis::X, Axis::Y];
    graph.projectors[0].cameras = vec![0];
    graph.pairs[0].right = Right::Projector;
    graph.cameras.remove(1);
    graph.projectors[1].cameras = vec![1, 2];
    graph.pairs[1].left = 1;
    graph.pairs[1].right = Right::Camera(2);
    let schedule = Schedule::new(&graph).unwrap();
    let work = Work::Match { pair: 0 };
    let matched = &schedule.activations[schedule.find(work).unwrap()];
    assert_eq!(matched.inputs.len(), 2);
    assert_eq!(axes_taken(&graph, 0, 0), [Axis::X, Axis::Y]);
}

/// A change that makes a graph impossible, and a part of the message that has to follow.
type Fault = (fn(&mut Graph), &'static str);

#[test]
fn graphs_that_cannot_run_are_refused_with_both_ends() {
    let faults: [Fault; 10] = [
        (|g| g.cameras.clear(), "no camera"),
        (|g| g.projectors.clear(), "no projector"),
        (|g| g.pairs.clear(), "no pair"),
        (|g| g.cores = 0, "no core"),
        (|g| g.projectors[1].cameras.clear(), "\"proj2\" lights no camera"),
        (|g| g.projectors[0].axes.clear(), "\"proj1\" has no set that gives one"),
        (|g| g.projectors[0].cameras = vec![0], "\"cam2\", but projector \"proj1\" lights only cam1"),
        (|g| g.cameras.push(g.cameras[0].clone()), "camera \"cam1\" is in no projector's `cameras`"),
        (|g| drop(g.pairs.pop()), "\"cam3\" looks at projector \"proj2\", but no pair"),
        (|g| g.rate_hz = Some(5.0), "10 frames at 5 Hz last 2000 ms, the cycle must end within 1000 ms"),
    ];
    for (change, message) in faults {
        let mut graph = demo();
        change(&mut graph);
        let error = Schedule::new(&graph).unwrap_err().to_string();
        assert!(error.contains(message), "{error} lacks {message}");
    }
    let mut graph = demo();
    graph.cameras[0].width_px = 65_535;
    graph.cameras[0].height_px = 65_535;
    assert!(matches!(Schedule::new(&graph), Err(ScheduleError::TooLarge { .. })));
}

/// The demo in small on two hosts, the first of which leads, seen from one of them.
fn on_host(here: usize) -> Graph {
    let host = |name: &str, pair: usize, leads: bool| crate::graph::HostNode {
        name: name.into(),
        pairs: vec![pair],
        leads,
    };
    Graph { hosts: vec![host("left", 0, true), host("right", 1, false)], here: Some(here), ..demo() }
}

#[test]
fn each_host_plans_its_part_under_the_numbers_of_the_whole() {
    let whole = Schedule::new(&demo()).unwrap();
    let [left, right] = [0, 1].map(|here| Schedule::new(&on_host(here)).unwrap());
    let works = |schedule: &Schedule| schedule.activations.iter().map(|a| a.work).collect::<Vec<_>>();
    for work in works(&whole) {
        let [here, there] = [left.find(work), right.find(work)].map(|found| found.is_some());
        assert!(here != there, "{work:?} is done on one of the hosts");
    }
    let remote = left.find(Work::Remote { host: 1 }).unwrap();
    let shown: Vec<Work> =
        left.activations[remote].inputs.iter().map(|&i| left.activations[i].work).collect();
    assert!(
        shown.iter().all(|work| matches!(work, Work::Expose { projector: 0, frame: 4, .. })),
        "{shown:?}"
    );
    let received = left.find(Work::Receive { pair: 1 }).unwrap();
    let fused = &left.activations[left.find(Work::Fuse).unwrap()];
    assert!(fused.inputs.contains(&received) && left.activations[received].inputs == [remote]);
    assert_eq!(works(&right).last(), Some(&Work::Deliver));
    assert_eq!(left.topic("cloud/pair2").unwrap().producers, ["link"]);
    assert_eq!(right.topic("cloud/pair2").unwrap().consumers, ["link"]);
    assert!(right.topic("cloud/fused").is_none() && left.topic("frame/cam3").is_none());
    assert!(
        right
            .find(Work::HandOver)
            .is_some_and(|handed| handed < right.find(Work::Match { pair: 1 }).unwrap() + 2)
    );
    for schedule in [&left, &right] {
        assert_eq!(schedule.lanes().len(), 2 * schedule.cores + 1, "waiting for others takes no core's turn");
        // One after another is one way to keep the order on every core.
        let interval = |activation: usize| {
            let start_ns = 10 * activation as u64;
            Interval { activation, start_ns, end_ns: start_ns + 5 }
        };
        let kept: Vec<Interval> = (0..schedule.activations.len()).map(interval).collect();
        assert_eq!(violation(schedule, &Order::new(schedule), &kept), None);
        let link = schedule.stages.iter().position(|stage| stage.kind == Kind::Link).unwrap();
        let on_link = schedule.on_lane(schedule.lanes()[2 * schedule.cores]);
        assert!(on_link.map(|(_, activation)| activation.stage).all(|stage| stage == link));
    }
}

#[test]
fn hosts_take_their_frames_one_after_another() {
    let mut graph = on_host(0);
    let third = CameraNode { name: "cam5".into(), width_px: 160, height_px: 120 };
    graph.cameras.extend([third.clone(), CameraNode { name: "cam6".into(), ..third }]);
    graph.projectors.push(ProjectorNode {
        name: "proj3".into(),
        cameras: vec![4, 5],
        ..graph.projectors[0].clone()
    });
    graph.groups.push(vec![2]);
    graph.pairs.push(PairNode { name: "pair3".into(), left: 4, right: Right::Camera(5), projector: 2 });
    graph.hosts.push(crate::graph::HostNode { name: "back".into(), pairs: vec![2], leads: false });
    let schedule = Schedule::new(&graph).unwrap();
    let [second, third] = [1, 2].map(|host| schedule.find(Work::Remote { host }).unwrap());
    assert_eq!(schedule.activations[third].inputs, [second]);
    assert_eq!(schedule.links, 2);
    assert!(
        schedule.find(Work::Receive { pair: 1 }).unwrap() > third,
        "clouds come while others take frames"
    );
}
