//! Obstacles in pictures of lines.

use nalgebra::Vector3;
use tdcr_sim::scene::{ObstacleShape, Scene};

use super::figure::{Ink, Mark, Shape};

/// How far beyond what else is drawn obstacles are shown, as a share of that.
const MARGIN: f64 = 0.15;

/// The part of a plane that is drawn: what is smallest and largest along its two axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    low: [f64; 2],
    high: [f64; 2],
}

impl Window {
    /// Around points, with a margin.
    pub fn around(points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let extent = (0..2)
            .map(|axis| high[axis] - low[axis])
            .fold(0.0, f64::max);
        Self {
            low: low.map(|end| end - MARGIN * extent),
            high: high.map(|end| end + MARGIN * extent),
        }
    }

    /// The part of a straight piece that is in it (Liang and Barsky, 1984).
    fn clip(&self, [a, b]: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let way = b[axis] - a[axis];
            let ends = [self.low[axis] - a[axis], self.high[axis] - a[axis]];
            if way == 0.0 {
                if ends[0] > 0.0 || ends[1] < 0.0 {
                    return None;
                }
                continue;
            }
            let [enter, leave] = ends.map(|end| end / way);
            first = first.max(enter.min(leave));
            last = last.min(enter.max(leave));
        }
        let at = |share: f64| [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]));
        (first < last).then(|| [at(first), at(last)])
    }
}

/// The obstacles of a scene as one sees them from far away along `towards`, those behind others included: their outlines and
/// edges, and of half spaces the section through `middle` (m). `place` is where a point (m) is in the picture.
pub fn outlines(
    scene: &Scene,
    towards: &Vector3<f64>,
    middle: &Vector3<f64>,
    window: Window,
    place: impl Fn(&Vector3<f64>) -> [f64; 2],
) -> Mark {
    let pieces = scene.obstacles().iter().flat_map(|obstacle| {
        let surface = obstacle.surface();
        match obstacle.shape {
            ObstacleShape::HalfSpace => surface.section(middle, towards),
            _ => surface.edges(towards),
        }
    });
    drawn(pieces, window, place)
}

/// Where the plane through `middle` (m) at right angles to `normal` cuts the obstacles of a scene, as in [`outlines`].
pub fn sections(
    scene: &Scene,
    normal: &Vector3<f64>,
    middle: &Vector3<f64>,
    window: Window,
    place: impl Fn(&Vector3<f64>) -> [f64; 2],
) -> Mark {
    let pieces =
        (scene.obstacles().iter()).flat_map(|obstacle| obstacle.surface().section(middle, normal));
    drawn(pieces, window, place)
}

fn drawn(
    pieces: impl Iterator<Item = [Vector3<f64>; 2]>,
    window: Window,
    place: impl Fn(&Vector3<f64>) -> [f64; 2],
) -> Mark {
    let flat = pieces.map(|[a, b]| [place(&a), place(&b)]);
    Mark {
        name: String::new(),
        shape: Shape::Segments,
        ink: Ink::Vermilion,
        points: flat
            .filter_map(|piece| window.clip(piece))
            .flatten()
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use tdcr_sim::scene::Obstacle;

    use super::*;

    #[test]
    fn what_is_outside_of_the_window_is_cut_off() {
        let window = Window::around([[0.0, 0.0], [10.0, 10.0]]);
        let whole = window.clip([[-100.0, 5.0], [100.0, 5.0]]).unwrap();
        assert_eq!(whole, [[-1.5, 5.0], [11.5, 5.0]]);
        assert_eq!(
            window.clip([[1.0, 2.0], [3.0, 4.0]]).unwrap(),
            [[1.0, 2.0], [3.0, 4.0]]
        );
        assert!(window.clip([[-5.0, 20.0], [30.0, 20.0]]).is_none());
        assert!(window.clip([[12.0, 0.0], [12.0, 9.0]]).is_none());
    }

    #[test]
    fn a_floor_is_a_line_and_a_box_its_edges() {
        let part = Obstacle::cuboid("part", [0.1, 0.1, 0.1])
            .unwrap()
            .at([0.1, 0.0, 0.2]);
        let scene = Scene::new(vec![Obstacle::half_space("floor"), part]).unwrap();
        let window = Window::around([[0.0, 0.0], [1.0, 1.0]]);
        let flat = |p: &Vector3<f64>| [p.x, p.z];
        let drawn = outlines(&scene, &Vector3::y(), &Vector3::zeros(), window, flat);
        // The floor's top and bottom face, and the twelve edges of the box, four of which are points and not drawn.
        let on_floor = drawn.points.iter().filter(|p| p[1].abs() < 1e-12).count();
        assert!(on_floor >= 2, "{:?}", drawn.points);
        let of_part = drawn.points.iter().filter(|p| (p[1] - 0.15).abs() < 1e-12);
        assert!(of_part.count() >= 4);
        // But for rounding.
        let mut numbers = drawn.points.iter().flatten();
        assert!(numbers.all(|x| (-0.15 - 1e-12..=1.15 + 1e-12).contains(x)));
    }
}
