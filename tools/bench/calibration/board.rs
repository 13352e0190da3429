//! A checkerboard before the twin's cell: frames in memory, through the same detection, decoding and reading as
//! `calibrate`; and the same without images, from drawn errors.

use super::super::scan::decode_with;
use crate::calibrate::projector_reading::{decoding, index, pitch_px};
use crate::numbers::within;
use crate::simulate::Buffer;
use anyhow::{Context, Result};
use characterise::calibration::{Device, DeviceKind, ImagePoint, Observations, View, projector_pixel};
use characterise::target::{Detection, TargetSettings, TargetSpec, detect};
use files::document::Document;
use files::scene_file::parse_scene;
use files::target_file::parse_target;
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use fringe::math::random::{Key, Normal};
use fringe::pattern::{Axis, PatternSet, frame_count};
use nalgebra::{Isometry3, Matrix2, Point2, Point3, Translation3, Vector2, Vector3};
use serde::Serialize;
use std::time::{Duration, Instant};
use twin::{Scene, Twin, TwinSettings, thesis};

/// Turn of the boards about their normal, ± rad.
const TURN_RAD: f64 = 0.6;
/// Within this distance of the rim of an image a corner's window does not fit, px.
const RIM_PX: f64 = 8.0;

/// The board and its poses.
#[derive(Debug, Clone, clap::Args, Serialize)]
pub struct Plan {
    /// Inner corners along x.
    #[arg(long, value_name = "N", default_value_t = 14, value_parser = clap::value_parser!(u32).range(3..=200))]
    pub columns: u32,
    /// Inner corners along y.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(3..=200))]
    pub rows: u32,
    /// Side of a square.
    #[arg(long, value_name = "MM", default_value_t = 8.0, value_parser = |text: &str| within(text, 0.1..=1000.0))]
    pub pitch_mm: f64,
    /// Relative amplitude of the paper's grain of half a millimetre.
    #[arg(long, value_name = "F", default_value_t = 0.0, value_parser = |text: &str| within(text, 0.0..=1.0))]
    pub grain: f64,
    /// Poses of the board.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(3..=1000))]
    pub poses: usize,
    /// Tilt of the boards about their x and y axes, ± degrees.
    #[arg(long, value_name = "DEG", default_value_t = 26.0, value_parser = |text: &str| within(text, 0.0..=80.0))]
    pub tilt_deg: f64,
    /// Places of the board's middle about that of the volume, ± mm along each axis.
    #[arg(long, value_name = "MM", default_value_t = 32.0, value_parser = |text: &str| within(text, 0.0..=10_000.0))]
    pub spread_mm: f64,
}

impl Plan {
    /// The target as `calibrate` reads it.
    fn spec(&self) -> Result<TargetSpec> {
        let Self { columns, rows, pitch_mm, .. } = self;
        let text =
            format!("kind = \"checkerboard\"\ncolumns = {columns}\nrows = {rows}\npitch_mm = {pitch_mm:?}\n");
        Ok(parse_target(&Document { path: "board".into(), text })?)
    }

    /// A board of paper with a margin of a square and a half beyond its outer corners' squares.
    fn scene(&self) -> Result<Scene> {
        let Self { columns, rows, pitch_mm, grain, .. } = self;
        let size = |count: u32| f64::from(count + 3) * pitch_mm;
        let text = format!(
            "format = \"fringecell-scene/1\"\nname = \"checkerboard\"\n[[material]]\nname = \"paper\"\nalbedo = 0.75\n\
             texture = {grain:?}\ntexture_mm = 0.5\n[[body]]\nname = \"board\"\nmaterial = \"paper\"\n\
             geometry = {{ shape = \"plane\", size_mm = [{:?}, {:?}], thickness_mm = 5.0, \
             checkerboard = {{ columns = {columns}, rows = {rows}, pitch_mm = {pitch_mm:?}, dark = 0.1 }} }}\n",
            size(*columns),
            size(*rows)
        );
        Ok(parse_scene(&Document { path: "board".into(), text })?)
    }

    /// Seeded poses of the board's middle all over the volume: world_from_board.
    pub fn boards(&self, seed: u64, count: usize) -> Vec<Isometry3<f64>> {
        let key = Key::new(seed).with(11);
        let tilt = self.tilt_deg.to_radians();
        let one = |pose: usize| {
            let any = |i: u64, half: f64| key.with(pose as u64).symmetric(i) * half;
            let turned = twin::pose::rotation([any(0, tilt), any(1, tilt), any(2, TURN_RAD)]);
            let at = Vector3::from(thesis::VOLUME_CENTRE_MM)
                + Vector3::from_fn(|i, _| any(3 + i as u64, self.spread_mm));
            Isometry3::from_parts(Translation3::from(at), turned)
        };
        (0..count).map(one).collect()
    }

    /// A corner in the frame of the twin's board; `turned` reads its numbering from the opposite end. Rows run against y,
    /// since a target is numbered as it is seen from its front.
    fn corner(&self, (column, row): (u32, u32), turned: bool) -> Point3<f64> {
        let place = |at: u32, count: u32| (f64::from(at) - 0.5 * f64::from(count - 1)) * self.pitch_mm;
        let (x, y) = (place(column, self.columns), -place(row, self.rows));
        if turned { Point3::new(-x, -y, 0.0) } else { Point3::new(x, y, 0.0) }
    }
}

/// Where a corner was found, beside where it truly is.
#[derive(Debug, Clone, Copy)]
pub struct CornerError {
    /// Index of the device: cameras, then projectors.
    pub device: usize,
    /// Index of the pose.
    pub pose: usize,
    /// Column and row on the target.
    pub index: (u32, u32),
    /// Found − true, px.
    pub error_px: Vector2<f64>,
    /// Standard deviations that the detection states, px.
    pub stated_px: Vector2<f64>,
}

/// Simulated views of all poses, with their errors.
pub struct SimulatedViews {
    /// As the adjustment takes it.
    pub observations: Observations,
    /// Error of each image point, in their order, px.
    pub errors: Vec<CornerError>,
    /// Time of all detections.
    pub detection: Duration,
    /// Images that were searched.
    pub images: usize,
}

/// The cell that is known exactly.
pub struct Cell {
    /// True cameras, projectors and pairs.
    pub rig: Rig,
    /// The board and its poses.
    pub plan: Plan,
    scene: Scene,
    spec: TargetSpec,
    sequence: Vec<PatternSet>,
    subsamples: u32,
}

impl Cell {
    /// The thesis' cell at 1124 × 750.
    ///
    /// # Errors
    /// A board that cannot be.
    pub fn new(plan: Plan, subsamples: u32) -> Result<Self> {
        let (scene, spec) = (plan.scene()?, plan.spec()?);
        Ok(Self { rig: thesis::rig(1124, 750), plan, scene, spec, sequence: sequence(), subsamples })
    }

    /// All devices: cameras, then projectors.
    pub fn devices(&self) -> Vec<&Camera> {
        self.rig.cameras.iter().chain(&self.rig.projectors).map(|n| &n.camera).collect()
    }

    /// Names and sizes, cameras, then projectors; no view yet.
    fn empty(&self, poses: usize) -> Observations {
        let kinds = [(DeviceKind::Camera, &self.rig.cameras), (DeviceKind::Projector, &self.rig.projectors)];
        let device = |(kind, n): (DeviceKind, &fringe::geometry::rig::Named)| Device {
            name: n.name.clone(),
            kind,
            width_px: n.camera.width_px,
            height_px: n.camera.height_px,
        };
        Observations {
            devices: kinds.iter().flat_map(|(kind, list)| list.iter().map(|n| device((*kind, n)))).collect(),
            target_mm: self.spec.board_points_mm().into_iter().map(|(_, point)| point).collect(),
            faces: Vec::new(),
            poses: (1..=poses).map(|i| format!("pose{i}")).collect(),
            views: Vec::new(),
        }
    }

    /// Renders, detects and decodes all poses.
    pub fn look(
        &self,
        boards: &[Isometry3<f64>],
        seed: u64,
        step: &mut dyn FnMut(),
    ) -> Result<SimulatedViews> {
        let observations = self.empty(boards.len());
        let mut seen =
            SimulatedViews { observations, errors: Vec::new(), detection: Duration::ZERO, images: 0 };
        for (pose, board) in boards.iter().enumerate() {
            let settings = TwinSettings {
                seed: seed.wrapping_mul(1000).wrapping_add(pose as u64),
                subsamples: self.subsamples,
                position_scatter_mm: 0.0,
                angle_scatter_deg: 0.0,
                // A board stands on the table; a part hangs in a gripper.
                vibration_um: 0.0,
                ..TwinSettings::default()
            };
            let rig = moved(&self.rig, board);
            let twin = Twin::new(&self.scene, settings, &rig)?;
            for pair in &self.rig.pairs {
                self.look_at(&twin, pair, (pose, board), &mut seen)?;
                step();
            }
        }
        Ok(seen)
    }

    /// Both cameras of a pair, and their projector as measured through the camera that found more corners.
    fn look_at(
        &self,
        twin: &Twin,
        pair: &Pair,
        (pose, board): (usize, &Isometry3<f64>),
        seen: &mut SimulatedViews,
    ) -> Result<()> {
        let mut best: Option<(&str, Detection)> = None;
        for name in [&pair.left, &pair.right] {
            let view = twin.view_lit_by(name, &[&pair.projector], 0)?;
            let mut buffer = Buffer::new(&view);
            view.render(&pair.projector, &[PatternSet::White {}], 0, buffer.pixels_mut())?;
            let started = Instant::now();
            let found = detect(&buffer.frame(&view), &self.spec, &TargetSettings::default());
            seen.detection += started.elapsed();
            seen.images += 1;
            let Ok(detection) = found else { continue };
            let image_points = detection.points.iter().map(|p| {
                let (pixel, covariance_px2) = (p.pixel, p.covariance_px2);
                (p.index, ImagePoint { index: index(&detection, p.index), pixel, covariance_px2, link: None })
            });
            self.add(seen, name, (pose, board), image_points.collect());
            if best.as_ref().is_none_or(|(_, other)| other.points.len() < detection.points.len()) {
                best = Some((name, detection));
            }
        }
        let Some((camera, detection)) = best else { return Ok(()) };
        let maps = decode_with(twin, (camera, &pair.projector), &self.rig, &self.sequence, 0, &decoding())?;
        let map = |axis| maps.iter().find(|m| m.info.axis == axis).context("both axes were decoded");
        let (x, y) = (map(Axis::X)?, map(Axis::Y)?);
        let device = self.rig.cameras.iter().position(|c| c.name == camera).context("a camera of the rig")?;
        let image_points = detection.points.iter().filter_map(|point| {
            let radius_px = pitch_px(&detection, point.index)?;
            let read = projector_pixel(&x.view(), &y.view(), point.pixel, radius_px, point.blur_px)?;
            Some((
                point.index,
                read.image_point(index(&detection, point.index), device, &point.covariance_px2),
            ))
        });
        self.add(seen, &pair.projector, (pose, board), image_points.collect());
        Ok(())
    }

    /// Adds a view and the error of each of its image points.
    fn add(
        &self,
        seen: &mut SimulatedViews,
        name: &str,
        (pose, board): (usize, &Isometry3<f64>),
        image_points: Vec<((u32, u32), ImagePoint)>,
    ) {
        let Some(device) = seen.observations.devices.iter().position(|d| d.name == name) else { return };
        let camera = self.devices()[device];
        let error = |index: (u32, u32), pixel: Point2<f64>, turned: bool| {
            camera.project(&(board * self.plan.corner(index, turned))).map(|truth| pixel - truth)
        };
        // Colours identify the ends, but the twin numbers the squares itself.
        let far = |turned: bool| -> f64 {
            image_points.iter().filter_map(|(i, s)| error(*i, s.pixel, turned)).map(|e| e.norm()).sum()
        };
        let turned = far(true) < far(false);
        for (index, image_point) in &image_points {
            let Some(error_px) = error(*index, image_point.pixel, turned) else { continue };
            let c = &image_point.covariance_px2;
            let stated_px = Vector2::new(c.m11.sqrt(), c.m22.sqrt());
            seen.errors.push(CornerError { device, pose, index: *index, error_px, stated_px });
        }
        let image_points: Vec<ImagePoint> =
            image_points.into_iter().map(|(_, image_point)| image_point).collect();
        if image_points.len() >= 6 {
            seen.observations.views.push(View { device, pose, image_points, may_be_turned: false });
        }
    }

    /// The same poses without images: true pixels with independent errors of the devices' standard deviations.
    pub fn draw(&self, boards: &[Isometry3<f64>], seed: u64, noise_px: &[f64]) -> Observations {
        let normal = Normal::default();
        let mut observations = self.empty(boards.len());
        for (pose, board) in boards.iter().enumerate() {
            for (device, (camera, sd)) in self.devices().into_iter().zip(noise_px).enumerate() {
                let key = Key::new(seed).with(7).with(pose as u64).with(device as u64);
                let image_points: Vec<ImagePoint> = (0..self.plan.columns * self.plan.rows)
                    .filter_map(|i| {
                        let index = (i % self.plan.columns, i / self.plan.columns);
                        let pixel = camera.project(&(board * self.plan.corner(index, false)))?;
                        let draw = |n: u32| f64::from(normal.draw(key.bits(u64::from(2 * i + n)))) * sd;
                        let rim = |at: f64, size: u32| (RIM_PX..f64::from(size) - RIM_PX).contains(&at);
                        (rim(pixel.x, camera.width_px) && rim(pixel.y, camera.height_px)).then(|| {
                            ImagePoint {
                                index: i as usize,
                                pixel: pixel + Vector2::new(draw(0), draw(1)),
                                covariance_px2: Matrix2::identity() * (sd * sd),
                                link: None,
                            }
                        })
                    })
                    .collect();
                if image_points.len() >= 6 {
                    observations.views.push(View { device, pose, image_points, may_be_turned: false });
                }
            }
        }
        observations
    }
}

/// The rig as seen from a part that stands at the origin.
pub fn moved(rig: &Rig, world_from_part: &Isometry3<f64>) -> Rig {
    let mut moved = rig.clone();
    for named in moved.cameras.iter_mut().chain(&mut moved.projectors) {
        named.camera.camera_from_world *= world_from_part;
    }
    moved
}

/// Ten steps of 16 px and seven bits in both directions, white and black.
fn sequence() -> Vec<PatternSet> {
    let sine = |axis| PatternSet::sine(axis, 16.0, 10);
    let code = |axis| PatternSet::gray(axis, 7, 8.0);
    let sets = vec![
        sine(Axis::X),
        code(Axis::X),
        sine(Axis::Y),
        code(Axis::Y),
        PatternSet::White {},
        PatternSet::Black {},
    ];
    debug_assert_eq!(frame_count(&sets), 36);
    sets
}
