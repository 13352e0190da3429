//! The CAD of the demo part, made here from the sizes in its scene file: body by body, and as one closed surface.

use nalgebra::{Point3, Vector3};

/// A triangle's corners, mm.
pub type Corners = [Point3<f64>; 3];

/// A body of the part.
enum Body {
    /// Centre and half edges.
    Cuboid(Vector3<f64>, Vector3<f64>),
    Sphere(Vector3<f64>, f64),
    /// The half above z = 0, about the origin.
    Hemisphere(f64),
    /// Foot, radius, height along z.
    Cylinder(Vector3<f64>, f64, f64),
    /// Middle of the footprint, direction in which the slope descends, inclination in degrees.
    Wedge(Vector3<f64>, Vector3<f64>, f64),
}

/// Height and half edge of the wedges.
const WEDGE_MM: [f64; 2] = [12.0, 12.0];

fn bodies() -> Vec<Body> {
    let [a, b] = [-39.756_018_112, 39.756_018_112];
    vec![
        Body::Cuboid(Vector3::new(0.0, 0.0, -5.3845), Vector3::new(55.0, 55.0, 5.3845)),
        Body::Hemisphere(30.097),
        Body::Sphere(Vector3::new(a, a, 28.0), 11.231),
        Body::Cylinder(Vector3::new(a, a, 0.0), 4.0, 28.0),
        Body::Sphere(Vector3::new(b, b, 28.0), 11.1835),
        Body::Cylinder(Vector3::new(b, b, 0.0), 4.0, 28.0),
        Body::Wedge(Vector3::new(38.0, -38.0, 0.0), Vector3::x(), 44.964),
        Body::Wedge(Vector3::new(-38.0, 38.0, 0.0), Vector3::y(), 44.809),
        Body::Cuboid(Vector3::new(0.0, -44.0, 4.0), Vector3::new(12.0, 8.0, 4.0)),
    ]
}

impl Body {
    /// Signed distance, or a number with the same zero and slope there, mm.
    fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        match self {
            Self::Cuboid(centre, half) => ((p - centre).abs() - half).max(),
            Self::Sphere(centre, radius) => (p - centre).norm() - radius,
            Self::Hemisphere(radius) => (p.norm() - radius).max(-p.z),
            Self::Cylinder(foot, radius, height) => {
                let at = p - foot;
                (at.xy().norm() - radius).max(-at.z).max(at.z - height)
            }
            Self::Wedge(foot, down, inclination) => {
                let at = p - foot;
                let along = at.dot(down);
                let across = (at - down * along).xy().norm();
                let (sine, cosine) = inclination.to_radians().sin_cos();
                let slope = (along - WEDGE_MM[1]) * sine + at.z * cosine;
                (along.abs() - WEDGE_MM[1])
                    .max(across - WEDGE_MM[1])
                    .max(at.z - WEDGE_MM[0])
                    .max(-at.z)
                    .max(slope)
            }
        }
    }

    /// Its closed surface, seen counter-clockwise from outside.
    fn triangles(&self, out: &mut Vec<Corners>) {
        match self {
            Self::Cuboid(centre, half) => {
                let rectangle = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
                let outline: Vec<Vector3<f64>> = rectangle
                    .iter()
                    .map(|[x, y]| centre + Vector3::new(x * half.x, y * half.y, -half.z))
                    .collect();
                prism(&outline, &(Vector3::z() * 2.0 * half.z), out);
            }
            Self::Sphere(centre, radius) => turned(centre, &arc(*radius, 0.0), out),
            Self::Hemisphere(radius) => {
                let mut profile = arc(*radius, 0.5);
                profile.insert(0, [0.0, 0.0]);
                turned(&Vector3::zeros(), &profile, out);
            }
            Self::Cylinder(foot, radius, height) => {
                turned(foot, &[[0.0, 0.0], [*radius, 0.0], [*radius, *height], [0.0, *height]], out);
            }
            Self::Wedge(foot, down, inclination) => {
                let [height, half] = WEDGE_MM;
                let top = half - height / inclination.to_radians().tan();
                let side = Vector3::z().cross(down);
                let outline: Vec<Vector3<f64>> = [[-half, 0.0], [-half, height], [top, height], [half, 0.0]]
                    .iter()
                    .map(|[x, z]| foot + down * *x + Vector3::z() * *z - side * half)
                    .collect();
                prism(&outline, &(side * 2.0 * half), out);
            }
        }
    }
}

/// Radius and height along a sphere, from a share of the half circle to its top.
fn arc(radius: f64, from: f64) -> Vec<[f64; 2]> {
    let steps = if from > 0.0 { 60 } else { 80 };
    let at = |i: i32| {
        let angle = std::f64::consts::PI * (from + (1.0 - from) * f64::from(i) / f64::from(steps));
        [if i == steps || angle == 0.0 { 0.0 } else { radius * angle.sin() }, -radius * angle.cos()]
    };
    (0..=steps).map(at).collect()
}

/// A profile (radius, height; upwards on the outside) turned about z.
fn turned(foot: &Vector3<f64>, profile: &[[f64; 2]], out: &mut Vec<Corners>) {
    let around = 160;
    let at = |[radius, height]: [f64; 2], i: i32| {
        let angle = std::f64::consts::TAU * f64::from(i % around) / f64::from(around);
        Point3::from(foot + Vector3::new(radius * angle.cos(), radius * angle.sin(), height))
    };
    for two in profile.windows(2) {
        for i in 0..around {
            let [a, b, c, d] = [at(two[0], i), at(two[0], i + 1), at(two[1], i + 1), at(two[1], i)];
            if two[0][0] > 0.0 {
                out.push([a, b, c]);
            }
            if two[1][0] > 0.0 {
                out.push([a, c, d]);
            }
        }
    }
}

/// A convex outline moved along a vector; seen from where it comes from, the outline runs clockwise.
fn prism(outline: &[Vector3<f64>], along: &Vector3<f64>, out: &mut Vec<Corners>) {
    let n = outline.len();
    for i in 1..n - 1 {
        out.push([outline[0], outline[i + 1], outline[i]].map(Point3::from));
        out.push([outline[0] + along, outline[i] + along, outline[i + 1] + along].map(Point3::from));
    }
    for i in 0..n {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        out.push([a, b, b + along].map(Point3::from));
        out.push([a, b + along, a + along].map(Point3::from));
    }
}

/// Body by body: closed surfaces that reach into each other, with faces inside and corners that do not meet.
pub fn unfused() -> Vec<Corners> {
    let mut out = Vec::new();
    for body in &bodies() {
        body.triangles(&mut out);
    }
    out
}

/// The union as one closed surface: marching tetrahedra over a grid. Its edges are cut by half a step.
pub fn fused() -> Vec<Corners> {
    const STEP_MM: f64 = 1.25;
    let bodies = bodies();
    let value = |p: &Vector3<f64>| bodies.iter().map(|b| b.distance_mm(p)).fold(f64::INFINITY, f64::min);
    let low = Vector3::new(-56.3, -56.3, -12.1);
    let counts = [91_usize, 91, 43];
    let place = |c: [usize; 3]| low + Vector3::new(c[0] as f64, c[1] as f64, c[2] as f64) * STEP_MM;
    let index = |c: [usize; 3]| (c[2] * counts[1] + c[1]) * counts[0] + c[0];
    let mut values = Vec::with_capacity(counts.iter().product());
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            values.extend((0..counts[0]).map(|x| value(&place([x, y, z]))));
        }
    }
    // Six tetrahedra around the diagonal of a cube: neighbours agree on the faces between them.
    let paths = [[1, 3], [1, 5], [2, 3], [2, 6], [4, 5], [4, 6]];
    let mut out = Vec::new();
    for z in 0..counts[2] - 1 {
        for y in 0..counts[1] - 1 {
            for x in 0..counts[0] - 1 {
                let corner = |bits: usize| [x + (bits & 1), y + (bits >> 1 & 1), z + (bits >> 2 & 1)];
                for [a, b] in paths {
                    let tetrahedron = [0, a, b, 7].map(corner);
                    tetrahedron_surface(
                        &tetrahedron.map(|c| (index(c), place(c), values[index(c)])),
                        &mut out,
                    );
                }
            }
        }
    }
    out
}

/// The surface within a tetrahedron.
fn tetrahedron_surface(corners: &[(usize, Vector3<f64>, f64); 4], out: &mut Vec<Corners>) {
    let (inside, outside): (Vec<_>, Vec<_>) = corners.iter().partition(|c| c.2 < 0.0);
    // From the corner of the lower index, so that neighbours get the same bits.
    let cut = |a: &(usize, Vector3<f64>, f64), b: &(usize, Vector3<f64>, f64)| {
        let (a, b) = if a.0 < b.0 { (a, b) } else { (b, a) };
        Point3::from(a.1 + (b.1 - a.1) * (a.2 / (a.2 - b.2)))
    };
    let outwards = |middle: &[&(usize, Vector3<f64>, f64)]| {
        middle.iter().map(|c| c.1).sum::<Vector3<f64>>() / middle.len() as f64
    };
    if inside.is_empty() || outside.is_empty() {
        return;
    }
    let direction = outwards(&outside) - outwards(&inside);
    let mut push = |[a, b, c]: Corners| {
        let turned = (b - a).cross(&(c - a)).dot(&direction) < 0.0;
        out.push(if turned { [a, c, b] } else { [a, b, c] });
    };
    match (inside.as_slice(), outside.as_slice()) {
        ([a], [b, c, d]) | ([b, c, d], [a]) => push([cut(a, b), cut(a, c), cut(a, d)]),
        ([a, b], [c, d]) => {
            let (p, q, r, s) = (cut(a, c), cut(a, d), cut(b, d), cut(b, c));
            push([p, q, r]);
            push([p, r, s]);
        }
        _ => {}
    }
}

/// A binary STL file.
pub fn stl(triangles: &[Corners]) -> Vec<u8> {
    let mut bytes = vec![0_u8; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for corners in triangles {
        bytes.extend([0_u8; 12]);
        let values = corners.iter().flat_map(|p| p.iter().copied().collect::<Vec<f64>>());
        bytes.extend(values.flat_map(|v| (v as f32).to_le_bytes()));
        bytes.extend([0_u8; 2]);
    }
    bytes
}
