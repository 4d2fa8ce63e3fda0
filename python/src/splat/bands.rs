//! Which Gaussians show in which rows of a picture, and where they do.

use rayon::prelude::*;

/// Rows of a band, unless others are asked for: a tile's height of Kerbl et al. A band is as wide as the picture.
pub const ROWS: usize = 16;

/// Bounds of the opacity of a Gaussian in a pixel.
pub const LEAST_OPACITY: f32 = 1.0 / 255.0;
pub const MOST_OPACITY: f32 = 0.99;

/// Transmittance at which a pixel is done.
const LEAST_TRANSMITTANCE: f32 = 1e-4;

/// Pictures of Gaussians that are projected: `count` in each of several pictures.
#[derive(Clone, Copy)]
pub struct Projected<'a> {
    /// Column and row of the means (pixels), picture by picture.
    pub means: &'a [[f32; 2]],
    /// Covariances xx, xy, yy (pixels squared), picture by picture.
    pub covariances: &'a [[f32; 3]],
    /// Depths, picture by picture.
    pub depths: &'a [f32],
    /// Depth that Gaussians are seen beyond.
    pub near: f32,
    /// Opacities, the same in all pictures.
    pub opacities: &'a [f32],
    /// Colours, picture by picture.
    pub colors: &'a [[f32; 3]],
    /// Width and height of a picture (pixels).
    pub size: [usize; 2],
    /// Rows of a band.
    pub rows: usize,
}

/// A Gaussian that shows in a picture.
pub struct Splat {
    /// Its place among the Gaussians.
    pub index: usize,
    pub depth: f32,
    pub opacity: f32,
    pub color: [f32; 3],
    mean: [f32; 2],
    /// Inverse of the covariance: xx, xy, yy.
    inverse: [f32; 3],
    /// Squared Mahalanobis distance at which its opacity is 1/255.
    reach: f32,
    /// First and last column, first and last row of the rectangle around the ellipse of that distance.
    columns: [usize; 2],
    rows: [usize; 2],
}

/// What shows in a picture.
pub struct Listed {
    /// Its Gaussians, from front to back.
    pub splats: Vec<Splat>,
    /// Places of those that show in each band.
    pub lists: Vec<Vec<u32>>,
}

/// Where a Gaussian meets a pixel.
#[derive(Clone, Copy)]
pub struct Meeting {
    /// Index of the pixel within the band, row-major.
    pub pixel: usize,
    /// Place of the Gaussian in the band's list.
    pub place: usize,
    /// Opacity of the Gaussian in the pixel.
    pub opacity: f32,
    /// Transmittance in front of it.
    pub through: f32,
}

impl Projected<'_> {
    /// Number of pictures.
    pub fn pictures(&self) -> usize {
        self.depths.len() / self.opacities.len().max(1)
    }

    /// Bands of a picture.
    pub fn bands(&self) -> usize {
        self.size[1].div_ceil(self.rows)
    }

    /// What shows in each picture, on all threads.
    pub fn listed(&self) -> Vec<Listed> {
        (0..self.pictures())
            .into_par_iter()
            .map(|picture| {
                let splats = self.splats(picture);
                let lists = self.lists(&splats);
                Listed { splats, lists }
            })
            .collect()
    }

    /// The Gaussians that show in a picture, from front to back.
    fn splats(&self, picture: usize) -> Vec<Splat> {
        let count = self.opacities.len();
        let mut splats: Vec<Splat> = (0..count)
            .filter_map(|index| self.splat(picture * count + index, index))
            .collect();
        splats.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        splats
    }

    /// The Gaussian `index`, number `row` of all pictures'; `None` where it does not show.
    fn splat(&self, row: usize, index: usize) -> Option<Splat> {
        let ([u, v], [xx, xy, yy]) = (self.means[row], self.covariances[row]);
        let (depth, opacity) = (self.depths[row], self.opacities[index]);
        let reach = 2.0 * (opacity / LEAST_OPACITY).ln();
        let area = xx * yy - xy * xy;
        // Written so that what is not a number does not show.
        if !(reach > 0.0 && depth > self.near && area > 0.0 && area.is_finite()) {
            return None;
        }
        let columns = pixels(u, (reach * xx).sqrt(), self.size[0])?;
        let rows = pixels(v, (reach * yy).sqrt(), self.size[1])?;
        Some(Splat {
            index,
            depth,
            opacity,
            color: self.colors[row],
            mean: [u, v],
            inverse: [yy / area, -xy / area, xx / area],
            reach,
            columns,
            rows,
        })
    }

    /// Places in `splats` of those that show in each band.
    fn lists(&self, splats: &[Splat]) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.bands()];
        for (place, splat) in splats.iter().enumerate() {
            for list in &mut lists[splat.rows[0] / self.rows..=splat.rows[1] / self.rows] {
                list.push(place as u32);
            }
        }
        lists
    }
}

/// First and last pixel of `count` within `half` of `middle`; `None` where there is none, and where they are not finite.
fn pixels(middle: f32, half: f32, count: usize) -> Option<[usize; 2]> {
    if !(middle + half).is_finite() {
        return None;
    }
    let low = (middle - half).ceil().max(0.0);
    let high = (middle + half).floor().min(count as f32 - 1.0);
    (low <= high).then_some([low as usize, high as usize])
}

impl Splat {
    /// From the mean to a pixel, by the inverse covariance: half the derivative of the squared Mahalanobis distance.
    pub fn scaled(&self, [column, row]: [usize; 2]) -> [f32; 2] {
        let [x, y] = [column as f32 - self.mean[0], row as f32 - self.mean[1]];
        let [xx, xy, yy] = self.inverse;
        [xx * x + xy * y, xy * x + yy * y]
    }
}

/// Calls `visit` where the Gaussians of a band's list meet its pixels, each pixel's from front to back, until it is done.
///
/// a = min(0.99, o exp(-d^T S^-1 d / 2)); those below 1/255 are left out, and all from the one on that would leave less than 1e-4
/// of the light (Kerbl et al. 2023, Section 4 and appendix).
pub fn walk(
    projected: &Projected<'_>,
    listed: &Listed,
    band: usize,
    mut visit: impl FnMut(&Splat, Meeting),
) {
    let width = projected.size[0];
    let top = band * projected.rows;
    let bottom = (top + projected.rows).min(projected.size[1]);
    // Nothing is left of the light of a pixel that is done.
    let mut through = vec![1.0_f32; width * (bottom - top)];
    for (place, &splat) in listed.lists[band].iter().enumerate() {
        let splat = &listed.splats[splat as usize];
        let [xx, xy, yy] = splat.inverse;
        for row in splat.rows[0].max(top)..=splat.rows[1].min(bottom - 1) {
            let y = row as f32 - splat.mean[1];
            let first = (row - top) * width;
            for column in splat.columns[0]..=splat.columns[1] {
                let x = column as f32 - splat.mean[0];
                let power = xx * x * x + 2.0 * xy * x * y + yy * y * y;
                let pixel = first + column;
                if power > splat.reach || through[pixel] == 0.0 {
                    continue;
                }
                let opacity = (splat.opacity * (-0.5 * power).exp()).min(MOST_OPACITY);
                let behind = through[pixel] * (1.0 - opacity);
                if behind < LEAST_TRANSMITTANCE {
                    through[pixel] = 0.0;
                    continue;
                }
                let meeting = Meeting {
                    pixel,
                    place,
                    opacity,
                    through: through[pixel],
                };
                visit(splat, meeting);
                through[pixel] = behind;
            }
        }
    }
}
