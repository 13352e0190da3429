//! What a rig file states of cameras beside their geometry: footprint and noise.

use super::RawCamera;
use crate::document::Document;
use crate::error::{FileError, Problem};
use fringe::sensor::{CameraNoise, Footprint, Sensor};
use std::collections::BTreeMap;

/// Largest footprint, px: beyond it the picture is out of focus, and the decoder's expansion does not hold.
const MOST_FOOTPRINT_PX: f64 = 1.0;
/// Largest noise, DN: the full scale of 16 bits.
const MOST_NOISE_DN: f64 = 65_535.0;

/// Footprints and noise of all cameras that state them.
pub(super) fn sensors(
    document: &Document,
    cameras: &[RawCamera],
) -> Result<BTreeMap<String, Sensor>, FileError> {
    let mut all = BTreeMap::new();
    for (index, camera) in cameras.iter().enumerate() {
        let check = |key: &str, values: [f64; 2], most: f64| {
            let outside = values.iter().find(|value| !(0.0..=most).contains(*value));
            outside.map_or(Ok(()), |value| {
                let problem =
                    Problem::Value { value: value.to_string(), limit: format!("must be within 0 to {most}") };
                let remedy = format!("this is \"{}\"; `fringetool calibrate` writes it", camera.name);
                Err(document.fault(&format!("camera[{index}].{key}"), problem, remedy))
            })
        };
        let mut sensor = Sensor::default();
        if let Some(sigma_px) = camera.footprint_px {
            check("footprint_px", sigma_px, MOST_FOOTPRINT_PX)?;
            sensor.footprint = Some(Footprint { sigma_px, u_px: None });
        }
        if let Some(noise) = &camera.noise {
            check("noise", [noise.read_dn, noise.gain_dn], MOST_NOISE_DN)?;
            sensor.noise = Some(CameraNoise { read_noise_dn: noise.read_dn, gain_dn: noise.gain_dn });
        }
        if !sensor.is_unknown() {
            all.insert(camera.name.clone(), sensor);
        }
    }
    Ok(all)
}

/// Refuses the keys of a sensor on a projector, which has none.
pub(super) fn no_sensors(document: &Document, projectors: &[RawCamera]) -> Result<(), FileError> {
    let stated = |projector: &RawCamera| match projector {
        RawCamera { footprint_px: Some(_), .. } => Some("footprint_px"),
        RawCamera { noise: Some(_), .. } => Some("noise"),
        _ => None,
    };
    let found = projectors.iter().enumerate().find_map(|(index, p)| Some((index, p, stated(p)?)));
    found.map_or(Ok(()), |(index, projector, key)| {
        let problem = Problem::Value {
            value: format!("{key} of the projector \"{}\"", projector.name),
            limit: "only cameras have it".into(),
        };
        Err(document.fault(&format!("projector[{index}].{key}"), problem, "remove it"))
    })
}
