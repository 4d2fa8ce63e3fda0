//! Samplers against fields whose flows are known.

use super::*;

/// The exact marginal velocity that carries `N(0, a^2)` to `N(0, b^2)` along straight paths.
///
/// `X_t` has deviation `s(t)`, `s^2 = (1-t)^2 a^2 + t^2 b^2`, and `u = x s'/s`, so `X_1 = X_0 b/a`.
struct Gaussian {
    a: f32,
    b: f32,
}

impl VelocityField for Gaussian {
    fn channels(&self) -> Channels {
        Channels::Xyz
    }

    fn velocity(&self, t: f32, _: &[f32], points: &[f32], velocities: &mut [f32]) {
        let (a, b) = (self.a * self.a, self.b * self.b);
        let rate = (t * b - (1.0 - t) * a) / ((1.0 - t) * (1.0 - t) * a + t * t * b);
        velocities
            .iter_mut()
            .zip(points)
            .for_each(|(v, x)| *v = rate * x);
    }
}

fn error(field: &Gaussian, sampler: Sampler) -> f32 {
    let mut points = [0.3, -0.5, 0.7];
    sampler.integrate(field, &[], &mut points);
    (points[1] / -0.5 - field.b / field.a).abs()
}

#[test]
fn methods_converge_with_their_order() {
    let field = Gaussian { a: 0.5, b: 0.2 };
    let grids = [TimeGrid::Uniform, TimeGrid::Power(2.0)];
    // With equal steps, the errors of the method of third order change their sign at some number of steps.
    for (method, expected, steps, grids) in [
        (Method::Heun, 2.0, 64, &grids[..]),
        (Method::Euler, 1.0, 64, &grids),
        (Method::AdamsBashforth, 2.0, 64, &grids),
        (Method::Exponential, 2.0, 64, &grids),
        (Method::Exponential3, 3.0, 32, &grids[1..]),
    ] {
        for &grid in grids {
            let sampler = |steps| Sampler {
                method,
                steps,
                grid,
                ..Sampler::PAPER
            };
            let [coarse, fine] = [steps, 2 * steps].map(|steps| error(&field, sampler(steps)));
            let order = (coarse / fine).log2();
            assert!(
                (order - expected).abs() < 0.3,
                "{method:?} {grid:?}: {order}"
            );
        }
    }
}

/// Where all paths lead to one point, the data prediction is exact from the first step on.
#[test]
fn the_exponential_method_is_exact_for_a_point() {
    let field = Gaussian { a: 0.5, b: 0.0 };
    let at_once = Sampler {
        method: Method::Exponential,
        steps: 2,
        ..Sampler::PAPER
    };
    assert!(error(&field, at_once) < 1e-6);
}

#[test]
fn evaluations_are_counted() {
    struct Counting(std::sync::atomic::AtomicUsize);
    impl VelocityField for Counting {
        fn channels(&self) -> Channels {
            Channels::Xyz
        }

        fn velocity(&self, _: f32, _: &[f32], _: &[f32], velocities: &mut [f32]) {
            self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            velocities.fill(0.0);
        }
    }
    for method in Method::ALL {
        let sampler = Sampler {
            method,
            ..Sampler::default()
        };
        let field = Counting(0.into());
        let taken = sampler.integrate(&field, &[], &mut [0.0; 3]);
        assert_eq!(taken, sampler.evaluations());
        assert_eq!(field.0.into_inner(), taken);
    }
}

/// The denoising leads to the mean of the data given the integrated points as points of its time: for the Gaussian
/// `E[X_1 | X_t = x] = x + (1 - t) u(x, t)`.
#[test]
fn the_denoising_predicts_the_data_of_its_time() {
    let field = Gaussian { a: 0.5, b: 0.2 };
    let [plain, denoised] = [None, Some(0.75)].map(|denoise| {
        let sampler = Sampler {
            denoise,
            ..Sampler::default()
        };
        let mut points = [0.3, -0.5, 0.7];
        sampler.integrate(&field, &[], &mut points);
        points
    });
    // Cov(X_1, X_t) / Var(X_t) = t b^2 / ((1 - t)^2 a^2 + t^2 b^2).
    let (t, a, b) = (0.75_f32, 0.25, 0.04);
    let gain = t * b / ((1.0 - t) * (1.0 - t) * a + t * t * b);
    for (plain, denoised) in plain.iter().zip(denoised) {
        assert!(
            (denoised - gain * plain).abs() < 1e-6,
            "{denoised}, {plain}"
        );
    }
}

#[test]
fn observers_see_every_step_and_the_denoised_end() {
    let field = Gaussian { a: 0.5, b: 0.2 };
    let sampler = Sampler {
        steps: 3,
        ..Sampler::default()
    };
    let (mut points, mut seen) = ([0.3, -0.5, 0.7], Vec::new());
    sampler.integrate_observed(&field, &[], &mut points, |taken, points| {
        seen.push((taken, points[0]));
    });
    let steps: Vec<usize> = seen.iter().map(|(taken, _)| *taken).collect();
    assert_eq!(steps, [1, 2, 3, 3]);
    assert_eq!(seen.last().map(|(_, x)| *x), Some(points[0]));
}

fn adaptive(method: Method, tolerance: f32) -> Sampler {
    Sampler {
        method,
        steps: 2000,
        grid: TimeGrid::Adaptive(tolerance),
        ..Sampler::PAPER
    }
}

#[test]
fn a_smaller_tolerance_takes_more_steps_and_errs_less() {
    let field = Gaussian { a: 0.5, b: 0.05 };
    for method in [
        Method::AdamsBashforth,
        Method::Exponential,
        Method::Exponential3,
    ] {
        let [coarse, fine] = [1e-2, 1e-4].map(|tolerance| {
            let sampler = adaptive(method, tolerance);
            let evaluations = sampler.integrate(&field, &[], &mut [0.3, -0.5, 0.7]);
            (evaluations, error(&field, sampler))
        });
        assert!(
            coarse.0 < fine.0 && fine.0 < 500,
            "{method:?}: {coarse:?}, {fine:?}"
        );
        assert!(
            fine.1 < 0.1 * coarse.1 && fine.1 < 2e-3,
            "{method:?}: {coarse:?}, {fine:?}"
        );
    }
}

#[test]
fn steps_shorter_than_f32_tells_apart_do_no_harm() {
    let field = Gaussian { a: 0.5, b: 0.2 };
    for method in Method::ALL {
        let sampler = Sampler {
            method,
            steps: 100,
            grid: TimeGrid::Power(10.0),
            ..Sampler::PAPER
        };
        let mut points = [0.3, -0.5, 0.7];
        let mut seen = 0;
        let taken = sampler.integrate_observed(&field, &[], &mut points, |k, _| seen = k);
        assert!(taken <= sampler.evaluations());
        assert_eq!(seen, 100, "{method:?}");
        let error = error(&field, sampler);
        assert!(error < 0.1, "{method:?}: {error}");
    }
}

#[test]
fn an_adaptive_integration_ends_with_the_steps_that_it_may_take() {
    let sampler = Sampler {
        steps: 5,
        ..adaptive(Method::Exponential, 1e-6)
    };
    let field = Gaussian { a: 0.5, b: 0.0 };
    let mut points = [0.3, -0.5, 0.7];
    assert_eq!(sampler.integrate(&field, &[], &mut points), 5);
    assert!(points.iter().all(|x| x.abs() < 1e-5), "{points:?}");
}

#[test]
fn a_tolerance_is_refused_where_no_step_knows_the_one_before() {
    for method in [Method::Heun, Method::Euler] {
        let error = adaptive(method, 0.01).check().expect_err("one step");
        assert!(error.to_string().contains("none with heun and euler"));
    }
    let error = adaptive(Method::Exponential, 0.0)
        .check()
        .expect_err("no tolerance");
    assert_eq!(
        error.to_string(),
        "sampler tolerance is 0, expected 1e-6 to 1"
    );
}

#[test]
fn constant_velocity_is_integrated_exactly() {
    struct Constant;
    impl VelocityField for Constant {
        fn channels(&self) -> Channels {
            Channels::Xyz
        }

        fn velocity(&self, _: f32, condition: &[f32], _: &[f32], velocities: &mut [f32]) {
            velocities.fill(condition[0]);
        }
    }
    for method in [Method::Heun, Method::Euler, Method::AdamsBashforth] {
        let mut points = [0.25, -0.5, 0.75];
        let sampler = Sampler {
            method,
            steps: 8,
            ..Sampler::PAPER
        };
        sampler.integrate(&Constant, &[0.5], &mut points);
        assert_eq!(points, [0.75, 0.0, 1.25], "{method:?}");
    }
}

#[test]
fn a_grid_dense_near_the_data_resolves_a_narrow_cloud_better() {
    let field = Gaussian { a: 0.5, b: 0.02 };
    let [uniform, dense] = [TimeGrid::Uniform, TimeGrid::Power(2.0)].map(|grid| {
        error(
            &field,
            Sampler {
                grid,
                denoise: None,
                ..Sampler::default()
            },
        )
    });
    assert!(dense < 0.25 * uniform, "{dense} against {uniform}");
}

#[test]
fn times_and_shares_that_are_none_are_refused() {
    for (sampler, expected) in [
        (
            Sampler {
                denoise: Some(1.0),
                ..Sampler::default()
            },
            "sampler denoising time is 1, expected 0 to below 1",
        ),
        (
            Sampler {
                spare: -0.1,
                ..Sampler::default()
            },
            "sampler spare points is -0.1, expected a share, 0 to 1",
        ),
    ] {
        let error = sampler.check().expect_err("no sampler").to_string();
        assert_eq!(error, expected);
    }
}

#[test]
fn a_sampler_without_steps_is_refused() {
    let error = Sampler {
        steps: 0,
        ..Sampler::default()
    }
    .check()
    .expect_err("no steps");
    assert_eq!(
        error.to_string(),
        "sampler steps is 0, expected 1 to 100000"
    );
}

#[test]
fn colours_are_clamped_after_each_step_and_positions_are_not() {
    /// Takes red up, green down, and the position out of [0, 1].
    struct Outward;
    impl VelocityField for Outward {
        fn channels(&self) -> Channels {
            Channels::XyzRgb
        }

        fn velocity(&self, _: f32, _: &[f32], points: &[f32], velocities: &mut [f32]) {
            for v in velocities.chunks_exact_mut(6) {
                v.copy_from_slice(&[1.0, -1.0, 0.0, 1.0, -1.0, 0.25]);
            }
            assert_eq!(points.len(), velocities.len());
        }
    }
    for method in Method::ALL {
        let sampler = Sampler {
            method,
            steps: 4,
            denoise: Some(0.5),
            ..Sampler::PAPER
        };
        let mut points = [0.5; 6].repeat(2);
        sampler.integrate_observed(&Outward, &[], &mut points, |_, points| {
            let mut colors = points.chunks_exact(6).flat_map(|point| &point[3..]);
            assert!(colors.all(|x| (0.0..=1.0).contains(x)), "{points:?}");
        });
        for point in points.chunks_exact(6) {
            for (x, expected) in point.iter().zip([2.0, -1.0, 0.5, 1.0, 0.0, 0.875]) {
                assert!((x - expected).abs() < 1e-6, "{method:?}: {point:?}");
            }
        }
        let free = Sampler {
            colors: ColorSteps::Free,
            ..sampler
        };
        let mut points = [0.5; 6];
        free.integrate(&Outward, &[], &mut points);
        assert!((points[3] - 2.0).abs() < 1e-6);
    }
}

#[test]
fn parts_of_a_path_make_the_path_where_the_method_has_no_memory() {
    let field = Gaussian { a: 0.5, b: 0.02 };
    let sampler = Sampler {
        method: Method::Euler,
        steps: 6,
        ..Sampler::DEFAULT
    };
    let mut whole = [0.4, -0.3, 0.2];
    let mut parts = whole;
    sampler.integrate(&field, &[], &mut whole);
    for part in [0..2, 2..5, 5..6] {
        sampler.integrate_part(&field, &[], part, &mut parts, |_, _| {});
    }
    assert_eq!(parts, whole);
}
