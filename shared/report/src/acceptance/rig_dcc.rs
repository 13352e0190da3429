//! The calibration of a rig in the format of digital calibration certificates: DCC 3.1.2 with D-SI 2.1.0 (PTB).
//!
//! A statement says that it is no certificate of an accredited laboratory. Each device has its parameters with U (k = 2) where the covariance
//! beside the rig file tells it; pixels are numbers (`\one`) to D-SI. Each pair has the distance of its projection centres.

use super::dcc::{
    Certificate, NOT_STATED, certificate, check_country, check_day, expanded, identification, statement, text,
};
use super::xml::Xml;
use super::{AcceptanceReportError, Parties};
use files::rig_file::{Covariance, RigFile};
use fringe::geometry::rig::Named;

/// Expanded uncertainties have this factor.
const COVERAGE: f64 = 2.0;

/// The whole document, UTF-8; `date` is the day of the calibration, YYYY-MM-DD.
///
/// # Errors
/// The date is no day, or the country is no code.
pub fn render_rig(
    rig: &RigFile,
    covariance: Option<&Covariance>,
    date: &str,
    parties: &Parties<'_>,
) -> Result<Vec<u8>, AcceptanceReportError> {
    let day = check_day(date, "--date", "the day of the calibration as YYYY-MM-DD")?;
    let country = check_country(parties)?;
    let statements = |xml: &mut Xml| {
        let claim = "Calibration report, not a calibration certificate of an accredited laboratory.";
        statement(xml, claim, None);
        if covariance.is_none() {
            statement(xml, "The rig file names no covariance: no uncertainty is stated.", None);
        }
    };
    Ok(certificate(&Certificate {
        software: stated(rig, "software").unwrap_or(env!("CARGO_PKG_VERSION")),
        country,
        sha256: (&rig.sha256, "SHA-256 of the rig file"),
        date: day,
        parties,
        items: &|xml| items(xml, rig),
        person: NOT_STATED,
        role: None,
        statements: &statements,
        result: &|xml| results(xml, rig, covariance),
    }))
}

/// A text of the provenance.
fn stated<'a>(rig: &'a RigFile, key: &str) -> Option<&'a str> {
    rig.provenance.get(key).and_then(|value| value.as_str())
}

fn items(xml: &mut Xml, rig: &RigFile) {
    xml.within("dcc:items", &[], |xml| {
        xml.within("dcc:item", &[], |xml| {
            text(xml, "dcc:name", "rig of cameras and projectors, fringe projection");
            xml.within("dcc:manufacturer", &[], |xml| text(xml, "dcc:name", NOT_STATED));
            xml.within("dcc:identifications", &[], |xml| {
                for device in rig.rig.cameras.iter().chain(&rig.rig.projectors) {
                    let (width, height) = (device.camera.width_px, device.camera.height_px);
                    identification(xml, "owner", &device.name, &format!("device of {width} × {height} px"));
                }
            });
        });
    });
}

fn results(xml: &mut Xml, rig: &RigFile, covariance: Option<&Covariance>) {
    text(xml, "dcc:name", "calibration of a rig");
    xml.within("dcc:usedMethods", &[], |xml| {
        xml.within("dcc:usedMethod", &[], |xml| {
            text(xml, "dcc:name", "joint adjustment of all devices from images of a target");
        });
    });
    if !rig.provenance.is_empty() {
        xml.within("dcc:influenceConditions", &[], |xml| {
            for (key, value) in &rig.provenance {
                let shown = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                xml.within("dcc:influenceCondition", &[], |xml| {
                    text(xml, "dcc:name", key);
                    xml.within("dcc:data", &[], |xml| text(xml, "dcc:text", &shown));
                });
            }
        });
    }
    xml.within("dcc:results", &[], |xml| {
        for device in rig.rig.cameras.iter().chain(&rig.rig.projectors) {
            xml.within("dcc:result", &[], |xml| {
                text(xml, "dcc:name", &format!("parameters of {}", device.name));
                text(xml, "dcc:description", &format!("lens model {}", device.camera.distortion.kind.name()));
                xml.within("dcc:data", &[], |xml| {
                    for (name, value, unit) in parameters(device) {
                        let u = covariance.and_then(|known| uncertainty(known, &device.name, name));
                        quantity(xml, name, value, unit, u.map(|u| COVERAGE * u));
                    }
                    for (name, value, u) in of_sensor(rig, covariance, &device.name) {
                        quantity(xml, name, value, "\\one", u.map(|u| COVERAGE * u));
                    }
                });
            });
        }
        for pair in &rig.rig.pairs {
            let all = || rig.rig.cameras.iter().chain(&rig.rig.projectors);
            let ends = [&pair.left, &pair.right].map(|name| {
                all().find(|device| device.name == *name).map(|device| device.camera.centre_mm())
            });
            if let [Some(left), Some(right)] = ends {
                xml.within("dcc:result", &[], |xml| {
                    text(xml, "dcc:name", &format!("base of {}", pair.name));
                    xml.within("dcc:data", &[], |xml| {
                        let what =
                            format!("distance of the projection centres of {} and {}", pair.left, pair.right);
                        quantity(xml, &what, (left - right).norm(), "\\milli\\metre", None);
                    });
                });
            }
        }
    });
}

/// Parameters by their names in the covariance file, with the unit of D-SI.
fn parameters(device: &Named) -> Vec<(&'static str, f64, &'static str)> {
    let camera = &device.camera;
    let ([fx, fy], [cx, cy], lens) = (camera.focal_px, camera.principal_point_px, &camera.distortion);
    let [k1, k2, k3] = lens.k;
    let ([k4, k5, k6], [s1, s2, s3, s4]) = (lens.more_k, lens.prism);
    let turned = camera.camera_from_world.rotation.scaled_axis();
    let moved = camera.camera_from_world.translation.vector;
    let mut all: Vec<(&'static str, f64, &'static str)> = [
        ("fx_px", fx),
        ("fy_px", fy),
        ("cx_px", cx),
        ("cy_px", cy),
        ("skew", camera.skew),
        ("k1", k1),
        ("k2", k2),
        ("k3", k3),
        ("p1", lens.p[0]),
        ("p2", lens.p[1]),
    ]
    .map(|(name, value)| (name, value, "\\one"))
    .into();
    let further = [("k4", k4), ("k5", k5), ("k6", k6), ("s1", s1), ("s2", s2), ("s3", s3), ("s4", s4)];
    all.extend(
        further.into_iter().filter(|(_, value)| *value != 0.0).map(|(name, value)| (name, value, "\\one")),
    );
    all.extend([
        ("rx_rad", turned.x, "\\radian"),
        ("ry_rad", turned.y, "\\radian"),
        ("rz_rad", turned.z, "\\radian"),
    ]);
    all.extend([
        ("tx_mm", moved.x, "\\milli\\metre"),
        ("ty_mm", moved.y, "\\milli\\metre"),
        ("tz_mm", moved.z, "\\milli\\metre"),
    ]);
    all
}

/// What is known of a camera's sensor and lens by the keys of the rig file, with standard uncertainties.
fn of_sensor(
    rig: &RigFile,
    covariance: Option<&Covariance>,
    device: &str,
) -> Vec<(&'static str, f64, Option<f64>)> {
    let sensor = rig.rig.sensor(device);
    let known = covariance.and_then(|covariance| covariance.sensors.get(device));
    let [u_x, u_y] = known.and_then(|known| known.u_footprint_px).map_or([None; 2], |u| u.map(Some));
    let [u_read, u_gain] = known.and_then(|known| known.u_noise_dn).map_or([None; 2], |u| u.map(Some));
    let mut all = Vec::new();
    if let Some(footprint) = sensor.footprint {
        let [x, y] = footprint.sigma_px;
        all.extend([("footprint_px along x", x, u_x), ("footprint_px along y", y, u_y)]);
        let field = Some(footprint.field_px2).filter(|field| *field != 0.0);
        all.extend(field.map(|field| ("footprint_field_px2", field, None)));
    }
    if let Some(noise) = sensor.noise {
        all.extend([("read_noise_dn", noise.read_noise_dn, u_read), ("gain_dn", noise.gain_dn, u_gain)]);
    }
    all
}

/// Standard uncertainty of a parameter; `None` where it was held or is not in the covariance.
fn uncertainty(covariance: &Covariance, device: &str, name: &str) -> Option<f64> {
    let place = covariance.parameters.iter().position(|known| known == name)?;
    let part = covariance.part(&[device])?;
    let variance = part.get(place * covariance.parameters.len() + place)?;
    Some(variance.sqrt()).filter(|u| *u > 0.0)
}

fn quantity(xml: &mut Xml, name: &str, value: f64, unit: &str, expanded_u: Option<f64>) {
    xml.within("dcc:quantity", &[], |xml| {
        text(xml, "dcc:name", name);
        xml.within("si:real", &[], |xml| {
            xml.leaf("si:value", &value.to_string());
            xml.leaf("si:unit", unit);
            if let Some(u) = expanded_u {
                expanded(xml, u);
            }
        });
    });
}
