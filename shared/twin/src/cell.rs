//! The twin of a cell: a scene, a rig, and the imperfections between them.

use crate::pose;
use crate::scene::Scene;
use crate::settings::{SettingError, TwinSettings};
use crate::trace::{Lit, Placed, Row, Sway, Tracer};
use fringe::geometry::camera::{Camera, CameraError};
use fringe::geometry::rig::{Named, Rig};
use fringe::math::random::Normal;
use fringe::pattern::PatternError;
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use std::sync::Arc;
use thiserror::Error;

use crate::light::LARGEST_SIDE_PX;

/// Rays per camera beyond which the planes would not fit a workstation: 16 times a 16-megapixel camera.
const MOST_RAYS: u64 = 1 << 28;

/// Why the twin cannot simulate a view.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TwinError {
    /// A setting outside its range.
    #[error("twin settings")]
    Setting(#[from] SettingError),
    /// A camera or projector that cannot be.
    #[error("camera \"{name}\"")]
    Camera {
        /// Name of the camera.
        name: String,
        /// What is wrong with the camera.
        source: CameraError,
    },
    /// Nothing to see with.
    #[error("the rig has no {0}; the twin needs at least one")]
    Missing(&'static str),
    /// A projector too large for the coordinate's format.
    #[error(
        "projector \"{name}\" has {width_px} × {height_px} px; the twin takes at most {LARGEST_SIDE_PX} along a side"
    )]
    ProjectorSize {
        /// Name of the projector.
        name: String,
        /// Columns of its chip, px.
        width_px: u32,
        /// Rows of its chip, px.
        height_px: u32,
    },
    /// The view needs more rays than allowed.
    #[error("camera \"{name}\" with subsamples = {subsamples} needs {rays} rays, limit {MOST_RAYS}")]
    Rays {
        /// Name of the camera.
        name: String,
        /// Value of the key `subsamples`.
        subsamples: u32,
        /// Number of rays needed.
        rays: u64,
    },
    /// A name that the rig does not have.
    #[error("no {kind} \"{name}\" here; known: {known}")]
    Unknown {
        /// Kind of the device: camera or projector.
        kind: &'static str,
        /// The name that was requested.
        name: String,
        /// All names that exist.
        known: String,
    },
    /// The optical centre is inside of the part.
    #[error("\"{name}\" is inside body \"{body}\" in cycle {cycle}; move it out of the part")]
    Inside {
        /// Name of the camera or projector.
        name: String,
        /// Name of the body.
        body: String,
        /// Number of the cycle.
        cycle: u64,
    },
    /// A pattern that cannot be generated.
    #[error("frame {frame} of projector \"{projector}\"")]
    Pattern {
        /// Name of the projector.
        projector: String,
        /// Number in the sequence.
        frame: usize,
        /// What is wrong with the pattern.
        source: PatternError,
    },
    /// A view or renderer of another twin.
    #[error("the view is not of this twin; make it with the twin that renders it")]
    Foreign,
    /// A frame beyond the sequence.
    #[error("frame {frame} does not exist: the sequence of projector \"{projector}\" has {count} frames")]
    Frame {
        /// Name of the projector.
        projector: String,
        /// Frame number that was requested, from 0.
        frame: usize,
        /// Number of frames of the sequence.
        count: usize,
    },
    /// A pixel buffer of another size or depth.
    #[error("the buffer holds {given}, the frame needs {needed}")]
    Buffer {
        /// Size of the buffer given.
        given: String,
        /// Size of the buffer needed.
        needed: String,
    },
}

/// What views and renderers share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub settings: TwinSettings,
    pub projectors: Vec<Named>,
    pub normal: Normal,
}

/// A simulated cell. It contains the truth; its frames contain only what cameras see.
#[derive(Debug, Clone)]
pub struct Twin {
    scene: Scene,
    cameras: Vec<Named>,
    /// What a rotation stage did to the part after it was placed.
    stage: Isometry3<f64>,
    pub(crate) shared: Arc<Shared>,
}

/// One camera's image point of one pose: the geometry, ready to be lit.
#[derive(Debug, Clone)]
pub struct View {
    pub(crate) shared: Arc<Shared>,
    pub(crate) camera: usize,
    pub(crate) cycle: u64,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Indices of the traced projectors.
    pub(crate) lamps: Vec<usize>,
    /// Albedo met by each ray, for ambient light.
    pub(crate) ambient: Vec<f32>,
    /// Per ray and traced projector.
    pub(crate) lit: Vec<Lit>,
    /// Likewise; empty for a part that stands still.
    pub(crate) sway: Vec<Sway>,
    /// Light by way of another place: per pixel, bounce ray and traced projector.
    pub(crate) bounce: Vec<Lit>,
}

/// The true intersection of a line of sight.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthPoint {
    /// In the world frame, mm.
    pub world_mm: Point3<f64>,
    /// In the part frame, mm.
    pub part_mm: Point3<f64>,
    /// Outward unit normal in the world frame.
    pub normal: Vector3<f64>,
    /// Index of the body, in the order of [`Scene::body_names`].
    pub body: usize,
    /// Face of the body.
    pub face: u32,
}

impl Twin {
    /// Joins scene, settings and the true rig (cameras and projectors; pairs do not matter).
    ///
    /// # Errors
    /// Settings out of range, impossible cameras, a rig without camera or projector.
    pub fn new(scene: &Scene, settings: TwinSettings, rig: &Rig) -> Result<Self, TwinError> {
        settings.check()?;
        for (kind, list) in [("camera", &rig.cameras), ("projector", &rig.projectors)] {
            if list.is_empty() {
                return Err(TwinError::Missing(kind));
            }
        }
        for Named { name, camera } in rig.cameras.iter().chain(&rig.projectors) {
            camera.check().map_err(|source| TwinError::Camera { name: name.clone(), source })?;
        }
        let subsamples = settings.subsamples;
        for Named { name, camera } in &rig.cameras {
            let rays =
                u64::from(camera.width_px) * u64::from(camera.height_px) * u64::from(subsamples).pow(2);
            if rays > MOST_RAYS {
                return Err(TwinError::Rays { name: name.clone(), subsamples, rays });
            }
        }
        for Named { name, camera: Camera { width_px, height_px, .. } } in &rig.projectors {
            let (width_px, height_px) = (*width_px, *height_px);
            if width_px.max(height_px) > LARGEST_SIDE_PX {
                return Err(TwinError::ProjectorSize { name: name.clone(), width_px, height_px });
            }
        }
        let projectors = rig.projectors.clone();
        let shared = Arc::new(Shared { settings, projectors, normal: Normal::default() });
        Ok(Self {
            scene: scene.without_truth(),
            cameras: rig.cameras.clone(),
            stage: Isometry3::identity(),
            shared,
        })
    }

    /// Settings of the twin.
    pub fn settings(&self) -> &TwinSettings {
        &self.shared.settings
    }

    /// The same twin with the part, wherever a cycle places it, moved by a rotation stage.
    #[must_use]
    pub fn on_stage(self, stage: Isometry3<f64>) -> Self {
        Self { stage, ..self }
    }

    /// Where the part stands in a cycle: world_from_part.
    pub fn pose(&self, cycle: u64) -> Isometry3<f64> {
        self.stage * pose::of_cycle(&self.shared.settings, cycle)
    }

    /// Traces a camera with all projectors.
    ///
    /// # Errors
    /// An unknown camera; a camera or projector inside of the part.
    pub fn view(&self, camera: &str, cycle: u64) -> Result<View, TwinError> {
        let names: Vec<_> = self.shared.projectors.iter().map(|p| p.name.as_str()).collect();
        self.view_lit_by(camera, &names, cycle)
    }

    /// Traces a camera with some projectors: less time and memory when a pair has one of its own.
    ///
    /// # Errors
    /// As [`Self::view`], and unknown projectors.
    pub fn view_lit_by(&self, camera: &str, projectors: &[&str], cycle: u64) -> Result<View, TwinError> {
        let index = index_of("camera", &self.cameras, camera)?;
        let lamps = projectors
            .iter()
            .map(|name| index_of("projector", &self.shared.projectors, name))
            .collect::<Result<Vec<_>, _>>()?;
        let size = &self.cameras[index].camera;
        let (width, height) = (size.width_px as usize, size.height_px as usize);
        let rays = width * height * (self.shared.settings.subsamples as usize).pow(2);
        let swaying = if self.shared.settings.moves() { rays * lamps.len() } else { 0 };
        let bounces = self.shared.settings.bounce_rays as usize;
        let mut view = View {
            shared: Arc::clone(&self.shared),
            camera: index,
            cycle,
            width,
            height,
            ambient: vec![0.0; rays],
            lit: vec![Lit::default(); rays * lamps.len()],
            sway: vec![Sway::default(); swaying],
            bounce: vec![Lit::default(); width * height * bounces * lamps.len()],
            lamps,
        };
        self.retrace(&mut view, cycle)?;
        Ok(view)
    }

    /// Traces a view again for another cycle, in the memory it has.
    ///
    /// # Errors
    /// A view of another twin; a camera or projector inside of the part.
    pub fn retrace(&self, view: &mut View, cycle: u64) -> Result<(), TwinError> {
        if !Arc::ptr_eq(&self.shared, &view.shared) {
            return Err(TwinError::Foreign);
        }
        let tracer = self.tracer(view.camera, &view.lamps, cycle)?;
        view.cycle = cycle;
        let rays = view.ambient.len() / view.height;
        let lamps = view.lamps.len();
        let mut lit = view.lit.chunks_mut((rays * lamps).max(1));
        let mut sway = view.sway.chunks_mut((rays * lamps).max(1));
        let bounces = view.bounce.len() / view.height;
        let mut bounce = view.bounce.chunks_mut(bounces.max(1));
        let rows = view
            .ambient
            .chunks_mut(rays)
            .enumerate()
            .map(|(y, ambient)| Row {
                y,
                ambient,
                lit: lit.next().unwrap_or(&mut []),
                sway: sway.next().unwrap_or(&mut []),
                bounce: bounce.next().unwrap_or(&mut []),
            })
            .collect();
        tracer.run(rows);
        Ok(())
    }

    fn tracer(&self, camera: usize, lamps: &[usize], cycle: u64) -> Result<Tracer<'_>, TwinError> {
        let world_from_part = self.pose(cycle);
        let aim = self.scene.centre_mm();
        let outside = |name: &str, placed: Placed| match self.scene.holder(&placed.centre) {
            Some(body) => Err(TwinError::Inside { name: name.into(), body: body.into(), cycle }),
            None => Ok(placed),
        };
        let lamp = |index: &usize| {
            let Named { name, camera } = &self.shared.projectors[*index];
            let reference_mm = (camera.centre_mm() - aim).norm();
            outside(name, Placed::projector(camera, &world_from_part, reference_mm))
        };
        let Named { name, camera } = &self.cameras[camera];
        Ok(Tracer {
            scene: &self.scene,
            camera: outside(name, Placed::new(camera, &world_from_part, 0.0))?,
            projectors: lamps.iter().map(lamp).collect::<Result<_, _>>()?,
            world_from_part,
            settings: &self.shared.settings,
        })
    }

    /// Of the pixels of a camera that see the part, every `step`-th along both axes: how many the projector lights, and how many there are.
    ///
    /// # Errors
    /// As [`Self::view`].
    pub fn lit_pixels(
        &self,
        camera: &str,
        projector: &str,
        cycle: u64,
        step: usize,
    ) -> Result<(usize, usize), TwinError> {
        let index = index_of("camera", &self.cameras, camera)?;
        let lamp = index_of("projector", &self.shared.projectors, projector)?;
        let tracer = self.tracer(index, &[lamp], cycle)?;
        let size = &self.cameras[index].camera;
        let pixels = |length: u32| (0..length as usize).step_by(step.max(1));
        let (mut lit, mut seen) = (0, 0);
        for (x, y) in pixels(size.height_px).flat_map(|y| pixels(size.width_px).map(move |x| (x, y))) {
            let Some(is_lit) = tracer.is_lit(x as f64, y as f64) else { continue };
            seen += 1;
            lit += usize::from(is_lit);
        }
        Ok((lit, seen))
    }

    /// The true point on the line of sight of a pixel; `None` beside the part. For evaluating a measurement, not for making one.
    ///
    /// # Errors
    /// As [`Self::view`].
    pub fn truth_point(
        &self,
        camera: &str,
        cycle: u64,
        pixel: Point2<f64>,
    ) -> Result<Option<TruthPoint>, TwinError> {
        let index = index_of("camera", &self.cameras, camera)?;
        let tracer = self.tracer(index, &[], cycle)?;
        let hit = tracer
            .camera
            .direction(pixel.x, pixel.y)
            .and_then(|d| self.scene.first_hit(&tracer.camera.centre, &d));
        Ok(hit.map(|hit| TruthPoint {
            world_mm: tracer.world_from_part * hit.point_mm,
            part_mm: hit.point_mm,
            normal: tracer.world_from_part.rotation * hit.normal,
            body: hit.body,
            face: hit.face,
        }))
    }
}

pub(crate) fn index_of(kind: &'static str, list: &[Named], name: &str) -> Result<usize, TwinError> {
    list.iter().position(|n| n.name == name).ok_or_else(|| TwinError::Unknown {
        kind,
        name: name.into(),
        known: list.iter().map(|n| n.name.as_str()).collect::<Vec<_>>().join(", "),
    })
}
