//! Ways to damage a recording, a rig or a configuration.

use crate::support::Small;
use std::fs;

/// A frame of the recording.
pub const FRAME: &str = "rec/frames/proj1/cam1/003.png";

pub fn frame(camera: &str, number: usize) -> String {
    format!("rec/frames/proj1/{camera}/{number:03}.png")
}

pub fn truncate(small: &Small, name: &str) {
    let bytes = fs::read(small.path(name)).unwrap();
    fs::write(small.path(name), &bytes[..bytes.len() / 2]).unwrap();
}

pub fn write_grey(small: &Small, name: &str, width: u32, height: u32) {
    image::GrayImage::from_pixel(width, height, image::Luma([90])).save(small.path(name)).unwrap();
}

pub fn swap(small: &Small, a: usize, b: usize) {
    let (a, b, spare) = (small.path(&frame("cam1", a)), small.path(&frame("cam1", b)), small.path("spare"));
    fs::rename(&a, &spare).unwrap();
    fs::rename(&b, &a).unwrap();
    fs::rename(&spare, &b).unwrap();
}

pub fn paint(small: &Small, numbers: std::ops::Range<usize>, value: u8) {
    for camera in ["cam1", "cam2"] {
        for number in numbers.clone() {
            let (width, height) = crate::support::SMALL_PX;
            let image = image::GrayImage::from_pixel(width, height, image::Luma([value]));
            image.save(small.path(&frame(camera, number))).unwrap();
        }
    }
}

pub fn saturate(small: &Small) {
    paint(small, 0..10, 255);
}

pub fn darken(small: &Small) {
    paint(small, 0..19, 3);
}

pub fn no_code(small: &Small) {
    let text = fs::read_to_string(small.path("rec/recording.toml")).unwrap();
    let kept: Vec<&str> = text.lines().filter(|line| !line.contains("gray")).collect();
    fs::write(small.path("rec/recording.toml"), kept.join("\n")).unwrap();
    for camera in ["cam1", "cam2"] {
        for number in 10..17 {
            fs::remove_file(small.path(&frame(camera, number))).unwrap();
        }
        for (from, to) in [(17, 10), (18, 11)] {
            fs::rename(small.path(&frame(camera, from)), small.path(&frame(camera, to))).unwrap();
        }
    }
}

/// Edits the parsed rig file.
pub fn edit_rig(small: &Small, edit: impl Fn(&mut toml::Table)) {
    let mut table: toml::Table = fs::read_to_string(small.path("rig.toml")).unwrap().parse().unwrap();
    edit(&mut table);
    fs::write(small.path("rig.toml"), toml::to_string(&table).unwrap()).unwrap();
}

pub fn camera(table: &mut toml::Table, index: usize) -> &mut toml::Table {
    table["camera"].as_array_mut().unwrap()[index].as_table_mut().unwrap()
}

pub fn mirror(small: &Small) {
    edit_rig(small, |table| {
        let row = &mut camera(table, 0)["from_world"]["rotation"].as_array_mut().unwrap()[0];
        for value in row.as_array_mut().unwrap() {
            *value = (-value.as_float().unwrap()).into();
        }
    });
}

pub fn zero_focal(small: &Small) {
    edit_rig(small, |table| camera(table, 1)["focal_px"].as_array_mut().unwrap()[0] = 0.0.into());
}

pub fn same_place(small: &Small) {
    edit_rig(small, |table| {
        let pose = camera(table, 0)["from_world"].clone();
        camera(table, 1)["from_world"] = pose;
    });
}

/// Moves the second camera so far aside that its rays meet those of the first nowhere in front of both.
pub fn turn_away(small: &Small) {
    edit_rig(small, |table| {
        camera(table, 1)["from_world"]["translation_mm"].as_array_mut().unwrap()[1] = 90_000.0.into();
    });
}

pub fn make_pipe(path: &str) {
    fs::remove_file(path).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
}

pub fn pipe(small: &Small) {
    make_pipe(&small.path(FRAME));
}

pub fn pipe_text(small: &Small) {
    make_pipe(&small.path("rec/recording.toml"));
}

pub fn focal(small: &Small, focal_px: f64) {
    edit_rig(small, |table| camera(table, 0)["focal_px"] = vec![focal_px; 2].into());
}

pub fn far_away(small: &Small, mm: f64) {
    edit_rig(small, |table| {
        camera(table, 1)["from_world"]["translation_mm"].as_array_mut().unwrap()[2] = mm.into();
    });
}

pub fn many_pairs(small: &Small) {
    edit_rig(small, |table| {
        let pairs = table["pair"].as_array_mut().unwrap();
        let first = pairs[0].as_table().unwrap().clone();
        for number in 0..298 {
            let mut pair = first.clone();
            pair.insert("name".into(), format!("copy{number}").into());
            pairs.push(pair.into());
        }
    });
}

/// Puts a camera below the surface of the hemisphere.
pub fn inside(camera: &mut toml::Table) {
    camera["from_world"]["translation_mm"] = vec![0.0, 0.0, -10.0].into();
}

pub fn drop_projectors(small: &Small) {
    edit_rig(small, |table| {
        table.remove("projector");
    });
}
