//! Derivatives of a function of pictures by the Gaussians that they show.

use rayon::prelude::*;

use super::bands::{Listed, MOST_OPACITY, Meeting, Projected, walk};

/// Derivatives by what Gaussians are made of, in the order of [`Projected`].
pub struct Gradient {
    pub means: Vec<f32>,
    pub covariances: Vec<f32>,
    pub opacities: Vec<f32>,
    pub colors: Vec<f32>,
}

/// Derivatives by a Gaussian in a picture: mean (2), covariance (3), opacity, colour (3).
type Row = [f32; 9];

/// From the derivatives by the pixels' colours and opacities to those by the Gaussians, on all threads; the same for any number
/// of them.
///
/// With w_i = a_i T_i, T_i = prod_{j < i} (1 - a_j) and g_i what the derivatives by a pixel say of colour and opacity of Gaussian i,
///
/// ```text
/// dL/da_i = T_i g_i - sum_{j > i} w_j g_j / (1 - a_i),   dL/dc_i = w_i dL/dC,
/// ```
///
/// and with q = S^-1 d: da/do = a / o, da/dm = a q, da/dS = a q q^T / 2 (Kerbl et al. 2023, appendix A).
pub fn gradient(projected: &Projected<'_>, by_colors: &[f32], by_opacities: &[f32]) -> Gradient {
    let [width, height] = projected.size;
    let (pictures, pixels) = (projected.pictures(), width * height);
    let count = projected.opacities.len();
    let listed = projected.listed();
    let bands = projected.bands();
    let parts: Vec<Vec<Row>> = (0..pictures * bands)
        .into_par_iter()
        .map(|number| {
            let (picture, band) = (number / bands, number % bands);
            let of_picture = picture * pixels..(picture + 1) * pixels;
            let by_colors = &by_colors.as_chunks::<3>().0[of_picture.clone()];
            let by_opacities = &by_opacities[of_picture];
            of_band(projected, &listed[picture], band, (by_colors, by_opacities))
        })
        .collect();
    // Sums in the order of bands and pictures, whatever thread had them.
    let by_picture: Vec<Vec<Row>> = (0..pictures)
        .into_par_iter()
        .map(|picture| {
            let Listed { splats, lists } = &listed[picture];
            let mut sums = vec![[0.0; 9]; count];
            for (list, rows) in lists.iter().zip(&parts[picture * bands..]) {
                for (&place, row) in list.iter().zip(rows) {
                    let sum = &mut sums[splats[place as usize].index];
                    sum.iter_mut()
                        .zip(row)
                        .for_each(|(sum, value)| *sum += value);
                }
            }
            sums
        })
        .collect();
    let mut found = Gradient {
        means: Vec::with_capacity(2 * pictures * count),
        covariances: Vec::with_capacity(3 * pictures * count),
        opacities: vec![0.0; count],
        colors: Vec::with_capacity(3 * pictures * count),
    };
    for sums in &by_picture {
        for (index, row) in sums.iter().enumerate() {
            found.means.extend_from_slice(&row[..2]);
            found.covariances.extend_from_slice(&row[2..5]);
            found.opacities[index] += row[5];
            found.colors.extend_from_slice(&row[6..]);
        }
    }
    found
}

/// Derivatives by the Gaussians of a band's list, from those by the pixels of its picture.
fn of_band(
    projected: &Projected<'_>,
    listed: &Listed,
    band: usize,
    (by_colors, by_opacities): (&[[f32; 3]], &[f32]),
) -> Vec<Row> {
    let width = projected.size[0];
    let top = band * projected.rows;
    let list = &listed.lists[band];
    let mut meetings: Vec<Meeting> = Vec::new();
    walk(projected, listed, band, |_, meeting| meetings.push(meeting));
    let mut rows = vec![[0.0; 9]; list.len()];
    // What lies behind, sum_{j > i} w_j g_j, pixel by pixel.
    let mut behind = vec![0.0_f32; width * projected.rows];
    for meeting in meetings.iter().rev() {
        let Meeting {
            pixel,
            place,
            opacity,
            through,
        } = *meeting;
        let splat = &listed.splats[list[place] as usize];
        let at = top * width + pixel;
        let (by_color, by_opacity) = (by_colors[at], by_opacities[at]);
        let colors = by_color.iter().zip(&splat.color);
        let said = colors.fold(by_opacity, |sum, (by, color)| sum + by * color);
        let weight = through * opacity;
        let by_alpha = through * said - behind[pixel] / (1.0 - opacity);
        behind[pixel] += weight * said;
        let row = &mut rows[place];
        for (sum, by_color) in row[6..].iter_mut().zip(by_color) {
            *sum += weight * by_color;
        }
        // Where the opacity is at its bound it does not change.
        if opacity >= MOST_OPACITY {
            continue;
        }
        let [x, y] = splat.scaled([pixel % width, top + pixel / width]);
        let slope = by_alpha * opacity;
        row[0] += slope * x;
        row[1] += slope * y;
        row[2] += 0.5 * slope * x * x;
        row[3] += slope * x * y;
        row[4] += 0.5 * slope * y * y;
        row[5] += slope / splat.opacity;
    }
    rows
}
