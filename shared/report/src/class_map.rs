//! A raster of classes in colours, with a legend that counts them.

use super::colour::{INK, Rgb, WHITE};
use super::glyph::{text_height, text_width, write_text};
use super::raster::{PictureError, Raster, check_plane};

/// Free space around the parts of the legend, px.
const MARGIN: usize = 10;

/// What a pixel may be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Class {
    /// Its name in the legend.
    pub name: String,
    /// Its colour in the picture.
    pub colour: Rgb,
}

/// A class for each pixel.
#[derive(Debug, Clone, Copy)]
pub struct ClassMap<'a> {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// Number of the class of each pixel in `legend`.
    pub classes: &'a [u8],
    /// The classes; those without a pixel are left out of the legend.
    pub legend: &'a [Class],
}

/// Pixels of each class.
pub fn class_counts(classes: &[u8], legend: usize) -> Vec<usize> {
    let mut counts = vec![0; legend];
    for class in classes {
        if let Some(count) = counts.get_mut(usize::from(*class)) {
            *count += 1;
        }
    }
    counts
}

/// The picture as PNG; pixels of no class in the legend are white.
///
/// # Errors
/// A plane that does not fit the size.
pub fn class_map_png(map: &ClassMap) -> Result<Vec<u8>, PictureError> {
    let (width, height) = (map.width_px as usize, map.height_px as usize);
    check_plane("plane of classes", width, height, map.classes.len())?;
    let counts = class_counts(map.classes, map.legend.len());
    let lines: Vec<(Rgb, String)> = map
        .legend
        .iter()
        .zip(counts)
        .filter(|(_, count)| *count > 0)
        .map(|(class, count)| (class.colour, format!("{}: {count}", class.name)))
        .collect();
    let scale = (height / 350).clamp(1, 4);
    let line = text_height(scale) + MARGIN;
    let square = text_height(scale);
    let widest = lines.iter().map(|(_, text)| text_width(text, scale)).max().unwrap_or(0);
    let mut sheet =
        Raster::new(width + square + widest + 3 * MARGIN, height.max(lines.len() * line + MARGIN), WHITE)?;
    for (pixel, class) in map.classes.iter().enumerate() {
        let colour = map.legend.get(usize::from(*class)).map_or(WHITE, |class| class.colour);
        sheet.set(pixel % width, pixel / width, colour);
    }
    for (index, (colour, text)) in lines.iter().enumerate() {
        let top = MARGIN + index * line;
        sheet.fill(width + MARGIN, top, square, square, *colour);
        write_text(&mut sheet, width + square + 2 * MARGIN, top, text, scale, INK);
    }
    sheet.to_png()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn legend() -> Vec<Class> {
        ["point", "too steep", "nowhere"]
            .into_iter()
            .zip([[200, 200, 200], [220, 40, 40], [0, 0, 255]])
            .map(|(name, colour)| Class { name: name.to_owned(), colour })
            .collect()
    }

    #[test]
    fn pixels_have_the_colours_of_the_legend_and_absent_classes_are_not_in_it() {
        let classes = [0, 1, 1, 0, 0, 7];
        let legend = legend();
        assert_eq!(class_counts(&classes, legend.len()), [3, 2, 0]);
        let map = ClassMap { width_px: 3, height_px: 2, classes: &classes, legend: &legend };
        let png = class_map_png(&map).unwrap();
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        assert_eq!(picture.get_pixel(1, 0).0, [220, 40, 40]);
        assert_eq!(picture.get_pixel(0, 1).0, [200, 200, 200]);
        assert_eq!(picture.get_pixel(2, 1).0, WHITE, "of no class");
        let blue = picture.pixels().filter(|p| p.0 == [0, 0, 255]).count();
        assert_eq!(blue, 0, "no pixel, no line");
        let red = picture.enumerate_pixels().filter(|(x, _, p)| *x > 3 && p.0 == [220, 40, 40]).count();
        assert!(red > 50, "its square in the legend: {red}");
    }

    #[test]
    fn a_plane_of_another_size_is_refused() {
        let map = ClassMap { width_px: 3, height_px: 2, classes: &[0; 5], legend: &[] };
        assert!(class_map_png(&map).is_err());
    }
}
