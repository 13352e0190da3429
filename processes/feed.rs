//! What the supervisor sends to the monitor: lines of JSON over a socket pair, a scan followed by its bytes.
//!
//! Both ends are the same executable, so the bytes of a scan need no format of their own. The monitor answers with single
//! bytes, each of which asks for one scan: without a viewer none is made.

use crate::supervisor::collect::Span;
use crate::supervisor::protocol::StateReport;
use anyhow::{Context, Result, ensure};
use files::result::CycleResult;
use fringe::cloud::Point;
use fringe::pattern::Axis;
use fringe::phase::{PhaseInfo, PhaseMap};
use serde::{Deserialize, Serialize};
use std::io::{BufRead, Read, Write};

/// Longest line of JSON: a result with 1 MB of features, twice escaped.
const MAX_LINE: u64 = 8 << 20;

/// Points of a scan: as many as a page draws at once. Of a larger cloud every n-th point is sent.
pub const MAX_POINTS: usize = 1_000_000;

/// Longest edge of the pictures and phase maps of a scan, px. Of a larger one every n-th pixel is sent.
pub const MAX_EDGE: u32 = 960;

/// One message of the supervisor.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Message {
    /// State, job and recipes.
    State(StateReport),
    /// A cycle has its outcome.
    Ended(Box<Ended>),
    /// Pictures, phase maps and cloud follow.
    Scan(ScanHeader),
}

/// The outcome of a cycle with the times of its activations.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Ended {
    /// As `result.json` has it.
    pub result: CycleResult,
    /// Times of the activations, in the order of the schedule.
    pub spans: Vec<Span>,
}

/// What follows the line of a scan.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ScanHeader {
    /// Number of the last cycle with an outcome, from 1.
    pub number: u64,
    /// Number of the cycle of the cloud: the last one that was ok.
    pub cloud_number: u64,
    /// Number of points that follow.
    pub points: usize,
    /// Points of the whole cloud.
    pub all_points: usize,
    /// Pictures in the order in which their bytes follow.
    pub pictures: Vec<RasterHeader>,
    /// Phase maps in the order in which their planes follow.
    pub maps: Vec<RasterHeader>,
}

/// A picture or a phase map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RasterHeader {
    /// Number of the cycle, from 1.
    pub number: u64,
    /// Index of the camera.
    pub camera: u32,
    /// Index of the projector that was on.
    pub projector: u32,
    /// 0 along columns, 1 along rows; 0 of a picture.
    pub axis: u32,
    /// Columns that follow, px.
    pub width_px: u32,
    /// Rows that follow, px.
    pub height_px: u32,
    /// Every n-th column and row of the camera is sent.
    pub step: u32,
    /// Period of the fringes, projector px; 0 of a picture.
    pub period_px: f64,
}

impl RasterHeader {
    fn pixels(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }

    fn check(&self) -> Result<()> {
        let fits = self.width_px <= MAX_EDGE && self.height_px <= MAX_EDGE;
        ensure!(fits, "a picture of {} × {} px; the limit is {MAX_EDGE}", self.width_px, self.height_px);
        Ok(())
    }
}

/// A scan as the page shows it.
#[derive(Debug, Default)]
pub struct Scan {
    /// Sizes of all that there is.
    pub header: ScanHeader,
    /// Points of the fused cloud.
    pub points: Vec<Point>,
    /// Grey values of each picture, 255 is saturated.
    pub pictures: Vec<Vec<u8>>,
    /// The phase maps, one per camera, projector and axis.
    pub maps: Vec<PhaseMap>,
}

/// Sends a message.
///
/// # Errors
/// The monitor has ended.
pub fn send(stream: &mut impl Write, message: &Message) -> Result<()> {
    let mut line = serde_json::to_vec(message)?;
    line.push(b'\n');
    Ok(stream.write_all(&line)?)
}

/// Sends a scan.
///
/// # Errors
/// The monitor has ended.
pub fn send_scan(stream: &mut impl Write, scan: &Scan) -> Result<()> {
    send(stream, &Message::Scan(scan.header.clone()))?;
    stream.write_all(bytemuck::cast_slice(&scan.points))?;
    for picture in &scan.pictures {
        stream.write_all(picture)?;
    }
    for map in &scan.maps {
        for plane in [&map.phase_rad, &map.sigma_rad, &map.modulation] {
            stream.write_all(bytemuck::cast_slice(plane))?;
        }
        stream.write_all(&map.valid)?;
    }
    Ok(())
}

/// Receives the next message; `None` at the end of the run.
///
/// # Errors
/// A line that is no message.
pub fn receive(stream: &mut impl BufRead) -> Result<Option<Message>> {
    let mut line = Vec::new();
    stream.by_ref().take(MAX_LINE).read_until(b'\n', &mut line)?;
    if line.is_empty() {
        return Ok(None);
    }
    serde_json::from_slice(&line).context("a message of the supervisor").map(Some)
}

/// Receives what follows the line of a scan.
///
/// # Errors
/// The supervisor has ended, or announces more than may be.
pub fn receive_scan(stream: &mut impl Read, header: ScanHeader) -> Result<Scan> {
    ensure!(header.points <= MAX_POINTS, "a scan of {} points; the limit is {MAX_POINTS}", header.points);
    header.pictures.iter().chain(&header.maps).try_for_each(RasterHeader::check)?;
    let mut points = vec![<Point as bytemuck::Zeroable>::zeroed(); header.points];
    stream.read_exact(bytemuck::cast_slice_mut(&mut points))?;
    let mut pictures = Vec::with_capacity(header.pictures.len());
    for picture in &header.pictures {
        let mut values = vec![0; picture.pixels()];
        stream.read_exact(&mut values)?;
        pictures.push(values);
    }
    let mut maps = Vec::with_capacity(header.maps.len());
    for map in &header.maps {
        maps.push(receive_map(stream, map)?);
    }
    Ok(Scan { header, points, pictures, maps })
}

fn receive_map(stream: &mut impl Read, header: &RasterHeader) -> Result<PhaseMap> {
    let axis = if header.axis == 0 { Axis::X } else { Axis::Y };
    let (width_px, height_px) = (header.width_px, header.height_px);
    let info = PhaseInfo { width_px, height_px, axis, period_px: header.period_px };
    let mut plane = || -> Result<Vec<f32>> {
        let mut values = vec![0.0; header.pixels()];
        stream.read_exact(bytemuck::cast_slice_mut(&mut values))?;
        Ok(values)
    };
    let (phase_rad, sigma_rad, modulation) = (plane()?, plane()?, plane()?);
    let mut valid = vec![0; header.pixels()];
    stream.read_exact(&mut valid)?;
    Ok(PhaseMap { info, phase_rad, sigma_rad, modulation, valid })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan() -> Scan {
        let raster = |width_px, height_px, axis| RasterHeader {
            number: 3,
            camera: 1,
            projector: 0,
            axis,
            width_px,
            height_px,
            step: 2,
            period_px: 16.0,
        };
        let point = Point { position_mm: [1.0, 2.0, 3.0], sigma_mm: 0.5, ..bytemuck::Zeroable::zeroed() };
        let (picture, map) = (raster(2, 1, 0), raster(1, 2, 1));
        let info = PhaseInfo { width_px: 1, height_px: 2, axis: Axis::Y, period_px: 16.0 };
        Scan {
            header: ScanHeader {
                number: 3,
                cloud_number: 2,
                points: 2,
                all_points: 9,
                pictures: vec![picture],
                maps: vec![map],
            },
            points: vec![point; 2],
            pictures: vec![vec![7, 255]],
            maps: vec![PhaseMap {
                info,
                phase_rad: vec![1.0, 2.0],
                sigma_rad: vec![0.1, 0.2],
                modulation: vec![30.0, 40.0],
                valid: vec![1, 0],
            }],
        }
    }

    #[test]
    fn a_scan_arrives_as_it_was_sent_and_the_line_after_it_is_found() {
        let mut bytes = Vec::new();
        send_scan(&mut bytes, &scan()).unwrap();
        send_scan(&mut bytes, &Scan::default()).unwrap();
        let mut stream = &bytes[..];
        let Some(Message::Scan(header)) = receive(&mut stream).unwrap() else { panic!("no scan") };
        let came = receive_scan(&mut stream, header).unwrap();
        let sent = scan();
        assert_eq!((&came.header, &came.points), (&sent.header, &sent.points));
        assert_eq!((&came.pictures, &came.maps), (&sent.pictures, &sent.maps));
        assert!(matches!(receive(&mut stream).unwrap(), Some(Message::Scan(header)) if header.points == 0));
        assert!(receive(&mut stream).unwrap().is_none());
    }

    #[test]
    fn a_scan_that_is_cut_short_or_too_large_is_an_error() {
        let mut bytes = Vec::new();
        send_scan(&mut bytes, &scan()).unwrap();
        let mut stream = &bytes[..bytes.len() - 1];
        let Some(Message::Scan(header)) = receive(&mut stream).unwrap() else { panic!("no scan") };
        assert!(receive_scan(&mut stream, header.clone()).is_err());
        let many = ScanHeader { points: MAX_POINTS + 1, ..header.clone() };
        assert!(receive_scan(&mut &bytes[..], many).unwrap_err().to_string().contains("limit"));
        let mut wide = header;
        wide.maps[0].width_px = MAX_EDGE + 1;
        assert!(receive_scan(&mut &bytes[..], wide).unwrap_err().to_string().contains("limit"));
        assert!(receive(&mut &b"{\"dance\":1}\n"[..]).is_err());
    }
}
