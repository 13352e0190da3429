//! The picture of a plan of views: the part from three sides, coloured by number of pairs and by uncertainty.

use super::colour::{ColourMap, Colouring, INK, Rgb, WHITE};
use super::glyph::{text_height, text_width, write_text};
use super::picture::{Ends, draw_scale_bar, share, with_colour_bar};
use super::raster::{PictureError, Raster};
use super::splat::{View, render};
use super::statistics::inner_range;
use fringe::cloud::Point;

/// Size of each of the views, px.
const VIEW_PX: [u32; 2] = [430, 340];
/// Free space around the parts of the picture, px.
const MARGIN: usize = 10;
/// Size of the letters.
const SCALE: usize = 2;
/// Side of a swatch, px.
const SWATCH: usize = 18;
/// What no pair sees.
const UNSEEN: Rgb = [204, 60, 48];

/// The views from above, from the front and obliquely, twice: coloured by the number of pairs that see an element, and by the least
/// uncertainty of a point among them, µm (NaN where none does). What no pair sees is red.
///
/// # Errors
/// A size that no picture has.
pub fn view_plan_png(
    elements: &[Point],
    pairs: &[usize],
    sigmas_um: &[f32],
    most_pairs: usize,
) -> Result<Vec<u8>, PictureError> {
    let by_pairs: Vec<Rgb> = pairs.iter().map(|pairs| pairs_colour(*pairs, most_pairs)).collect();
    let ends = inner_range(sigmas_um.iter().copied().filter(|sigma| sigma.is_finite()))
        .map_or(Ends { low: 0.0, high: 1.0 }, |(low, high)| Ends { low, high });
    let sigma_colour = |(sigma, pairs): (&f32, &usize)| match *pairs {
        0 => UNSEEN,
        _ => ColourMap::Sequential.colour(share(f64::from(*sigma), ends)),
    };
    let by_sigma: Vec<Rgb> = sigmas_um.iter().zip(pairs).map(sigma_colour).collect();
    let upper = legend(&row(elements, &by_pairs, "Number of pairs that see it")?, most_pairs)?;
    let lower = row(elements, &by_sigma, "Standard uncertainty of a point (best pair)")?;
    let lower = with_colour_bar(&lower, ColourMap::Sequential, ends, "µm")?;
    let width = upper.width.max(lower.width);
    let mut sheet = Raster::new(width, upper.height + lower.height + MARGIN, WHITE)?;
    sheet.paste(&upper, 0, 0);
    sheet.paste(&lower, 0, upper.height + MARGIN);
    sheet.to_png()
}

/// Red for none, then from dark to bright.
fn pairs_colour(pairs: usize, most: usize) -> Rgb {
    match pairs {
        0 => UNSEEN,
        _ if most <= 1 => ColourMap::Sequential.colour(0.6),
        _ => ColourMap::Sequential.colour(0.25 + 0.75 * (pairs - 1) as f64 / (most - 1) as f64),
    }
}

/// Three views side by side under a title.
fn row(elements: &[Point], colours: &[Rgb], title: &str) -> Result<Raster, PictureError> {
    let [width, height] = VIEW_PX;
    let views = [View::top(width, height), View::front(width, height), View::oblique(width, height)];
    let top = text_height(SCALE) + 2 * MARGIN;
    let mut sheet = Raster::new(views.len() * width as usize, top + height as usize, WHITE)?;
    write_text(&mut sheet, MARGIN, MARGIN, title, SCALE, INK);
    for (number, view) in views.iter().enumerate() {
        let mut rendered = render(elements, view, &Colouring::Given { colours })?;
        draw_scale_bar(&mut rendered);
        let left = number * width as usize;
        sheet.paste(&rendered.raster, left, top);
        // Signs beyond Latin-1 are not in the letters of pictures.
        write_text(&mut sheet, left + MARGIN, top, &view.name.replace('−', "-"), SCALE, INK);
    }
    Ok(sheet)
}

/// Adds the swatches of the numbers of pairs at the right.
fn legend(picture: &Raster, most_pairs: usize) -> Result<Raster, PictureError> {
    let entries: Vec<(Rgb, String)> = (0..=most_pairs)
        .map(|pairs| {
            let text = if pairs == 0 { "none".to_owned() } else { pairs.to_string() };
            (pairs_colour(pairs, most_pairs), text)
        })
        .collect();
    let widest = entries.iter().map(|(_, text)| text_width(text, SCALE)).max().unwrap_or(0);
    let needed = MARGIN + entries.len() * (SWATCH + MARGIN / 2);
    let mut sheet =
        Raster::new(picture.width + SWATCH + widest + 3 * MARGIN, picture.height.max(needed), WHITE)?;
    sheet.paste(picture, 0, 0);
    for (number, (colour, text)) in entries.iter().enumerate() {
        let (left, top) = (picture.width + MARGIN, MARGIN + number * (SWATCH + MARGIN / 2));
        sheet.fill(left, top, SWATCH, SWATCH, *colour);
        write_text(&mut sheet, left + SWATCH + MARGIN, top, text, SCALE, INK);
    }
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate of which one half is seen by one pair, the other by none.
    #[test]
    fn what_no_pair_sees_is_red_in_both_rows() {
        let at = |i: usize| [(i % 40) as f64, (i / 40) as f64, 0.0];
        let point = |i| Point {
            position_mm: at(i),
            normal: [0.0, 0.0, 1.0],
            sigma_mm: 0.0,
            modulation: 0.0,
            pair: 0,
            pixel: 0,
            shared_mm: 0.0,
        };
        let plate: Vec<Point> = (0..1600).map(point).collect();
        let pairs: Vec<usize> = (0..1600).map(|i| usize::from(i % 40 < 20)).collect();
        let sigmas: Vec<f32> = pairs.iter().map(|p| if *p > 0 { 5.0 } else { f32::NAN }).collect();
        let png = view_plan_png(&plate, &pairs, &sigmas, 2).unwrap();
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        let red = |pixel: &image::Rgb<u8>| pixel.0[0] > 120 && pixel.0[1] < 80 && pixel.0[2] < 80;
        let half = picture.height() / 2;
        let count = |rows: std::ops::Range<u32>| {
            picture.enumerate_pixels().filter(|(_, y, pixel)| rows.contains(y) && red(pixel)).count()
        };
        assert!(count(0..half) > 10_000 && count(half..picture.height()) > 10_000);
        assert!(view_plan_png(&[], &[], &[], 0).is_ok(), "an empty part has a picture too");
    }
}
