//! A camera's picture with what was found in it: points in their order, first corner, residuals magnified.

use super::GreyPicture;
use super::colour::{ColourMap, INK, Rgb, WHITE};
use super::glyph::{circle, line, text_height, text_width, write_text};
use super::raster::{PictureError, Raster, check_plane};

/// Small pictures are enlarged by a whole factor to about this width, so that a tenth of a pixel can be seen.
const WIDTH_PX: usize = 1400;

/// Colour of the arrows of residuals.
const ARROW: Rgb = [255, 60, 60];

/// Size of the text below.
const TEXT: usize = 2;

/// A point of a target in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePointMark {
    /// Column and row on the target.
    pub index: (u32, u32),
    /// Where it was seen.
    pub pixel: [f64; 2],
    /// Seen − modelled after the calibration, px.
    pub error_px: Option<[f64; 2]>,
    /// Whether the adjustment rejected it.
    pub rejected: bool,
}

/// Content of the drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct ImagePointPicture {
    /// The picture; its caption is the first line below.
    pub grey: GreyPicture,
    /// In the order of the target; empty where no target was found.
    pub marks: Vec<ImagePointMark>,
    /// Length of a drawn arrow over that of the residual.
    pub magnification: f64,
    /// Second line below: number of points and rms, or why there is no target.
    pub note: String,
}

/// Draws it as PNG.
///
/// # Errors
/// A size that does not fit the number of values.
pub fn image_points_png(picture: &ImagePointPicture) -> Result<Vec<u8>, PictureError> {
    let grey = &picture.grey;
    let (width, height) = (grey.width_px as usize, grey.height_px as usize);
    check_plane("grey picture", width, height, grey.values.len())?;
    let factor = (WIDTH_PX / width).clamp(1, 8);
    let lines = footer(picture, width * factor);
    let line_height = text_height(TEXT) + 4;
    let mut raster = Raster::new(width * factor, height * factor + lines.len() * line_height + 8, WHITE)?;
    for (row, values) in grey.values.chunks_exact(width).enumerate() {
        for (column, value) in values.iter().enumerate() {
            raster.fill(column * factor, row * factor, factor, factor, [*value; 3]);
        }
    }
    draw_marks(&mut raster, picture, factor as f64);
    raster.fill(0, height * factor, width * factor, lines.len() * line_height + 8, WHITE);
    for (number, text) in lines.iter().enumerate() {
        write_text(&mut raster, 6, height * factor + 6 + number * line_height, text, TEXT, INK);
    }
    raster.to_png()
}

/// The lines below, broken at the width of the picture.
fn footer(picture: &ImagePointPicture, width: usize) -> Vec<String> {
    let most = (width.saturating_sub(12) / text_width("0", TEXT)).max(8);
    let mut lines = Vec::new();
    for text in [&picture.grey.caption, &picture.note] {
        let mut current = String::new();
        for word in text.split_whitespace() {
            if !current.is_empty() && current.chars().count() + 1 + word.chars().count() > most {
                lines.push(std::mem::take(&mut current));
            }
            if !current.is_empty() {
                current.push(' ');
            }
            current.push_str(word);
        }
        lines.push(current);
    }
    lines
}

fn draw_marks(raster: &mut Raster, picture: &ImagePointPicture, factor: f64) {
    // Pixel (0, 0) is a block of factor × factor whose middle is the pixel's.
    let place = |pixel: [f64; 2]| pixel.map(|v| (v + 0.5) * factor - 0.5);
    let rows = picture.marks.iter().map(|m| m.index.1).max().unwrap_or(0) + 1;
    let colour = |row: u32| ColourMap::Cyclic.colour(f64::from(row) / f64::from(rows));
    for both in picture.marks.windows(2) {
        line(raster, place(both[0].pixel), place(both[1].pixel), 1, colour(both[1].index.1));
    }
    for mark in &picture.marks {
        let [x, y] = place(mark.pixel);
        circle(raster, [x, y], 5.0, 2, colour(mark.index.1));
        if mark.rejected {
            line(raster, [x - 9.0, y - 9.0], [x + 9.0, y + 9.0], 3, ARROW);
            line(raster, [x - 9.0, y + 9.0], [x + 9.0, y - 9.0], 3, ARROW);
        }
        if let Some([dx, dy]) = mark.error_px.filter(|e| e.iter().all(|v| v.is_finite())) {
            let long = picture.magnification * factor;
            arrow(raster, [x, y], [x + dx * long, y + dy * long]);
        }
    }
    if let Some(first) = picture.marks.first() {
        let [x, y] = place(first.pixel);
        circle(raster, [x, y], 13.0, 3, colour(first.index.1));
        let name = format!("{},{}", first.index.0, first.index.1);
        let (left, top) = ((x + 16.0).max(0.0) as usize, (y - 22.0).max(0.0) as usize);
        raster.fill(left, top, text_width(&name, TEXT) + 4, text_height(TEXT), WHITE);
        write_text(raster, left + 2, top, &name, TEXT, INK);
    }
}

fn arrow(raster: &mut Raster, from: [f64; 2], to: [f64; 2]) {
    line(raster, from, to, 2, ARROW);
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let length = (dx * dx + dy * dy).sqrt();
    if length < 6.0 {
        return;
    }
    let [ux, uy] = [dx / length * 5.0, dy / length * 5.0];
    for side in [-0.6, 0.6] {
        line(raster, to, [to[0] - ux - side * uy, to[1] - uy + side * ux], 2, ARROW);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> ImagePointPicture {
        let mark = |i: u32| ImagePointMark {
            index: (i % 3, i / 3),
            pixel: [10.0 + 20.0 * f64::from(i % 3), 10.0 + 15.0 * f64::from(i / 3)],
            error_px: Some([0.1, f64::from(i) * 0.01]),
            rejected: i == 4,
        };
        ImagePointPicture {
            grey: GreyPicture {
                caption: "left01.png".into(),
                width_px: 64,
                height_px: 40,
                values: vec![90; 2560],
            },
            marks: (0..6).map(mark).collect(),
            magnification: 30.0,
            note: "6 points, rms 0.1 px".into(),
        }
    }

    #[test]
    fn points_arrows_and_text_are_drawn_and_a_picture_without_points_keeps_its_pixels() {
        let full = image::load_from_memory(&image_points_png(&picture()).unwrap()).unwrap().to_rgb8();
        let bare = ImagePointPicture { marks: Vec::new(), note: "no target: too dark".into(), ..picture() };
        let bare = image::load_from_memory(&image_points_png(&bare).unwrap()).unwrap().to_rgb8();
        assert_eq!(full.dimensions(), bare.dimensions());
        assert_eq!(full.width(), 512);
        assert!(bare.enumerate_pixels().all(|(_, y, p)| y >= 320 || p.0 == [90; 3]));
        assert!(full.pixels().filter(|p| p.0 == ARROW).count() > 100);
        assert!(bare.enumerate_pixels().any(|(_, y, p)| y >= 320 && p.0 == INK), "the reason is written");
    }

    #[test]
    fn a_long_reason_is_broken_and_numbers_without_end_are_drawn_nowhere() {
        let mut long = picture();
        long.note = "reason ".repeat(60);
        long.marks[0].pixel = [f64::NAN, 1e300];
        long.marks[1].error_px = Some([f64::INFINITY, 0.0]);
        let (short, tall) = (footer(&picture(), 512).len(), footer(&long, 512).len());
        assert!(tall > short + 5, "{tall} lines");
        image_points_png(&long).unwrap();
        long.grey.values.pop();
        assert!(image_points_png(&long).is_err());
    }
}
