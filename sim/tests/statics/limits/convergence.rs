//! The order at which a discretisation's error falls.

/// Errors at three resolutions, each double the one before.
pub fn errors(coarsest: usize, error: impl Fn(usize) -> f64) -> [f64; 3] {
    [1, 2, 4].map(|factor| error(coarsest * factor))
}

/// Asserts that the errors fall with the given order, and have fallen below `finest` at last.
#[track_caller]
pub fn assert_order(order: f64, errors: [f64; 3], finest: f64) {
    for pair in errors.windows(2) {
        let found = (pair[0] / pair[1]).abs().log2();
        assert!(
            (found - order).abs() < 0.12,
            "order {found} instead of {order}: errors {errors:?}"
        );
    }
    assert!(errors[2].abs() < finest, "errors {errors:?}");
}

/// The limit that results of second order tend to, from two resolutions, the finer one double the
/// coarser (Richardson).
pub fn extrapolated<T>(coarse: T, fine: T) -> T
where
    T: Clone
        + std::ops::Sub<Output = T>
        + std::ops::Add<Output = T>
        + std::ops::Div<f64, Output = T>,
{
    fine.clone() + (fine - coarse) / 3.0
}
