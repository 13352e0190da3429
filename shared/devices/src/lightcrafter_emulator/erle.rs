//! Decompression as the DLPC900 does it, written from table 2-115 of its guide alone.

/// Width, height and three bytes a pixel (red, green, blue) of an image with its header.
///
/// # Errors
/// Anything that the guide does not allow.
pub fn decompressed(bytes: &[u8]) -> Result<(u32, u32, Vec<u8>), String> {
    let (width, height) = size(bytes)?;
    let mut pixels: Vec<[u8; 3]> = Vec::with_capacity(width * height);
    let mut data = bytes[48..].iter().copied();
    let mut next = || data.next().ok_or("the data end before the image");
    loop {
        match next()? {
            0 => match next()? {
                0 => {
                    if !pixels.len().is_multiple_of(width) {
                        return Err("a row ends before it is full".into());
                    }
                }
                1 => {
                    let first = next()?;
                    if first == 0 {
                        break;
                    }
                    let copied = if first < 128 { usize::from(first) } else { wide(first, next()?) };
                    let at = pixels.len();
                    let from = at.checked_sub(width).ok_or("the first row copies from above")?;
                    if at % width + copied > width {
                        return Err("a copy runs over the end of its row".into());
                    }
                    pixels.extend_from_within(from..from + copied);
                }
                first => {
                    let raw = if first < 128 { usize::from(first) } else { wide(first, next()?) };
                    for _ in 0..raw {
                        pixels.push([next()?, next()?, next()?]);
                    }
                }
            },
            first => {
                let times = if first < 128 { usize::from(first) } else { wide(first, next()?) };
                let pixel = [next()?, next()?, next()?];
                pixels.extend(std::iter::repeat_n(pixel, times));
            }
        }
        if pixels.len() > width * height {
            return Err("more pixels than the header states".into());
        }
    }
    if pixels.len() != width * height {
        return Err(format!("{} pixels instead of {width} × {height}", pixels.len()));
    }
    if data.next().is_some() {
        return Err("data after the end of the image".into());
    }
    // In memory a pixel has blue, red, green.
    let rgb = pixels.iter().flat_map(|[blue, red, green]| [*red, *green, *blue]).collect();
    Ok((width as u32, height as u32, rgb))
}

fn wide(first: u8, second: u8) -> usize {
    usize::from(first & 0x7f) | usize::from(second) << 7
}

/// Columns and rows that the header states, once all of it is as the guide states.
fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    let header = bytes.get(..48).ok_or("the image has no header of 48 bytes")?;
    if header[..4] != [0x53, 0x70, 0x6c, 0x64] {
        return Err(format!("signature {:02x?}", &header[..4]));
    }
    let width = usize::from(u16::from_le_bytes([header[4], header[5]]));
    let height = usize::from(u16::from_le_bytes([header[6], header[7]]));
    let count = u32::from_le_bytes([header[8], header[9], header[10], header[11]]) as usize;
    if count != bytes.len() - 48 {
        return Err(format!("the header states {count} bytes of data, {} follow", bytes.len() - 48));
    }
    if header[12..20] != [0xff; 8] || header[20..24] != [0; 4] {
        return Err("fields without use are not as the guide states".into());
    }
    if header[25] != 2 {
        return Err(format!("compression {} is not the enhanced one (2)", header[25]));
    }
    Ok((width, height))
}
