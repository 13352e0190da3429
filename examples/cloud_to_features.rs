//! From a cloud and an inspection plan to features with uncertainty; then one sphere fitted by hand:
//!
//!     cargo run --release --example cloud_to_features -- PLAN.toml CLOUD.ply

use files::plan_file::read_plan;
use metrology::fit::{Correlation, FitSettings, sphere};
use metrology::inspection::{Geometry, evaluate};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [plan, cloud] = arguments.as_slice() else {
        return Err("arguments: PLAN.toml CLOUD.ply".into());
    };
    let (plan, _) = read_plan(Path::new(plan))?;
    let points = files::ply::read_cloud(Path::new(cloud))?.points;

    let result = evaluate(&plan, &points);
    for feature in &result.features {
        match (feature.value, feature.u) {
            (Some(value), Some(u)) => {
                println!("{:<22} {value:10.4} ± {:.4} {} (k = 2)", feature.name, 2.0 * u, feature.unit);
            }
            _ => println!("{:<22} not measured", feature.name),
        }
    }

    // The same for one sphere alone, from the points around the place where the part was found.
    let place = result.alignment.ok_or("the part was not found")?.world_from_part();
    let spheres = plan.elements.iter().filter_map(|element| match element.geometry {
        Geometry::Sphere { center_mm, radius_mm, .. } => Some((place * center_mm, radius_mm)),
        _ => None,
    });
    let (center, radius_mm) = spheres.into_iter().next().ok_or("the plan has no sphere")?;
    let near = |p: &nalgebra::Point3<f64>| ((p - center).norm() - radius_mm).abs() < 0.3;
    let around: Vec<_> = points.iter().map(fringe::cloud::Point::position).filter(near).collect();
    let settings = FitSettings {
        max_reject_fraction: 0.003,
        correlation: Correlation::Estimated,
        ..FitSettings::default()
    };
    let fit = sphere(&around, &settings)?;
    println!("by hand: diameter {:.4} mm, u {:.4} mm", fit.diameter_mm, fit.u_diameter_mm);
    Ok(())
}
