//! Plans and rule sets: what is refused, what is marked.

use super::super::*;
use super::synthetic::*;

#[test]
fn a_plan_that_breaks_rules_is_refused_or_marked() {
    let refused = evaluate(&plan_text("", 2, 120.055_09, ""), &SPHERES[..2], &BARS).unwrap_err().to_string();
    for words in
        ["sphere positions: 2 for sphere, at least 3", "120.055 mm for bar, at least 144.99", "allow_reduced"]
    {
        assert!(refused.contains(words), "{refused}");
    }
    assert!(!refused.contains('\n'));
    let text = plan_text("", 2, 120.055_09, "allow_reduced = true");
    let report = evaluate(&text, &SPHERES[..2], &BARS).unwrap();
    assert_eq!(report.reduced.len(), 2, "{:?}", report.reduced);
    let bar = &report.reduced[1];
    assert!(
        (bar.actual - 120.055_09).abs() < 1e-9 && (bar.required - 2.0 / 3.0 * 217.485_631_709_3).abs() < 1e-6
    );
}

#[test]
fn rule_sets_are_readable_and_tell_what_they_assume() {
    for text in ALL {
        let rules = RuleSet::from_toml(text).unwrap();
        let id = rules.id();
        assert!(id.wording.starts_with("evaluated following ") && id.wording.ends_with(&rules.edition));
        assert!(!text.contains("certified"), "{}", rules.id);
        assert!(!id.assumed.is_empty(), "{}: the standard's text was not at hand", rules.id);
        assert!(rules.rules.iter().all(|rule| rule.status != Status::Verified || !rule.source.is_empty()));
    }
    let broken = PART_3.replace("edition = \"2008-12\"", "edition = \"\"");
    assert!(RuleSet::from_toml(&broken).unwrap_err().to_string().contains("edition"));
    let broken = PART_3.replace("statistic = \"spacing\"", "statistic = \"size\"");
    assert!(RuleSet::from_toml(&broken).unwrap_err().to_string().contains("\"SD\""));
}

#[test]
fn plans_that_cannot_be_meant_are_refused() {
    let good = plan_text("", 3, 150.0, "");
    let cases = [
        (good.replace("name = \"synthetic\"", "nam = \"x\""), "line"),
        (good.replace("fringecell-test/1", "fringecell-test/9"), "this program reads"),
        (good.replace("kind = \"sphere\"", "kind = \"ball-bar\""), "spacings_mm"),
        (good.replace("certificate = \"C1\"", "certificate = \"\""), "certificate"),
        (good.replace("artefact = \"ball\"", "artefact = \"bowl\""), "known: ball, bar"),
        (good.replace("s1v1.ply", "s0v0.ply"), "another view"),
        (good.replace("b1.ply", "./b0.ply"), "another view"),
        (good.replace("b1.ply", "x/..//b0.ply"), "another view"),
        (good.replace("s1\"", "s0\""), "occurs twice"),
        (good.replace("20.0\nu_temperature_k", "nan\nu_temperature_k"), "temperature_c"),
        (good.replace("[limits]\n", "[limits]\nPS = -0.1\n"), "limits, PS"),
        (good.replace("u_spacing_mm = 0.001", "u_spacing_mm = -0.001"), "u_spacing_mm"),
        (
            good.replace(
                "[[position.view]]\nname = \"v0\"\ncloud",
                "[[position.view]]\nname = \"v0\"\nrecording",
            ),
            "[measurement]",
        ),
        (good.replace("reject_fraction = 0.0", "reject_fraction = 0.7"), "reject_fraction"),
    ];
    for (text, words) in cases {
        let error = TestPlan::from_toml(&text).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{words}: {error}");
    }
    let limits = plan_text("PX = 0.1", 3, 150.0, "");
    assert!(evaluate(&limits, &SPHERES, &BARS).unwrap_err().to_string().contains("PF_range"));
}
