//! `fringetool focus` on images of a checkerboard with known blur.

use crate::support::fringetool;
use serde_json::Value;
use std::path::Path;

/// A checkerboard of 10 px squares under a Gaussian blur, made by a separable convolution.
fn board(path: &Path, sigma: f64) {
    let size = 128_usize;
    let square = |i: i64| if (i + 1000).div_euclid(10) % 2 == 0 { 1.0 } else { -1.0 };
    let weights: Vec<f64> = (-30..=30).map(|k| (-0.5 * (f64::from(k) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let line: Vec<f64> = (0..size as i64)
        .map(|i| weights.iter().zip(-30..=30).map(|(w, k)| w * square(i + k)).sum::<f64>() / sum)
        .collect();
    let value = |x: u32, y: u32| (120.0 + 100.0 * line[x as usize] * line[y as usize]).round() as u8;
    image::GrayImage::from_fn(size as u32, size as u32, |x, y| image::Luma([value(x, y)]))
        .save(path)
        .unwrap();
}

/// Eleven pictures from 460 mm to 560 mm: sharpest (0.8 px) at 512 mm; the blur grows by 0.08 px/mm.
pub fn stack(folder: &Path) {
    for i in 0..11 {
        let defocus = 0.08 * (460.0 + 10.0 * f64::from(i) - 512.0);
        board(&folder.join(format!("focus{}.png", 460 + 10 * i)), (0.64 + defocus * defocus).sqrt());
    }
}

#[test]
fn a_stack_of_pictures_tells_best_focus_and_depth() {
    let dir = tempfile::tempdir().unwrap();
    stack(dir.path());
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (images, json, html) = (path("focus*.png"), path("f.json"), path("f.html"));
    let base = ["focus", "--images", &images, "--json", &json, "--report", &html, "--positions"];
    let run = |positions: &str, more: &[&str]| fringetool(&[&base, &[positions][..], more].concat());
    println!("{}", run("460:560:10", &[]).expect_success().stdout);
    let result: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let number = |key: &str| result[key].as_f64().unwrap_or_else(|| panic!("{key} in {result}"));
    assert!((number("best_focus_mm") - 512.0).abs() < 0.5, "{result}");
    // exp(−2π²f²σ²) with f² = ½/10² falls to one half at σ = 10 √(ln 2)/π px of defocus.
    let expected = 2.0 * 10.0 * std::f64::consts::LN_2.sqrt() / std::f64::consts::PI / 0.08;
    assert!((number("depth_of_focus_mm") / expected - 1.0).abs() < 0.02, "{result} {expected}");
    assert_eq!(result["curve"].as_array().unwrap().len(), 11);
    assert!(std::fs::read_to_string(&html).unwrap().contains("best focus"));
    let cases = [
        ("460:550:10", &[][..], "11 images, but --positions: 10"),
        ("460:560:10", &["--fraction", "1.5"], "fraction 1.5"),
        ("460:560:10", &["--roi", "100,100,64,64"], "is not within the frame"),
        ("1,1,1,1,1,1,1,1,1,1,1", &[], "1 different positions"),
        ("far", &[], "\"far\" is not a number"),
    ];
    for (positions, more, expected) in cases {
        let ran = run(positions, more);
        assert_eq!(ran.code, Some(2), "{expected}: {}", ran.stdout);
        assert!(
            ran.stderr.contains(expected) && ran.stderr.trim_end().lines().count() == 1,
            "{}",
            ran.stderr
        );
    }
}
