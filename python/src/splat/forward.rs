//! Pictures of Gaussians.

use rayon::prelude::*;

use super::bands::{Listed, Projected, walk};

/// Pictures, one after another, row-major.
pub struct Pictures {
    /// Colours, black where nothing is.
    pub colors: Vec<f32>,
    /// Opacities.
    pub opacities: Vec<f32>,
    /// Depths at which the transmittance falls to one half; 0 where it does not.
    pub depths: Vec<f32>,
}

/// Where a band of a picture is written.
struct Band<'a> {
    picture: usize,
    band: usize,
    colors: &'a mut [f32],
    opacities: &'a mut [f32],
    depths: &'a mut [f32],
}

/// Blends colours from front to back: sum_i c_i a_i prod_{j < i} (1 - a_j) (Kerbl et al. 2023, Eq. 3), on all threads; the same for
/// any number of them.
pub fn pictures(projected: &Projected<'_>) -> Pictures {
    let [width, height] = projected.size;
    let (pictures, pixels) = (projected.pictures(), width * height);
    let listed = projected.listed();
    let mut colors = vec![0.0; 3 * pictures * pixels];
    let mut opacities = vec![0.0; pictures * pixels];
    let mut depths = vec![0.0; pictures * pixels];
    let each = (colors.chunks_mut(3 * pixels))
        .zip(opacities.chunks_mut(pixels))
        .zip(depths.chunks_mut(pixels));
    let rows = projected.rows * width;
    let bands: Vec<Band<'_>> = each
        .enumerate()
        .flat_map(|(picture, ((colors, opacities), depths))| {
            let parts = (colors.chunks_mut(3 * rows))
                .zip(opacities.chunks_mut(rows))
                .zip(depths.chunks_mut(rows));
            parts
                .enumerate()
                .map(move |(band, ((colors, opacities), depths))| Band {
                    picture,
                    band,
                    colors,
                    opacities,
                    depths,
                })
        })
        .collect();
    bands.into_par_iter().for_each(|band| {
        blend(projected, &listed[band.picture], band);
    });
    Pictures {
        colors,
        opacities,
        depths,
    }
}

fn blend(projected: &Projected<'_>, listed: &Listed, band: Band<'_>) {
    let colors = band.colors.as_chunks_mut::<3>().0;
    walk(projected, listed, band.band, |splat, meeting| {
        let weight = meeting.through * meeting.opacity;
        for (sum, color) in colors[meeting.pixel].iter_mut().zip(&splat.color) {
            *sum += weight * color;
        }
        band.opacities[meeting.pixel] += weight;
        let behind = meeting.through * (1.0 - meeting.opacity);
        if meeting.through > 0.5 && behind <= 0.5 {
            band.depths[meeting.pixel] = splat.depth;
        }
    });
}
