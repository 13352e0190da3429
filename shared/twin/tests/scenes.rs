use crate::common::{ARTEFACT, artefact, body, parse, parse_text, points};
use fringe::math::{acos, hypot};
use nalgebra::Point3;
use twin::scene_file::SceneFile;
use twin::{PixelsMut, SceneError, Twin, TwinSettings, thesis};

const SCENES: [(&str, &str); 4] = [
    ("complex-artefact", ARTEFACT),
    ("ball-bar", include_str!("../../../configs/ball-bar.scene.toml")),
    ("ball-beam", include_str!("../../../configs/ball-beam.scene.toml")),
    ("plane", include_str!("../../../configs/plane.scene.toml")),
];

fn load(text: &str) -> twin::Scene {
    parse_text(text, &mut |_| Err("no file in this scene".into())).unwrap()
}

/// Each scene stays in view of all cameras, whatever the scatter of the pose, and both pairs see lit parts of it.
#[test]
fn the_scenes_of_the_project_are_in_view_and_lit() {
    let (width, height) = (281, 188);
    let rig = thesis::rig(width, height);
    for (name, text) in SCENES {
        let settings =
            TwinSettings { position_scatter_mm: 1.0, angle_scatter_deg: 1.0, ..TwinSettings::ideal() };
        let twin = Twin::new(&load(text), settings, &rig).unwrap();
        for cycle in 0..4 {
            for (camera, projector) in
                [("cam1", "proj1"), ("cam2", "proj1"), ("cam3", "proj2"), ("cam4", "proj2")]
            {
                let view = twin.view_lit_by(camera, &[projector], cycle).unwrap();
                let (mut seen, mut lit) = (0, 0);
                for index in 0..(width * height) as usize {
                    let (x, y) = (index as u32 % width, index as u32 / width);
                    let is_lit = view.truth_coordinate(projector, index).unwrap().is_some();
                    lit += u32::from(is_lit);
                    let on_border = x < 2 || y < 2 || x + 2 >= width || y + 2 >= height;
                    let pixel = nalgebra::Point2::new(f64::from(x), f64::from(y));
                    let hit = twin.truth_point(camera, cycle, pixel).unwrap().is_some();
                    assert!(
                        !(on_border && hit),
                        "{name}: {camera} cuts the part at {pixel} in cycle {cycle}"
                    );
                    seen += u32::from(hit);
                }
                assert!(seen > 1500, "{name}: {camera} sees {seen} pixels");
                assert!(f64::from(lit) > 0.6 * f64::from(seen), "{name}: {camera}: {lit} of {seen} are lit");
            }
        }
    }
}

/// Both pairs see each feature of the artefact, with enough pixels to fit it.
#[test]
fn both_pairs_see_every_feature_of_the_artefact() {
    let scene = artefact();
    let rig = thesis::rig(281, 188);
    let twin = Twin::new(&scene, TwinSettings::ideal(), &rig).unwrap();
    let names: Vec<_> = scene.body_names().collect();
    for (cameras, projector) in [(["cam1", "cam2"], "proj1"), (["cam3", "cam4"], "proj2")] {
        for camera in cameras {
            let view = twin.view(camera, 0).unwrap();
            let mut lit = std::collections::BTreeMap::new();
            for index in 0..281 * 188 {
                let pixel = nalgebra::Point2::new((index % 281) as f64, (index / 281) as f64);
                if view.truth_coordinate(projector, index).unwrap().is_some() {
                    let point = twin.truth_point(camera, 0, pixel).unwrap().unwrap();
                    *lit.entry((names[point.body], point.face)).or_insert(0) += 1;
                }
            }
            let features = [
                ("base", 2),
                ("hemisphere", 0),
                ("sphere1", 0),
                ("sphere2", 0),
                ("wedge1", 1),
                ("wedge2", 1),
                ("step", 2),
            ];
            for feature in features {
                let count = lit.get(&feature).copied().unwrap_or(0);
                assert!(
                    count > 60,
                    "{camera}: {feature:?} has {count} lit pixels at a quarter of the resolution"
                );
            }
        }
    }
}

/// The truth of the artefact follows from its geometry, found by asking the surface, not the file.
#[test]
fn the_truth_of_the_artefact_is_its_geometry() {
    let scene = artefact();
    let truth = |name: &str| scene.truth().get(name).unwrap().value;
    let index = |name: &str| scene.body_names().position(|n| n == name).unwrap();
    let surface = |x: f64, y: f64, z: f64| scene.surface_distance(&Point3::new(x, y, z));
    let half = truth("sphere_spacing") / 8.0_f64.sqrt();
    for (name, side) in [("sphere1", -1.0), ("sphere2", 1.0)] {
        let top = surface(side * half, side * half, 60.0);
        assert_eq!(top.body, index(name));
        // The top of a sphere lies above its centre only if the centre is where the spacing puts it.
        assert!(hypot(top.foot_mm.x - side * half, top.foot_mm.y - side * half) < 1e-8);
        assert!((top.foot_mm.z - 28.0 - 0.5 * truth(&format!("{name}_diameter"))).abs() < 1e-9);
    }
    let apex = surface(0.0, 0.0, 60.0).foot_mm;
    let plate = surface(45.0, 5.0, 1.0).foot_mm;
    assert!((apex.z - plate.z - truth("hemisphere_height")).abs() < 1e-12);
    assert!((2.0 * apex.z - truth("hemisphere_diameter")).abs() < 1e-12);
    assert!((surface(0.0, -44.0, 9.0).foot_mm.z - plate.z - truth("step_height")).abs() < 1e-12);
    for (name, at) in [("wedge1", Point3::new(46.0, -38.0, 8.0)), ("wedge2", Point3::new(-38.0, 46.0, 8.0))] {
        let near = scene.surface_distance(&at);
        assert_eq!((near.body, near.face), (index(name), 1));
        let normal = (at - near.foot_mm).normalize();
        let inclination_deg = acos(normal.z).to_degrees();
        assert!((inclination_deg - truth(&format!("{name}_inclination"))).abs() < 1e-9, "{inclination_deg}");
        let falls_along = if name == "wedge1" { normal.x } else { normal.y };
        assert!(falls_along > 0.7);
    }
}

#[test]
fn bars_and_beams_have_their_spheres_where_they_say() {
    for (text, spacing_mm) in [(SCENES[1].1, 200.103_80), (SCENES[2].1, 120.055_09)] {
        let scene = load(text);
        let names: Vec<String> = scene.body_names().map(Into::into).collect();
        let centre = |suffix: &str| {
            let (index, radius_mm) = (
                names.iter().position(|n| n.ends_with(suffix)).unwrap(),
                0.5 * scene.truth().get(&format!("{suffix}_diameter")).unwrap().value,
            );
            // The normal at any point of a sphere leads back to its centre.
            let far = Point3::new(0.0, 0.0, 500.0);
            let hit = points(1, 100_000, [0.0, 0.0, 15.0], 120.0)
                .iter()
                .filter_map(|p| scene.first_hit(&far, &(p - far).normalize()))
                .find(|hit| hit.body == index)
                .unwrap();
            hit.point_mm - hit.normal * radius_mm
        };
        let measured = (centre("sphere1") - centre("sphere2")).norm();
        assert!((measured - spacing_mm).abs() < 1e-9, "{measured}");
        assert!((scene.truth().get("sphere_spacing").unwrap().value - spacing_mm).abs() < 1e-12);
    }
}

#[test]
fn a_scene_file_survives_being_written() {
    for (name, text) in SCENES {
        let file: SceneFile = toml::from_str(text).unwrap();
        let again: SceneFile = toml::from_str(&toml::to_string(&file).unwrap()).unwrap();
        assert_eq!(file, again, "{name}");
    }
}

#[test]
fn every_fault_of_a_scene_file_is_named() {
    let ball = |geometry: &str| parse(&body("a", [0.0; 3], geometry)).unwrap_err();
    for (geometry, message) in [
        (
            r#"{ shape = "sphere", diameter_mm = 0.0 }"#,
            "[[body]] \"a\": diameter_mm = 0 must be larger than 0 and at most 100000",
        ),
        (
            r#"{ shape = "sphere", diameter_mm = nan }"#,
            "[[body]] \"a\": diameter_mm = NaN must be larger than 0 and at most 100000",
        ),
        (
            r#"{ shape = "box", size_mm = [1.0, -2.0, 3.0] }"#,
            "[[body]] \"a\": size_mm = -2 must be larger than 0 and at most 100000",
        ),
        (
            r#"{ shape = "wedge", footprint_mm = [10.0, 10.0], height_mm = 12.0, inclination_deg = 45.0 }"#,
            "[[body]] \"a\": height_mm = 12 must be below 10.000 so that the slope ends within the footprint",
        ),
        (
            r#"{ shape = "ball-beam", diameters_mm = [5.0, 5.0], offsets_mm = [1.0], rod_diameter_mm = 1.0, rod_length_mm = 9.0, drop_mm = 0.0 }"#,
            "[[body]] \"a\": 2 diameters_mm but 1 offsets_mm; give one offset per sphere",
        ),
        (
            r#"{ shape = "mesh", file = "gone.stl" }"#,
            "[[body]] \"a\": file = \"gone.stl\": no file in this test",
        ),
    ] {
        assert_eq!(ball(geometry), message);
    }
    assert!(ball(r#"{ shape = "sphere", diameter = 3.0 }"#).contains("unknown field `diameter`"));
    assert!(ball(r#"{ shape = "cube" }"#).contains("unknown variant `cube`"));
    let sphere = r#"{ shape = "sphere", diameter_mm = 2.0 }"#;
    let twice = body("a", [0.0; 3], sphere) + &body("a", [9.0, 0.0, 0.0], sphere);
    assert_eq!(
        parse(&twice).unwrap_err(),
        SceneError::Duplicate { kind: "body", name: "a".into() }.to_string()
    );
    assert_eq!(parse("").unwrap_err(), SceneError::NoBody.to_string());
    let foreign = body("a", [0.0; 3], sphere).replace("\"white\"", "\"gold\"");
    let message = parse(&foreign).unwrap_err();
    assert_eq!(message, "[[body]] \"a\": material = \"gold\" is not among the [[material]] names: white");
    let other = ARTEFACT.replace("fringecell-scene/1", "fringecell-scene/9");
    assert_eq!(
        parse_text(&other, &mut |_| unreachable!()).unwrap_err(),
        SceneError::Format("fringecell-scene/9".into()).to_string()
    );
}

/// A cut or damaged scene file gives a scene or an error, never a panic.
#[test]
fn no_damage_to_a_scene_file_panics() {
    let text = ARTEFACT;
    for cut in (0..text.len()).step_by(7).filter(|c| text.is_char_boundary(*c)) {
        let _ = parse_text(&text[..cut], &mut |_| Err("none".into()));
    }
    for number in ["nan", "inf", "-inf", "-1.0", "0.0", "1e300", "1e-300", "\"x\"", "[]"] {
        for old in ["60.194", "44.964", "0.7", "110.0", "28.0", "12.0", "8.0", "0.5"] {
            if let Ok(scene) = parse_text(&text.replacen(old, number, 1), &mut |_| Err("none".into())) {
                let twin = Twin::new(&scene, TwinSettings::default(), &thesis::rig(40, 30)).unwrap();
                let view = twin.view("cam1", 0).unwrap();
                let mut out = vec![0; 40 * 30];
                view.render("proj1", &thesis::sequence(), 0, PixelsMut::Mono8(&mut out)).unwrap();
            }
        }
    }
}

#[test]
fn a_checkerboard_has_its_corners_where_the_target_says() {
    let board = r#"{ shape = "plane", size_mm = [100.0, 80.0], thickness_mm = 5.0, checkerboard = { columns = 8, rows = 6, pitch_mm = 9.0, dark = 0.1 } }"#;
    let scene = parse(&body("board", [0.0, 0.0, 15.0], board)).unwrap();
    let twin = Twin::new(&scene, TwinSettings::ideal(), &thesis::rig(281, 188)).unwrap();
    let view = twin.view("cam1", 0).unwrap();
    let mut renderer = twin.renderer("proj1", &[fringe::pattern::PatternSet::White {}]).unwrap();
    let image = renderer.irradiance(&view, 0).unwrap().to_vec();
    let mut seen = [0, 0];
    for (index, value) in image.iter().enumerate() {
        let pixel = nalgebra::Point2::new((index % 281) as f64, (index / 281) as f64);
        let Some(point) = twin.truth_point("cam1", 0, pixel).unwrap().filter(|p| p.normal.z > 0.99) else {
            continue;
        };
        let (i, j) = ((point.part_mm.x / 9.0 + 4.5).floor(), (point.part_mm.y / 9.0 + 3.5).floor());
        let on_board = (0.0..=8.0).contains(&i) && (0.0..=6.0).contains(&j);
        let dark = on_board && (i + j) % 2.0 == 0.0;
        // Light falls off by a few per cent over the plate; dark and light squares differ tenfold.
        assert_eq!(*value < 0.2, dark, "square {i}, {j}: {value}");
        seen[usize::from(dark)] += 1;
    }
    assert!(seen[0] > 1000 && seen[1] > 1000, "{seen:?}");
}
