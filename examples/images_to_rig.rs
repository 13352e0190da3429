//! From pictures of a checkerboard by two cameras to a rig file. The n-th picture of each camera shows pose n:
//!
//!     cargo run --release --example images_to_rig -- TARGET.toml RIG.toml LEFT1.png RIGHT1.png LEFT2.png RIGHT2.png …

use characterise::calibration::{
    CalibrationSettings, Device, DeviceKind, ImagePoint, Observations, View, calibrate,
};
use characterise::target::{TargetSettings, detect};
use files::image_file::read_foreign_frame;
use files::target_file::read_target;
use fringe::geometry::rig::{Named, Pair, Rig};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [target, out, pictures @ ..] = arguments.as_slice() else {
        return Err("arguments: TARGET.toml RIG.toml LEFT1.png RIGHT1.png …".into());
    };
    let target = read_target(Path::new(target))?;
    let target = target.board().ok_or("the target has faces; this example takes a single board")?;
    let target_mm = target.board_points_mm().into_iter().map(|(_, point)| point).collect();
    let (devices, faces, poses, views) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut seen = Observations { devices, target_mm, faces, poses, views };
    for (number, picture) in pictures.iter().enumerate() {
        let (pose, device) = (number / 2, number % 2);
        let frame = read_foreign_frame(Path::new(picture), None)?;
        if pose == 0 {
            let (name, kind) = (["left", "right"][device].to_owned(), DeviceKind::Camera);
            seen.devices.push(Device { name, kind, width_px: frame.width_px, height_px: frame.height_px });
        }
        if device == 0 {
            seen.poses.push(picture.clone());
        }
        let found = detect(&frame.view(), target, &TargetSettings::default())?;
        let image_points = found.points.iter().map(|point| ImagePoint {
            index: (point.index.1 * target.columns + point.index.0) as usize,
            pixel: point.pixel,
            covariance_px2: point.covariance_px2,
            link: None,
        });
        let image_points = image_points.collect();
        seen.views.push(View { device, pose, image_points, may_be_turned: false });
    }
    let calibration = calibrate(&seen, &CalibrationSettings::default())?;
    for device in &calibration.devices {
        let (u_px, rms_px) = (device.standard_uncertainty[0], device.rms_reprojection_px);
        println!(
            "{}: focal length {:.2} ± {u_px:.2} px, rms {rms_px:.4} px",
            device.name, device.camera.focal_px[0]
        );
    }
    let cameras =
        calibration.devices.iter().map(|d| Named { name: d.name.clone(), camera: d.camera.clone() });
    let [name, left, right] = ["pair1", "left", "right"].map(str::to_owned);
    let pairs = vec![Pair { name, left, right, projector: String::new() }];
    let rig = Rig { cameras: cameras.collect(), projectors: Vec::new(), pairs, ..Rig::default() };
    files::rig_file::write_rig(Path::new(out), &rig, &toml::Table::new(), None)?;
    println!("{out}: from {} poses", seen.poses.len());
    Ok(())
}
