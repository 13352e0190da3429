//! A cloud seen from one side, drawn point by point into a depth buffer: no graphics hardware, the same bytes everywhere.
//!
//! Parallel projection, so that lengths may be read off.

use fringe::cloud::Point;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::canvas::{Canvas, Dot, Span};
use super::colour::{Colouring, Rgb, WHITE, pair_colour};
use super::number;
use super::raster::{PictureError, Raster};
use super::statistics::inner_range;

/// Pixels drawn per pixel of the picture along each side; their mean smooths the edges.
const OVERSAMPLING: usize = 2;

/// Free border of the picture, as a part of each side.
const BORDER: f64 = 0.06;

/// Largest radius of a drawn point, drawn pixels: a sparse cloud shall look sparse.
const MAX_RADIUS: f64 = 6.0;

/// Points without a deviation in a deviation picture.
const NO_VALUE: Rgb = [178, 182, 188];

/// Surface colour of a shaded picture.
const SURFACE: Rgb = [196, 204, 214];

/// Where one looks from.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Shown below the picture.
    pub name: String,
    /// From the part to the eye, world frame; any length.
    pub towards_eye: Vector3<f64>,
    /// Direction that is up in the picture; any length, not along `towards_eye`.
    pub up: Vector3<f64>,
    /// Columns of the picture.
    pub width_px: u32,
    /// Rows of the picture.
    pub height_px: u32,
}

impl View {
    /// Along −z, y up.
    pub fn top(width_px: u32, height_px: u32) -> Self {
        Self::named("Top (along −z)", Vector3::z(), Vector3::y(), width_px, height_px)
    }

    /// Along +y, z up.
    pub fn front(width_px: u32, height_px: u32) -> Self {
        Self::named("Front (along +y)", -Vector3::y(), Vector3::z(), width_px, height_px)
    }

    /// From the right, the front and above at once.
    pub fn oblique(width_px: u32, height_px: u32) -> Self {
        Self::named("Oblique", Vector3::new(0.75, -1.0, 0.85), Vector3::z(), width_px, height_px)
    }

    fn named(name: &str, towards_eye: Vector3<f64>, up: Vector3<f64>, width_px: u32, height_px: u32) -> Self {
        Self { name: name.to_owned(), towards_eye, up, width_px, height_px }
    }

    /// Unit vectors right, up, towards the eye; the top view if the directions span no picture.
    fn axes(&self) -> [Vector3<f64>; 3] {
        let towards = self.towards_eye.try_normalize(1e-12);
        let right = towards.and_then(|towards| self.up.cross(&towards).try_normalize(1e-12));
        match (right, towards) {
            (Some(right), Some(towards)) => [right, towards.cross(&right), towards],
            _ => [Vector3::x(), Vector3::y(), Vector3::z()],
        }
    }
}

/// A drawn cloud and what its labels need.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// The picture, without labels.
    pub raster: Raster,
    /// Size of a pixel.
    pub mm_per_px: f64,
    /// The world axes x, y, z in the picture: right and down, unit length where seen from the side.
    pub axes: [[f64; 2]; 3],
    /// Points that lie within the picture.
    pub drawn: usize,
}

impl Rendered {
    /// Length of a scale bar of at most a fifth of the width: 1, 2 or 5 · 10ⁿ mm. `None` for an empty picture.
    pub fn scale_bar_mm(&self) -> Option<f64> {
        let longest = self.raster.width as f64 * self.mm_per_px / 5.0;
        let above = number::round_up(longest);
        let candidates = [above, number::round_up(above / 2.6), number::round_up(above / 6.0)];
        candidates.into_iter().find(|c| *c > 0.0 && *c <= longest * (1.0 + 1e-9)).filter(|_| self.drawn > 0)
    }
}

/// Draws a cloud; an empty one gives an empty picture.
///
/// # Errors
/// A size that no picture has; a deviation of a point that does not exist.
pub fn render(points: &[Point], view: &View, colouring: &Colouring<'_>) -> Result<Rendered, PictureError> {
    let deviations = deviations_by_point(points.len(), colouring)?;
    let (width, height) = (view.width_px as usize * OVERSAMPLING, view.height_px as usize * OVERSAMPLING);
    let axes = view.axes();
    let placement = Placement::fit(points, &axes, width, height);
    let disc = disc(placement.radius);
    let lamp = (axes[2] * 0.75 + axes[1] * 0.5 - axes[0] * 0.43).normalize();
    let dot = |(i, point): (usize, &Point)| {
        let (pixel, depth_mm) = placement.place(point, &axes)?;
        let colour = shaded(base_colour(i, point, colouring), point, &axes[2], &lamp);
        let deviation_mm = deviations.get(i).copied().unwrap_or(f32::NAN);
        Some(Dot { pixel, depth_mm, colour, deviation_mm })
    };
    let dots: Vec<Dot> = points.par_iter().enumerate().filter_map(dot).collect();
    let (thickness_mm, mm_per_px) = (placement.thickness_mm(), placement.mm_per_px);
    let canvas = Canvas { width, height, disc: &disc, thickness_mm, mm_per_px, colouring };
    let drawn = dots.len();
    Ok(Rendered {
        raster: canvas.draw(dots)?.reduced(OVERSAMPLING)?,
        mm_per_px: mm_per_px * OVERSAMPLING as f64,
        axes: [0, 1, 2].map(|k| [axes[0][k], -axes[1][k]]),
        drawn,
    })
}

/// Deviation of each point, NaN where there is none; empty where none are shown.
fn deviations_by_point(points: usize, colouring: &Colouring<'_>) -> Result<Vec<f32>, PictureError> {
    let Colouring::Deviation { values, .. } = colouring else {
        return Ok(Vec::new());
    };
    let mut by_point = vec![f32::NAN; points];
    for (index, value) in *values {
        match by_point.get_mut(*index as usize) {
            Some(slot) => *slot = *value,
            None => return Err(PictureError::NoSuchPoint { index: *index, points }),
        }
    }
    Ok(by_point)
}

/// Colour of a point before shading; a deviation comes instead of it.
fn base_colour(index: usize, point: &Point, colouring: &Colouring<'_>) -> Rgb {
    match colouring {
        Colouring::Normal => SURFACE,
        Colouring::Pair => pair_colour(point.pair as usize),
        Colouring::Given { colours } => colours.get(index).copied().unwrap_or(WHITE),
        Colouring::Deviation { .. } => NO_VALUE,
    }
}

/// The rows of a disc.
fn disc(radius: i64) -> Vec<Span> {
    let reach = |row: i64| (0..=radius).rev().find(|reach| reach * reach + row * row <= radius * radius);
    (-radius..=radius).filter_map(|row| Some(Span { row, reach: reach(row)? })).collect()
}

/// Lambertian shading by a lamp in a direction (unit length); a surface seen from behind is dark.
fn shaded(colour: Rgb, point: &Point, towards_eye: &Vector3<f64>, lamp: &Vector3<f64>) -> Rgb {
    let normal = point.normal_vector();
    let level = match normal.try_normalize(1e-6) {
        None => 0.8,
        Some(normal) if normal.dot(towards_eye) < 0.0 => 0.3,
        Some(normal) => 0.4 + 0.62 * normal.dot(lamp).max(0.0),
    };
    colour.map(|c| (f64::from(c) * level + 0.5).min(255.0) as u8)
}

/// Where the part lies in the picture.
struct Placement {
    centre: (f64, f64),
    /// Columns and rows of the picture.
    size: (f64, f64),
    mm_per_px: f64,
    radius: i64,
}

impl Placement {
    /// Fits the cloud into the picture; the outermost thousandth at each side may fall outside.
    fn fit(points: &[Point], axes: &[Vector3<f64>; 3], width: usize, height: usize) -> Self {
        let along = |axis: Vector3<f64>| {
            let values = points.iter().map(move |p| axis.dot(&p.position().coords) as f32);
            inner_range(values).unwrap_or((0.0, 0.0))
        };
        let (u, v) = (along(axes[0]), along(axes[1]));
        let room = |pixels: usize| pixels as f64 * (1.0 - 2.0 * BORDER);
        let needed = ((u.1 - u.0) / room(width)).max((v.1 - v.0) / room(height));
        // A single point, or all in one place: any scale will do.
        let mm_per_px = if needed > 0.0 { needed } else { 0.01 };
        let area_px = (u.1 - u.0) * (v.1 - v.0) / (mm_per_px * mm_per_px);
        let spacing_px = (area_px / points.len().max(1) as f64).sqrt();
        Self {
            centre: (f64::midpoint(u.0, u.1), f64::midpoint(v.0, v.1)),
            size: (width as f64, height as f64),
            mm_per_px,
            radius: (0.9 * spacing_px).clamp(1.0, MAX_RADIUS).ceil() as i64,
        }
    }

    /// Points so much behind the foremost one still belong to its surface: a disc lies flat although the surface
    /// below it may rise by twice its width.
    fn thickness_mm(&self) -> f64 {
        self.mm_per_px * (2 * self.radius + 1) as f64 * 2.0
    }

    /// The pixel of a point that lies within the picture, and its depth towards the eye in mm.
    fn place(&self, point: &Point, axes: &[Vector3<f64>; 3]) -> Option<((u32, u32), f64)> {
        let position = point.position().coords;
        let (width, height) = self.size;
        let x = width / 2.0 + (axes[0].dot(&position) - self.centre.0) / self.mm_per_px;
        let y = height / 2.0 - (axes[1].dot(&position) - self.centre.1) / self.mm_per_px;
        // What is no number lies outside.
        let inside = x >= 0.0 && y >= 0.0 && x < width && y < height;
        inside.then(|| ((x as u32, y as u32), axes[2].dot(&position)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::colour::ColourMap;
    use super::*;

    fn point(x: f64, y: f64, z: f64, pair: u32) -> Point {
        Point {
            position_mm: [x, y, z],
            normal: [0.0, 0.0, 1.0],
            sigma_mm: 0.01,
            modulation: 50.0,
            pair,
            pixel: 0,
            shared_mm: 0.0,
        }
    }

    fn centre_of(raster: &Raster) -> Rgb {
        raster.pixels[raster.height / 2 * raster.width + raster.width / 2]
    }

    #[test]
    fn the_nearer_point_hides_the_farther_one_in_any_order() {
        let cloud = [point(0.0, 0.0, 0.0, 0), point(0.0, 0.0, 5.0, 1)];
        let swapped = [cloud[1], cloud[0]];
        let view = View::top(40, 30);
        let a = render(&cloud, &view, &Colouring::Pair).unwrap();
        let b = render(&swapped, &view, &Colouring::Pair).unwrap();
        assert_eq!(a, b);
        let from_below = View { towards_eye: -Vector3::z(), ..view };
        let c = render(&cloud, &from_below, &Colouring::Pair).unwrap();
        assert_ne!(centre_of(&a.raster), centre_of(&c.raster), "the other pair is in front from below");
    }

    #[test]
    fn lengths_may_be_read_off() {
        let cloud = [point(-50.0, 0.0, 0.0, 0), point(50.0, 0.0, 0.0, 0)];
        let drawn = render(&cloud, &View::top(500, 200), &Colouring::Normal).unwrap();
        let columns: Vec<usize> =
            (0..500).filter(|x| (0..200).any(|y| drawn.raster.pixels[y * 500 + x] != WHITE)).collect();
        let apart_px = (columns[columns.len() - 1] - columns[0]) as f64;
        assert!((apart_px * drawn.mm_per_px - 100.0).abs() < 3.0 * drawn.mm_per_px);
        assert_eq!(drawn.scale_bar_mm(), Some(20.0));
    }

    #[test]
    fn axes_are_those_of_the_world() {
        let top = render(&[point(0.0, 0.0, 0.0, 0)], &View::top(20, 20), &Colouring::Normal).unwrap();
        assert_eq!(top.axes, [[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]]);
        let front = render(&[point(0.0, 0.0, 0.0, 0)], &View::front(20, 20), &Colouring::Normal).unwrap();
        assert_eq!(front.axes, [[1.0, 0.0], [0.0, 0.0], [0.0, -1.0]]);
    }

    #[test]
    fn clouds_that_show_nothing_are_drawn_all_the_same() {
        let view = View::oblique(20, 20);
        let empty = render(&[], &view, &Colouring::Normal).unwrap();
        assert_eq!((empty.drawn, empty.scale_bar_mm()), (0, None));
        assert!(empty.raster.pixels.iter().all(|p| *p == WHITE));
        let broken = [point(f64::NAN, 0.0, 0.0, 0), point(f64::INFINITY, 1e300, 0.0, 0)];
        assert_eq!(render(&broken, &view, &Colouring::Normal).unwrap().drawn, 0);
        let blind = View { up: view.towards_eye, ..view };
        assert_eq!(render(&[point(1.0, 2.0, 3.0, 9)], &blind, &Colouring::Pair).unwrap().drawn, 1);
    }

    #[test]
    fn deviations_have_the_colours_of_the_bar() {
        // Dense enough that the middle of the picture is all surface.
        let cloud: Vec<Point> = (0..25).map(|i| point(f64::from(i % 5), f64::from(i / 5), 0.0, 0)).collect();
        let view = View::top(20, 20);
        let colour = |deviation: Option<f32>| {
            let values: Vec<(u32, f32)> = (0..25).filter_map(|i| Some((i, deviation?))).collect();
            let colouring = Colouring::Deviation { values: &values, half_range_mm: 0.01 };
            centre_of(&render(&cloud, &view, &colouring).unwrap().raster)
        };
        assert_eq!(colour(Some(0.01)), ColourMap::Diverging.colour(1.0));
        assert_eq!(colour(Some(-0.005)), ColourMap::Diverging.colour(0.25));
        assert_eq!(colour(Some(99.0)), ColourMap::Diverging.colour(1.0));
        assert_eq!(colour(Some(f32::NAN)), colour(None));
        let wrong = Colouring::Deviation { values: &[(25, 0.0)], half_range_mm: 0.01 };
        assert!(matches!(
            render(&cloud, &view, &wrong),
            Err(PictureError::NoSuchPoint { index: 25, points: 25 })
        ));
    }

    #[test]
    fn a_deviation_map_shows_the_mean_and_not_the_foremost_noise() {
        // Two layers 20 µm above and below the true plane at each place: what noise of mean zero looks like.
        let mut cloud = Vec::new();
        let mut values = Vec::new();
        for i in 0..900_u16 {
            for side in [-0.02_f32, 0.02] {
                values.push((cloud.len() as u32, side));
                cloud.push(point(f64::from(i % 30), f64::from(i / 30), f64::from(side), 0));
            }
        }
        let colouring = Colouring::Deviation { values: &values, half_range_mm: 0.05 };
        let picture = render(&cloud, &View::top(60, 60), &colouring).unwrap();
        assert_eq!(centre_of(&picture.raster), ColourMap::Diverging.colour(0.5));
    }
}
