//! An emulated DLPC350, after DLPU010 and the comments of the manufacturer's `dlpc350_api.cpp`.

use super::{Board, Slow, bytes, number};
use cell::lightcrafter::{Place, taken};

/// Reads until a change of mode or a check is done.
const READS_UNTIL_DONE: u32 = 2;

/// Shortest exposures by bits, µs (DLPU010, table of exposures).
const LEAST_US: [u32; 8] = [235, 700, 1570, 1700, 2000, 2500, 4500, 8333];

/// Time to load an image from flash at worst, µs (DLPU011, pattern sequence background); two are loaded before the start.
const LOAD_US: u32 = 200_000;
const LOADED: usize = 2;

/// Bits of a row of the pattern table: dark after the exposure, exchange of images.
const DARK: u32 = 1 << 17;
const SWAP: u32 = 1 << 18;

/// The picture that stands at the video input, three bytes a pixel; none without a signal.
type Video = Box<dyn Fn() -> Option<Vec<u8>> + Send>;

/// The picture of a display at the video input, from the four bytes of its pixels (blue, green, red, none).
///
/// It is here because tests are compiled without optimisation: the board looks at its input whenever it is asked, and its driver waits meanwhile.
pub fn picture_of_display(pixels: &[u8]) -> Vec<u8> {
    let mut picture = Vec::with_capacity(pixels.len() / 4 * 3);
    for pixel in pixels.chunks_exact(4) {
        picture.extend_from_slice(&[pixel[2], pixel[1], pixel[0]]);
    }
    picture
}

/// The state of a board with images in flash and perhaps a cable at its video input.
pub struct Dlpc350 {
    /// Images in flash, three bytes a pixel.
    flash: Vec<Vec<u8>>,
    video: Option<Video>,
    power: u8,
    mode: Slow,
    source: u8,
    trigger: u8,
    times_us: [u32; 2],
    sequence: [u8; 4],
    trigger_out: [u8; 3],
    table: u8,
    place: usize,
    images: Vec<u8>,
    patterns: Vec<u8>,
    /// The result of a check; absent: something was changed since.
    checked: Option<Slow>,
    state: u8,
}

impl Dlpc350 {
    /// A board that was just switched on, with these images in flash.
    pub fn new(flash: Vec<Vec<u8>>) -> Self {
        Self {
            flash,
            video: None,
            power: 0,
            mode: Slow::new(0),
            source: 0,
            trigger: 0,
            times_us: [0; 2],
            sequence: [0; 4],
            trigger_out: [0, 0xbb, 0xbb],
            table: 0,
            place: 0,
            images: vec![0; 64],
            patterns: vec![0; 128 * 3],
            checked: None,
            state: 0,
        }
    }

    /// A board whose video input shows what `video` gives.
    pub fn with_video(video: impl Fn() -> Option<Vec<u8>> + Send + 'static) -> Self {
        Self { video: Some(Box::new(video)), ..Self::new(Vec::new()) }
    }

    /// The picture at the video input.
    fn picture(&self) -> Option<Vec<u8>> {
        self.video.as_ref()?()
    }

    /// Whether it shows its sequence: with the video input only while there is a signal.
    fn runs(&self) -> bool {
        self.state == 2 && (self.source == 3 || self.picture().is_some())
    }

    /// The place of each pattern of the sequence; images follow each other in the order of their table.
    fn places(&self) -> Vec<Place> {
        let mut image = 0;
        let place = |number: usize| {
            let entry = self.entry(number);
            let (bits, pattern) = (((entry >> 8) & 0xf) as u8, ((entry >> 2) & 0x3f) as u8);
            image += usize::from(number > 0 && entry & SWAP != 0);
            let image = self.images.get(image).copied().unwrap_or(u8::MAX);
            Place { image: image.into(), bit: if bits == 8 { pattern * 8 } else { pattern }, bits }
        };
        (0..=usize::from(self.sequence[0])).map(place).collect()
    }

    /// What the tables must agree on beside what the board itself checks: images and their exchanges, light and its end.
    fn consistent(&self) -> Result<(), String> {
        let [exposure_us, period_us] = self.times_us;
        let entries: Vec<u32> =
            (0..=usize::from(self.sequence[0])).map(|number| self.entry(number)).collect();
        if entries.iter().any(|entry| (entry & DARK != 0) != (period_us > exposure_us)) {
            return Err("a dark time without black, or black without a dark time".into());
        }
        let swaps: Vec<usize> = (0..entries.len()).filter(|number| entries[*number] & SWAP != 0).collect();
        if swaps.first() != Some(&0) || (self.source == 3 && swaps.len() != usize::from(self.sequence[3]) + 1)
        {
            return Err(format!("{} exchanges of {} images", swaps.len(), self.sequence[3] + 1));
        }
        if self.sequence[1] == 0 && self.sequence[2] != self.sequence[0] {
            return Err("a sequence that is shown once shows another number of patterns than it has".into());
        }
        // While the patterns of one image stand the next one is loaded.
        let late = |pair: &[usize]| ((pair[1] - pair[0]) as u32).saturating_mul(period_us) < LOAD_US;
        if self.source == 3 && swaps.len() > LOADED && swaps.windows(2).any(late) {
            return Err("an image is not loaded when its turn comes".into());
        }
        Ok(())
    }

    /// What may only be changed while nothing is shown makes the last check worthless.
    fn change(&mut self) -> Result<(), String> {
        if self.state == 2 {
            return Err("changed while the sequence runs".into());
        }
        self.checked = None;
        Ok(())
    }

    fn entry(&self, number: usize) -> u32 {
        super::number(&self.patterns[number * 3..number * 3 + 3])
    }

    /// The bits of a check: exposure and period, numbers of patterns, the pause of the trigger, the difference of the times.
    fn check(&self) -> u8 {
        let mut found = 0;
        let [exposure_us, period_us] = self.times_us;
        for number in 0..=usize::from(self.sequence[0]) {
            let entry = self.entry(number);
            let (pattern, bits) = ((entry >> 2) & 0x3f, (entry >> 8) & 0xf);
            if !(1..=8).contains(&bits)
                || pattern >= 24 / bits.max(1)
                || !(1..=7).contains(&((entry >> 12) & 7))
                || entry >> 20 != 0
            {
                found |= 2;
            } else if exposure_us < LEAST_US[bits as usize - 1] || period_us < exposure_us {
                found |= 1;
            }
        }
        if self.source == 3
            && self.images[..=usize::from(self.sequence[3])]
                .iter()
                .any(|i| usize::from(*i) >= self.flash.len())
        {
            found |= 2;
        }
        if period_us - exposure_us.min(period_us) < 230 {
            // Warnings: no pause between two triggers, a short difference.
            found |= 0x14;
        }
        found
    }

    fn start(&mut self, data: &[u8]) -> Result<(), String> {
        let [state] = bytes(data)?;
        let ready = self
            .checked
            .and_then(|checked| checked.settled())
            .is_some_and(|found| found.trailing_zeros() >= 2);
        match state {
            0 | 1 => {}
            2 if self.mode.settled() != Some(1) => return Err("not in pattern mode".into()),
            2 if self.table != 0 => return Err("a table is open".into()),
            2 if self.power != 0 => return Err("in standby".into()),
            2 if !ready => return Err("started without a check".into()),
            3.. => return Err("states are 0, 1 and 2".into()),
            2 => {
                self.trigger_fires()?;
                self.consistent()?;
            }
        }
        self.state = state;
        Ok(())
    }

    /// Patterns from flash start by themselves, those of the video with its vertical sync.
    fn trigger_fires(&self) -> Result<(), String> {
        if self.trigger == u8::from(self.source == 3) {
            Ok(())
        } else {
            Err("started by a trigger that does not come".into())
        }
    }

    fn write_table(&mut self, command: u16, data: &[u8]) -> Result<(), String> {
        if command == 0x1a32 {
            let [place] = bytes(data)?;
            if place > 127 || self.table == 0 {
                return Err("a place of an open table is 0 to 127".into());
            }
            self.place = place.into();
            return Ok(());
        }
        self.change()?;
        if command == 0x1a33 {
            let [table] = bytes(data)?;
            if table != 0 && self.table != 0 {
                return Err("another table is open".into());
            }
            (self.table, self.place) = (table, 0);
            return Ok(());
        }
        let row = if self.table == 2 { 3 } else { 1 };
        let from = self.place * row;
        let table = self.table()?;
        match table.get_mut(from..from + data.len()) {
            Some(part) if data.len().is_multiple_of(row) => part.copy_from_slice(data),
            _ => return Err("the data do not fit the table".into()),
        }
        Ok(())
    }

    fn table(&mut self) -> Result<&mut Vec<u8>, String> {
        match self.table {
            1 => Ok(&mut self.images),
            2 => Ok(&mut self.patterns),
            _ => Err("no table is open".into()),
        }
    }
}

impl Board for Dlpc350 {
    fn write(&mut self, command: u16, data: &[u8]) -> Result<(), String> {
        match command {
            0x0200 => [self.power] = bytes(data)?,
            0x1a1b => {
                let [mode] = bytes(data)?;
                self.change()?;
                if mode > 1 {
                    return Err("modes are 0 and 1".into());
                }
                self.mode.become_after(mode, READS_UNTIL_DONE);
            }
            0x1a22 => {
                self.change()?;
                [self.source] = bytes(data)?;
                if !matches!(self.source, 0 | 3) {
                    return Err("sources are 0 and 3".into());
                }
            }
            0x1a23 => {
                self.change()?;
                [self.trigger] = bytes(data)?;
            }
            0x1a29 => {
                self.change()?;
                let times: [u8; 8] = bytes(data)?;
                self.times_us = [number(&times[..4]), number(&times[4..])];
            }
            0x1a31 => {
                self.change()?;
                self.sequence = bytes(data)?;
                if self.sequence[0] > 127 || self.sequence[3] > 63 {
                    return Err("128 patterns and 64 images are the most".into());
                }
            }
            0x1a32..=0x1a34 => self.write_table(command, data)?,
            0x1a1a => {
                let mut checked = Slow::new(0x80);
                checked.become_after(self.check(), READS_UNTIL_DONE);
                self.checked = Some(checked);
            }
            0x1a1d => {
                self.change()?;
                self.trigger_out = bytes(data)?;
            }
            0x1a24 => self.start(data)?,
            _ => return Err("unknown command".into()),
        }
        Ok(())
    }

    fn read(&mut self, command: u16) -> Result<Vec<u8>, String> {
        Ok(match command {
            // Initialised; the sequencer runs.
            0x1a0a => vec![1],
            0x1a0c => vec![if self.runs() { 2 } else { 0 }],
            0x1a1b => vec![self.mode.read()],
            0x1a22 => vec![self.source],
            0x1a23 => vec![self.trigger],
            0x1a24 => vec![self.state],
            0x1a29 => self.times_us.iter().flat_map(|us| us.to_le_bytes()).collect(),
            0x1a31 => self.sequence.to_vec(),
            0x1a34 => {
                let row = if self.table == 2 { 3 } else { 1 };
                let from = self.place * row;
                self.table()?[from..].to_vec()
            }
            0x1a1a => vec![self.checked.as_mut().ok_or("no check was asked for")?.read()],
            0x1a1d => self.trigger_out.to_vec(),
            0x1a42 => vec![self.flash.len() as u8],
            _ => return Err("unknown command".into()),
        })
    }

    fn shown(&self) -> Option<Vec<u8>> {
        let place = self.places()[0];
        match self.source {
            _ if self.state != 2 => None,
            3 => Some(taken(self.flash.get(place.image)?, place)),
            _ => Some(taken(&self.picture()?, place)),
        }
    }

    fn sequence(&self) -> Option<(Vec<Vec<u8>>, u32)> {
        let once = self.state == 2 && self.source == 3 && self.sequence[1] == 0;
        let patterns: Option<_> =
            self.places().into_iter().map(|place| Some(taken(self.flash.get(place.image)?, place))).collect();
        once.then_some((patterns?, self.times_us[1]))
    }
}
