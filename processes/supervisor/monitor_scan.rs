//! The scan that the monitor shows: pictures, phase maps and cloud of the snapshot, reduced to what a page can draw.
//!
//! This runs in the supervisor, which alone holds the shared memory, and only while somebody looks at the page.

use super::snapshot::{CameraImage, Snapshot};
use crate::feed::{MAX_EDGE, MAX_POINTS, RasterHeader, Scan, ScanHeader};
use fringe::cloud::Point;
use fringe::phase::{PhaseInfo, PhaseMap, PhaseView};
use ipc::header::Phase;
use ipc::payload;
use ipc::port::Received;

impl Snapshot {
    /// What there is to show after the cycle of this number.
    pub fn scan(&self, number: u64) -> Scan {
        let (cloud_number, all) = match &self.cloud {
            Some(cloud) => (cloud.wire_cycle(), cloud.points().unwrap_or_default()),
            None => (0, &[][..]),
        };
        let points = every(all, MAX_POINTS);
        let mut scan = Scan {
            header: ScanHeader {
                number,
                cloud_number,
                points: points.len(),
                all_points: all.len(),
                ..ScanHeader::default()
            },
            points,
            ..Scan::default()
        };
        for (&(camera, projector), image) in &self.images {
            scan.header.pictures.push(picture_header(image, camera, projector));
            scan.pictures.push(reduced(&image.values, image.width_px, image.height_px));
        }
        for (header, map) in self.maps.values().filter_map(reduced_map) {
            scan.header.maps.push(header);
            scan.maps.push(map);
        }
        scan
    }
}

/// Every n-th point, so that at most `limit` are left.
fn every(points: &[Point], limit: usize) -> Vec<Point> {
    let step = points.len().div_ceil(limit).max(1);
    points.iter().step_by(step).copied().collect()
}

/// Every n-th pixel is left of a raster of this size.
fn step(width_px: u32, height_px: u32) -> u32 {
    width_px.max(height_px).div_ceil(MAX_EDGE).max(1)
}

/// A plane with every n-th column and row.
fn reduced<T: Copy>(values: &[T], width_px: u32, height_px: u32) -> Vec<T> {
    let step = step(width_px, height_px) as usize;
    let rows = values.chunks_exact((width_px as usize).max(1)).step_by(step);
    rows.flat_map(|row| row.iter().step_by(step).copied()).collect()
}

fn raster_header(
    number: u64,
    (camera, projector): (u32, u32),
    (width_px, height_px): (u32, u32),
) -> RasterHeader {
    let step = step(width_px, height_px);
    RasterHeader {
        number,
        camera,
        projector,
        axis: 0,
        width_px: width_px.div_ceil(step),
        height_px: height_px.div_ceil(step),
        step,
        period_px: 0.0,
    }
}

fn picture_header(image: &CameraImage, camera: u32, projector: u32) -> RasterHeader {
    raster_header(image.cycle, (camera, projector), (image.width_px, image.height_px))
}

fn reduced_map(message: &Received<Phase>) -> Option<(RasterHeader, PhaseMap)> {
    let header = message.header();
    let PhaseView { info, phase_rad, sigma_rad, modulation, valid } =
        payload::phase(header, message.payload()).ok()?;
    let (width_px, height_px) = (info.width_px, info.height_px);
    let raster = RasterHeader {
        axis: header.axis,
        period_px: info.period_px,
        ..raster_header(header.cycle, (header.camera, header.projector), (width_px, height_px))
    };
    let plane = |values: &[f32]| reduced(values, width_px, height_px);
    let map = PhaseMap {
        info: PhaseInfo { width_px: raster.width_px, height_px: raster.height_px, ..info },
        phase_rad: plane(phase_rad),
        sigma_rad: plane(sigma_rad),
        modulation: plane(modulation),
        valid: reduced(valid, width_px, height_px),
    };
    Some((raster, map))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_raster_keeps_every_nth_pixel_and_a_small_one_all() {
        assert_eq!(reduced(&[1, 2, 3, 4, 5, 6], 3, 2), [1, 2, 3, 4, 5, 6]);
        let (width_px, height_px) = (2 * MAX_EDGE - 1, 3);
        let values: Vec<u32> = (0..width_px * height_px).collect();
        let header = raster_header(1, (0, 0), (width_px, height_px));
        let left = reduced(&values, width_px, height_px);
        assert_eq!((header.width_px, header.height_px, header.step), (MAX_EDGE, 2, 2));
        assert_eq!(left.len() as u32, header.width_px * header.height_px);
        assert_eq!((left[1], left[header.width_px as usize]), (2, 2 * width_px));
        assert_eq!(reduced::<u8>(&[], 0, 0), [] as [u8; 0]);
    }

    #[test]
    fn a_large_cloud_keeps_as_many_points_as_may_be() {
        let points: Vec<Point> =
            (0..10).map(|n| Point { pixel: n, ..bytemuck::Zeroable::zeroed() }).collect();
        let left = |limit| every(&points, limit).iter().map(|point| point.pixel).collect::<Vec<_>>();
        assert_eq!(left(10).len(), 10);
        assert_eq!(left(9), [0, 2, 4, 6, 8]);
        assert_eq!(left(3), [0, 4, 8]);
        assert!(every(&[], 3).is_empty());
    }
}
