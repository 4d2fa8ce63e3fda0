//! A small software renderer of point clouds: orthographic, depth-buffered balls on white.
//!
//! Balls that close the surface between points that are millimetres apart make a lump of each point that lies off the
//! surface. So each point is a small ball, and the surface is drawn only where the large balls of several points come together.

mod depth;
mod image;

pub(crate) use image::Image;

use depth::DepthBuffer;
use tdcr_sim::cloud::PointCloud;

/// Samples per pixel and direction.
const SUPERSAMPLE: usize = 2;

/// Axes of an orthographic picture: orthonormal, right-handed, in the world frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    right: [f64; 3],
    up: [f64; 3],
    toward: [f64; 3],
}

impl View {
    /// The view whose right is the horizontal direction at angle `azimuth` from x (rad), from a
    /// camera at angle `elevation` above the horizon (rad).
    pub fn turned(azimuth: f64, elevation: f64) -> Self {
        let (sa, ca) = azimuth.sin_cos();
        let (se, ce) = elevation.sin_cos();
        Self {
            right: [ca, sa, 0.0],
            up: [-sa * se, ca * se, ce],
            toward: [sa * ce, -ca * ce, se],
        }
    }

    /// Coordinates `(right, up, toward the camera)` of a world point (m).
    pub fn project(&self, point: [f32; 3]) -> [f64; 3] {
        let p = point.map(f64::from);
        [self.right, self.up, self.toward]
            .map(|axis| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2])
    }
}

/// The part of the picture plane that an image shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// Width of the image (pixels).
    pub width: usize,
    /// Height of the image (pixels).
    pub height: usize,
    /// Side of a pixel (m).
    pub metres_per_pixel: f64,
    /// Point `(right, up)` of the picture plane at the image's centre (m).
    pub center: [f64; 2],
}

/// Where a layer's colours come from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Paint<'a> {
    /// Each point has its own colour.
    Own,
    /// All points have this colour.
    Flat([u8; 3]),
    /// Each point has the colour of its place here.
    Each(&'a [[u8; 3]]),
}

/// A cloud drawn as balls, and as the surface that they sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer<'a> {
    pub cloud: &'a PointCloud,
    pub paint: Paint<'a>,
    /// Radius of each point's ball (m).
    pub ball: f64,
    /// Radius (m) of the balls that together close the surface; 0 draws no surface.
    pub closing: f64,
}

/// Renders layers into one picture, each by itself; where several cover each other, the picture
/// shows `shared` instead of their colours. Points that are not finite, or have no colour, are left
/// out.
pub(crate) fn render(layers: &[Layer], shared: [u8; 3], view: &View, frame: &Frame) -> Image {
    let buffers: Vec<DepthBuffer> = layers
        .iter()
        .map(|layer| DepthBuffer::of(layer, view, frame))
        .collect();
    let sample = |x, y| {
        let mut surfaces = buffers.iter().filter_map(|buffer| buffer.surface(x, y));
        match (surfaces.next(), surfaces.next()) {
            (None, _) => [255.0; 3],
            (Some((brightness, color)), None) => color.map(|c| brightness * f64::from(c)),
            (Some((brightness, _)), Some((other, _))) => {
                shared.map(|c| 0.5 * (brightness + other) * f64::from(c))
            }
        }
    };
    let mut image = Image::white(frame.width, frame.height);
    let samples = (SUPERSAMPLE * SUPERSAMPLE) as f64;
    for (index, pixel) in image.rgb.chunks_exact_mut(3).enumerate() {
        let (row, column) = (index / frame.width, index % frame.width);
        let mut sum = [0.0; 3];
        for sub in 0..SUPERSAMPLE * SUPERSAMPLE {
            let x = column * SUPERSAMPLE + sub % SUPERSAMPLE;
            let y = row * SUPERSAMPLE + sub / SUPERSAMPLE;
            for (total, channel) in sum.iter_mut().zip(sample(x, y)) {
                *total += channel;
            }
        }
        for (channel, total) in pixel.iter_mut().zip(sum) {
            *channel = (total / samples).round() as u8;
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLUE: [u8; 3] = [0, 0, 255];
    const RED: [u8; 3] = [255, 0, 0];
    const GREY: [u8; 3] = [200, 200, 200];

    /// 40 x 30 pixels of 1 mm around the world's origin.
    const FRAME: Frame = Frame {
        width: 40,
        height: 30,
        metres_per_pixel: 1e-3,
        center: [0.0, 0.0],
    };

    fn cloud(points: &[[f32; 3]]) -> PointCloud {
        PointCloud {
            points: points.to_vec(),
            colors: vec![RED; points.len()],
        }
    }

    fn picture(clouds: &[(&PointCloud, Paint)]) -> Image {
        let layer = |&(cloud, paint)| Layer {
            cloud,
            paint,
            ball: 3e-3,
            closing: 0.0,
        };
        let layers: Vec<Layer> = clouds.iter().map(layer).collect();
        render(&layers, GREY, &View::turned(0.0, 0.0), &FRAME)
    }

    fn pixel(image: &Image, x: usize, y: usize) -> [u8; 3] {
        let start = 3 * (y * image.width + x);
        [0, 1, 2].map(|k| image.rgb[start + k])
    }

    #[test]
    fn a_ball_is_a_disc_of_its_radius_where_the_view_puts_it() {
        // 8 mm to the right of the centre and 5 mm above it.
        let image = picture(&[(&cloud(&[[0.008, 0.3, 0.005]]), Paint::Own)]);
        let inked: Vec<(usize, usize)> = (0..30)
            .flat_map(|y| (0..40).map(move |x| (x, y)))
            .filter(|&(x, y)| pixel(&image, x, y) != [255; 3])
            .collect();
        for &(x, y) in &inked {
            let distance = (x as f64 + 0.5 - 28.0).hypot(y as f64 + 0.5 - 10.0);
            assert!(distance < 3.0 + 0.75, "({x}, {y})");
        }
        let area = std::f64::consts::PI * 9.0;
        assert!(inked.len() as f64 >= area, "{} pixels", inked.len());
    }

    #[test]
    fn the_nearer_ball_hides_the_farther_one() {
        // Seen along y, from the negative side.
        let mut two = cloud(&[[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]);
        two.colors = vec![RED, BLUE];
        let [red, _, blue] = pixel(&picture(&[(&two, Paint::Own)]), 20, 15);
        assert!(red > 200 && blue == 0);
        two.points.reverse();
        let [red, _, blue] = pixel(&picture(&[(&two, Paint::Own)]), 20, 15);
        assert!(red == 0 && blue > 200);
    }

    #[test]
    fn layers_that_cover_each_other_are_drawn_in_the_shared_colour() {
        let [left, middle] = [cloud(&[[-0.01, 0.0, 0.0], [0.0; 3]]), cloud(&[[0.0; 3]])];
        let image = picture(&[(&left, Paint::Own), (&middle, Paint::Flat(BLUE))]);
        let [red, _, blue] = pixel(&image, 10, 15);
        assert!(red > 150 && blue == 0);
        let [red, green, blue] = pixel(&image, 20, 15);
        assert!(red == green && green == blue && red > 150);
    }

    #[test]
    fn balls_beyond_the_edges_and_beyond_numbers_are_left_out() {
        let far = [
            [-9.0, 0.0, 0.0],
            [9.0, 0.0, 0.0],
            [0.0, 0.0, 9.0],
            [0.0, 0.0, -9.0],
        ];
        let wild = [
            [f32::NAN, 0.0, 0.0],
            [0.0, 0.0, f32::INFINITY],
            [f32::MAX; 3],
        ];
        let image = picture(&[(&cloud(&far), Paint::Own), (&cloud(&wild), Paint::Own)]);
        assert_eq!(image, Image::white(40, 30));
    }

    #[test]
    fn points_off_the_surface_are_small_balls_and_the_surface_is_closed() {
        // A wall of points 2 mm apart, two points close together before it, and two beside it.
        let wall: Vec<[f32; 3]> = (0..100)
            .map(|k| {
                [
                    0.002 * (k % 10) as f32 - 0.009,
                    0.0,
                    0.002 * (k / 10) as f32 - 0.009,
                ]
            })
            .collect();
        let mut points = cloud(&wall);
        for off in [
            [0.001, -0.02, 0.0],
            [0.0, -0.02, 0.0],
            [-0.016, 0.0, 0.0],
            [-0.0165, 0.0, 0.0],
        ] {
            points.points.push(off);
            points.colors.push(BLUE);
        }
        let layer = Layer {
            cloud: &points,
            paint: Paint::Own,
            ball: 1e-3,
            closing: 4e-3,
        };
        let image = render(&[layer], GREY, &View::turned(0.0, 0.0), &FRAME);
        let (mut red, mut blue) = ([0; 2], [0; 2]);
        for y in 0..30 {
            for x in 0..40 {
                let beside = usize::from(x < 7);
                match pixel(&image, x, y) {
                    [255, 255, 255] => {}
                    [r, _, b] if r > b => red[beside] += 1,
                    _ => blue[beside] += 1,
                }
            }
        }
        // 18 mm by 18 mm, closed, and a border of less than a large ball's radius.
        assert!(
            (324..26 * 26).contains(&(red[0] + blue[0])),
            "{red:?} {blue:?}"
        );
        for y in 7..23 {
            assert!((12..28).all(|x| pixel(&image, x, y) != [255; 3]), "row {y}");
        }
        assert_eq!(red[1], 0);
        // Two balls of 1 mm each, and the pixels at their edges.
        assert!(
            (4..20).contains(&blue[0]) && (4..20).contains(&blue[1]),
            "{blue:?}"
        );
    }

    #[test]
    fn views_have_orthonormal_right_handed_axes() {
        let view = View::turned(0.7, 0.4);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let [r, u, t] = [view.right, view.up, view.toward];
        let cross = [
            r[1] * u[2] - r[2] * u[1],
            r[2] * u[0] - r[0] * u[2],
            r[0] * u[1] - r[1] * u[0],
        ];
        assert!((dot(r, r) - 1.0).abs() < 1e-12 && (dot(u, u) - 1.0).abs() < 1e-12);
        assert!(dot(r, u).abs() < 1e-12 && (dot(cross, t) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_png_decodes_to_the_image() {
        let image = picture(&[(&cloud(&[[0.0; 3]]), Paint::Own)]);
        let png = image.to_png();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&png))
            .read_info()
            .expect("a PNG header");
        let mut rgb = vec![0; image.rgb.len()];
        let info = reader.next_frame(&mut rgb).expect("PNG pixels");
        assert_eq!((info.width, info.height), (40, 30));
        assert_eq!(rgb, image.rgb);
    }
}
