//! The entities of a STEP file by number: types, references, numbers.

use super::part21::{self, Entities, Record, Value};
use crate::error::{FileError, Problem};
use metrology::cad::Frame;
use nalgebra::{Matrix3, Point3, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The entities of a file, with the path for messages.
pub(super) struct Graph {
    path: PathBuf,
    entities: Entities,
    of_type: BTreeMap<String, Vec<u64>>,
}

impl Graph {
    pub fn read(path: &Path, bytes: &[u8]) -> Result<Self, FileError> {
        let entities = part21::parse(bytes).map_err(|fault| {
            let problem = Problem::Syntax(format!("is no readable STEP file: {}", fault.message));
            let mut error = FileError::new(path, problem, "truncated? export or copy it again");
            error.line = Some(fault.line);
            error
        })?;
        let mut of_type: BTreeMap<String, Vec<u64>> = BTreeMap::new();
        for (id, records) in &entities {
            for Record { name, .. } in records {
                match of_type.get_mut(name) {
                    Some(list) => list.push(*id),
                    None => drop(of_type.insert(name.clone(), vec![*id])),
                }
            }
        }
        Ok(Self { path: path.to_owned(), entities, of_type })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Numbers of the entities of a type, rising.
    pub fn all(&self, name: &str) -> &[u64] {
        self.of_type.get(name).map_or(&[], Vec::as_slice)
    }

    /// A fault of an entity.
    pub fn fault(&self, id: u64, what: &str) -> FileError {
        let problem = Problem::Syntax(format!("#{id} ({}): {what}", self.kind(id)));
        FileError::new(&self.path, problem, "export the part again, or as STL")
    }

    /// A fault of an entity that is as it should be, but not read.
    pub fn unread(&self, id: u64, remedy: &str) -> FileError {
        let problem = Problem::Unsupported(format!("#{id} ({}) is not read", self.kind(id)));
        FileError::new(&self.path, problem, remedy)
    }

    /// Types of an entity, for messages.
    pub fn kind(&self, id: u64) -> String {
        let Some(records) = self.entities.get(&id) else { return "absent".into() };
        records.iter().map(|r| r.name.as_str()).collect::<Vec<_>>().join(" ")
    }

    /// Parameters of an entity under one of its types.
    pub fn record(&self, id: u64, name: &str) -> Option<&[Value]> {
        let records = self.entities.get(&id)?;
        records.iter().find(|r| r.name == name).map(|r| r.params.as_slice())
    }

    /// Parameters of an entity that must be of a type.
    pub fn params(&self, id: u64, name: &str) -> Result<&[Value], FileError> {
        self.record(id, name).ok_or_else(|| self.fault(id, &format!("where a {name} is needed")))
    }

    /// A reference among the parameters.
    pub fn reference(&self, id: u64, params: &[Value], at: usize) -> Result<u64, FileError> {
        match params.get(at) {
            Some(Value::Ref(other)) => Ok(*other),
            _ => Err(self.fault(id, &format!("parameter {} is no reference", at + 1))),
        }
    }

    /// The references of a list among the parameters.
    pub fn list(&self, id: u64, params: &[Value], at: usize) -> Result<Vec<u64>, FileError> {
        match params.get(at) {
            Some(Value::List(items)) => Ok(references(items)),
            _ => Err(self.fault(id, &format!("parameter {} is no list", at + 1))),
        }
    }

    /// A finite number among the parameters.
    pub fn number(&self, id: u64, params: &[Value], at: usize) -> Result<f64, FileError> {
        let found = params.get(at).and_then(number).filter(|v| v.is_finite());
        found.ok_or_else(|| self.fault(id, &format!("parameter {} is no finite number", at + 1)))
    }

    /// Whether a parameter is true.
    pub fn truth(&self, id: u64, params: &[Value], at: usize) -> Result<bool, FileError> {
        match params.get(at) {
            Some(Value::Word(word)) if word == "T" => Ok(true),
            Some(Value::Word(word)) if word == "F" => Ok(false),
            _ => Err(self.fault(id, &format!("parameter {} is neither .T. nor .F.", at + 1))),
        }
    }

    /// The finite numbers of a list among the parameters.
    pub fn numbers(&self, id: u64, params: &[Value], at: usize) -> Result<Vec<f64>, FileError> {
        let numbers: Option<Vec<f64>> = match params.get(at) {
            Some(Value::List(items)) => items.iter().map(number).collect(),
            _ => None,
        };
        let finite = numbers.filter(|n| n.iter().all(|v| v.is_finite()));
        finite.ok_or_else(|| self.fault(id, &format!("parameter {} is no list of finite numbers", at + 1)))
    }

    fn triple(&self, id: u64, name: &str) -> Result<[f64; 3], FileError> {
        let numbers = self.numbers(id, self.params(id, name)?, 1)?;
        numbers.try_into().map_err(|_| self.fault(id, "has not three numbers"))
    }

    /// A point, in the unit of its file.
    pub fn point(&self, id: u64) -> Result<Point3<f64>, FileError> {
        self.triple(id, "CARTESIAN_POINT").map(Point3::from)
    }

    /// The direction of an entity, of unit length.
    pub fn direction(&self, id: u64) -> Result<Vector3<f64>, FileError> {
        let given = Vector3::from(self.triple(id, "DIRECTION")?);
        given.try_normalize(1e-12).ok_or_else(|| self.fault(id, "has no length"))
    }

    /// An AXIS2_PLACEMENT_3D: its third axis exactly, the first made perpendicular to it; the origin times a scale.
    pub fn frame(&self, id: u64, scale: f64) -> Result<Frame, FileError> {
        let params = self.params(id, "AXIS2_PLACEMENT_3D")?;
        let origin = self.point(self.reference(id, params, 1)?)? * scale;
        let optional = |at: usize| match params.get(at) {
            Some(Value::Ref(other)) => self.direction(*other).map(Some),
            _ => Ok(None),
        };
        let z = optional(2)?.unwrap_or_else(Vector3::z);
        let given =
            optional(3)?.unwrap_or_else(|| if z.x.abs() > 0.99 { Vector3::y() } else { Vector3::x() });
        let across = given - z * given.dot(&z);
        let x = across.try_normalize(1e-9).ok_or_else(|| self.fault(id, "its directions are parallel"))?;
        Ok(Frame { origin, axes: Matrix3::from_columns(&[x, z.cross(&x), z]) })
    }

    /// Name of an entity: its first parameter, without what does not print.
    pub fn name(params: &[Value]) -> String {
        match params.first() {
            Some(Value::Text(text)) => {
                let hidden = |c: &char| !c.is_control() && fringe::text::is_printable(&c.to_string());
                text.chars().filter(hidden).take(200).collect()
            }
            _ => String::new(),
        }
    }
}

/// The references among values.
pub(super) fn references(values: &[Value]) -> Vec<u64> {
    let one = |value: &Value| if let Value::Ref(id) = value { Some(*id) } else { None };
    values.iter().filter_map(one).collect()
}

/// A number, with or without the name of its measure.
pub(super) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Number(v) => Some(*v),
        Value::Typed(_, inner) => number(inner),
        _ => None,
    }
}
