//! Values of a YAML file by their path.

use crate::error::{FileError, Problem};
use crate::opencv::lens_from_opencv;
use fringe::geometry::camera::{Lens, pose};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};
use yaml_rust2::parser::{Event, Parser};
use yaml_rust2::{Yaml, YamlLoader};

/// Deepest nesting of a calibration, with room; the reader of the library calls itself for each level.
const MAX_DEPTH: usize = 32;

/// A YAML file, or a part of it.
pub(super) struct Tree {
    path: PathBuf,
    root: Yaml,
}

impl Tree {
    /// Reads the first document of a text.
    ///
    /// # Errors
    /// No YAML; references, which could make little text large; nesting beyond any calibration.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let fault = |message: String| {
            FileError::new(
                path,
                Problem::Syntax(message),
                "name a calibration of OpenCV, ROS, Kalibr, mrcal or MATLAB",
            )
        };
        let mut parser = Parser::new_from_str(text);
        let mut depth = 0_usize;
        loop {
            let (event, mark) = parser.next_token().map_err(|error| fault(format!("is no YAML: {error}")))?;
            match event {
                Event::StreamEnd => break,
                Event::Alias(_) => return Err(fault(format!("refers to itself in line {}", mark.line()))),
                Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
                Event::SequenceEnd | Event::MappingEnd => depth = depth.saturating_sub(1),
                _ => {}
            }
            if depth > MAX_DEPTH {
                return Err(fault(format!(
                    "is nested more than {MAX_DEPTH} levels deep in line {}",
                    mark.line()
                )));
            }
        }
        let documents =
            YamlLoader::load_from_str(text).map_err(|error| fault(format!("is no YAML: {error}")))?;
        let root = documents.into_iter().next().unwrap_or(Yaml::Null);
        Ok(Self { path: path.to_owned(), root })
    }

    /// Whether there is a value at a path such as `cam0.intrinsics`.
    pub fn has(&self, key: &str) -> bool {
        !self.at(key).is_badvalue()
    }

    fn at(&self, key: &str) -> &Yaml {
        key.split('.').fold(&self.root, |value, part| &value[part])
    }

    /// A fault of a value.
    pub fn fault(&self, key: &str, problem: Problem) -> FileError {
        FileError::new(&self.path, problem, "").at(key)
    }

    fn missing(&self, key: &str) -> FileError {
        self.fault("", Problem::Missing(format!("the key {key}")))
    }

    /// A text, if it is there.
    pub fn text(&self, key: &str) -> Option<String> {
        self.at(key).as_str().map(str::to_owned)
    }

    /// A whole number of pixels.
    pub fn pixels(&self, key: &str) -> Result<u32, FileError> {
        if !self.has(key) {
            return Err(self.missing(key));
        }
        whole(self.at(key)).ok_or_else(|| {
            self.fault(
                key,
                Problem::Value { value: format!("{:?}", self.at(key)), limit: "1 … 65535 px".into() },
            )
        })
    }

    /// Two whole numbers of pixels.
    pub fn size(&self, key: &str) -> Result<[u32; 2], FileError> {
        let of = self.numbers(key)?;
        match of[..] {
            [a, b] if [a, b].iter().all(|v| v.fract() == 0.0 && (1.0..=65_535.0).contains(v)) => {
                Ok([a as u32, b as u32])
            }
            _ => {
                Err(self
                    .fault(key, Problem::Value { value: format!("{of:?}"), limit: "two sizes in px".into() }))
            }
        }
    }

    /// Numbers of a list, of lists in a list row by row, or of one number.
    ///
    /// # Errors
    /// The key is absent, or something there is no finite number.
    pub fn numbers(&self, key: &str) -> Result<Vec<f64>, FileError> {
        if !self.has(key) {
            return Err(self.missing(key));
        }
        let mut numbers = Vec::new();
        if flatten(self.at(key), &mut numbers) && numbers.iter().all(|v| v.is_finite()) {
            return Ok(numbers);
        }
        let limit = "a list of finite numbers".into();
        Err(self.fault(key, Problem::Value { value: "something else".into(), limit }))
    }

    /// A list of exactly so many numbers.
    pub fn exactly<const N: usize>(&self, key: &str) -> Result<[f64; N], FileError> {
        let numbers = self.numbers(key)?;
        let count = numbers.len();
        numbers.try_into().map_err(|_| {
            self.fault(
                key,
                Problem::Value { value: format!("{count} numbers"), limit: format!("{N} numbers") },
            )
        })
    }

    /// Three rows of three numbers.
    pub fn rotation(&self, key: &str) -> Result<[[f64; 3]; 3], FileError> {
        let m: [f64; 9] = self.exactly(key)?;
        Ok([[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]])
    }

    /// A lens in OpenCV's order k1, k2, p1, p2, k3, k4 …, or the four coefficients of a fisheye.
    pub fn lens(&self, key: &str, fisheye: bool) -> Result<Lens, FileError> {
        lens_from_opencv(&self.numbers(key)?, fisheye).map_err(|problem| self.fault(key, problem))
    }

    /// A motion from its rotation and its translation, mm.
    pub fn motion(
        &self,
        key: &str,
        rotation: [[f64; 3]; 3],
        t_mm: [f64; 3],
    ) -> Result<Isometry3<f64>, FileError> {
        pose(rotation, t_mm).map_err(|error| self.fault(key, Problem::Camera(error)))
    }

    /// A 4 × 4 matrix as a motion; its translation is scaled.
    pub fn matrix4(&self, key: &str, unit_mm: f64) -> Result<Isometry3<f64>, FileError> {
        let m: [f64; 16] = self.exactly(key)?;
        let bottom = [m[12], m[13], m[14], m[15] - 1.0];
        if bottom.iter().any(|v| v.abs() > 1e-9) {
            let limit = "0 0 0 1".into();
            return Err(self.fault(key, Problem::Value { value: format!("last row {:?}", &m[12..]), limit }));
        }
        let rotation = [[m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]];
        self.motion(key, rotation, [m[3], m[7], m[11]].map(|v| v * unit_mm))
    }
}

fn whole(value: &Yaml) -> Option<u32> {
    let number = number(value)?;
    (number.fract() == 0.0 && (1.0..=65_535.0).contains(&number)).then_some(number as u32)
}

fn number(value: &Yaml) -> Option<f64> {
    match value {
        Yaml::Integer(number) => Some(*number as f64),
        Yaml::Real(_) => value.as_f64(),
        _ => None,
    }
}

/// Adds the numbers of a value; false where something is no number.
fn flatten(value: &Yaml, numbers: &mut Vec<f64>) -> bool {
    match value {
        Yaml::Array(values) => values.iter().all(|value| flatten(value, numbers)),
        other => number(other).map(|number| numbers.push(number)).is_some(),
    }
}
