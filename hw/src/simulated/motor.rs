//! A geared direct-current motor with its temperature: what turns a horn.
//!
//! With the duty cycle `u` of the supply `V`, the current is `i = (u V - k_e w) / R` and the horn obeys
//! `J dw/dt = k_t i - r T`, against friction of the gear (Coulomb) that holds it at rest up to its bound. All constants are
//! seen from the horn. `R`, `k_t`, `k_e` follow from the data sheet's stall torque and current and no-load speed; friction,
//! inertia and the thermal constants are of the right size, not measured.

use std::f64::consts::TAU;

/// Share of the stall torque that the gear's friction takes.
const FRICTION: f64 = 0.05;
/// Time (s) in which an unloaded motor comes to 63 % of its speed.
const MECHANICAL_TIME: f64 = 0.02;
/// Resistance of the supply line (Ohm): the voltage sags under load.
const LINE_RESISTANCE: f64 = 0.1;
/// Warming at rest per heat (K/W), and the time (s) in which 63 % of it is reached.
const THERMAL_RESISTANCE: f64 = 40.0;
const THERMAL_TIME: f64 = 300.0;
/// Temperature around (degrees Celsius).
pub(super) const AMBIENT: f64 = 25.0;
/// Share of the stall current above which a load is one too many, and for how long (s) it is borne.
const OVERLOAD: f64 = 0.8;
const OVERLOAD_TIME: f64 = 1.0;

/// What a motor is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorData {
    /// Supply voltage of the data sheet (V).
    pub voltage: f64,
    /// Torque of the blocked horn (N m).
    pub stall_torque: f64,
    /// Current of the blocked motor (A).
    pub stall_current: f64,
    /// Speed without load (rev/min).
    pub no_load_speed: f64,
}

impl MotorData {
    /// Torque per current (N m/A).
    pub fn torque_constant(&self) -> f64 {
        self.stall_torque / self.stall_current
    }

    fn resistance(&self) -> f64 {
        self.voltage / self.stall_current
    }

    fn friction(&self) -> f64 {
        FRICTION * self.stall_torque
    }

    /// Voltage per speed (V s/rad): at the no-load speed the current bears the friction.
    fn back_emf(&self) -> f64 {
        (1.0 - FRICTION) * self.voltage * 60.0 / (TAU * self.no_load_speed)
    }

    fn inertia(&self) -> f64 {
        MECHANICAL_TIME * self.torque_constant() * self.back_emf() / self.resistance()
    }
}

/// What the bridge does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Drive {
    /// Open: no current, and nothing but the gear's friction holds the horn.
    Off,
    /// This duty cycle, -1 to 1, with the current (A) within a bound.
    Duty { duty: f64, current_limit: f64 },
    /// This current (A), as far as the voltage goes.
    Current(f64),
}

/// A motor in a moment.
#[derive(Clone, Debug)]
pub(super) struct Motor {
    data: MotorData,
    /// Supply voltage without load (V).
    pub supply: f64,
    /// Angle of the horn (rad, counter-clockwise), over any number of turns.
    pub angle: f64,
    /// Its angular velocity (rad/s).
    pub velocity: f64,
    /// Current (A), of the sign of the torque.
    pub current: f64,
    /// Duty cycle, -1 to 1.
    pub duty: f64,
    /// Temperature inside (degrees Celsius).
    pub temperature: f64,
    /// Time at overload (s).
    overloaded: f64,
}

impl Motor {
    /// A cold motor at rest, its horn at `angle` (rad), on the data sheet's voltage.
    pub fn new(data: MotorData, angle: f64) -> Self {
        Self {
            data,
            supply: data.voltage,
            angle,
            velocity: 0.0,
            current: 0.0,
            duty: 0.0,
            temperature: AMBIENT,
            overloaded: 0.0,
        }
    }

    /// Voltage at its terminals (V).
    pub fn voltage(&self) -> f64 {
        self.supply - LINE_RESISTANCE * (self.duty * self.current).abs()
    }

    /// Whether its load has been too large for too long.
    pub fn is_overloaded(&self) -> bool {
        self.overloaded > OVERLOAD_TIME
    }

    /// Forgets how long it has been overloaded.
    pub fn rest(&mut self) {
        self.overloaded = 0.0;
    }

    /// Goes on by `dt` (s) under the torque `load` (N m) about the horn.
    pub fn step(&mut self, dt: f64, drive: Drive, load: f64) {
        let end = match drive {
            Drive::Off => self.at_current(dt, 0.0, load),
            Drive::Current(current) => {
                let end = self.at_current(dt, current, load);
                match end.duty.abs() <= 1.0 {
                    true => end,
                    false => self.at_duty(dt, end.duty.signum(), load),
                }
            }
            Drive::Duty {
                duty,
                current_limit,
            } => {
                let end = self.at_duty(dt, duty.clamp(-1.0, 1.0), load);
                match end.current.abs() <= current_limit {
                    true => end,
                    false => self.at_current(dt, current_limit.copysign(end.current), load),
                }
            }
        };
        self.velocity = end.velocity;
        self.angle += dt * self.velocity;
        self.current = end.current;
        self.duty = match drive {
            Drive::Off => 0.0,
            _ => end.duty.clamp(-1.0, 1.0),
        };
        // C dT/dt = R i² - (T - T_ambient) / R_th, solved exactly for a constant current.
        let data = &self.data;
        let warm = AMBIENT + THERMAL_RESISTANCE * data.resistance() * self.current * self.current;
        self.temperature = warm + (self.temperature - warm) * (-dt / THERMAL_TIME).exp();
        if self.current.abs() > OVERLOAD * data.stall_current {
            self.overloaded += dt;
        } else {
            self.overloaded = 0.0;
        }
    }

    /// A step at a duty cycle, semi-implicit: the back-EMF is that at the end.
    fn at_duty(&self, dt: f64, duty: f64, load: f64) -> End {
        let data = &self.data;
        let volts = duty * self.voltage();
        let stiff = data.torque_constant() / data.resistance();
        let velocity = self.moved(dt, stiff * volts + load, stiff * data.back_emf());
        End {
            velocity,
            current: (volts - data.back_emf() * velocity) / data.resistance(),
            duty,
        }
    }

    /// A step at a current.
    fn at_current(&self, dt: f64, current: f64, load: f64) -> End {
        let data = &self.data;
        let velocity = self.moved(dt, data.torque_constant() * current + load, 0.0);
        let volts = data.resistance() * current + data.back_emf() * velocity;
        End {
            velocity,
            current,
            duty: volts / self.voltage().max(1e-3),
        }
    }

    /// Velocity after `dt` (s) under a torque (N m) and damping (N m s/rad). Friction takes speed away, and holds what it can
    /// stop.
    fn moved(&self, dt: f64, torque: f64, damping: f64) -> f64 {
        let per_inertia = dt / self.data.inertia();
        let implicit = 1.0 + per_inertia * damping;
        let free = (self.velocity + per_inertia * torque) / implicit;
        let stop = per_inertia * self.data.friction() / implicit;
        free.signum() * (free.abs() - stop).max(0.0)
    }
}

/// How a step ends.
struct End {
    velocity: f64,
    current: f64,
    duty: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    const XL330: MotorData = MotorData {
        voltage: 5.0,
        stall_torque: 0.52,
        stall_current: 1.47,
        no_load_speed: 103.0,
    };

    const FULL: Drive = Drive::Duty {
        duty: 1.0,
        current_limit: f64::INFINITY,
    };

    fn run(motor: &mut Motor, seconds: f64, drive: Drive, load: f64) {
        for _ in 0..(seconds * 1000.0) as usize {
            motor.step(1e-3, drive, load);
        }
    }

    #[test]
    fn the_data_sheet_comes_back() {
        let mut motor = Motor::new(XL330, 0.0);
        run(&mut motor, 0.5, FULL, 0.0);
        let speed = motor.velocity * 60.0 / TAU;
        assert!((speed / 103.0 - 1.0).abs() < 0.02, "{speed} rev/min");
        // Blocked: the supply line takes its share of the stall current.
        run(&mut motor, 0.5, FULL, -0.6);
        let mut blocked = Motor::new(XL330, 0.0);
        run(&mut blocked, 0.2, FULL, -0.5);
        assert!(blocked.velocity < 0.5 && blocked.current > 1.35 && blocked.current < 1.47);
    }

    #[test]
    fn friction_of_the_gear_holds_a_small_load_and_no_large_one() {
        let mut motor = Motor::new(XL330, 1.0);
        run(&mut motor, 1.0, Drive::Off, -0.02);
        assert_eq!(motor.angle, 1.0);
        run(&mut motor, 0.1, Drive::Off, -0.05);
        assert!(motor.angle < 0.95, "{}", motor.angle);
    }

    #[test]
    fn current_is_bounded_and_bears_the_load() {
        let mut motor = Motor::new(XL330, 0.0);
        let drive = Drive::Duty {
            duty: 1.0,
            current_limit: 0.3,
        };
        for _ in 0..1000 {
            motor.step(1e-3, drive, -0.2);
            assert!(motor.current <= 0.3, "{}", motor.current);
        }
        // 0.3 A pull with 0.106 N m, less than the load but for the friction: the horn gives way slowly.
        assert!(motor.velocity < 0.0);
        let mut held = Motor::new(XL330, 0.0);
        run(&mut held, 1.0, drive, -0.106);
        assert!(held.velocity.abs() < 1e-3);
    }

    #[test]
    fn a_stalled_motor_heats_up_and_counts_as_overloaded() {
        let mut motor = Motor::new(XL330, 0.0);
        run(&mut motor, 0.9, FULL, -0.52);
        assert!(!motor.is_overloaded());
        run(&mut motor, 0.2, FULL, -0.52);
        assert!(motor.is_overloaded());
        run(&mut motor, 60.0, FULL, -0.52);
        assert!(motor.temperature > 60.0, "{}", motor.temperature);
        run(&mut motor, 1500.0, Drive::Off, 0.0);
        assert!((motor.temperature - AMBIENT).abs() < 1.0);
    }
}
