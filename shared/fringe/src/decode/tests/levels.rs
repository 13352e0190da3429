//! The same bits whatever vector instructions the processor has, and however many threads.

use super::*;
use crate::math::simd::levels;

/// All planes of a map as bits.
fn bits(map: &PhaseMap) -> Vec<u32> {
    let planes = [&map.phase_rad, &map.sigma_rad, &map.modulation];
    let values = planes.into_iter().flatten().map(|value| value.to_bits());
    values.chain(map.valid.iter().map(|valid| u32::from(*valid))).collect()
}

/// Faces with steps between them, holes, single pixels that see something else: hardly a neighbourhood is smooth.
fn torn() -> Scene {
    const WIDTH: usize = 187;
    let mut scene = Scene::ramp(WIDTH, 71, 0.7, 0.11, 608).eight_bits();
    for (i, coordinate) in scene.coordinates_px.iter_mut().enumerate() {
        let (x, y) = (i % WIDTH, i / WIDTH);
        *coordinate += [0.0, 90.0, 37.0, 1e9][(x / 9 + y / 7) % 4];
        if (x * 7 + y * 13).is_multiple_of(31) {
            *coordinate = 300.0 + (x % 11) as f64;
        }
    }
    scene.noise = (1.5, 0.02);
    scene
}

#[test]
fn every_level_of_instructions_gives_the_same_bits() {
    let mut bytes = Scene::ramp(203, 67, 0.7, 0.11, 608).eight_bits();
    bytes.noise = (1.5, 0.02);
    let mut words = Scene::ramp(131, 53, 1.3, 0.07, 608);
    words.noise = (90.0, 0.4);
    let torn = torn();
    let x = Axis::X;
    let levels_of = |sets: Vec<PatternSet>| [sets, vec![PatternSet::White {}, PatternSet::Black {}]].concat();
    let sequences = [
        demo(8.0, 7),
        levels_of(vec![sine(x, 16.0, 7), sine(x, 128.0, 4), gray(x, 6, 16.0)]),
        vec![sine(x, 608.0, 5), sine(x, 32.0, 12)],
        levels_of(vec![gray(x, 7, 8.0)]),
    ];
    // What is torn contradicts itself nearly everywhere.
    let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
    for scene in [&bytes, &words, &torn] {
        for sequence in &sequences {
            let frames = scene.frames(sequence);
            let mut expected = None;
            for (level, threads) in levels().into_iter().flat_map(|level| [(level, 1), (level, 3)]) {
                let mut decoder = scene.decoder(sequence, &settings).unwrap();
                decoder.level = level;
                let mut map = PhaseMap::new(decoder.info(x).unwrap());
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let report = pool.install(|| {
                    frames.iter().enumerate().for_each(|(i, frame)| decoder.push(i, &frame.view()).unwrap());
                    decoder.finish(x, &mut map.view_mut()).unwrap()
                });
                assert!(report.valid > 1000, "{report:?}");
                let found = (bits(&map), report);
                let expected = expected.get_or_insert_with(|| found.clone());
                assert!(*expected == found, "{level:?} with {threads} threads");
            }
        }
    }
}
