//! How a surface reflects at a point.

use crate::checkerboard::Checkerboard;
use fringe::math::pow;
use fringe::math::random::Key;
use nalgebra::{Point3, Vector3};

/// A surface: Lambertian with a grainy albedo, and a specular lobe.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Lambertian reflectance, 0 … 1.
    pub albedo: f64,
    /// Relative amplitude of the albedo's texture.
    pub texture: f64,
    /// Grain of the texture, mm.
    pub texture_mm: f64,
    /// Strength of the specular lobe, in units of reflectance.
    pub specular: f64,
    /// Exponent of the specular lobe.
    pub shininess: f64,
    /// Squares on the face z = 0.
    pub checkerboard: Option<Checkerboard>,
    /// Stream of the texture.
    pub key: Key,
}

impl Surface {
    /// Albedo at a point of the body frame, without what is printed there.
    pub fn albedo_at(&self, p: &Point3<f64>) -> f64 {
        if self.texture <= 0.0 {
            return self.albedo;
        }
        self.albedo * (1.0 + self.texture * grain(self.key, &(p / self.texture_mm)))
    }

    /// What is printed at a point of the body frame.
    pub fn print_at(&self, p: &Point3<f64>) -> Option<&Checkerboard> {
        self.checkerboard.as_ref().filter(|_| p.z > -1e-6)
    }

    /// Reflectance times cosine for light from `to_light` seen from `to_eye` (unit vectors); zero from behind.
    ///
    /// `gloss` adds to the specular lobe. Lambert plus Blinn–Phong (Blinn, Models of light reflection, 1977), the lobe weighted with the cosine too.
    pub fn shade(
        &self,
        albedo: f64,
        normal: &Vector3<f64>,
        to_light: &Vector3<f64>,
        to_eye: &Vector3<f64>,
        gloss: f64,
    ) -> f64 {
        let cosine = normal.dot(to_light);
        if cosine <= 0.0 {
            return 0.0;
        }
        let lobe = match (to_light + to_eye).try_normalize(1e-12) {
            Some(half) if self.specular + gloss > 0.0 => {
                (self.specular + gloss) * pow(normal.dot(&half).max(0.0), self.shininess)
            }
            _ => 0.0,
        };
        cosine * (albedo + lobe)
    }
}

/// Solid value noise, −1 … 1: even draws on a unit lattice, smoothly interpolated (Perlin's 3t² − 2t³).
fn grain(key: Key, p: &Point3<f64>) -> f64 {
    let cell = p.map(f64::floor);
    let s = (p - cell).map(|t| t * t * (3.0 - 2.0 * t));
    let corner = |dx: i64, dy: i64, dz: i64| {
        let [x, y, z] = [cell.x as i64 + dx, cell.y as i64 + dy, cell.z as i64 + dz];
        key.symmetric(
            (x & 0x1f_ffff) as u64 | ((y & 0x1f_ffff) as u64) << 21 | ((z & 0x1f_ffff) as u64) << 42,
        )
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let along_x = |dy, dz| mix(corner(0, dy, dz), corner(1, dy, dz), s.x);
    let along_y = |dz| mix(along_x(0, dz), along_x(1, dz), s.y);
    mix(along_y(0), along_y(1), s.z)
}
