//! The camera's point spread: a separable blur of the irradiance image.

/// Half of Lindeberg's discrete Gaussian (centre first): T(n, t) = e^−t I_n(t), whose variance is exactly t (px²).
///
/// Source: Lindeberg, Scale-space for discrete signals, 1990. A sampled Gaussian of half a pixel would have the wrong
/// variance; this one has the right one at any width.
pub(crate) fn taps(variance_px2: f64) -> Vec<f32> {
    if variance_px2 <= 0.0 {
        return vec![1.0];
    }
    // Miller's backward recurrence I_{n−1} = I_{n+1} + (2n/t) I_n, normalised by I_0 + 2 Σ I_n = e^t.
    let reach = (7.0 * variance_px2.sqrt()).ceil() as usize + 2;
    let start = reach + 20;
    let mut bessel = vec![0.0_f64; start + 2];
    bessel[start] = 1e-280;
    for n in (1..=start).rev() {
        bessel[n - 1] = bessel[n + 1] + 2.0 * n as f64 / variance_px2 * bessel[n];
        if bessel[n - 1] > 1e200 {
            for b in &mut bessel {
                *b *= 1e-200;
            }
        }
    }
    bessel.truncate(reach + 1);
    let sum = 2.0 * bessel.iter().sum::<f64>() - bessel[0];
    let mut taps: Vec<f64> = bessel.iter().map(|b| b / sum).collect();
    // Below 1e-7 a tap is lost in the rounding of the image.
    while taps.len() > 1 && taps[taps.len() - 1] < 1e-7 {
        taps.pop();
    }
    let sum = 2.0 * taps.iter().sum::<f64>() - taps[0];
    taps.iter().map(|t| (t / sum) as f32).collect()
}

/// Blurs an image in place; beyond its border the last pixel continues. `spare` has the image's size,
/// `padded` holds one row.
pub(crate) fn blur(image: &mut [f32], spare: &mut [f32], padded: &mut Vec<f32>, width: usize, taps: &[f32]) {
    let reach = taps.len() - 1;
    if reach == 0 || width == 0 {
        return;
    }
    padded.resize(width + 2 * reach, 0.0);
    for (row, out) in image.chunks_exact(width).zip(spare.chunks_exact_mut(width)) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(row[width - 1]);
        for (o, c) in out.iter_mut().zip(&padded[reach..]) {
            *o = taps[0] * c;
        }
        for (k, tap) in taps.iter().enumerate().skip(1) {
            let (left, right) = (&padded[reach - k..], &padded[reach + k..]);
            for ((o, a), b) in out.iter_mut().zip(left).zip(right) {
                *o += tap * (a + b);
            }
        }
    }
    let rows = spare.len() / width;
    let row = |y: usize| &spare[y * width..(y + 1) * width];
    for (y, out) in image.chunks_exact_mut(width).enumerate() {
        for (o, c) in out.iter_mut().zip(row(y)) {
            *o = taps[0] * c;
        }
        for (k, tap) in taps.iter().enumerate().skip(1) {
            let (above, below) = (row(y.saturating_sub(k)), row((y + k).min(rows - 1)));
            for ((o, a), b) in out.iter_mut().zip(above).zip(below) {
                *o += tap * (a + b);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_has_unit_sum_and_the_asked_variance() {
        for variance in [0.01, 1.0 / 12.0, 0.25, 1.0, 9.0, 400.0] {
            let taps = taps(variance);
            let sum = f64::from(taps[0]) + 2.0 * taps[1..].iter().map(|t| f64::from(*t)).sum::<f64>();
            let second: f64 =
                2.0 * taps.iter().enumerate().map(|(n, t)| (n * n) as f64 * f64::from(*t)).sum::<f64>();
            assert!((sum - 1.0).abs() < 1e-6);
            assert!((second / variance - 1.0).abs() < 1e-3, "{variance} became {second}");
        }
    }

    #[test]
    fn a_blurred_point_is_the_product_of_the_kernels_and_a_flat_image_stays_flat() {
        let taps = taps(0.4);
        let (width, height) = (21, 17);
        let mut image = vec![0.0; width * height];
        let mut spare = image.clone();
        image[8 * width + 10] = 1.0;
        blur(&mut image, &mut spare, &mut Vec::new(), width, &taps);
        for y in 0..height {
            for x in 0..width {
                let tap = |d: usize| taps.get(d).copied().unwrap_or(0.0);
                let expected = tap(x.abs_diff(10)) * tap(y.abs_diff(8));
                assert!((image[y * width + x] - expected).abs() < 1e-7);
            }
        }
        let mut flat = vec![0.7; width * height];
        blur(&mut flat, &mut spare, &mut Vec::new(), width, &taps);
        assert!(flat.iter().all(|v| (v - 0.7).abs() < 1e-6));
    }
}
