//! The order of frames is proven in every sequence, and what happened to it is named.

use super::*;

const X: Axis = Axis::X;

fn check(axis: Axis) -> PatternSet {
    PatternSet::Check { axis, stripe_px: 8.0, seed: 0 }
}

/// A wavy surface with a step, eight bits with noise.
fn scene() -> Scene {
    let mut scene = Scene::ramp(320, 200, 1.3, 0.05, 608).eight_bits();
    scene.noise = (1.0, 0.02);
    for (i, x) in scene.coordinates_px.iter_mut().enumerate() {
        let (row, column) = (i / 320, i % 320);
        *x += 3.0 * crate::math::sin(row as f64 / 15.0) + 2.0 * crate::math::cos(column as f64 / 40.0);
        *x += if column > 150 && row > 80 { 24.5 } else { 0.0 };
    }
    scene
}

fn sequences() -> Vec<Vec<PatternSet>> {
    let (white, black) = (PatternSet::White {}, PatternSet::Black {});
    // Whole periods and few steps: see below.
    let narrow = PatternSet::Check { axis: X, stripe_px: 5.0, seed: 0 };
    vec![
        vec![white.clone(), black.clone(), sine(X, 16.0, 10), gray(X, 7, 8.0), check(X)],
        vec![white.clone(), black.clone(), sine(X, 16.0, 4), gray(X, 6, 16.0), narrow],
        vec![sine(X, 16.0, 5), check(X), gray(X, 7, 8.0), white, black],
    ]
}

fn decode(scene: &Scene, sequence: &[PatternSet], frames: &[Frame]) -> Result<DecodeReport, DecodeError> {
    let mut decoder = scene.decoder(sequence, &DecodeSettings::default())?;
    for (index, frame) in frames.iter().enumerate() {
        decoder.push(index, &frame.view())?;
    }
    let mut map = PhaseMap::new(decoder.info(X)?);
    decoder.finish(X, &mut map.view_mut())
}

/// The frames as a camera takes them when something happens to their order.
fn disturbed(frames: &[Frame], event: OrderEvent) -> Vec<Frame> {
    let dark = PixelBuffer::Mono8(vec![20; frames[0].view().pixels.len()]);
    let black = Frame { pixels: dark, ..frames[0].clone() };
    let shown = |i: usize| event.shown(i).and_then(|shown| frames.get(shown)).unwrap_or(&black);
    (0..frames.len()).map(|i| shown(i).clone()).collect()
}

#[test]
fn frames_in_order_are_proven_and_every_event_is_named() {
    for (number, sequence) in sequences().iter().enumerate() {
        let scene = scene();
        let frames = scene.frames(sequence);
        let report = decode(&scene, sequence, &frames).unwrap();
        assert!(
            matches!(report.order, FrameOrder::Proven { misfit, .. } if misfit < 0.03),
            "{:?}",
            report.order
        );
        assert!(report.ignored.is_empty(), "{:?}", report.ignored);
        let still = Scene { noise: (0.0, 0.0), ..scene.clone() }.frames(sequence);
        let (mut tried, mut named, mut others) = (0, 0, Vec::new());
        // A third of them for each sequence: the trials take most of the time.
        for event in OrderEvent::all(frames.len()).skip(number).step_by(3) {
            match decode(&scene, sequence, &disturbed(&frames, event)) {
                Err(DecodeError::Order { event: told, .. }) => {
                    (tried, named) = (tried + 1, named + usize::from(told == event));
                    if told != event {
                        others.push(format!("{event}: {told}"));
                    }
                }
                Err(error) => panic!("{event}: {error}"),
                // The first bit is dark wherever this part is, as black is.
                Ok(report) => {
                    // Or bits that stood in each other's place were put back by name.
                    let put_back = report.findings.iter().any(|found| found.remedy == Remedy::OtherFrame);
                    let unseen = !put_back && disturbed(&still, event) != still;
                    assert!(!unseen, "{event} was not seen: {:?} {:?}", report.order, report.findings);
                }
            }
        }
        assert!(named * 100 >= tried * 90 && tried > 30, "{named} of {tried} named: {others:#?}");
    }
}

#[test]
fn a_code_alone_cannot_prove_that_bits_were_exchanged() {
    let sequence = vec![sine(X, 16.0, 5), gray(X, 7, 8.0), PatternSet::White {}, PatternSet::Black {}];
    prove_order(&sequence, [608, 684]).unwrap();
    for sequence in sequences() {
        prove_order(&sequence, [608, 684]).unwrap();
    }
    // The check of the other axis says nothing of the bits of this one.
    let mut wrong = sequence.clone();
    wrong.push(check(Axis::Y));
    let refused = prove_order(&wrong, [608, 684]).unwrap_err();
    assert!(
        matches!(refused, DecodeError::OrderNotProven { axis: X, event: OrderEvent::Exchanged(..) }),
        "{refused}"
    );
    assert!(refused.to_string().contains("axis = \"x\""), "{refused}");
    let both = [
        &sequence[..2],
        &[sine(Axis::Y, 16.0, 5), gray(Axis::Y, 7, 8.0)],
        &sequence[2..],
        &[check(X), check(Axis::Y)],
    ];
    prove_order(&both.concat(), [608, 684]).unwrap();
}

/// Steps 1 and 3 of four exchanged turn the phase about a quarter of a period: it stays in its half of the period, which stripes of half a
/// period cannot tell, and a code of whole periods asks for nothing.
#[test]
fn stripes_of_half_a_period_do_not_prove_four_steps_on_a_code_of_whole_periods() {
    let mut sequence = sequences().swap_remove(1);
    prove_order(&sequence, [608, 684]).unwrap();
    sequence[4] = check(X);
    let refused = prove_order(&sequence, [608, 684]).unwrap_err();
    let event = OrderEvent::Exchanged(2, 4);
    assert_eq!(refused, DecodeError::OrderNotProven { axis: X, event });
    // Which is so: nobody sees it.
    let scene = scene();
    let frames = disturbed(&scene.frames(&sequence), event);
    let decoded = decode(&scene, &sequence, &frames);
    assert!(!matches!(decoded, Err(DecodeError::Order { .. })), "{decoded:?}");
}

#[test]
fn darkness_proves_nothing_and_says_so() {
    let mut dark = scene();
    dark.projected_dn = 2.0;
    let sequence = &sequences()[0];
    let report = decode(&dark, sequence, &dark.frames(sequence)).unwrap();
    assert!(matches!(report.order, FrameOrder::Dark(0)), "{:?}", report.order);
    assert!(report.warnings("cam1").iter().any(|warning| warning.contains("not proven")));
}

#[test]
fn a_frame_of_something_else_is_named() {
    let scene = scene();
    let sequence = &sequences()[0];
    let mut frames = scene.frames(sequence);
    frames[15] = frames[1].clone();
    let error = decode(&scene, sequence, &frames).unwrap_err();
    assert_eq!(error, DecodeError::Order { axis: X, event: OrderEvent::Foreign(15) });
    assert!(error.to_string().contains("frame 16"), "{error}");
}
