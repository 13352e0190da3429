//! Phase maps as a camera will measure them, with noise.

use super::conditions::Fringes;
use super::planner::Planner;
use super::view::View;
use fringe::math::random::{Key, Normal};
use fringe::pattern::Axis;
use fringe::phase::{PhaseInfo, PhaseMap};
use fringe::planning::geometry::{Place, projector_px_across};
use fringe::sensor::CameraNoise;
use nalgebra::{Point2, Point3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Separates the noise of predicted phases from other draws of a seed.
const PHASES: u64 = 0x7669_6577;

/// What one pixel will measure.
struct Measured {
    phase_rad: f64,
    sigma_rad: f64,
    modulation_dn: f64,
}

impl Planner {
    /// Phase maps of a pair: of the left and of the right camera (none with a projector that is read backwards), one for each axis. `None`
    /// where the rig does not state where the light comes from. A trial is one draw of the noise.
    pub fn phases(&self, pair: usize, trial: u64) -> Option<[Vec<PhaseMap>; 2]> {
        let views = self.pairs.get(pair)?;
        let projector = views.projector.as_ref()?;
        let of = |view: &View, side: usize| -> Vec<PhaseMap> {
            let one = |fringes: &Fringes| self.phase((view, projector), fringes, views.noise[side], trial);
            views.fringes.iter().map(one).collect()
        };
        Some([of(&views.left, 0), views.right.as_ref().map_or_else(Vec::new, |right| of(right, 1))])
    }

    /// The phase map of one camera under one projector.
    fn phase(
        &self,
        (view, projector): (&View, &View),
        fringes: &Fringes,
        noise: CameraNoise,
        trial: u64,
    ) -> PhaseMap {
        let (width_px, height_px) = (view.camera.width_px, view.camera.height_px);
        let info = PhaseInfo { width_px, height_px, axis: fringes.axis, period_px: fringes.period_px };
        let mut map = PhaseMap::new(info);
        let width = width_px as usize;
        let key = [&view.name, &projector.name].into_iter().flat_map(|name| name.bytes());
        let key = key.fold(Key::new(trial).with(PHASES), |key, byte| key.with(byte.into()));
        let key = key.with(u64::from(fringes.axis == Axis::Y));
        let normal = Normal::default();
        let rows = map
            .phase_rad
            .par_chunks_mut(width)
            .zip(map.sigma_rad.par_chunks_mut(width))
            .zip(map.modulation.par_chunks_mut(width))
            .zip(map.valid.par_chunks_mut(width));
        rows.enumerate().for_each(|(row, (((phases, sigmas), modulations), valid))| {
            for column in 0..width {
                let pixel = Point2::new(column as f64, row as f64);
                let Some(found) = self.measured(view, projector, fringes, noise, pixel) else { continue };
                let drawn = f64::from(normal.draw(key.bits((row * width + column) as u64)));
                phases[column] = (found.phase_rad + drawn * found.sigma_rad) as f32;
                sigmas[column] = found.sigma_rad as f32;
                modulations[column] = found.modulation_dn as f32;
                valid[column] = 1;
            }
        });
        map
    }

    fn measured(
        &self,
        view: &View,
        projector: &View,
        fringes: &Fringes,
        noise: CameraNoise,
        pixel: Point2<f64>,
    ) -> Option<Measured> {
        let ray = view.camera.ray(pixel)?;
        let (t_mm, triangle) = self.mesh.first_met(&ray.origin_mm, &ray.direction, 0.0)?;
        let at: Point3<f64> = ray.origin_mm + ray.direction * t_mm;
        let face = self.mesh.triangles()[triangle as usize].normal;
        // The back of a face of an open mesh is seen as well, and dark.
        if face.dot(&ray.direction) >= 0.0 {
            return None;
        }
        let light = projector.light(&self.mesh, &at, &face);
        if light <= 0.0 {
            return None;
        }
        let place = Place { at, normal: face };
        let across = projector_px_across(&view.camera, &projector.camera, fringes.axis, &place)?;
        let brightness = self.conditions.brightness(light, across, noise);
        let (modulation_dn, sigma_rad) = brightness.phase_noise(fringes.period_px, fringes.steps);
        let lit = projector.pixel(&at)?;
        let along_px = if fringes.axis == Axis::X { lit.x } else { lit.y };
        let usable = brightness.usable(&self.conditions.decode, modulation_dn, sigma_rad);
        usable.then_some(Measured { phase_rad: along_px * TAU / fringes.period_px, sigma_rad, modulation_dn })
    }
}
