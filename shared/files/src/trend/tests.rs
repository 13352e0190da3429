//! A chain holds, and shows where it was broken.

use super::*;
use std::fs;

fn entry(day: u32, statistic: f64) -> TrendEntry {
    let pair = |name: &str, statistic: f64| TrendPair {
        name: name.into(),
        used: 7000,
        mean_px: -0.1 / 3.0,
        rms_px: 0.017,
        drift_px: 0.0006,
        statistic,
        limit: 22.5,
        healthy: statistic <= 22.5,
    };
    TrendEntry {
        format: TREND_FORMAT.into(),
        date: format!("2026-01-{day:02}T08:00:00Z"),
        rig_sha256: "ab".into(),
        recording_sha256: "cd".into(),
        healthy: statistic <= 22.5,
        pairs: vec![pair("pair1", statistic), pair("cam1 <proj1>", 2.0)],
    }
}

fn written(seal: &Seal) -> (tempfile::TempDir, std::path::PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("trend.txt");
    for (day, statistic) in [(1, 3.0), (2, 5.0), (3, 400.0)] {
        append_trend(&path, seal, entry(day, statistic)).unwrap();
    }
    (dir, path)
}

#[test]
fn what_was_appended_comes_back_in_order() {
    for seal in [Seal::Chain, Seal::Key(vec![7; 32])] {
        let (_dir, path) = written(&seal);
        let trend = read_trend(&path, &seal).unwrap();
        assert_eq!(trend.entries, [entry(1, 3.0), entry(2, 5.0), entry(3, 400.0)]);
        assert!(fs::read_to_string(&path).unwrap().trim_end().ends_with(&trend.last_seal));
    }
    assert!(read_trend(Path::new("absent/trend"), &Seal::Chain).unwrap().entries.is_empty());
}

#[test]
fn each_change_shows_at_its_line_and_nothing_is_appended() {
    let (_dir, path) = written(&Seal::Chain);
    let text = fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let joined = |lines: &[&str]| lines.join("\n") + "\n";
    for (broken, expected) in [
        (text.replacen("400.0", "4.0", 1), "trend.txt:3: the seal does not fit this line"),
        (text.replacen("2026-01-01", "2026-01-09", 1), "trend.txt:1: the seal does not fit this line"),
        (joined(&[lines[0], lines[2]]), "trend.txt:2: the seal does not fit this line"),
        (joined(&[lines[1], lines[0], lines[2]]), "trend.txt:1: "),
        (joined(&[lines[0], lines[0], lines[1]]), "trend.txt:2: "),
        (text.trim_end().to_owned(), "trend.txt:3: ends in the middle of a line"),
        (text.replace('\t', " "), "trend.txt:1: has no seal"),
        (text.replace("sha256:", "md5:"), "this line is sealed by md5"),
    ] {
        fs::write(&path, &broken).unwrap();
        let error = append_trend(&path, &Seal::Chain, entry(4, 1.0)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
        assert_eq!(fs::read_to_string(&path).unwrap(), broken);
    }
}

/// Whoever has no key can make a chain, but not one that the key's holder takes.
#[test]
fn only_the_key_makes_a_seal() {
    let key = Seal::Key(b"0123456789abcdef".to_vec());
    let (_dir, path) = written(&key);
    let other = Seal::Key(b"0123456789abcdeg".to_vec());
    assert!(read_trend(&path, &other).unwrap_err().to_string().contains("the key is another one"));
    assert!(read_trend(&path, &Seal::Chain).unwrap_err().to_string().contains("give --key"));
    let (_dir, forged) = written(&Seal::Chain);
    assert!(read_trend(&forged, &key).unwrap_err().to_string().contains("sealed by sha256"));
    let short = forged.with_file_name("key");
    fs::write(&short, "secret").unwrap();
    assert!(Seal::read_key(&short).unwrap_err().to_string().contains("at least 16 bytes"));
}
