//! Angles in robot files: in radians, or under a name of their own in degrees.

/// The angles that a file gives in one of two ways, in radians; `None` where it gives neither.
///
/// # Errors
/// What is wrong with giving both, by the fields' `names`.
pub(super) fn one_of<T>(
    radians: Option<T>,
    degrees: Option<T>,
    names: [&str; 2],
    to_radians: impl Fn(T) -> T,
) -> Result<Option<T>, String> {
    match (radians, degrees) {
        (Some(_), Some(_)) => Err(format!(
            "both `{}` (radians) and `{}` are given; expected one of them",
            names[0], names[1]
        )),
        (radians, degrees) => Ok(radians.or(degrees.map(to_radians))),
    }
}

/// As [`one_of`], for angles that must be given.
///
/// # Errors
/// As [`one_of`], and for neither.
pub(super) fn required<T>(
    radians: Option<T>,
    degrees: Option<T>,
    names: [&str; 2],
    to_radians: impl Fn(T) -> T,
) -> Result<T, String> {
    one_of(radians, degrees, names, to_radians)?
        .ok_or_else(|| format!("missing field `{}` (radians) or `{}`", names[0], names[1]))
}
