//! Loops of the tip as one tendon is pulled and released, with friction.

use nalgebra::Vector3;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Equilibrium;
use tdcr_sim::tendon_friction::ContactPath;

use crate::study::spec::HysteresisLoop;

/// Where the tip comes as a tendon's command goes out and back.
pub(in crate::study) struct TipLoop {
    /// The tendon's commands (m, or N), as many out as back, the first and the last the same.
    commands: Vec<f64>,
    /// The tip under them (m).
    tips: Vec<Vector3<f64>>,
    /// Energy lost in friction (J).
    pub dissipated: f64,
}

impl TipLoop {
    /// From `command`, among the obstacles of a scene; `None` where the path breaks off or leaves a tendon's range.
    pub fn new(
        (robot, scene): (&Robot, &Scene),
        command: &Command,
        loads: &Loads,
        about: HysteresisLoop,
    ) -> Option<Self> {
        let start = *command.as_slice().get(about.tendon)?;
        let at = |part: usize| start + about.by * part as f64 / about.points as f64;
        let commands: Vec<f64> = (0..=about.points)
            .chain((0..about.points).rev())
            .map(at)
            .collect();
        let mut path = ContactPath::new(robot, scene);
        let tip = |equilibrium: &Equilibrium| {
            (equilibrium.converged).then(|| equilibrium.pose().tip().translation.vector)
        };
        let mut tips = Vec::with_capacity(commands.len());
        let mut values = command.as_slice().to_vec();
        for (place, pulled) in commands.iter().enumerate() {
            values[about.tendon] = *pulled;
            let command = robot.command(&values).ok()?;
            let step = match place {
                0 => path.start(&command, loads),
                _ => path.advance(&command, loads),
            }
            .ok()?;
            tips.push(tip(&step.equilibrium)?);
        }
        Some(Self {
            commands,
            tips,
            dissipated: path.state().dissipated,
        })
    }

    /// Largest distance between the tips on the way out and back under the same command (m).
    pub fn width(&self) -> f64 {
        let pairs = self.tips.iter().zip(self.tips.iter().rev());
        pairs
            .map(|(out, back)| (out - back).norm())
            .fold(0.0, f64::max)
    }

    /// Command, and displacement of the tip (m) along the line from its start to where the command turns.
    pub(in crate::study) fn course(&self) -> Vec<[f64; 2]> {
        let start = self.tips[0];
        let along = (self.tips[self.tips.len() / 2] - start).try_normalize(0.0);
        let along = along.unwrap_or_default();
        let pairs = self.commands.iter().zip(&self.tips);
        pairs
            .map(|(command, tip)| [*command, (tip - start).dot(&along)])
            .collect()
    }

    /// Area (m times the command's unit) within the course, whose end is joined to its start (the shoelace formula).
    pub fn area(&self) -> f64 {
        let course = self.course();
        let next = course.iter().cycle().skip(1);
        let twice = course
            .iter()
            .zip(next)
            .map(|([x0, y0], [x1, y1])| x0 * y1 - x1 * y0);
        0.5 * twice.sum::<f64>().abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tip that lags by 1 mm on a line, over 10 mm of command: a parallelogram.
    #[test]
    fn the_area_of_a_loop_is_that_of_its_polygon() {
        let commands = vec![0.0, 0.01, 0.0];
        let tips = [0.0, 0.02, 0.001].map(|x| Vector3::new(0.0, x, 0.0));
        let found = TipLoop {
            commands,
            tips: tips.into(),
            dissipated: 0.0,
        };
        assert!((found.area() - 0.5 * 0.01 * 0.001).abs() < 1e-15);
        assert!((found.width() - 0.001).abs() < 1e-15);
    }
}
