//! `fringetool simulate-test`: the recordings of a whole acceptance test on the digital twin, and its plan.

mod layout;
mod plan;

use crate::Outcome;
use crate::bundled;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use crate::simulate::{frames, truth_text, write_recording};
use anyhow::{Context, Result, bail};
use files::config::Config;
use files::document::Document;
use files::scene_file::parse_file;
use fringe::geometry::rig::Rig;
use layout::{TestRecording, recordings};
use std::path::{Path, PathBuf};
use twin::{Scene, Twin, TwinSettings};

const SPHERE: &str = include_str!("../configs/sphere.scene.toml");
const BAR: &str = include_str!("../configs/compliant-bar.scene.toml");

/// Name of the rig file beside the plan.
const RIG: &str = "rig.toml";

#[derive(clap::Args)]
pub struct Args {
    /// Cell configuration (TOML, docs/formats.md) whose [twin] is tested.
    #[arg(default_value = "configs/demo.toml")]
    config: PathBuf,
    /// Folder to write the recordings and the plan to (docs/formats.md).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Rig file (TOML, docs/formats.md) for the evaluation, such as one from `calibrate`; by default that of the twin.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Reduced test with one sphere position of two views and two bar positions.
    #[arg(long)]
    reduced: bool,
    /// Seed instead of that of the configuration.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<&Path> = std::iter::once(&args.config).chain(&args.rig).map(PathBuf::as_path).collect();
    check_outputs(&[("--json", args.json.as_deref())], &inputs, Some(&args.out))?;
    if args.out.read_dir().is_ok_and(|mut entries| entries.next().is_some()) {
        bail!("--out {}: already holds something; name a new folder", args.out.display());
    }
    let found = bundled::find(&args.config)?;
    let config = Config::load(&found.path)?;
    let Some(twin) = &config.twin else {
        bail!("{}: has no [twin]; simulate-test needs one", args.config.display());
    };
    let seed = args.seed.unwrap_or(twin.settings.seed);
    let settings = TwinSettings { seed, ..twin.settings.clone() };
    let recordings = recordings(args.reduced);
    let mut progress = Progress::new(recordings.len() * frames(&config), "simulating");
    files::atomic::create_dir(&args.out.join("truth"))?;
    for (cycle, recording) in recordings.iter().enumerate() {
        let scene = scene(recording)?;
        let twin = Twin::new(&scene, settings.clone(), &twin.rig)
            .with_context(|| args.config.display().to_string())?;
        let truth_path = args.out.join("truth").join(format!("{}.toml", recording.name));
        let truth = (truth_path.as_path(), truth_text(&scene, &twin, cycle as u64));
        let out = args.out.join(&recording.name);
        write_recording((&out, truth.0, &truth.1), &config, &twin, cycle as u64, &[], &mut progress)?;
    }
    drop(progress);
    write_evaluation_rig(args, &twin.rig)?;
    let path = args.out.join("plan.toml");
    files::atomic::write(&path, plan::text(&recordings, args.reduced, &config)?.as_bytes())?;
    println!("{} recordings; next: fringetool vdi2634 {}", recordings.len(), path.display());
    emit(args.json.as_deref(), &serde_json::json!({ "plan": path, "recordings": recordings.len() }))?;
    Ok(Outcome::Done)
}

/// Writes the rig of the evaluation beside the plan: the twin's own, or the one given.
fn write_evaluation_rig(args: &Args, own: &Rig) -> Result<()> {
    let (rig, source) = match &args.rig {
        None => (own.clone(), "the digital twin's own rig: free of calibration errors".to_owned()),
        Some(path) => {
            let rig = in_world_of(own, files::rig_file::read_rig(path)?.rig);
            (rig, format!("{}, moved into the world of the twin", path.display()))
        }
    };
    let mut provenance = toml::Table::new();
    provenance.insert("source".into(), source.into());
    files::rig_file::write_rig(&args.out.join(RIG), &rig, &provenance, None)?;
    Ok(())
}

/// The same rig in the world of another one: its first camera stands where the camera of this name stands there. The world of
/// a calibrated rig is that of its first target, but the volume of the test has edges along the axes of the twin's world.
fn in_world_of(other: &Rig, mut rig: Rig) -> Rig {
    let shared = rig.cameras.iter().find_map(|c| Some((other.camera(&c.name)?, c.camera.camera_from_world)));
    let Some((there, camera_from_own)) = shared else { return rig };
    let own_from_other = camera_from_own.inverse() * there.camera_from_world;
    for device in rig.cameras.iter_mut().chain(&mut rig.projectors) {
        device.camera.camera_from_world *= own_from_other;
    }
    rig
}

/// The artefact of a recording where the recording has it.
fn scene(recording: &TestRecording) -> Result<Scene> {
    let text = if recording.bar { BAR } else { SPHERE };
    let document = Document { path: "the scene that comes with the program".into(), text: text.to_owned() };
    let mut file = parse_file(&document)?;
    for body in &mut file.bodies {
        let [x, y, z] = body.rotation_deg.map(f64::to_radians);
        let part_from_body = nalgebra::Isometry3::from_parts(
            nalgebra::Vector3::from(body.position_mm).into(),
            nalgebra::UnitQuaternion::from_euler_angles(x, y, z),
        );
        let moved = recording.place() * part_from_body;
        let (roll, pitch, yaw) = moved.rotation.euler_angles();
        body.position_mm = moved.translation.vector.into();
        body.rotation_deg = [roll, pitch, yaw].map(f64::to_degrees);
    }
    Scene::new(&file, &mut |_| Err("no mesh here".into())).context("the scene that comes with the program")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    #[test]
    fn a_rig_with_another_world_keeps_its_shape() {
        let twin = Config::load(Path::new("configs/demo.toml")).unwrap().twin.unwrap().rig;
        let mut rig = twin.clone();
        let moved = Isometry3::new(Vector3::new(3.0, -70.0, 500.0), Vector3::new(0.4, -2.0, 0.7));
        rig.cameras.iter_mut().chain(&mut rig.projectors).for_each(|d| d.camera.camera_from_world *= moved);
        let back = in_world_of(&twin, rig);
        for (a, b) in
            back.cameras.iter().chain(&back.projectors).zip(twin.cameras.iter().chain(&twin.projectors))
        {
            let off = a.camera.camera_from_world.inverse() * b.camera.camera_from_world;
            assert!(
                off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-12,
                "{}: {off}",
                a.name
            );
        }
    }
}
