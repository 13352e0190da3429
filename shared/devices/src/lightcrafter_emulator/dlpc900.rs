//! An emulated DLPC900, after DLPU018J.

use super::erle::decompressed;
use super::{Board, Slow, bytes, number};
use cell::lightcrafter::{Place, taken};
use std::collections::BTreeMap;

/// Reads until a change of mode is done.
const READS_UNTIL_DONE: u32 = 3;

/// The mode of patterns that are sent.
const ON_THE_FLY: u8 = 3;

/// An image that is coming in: its number, its full length, what has come.
struct Coming {
    number: usize,
    bytes: usize,
    data: Vec<u8>,
}

/// The state of a board.
pub struct Dlpc900 {
    hardware: u8,
    size_px: [u32; 2],
    mode: Slow,
    patterns: Vec<[u8; 12]>,
    sequence: Option<[u8; 6]>,
    order: Vec<usize>,
    /// Patterns that are shown in all; 0: without end.
    shows: u32,
    /// For the left and the right controller.
    coming: [Option<Coming>; 2],
    images: [BTreeMap<usize, Vec<u8>>; 2],
    state: u8,
}

impl Dlpc900 {
    /// A board that was just switched on: 1 = DLP6500, 2 = DLP9000, 5 = DLP5500.
    pub fn new(hardware: u8) -> Self {
        let size_px = match hardware {
            1 => [1920, 1080],
            2 => [2560, 1600],
            _ => [1024, 768],
        };
        Self {
            hardware,
            size_px,
            mode: Slow::new(1),
            patterns: Vec::new(),
            sequence: None,
            order: Vec::new(),
            shows: 0,
            coming: [None, None],
            images: [BTreeMap::new(), BTreeMap::new()],
            state: 0,
        }
    }

    fn sides(&self) -> usize {
        if self.hardware == 2 { 2 } else { 1 }
    }

    fn stopped(&self) -> Result<(), String> {
        if self.state == 2 { Err("changed while the sequence runs".into()) } else { Ok(()) }
    }

    fn place(pattern: &[u8; 12]) -> Place {
        let from = u16::from_le_bytes([pattern[10], pattern[11]]);
        Place { image: (from & 0x7ff).into(), bit: (from >> 11) as u8, bits: (pattern[5] >> 1 & 7) + 1 }
    }

    fn define(&mut self, data: &[u8]) -> Result<(), String> {
        let pattern: [u8; 12] = bytes(data)?;
        let (index, exposure_us) = (number(&pattern[..2]) as usize, number(&pattern[2..5]));
        let place = Self::place(&pattern);
        if self.mode.settled() != Some(ON_THE_FLY) {
            return Err("patterns are defined after the mode is set".into());
        }
        if index > 399 || index > self.patterns.len() {
            return Err(format!("pattern {index} after {} patterns", self.patterns.len()));
        }
        if !matches!((place.bits, place.bit), (1, 0..24) | (8, 0 | 8 | 16)) || place.image > 17 {
            return Err(format!("{place:?}"));
        }
        let least_us = if place.bits == 8 { 4046 } else { 105 };
        let dark_us = number(&pattern[6..9]);
        if exposure_us < least_us || (dark_us != 0 && dark_us < 105) {
            return Err(format!("{exposure_us} µs, then {dark_us} µs dark, with {} bits", place.bits));
        }
        if !(1..=7).contains(&(pattern[5] >> 4 & 7)) || pattern[5] & 0x80 != 0 || pattern[9] > 1 {
            return Err("without light, or waiting for a trigger that nobody gives".into());
        }
        if index == 0 {
            self.patterns.clear();
        }
        self.patterns.push(pattern);
        self.sequence = None;
        Ok(())
    }

    fn begin_image(&mut self, side: usize, data: &[u8]) -> Result<(), String> {
        let data: [u8; 6] = bytes(data)?;
        let (index, length) = (number(&data[..2]) as usize, number(&data[2..]) as usize);
        if side >= self.sides() {
            return Err("there is no second controller".into());
        }
        if self.sequence.is_none() {
            return Err("images come after the control of the pattern table".into());
        }
        let last = self.patterns.iter().map(|pattern| Self::place(pattern).image).max().unwrap_or(0);
        let expected = self.images[side].keys().next().map_or(last, |least| least.wrapping_sub(1));
        if index != expected {
            return Err(format!("image {index}, but images come in reverse order: {expected} is next"));
        }
        self.coming[side] = Some(Coming { number: index, bytes: length, data: Vec::new() });
        Ok(())
    }

    fn image_data(&mut self, side: usize, data: &[u8]) -> Result<(), String> {
        let (count, part) = data.split_at_checked(2).ok_or("no number of bytes")?;
        if number(count) as usize != part.len() || part.len() > 504 {
            return Err(format!("{} bytes, of which {} are stated", part.len(), number(count)));
        }
        let coming = self.coming[side].as_mut().ok_or("no image was begun")?;
        coming.data.extend(part);
        if coming.data.len() < coming.bytes {
            return Ok(());
        }
        let (width, height, rgb) = decompressed(&coming.data)?;
        let sides = if self.hardware == 2 { 2 } else { 1 };
        if [width * sides, height] != self.size_px {
            return Err(format!("an image of {width} × {height} px"));
        }
        let number = coming.number;
        self.coming[side] = None;
        self.images[side].insert(number, rgb);
        Ok(())
    }

    fn start(&mut self, state: u8) -> Result<(), String> {
        if state == 2 {
            if self.mode.settled() != Some(ON_THE_FLY) || self.sequence.is_none() {
                return Err("started without mode or sequence".into());
            }
            for pattern in &self.patterns {
                let image = Self::place(pattern).image;
                if self.images[..self.sides()].iter().any(|side| !side.contains_key(&image)) {
                    return Err(format!("image {image} was not sent"));
                }
            }
        } else if state > 2 {
            return Err("states are 0, 1 and 2".into());
        }
        self.state = state;
        Ok(())
    }
}

impl Board for Dlpc900 {
    fn write(&mut self, command: u16, data: &[u8]) -> Result<(), String> {
        if command != 0x1a24 {
            self.stopped()?;
        }
        match command {
            0x1a1b => {
                let [mode] = bytes(data)?;
                if mode > 3 {
                    return Err("modes are 0 to 3".into());
                }
                self.mode.become_after(mode, READS_UNTIL_DONE);
                self.patterns.clear();
                self.sequence = None;
                self.images = [BTreeMap::new(), BTreeMap::new()];
            }
            0x1a34 => self.define(data)?,
            0x1a31 => {
                let sequence: [u8; 6] = bytes(data)?;
                if number(&sequence[..2]) as usize != self.patterns.len() {
                    return Err(format!("{} patterns are defined", self.patterns.len()));
                }
                self.sequence = Some(sequence);
                self.order = (0..self.patterns.len()).collect();
                self.images = [BTreeMap::new(), BTreeMap::new()];
            }
            0x1a32 => {
                let (head, order) = data.split_at_checked(6).ok_or("less than 6 bytes")?;
                let order: Vec<usize> = order.chunks(2).map(|index| number(index) as usize).collect();
                if number(&head[..2]) as usize != order.len() || self.sequence.is_none() {
                    return Err("the number of patterns is another one, or none are defined".into());
                }
                if order.is_empty() || order.iter().any(|index| *index >= self.patterns.len()) {
                    return Err(format!("{order:?} of {} patterns", self.patterns.len()));
                }
                self.order = order;
                self.shows = number(&head[2..]);
            }
            0x1a2a => self.begin_image(0, data)?,
            0x1a2c => self.begin_image(1, data)?,
            0x1a2b => self.image_data(0, data)?,
            0x1a2d => self.image_data(1, data)?,
            0x1a24 => {
                let [state] = bytes(data)?;
                self.start(state)?;
            }
            _ => return Err("unknown command".into()),
        }
        Ok(())
    }

    fn read(&mut self, command: u16) -> Result<Vec<u8>, String> {
        Ok(match command {
            0x1a0a => vec![if self.hardware == 2 { 0x11 } else { 1 }],
            0x1a0c => vec![if self.state == 2 { 2 } else { 0 }],
            0x0206 => {
                let mut answer = vec![self.hardware];
                answer.extend(b"emulated");
                answer.resize(33, 0);
                answer
            }
            0x1a1b => vec![self.mode.read()],
            0x1a31 => self.sequence.ok_or("no sequence")?.to_vec(),
            _ => return Err("unknown command, or one that cannot be read".into()),
        })
    }

    fn sequence(&self) -> Option<(Vec<Vec<u8>>, u32)> {
        let first = self.patterns.first()?;
        let period_us = number(&first[2..5]) + number(&first[6..9]);
        let patterns: Option<_> = self.order.iter().map(|number| self.levels(*number)).collect();
        (self.state == 2 && self.shows as usize == self.order.len()).then_some((patterns?, period_us))
    }

    fn shown(&self) -> Option<Vec<u8>> {
        self.levels(*self.order.first()?).filter(|_| self.state == 2)
    }
}

impl Dlpc900 {
    /// What the mirrors show of a pattern.
    fn levels(&self, number: usize) -> Option<Vec<u8>> {
        let pattern = self.patterns.get(number)?;
        let place = Self::place(pattern);
        let halves: Option<Vec<_>> =
            self.images[..self.sides()].iter().map(|side| side.get(&place.image)).collect();
        let row = self.size_px[0] as usize / self.sides();
        let halves: Vec<Vec<u8>> = halves?.iter().map(|rgb| taken(rgb, place)).collect();
        let rows = 0..self.size_px[1] as usize;
        let levels = rows.flat_map(|y| halves.iter().flat_map(move |half| &half[y * row..(y + 1) * row]));
        Some(levels.copied().collect())
    }
}
