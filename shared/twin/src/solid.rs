//! Convex bodies with closed-form intersections and distances, in their own frame.
//!
//! Each one is a quadric, or nothing, cut by half-spaces: a ray keeps one span of parameters inside it. All faces are
//! numbered, so that the face of each point is known.

use nalgebra::{Point3, Vector2, Vector3};

/// Where a ray enters a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Distance along the (unit) direction, mm.
    pub t_mm: f64,
    /// Outward normal, unit vector.
    pub normal: Vector3<f64>,
    /// Face number, see the body's variant.
    pub face: u32,
}

/// The nearest point of a body's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Distance, mm; negative inside.
    pub signed_mm: f64,
    /// Nearest point of the surface, mm.
    pub foot_mm: Point3<f64>,
    /// Number of its face.
    pub face: u32,
    /// Distance of the foot to the next face of the body, mm: a lower bound of the distance to an edge; infinite if
    /// the body has one face only.
    pub edge_mm: f64,
}

/// A plane with its outward unit normal: the inside is n·x ≤ offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Outward normal, unit vector.
    pub normal: Vector3<f64>,
    /// Distance of the plane from the origin along the normal, mm.
    pub offset_mm: f64,
}

/// A convex polygon in the x–z plane, extruded along y.
#[derive(Debug, Clone, PartialEq)]
pub struct Prism {
    /// Corners (x, z), counter-clockwise.
    profile: Vec<Vector2<f64>>,
    /// Half of the extent along y, mm.
    half_width_mm: f64,
    /// One per profile edge, then −y, then +y.
    faces: Vec<HalfSpace>,
}

/// A convex body in its own frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// Sphere about the origin. Face 0.
    Ball {
        /// Radius of the sphere, mm.
        radius_mm: f64,
    },
    /// The half z ≥ 0 of a sphere about the origin. Face 0 the cap, 1 the disc.
    Dome {
        /// Radius of the solid, mm.
        radius_mm: f64,
    },
    /// Cylinder about the z axis from z = 0. Face 0 the mantle, 1 the bottom, 2 the top.
    Tube {
        /// Radius of the solid, mm.
        radius_mm: f64,
        /// Length along the axis, mm.
        length_mm: f64,
    },
    /// Extruded polygon. Faces in the order of the profile's edges, then −y, then +y.
    Prism(Prism),
}

/// The part of a ray inside a body, while half-spaces cut it.
#[derive(Debug, Clone, Copy)]
struct Span {
    enter: Contact,
    leave_mm: f64,
}

impl Span {
    fn whole() -> Self {
        Self {
            enter: Contact { t_mm: f64::NEG_INFINITY, normal: Vector3::zeros(), face: 0 },
            leave_mm: f64::INFINITY,
        }
    }

    fn cut(mut self, plane: &HalfSpace, face: u32, origin: &Point3<f64>, d: &Vector3<f64>) -> Option<Self> {
        let slope = plane.normal.dot(d);
        let depth = plane.offset_mm - plane.normal.dot(&origin.coords);
        if slope == 0.0 {
            return (depth >= 0.0).then_some(self);
        }
        let t_mm = depth / slope;
        if slope < 0.0 {
            if t_mm > self.enter.t_mm {
                self.enter = Contact { t_mm, normal: plane.normal, face };
            }
        } else {
            self.leave_mm = self.leave_mm.min(t_mm);
        }
        (self.enter.t_mm < self.leave_mm).then_some(self)
    }
}

fn ball_span(radius_mm: f64, origin: &Point3<f64>, d: &Vector3<f64>) -> Option<Span> {
    let along = origin.coords.dot(d);
    // The distance of the axis point loses no digits, unlike b² − 4ac at 500 mm.
    let axis_point = origin.coords - d * along;
    let half_squared = radius_mm * radius_mm - axis_point.norm_squared();
    if half_squared <= 0.0 {
        return None;
    }
    let half = half_squared.sqrt();
    let t_mm = -along - half;
    let normal = (axis_point - d * half) / radius_mm;
    Some(Span { enter: Contact { t_mm, normal, face: 0 }, leave_mm: half - along })
}

fn tube_span(radius_mm: f64, origin: &Point3<f64>, d: &Vector3<f64>) -> Option<Span> {
    let o = Vector2::new(origin.x, origin.y);
    let flat = Vector2::new(d.x, d.y);
    let speed = flat.norm();
    if speed < 1e-12 {
        return (o.norm() <= radius_mm).then(Span::whole);
    }
    let unit = flat / speed;
    let along = o.dot(&unit);
    let axis_point = o - unit * along;
    let half_squared = radius_mm * radius_mm - axis_point.norm_squared();
    if half_squared <= 0.0 {
        return None;
    }
    let half = half_squared.sqrt();
    let normal = (axis_point - unit * half) / radius_mm;
    Some(Span {
        enter: Contact {
            t_mm: (-along - half) / speed,
            normal: Vector3::new(normal.x, normal.y, 0.0),
            face: 0,
        },
        leave_mm: (half - along) / speed,
    })
}

const DOWN: Vector3<f64> = Vector3::new(0.0, 0.0, -1.0);
const UP: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

impl Prism {
    /// Extrudes a convex counter-clockwise polygon (x, z) to |y| ≤ half_width_mm.
    ///
    /// The caller has checked that it is convex and of positive size.
    pub fn new(profile: Vec<Vector2<f64>>, half_width_mm: f64) -> Self {
        let mut faces: Vec<HalfSpace> = edges(&profile)
            .map(|(a, b)| {
                let along = (b - a) / (b - a).norm();
                let normal = Vector3::new(along.y, 0.0, -along.x);
                HalfSpace { normal, offset_mm: normal.x * a.x + normal.z * a.y }
            })
            .collect();
        faces.push(HalfSpace { normal: Vector3::new(0.0, -1.0, 0.0), offset_mm: half_width_mm });
        faces.push(HalfSpace { normal: Vector3::new(0.0, 1.0, 0.0), offset_mm: half_width_mm });
        Self { profile, half_width_mm, faces }
    }

    /// The profile's corners (x, z) counter-clockwise, and half of the extent along y, mm.
    pub fn outline(&self) -> (&[Vector2<f64>], f64) {
        (&self.profile, self.half_width_mm)
    }

    fn nearest(&self, p: &Point3<f64>) -> Nearest {
        let flat = Vector2::new(p.x, p.z);
        let last = self.profile.len();
        let depth = |f: &HalfSpace| f.normal.x * p.x + f.normal.z * p.z - f.offset_mm;
        let inside_profile = self.faces[..last].iter().all(|f| depth(f) <= 0.0);
        let side = p.y.abs() - self.half_width_mm;
        let mut best = (f64::INFINITY, 0, flat);
        for (index, (a, b)) in edges(&self.profile).enumerate() {
            let along = b - a;
            let s = ((flat - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let foot = a + along * s;
            let distance = (flat - foot).norm();
            if distance < best.0 {
                best = (distance, index, foot);
            }
        }
        let (distance, edge, on_profile) = best;
        let inner_y = p.y.clamp(-self.half_width_mm, self.half_width_mm);
        let side_face = last + usize::from(p.y > 0.0);
        let side_y = self.half_width_mm.copysign(p.y);
        // Inside: the nearest of profile and side face. Outside: clamp what lies beyond.
        let (foot, face, signed_mm) = if inside_profile && side <= 0.0 {
            if -side < distance {
                (Point3::new(p.x, side_y, p.z), side_face, side)
            } else {
                (Point3::new(on_profile.x, p.y, on_profile.y), edge, -distance)
            }
        } else if inside_profile {
            (Point3::new(p.x, side_y, p.z), side_face, side)
        } else {
            let foot = Point3::new(on_profile.x, inner_y, on_profile.y);
            let face = if side > distance { side_face } else { edge };
            (foot, face, (p - foot).norm())
        };
        let edge_mm = self
            .faces
            .iter()
            .enumerate()
            .filter(|(index, _)| *index != face)
            .map(|(_, f)| (f.offset_mm - f.normal.dot(&foot.coords)).max(0.0))
            .fold(f64::INFINITY, f64::min);
        Nearest { signed_mm, foot_mm: foot, face: face as u32, edge_mm }
    }
}

fn edges(profile: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    let next = profile.iter().cycle().skip(1);
    profile.iter().zip(next).map(|(a, b)| (*a, *b))
}

impl Solid {
    /// Where a ray with a unit direction enters the body; `None` if it misses, leaves, or starts inside.
    pub fn enter(&self, origin: &Point3<f64>, d: &Vector3<f64>) -> Option<Contact> {
        let span = match self {
            Self::Ball { radius_mm } => ball_span(*radius_mm, origin, d)?,
            Self::Dome { radius_mm } => {
                let floor = HalfSpace { normal: DOWN, offset_mm: 0.0 };
                ball_span(*radius_mm, origin, d)?.cut(&floor, 1, origin, d)?
            }
            Self::Tube { radius_mm, length_mm } => {
                let floor = HalfSpace { normal: DOWN, offset_mm: 0.0 };
                let lid = HalfSpace { normal: UP, offset_mm: *length_mm };
                tube_span(*radius_mm, origin, d)?.cut(&floor, 1, origin, d)?.cut(&lid, 2, origin, d)?
            }
            Self::Prism(prism) => {
                let mut span = Span::whole();
                for (face, plane) in prism.faces.iter().enumerate() {
                    span = span.cut(plane, face as u32, origin, d)?;
                }
                span
            }
        };
        (span.enter.t_mm > 0.0).then_some(span.enter)
    }

    /// The nearest surface point, exactly, from outside and from inside.
    pub fn nearest(&self, p: &Point3<f64>) -> Nearest {
        match self {
            Self::Ball { radius_mm } => {
                let (distance, foot_mm) = on_sphere(*radius_mm, p);
                Nearest { signed_mm: distance, foot_mm, face: 0, edge_mm: f64::INFINITY }
            }
            Self::Dome { radius_mm } => nearest_on_dome(*radius_mm, p),
            Self::Tube { radius_mm, length_mm } => nearest_on_tube(*radius_mm, *length_mm, p),
            Self::Prism(prism) => prism.nearest(p),
        }
    }

    /// Centre and radius of a sphere that holds the body, mm.
    pub fn bounding_sphere(&self) -> (Point3<f64>, f64) {
        match self {
            Self::Ball { radius_mm } | Self::Dome { radius_mm } => (Point3::origin(), *radius_mm),
            Self::Tube { radius_mm, length_mm } => {
                let half = 0.5 * length_mm;
                (Point3::new(0.0, 0.0, half), (radius_mm * radius_mm + half * half).sqrt())
            }
            Self::Prism(prism) => {
                let sum: Vector2<f64> = prism.profile.iter().sum();
                let centre = sum / prism.profile.len() as f64;
                let reach = prism.profile.iter().map(|c| (c - centre).norm()).fold(0.0, f64::max);
                let radius = (reach * reach + prism.half_width_mm * prism.half_width_mm).sqrt();
                (Point3::new(centre.x, 0.0, centre.y), radius)
            }
        }
    }
}

/// Radial unit vector of a point, or +z at the centre itself.
fn radial(v: Vector3<f64>) -> Vector3<f64> {
    v.try_normalize(1e-300).unwrap_or(UP)
}

fn on_sphere(radius_mm: f64, p: &Point3<f64>) -> (f64, Point3<f64>) {
    (p.coords.norm() - radius_mm, Point3::from(radial(p.coords) * radius_mm))
}

fn nearest_on_dome(radius_mm: f64, p: &Point3<f64>) -> Nearest {
    let rho = (p.x * p.x + p.y * p.y).sqrt();
    let (to_cap, cap_foot) = on_sphere(radius_mm, p);
    let cap = |signed_mm, foot_mm: Point3<f64>| Nearest { signed_mm, foot_mm, face: 0, edge_mm: foot_mm.z };
    if p.z < 0.0 && rho > radius_mm {
        let rim = radial(Vector3::new(p.x, p.y, 0.0)) * radius_mm;
        return cap((p.coords - rim).norm(), Point3::from(rim));
    }
    if p.z >= 0.0 && -to_cap <= p.z {
        return cap(to_cap, cap_foot);
    }
    Nearest { signed_mm: -p.z, foot_mm: Point3::new(p.x, p.y, 0.0), face: 1, edge_mm: radius_mm - rho }
}

fn nearest_on_tube(radius_mm: f64, length_mm: f64, p: &Point3<f64>) -> Nearest {
    let rho = (p.x * p.x + p.y * p.y).sqrt();
    let out = if rho > 0.0 { Vector3::new(p.x / rho, p.y / rho, 0.0) } else { Vector3::new(1.0, 0.0, 0.0) };
    let beyond_mantle = rho - radius_mm;
    let beyond_end = (p.z - 0.5 * length_mm).abs() - 0.5 * length_mm;
    let top = p.z > 0.5 * length_mm;
    let end_z = if top { length_mm } else { 0.0 };
    let at = |r: f64, z: f64| Point3::from(out * r + UP * z);
    let inside = beyond_mantle <= 0.0 && beyond_end <= 0.0;
    if beyond_end > beyond_mantle {
        let foot_mm = at(rho.min(radius_mm), end_z);
        let signed_mm = if inside { beyond_end } else { (p - foot_mm).norm() };
        let edge_mm = (radius_mm - rho).max(0.0);
        return Nearest { signed_mm, foot_mm, face: 1 + u32::from(top), edge_mm };
    }
    let foot_mm = at(radius_mm, p.z.clamp(0.0, length_mm));
    let signed_mm = if inside { beyond_mantle } else { (p - foot_mm).norm() };
    Nearest { signed_mm, foot_mm, face: 0, edge_mm: foot_mm.z.min(length_mm - foot_mm.z) }
}
