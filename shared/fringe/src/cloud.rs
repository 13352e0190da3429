//! A point of a cloud, as laid out in shared memory.

use bytemuck::{Pod, Zeroable};
use nalgebra::{Point3, Vector3};

/// One measured point in the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Point {
    /// x, y, z in mm.
    pub position_mm: [f64; 3],
    /// Unit surface normal towards the cameras; zero where the neighbours do not give one.
    pub normal: [f32; 3],
    /// Standard uncertainty along the normal, mm, propagated from the phase noise.
    pub sigma_mm: f32,
    /// Modulation of the fringes, DN (the smaller one of the two views).
    pub modulation: f32,
    /// The pair that saw it, counted from 0 in the order of the rig file.
    pub pair: u32,
    /// Pixel of the left camera, row · width + column.
    pub pixel: u32,
    /// The part of `sigma_mm` that is no noise, so that points of one surface may have it in common: light from other faces,
    /// pairs that disagree. 0 as a rule.
    pub shared_mm: f32,
}

impl Point {
    /// Position in the world frame, mm.
    #[inline]
    pub fn position(&self) -> Point3<f64> {
        Point3::from(self.position_mm)
    }

    /// Normal, in double precision.
    #[inline]
    pub fn normal_vector(&self) -> Vector3<f64> {
        Vector3::from(self.normal.map(f64::from))
    }
}
