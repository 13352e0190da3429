//! Every way of coding the projector's coordinate, from recording to points: the scatter of two recordings beside the stated sigma, the points
//! about the plate that they stand on, and what is refused.

use crate::support::fringetool;
use fringe::cloud::Point;
use metrology::fit::{FitSettings, plane};
use std::path::Path;
use tempfile::TempDir;

/// A plate that faces the first projector of the demo, seen by its cameras at half their resolution.
const PLATE: &str = "format = \"fringecell-scene/1\"\n[[material]]\nname = \"matte\"\nalbedo = 0.7\n[[body]]\nname = \"plate\"\n\
    material = \"matte\"\nposition_mm = [0.0, 0.0, 15.0]\nrotation_deg = [0.0, 42.0, 0.0]\n\
    geometry = { shape = \"plane\", size_mm = [90.0, 90.0], thickness_mm = 5.0 }\n";

const INVERSE: &str = "{ set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 },\n\
    { set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0, invert = true },\n";
const WHITE_BLACK: &str = "{ set = \"white\" }, { set = \"black\" },\n";

/// Two cameras and the projector of the demo in front of the plate.
struct Cell {
    folder: TempDir,
}

impl Cell {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let mut rig = twin::thesis::rig(562, 375);
        let (left, right) = ("cam1".to_owned(), "proj1".to_owned());
        rig.pairs.truncate(1);
        rig.pairs.push(fringe::geometry::rig::Pair {
            name: "beside".into(),
            left,
            right: right.clone(),
            projector: right,
        });
        files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
        std::fs::write(folder.path().join("scene.toml"), PLATE).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// Records what a sequence shows.
    fn record(&self, sequence: &str, name: &str, seed: u64) {
        let text = format!(
            "format = \"fringecell-config/1\"\nname = \"codec\"\nrig = \"rig.toml\"\npairs = [\"pair1\"]\n[[projector]]\n\
             name = \"proj1\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\ncameras = [\"cam1\", \"cam2\"]\n\
             sequence = [\n{sequence}]\n[[camera]]\nname = \"cam1\"\ndriver = \"twin\"\n[[camera]]\nname = \"cam2\"\n\
             driver = \"twin\"\n[twin]\nscene = \"scene.toml\"\nseed = {seed}\n[twin.settings]\nposition_scatter_mm = 0.0\n\
             angle_scatter_deg = 0.0\nvibration_um = 0.0\n"
        );
        std::fs::write(self.path("cell.toml"), text).unwrap();
        fringetool(&["simulate", &self.path("cell.toml"), "--out", &self.path(name)]).expect_success();
    }

    /// Absolute phase and sigma of a recording, rad.
    fn phase(&self, recording: &str, more: &[&str]) -> (Vec<f32>, Vec<f32>) {
        let (recording, out) = (self.path(recording), self.path(&format!("{recording}-out")));
        let arguments = ["decode", &recording, "--camera", "cam1", "--out", &out];
        println!("{}", fringetool(&[&arguments[..], more].concat()).expect_success().stdout);
        let raster = |what: &str| {
            files::npy::read(Path::new(&format!("{out}/proj1-cam1-x-{what}.npy"))).unwrap().values
        };
        (raster("phase"), raster("sigma"))
    }

    fn cloud(&self, recording: &str, method: &str) -> Vec<Point> {
        let (recording, ply) = (self.path(recording), self.path("cloud.ply"));
        let rig = self.path("rig.toml");
        let arguments = ["reconstruct", "--rig", &rig, "--method", method, "--out", &ply, &recording];
        println!("{}", fringetool(&arguments).expect_success().stdout);
        files::ply::read_cloud(ply.as_ref()).unwrap().points
    }
}

/// Standard deviation of the difference of two recordings over what their sigmas state, without the tenth that differs most.
fn scatter_over_sigma(one: &(Vec<f32>, Vec<f32>), two: &(Vec<f32>, Vec<f32>)) -> (f64, usize) {
    let pixels = one.0.iter().zip(&two.0).zip(one.1.iter().zip(&two.1));
    let ratios = pixels.filter(|((a, b), _)| a.is_finite() && b.is_finite());
    let mut squares: Vec<f64> = ratios
        .map(|((a, b), (s, t))| f64::from(a - b).powi(2) / (f64::from(*s).powi(2) + f64::from(*t).powi(2)))
        .collect();
    squares.sort_by(f64::total_cmp);
    let face = &squares[..squares.len() * 9 / 10];
    // What a normal scatter leaves below the 90 % quantile of its square.
    let share = 0.9 - 2.0 * 1.644_853_6 * 0.103_135_6;
    ((face.iter().sum::<f64>() / squares.len() as f64 / share).sqrt(), squares.len())
}

/// Points on the plate's face and their standard deviation about its plane, mm.
fn about_the_plate(points: &[Point]) -> (usize, f64) {
    let face: Vec<_> = points
        .iter()
        .map(Point::position)
        .filter(|p| (p.coords - nalgebra::Vector3::new(0.0, 0.0, 15.0)).norm() < 33.0)
        .collect();
    let fit = plane(&face, &FitSettings::default()).unwrap();
    (face.len(), fit.form.form_sigma_mm)
}

#[test]
fn every_codec_states_the_scatter_it_has_and_gives_the_plate() {
    let cell = Cell::new();
    // Sequence, bounds of scatter over sigma, largest deviation from the plate in mm.
    let code = format!("{INVERSE}{WHITE_BLACK}");
    for (name, sequence, most_mm) in [
        ("sine", format!("{{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 4 }},\n{INVERSE}"), 0.03),
        ("lines", format!("{{ set = \"lines\", axis = \"x\", period_px = 8.0, steps = 8 }},\n{}", code.replace("stripe_px = 8.0", "stripe_px = 4.0").replace("bits = 7", "bits = 8")), 0.03),
        ("micro", "{ set = \"micro\", axis = \"x\", periods_px = [16.0, 16.6, 17.4, 18.7, 20.3] },\n".to_owned(), 0.03),
        ("modulated", format!("{{ set = \"modulated\", axis = \"x\", period_px = 16.0, steps = 4, carrier_px = 18.0, carrier_steps = 4 }},\n{code}"), 0.06),
        ("shifted", "{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 4 },\n{ set = \"gray\", axis = \"x\", bits = 6, stripe_px = 16.0 },\n{ set = \"gray\", axis = \"x\", bits = 6, stripe_px = 16.0, shift_px = 8.0 },\n".to_owned(), 0.03),
        ("any order", format!("{{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 3, shifts_rad = [2.0943951023931953, 0.0, 4.1887902047863905] }},\n{code}"), 0.04),
    ] {
        cell.record(&sequence, &format!("{name} 1"), 1);
        cell.record(&sequence, &format!("{name} 2"), 2);
        let (one, two) = (cell.phase(&format!("{name} 1"), &[]), cell.phase(&format!("{name} 2"), &[]));
        let (ratio, pixels) = scatter_over_sigma(&one, &two);
        println!("{name}: scatter over sigma {ratio:.3} at {pixels} pixels");
        assert!(pixels > 40_000, "{name}: {pixels}");
        assert!((0.9..1.15).contains(&ratio), "{name}: {ratio}");
        // Between two cameras errors of the pattern cancel; beside the projector they stay.
        for (method, most_mm) in [("phase", most_mm), ("projector", 2.0 * most_mm)] {
            let (count, sigma_mm) = about_the_plate(&cell.cloud(&format!("{name} 1"), method));
            println!("{name}, {method}: {count} points, {sigma_mm:.4} mm");
            assert!(count > 15_000 && sigma_mm < most_mm, "{name}, {method}: {count} points, {sigma_mm} mm");
        }
    }
}

/// One frame by its Fourier transform: a phase that is smooth over the period, with a code for the order, or without by `unwrap`.
#[test]
fn a_single_frame_is_decoded_by_its_fourier_transform() {
    let cell = Cell::new();
    let sine = "{ set = \"sine\", axis = \"x\", period_px = 12.0, steps = 1 },\n";
    let sequence = format!("{sine}{}{WHITE_BLACK}", INVERSE.replace("stripe_px = 8.0", "stripe_px = 6.0"));
    cell.record(&sequence, "one", 1);
    cell.record(&sequence, "two", 2);
    let (ratio, pixels) = scatter_over_sigma(&cell.phase("one", &[]), &cell.phase("two", &[]));
    println!("scatter over sigma {ratio:.3} at {pixels} pixels");
    // The stated one holds the method's systematic part too, of which an even plate has none.
    assert!(pixels > 25_000 && (0.4..1.15).contains(&ratio), "{ratio} {pixels}");
    let (count, sigma_mm) = about_the_plate(&cell.cloud("one", "projector"));
    assert!(count > 15_000 && sigma_mm < 0.1, "{count} {sigma_mm}");
    // Of the recording only the first frame.
    let frames = "frames/proj1/cam1";
    std::fs::create_dir_all(cell.path(&format!("alone/{frames}"))).unwrap();
    std::fs::copy(cell.path(&format!("one/{frames}/000.png")), cell.path(&format!("alone/{frames}/000.png")))
        .unwrap();
    let text = format!(
        "format = \"fringecell-recording/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\n\
         cameras = [\"cam1\"]\nsequence = [\n{sine}]\n"
    );
    std::fs::write(cell.path("alone/recording.toml"), text).unwrap();
    let ran = fringetool(&["decode", &cell.path("alone")]);
    assert_eq!(ran.code, Some(2), "{}", ran.stdout);
    assert!(ran.stderr.contains("fringetool unwrap"), "{}", ran.stderr);
    let arguments =
        ["unwrap", &cell.path("alone"), "--method", "reliability", "--out", &cell.path("relative")];
    fringetool(&arguments).expect_success();
}

/// Steps in the three colours of one picture, from a colour picture and from the raw mosaic behind it.
#[test]
fn three_steps_in_one_colour_picture_are_decoded_from_its_channels() {
    let cell = Cell::new();
    let steps = "{ set = \"sine\", axis = \"x\", period_px = 32.0, steps = 3 },\n";
    let code = "{ set = \"gray\", axis = \"x\", bits = 6, stripe_px = 16.0 },\n";
    cell.record(&format!("{steps}{code}{WHITE_BLACK}"), "grey", 1);
    let frame = |number: usize| {
        image::open(cell.path(&format!("grey/frames/proj1/cam1/{number:03}.png"))).unwrap().into_luma8()
    };
    let from = cell.folder.path().join("colour");
    std::fs::create_dir(&from).unwrap();
    let parts = [frame(0), frame(1), frame(2)];
    let (width, height) = parts[0].dimensions();
    image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([0, 1, 2].map(|k| parts[k].get_pixel(x, y).0[0]))
    })
    .save(from.join("rgb.png"))
    .unwrap();
    let filter = |x: u32, y: u32| [0, 1, 1, 2][(y % 2 * 2 + x % 2) as usize];
    image::GrayImage::from_fn(width, height, |x, y| *parts[filter(x, y)].get_pixel(x, y))
        .save(from.join("raw.png"))
        .unwrap();
    let rest: Vec<String> = (3..11).map(|number| format!("{number:03}.png")).collect();
    for name in &rest {
        std::fs::copy(cell.path(&format!("grey/frames/proj1/cam1/{name}")), from.join(name)).unwrap();
    }
    let reference = cell.phase("grey", &[]);
    for (picture, more) in [("rgb", ""), ("raw", "mosaic = \"rggb\"\n")] {
        let list: Vec<String> =
            std::iter::repeat_n(format!("{picture}.png"), 3).chain(rest.clone()).collect();
        let grey = vec!["grey"; rest.len()];
        let channel = [vec!["red", "green", "blue"], grey].concat();
        let layout = format!(
            "format = \"fringecell-layout/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\n\
             sequence = [\n{steps}{code}{WHITE_BLACK}]\n[[projector.camera]]\nname = \"cam1\"\nlist = {list:?}\n\
             channel = {channel:?}\n{more}"
        );
        std::fs::write(cell.path("layout.toml"), layout).unwrap();
        let (layout, from, out) = (cell.path("layout.toml"), cell.path("colour"), cell.path(picture));
        fringetool(&["import", &layout, "--from", &from, "--out", &out]).expect_success();
        let found = cell.phase(picture, &[]);
        let pairs = found.0.iter().zip(&reference.0).filter(|(a, b)| a.is_finite() && b.is_finite());
        let mut apart: Vec<f32> = pairs.map(|(a, b)| (a - b).abs()).collect();
        apart.sort_by(f32::total_cmp);
        println!("{picture}: {} pixels, median {:.4} rad apart", apart.len(), apart[apart.len() / 2]);
        assert!(apart.len() > 40_000, "{}", apart.len());
        if picture == "rgb" {
            assert_eq!(found.0.len(), reference.0.len());
            assert!(apart.iter().all(|rad| *rad == 0.0), "the channels are the frames");
        } else {
            // What the gaps were filled with is smooth over two pixels; the outline of the plate is not.
            assert!(apart[apart.len() * 9 / 10] < 0.2, "{}", apart[apart.len() * 9 / 10]);
        }
    }
}

/// Nobody declares it: frames of a code that are black, taken twice, exchanged, or darker as a whole are named, and orders stay right.
#[test]
fn wrong_frames_of_a_code_are_named_and_orders_stay_right() {
    let cell = Cell::new();
    let sine = "{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 4 },\n";
    cell.record(
        &format!("{sine}{{ set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 }},\n{WHITE_BLACK}"),
        "dirt",
        1,
    );
    let clean = cell.phase("dirt", &[]).0;
    // Frames 4 to 10 are the bits, from coarse to fine.
    let place = |frame: u32| cell.path(&format!("dirt/frames/proj1/cam1/{frame:03}.png"));
    let read = |frame: u32| image::open(place(frame)).unwrap().into_luma8();
    let kept: Vec<_> = (0..13).map(read).collect();
    let black = image::GrayImage::new(kept[0].width(), kept[0].height());
    let mut dark = kept[7].clone();
    dark.pixels_mut().for_each(|pixel| pixel.0[0] = (f32::from(pixel.0[0]) * 0.5) as u8);
    for (kind, spoiled) in [
        ("black", vec![(7, &black)]),
        ("exchanged", vec![(8, &kept[7])]),
        ("level", vec![(7, &dark)]),
        ("exchanged", vec![(7, &kept[8]), (8, &kept[7])]),
    ] {
        for (frame, picture) in &spoiled {
            picture.save(place(*frame)).unwrap();
        }
        let json = cell.path("dirt.json");
        let ran =
            fringetool(&["decode", &cell.path("dirt"), "--camera", "cam1", "--json", &json]).expect_success();
        let result: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        let found = result["views"][0]["findings"].as_array().unwrap();
        let frames: Vec<u64> = found.iter().filter_map(|fault| fault["frame"].as_u64()).collect();
        let expected: Vec<u64> = spoiled.iter().map(|(frame, _)| u64::from(frame - 3)).collect();
        assert!(
            frames == expected && found.iter().all(|fault| fault["kind"] == kind),
            "{kind}: {}",
            ran.stdout
        );
        let phase = cell.phase("dirt", &[]).0;
        let both = phase.iter().zip(&clean).filter(|(a, b)| a.is_finite() && b.is_finite());
        let (mut count, mut wrong) = (0, 0);
        for (a, b) in both {
            count += 1;
            wrong += usize::from((a - b).abs() > 3.0);
        }
        let before = clean.iter().filter(|phase| phase.is_finite()).count();
        println!("{kind}: {wrong} wrong orders, {count} of {before} pixels");
        assert!(count * 100 > before * 85 && wrong * 1000 < count, "{kind}: {wrong}, {count} of {before}");
        for (frame, _) in &spoiled {
            kept[*frame as usize].save(place(*frame)).unwrap();
        }
    }
}
