//! STEP files of OpenCascade (tests/step, benches/step_samples.py) against its own volumes, and files that are damaged.

use super::*;
use metrology::inspection::Geometry;

fn sample(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/step").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn read(name: &str, chord_mm: Option<f64>) -> StepPart {
    part_of(Path::new(name), sample(name).as_bytes(), chord_mm).unwrap_or_else(|error| panic!("{error}"))
}

/// The message for a text that must not be read.
fn refused_text(text: &str) -> String {
    let error = part_of(Path::new("a.step"), text.as_bytes(), Some(0.05)).expect_err("read").to_string();
    assert!(error.starts_with("a.step:") && !error.contains('\n') && error.contains("; "), "{error}");
    error
}

fn kinds(part: &StepPart) -> Vec<&'static str> {
    let mut kinds: Vec<_> = part.features().iter().map(|f| f.geometry.kind()).collect();
    kinds.sort_unstable();
    kinds
}

/// Volumes and areas by OpenCascade's integration, as benches/step_samples.py printed them.
#[test]
fn volumes_and_areas_are_those_of_another_kernel_within_the_distance() {
    for (name, solids, volume, area) in [
        ("plate.step", 1, 55_563.563_611_054, 14_317.966_253_866),
        ("turned.step", 1, 32_904.680_144_675, 6_244.701_686_874),
        ("inches.step", 3, 8_997.930_123_067, 4_561.794_958_195),
    ] {
        for chord_mm in [0.1, 0.005] {
            let part = read(name, Some(chord_mm));
            assert_eq!(part.solids.len(), solids, "{name}");
            let off = part.volume_mm3() - volume;
            assert!(off.abs() < area * chord_mm, "{name}, {chord_mm} mm: off by {off} mm³");
            let found: f64 = part.features().iter().map(|f| f.area_mm2).sum();
            assert!((found - area).abs() < 0.01 * area * (1.0 + 10.0 * chord_mm), "{name}: {found} mm²");
        }
        assert!((0.0005..=0.02).contains(&read(name, None).chord_mm));
    }
}

#[test]
fn elements_have_the_sizes_places_and_sides_of_the_part() {
    let part = read("plate.step", None);
    let bores: Vec<_> = part
        .features()
        .into_iter()
        .filter_map(|f| match f.geometry {
            Geometry::Cylinder { point_mm, radius_mm, internal: true, half_length_mm, .. } => {
                Some((radius_mm, point_mm.x, point_mm.y, 2.0 * half_length_mm))
            }
            _ => None,
        })
        .collect();
    let near = |wanted: (f64, f64, f64, f64)| {
        let close = |b: &(f64, f64, f64, f64)| {
            [b.0 - wanted.0, b.1 - wanted.1, b.2 - wanted.2, b.3 - wanted.3].iter().all(|d| d.abs() < 1e-6)
        };
        assert!(bores.iter().any(close), "{wanted:?} is not among {bores:?}");
    };
    assert_eq!(bores.len(), 3, "{bores:?}");
    near((6.0, -25.0, -15.0, 12.0));
    near((6.0, 25.0, 15.0, 12.0));
    near((4.0, 25.0, -15.0, 8.0));
    let cone = part.features().into_iter().find(|f| f.geometry.kind() == "cone").unwrap();
    let Geometry::Cone { half_angle_rad, internal, axis, .. } = cone.geometry else { panic!() };
    assert!((half_angle_rad.to_degrees() - 45.0).abs() < 1e-9 && internal && axis.z > 0.99);
    let turned = read("turned.step", None);
    assert_eq!(kinds(&turned).iter().filter(|k| **k == "cylinder").count(), 3);
    for kind in ["cone", "sphere", "torus"] {
        assert!(kinds(&turned).contains(&kind), "{kind}");
    }
}

/// The pins stand where the assembly places them, one upside down, in inches.
#[test]
fn assemblies_are_placed_in_millimetres() {
    let part = read("inches.step", None);
    let mut pins: Vec<(f64, f64)> = part
        .features()
        .iter()
        .filter_map(|f| match &f.geometry {
            Geometry::Cylinder { point_mm, internal: false, radius_mm, .. } => {
                assert!((radius_mm - 3.175).abs() < 1e-9);
                Some((point_mm.x, point_mm.z))
            }
            _ => None,
        })
        .collect();
    pins.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = [(-12.7, 6.35 + 9.525), (12.7, 31.75 - 9.525)];
    assert_eq!(pins.len(), 2);
    for (pin, wanted) in pins.iter().zip(wanted) {
        assert!((pin.0 - wanted.0).abs() < 1e-6 && (pin.1 - wanted.1).abs() < 1e-6, "{pins:?}");
    }
}

/// The text with one entity changed: the first one that has a piece of text.
fn changed(name: &str, from: &str, to: &str) -> String {
    let text = sample(name);
    assert!(text.contains(from), "{name} has no {from}");
    text.replacen(from, to, 1)
}

#[test]
fn damaged_and_foreign_files_are_refused_with_entity_and_remedy() {
    let turned = sample("turned.step");
    let cut = &turned[..turned.len() / 2];
    let no_solid = turned.replace("MANIFOLD_SOLID_BREP", "SHELL_BASED_SURFACE_MODEL");
    let faceted = turned.replace("MANIFOLD_SOLID_BREP", "FACETED_BREP");
    let missing = changed("turned.step", "CLOSED_SHELL('',(#", "CLOSED_SHELL('',(#9999999,#");
    let unitless = turned.replace("GLOBAL_UNIT_ASSIGNED_CONTEXT", "GLOBAL_UNKNOWN_CONTEXT");
    let huge = turned.replace("(15.,0.,", "(1.E300,0.,");
    assert_ne!(huge, turned);
    for (text, words) in [
        ("solid part\n facet normal 0 0 1\n", "does not begin with ISO-10303-21"),
        ("\u{0}\u{1}\u{2}ISO-10303-21;", "does not begin with ISO-10303-21"),
        ("ISO-10303-21;HEADER;ENDSEC;DATA;ENDSEC;END-ISO-10303-21;", "has no solid (MANIFOLD_SOLID_BREP)"),
        (cut, "is no readable STEP file"),
        (&no_solid, "(SHELL_BASED_SURFACE_MODEL) is not read"),
        (&faceted, "(FACETED_BREP) is not read"),
        (&missing, "#9999999 (absent)"),
        (&unitless, "states no unit of length"),
        (&sample("loft.step"), "B_SPLINE_SURFACE"),
        (&huge, "beyond ±1e6 mm"),
    ] {
        let error = refused_text(text);
        assert!(error.contains(words), "{words}: {error}");
    }
}

/// CAD systems name a solid again for its properties: it is still one.
#[test]
fn a_solid_that_two_representations_name_is_one() {
    let text = sample("turned.step");
    let context =
        text.split("ADVANCED_BREP_SHAPE_REPRESENTATION").nth(1).unwrap().split(");").next().unwrap();
    let context = context.rsplit('#').next().unwrap();
    let again = format!("#9000 = SHAPE_REPRESENTATION('',(#15),#{context});\nENDSEC;\nEND-ISO");
    let text = text.replace("ENDSEC;\nEND-ISO", &again);
    assert!(text.contains("#15 = MANIFOLD_SOLID_BREP") && text.contains("#9000 ="));
    let part = part_of(Path::new("a.step"), text.as_bytes(), Some(0.1)).unwrap();
    assert_eq!(part.solids.len(), 1);
}

/// Every reference turned into each of some others: circles, wrong types, absent entities. Nothing panics or hangs.
#[test]
fn wrong_references_end_in_a_message_or_in_the_same_solid() {
    let text = sample("turned.step");
    let places: Vec<usize> = text.match_indices('#').map(|(at, _)| at).collect();
    let mut refused = 0;
    for (round, at) in places.iter().enumerate().step_by(17) {
        let end = at + 1 + text[at + 1..].find(|c: char| !c.is_ascii_digit()).unwrap();
        let other = ["#1", "#99999", "#31", &text[places[round / 2]..][..3]][round % 4];
        let damaged = format!("{}{other}{}", &text[..*at], &text[end..]);
        if let Err(error) = part_of(Path::new("a.step"), damaged.as_bytes(), Some(0.2)) {
            let error = error.to_string();
            assert!(!error.contains('\n') && error.contains("a.step"), "{error}");
            refused += 1;
        }
    }
    assert!(refused > places.len() / 17 / 4, "{refused}");
}

#[test]
fn names_lose_what_does_not_print_and_distances_have_limits() {
    let text = changed("turned.step", "ADVANCED_FACE('',", "ADVANCED_FACE('a\u{7}b\u{202e}c',");
    let part = part_of(Path::new("a.step"), text.as_bytes(), Some(0.1)).unwrap();
    assert_eq!(part.features().iter().find_map(|f| f.names.first().cloned()), Some("abc".into()));
    for chord in [0.0, -1.0, f64::NAN, 11.0] {
        let error = part_of(Path::new("a.step"), text.as_bytes(), Some(chord)).unwrap_err().to_string();
        assert!(error.contains("--chord-mm"), "{error}");
    }
}
