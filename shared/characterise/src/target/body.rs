//! A target of several flat faces: a board with two sides, a cube, or boards on a frame. Each camera sees some of them.
//!
//! Faces are told apart by what is printed on them: by markers with other numbers, or by other numbers of columns and rows.

use super::attempts::rank;
use super::detection::{Ambiguity, Detection, detect};
use super::error::TargetError;
use super::settings::TargetSettings;
use super::spec::{TargetKind, TargetSpec};
use fringe::frame::FrameView;
use nalgebra::Isometry3;
use std::collections::BTreeSet;

/// Most faces of a target; an icosahedron has twenty.
pub const MAX_FACES: usize = 24;

/// A flat face of a target.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetFace {
    /// Name of the face, unique; empty of a target that is a single board.
    pub name: String,
    /// What is printed on it.
    pub spec: TargetSpec,
    /// From the middle of its points, with x along the rows, y along the columns and z into the face, to the frame of the target.
    pub target_from_middle: Isometry3<f64>,
    /// Whether that place is certified; else it is where the adjustment starts.
    pub fixed: bool,
}

/// A target with all its faces.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetBody {
    /// In the order of the file; one of a single board.
    pub faces: Vec<TargetFace>,
}

/// A face that was found in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceSighting {
    /// Index of the face.
    pub face: usize,
    /// Number of its first point among those of all faces.
    pub first: usize,
    /// The points that were found on it.
    pub detection: Detection,
}

impl TargetBody {
    /// A target that is one board.
    pub fn single(spec: TargetSpec) -> Self {
        let target_from_middle = Isometry3::identity();
        Self { faces: vec![TargetFace { name: String::new(), spec, target_from_middle, fixed: true }] }
    }

    /// The board of a target that is a single one.
    pub fn board(&self) -> Option<&TargetSpec> {
        match self.faces.as_slice() {
            [only] if only.name.is_empty() => Some(&only.spec),
            _ => None,
        }
    }

    /// Checks the faces, each by itself and against the others.
    ///
    /// # Errors
    /// The index of the face, and why it cannot be used.
    pub fn check(&self) -> Result<(), (usize, TargetError)> {
        for (number, face) in self.faces.iter().enumerate() {
            face.spec.check().map_err(|error| (number, error))?;
            if self.board().is_some() {
                return Ok(());
            }
            if face.name.is_empty() || self.faces[..number].iter().any(|other| other.name == face.name) {
                return Err((number, TargetError::FaceName { name: face.name.clone() }));
            }
            let (columns, rows) = (face.spec.columns, face.spec.rows);
            let turns = match face.spec.kind {
                TargetKind::Charuco | TargetKind::Aprilgrid => false,
                TargetKind::Checkerboard => (columns + rows).is_multiple_of(2),
                TargetKind::Circles | TargetKind::AsymmetricCircles => true,
            };
            if turns {
                return Err((number, TargetError::FaceTurns { name: face.name.clone(), columns, rows }));
            }
            if let Some(other) = self.faces[..number].iter().find(|other| alike(&other.spec, &face.spec)) {
                let names = [&other.name, &face.name].map(Clone::clone);
                return Err((number, TargetError::FacesAlike { names }));
            }
        }
        Ok(())
    }

    /// Number of points of all faces.
    pub fn count(&self) -> usize {
        self.faces.iter().map(|face| face.spec.count()).sum()
    }

    /// Number of a face's first point among those of all faces.
    pub fn first(&self, face: usize) -> usize {
        self.faces[..face].iter().map(|face| face.spec.count()).sum()
    }
}

/// Whether an image of one face could be taken for the other.
fn alike(a: &TargetSpec, b: &TargetSpec) -> bool {
    if let (Some(marks), Some(others)) = (a.marking(), b.marking()) {
        // The sizes of a dictionary are its first markers, so that dictionaries of one family share numbers, too.
        let family = marks.dictionary.codes().first() == others.dictionary.codes().first();
        let numbers: BTreeSet<usize> = a.marker_numbers().collect();
        return family && b.marker_numbers().any(|number| numbers.contains(&number));
    }
    let extent = |spec: &TargetSpec| (spec.columns.min(spec.rows), spec.columns.max(spec.rows));
    // A ChArUco board is a checkerboard, too.
    extent(a) == extent(b) && a.kind != TargetKind::Aprilgrid && b.kind != TargetKind::Aprilgrid
}

/// Finds the faces of a target in a frame.
///
/// # Errors
/// As [`detect`], where no face is found: the most telling refusal.
pub fn detect_body(
    frame: &FrameView,
    body: &TargetBody,
    settings: &TargetSettings,
) -> Result<Vec<FaceSighting>, TargetError> {
    let (mut found, mut first, mut why) = (Vec::new(), 0, None);
    let single = body.board().is_some();
    for (face, TargetFace { spec, .. }) in body.faces.iter().enumerate() {
        match detect(frame, spec, settings) {
            Ok(detection) if single || detection.ambiguity == Ambiguity::None => {
                found.push(FaceSighting { face, first, detection });
            }
            Err(error) if why.as_ref().is_none_or(|known| rank(&error) > rank(known)) => why = Some(error),
            Ok(_) | Err(_) => {}
        }
        first += spec.count();
    }
    match (found.is_empty(), why) {
        (true, Some(error)) => Err(error),
        (true, None) => Err(TargetError::NoTarget { what: "face of the target", candidates: 0 }),
        (false, _) => Ok(found),
    }
}
