//! Tracing: per pixel, what a camera sees and where in each projector's image it lies. Done once per pose.

use crate::body::Hit;
use crate::light;
use crate::scene::Scene;
use crate::settings::TwinSettings;
use fringe::geometry::camera::Camera;
use fringe::math::random::Key;
use fringe::math::sincos;
use fringe::pattern::Axis;
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Separates the directions of the bounce from the other draws of a seed.
const BOUNCE: u64 = 4;

/// A ray that goes on from a surface starts so far above it, mm: beyond the rounding, below anything that is seen.
const BOUNCE_SKIN_MM: f64 = 1e-4;

/// Half step of the difference quotient along a ray, mm: its error is below 1e-8 of the slope.
const SLOPE_STEP_MM: f64 = 0.01;

/// What one projector does to one ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C)]
pub(crate) struct Lit {
    /// Projector column, fixed point.
    pub u: u32,
    /// Projector row, fixed point.
    pub v: u32,
    /// Light reflected to the camera per light sent; zero in the shadow.
    pub gain: f32,
    /// Blur by defocus, layers of [`light::LAYER_PX`].
    pub layer: f32,
}

impl Lit {
    /// The projector coordinate along an axis, fixed point.
    #[inline]
    pub fn along(&self, axis: Axis) -> u32 {
        if axis == Axis::X { self.u } else { self.v }
    }
}

/// How the projector coordinate of a ray changes when the part moves, px per mm in the world frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C)]
pub(crate) struct Sway {
    pub u: [f32; 3],
    pub v: [f32; 3],
}

impl Sway {
    /// How the coordinate along an axis changes.
    #[inline]
    pub fn along(&self, axis: Axis) -> &[f32; 3] {
        if axis == Axis::X { &self.u } else { &self.v }
    }
}

/// A camera or projector seen from the part.
#[derive(Debug, Clone)]
pub(crate) struct Placed {
    camera: Camera,
    part_from_camera: Matrix3<f64>,
    pub centre: Point3<f64>,
    /// Squared distance at which its light counts as 1, mm².
    pub reference_mm2: f64,
    /// Largest squared ideal radius that can lie on the chip; only a projector asks.
    reach2: f64,
}

impl Placed {
    pub fn new(camera: &Camera, world_from_part: &Isometry3<f64>, reference_mm: f64) -> Self {
        let mut camera = camera.clone();
        camera.camera_from_world *= world_from_part;
        let inverse = camera.camera_from_world.inverse();
        Self {
            part_from_camera: inverse.rotation.to_rotation_matrix().into_inner(),
            centre: Point3::from(inverse.translation.vector),
            reference_mm2: reference_mm * reference_mm,
            reach2: 0.0,
            camera,
        }
    }

    /// The same, prepared to project points onto its chip.
    pub fn projector(camera: &Camera, world_from_part: &Isometry3<f64>, reference_mm: f64) -> Self {
        Self { reach2: camera.reach2(), ..Self::new(camera, world_from_part, reference_mm) }
    }

    /// Direction of a pixel's ray in the part frame.
    pub fn direction(&self, x: f64, y: f64) -> Option<Vector3<f64>> {
        let ideal = self.camera.normalised_from_pixel(Point2::new(x, y))?;
        Some((self.part_from_camera * Vector3::new(ideal.x, ideal.y, 1.0)).normalize())
    }

    /// The shorter focal length.
    fn focal_px(&self) -> f64 {
        self.camera.focal_px[0].min(self.camera.focal_px[1])
    }

    /// Pixel of a point of the part frame, if it lies on the chip.
    pub fn pixel(&self, p: &Point3<f64>) -> Option<Point2<f64>> {
        let at = self.camera.camera_from_world * p;
        if at.x * at.x + at.y * at.y > self.reach2 * at.z * at.z {
            return None;
        }
        self.camera.project(p).filter(|q| self.camera.contains(*q))
    }
}

/// Place of ray `number` of n × n within its pixel, −½ … ½.
///
/// A grid that is turned a little: no two rays share a row or a column, so that an edge along either covers a pixel in n²
/// steps instead of n. With steps of a third of a pixel the corners of a board were off by 0.01 px, more than by all noise.
/// Every cell of the straight grid still holds one ray, the middle one of an odd n is the centre.
fn offset(number: usize, n: usize) -> [f64; 2] {
    let (column, row) = (number % n, number / n);
    let place =
        |cell: usize, within: usize| (cell as f64 + (within as f64 + 0.5) / n as f64) / n as f64 - 0.5;
    [place(column, row), place(row, n - 1 - column)]
}

/// Two unit vectors across a normal.
fn across(normal: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let least = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let side = normal.cross(&least).normalize();
    (side, normal.cross(&side))
}

/// The cell of the straight grid that ray `number` stands for: left, top, right and bottom of it in the image.
fn cell(number: usize, n: usize, x: usize, y: usize) -> [f64; 4] {
    let place = |pixel: usize, cell: usize| pixel as f64 + cell as f64 / n as f64 - 0.5;
    let (column, row) = (number % n, number / n);
    [place(x, column), place(y, row), place(x, column + 1), place(y, row + 1)]
}

/// A ray through a pixel.
struct Ray {
    /// Its place in the image.
    at: [f64; 2],
    /// The part of the pixel that it stands for.
    cell: [f64; 4],
}

/// One row of the planes.
pub(crate) struct Row<'a> {
    pub y: usize,
    pub ambient: &'a mut [f32],
    pub lit: &'a mut [Lit],
    pub sway: &'a mut [Sway],
    /// Light by way of another place, `bounce_rays` per pixel and projector.
    pub bounce: &'a mut [Lit],
}

/// Everything that tracing needs.
pub(crate) struct Tracer<'a> {
    pub scene: &'a Scene,
    pub camera: Placed,
    pub projectors: Vec<Placed>,
    pub world_from_part: Isometry3<f64>,
    pub settings: &'a TwinSettings,
}

impl Tracer<'_> {
    /// Fills all rows. Rows are independent, so the number of threads does not show.
    pub fn run(&self, rows: Vec<Row>) {
        rows.into_par_iter().for_each(|mut row| self.row(&mut row));
    }

    fn row(&self, row: &mut Row) {
        let n = self.settings.subsamples as usize;
        let projectors = self.projectors.len();
        for (index, ambient) in row.ambient.iter_mut().enumerate() {
            let (x, number) = (index / (n * n), index % (n * n));
            let lit = &mut row.lit[index * projectors..(index + 1) * projectors];
            let sway = row.sway.get_mut(index * projectors..(index + 1) * projectors).unwrap_or(&mut []);
            lit.fill(Lit::default());
            sway.fill(Sway::default());
            let [dx, dy] = offset(number, n);
            let ray = Ray { at: [x as f64 + dx, row.y as f64 + dy], cell: cell(number, n, x, row.y) };
            *ambient = self.sample(&ray, lit, sway);
        }
        let rays = self.settings.bounce_rays as usize;
        for (x, bounce) in row.bounce.chunks_mut((rays * projectors).max(1)).enumerate() {
            bounce.fill(Lit::default());
            self.bounce(x, row.y, bounce);
        }
    }

    /// The first bounce: rays of sight go on from where they meet the part, spread with the cosine, so that each carries the same share of
    /// the light that falls in from there; the receiving place counts as matt.
    fn bounce(&self, x: usize, y: usize, out: &mut [Lit]) {
        let Some(direction) = self.camera.direction(x as f64, y as f64) else { return };
        let Some(hit) = self.scene.first_hit(&self.camera.centre, &direction) else { return };
        let body = self.scene.body(hit.body);
        let albedo = body.surface.albedo_at(&body.local(&hit.point_mm));
        let count = f64::from(self.settings.bounce_rays);
        let key = Key::new(self.settings.seed).with(BOUNCE).with(y as u64).with(x as u64);
        let (side, other) = across(&hit.normal);
        let start = hit.point_mm + hit.normal * BOUNCE_SKIN_MM;
        for (ray, lit) in out.chunks_mut(self.projectors.len()).enumerate() {
            let share = (ray as f64 + 0.5 + 0.5 * key.symmetric(2 * ray as u64)) / count;
            let (sin, cos) = sincos(PI * key.symmetric(2 * ray as u64 + 1));
            let (flat, up) = (share.sqrt(), (1.0 - share).sqrt());
            let towards = side * (flat * cos) + other * (flat * sin) + hit.normal * up;
            let Some(source) = self.scene.first_hit(&start, &towards) else { continue };
            let body = self.scene.body(source.body);
            let own = body.surface.albedo_at(&body.local(&source.point_mm));
            for (lit, projector) in lit.iter_mut().zip(&self.projectors) {
                if let Some(found) = self.lit(projector, &source, own, &-towards) {
                    *lit = Lit { gain: (f64::from(found.gain) * albedo / count) as f32, ..found };
                }
            }
        }
    }

    /// What a projector does to a place of the part that is seen in a direction; `None` in the shadow.
    fn lit(&self, projector: &Placed, hit: &Hit, albedo: f64, to_eye: &Vector3<f64>) -> Option<Lit> {
        let way = projector.centre - hit.point_mm;
        let distance_mm2 = way.norm_squared();
        let surface = &self.scene.body(hit.body).surface;
        let to_light = way / distance_mm2.sqrt();
        let shade = surface.shade(albedo, &hit.normal, &to_light, to_eye, self.settings.gloss);
        if shade <= 0.0 {
            return None;
        }
        let at = projector.pixel(&hit.point_mm)?;
        if self.scene.is_shadowed(hit, &projector.centre) {
            return None;
        }
        let gain = (shade * projector.reference_mm2 / distance_mm2) as f32;
        let out_of_focus_mm = (distance_mm2.sqrt() - projector.reference_mm2.sqrt()).abs();
        let layer = (self.settings.defocus_px_per_mm * out_of_focus_mm / light::LAYER_PX) as f32;
        Some(Lit { u: light::fixed(at.x), v: light::fixed(at.y), gain, layer })
    }

    /// Whether the first projector lights what a pixel sees; `None` beside the part.
    pub fn is_lit(&self, x: f64, y: f64) -> Option<bool> {
        let direction = self.camera.direction(x, y)?;
        let hit = self.scene.first_hit(&self.camera.centre, &direction)?;
        let lit = |projector: &Placed| self.lit(projector, &hit, 1.0, &-direction).is_some();
        Some(self.projectors.first().is_some_and(lit))
    }

    /// Traces one ray; returns the albedo, zero where it meets nothing.
    fn sample(&self, ray: &Ray, lit: &mut [Lit], sway: &mut [Sway]) -> f32 {
        let Some(direction) = self.camera.direction(ray.at[0], ray.at[1]) else { return 0.0 };
        let Some(hit) = self.scene.first_hit(&self.camera.centre, &direction) else { return 0.0 };
        let albedo = self.albedo(ray, &hit, &direction);
        for (index, projector) in self.projectors.iter().enumerate() {
            let Some(found) = self.lit(projector, &hit, albedo, &-direction) else { continue };
            lit[index] = found;
            if let Some(sway) = sway.get_mut(index) {
                *sway = self.sway(projector, &hit.point_mm, &hit.normal, &direction);
            }
        }
        albedo as f32
    }

    /// Albedo of what a ray meets. Prints are averaged over the ray's cell of the pixel, where there is more than one: an
    /// edge that passes rays one by one moves in steps, and with 5 × 5 rays the corners of a board were off by as much as
    /// by all noise.
    fn albedo(&self, ray: &Ray, hit: &Hit, direction: &Vector3<f64>) -> f64 {
        let body = self.scene.body(hit.body);
        let p = body.local(&hit.point_mm);
        let albedo = body.surface.albedo_at(&p);
        let Some(print) = body.surface.print_at(&p) else { return albedo };
        let averaged = || {
            // The half diagonal of the cell is 0.71 of its side; the rest covers a ray beside its middle, and distortion.
            let slant =
                hit.normal.dot(direction).abs() * self.settings.subsamples as f64 * self.camera.focal_px();
            if self.settings.subsamples == 1 || !print.changes_within(p.x, p.y, 2.5 * hit.t_mm / slant) {
                return None;
            }
            print.mean_factor(&self.footprint(ray, hit)?)
        };
        albedo * averaged().unwrap_or_else(|| print.factor(p.x, p.y))
    }

    /// Corners of a ray's cell on the tangent plane of what it meets, body frame, mm; `None` where the plane is seen edge-on.
    fn footprint(&self, ray: &Ray, hit: &Hit) -> Option<[Point2<f64>; 4]> {
        let body = self.scene.body(hit.body);
        let [left, top, right, bottom] = ray.cell;
        let depth = hit.normal.dot(&(hit.point_mm - self.camera.centre));
        let mut corners = [Point2::origin(); 4];
        for (corner, (x, y)) in
            corners.iter_mut().zip([(left, top), (right, top), (right, bottom), (left, bottom)])
        {
            let direction = self.camera.direction(x, y)?;
            let t_mm = depth / hit.normal.dot(&direction);
            if !(t_mm > 0.0 && t_mm < 2.0 * hit.t_mm) {
                return None;
            }
            *corner = body.local(&(self.camera.centre + direction * t_mm)).xy();
        }
        Some(corners)
    }

    /// The part moves by δ; the ray then meets the displaced face at t + n·δ / n·d, to first order.
    fn sway(&self, projector: &Placed, p: &Point3<f64>, normal: &Vector3<f64>, d: &Vector3<f64>) -> Sway {
        let step = d * SLOPE_STEP_MM;
        let (Some(far), Some(near)) =
            (projector.camera.project(&(p + step)), projector.camera.project(&(p - step)))
        else {
            return Sway::default();
        };
        let slope = (far - near) / (2.0 * SLOPE_STEP_MM);
        let along_normal = self.world_from_part.rotation * normal / normal.dot(d);
        let of = |rate: f64| (along_normal * rate).map(|c| c as f32).into();
        Sway { u: of(slope.x), v: of(slope.y) }
    }
}

#[cfg(test)]
mod tests {
    use super::offset;

    /// Moments of the footprint, and the steps in which an edge covers it.
    #[test]
    fn rays_cover_the_pixel_evenly() {
        for n in 1..=8 {
            let rays: Vec<[f64; 2]> = (0..n * n).map(|s| offset(s, n)).collect();
            let count = rays.len() as f64;
            let mean = |of: fn(&[f64; 2]) -> f64| rays.iter().map(of).sum::<f64>() / count;
            assert!(mean(|r| r[0]).abs() < 1e-12 && mean(|r| r[1]).abs() < 1e-12);
            assert!(mean(|r| r[0] * r[1]).abs() < 1e-12);
            // Variance of n² even steps, 1/12 (1 − 1/n⁴).
            let variance = (1.0 - count.powi(-2)) / 12.0;
            assert!((mean(|r| r[0] * r[0]) - variance).abs() < 1e-12);
            assert!((mean(|r| r[1] * r[1]) - variance).abs() < 1e-12);
            for axis in 0..2 {
                let mut places: Vec<f64> = rays.iter().map(|r| r[axis]).collect();
                places.sort_by(f64::total_cmp);
                assert!(places.windows(2).all(|w| (w[1] - w[0] - 1.0 / count).abs() < 1e-12));
            }
        }
        assert_eq!(offset(0, 1), [0.0, 0.0]);
        assert!(offset(4, 3).iter().all(|v| v.abs() < 1e-12));
    }
}
