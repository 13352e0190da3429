//! Files of corrections.

use super::*;

fn correction() -> PatternCorrection {
    PatternCorrection {
        projector: Some("proj1".into()),
        source: TableSource::InversePolynomial,
        gamma: Some(2.2),
        coefficients: Some(vec![1e-17, -3.25, 0.1 + 0.2]),
        table: LevelTable::sample(256, |x| fringe::math::pow(x, 1.0 / 2.2)).unwrap(),
        provenance: toml::Table::from_iter([("software".to_owned(), "test \"1\"".into())]),
    }
}

#[test]
fn a_correction_comes_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.toml");
    write_correction(&path, &correction()).unwrap();
    assert_eq!(read_correction(&path).unwrap(), correction());
}

#[test]
fn what_is_no_correction_is_refused_with_file_key_and_remedy() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.toml");
    let head = format!("format = \"{CORRECTION_FORMAT}\"\nsource = \"response\"\n");
    let cases = [
        ("table = [0.0, 0.5, 0.4]\n", "table: a level table needs"),
        ("table = [0.0, 7.5]\n", "value 1 is 7.5"),
        ("table = [0.0, nan]\n", "value 1 is NaN"),
        ("table = [0.0]\n", "it has 1"),
        ("table = [0.0, 1.0]\ntabel = 3\n", "tabel"),
        ("", "table"),
    ];
    for (rest, expected) in cases {
        std::fs::write(&path, format!("{head}{rest}")).unwrap();
        let error = read_correction(&path).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("c.toml") && !error.contains('\n'), "{error}");
    }
    std::fs::write(&path, "format = \"fringecell-rig/1\"\n").unwrap();
    assert!(read_correction(&path).unwrap_err().to_string().contains("expected"));
}
