//! What of a layer is seen: the nearest surface at each sample.

use super::{Frame, Layer, Paint, SUPERSAMPLE, View};

/// Brightness of the farthest point; the nearest has 1.
const FAR_BRIGHTNESS: f64 = 0.72;

/// Levels of brightness: few enough for the pictures to compress well, too many to be seen.
const BRIGHTNESS_LEVELS: f64 = 24.0;

/// Depth difference to a neighbouring sample that shades a sample by a factor of 1/e (m).
const EDGE_DEPTH: f64 = 0.02;

/// Points whose large balls must cover a sample for the surface to be drawn there: one or two that lie off the surface are
/// not it. About 17 cover a place of the surface ([`super::super::closing`]).
const TOGETHER: usize = 3;

/// Nearest surface of a layer at each sample of a supersampled picture.
pub(super) struct DepthBuffer {
    width: usize,
    height: usize,
    /// Coordinate toward the camera (m); minus infinity where there is background.
    depth: Vec<f64>,
    color: Vec<[u8; 3]>,
    /// Least and greatest depth of the surface (m).
    range: [f64; 2],
    /// Whether surfaces are darker with distance; colours that stand for numbers stay what they are.
    shaded: bool,
}

impl DepthBuffer {
    pub(super) fn of(layer: &Layer, view: &View, frame: &Frame) -> Self {
        let (width, height) = (frame.width * SUPERSAMPLE, frame.height * SUPERSAMPLE);
        let mut buffer = Self {
            width,
            height,
            depth: vec![f64::NEG_INFINITY; width * height],
            color: vec![[255; 3]; width * height],
            range: [f64::INFINITY, f64::NEG_INFINITY],
            shaded: !matches!(layer.paint, Paint::Each(_)),
        };
        let sample = frame.metres_per_pixel / SUPERSAMPLE as f64;
        let points: Vec<Splat> = (layer.cloud.points.iter().enumerate())
            .filter_map(|(index, &point)| {
                let color = match layer.paint {
                    Paint::Own => layer.cloud.colors.get(index).copied(),
                    Paint::Flat(color) => Some(color),
                    Paint::Each(colors) => colors.get(index).copied(),
                }?;
                let [u, v, w] = view.project(point);
                let x = (u - frame.center[0]) / sample + 0.5 * width as f64;
                let y = (frame.center[1] - v) / sample + 0.5 * height as f64;
                let finite = [x, y, w].iter().all(|c| c.is_finite());
                finite.then_some(Splat { x, y, w, color })
            })
            .collect();
        buffer.close(&points, layer.closing, sample);
        for point in &points {
            point.cover(layer.ball, sample, [width, height], |index, depth| {
                if depth > buffer.depth[index] {
                    buffer.depth[index] = depth;
                    buffer.color[index] = point.color;
                }
            });
        }
        for depth in buffer.depth.iter().filter(|d| d.is_finite()) {
            buffer.range = [buffer.range[0].min(*depth), buffer.range[1].max(*depth)];
        }
        buffer
    }

    /// Draws the surface that the balls of a radius (m) close: at the depth of the [`TOGETHER`]th nearest, in the colour of
    /// the nearest that is not as far as a radius before it.
    fn close(&mut self, points: &[Splat], radius: f64, sample: f64) {
        let none = (f64::NEG_INFINITY, [255; 3]);
        let mut nearest = vec![[none; TOGETHER]; self.depth.len()];
        for point in points {
            point.cover(radius, sample, [self.width, self.height], |index, depth| {
                let nearest = &mut nearest[index];
                // Into its place from behind: most balls have no place here.
                let mut place = TOGETHER;
                while place > 0 && nearest[place - 1].0 < depth {
                    if place < TOGETHER {
                        nearest[place] = nearest[place - 1];
                    }
                    place -= 1;
                }
                if place < TOGETHER {
                    nearest[place] = (depth, point.color);
                }
            });
        }
        for (index, nearest) in nearest.iter().enumerate() {
            let (depth, _) = nearest[TOGETHER - 1];
            if depth.is_finite() {
                let color = nearest.iter().find(|(nearer, _)| *nearer <= depth + radius);
                self.depth[index] = depth;
                self.color[index] = color.unwrap_or(&nearest[TOGETHER - 1]).1;
            }
        }
    }

    /// Brightness in `[0, 1]` and colour of the surface at a sample: darker with distance, and where
    /// a neighbour stands in front (eye-dome lighting: Boucheny, 2009), which draws the outlines.
    pub(super) fn surface(&self, x: usize, y: usize) -> Option<(f64, [u8; 3])> {
        let index = y * self.width + x;
        let depth = self.depth[index];
        if !depth.is_finite() {
            return None;
        }
        if !self.shaded {
            return Some((1.0, self.color[index]));
        }
        let [far, near] = self.range;
        let nearness = (depth - far) / (near - far).max(f64::MIN_POSITIVE);
        let neighbours = [
            (x.wrapping_sub(SUPERSAMPLE), y),
            (x + SUPERSAMPLE, y),
            (x, y.wrapping_sub(SUPERSAMPLE)),
            (x, y + SUPERSAMPLE),
        ];
        let mut in_front = 0.0;
        for (x, y) in neighbours {
            if x < self.width && y < self.height {
                in_front += (self.depth[y * self.width + x] - depth).clamp(0.0, EDGE_DEPTH);
            }
        }
        let edge = (-in_front / (neighbours.len() as f64 * EDGE_DEPTH)).exp();
        let brightness = (FAR_BRIGHTNESS + (1.0 - FAR_BRIGHTNESS) * nearness) * edge;
        let level = (brightness * BRIGHTNESS_LEVELS).round() / BRIGHTNESS_LEVELS;
        Some((level, self.color[index]))
    }
}

/// A point in a picture.
struct Splat {
    /// Place (samples).
    x: f64,
    y: f64,
    /// Coordinate toward the camera (m).
    w: f64,
    color: [u8; 3],
}

impl Splat {
    /// Calls `each` with the index and the depth (m) of all samples, `sample` wide (m), that the near half of a ball of `radius`
    /// (m) covers in a picture of so many samples.
    fn cover(
        &self,
        radius: f64,
        sample: f64,
        [width, height]: [usize; 2],
        mut each: impl FnMut(usize, f64),
    ) {
        let (r, x, y) = (radius / sample, self.x, self.y);
        // Casts to usize saturate, so a ball beyond the left or top edge starts at 0.
        for row in (y - r) as usize..((y + r + 1.0) as usize).min(height) {
            for column in (x - r) as usize..((x + r + 1.0) as usize).min(width) {
                let [dx, dy] = [column as f64 + 0.5 - x, row as f64 + 0.5 - y];
                let squared = r * r - dx * dx - dy * dy;
                if squared >= 0.0 {
                    each(row * width + column, self.w + squared.sqrt() * sample);
                }
            }
        }
    }
}
