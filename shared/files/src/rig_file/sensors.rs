//! What a rig file states of cameras beside their geometry: footprint and noise.

use super::RawCamera;
use crate::document::Document;
use crate::error::{FileError, Problem};
use fringe::sensor::{CameraNoise, Footprint, Sensor};
use std::collections::BTreeMap;

/// Largest footprint, px: beyond it the picture is far out of focus. Lenses of real recordings reach 1.0 px in the mean over the picture.
const MOST_FOOTPRINT_PX: f64 = 2.0;
/// Largest square of it anywhere in the picture, px²: twice that of the mean.
const MOST_VARIANCE_PX2: f64 = 2.0 * MOST_FOOTPRINT_PX * MOST_FOOTPRINT_PX;
/// Largest noise, DN: the full scale of 16 bits.
const MOST_NOISE_DN: f64 = 65_535.0;

/// Footprints and noise of all cameras that state them.
pub(super) fn sensors(
    document: &Document,
    cameras: &[RawCamera],
) -> Result<BTreeMap<String, Sensor>, FileError> {
    let mut all = BTreeMap::new();
    for (index, camera) in cameras.iter().enumerate() {
        let refuse = |key: &str, value: String, limit: String| {
            let remedy = format!("this is \"{}\"; `fringetool calibrate` writes it", camera.name);
            Err(document.fault(&format!("camera[{index}].{key}"), Problem::Value { value, limit }, remedy))
        };
        let check = |key: &str, values: [f64; 2], most: f64| {
            let outside = values.iter().find(|value| !(0.0..=most).contains(*value));
            outside
                .map_or(Ok(()), |value| refuse(key, value.to_string(), format!("must be within 0 to {most}")))
        };
        let mut sensor = Sensor::default();
        if let Some(sigma_px) = camera.footprint_px {
            check("footprint_px", sigma_px, MOST_FOOTPRINT_PX)?;
            let field_px2 = camera.footprint_field_px2.unwrap_or(0.0);
            let footprint = Footprint { sigma_px, u_px: None, field_px2 };
            if !is_everywhere(&footprint) {
                let limit = format!(
                    "must leave the squares of footprint_px within 0 to {MOST_VARIANCE_PX2} from the middle (less a third of it) to the corner (more by two thirds)"
                );
                refuse("footprint_field_px2", field_px2.to_string(), limit)?;
            }
            sensor.footprint = Some(footprint);
        } else if camera.footprint_field_px2.is_some() {
            let problem = Problem::Value {
                value: "footprint_field_px2 alone".into(),
                limit: "needs footprint_px, the mean over the picture".into(),
            };
            let key = format!("camera[{index}].footprint_field_px2");
            return Err(document.fault(&key, problem, "state footprint_px, or remove it"));
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

/// Whether a rig file may state a footprint: that of a picture in focus, everywhere.
pub fn is_in_focus(footprint: &Footprint) -> bool {
    footprint.sigma_px.iter().all(|sigma_px| (0.0..=MOST_FOOTPRINT_PX).contains(sigma_px))
        && is_everywhere(footprint)
}

/// Whether the change of a footprint over the picture leaves one everywhere.
fn is_everywhere(footprint: &Footprint) -> bool {
    let ends = [0.0, 1.0].map(|field| footprint.variances_at_px2(field));
    ends.as_flattened().iter().all(|variance| (-1e-12..=MOST_VARIANCE_PX2).contains(variance))
}

/// Refuses the keys of a sensor on a projector, which has none.
pub(super) fn no_sensors(document: &Document, projectors: &[RawCamera]) -> Result<(), FileError> {
    let stated = |projector: &RawCamera| match projector {
        RawCamera { footprint_px: Some(_), .. } => Some("footprint_px"),
        RawCamera { footprint_field_px2: Some(_), .. } => Some("footprint_field_px2"),
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
