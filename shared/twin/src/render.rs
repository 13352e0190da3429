//! Frames: the traced geometry, lit by a pattern, seen by a sensor.
//!
//! Order of the physics: light of the pattern (response, chip, blur) → reflected → averaged over the pixel → lens
//! blur → shot and read noise → saturation → quantisation.

use crate::blur;
use crate::cell::{Shared, Twin, TwinError, View, index_of};
use crate::light::{FIXED_BITS, Light, pixel, tabulated};
use crate::pose;
use fringe::geometry::rig::Named;
use fringe::math::random::Key;
use fringe::pattern::{Axis, LevelTable, PatternSet, frame_count, locate};
use nalgebra::{Point2, Vector3};
use std::sync::Arc;

/// Separates the noise from the other draws of a seed.
const NOISE: u64 = 3;

/// Fraction of full scale that a reflectance of 1 gives at exposure 1 and at the reference distance.
const NOMINAL_SIGNAL: f64 = 0.85;

/// Variance of an even distribution over one pixel, px².
const FOOTPRINT_PX2: f64 = 1.0 / 12.0;

/// Grey values to be written, row by row.
#[derive(Debug)]
pub enum PixelsMut<'a> {
    /// 8 bits per pixel.
    Mono8(&'a mut [u8]),
    /// 10 to 16 bits per pixel, in the low bits.
    Mono16(&'a mut [u16]),
}

impl PixelsMut<'_> {
    fn describe(&self) -> (usize, bool) {
        match self {
            Self::Mono8(values) => (values.len(), true),
            Self::Mono16(values) => (values.len(), false),
        }
    }
}

/// Renders the frames of one projector's sequence. All tables are made beforehand; after the first frame of a size
/// nothing is allocated.
#[derive(Debug, Clone)]
pub struct Renderer {
    shared: Arc<Shared>,
    projector: usize,
    first: usize,
    lights: Vec<Light>,
    /// Further projectors that shine at the same time, with the light of their frames.
    beside: Vec<(usize, Vec<Light>)>,
    taps: Vec<f32>,
    /// Number of the exposure, and its factor on all light.
    exposure: (u64, f64),
    image: Vec<f32>,
    spare: Vec<f32>,
    padded: Vec<f32>,
}

impl Twin {
    /// Prepares all frames of a sequence of a projector.
    ///
    /// # Errors
    /// An unknown projector, a set that cannot be generated.
    pub fn renderer(&self, projector: &str, sequence: &[PatternSet]) -> Result<Renderer, TwinError> {
        self.corrected_renderer(projector, sequence, None)
    }

    /// As [`Self::renderer`], for patterns that are corrected for the projector's response by a table.
    ///
    /// # Errors
    /// As [`Self::renderer`].
    pub fn corrected_renderer(
        &self,
        projector: &str,
        sequence: &[PatternSet],
        correction: Option<&LevelTable>,
    ) -> Result<Renderer, TwinError> {
        Renderer::new(&self.shared, projector, sequence, 0..frame_count(sequence), correction)
    }
}

impl View {
    /// Columns of the camera, px.
    pub fn width_px(&self) -> u32 {
        self.width as u32
    }

    /// Rows of the camera, px.
    pub fn height_px(&self) -> u32 {
        self.height as u32
    }

    /// Grey value at which the sensor is full.
    pub fn full_scale_dn(&self) -> u16 {
        self.shared.settings.full_scale_dn()
    }

    /// Renders one frame. For many frames a [`Renderer`] saves the tables.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render(
        &self,
        projector: &str,
        sequence: &[PatternSet],
        frame: usize,
        out: PixelsMut,
    ) -> Result<(), TwinError> {
        Renderer::new(&self.shared, projector, sequence, frame..frame + 1, None)?.render(self, frame, out)
    }

    /// The true projector coordinate of a pixel's centre; `None` where the projector does not light it. With several
    /// rays per pixel, that of the middle one. For evaluating a measurement, not for making one.
    ///
    /// # Errors
    /// A projector that this view was not traced with.
    pub fn truth_coordinate(&self, projector: &str, index: usize) -> Result<Option<Point2<f64>>, TwinError> {
        let slot = self.slot(index_of("projector", &self.shared.projectors, projector)?)?;
        let rays = (self.shared.settings.subsamples as usize).pow(2);
        let lit = self.lit.get((index * rays + rays / 2) * self.lamps.len() + slot);
        Ok(lit.filter(|l| l.gain > 0.0).map(|l| Point2::new(pixel(l.u), pixel(l.v))))
    }

    fn slot(&self, projector: usize) -> Result<usize, TwinError> {
        self.lamps.iter().position(|l| *l == projector).ok_or_else(|| {
            let name = |i: &usize| self.shared.projectors[*i].name.clone();
            TwinError::Unknown {
                kind: "traced projector",
                name: name(&projector),
                known: self.lamps.iter().map(name).collect::<Vec<_>>().join(", "),
            }
        })
    }
}

impl Renderer {
    fn new(
        shared: &Arc<Shared>,
        projector: &str,
        sequence: &[PatternSet],
        frames: std::ops::Range<usize>,
        correction: Option<&LevelTable>,
    ) -> Result<Self, TwinError> {
        let index = index_of("projector", &shared.projectors, projector)?;
        let first = frames.start;
        let lights = lights(shared, index, sequence, frames, correction)?;
        let settings = &shared.settings;
        let parts = settings.subsamples;
        let footprint = if settings.pixel_footprint && parts == 1 { FOOTPRINT_PX2 } else { 0.0 };
        // A lens blurs before a pixel averages: where there are parts of pixels, they are what is blurred.
        let lens_px = settings.camera_blur_px * f64::from(parts);
        let taps = blur::taps(lens_px * lens_px + footprint);
        let (image, spare, padded) = (Vec::new(), Vec::new(), Vec::new());
        let shared = Arc::clone(shared);
        let exposure = (0, 1.0);
        let beside = Vec::new();
        Ok(Self { shared, projector: index, first, lights, beside, taps, exposure, image, spare, padded })
    }

    /// Lets another projector shine at the same time: with frame n of this one it shows frame n of its own sequence, and its last one when
    /// that is over. The views must be traced with both.
    ///
    /// # Errors
    /// An unknown projector, a set that cannot be generated.
    pub fn shine_beside(
        &mut self,
        projector: &str,
        sequence: &[PatternSet],
        correction: Option<&LevelTable>,
    ) -> Result<(), TwinError> {
        let index = index_of("projector", &self.shared.projectors, projector)?;
        let lights = lights(&self.shared, index, sequence, 0..frame_count(sequence), correction)?;
        self.beside.push((index, lights));
        Ok(())
    }

    /// Number of frames of the sequence.
    pub fn frames(&self) -> usize {
        self.lights.len()
    }

    /// Sets the exposure of the next frames: its number, which has noise of its own, and a factor on the settings' exposure.
    pub fn expose(&mut self, number: u64, factor: f64) {
        self.exposure = (number, factor);
    }

    /// Renders one frame of the sequence.
    ///
    /// # Errors
    /// A frame beyond the sequence, a view that was not traced with this projector, a buffer of another size or depth.
    pub fn render(&mut self, view: &View, frame: usize, out: PixelsMut) -> Result<(), TwinError> {
        let bits = self.shared.settings.bits;
        let (len, is_8bit) = out.describe();
        let pixels = view.width * view.height;
        if len != pixels || is_8bit != (bits == 8) {
            let depth = |eight: bool| if eight { "8-bit" } else { "16-bit" };
            return Err(TwinError::Buffer {
                given: format!("{len} {} pixels", depth(is_8bit)),
                needed: format!("{pixels} {} pixels", depth(bits == 8)),
            });
        }
        self.irradiance(view, frame)?;
        self.add_noise(view, frame);
        let full = f32::from(self.shared.settings.full_scale_dn());
        // Clamped first: black and saturation are the ends of the range, and NaN cannot occur.
        let dn = |value: &f32| value.clamp(0.0, 1.0) * full + 0.5;
        match out {
            PixelsMut::Mono8(out) => out.iter_mut().zip(&self.image).for_each(|(o, v)| *o = dn(v) as u8),
            PixelsMut::Mono16(out) => out.iter_mut().zip(&self.image).for_each(|(o, v)| *o = dn(v) as u16),
        }
        Ok(())
    }

    /// The frame before noise and quantisation, as a fraction of full scale; may exceed 1 where it saturates.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn irradiance(&mut self, view: &View, frame: usize) -> Result<&[f32], TwinError> {
        if !Arc::ptr_eq(&self.shared, &view.shared) {
            return Err(TwinError::Foreign);
        }
        let unknown = || TwinError::Frame {
            projector: self.shared.projectors[self.projector].name.clone(),
            frame,
            count: self.first + self.lights.len(),
        };
        let light = frame.checked_sub(self.first).and_then(|i| self.lights.get(i)).ok_or_else(unknown)?;
        let slot = view.slot(self.projector)?;
        let settings = &self.shared.settings;
        let parts = (view.width, settings.subsamples as usize);
        let black = settings.black_level as f32;
        self.image.clear();
        self.image.resize(view.ambient.len(), black);
        self.spare.resize(view.ambient.len(), 0.0);
        let exposure = (self.exposure.1 * settings.exposure * NOMINAL_SIGNAL) as f32;
        let shift = pose::vibration_mm(settings, &self.shared.normal, view.cycle, self.projector, frame);
        let shift = shift.map(|c| c as f32);
        let beam = Beam { view, slot, shift, exposure, ambient: settings.ambient as f32 };
        beam.add(&mut self.image, parts, light);
        add_bounce(&mut self.image, view, slot, light, exposure);
        for (projector, lights) in &self.beside {
            let Some(light) = lights.get(frame).or(lights.last()) else { continue };
            let beam = Beam { slot: view.slot(*projector)?, ambient: 0.0, ..beam };
            beam.add(&mut self.image, parts, light);
            add_bounce(&mut self.image, view, beam.slot, light, exposure);
        }
        blur::blur(&mut self.image, &mut self.spare, &mut self.padded, parts.0 * parts.1, &self.taps);
        average(&mut self.image, parts);
        Ok(&self.image)
    }

    /// Shot noise (variance = electrons) and read noise.
    fn add_noise(&mut self, view: &View, frame: usize) {
        let settings = &self.shared.settings;
        let full_well = settings.full_well_e as f32;
        let shot = if settings.shot_noise { 1.0 / full_well } else { 0.0 };
        let read = (settings.read_noise_e as f32 / full_well).powi(2);
        if shot == 0.0 && read == 0.0 {
            return;
        }
        let mut key = Key::new(settings.seed_of_noise())
            .with(NOISE)
            .with(view.cycle)
            .with(view.camera as u64)
            .with(self.projector as u64)
            .with(frame as u64);
        if self.exposure.0 > 0 {
            key = key.with(self.exposure.0);
        }
        let normal = &self.shared.normal;
        for (index, value) in self.image.iter_mut().enumerate() {
            let variance = value.max(0.0) * shot + read;
            *value += variance.sqrt() * normal.draw(key.bits(index as u64));
        }
    }
}

/// The light of some frames of a projector's sequence.
fn lights(
    shared: &Shared,
    projector: usize,
    sequence: &[PatternSet],
    frames: std::ops::Range<usize>,
    correction: Option<&LevelTable>,
) -> Result<Vec<Light>, TwinError> {
    let Named { name, camera } = &shared.projectors[projector];
    let light = |frame: usize| {
        let count = frame_count(sequence);
        let unknown = || TwinError::Frame { projector: name.clone(), frame, count };
        let (set, step) = locate(sequence, frame).ok_or_else(unknown)?;
        let size_px = [camera.width_px, camera.height_px];
        Light::new(&sequence[set], step, size_px, &shared.settings, correction)
            .map_err(|source| TwinError::Pattern { projector: name.clone(), frame, source })
    };
    frames.map(light).collect()
}

/// What a frame of a projector adds to an image.
#[derive(Clone, Copy)]
struct Beam<'a> {
    view: &'a View,
    /// Number of the projector among those that the view was traced with.
    slot: usize,
    /// Displacement of the part, mm.
    shift: Vector3<f32>,
    exposure: f32,
    ambient: f32,
}

impl Beam<'_> {
    /// Adds the light to an image of so many parts a pixel. Tables, what nearly every frame is, are looked up without a choice at every
    /// ray, and many rays meet no light at all.
    fn add(&self, image: &mut [f32], parts: (usize, usize), light: &Light) {
        let Self { view, slot, exposure, ambient, .. } = *self;
        let lamps = view.lamps.len();
        let lit = |ray: usize| &view.lit[ray * lamps + slot];
        let seen = |ray: usize, own: f32| exposure * (own + ambient * view.ambient[ray]);
        match light {
            Light::Even(level) => add_rays(image, parts, |ray| seen(ray, lit(ray).gain * level)),
            Light::Table { axis, layers } => add_rays(image, parts, |ray| {
                let lit = lit(ray);
                let light = || lit.gain * tabulated(layers, self.place(ray * lamps + slot, *axis), lit.layer);
                seen(ray, if lit.gain > 0.0 { light() } else { 0.0 })
            }),
            _ => add_rays(image, parts, |ray| {
                let [u, v] = [Axis::X, Axis::Y].map(|axis| self.place(ray * lamps + slot, axis));
                seen(ray, lit(ray).gain * light.at(u, v, lit(ray).layer))
            }),
        }
    }

    /// Projector coordinate of a ray along an axis, where the part is, fixed point.
    #[inline]
    fn place(&self, at: usize, axis: Axis) -> u32 {
        let place = self.view.lit[at].along(axis);
        let Some(sway) = self.view.sway.get(at) else { return place };
        let (rate, shift) = (sway.along(axis), &self.shift);
        let px = rate[0] * shift.x + rate[1] * shift.y + rate[2] * shift.z;
        let delta = (px * (1_u32 << FIXED_BITS) as f32) as i64;
        (i64::from(place) + delta).clamp(0, i64::from(u32::MAX)) as u32
    }
}

/// Adds the light of each ray to the part of the image that it stands for: of a pixel n × n parts, for an image of a width in pixels.
fn add_rays(image: &mut [f32], (width, n): (usize, usize), light: impl Fn(usize) -> f32) {
    if n == 1 {
        return image.iter_mut().enumerate().for_each(|(ray, value)| *value += light(ray));
    }
    for (y, rows) in image.chunks_exact_mut(width * n * n).enumerate() {
        for x in 0..width {
            for row in 0..n {
                for column in 0..n {
                    let ray = (y * width + x) * n * n + row * n + column;
                    rows[row * width * n + x * n + column] += light(ray);
                }
            }
        }
    }
}

/// Makes pixels of their parts, in place: none is written before it was read.
fn average(image: &mut Vec<f32>, (width, n): (usize, usize)) {
    if n == 1 || width == 0 {
        return;
    }
    let pixels = image.len() / (n * n);
    for pixel in 0..pixels {
        let first = pixel / width * n * width * n + pixel % width * n;
        let sum: f32 = (0..n * n).map(|part| image[first + part / n * width * n + part % n]).sum();
        image[pixel] = sum / (n * n) as f32;
    }
    image.truncate(pixels);
}

/// Adds light that reached the part by way of another place of it.
fn add_bounce(image: &mut [f32], view: &View, slot: usize, light: &Light, exposure: f32) {
    let (lamps, settings) = (view.lamps.len(), &view.shared.settings);
    let (rays, n) = (settings.bounce_rays as usize, settings.subsamples as usize);
    if rays == 0 {
        return;
    }
    let bounced = view.bounce.chunks_exact(rays * lamps).map(|rays| {
        let lit = rays.iter().skip(slot).step_by(lamps);
        exposure * lit.map(|lit| lit.gain * light.at(lit.u, lit.v, lit.layer)).sum::<f32>()
    });
    for (pixel, light) in bounced.enumerate() {
        let first = pixel / view.width * n * view.width * n + pixel % view.width * n;
        for part in 0..n * n {
            image[first + part / n * view.width * n + part % n] += light;
        }
    }
}
