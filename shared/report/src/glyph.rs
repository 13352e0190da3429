//! Text, lines and circles in pictures: a stand-alone PNG cannot carry text of its own.

use std::convert::Infallible;

use embedded_graphics::Drawable;
use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_9X15, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::text::{Baseline, Text};

use super::colour::Rgb;
use super::raster::Raster;

impl OriginDimensions for Raster {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Raster {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, colour) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) {
                self.set(x, y, [colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}

fn rgb([r, g, b]: Rgb) -> Rgb888 {
    Rgb888::new(r, g, b)
}

/// Three sizes; larger scales take the last.
fn font(scale: usize) -> &'static MonoFont<'static> {
    match scale {
        0 | 1 => &FONT_6X10,
        2 => &FONT_9X15,
        _ => &FONT_10X20,
    }
}

/// Width of a text in pixels of the picture.
pub fn text_width(text: &str, scale: usize) -> usize {
    text.chars().count() * font(scale).character_size.width as usize
}

/// Height of a text in pixels of the picture.
pub fn text_height(scale: usize) -> usize {
    font(scale).character_size.height as usize
}

/// Writes a text of one line, its top-left corner at (x, y). Signs beyond Latin-1 become their nearest, or `?`.
pub fn write_text(raster: &mut Raster, x: usize, y: usize, text: &str, scale: usize, colour: Rgb) {
    let plain: String = text.chars().map(latin).collect();
    let style = MonoTextStyle::new(font(scale), rgb(colour));
    let place = Point::new(x.min(1 << 20) as i32, y.min(1 << 20) as i32);
    let Ok(_) = Text::with_baseline(&plain, place, style, Baseline::Top).draw(raster);
}

fn latin(sign: char) -> char {
    match sign {
        '−' | '–' | '—' => '-',
        '“' | '”' => '"',
        '\n' | '\t' => ' ',
        other => other,
    }
}

/// Draws a line between two places in pixels of the picture; the part outside is cut off.
pub fn line(raster: &mut Raster, from: [f64; 2], to: [f64; 2], width: usize, colour: Rgb) {
    // Ends far outside are moved near, so that no line is endless; NaN draws nothing.
    let far = 3.0 * raster.width.max(raster.height) as f64;
    let [from, to] = [from, to].map(|end| end.map(|v| v.clamp(-far, far)));
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let steps = dx.abs().max(dy.abs()).ceil();
    if steps.is_nan() {
        return;
    }
    let back = (width / 2) as f64;
    for step in 0..=steps as usize {
        let share = step as f64 / steps.max(1.0);
        let (x, y) = ((from[0] + dx * share - back).round(), (from[1] + dy * share - back).round());
        if x >= 0.0 && y >= 0.0 {
            raster.fill(x as usize, y as usize, width, width, colour);
        }
    }
}

/// Draws the outline of a circle.
pub fn circle(raster: &mut Raster, centre: [f64; 2], radius: f64, width: usize, colour: Rgb) {
    const SIDES: u32 = 24;
    let corner = |i: u32| {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(SIDES);
        [centre[0] + radius * fringe::math::cos(angle), centre[1] + radius * fringe::math::sin(angle)]
    };
    for i in 0..SIDES {
        line(raster, corner(i), corner(i + 1), width, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::WHITE;

    fn dark(raster: &Raster) -> Vec<usize> {
        (0..raster.pixels.len()).filter(|i| raster.pixels[*i] == [0; 3]).collect()
    }

    fn drawn(text: &str) -> Vec<usize> {
        let mut raster = Raster::new(40, 24, WHITE).unwrap();
        write_text(&mut raster, 2, 3, text, 2, [0; 3]);
        dark(&raster)
    }

    #[test]
    fn every_sign_that_a_label_uses_is_drawn_and_differs_from_the_others() {
        let signs: Vec<char> = "0123456789.-+/°%µ×abcdefghijklmnopqrstuvwxyzABCDN".chars().collect();
        for (i, a) in signs.iter().enumerate() {
            assert_ne!(drawn(&a.to_string()), drawn("?"), "{a} is missing");
            let other = |b: &char| drawn(&a.to_string()) != drawn(&b.to_string());
            assert!(signs[i + 1..].iter().all(other), "{a} looks like another sign");
        }
        assert_eq!(drawn("−"), drawn("-"));
    }

    #[test]
    fn a_text_stays_within_its_size() {
        let (right, bottom) = (2 + text_width("8+8", 2), 3 + text_height(2));
        let inside = |i: &usize| (2..right).contains(&(i % 40)) && (3..bottom).contains(&(i / 40));
        assert!(drawn("8+8").iter().all(inside));
    }

    #[test]
    fn lines_and_circles_may_leave_the_picture() {
        let mut raster = Raster::new(20, 20, WHITE).unwrap();
        line(&mut raster, [-5.0, 10.0], [f64::INFINITY, 10.0], 1, [0; 3]);
        assert_eq!(dark(&raster), (200..220).collect::<Vec<_>>());
        circle(&mut raster, [0.0, 0.0], 4.0, 1, [0; 3]);
        assert!(dark(&raster).contains(&4));
        line(&mut raster, [f64::NAN, 0.0], [3.0, 3.0], 1, [9; 3]);
        assert!(!raster.pixels.contains(&[9; 3]));
    }
}
