//! `fringetool gamma`: the twin's projector is measured, corrected and measured again; a real projector too.

use crate::support::{Small, fringetool, real_data};
use fringe::math::pow;
use serde_json::Value;
use std::path::Path;

/// A small recording of a plate: 32 grey levels, fringes of 64 px in 60 steps.
fn simulate(small: &Small, name: &str, more: &[&str]) -> String {
    let (cell, out) = (small.path("cell.toml"), small.path(name));
    let mut arguments =
        vec!["simulate", &cell, "--scene", "configs/plane.scene.toml", "--grey-levels", "32", "--out", &out];
    arguments.extend(["--projector-gamma", "2.2"]);
    arguments.extend(more);
    fringetool(&arguments).expect_success();
    out
}

fn coarse_fringes() -> Small {
    let small = Small::new();
    small.edit("cell.toml", "period_px = 16.0", "period_px = 64.0");
    small.edit("cell.toml", "stripe_px = 8.0", "stripe_px = 32.0");
    small
}

fn measured(small: &Small, recording: &str, more: &[&str]) -> Value {
    let json = small.path("gamma.json");
    let mut arguments = vec!["gamma", recording, "--json", &json];
    arguments.extend(more);
    println!("{}", fringetool(&arguments).expect_success().stdout);
    serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap()
}

fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} in {value}"))
}

/// What the measuring side makes of grey frames, drawn again, takes harmonics and phase error out of recorded fringes.
#[test]
fn a_measured_correction_makes_the_projected_fringes_sinusoidal() {
    let small = coarse_fringes();
    let first = simulate(&small, "first", &[]);
    let (response, polynomial, report) = (small.path("r.toml"), small.path("p.toml"), small.path("r.html"));
    let before = measured(&small, &first, &["--out", &response, "--report", &report]);
    assert!((number(&before, "/gamma") - 2.2).abs() < 0.01, "{}", before["gamma"]);
    assert_eq!(before["lut"].as_array().unwrap().len(), 256);
    assert_eq!(before["polynomial"]["coefficients"].as_array().unwrap().len(), 8);
    assert!(std::fs::read_to_string(&report).unwrap().contains("</html>"));
    let rms = |value: &Value| number(value, "/recorded/phase_error/rms_rad");
    assert!((0.15..0.25).contains(&rms(&before)), "{}", rms(&before));
    // Camera and lens blur damps the harmonics a little; the prediction is for the light itself.
    let ratio = number(&before, "/recorded/harmonics/0") / number(&before, "/before/harmonics/0");
    assert!((0.8..1.0).contains(&ratio), "{ratio}");

    let second = simulate(&small, "second", &["--pattern-correction", &response]);
    let after = measured(&small, &second, &[]);
    assert!(rms(&after) < 0.005, "{}", rms(&after));
    for order in 0..4 {
        let left = number(&after, &format!("/recorded/harmonics/{order}"));
        assert!(left < 0.003, "order {}: {left}", order + 2);
    }
    assert!((number(&after, "/gamma") - 1.0).abs() < 0.02);
    assert_eq!(after["corrected"], true);

    // The thesis' polynomial leaves more, as predicted.
    measured(&small, &first, &["--table", "polynomial", "--out", &polynomial]);
    let third = simulate(&small, "third", &["--pattern-correction", &polynomial]);
    let thesis = measured(&small, &third, &[]);
    assert!(rms(&thesis) < 0.03 && rms(&thesis) > rms(&after), "{} {}", rms(&thesis), rms(&after));

    // A correction of a correction would not be one of the projector.
    let refused = fringetool(&["gamma", &second, "--out", &small.path("x.toml")]);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    assert!(!Path::new(&small.path("x.toml")).exists());
}

/// Grey images of a response, as another program may have saved them.
fn pictures(folder: &Path, name: impl Fn(usize) -> String, values: &[u8]) {
    for (index, value) in values.iter().enumerate() {
        let frame = image::GrayImage::from_pixel(60, 40, image::Luma([*value]));
        frame.save(folder.join(name(index))).unwrap();
    }
}

#[test]
fn pictures_with_levels_are_read_in_the_order_of_their_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let value = |i: usize| (10.0 + 240.0 * pow(i as f64 / 51.0, 1.8)).round() as u8;
    let values: Vec<u8> = (0..52).map(value).collect();
    pictures(dir.path(), |i| format!("grey{}.png", 5 * i), &values);
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (pattern, json) = (path("grey*.png"), path("r.json"));
    fringetool(&["gamma", "--images", &pattern, "--levels", "0:255:5", "--json", &json]).expect_success();
    let result: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    // Rounding to whole grey values without noise is all the error there is.
    assert!((number(&result, "/gamma") - 1.8).abs() < 0.01, "{}", result["gamma"]);
    let fractions = "0:1:0.0196078431372549";
    fringetool(&["gamma", "--images", &pattern, "--levels", fractions, "--json", &json]).expect_success();
    let same: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert!((number(&same, "/gamma") - number(&result, "/gamma")).abs() < 1e-9);
}

#[test]
fn what_tells_no_response_is_refused_with_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let folder = |name: &str, values: &[u8]| {
        let folder = dir.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        pictures(&folder, |i| format!("{i}.png"), values);
        folder.join("*.png").to_str().unwrap().to_owned()
    };
    let rising: Vec<u8> = (0..16).map(|i| 10 + 15 * i).collect();
    let mut shuffled = rising.clone();
    shuffled.swap(3, 12);
    let good = folder("good", &rising);
    let cases = [
        (good.clone(), "0:225:15", "65,0,10,10", "is not within the frame"),
        (good.clone(), "0:240:15", "0,0,10,10", "16 images, but --levels: 17"),
        (good.clone(), "0:3825:255", "0,0,10,10", "add --bits"),
        (folder("few", &rising[..8]), "0:105:15", "0,0,10,10", "at least 9 needed"),
        (folder("even", &[90; 16]), "0:225:15", "0,0,10,10", "needed; check that the region"),
        (folder("full", &[255; 16]), "0:225:15", "0,0,10,10", "saturate"),
        (folder("shuffled", &shuffled), "0:225:15", "0,0,10,10", "not monotonic"),
        (dir.path().join("none*").to_str().unwrap().into(), "0:225:15", "0,0,1,1", "no file matches"),
    ];
    for (images, levels, roi, expected) in cases {
        let out = dir.path().join("c.toml");
        let out = out.to_str().unwrap();
        let ran = fringetool(&["gamma", "--images", &images, "--levels", levels, "--roi", roi, "--out", out]);
        assert_eq!(ran.code, Some(2), "{expected}: {}", ran.stdout);
        assert!(
            ran.stderr.contains(expected) && ran.stderr.trim_end().lines().count() == 1,
            "{}",
            ran.stderr
        );
        assert!(!Path::new(out).exists());
    }
    let without = fringetool(&["gamma", "--images", &good]);
    assert!(without.code == Some(2) && without.stderr.contains("--levels"), "{}", without.stderr);
    let small = Small::new();
    small.edit("rec/recording.toml", "{ set = \"black\" }", "{ set = \"random\", frames = 1 }");
    let no_grey = fringetool(&["gamma", &small.path("rec")]);
    assert!(no_grey.code == Some(2) && no_grey.stderr.contains("shows no grey levels"), "{}", no_grey.stderr);
}

/// A recording made of the real frames `numbers` of fringes, with white and black.
fn real_recording(source: &Path, folder: &Path, axis: &str, numbers: [usize; 3]) {
    let frames = folder.join("frames/proj1/cam1");
    std::fs::create_dir_all(&frames).unwrap();
    for (index, number) in numbers.into_iter().chain([52, 53]).enumerate() {
        let from = source.join(format!("pat{number:02}.png"));
        std::fs::copy(from, frames.join(format!("{index:03}.png"))).unwrap();
    }
    let text = format!(
        "format = \"fringecell-recording/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 1920\nheight_px = 1080\n\
         cameras = [\"cam1\"]\nsequence = [{{ set = \"sine\", axis = \"{axis}\", period_px = 240.0, steps = 3, \
         direction = \"-\" }}, {{ set = \"white\" }}, {{ set = \"black\" }}]\n"
    );
    std::fs::write(folder.join("recording.toml"), text).unwrap();
}

/// Inside the board, where a smooth surface is the truth.
const BOARD: [usize; 4] = [300, 300, 1300, 600];

/// Rms of the wrapped phase of three real frames about a smooth surface (a polynomial of order 5 in x and y), rad. The
/// error of a response repeats three times a fringe, 24 times over the board: no such surface follows it.
fn phase_rms_rad(recording: &Path, level: impl Fn(f64) -> f64) -> f64 {
    use std::f64::consts::TAU;
    let frame = |i: usize| {
        let path = recording.join(format!("frames/proj1/cam1/{i:03}.png"));
        image::open(path).unwrap().into_luma8()
    };
    let frames: Vec<_> = (0..5).map(frame).collect();
    let phase = |x: usize, y: usize| {
        let dn = |i: usize| f64::from(frames[i].get_pixel(x as u32, y as u32).0[0]);
        let (mut s, mut c) = (0.0, 0.0);
        for i in 0..3 {
            let value = level((dn(i) - dn(4)) / (dn(3) - dn(4)));
            let shift = TAU * i as f64 / 3.0;
            s -= value * fringe::math::sin(shift);
            c += value * fringe::math::cos(shift);
        }
        fringe::math::atan2(s, c)
    };
    let [x0, y0, width, height] = BOARD;
    let (step, mut rows) = (4, Vec::new());
    let mut corner = phase(x0, y0);
    for y in (y0..y0 + height).step_by(step) {
        corner = phase(x0, y) + TAU * ((corner - phase(x0, y)) / TAU).round();
        let mut last = corner;
        for x in (x0..x0 + width).step_by(step) {
            last = phase(x, y) + TAU * ((last - phase(x, y)) / TAU).round();
            let (u, v) =
                ((x - x0) as f64 / width as f64 * 2.0 - 1.0, (y - y0) as f64 / height as f64 * 2.0 - 1.0);
            let terms = (0..=5).flat_map(|i| (0..=5 - i).map(move |j| u.powi(i) * v.powi(j)));
            rows.push((terms.collect::<Vec<f64>>(), last));
        }
    }
    let design = nalgebra::DMatrix::from_fn(rows.len(), rows[0].0.len(), |r, c| rows[r].0[c]);
    let values = nalgebra::DVector::from_iterator(rows.len(), rows.iter().map(|r| r.1));
    let normal = design.tr_mul(&design).cholesky().expect("independent terms");
    let smooth = &design * normal.solve(&design.tr_mul(&values));
    ((values - smooth).norm_squared() / rows.len() as f64).sqrt()
}

/// A real projector, its fringes drawn with two different encodings along two axes. Its README: 0.194 rad before and
/// 0.0305 rad after a correction for the first encoding, against a code that is not part of the set.
#[test]
#[cfg_attr(not(shared_data), ignore = "../shared/data is absent; with it: cargo test --test main gamma::")]
fn a_real_projector_shows_one_gamma_in_four_sets_and_its_correction_straightens_the_phase() {
    let Some(source) = real_data("gamma") else { return };
    let dir = tempfile::tempdir().unwrap();
    let sets = [
        ("x", [0, 1, 2], 0.75, 0.15),
        ("x", [3, 4, 5], 1.25, 0.05),
        ("y", [6, 7, 8], 0.75, 0.15),
        ("y", [9, 10, 11], 1.25, 0.05),
    ];
    let mut gammas = Vec::new();
    for (index, (axis, numbers, encoded, least)) in sets.into_iter().enumerate() {
        let folder = dir.path().join(format!("set{index}"));
        real_recording(&source, &folder, axis, numbers);
        let json = dir.path().join("r.json");
        let (recording, json) = (folder.to_str().unwrap(), json.to_str().unwrap());
        let (roi, encoded) = (BOARD.map(|v| v.to_string()).join(","), encoded.to_string());
        let arguments = ["gamma", recording, "--encoded-gamma", &encoded, "--roi", &roi, "--json", json];
        fringetool(&arguments).expect_success();
        let result: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        gammas.push(number(&result, "/gamma"));
        let part = |key: &str| number(&result, &format!("/fringes/{key}"));
        let (gamma, gain, offset) = (part("gamma"), part("gain"), part("offset"));
        let before = phase_rms_rad(&folder, |light| light);
        let after = phase_rms_rad(&folder, |light| pow(((light - offset) / gain).max(0.0), 1.0 / gamma));
        println!(
            "axis {axis}, encoded {encoded}: gamma {:.4}, phase rms {before:.4} → {after:.4} rad",
            gammas[index]
        );
        assert!(before > least && after < 0.03, "{before} → {after}");
    }
    let (low, high) = gammas.iter().fold((f64::MAX, 0.0_f64), |(l, h), g| (l.min(*g), h.max(*g)));
    assert!(high - low < 0.05 && low > 1.4 && high < 1.7, "{gammas:?}");
}
