//! Views at angles, and axes, as the command line gives them.

use crate::progress::Progress;
use crate::surface::read_cloud;
use anyhow::{Context, Result, bail};
use characterise::rotation_stage::StageAxis;
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use metrology::reference::{CloudReference, Reference};
use metrology::register::{InitialPose, RegisterSettings, Registration, register};
use nalgebra::{Point3, Vector3};
use std::path::PathBuf;
use std::str::FromStr;

/// A cloud and the angle of the stage at which it was taken: `ANGLE=FILE`.
#[derive(Debug, Clone)]
pub struct ViewArg {
    /// Angle of the stage, degrees.
    pub angle_deg: f64,
    /// File of the cloud.
    pub path: PathBuf,
}

impl FromStr for ViewArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (angle, path) = text.split_once('=').ok_or("must be ANGLE=FILE, as in 30=view-030.ply")?;
        let angle_deg: f64 =
            angle.trim().parse().map_err(|_| format!("\"{angle}\" is not an angle in degrees"))?;
        if !angle_deg.is_finite() {
            return Err(format!("{angle} must be finite"));
        }
        Ok(Self { angle_deg, path: path.into() })
    }
}

/// An axis given as `x,y,z,dx,dy,dz`.
#[derive(Debug, Clone, Copy)]
pub struct Axis(pub StageAxis);

impl FromStr for Axis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
        let all = text.split(',').count() == 6 && numbers.len() == 6 && numbers.iter().all(|v| v.is_finite());
        let direction = if all { Vector3::new(numbers[3], numbers[4], numbers[5]) } else { Vector3::zeros() };
        let direction = direction
            .try_normalize(1e-12)
            .ok_or("must be six numbers x,y,z,dx,dy,dz, the direction not zero")?;
        Ok(Self(StageAxis { point_mm: Point3::new(numbers[0], numbers[1], numbers[2]), direction }))
    }
}

/// A view that was read.
pub struct View {
    /// File name, for messages.
    pub name: String,
    /// Angle of the stage as given, degrees.
    pub angle_deg: f64,
    /// Angle of the stage, rad.
    pub angle_rad: f64,
    /// Points in the frame of the sensor, mm.
    pub points: Vec<Point>,
}

/// Reads the clouds of all views.
pub fn read(views: &[ViewArg]) -> Result<Vec<View>> {
    let mut progress = Progress::new(views.len(), "reading");
    let mut all = Vec::new();
    for view in views {
        let cloud = read_cloud(&view.path)?;
        let name = view.path.display().to_string();
        let angle_deg = view.angle_deg;
        all.push(View { name, angle_deg, angle_rad: angle_deg.to_radians(), points: cloud.points });
        progress.step();
    }
    Ok(all)
}

/// Mean of the positions.
pub fn middle(points: &[Point]) -> Point3<f64> {
    let sum: Vector3<f64> = points.iter().map(|p| p.position().coords).sum();
    Point3::from(sum / points.len().max(1) as f64)
}

/// Brings a view, which `start` puts about where it belongs, onto points that are there already.
pub fn onto(view: &View, there: &[Point], start: InitialPose, reach_mm: Option<f64>) -> Result<Registration> {
    let reference = CloudReference::new(there, Vector3::z(), None).context("the views before it")?;
    let settings = RegisterSettings { reach_mm, ..RegisterSettings::default() };
    register(&view.points, &Reference::Cloud(reference.with_normals()), &start, &settings)
        .with_context(|| view.name.clone())
}

/// Whether an alignment may replace the motion about the axis.
pub fn trusted(found: &Registration) -> bool {
    found.converged && found.undetermined.is_empty()
}

/// Refuses a motion from ICP that is far from the motion about the axis.
pub fn check_near(found: &Pose, expected: &Pose, at: &Point3<f64>, limit_mm: f64, name: &str) -> Result<f64> {
    let apart_mm = (found.point(&at.coords) - expected.point(&at.coords)).norm();
    if apart_mm > limit_mm {
        bail!(
            "{name}: the alignment moves the view by {apart_mm:.3} mm from its place by the axis, limit {limit_mm} mm; check the angle, and that the axis is that of this stage"
        );
    }
    Ok(apart_mm)
}
