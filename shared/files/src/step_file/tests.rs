//! STEP files of OpenCascade (tests/step, benches/step_samples.py) against its own volumes, and files that are damaged.

use super::*;
use metrology::inspection::Geometry;
use std::fmt::Write as _;

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
        ("loft.step", 1, 9_114.665_642_623, 2_638.397_187_526),
        ("swept.step", 1, 22_148.805_112_772, 7_737.602_552_829),
    ] {
        for chord_mm in [0.1, 0.005] {
            let part = read(name, Some(chord_mm));
            assert_eq!(part.solids.len(), solids, "{name}");
            let off = part.volume_mm3() - volume;
            assert!(off.abs() < area * chord_mm, "{name}, {chord_mm} mm: off by {off} mm³");
            let free = part.solids.iter().flat_map(|s| &s.free_faces).map(|f| f.area_mm2).sum::<f64>();
            let found = free + part.features().iter().map(|f| f.area_mm2).sum::<f64>();
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

/// The loft with a rational surface, whose first weight is given.
fn weighted(weight: &str) -> String {
    let row = format!("({weight},1.),");
    let text = sample("loft.step");
    let at = text.find("#137 = ").unwrap();
    let end = at + text[at..].find(';').unwrap();
    let poles = text[at..end].split("1,(").nth(1).unwrap().split(",.UNSPECIFIED.").next().unwrap();
    let rational = format!(
        "#137 = ( BOUNDED_SURFACE() B_SPLINE_SURFACE(6,1,({poles},.UNSPECIFIED.,.F.,.F.,.F.) \
         B_SPLINE_SURFACE_WITH_KNOTS((7,7),(2,2),(10.,20.),(0.,1.),.UNSPECIFIED.) GEOMETRIC_REPRESENTATION_ITEM() \
         RATIONAL_B_SPLINE_SURFACE(({row}(1.,1.),(1.,1.),(1.,1.),(1.,1.),(1.,1.),(1.,1.))) REPRESENTATION_ITEM('') SURFACE())"
    );
    format!("{}{rational}{}", &text[..at], &text[end..])
}

/// Surfaces of two parameters whose numbers do not fit are refused with what is there and what is needed.
#[test]
fn numbers_of_splines_that_do_not_fit_are_refused_with_value_and_limit() {
    let head = "#51 = B_SPLINE_SURFACE_WITH_KNOTS('',8,1,(";
    let around = changed(
        "swept.step",
        "#458 = SURFACE_OF_REVOLUTION('',#459",
        "#458 = OFFSET_SURFACE('',#458,1.,.F.);\n#9458 = SURFACE_OF_REVOLUTION('',#459",
    );
    for (text, words) in [
        (
            changed("loft.step", "(7,7),(2,2),(10.,20.)", "(7,6),(2,2),(10.,20.)"),
            "its knots count 13 times in all, 7 control points of degree 6 need 14",
        ),
        (
            changed("loft.step", "(7,7),(2,2),(10.,20.)", "(7,7),(2,2),(20.,10.)"),
            "knot 10 stands after knot 20",
        ),
        (changed("loft.step", "(7,7),(2,2),(10.,20.)", "(7,7),(2,2),(10.,10.)"), "nothing is between"),
        (changed("loft.step", "(7,7),(2,2),(10.,20.)", "(7,7.5),(2,2),(10.,20.)"), "counts 7.5 times"),
        (
            changed("loft.step", "(7,7),(2,2),(10.,20.)", "(7,7),(2),(10.,20.)"),
            "1 multiplicities for 2 knots",
        ),
        (
            changed("loft.step", head, "#51 = B_SPLINE_SURFACE_WITH_KNOTS('',80,1,("),
            "has degree 80, must be a whole number of 1 … 25",
        ),
        (changed("loft.step", "(#52,#53)", "(#52,#53,#53)"), "a row has 2 control points, the first one 3"),
        (changed("loft.step", "(#52,#53)", "(#52,#51)"), "where a CARTESIAN_POINT is needed"),
        (weighted("0."), "weight 1 is 0, must be above 0"),
        (weighted("-2."), "weight 1 is -2, must be above 0"),
        (around, "it is made of itself"),
        (
            changed(
                "swept.step",
                "#459 = B_SPLINE_CURVE",
                "#459 = TRIMMED_CURVE('',#459,(),(),.T.,.PARAMETER.);\n#9459 = B_SPLINE_CURVE",
            ),
            "it is made of itself",
        ),
        (
            changed("swept.step", "#568 = ELLIPSE('',#569,7.,4.)", "#568 = ELLIPSE('',#569,7.,-4.)"),
            "has a radius of -4 mm",
        ),
        (
            changed("swept.step", "#568 = ELLIPSE('',#569,7.,4.)", "#568 = CLOTHOID('',#569,7.,4.)"),
            "#568 (CLOTHOID) is not read",
        ),
    ] {
        let error = refused_text(&text);
        assert!(error.contains(words), "{words}: {error}");
    }
    // The same weights, but above 0, are taken.
    let part = part_of(Path::new("a.step"), weighted("1.").as_bytes(), Some(0.05)).unwrap();
    assert!((part.volume_mm3() - 9_114.67).abs() < 50.0);
}

/// Faces within surfaces that others trim, and surfaces beside elements, are what they stand for.
#[test]
fn surfaces_that_name_others_are_these() {
    let plain = read("turned.step", Some(0.02));
    let text = sample("turned.step");
    let id = text.split(" = CYLINDRICAL_SURFACE(").next().unwrap().rsplit('#').next().unwrap().to_owned();
    let of = |kind: &str| {
        let head = format!("#{id} = CYLINDRICAL_SURFACE(");
        assert!(text.contains(&head));
        text.replacen(&head, &format!("#{id} = {kind};\n#9000 = CYLINDRICAL_SURFACE("), 1)
    };
    for kind in [
        "RECTANGULAR_TRIMMED_SURFACE('',#9000,0.,6.,0.,9.,.T.,.T.)",
        "CURVE_BOUNDED_SURFACE('',#9000,(),.T.)",
        "OFFSET_SURFACE('',#9000,0.,.F.)",
    ] {
        let part = part_of(Path::new("a.step"), of(kind).as_bytes(), Some(0.02))
            .unwrap_or_else(|e| panic!("{kind}: {e}"));
        assert_eq!(part.volume_mm3(), plain.volume_mm3(), "{kind}");
    }
    // One sense turned: the other side of the surface, so that the solid does not close.
    let turned = of("RECTANGULAR_TRIMMED_SURFACE('',#9000,0.,6.,0.,9.,.T.,.F.)");
    assert!(refused_text(&turned).contains("face #"));
    let nothing = of("OFFSET_SURFACE('',#9000,-100.,.F.)");
    assert!(refused_text(&nothing).contains("nothing is left of #9000"));
}

/// A chain of surfaces, and a file of very many entities, end in bounded time: a message or the part.
#[test]
fn long_chains_and_many_entities_are_bounded() {
    let mut chain = String::new();
    for k in 0..20_000 {
        let _ = writeln!(chain, "#{} = OFFSET_SURFACE('',#{},0.,.F.);", 100_000 + k, 100_001 + k);
    }
    let text = changed(
        "swept.step",
        "#458 = SURFACE_OF_REVOLUTION(",
        &format!("#458 = OFFSET_SURFACE('',#100000,0.,.F.);\n{chain}#99999 = SURFACE_OF_REVOLUTION("),
    );
    assert!(refused_text(&text).contains("lies in more than 8 others"));
    let mut many = String::new();
    for k in 0..100_000 {
        let _ = writeln!(many, "#{} = CARTESIAN_POINT('',({k}.,0.,0.));", 1_000_000 + k);
    }
    let text = sample("turned.step").replace("ENDSEC;\nEND-ISO", &format!("{many}ENDSEC;\nEND-ISO"));
    assert!(part_of(Path::new("a.step"), text.as_bytes(), Some(0.1)).is_ok());
}

/// A part that an assembly places twice has each face twice: the same numbers, distinguished by the place.
#[test]
fn elements_of_one_solid_in_several_places_are_counted() {
    let part = read("inches.step", Some(0.05));
    let counted: Vec<Option<usize>> =
        part.solids.iter().filter_map(|s| s.features.first()).map(|f| f.instance).collect();
    assert_eq!(counted.iter().filter(|c| c.is_none()).count(), 1, "{counted:?}");
    let pins: Vec<_> = part.solids.iter().filter(|s| s.features[0].instance.is_some()).collect();
    assert_eq!(pins.len(), 2);
    for (one, two) in pins[0].features.iter().zip(&pins[1].features) {
        assert_eq!((&one.faces, one.instance, two.instance), (&two.faces, Some(1), Some(2)));
    }
}
