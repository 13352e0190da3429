//! Which points of the cloud the fit gets.

use super::{Args, Element};
use anyhow::{Context, Result, bail};
use files::ply::Cloud;
use metrology::fit;
use nalgebra::Point3;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// A ball that limits the region.
#[derive(Clone, Copy, Debug)]
pub struct Near {
    center_mm: Point3<f64>,
    radius_mm: f64,
}

impl fmt::Display for Near {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z]: [f64; 3] = self.center_mm.into();
        write!(f, "within {} mm of ({x}, {y}, {z}) mm", self.radius_mm)
    }
}

impl FromStr for Near {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text)?.as_slice() {
            [x, y, z, r] if *r > 0.0 => Ok(Self { center_mm: Point3::new(*x, *y, *z), radius_mm: *r }),
            _ => Err("four finite numbers x,y,z,r in mm, r above 0".into()),
        }
    }
}

/// A box along the axes that limits the region.
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    low_mm: Point3<f64>,
    high_mm: Point3<f64>,
}

impl Corners {
    fn holds(&self, point: &Point3<f64>) -> bool {
        (0..3).all(|axis| (self.low_mm[axis]..=self.high_mm[axis]).contains(&point[axis]))
    }
}

impl fmt::Display for Corners {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([a, b, c], [x, y, z]): ([f64; 3], [f64; 3]) = (self.low_mm.into(), self.high_mm.into());
        write!(f, "{:.0} × {:.0} × {:.0} mm: ({a}, {b}, {c}) to ({x}, {y}, {z}) mm", x - a, y - b, z - c)
    }
}

impl FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text)?.as_slice() {
            [a, b, c, x, y, z] if a < x && b < y && c < z => {
                Ok(Self { low_mm: Point3::new(*a, *b, *c), high_mm: Point3::new(*x, *y, *z) })
            }
            _ => Err("six finite numbers x0,y0,z0,x1,y1,z1 in mm, the low corner first".into()),
        }
    }
}

/// Finite numbers parted by commas.
fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let one = |part: &str| {
        let number = part.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| format!("\"{part}\" is not a finite number"))
    };
    text.split(',').map(one).collect()
}

/// Whether a point lies in both limits.
pub fn within(near: Option<Near>, corners: Option<Corners>, point: &Point3<f64>) -> bool {
    near.is_none_or(|near| (point - near.center_mm).norm() <= near.radius_mm)
        && corners.is_none_or(|limits| limits.holds(point))
}

/// What the search left out.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Left {
    /// Points of the region that lie farther than `--within` from the element found; absent without a search.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outside_margin: Option<usize>,
}

/// The points that a fit gets.
pub struct Chosen {
    /// Positions of these points, mm.
    pub points: Vec<Point3<f64>>,
    /// What the error of each may have in common with others, mm.
    pub shared_mm: Vec<f32>,
    /// What the search left out.
    pub left: Left,
}

/// The points of the region, and what the search left out of it.
pub fn choose(args: &Args, cloud: &Cloud) -> Result<Chosen> {
    let held = cloud.points.iter().filter(|p| within(args.near, args.corners, &p.position()));
    let (points, shared_mm): (Vec<Point3<f64>>, Vec<f32>) = held.map(|p| (p.position(), p.shared_mm)).unzip();
    if points.is_empty() {
        bail!(
            "{}: no point within --near and --box (the cloud has {})",
            args.cloud.display(),
            cloud.points.len()
        );
    }
    let Some(margin_mm) = args.within else { return Ok(Chosen { points, shared_mm, left: Left::default() }) };
    let held = match args.element {
        Element::Plane => fit::find_plane(&points, margin_mm),
        _ => fit::find_sphere(&points, args.given_diameter_mm(), margin_mm),
    }
    .with_context(|| format!("{}: --within", args.cloud.display()))?;
    let total = points.len();
    let all = points.into_iter().zip(shared_mm).zip(held);
    let (points, shared_mm): (Vec<_>, Vec<_>) = all.filter(|(_, held)| *held).map(|(one, _)| one).unzip();
    let left = Left { outside_margin: Some(total - points.len()) };
    Ok(Chosen { points, shared_mm, left })
}
