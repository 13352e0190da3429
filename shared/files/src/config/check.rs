//! From what is written to what is meant.

use super::devices::{check_apart, genicam};
use super::hosts::{check_hosts, hosts};
use super::limits::{cycles, formats, limits, results, schedule, settings};
use super::projector_relations::check_lights;
use super::projectors::{Lights, check_recorded_sizes, projectors};
use super::raw::{RawConfig, RawTwin};
use super::recipes::recipes;
use super::references::{check_drivers, check_graph, check_twin, pairs};
use super::together::together;
use super::values::{camera_driver, driver, referenced, value};
use super::warm_up::warm_up;
use super::{CONFIG_FORMAT, Config, RecordingConfig, TwinConfig};
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::hash::sha256_hex;
use crate::name::duplicate;
use crate::recording::Recording;
use crate::rig_file::{RigFile, read_rig};
use crate::scene_file::mesh_files;
use cell::configuration::{CameraConfig, Configuration, Driver};
use fringe::text::{CELL_NAME, is_cell_name};
use std::path::Path;
use twin::TwinSettings;

impl Config {
    /// Reads and checks a configuration and every file that it names.
    ///
    /// # Errors
    /// The first fault, with file, line, key, value, limit and remedy.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let document = Document::read(path)?;
        let raw: RawConfig = document.parse(CONFIG_FORMAT)?;
        check_cell_name(&document, &raw.name)?;
        let mut rig_file = referenced(&document, "rig", &raw.rig, read_rig)?;
        rig_file.rig.sensors = rig_file.sensors();
        let cameras = cameras(&document, &raw, &rig_file)?;
        check_apart(&document, &cameras)?;
        check_tables(&document, &raw)?;
        let recording = recording(&document, &raw)?;
        let settings = settings(&document, &raw)?;
        let played = recording.as_ref().map(|recording| &recording.recording);
        let Lights { projectors, corrections } =
            projectors(&document, &raw, &cameras, played, &settings.decode)?;
        let rig = pairs(&document, &raw, &rig_file, &projectors)?;
        let twin = twin(&document, &raw, &rig_file)?;
        let (edge_px, viewpoints) = (settings.matching.surface.edge_px, rig.viewpoints(&rig.pairs));
        let named = (rig_file.sha256.as_str(), rig_file.path.as_path(), &rig.pairs[..]);
        let (recipes, plans) = recipes(&document, &raw, named, (edge_px, &viewpoints))?;
        let warm_up = warm_up(&document, raw.warm_up.as_ref(), &cameras)?;
        let mut cell = Configuration {
            warm_up,
            hosts: hosts(&document, &raw)?,
            name: raw.name.clone(),
            cycles: cycles(&document, raw.cycles)?,
            rig,
            limits: limits(&document, &raw.limits)?,
            projectors,
            cameras,
            settings,
            recipes,
            schedule: schedule(&document, &raw.schedule)?,
            together: Vec::new(),
            rate_hz: recording.as_ref().map(|r| r.rate_hz),
        };
        check_graph(&document, &rig_file, &cell)?;
        check_drivers(&document, &cell.cameras, &cell.projectors)?;
        check_lights(&document, &cell)?;
        if let Some(recording) = played {
            check_recorded_sizes(&document, recording, &cell.cameras)?;
        }
        if let Some(twin) = &twin {
            check_twin(&document, &cell.rig, twin, &cell.cameras, &cell.projectors)?;
        }
        cell.together = together(&document, raw.schedule.together.as_ref(), &cell, twin.as_ref())?;
        check_hosts(&document, &cell)?;
        Ok(Self {
            sha256: sha256_hex(document.text.as_bytes()),
            cell,
            rig_path: rig_file.path,
            rig_sha256: rig_file.sha256,
            has_covariance: rig_file.covariance.is_some(),
            plans,
            corrections,
            twin,
            recording,
            results: results(&document, &raw.results)?,
            formats: formats(&document, &raw.results.formats)?,
            document,
        })
    }
}

fn check_cell_name(document: &Document, name: &str) -> Result<(), FileError> {
    if is_cell_name(name) {
        return Ok(());
    }
    let problem = value(format!("{name:?}"), CELL_NAME);
    Err(document.fault("name", problem, "it becomes the name of a folder and of services"))
}

fn cameras(document: &Document, raw: &RawConfig, rig: &RigFile) -> Result<Vec<CameraConfig>, FileError> {
    let names = raw.camera.iter().map(|camera| camera.name.as_str());
    if let Some((index, name)) = duplicate(names) {
        let problem = Problem::Duplicate { kind: "camera", name: name.to_owned() };
        return Err(document.fault(
            &format!("camera[{index}].name"),
            problem,
            "rename or remove one of them",
        ));
    }
    let known: Vec<&str> = rig.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
    raw.camera
        .iter()
        .enumerate()
        .map(|(index, camera)| {
            let key = |part: &str| format!("camera[{index}].{part}");
            let Some(geometry) = rig.rig.camera(&camera.name) else {
                let remedy = format!("the rig is {}; {}", rig.path.display(), "name one of its cameras");
                let problem = Problem::UnknownName {
                    kind: "camera",
                    name: camera.name.clone(),
                    known: list(known.iter().copied()),
                };
                let remedy = did_you_mean(&camera.name, known.iter().copied(), &remedy);
                return Err(document.fault(&key("name"), problem, remedy));
            };
            Ok(CameraConfig {
                name: camera.name.clone(),
                driver: camera_driver(document, &key("driver"), &camera.driver)?,
                genicam: genicam(document, &format!("camera[{index}]"), camera)?,
                width_px: geometry.width_px,
                height_px: geometry.height_px,
            })
        })
        .collect()
}

/// The tables that the drivers need are there.
fn check_tables(document: &Document, raw: &RawConfig) -> Result<(), FileError> {
    let cameras = raw.camera.iter().enumerate().map(|(i, c)| (format!("camera[{i}].driver"), &c.driver));
    let projectors =
        raw.projector.iter().enumerate().map(|(i, p)| (format!("projector[{i}].driver"), &p.driver));
    for (key, name) in cameras.chain(projectors) {
        let (table, present) = match driver(document, &key, name)? {
            Driver::Twin => ("[twin]", raw.twin.is_some()),
            Driver::Recording => ("[recording]", raw.recording.is_some()),
            Driver::Genicam | Driver::Network | Driver::Screen | Driver::LightCrafter => continue,
        };
        if !present {
            let problem = Problem::Missing(format!("the table {table}, which this driver needs,"));
            return Err(document.fault(&key, problem, format!("add {table}")));
        }
    }
    Ok(())
}

fn recording(document: &Document, raw: &RawConfig) -> Result<Option<RecordingConfig>, FileError> {
    let Some(recording) = &raw.recording else { return Ok(None) };
    let rate_hz = recording.rate_hz;
    if !(0.0..=100_000.0).contains(&rate_hz) {
        let problem = value(rate_hz, "0 … 100000 frames per second");
        return Err(document.fault("recording.rate_hz", problem, "0 plays as fast as possible"));
    }
    let opened = referenced(document, "recording.path", &recording.path, Recording::open)?;
    Ok(Some(RecordingConfig { recording: opened, rate_hz, repeat: recording.repeat }))
}

fn twin(document: &Document, raw: &RawConfig, measured: &RigFile) -> Result<Option<TwinConfig>, FileError> {
    let Some(twin) = &raw.twin else { return Ok(None) };
    let scene = referenced(document, "twin.scene", &twin.scene, Document::read)?;
    let truth = match &twin.rig {
        Some(path) => referenced(document, "twin.rig", path, read_rig)?,
        None => measured.clone(),
    };
    Ok(Some(TwinConfig {
        meshes: mesh_files(&scene),
        scene,
        rig: truth.rig,
        rig_path: truth.path,
        rig_sha256: truth.sha256,
        settings: twin_settings(document, twin)?,
    }))
}

fn twin_settings(document: &Document, twin: &RawTwin) -> Result<TwinSettings, FileError> {
    let written: TwinSettings = document.typed("twin.settings", twin.settings.clone())?;
    written.check().map_err(|error| {
        let remedy = "change it, or leave it out for the usual value";
        document.fault(&format!("twin.settings.{}", error.key), value(error.value, error.limit), remedy)
    })?;
    Ok(TwinSettings { seed: twin.seed, ..written })
}
