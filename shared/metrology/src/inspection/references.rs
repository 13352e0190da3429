//! What refers to elements by their index: elements made of others, datum systems.

/// How an element is made of others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Construction {
    /// What elements have in common: of two planes a line, of plane and axis or three planes a point, of plane and
    /// cylinder, cone or sphere a circle, of two axes the middle of their shortest connection.
    Intersection,
    /// The first element projected: a point onto a plane or axis, an axis onto a plane.
    Projection,
    /// The middle plane of two planes, two points or two parallel axes, or that of a slot or rectangle along its length.
    SymmetryPlane,
    /// The middle of two points.
    MiddlePoint,
    /// The least-squares line through points.
    FitLine,
    /// The least-squares plane through points.
    FitPlane,
    /// The least-squares circle through points.
    FitCircle,
}

/// An element made of others.
#[derive(Debug, Clone, PartialEq)]
pub struct Constructed {
    /// Name, unique among all elements.
    pub name: String,
    /// How it is made.
    pub construction: Construction,
    /// Elements it is made of: measured ones by their index, constructed ones after them.
    pub elements: Vec<usize>,
}

/// An ordered datum system.
#[derive(Debug, Clone, PartialEq)]
pub struct DatumSystem {
    /// Name, unique among the plan's datum systems.
    pub name: String,
    /// Elements of each step, in the order of precedence.
    pub steps: Vec<Vec<usize>>,
}

impl DatumSystem {
    /// The elements' names, steps parted by bars, elements of one step by dashes, as in |A|B-C|.
    pub fn letters<'a>(&self, name: &dyn Fn(usize) -> &'a str) -> String {
        let step = |step: &Vec<usize>| step.iter().map(|i| name(*i)).collect::<Vec<_>>().join("-");
        format!("|{}|", self.steps.iter().map(step).collect::<Vec<_>>().join("|"))
    }
}
