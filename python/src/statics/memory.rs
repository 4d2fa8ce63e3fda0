//! The memory of a settler as numbers.

use tdcr::sim::chain::Configuration;
use tdcr::sim::statics::{Equilibrium, Growth, Memory};

use crate::arrays::{Tape, flat_points, flat_quaternions};

use super::numbers::{EXAMINED, STABILITY, code};

/// Numbers of a settler's memory, for [`read_memory`].
pub fn write_memory(memory: &Memory, out: &mut Vec<f64>) {
    let at = &memory.equilibrium;
    out.extend([
        f64::from(at.converged),
        f64::from(code(&STABILITY, at.stability)),
    ]);
    out.push(f64::from(code(&EXAMINED, at.examined)));
    let growth = at.growth.map_or([0.0; 3], |growth| {
        let without = f64::from(growth.without_damping);
        [growth.rate, growth.angular_frequency, without]
    });
    out.extend(growth);
    out.extend([at.residual, at.iterations as f64]);
    out.extend(flat_quaternions(&at.configuration.0));
    out.extend(flat_points(&at.positions));
    out.extend(flat_quaternions(&at.orientations));
    out.extend(at.tendon_lengths.iter().chain(&at.tendon_tensions));
    out.extend(flat_quaternions(&memory.predicted.0));
    out.extend(memory.command.iter().chain(&memory.change));
}

/// The memory of a settler of `robot` that [`write_memory`] wrote.
pub fn read_memory(robot: &tdcr::sim::robot::Robot, tape: &mut Tape<'_>) -> Memory {
    let (n, t) = (robot.discs().len(), robot.tendons().len());
    let (converged, stability) = (tape.number() == 1.0, tape.number());
    let examined = tape.number();
    let growth = Growth {
        rate: tape.number(),
        angular_frequency: tape.number(),
        without_damping: tape.number() == 1.0,
    };
    Memory {
        equilibrium: Equilibrium {
            converged,
            stability: STABILITY.get(stability as usize).copied().flatten(),
            examined: EXAMINED.get(examined as usize).copied().flatten(),
            growth: (growth.rate > 0.0).then_some(growth),
            residual: tape.number(),
            iterations: tape.number() as usize,
            configuration: Configuration(tape.quaternions(n)),
            positions: tape.points(n),
            orientations: tape.quaternions(n),
            tendon_lengths: tape.take(t).to_vec(),
            tendon_tensions: tape.take(t).to_vec(),
        },
        predicted: Configuration(tape.quaternions(n)),
        command: tape.take(t).to_vec(),
        change: tape.take(t).to_vec(),
    }
}
