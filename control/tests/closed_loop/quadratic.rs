//! Quadratic programs, by the conditions of Karush, Kuhn and Tucker.

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use tdcr_control::quadratic::QuadraticProgram;

fn program(n: usize, m: usize, numbers: &[f64]) -> QuadraticProgram {
    let mut numbers = numbers.iter().copied().cycle();
    let mut next = move || numbers.next().unwrap();
    let root = DMatrix::from_fn(n, n, |_, _| next());
    QuadraticProgram {
        hessian: &root * root.transpose() + DMatrix::identity(n, n) * 1e-3,
        gradient: DVector::from_fn(n, |_, _| 3.0 * next()),
        rows: DMatrix::from_fn(m, n, |_, _| next()),
        bounds: DVector::from_fn(m, |_, _| next().abs()),
    }
}

proptest! {
    #[test]
    fn solutions_meet_the_conditions_of_karush_kuhn_and_tucker(
        n in 1_usize..8, m in 0_usize..25, numbers in proptest::collection::vec(-1.0..1.0_f64, 300)
    ) {
        let program = program(n, m, &numbers);
        let solved = program.solve().unwrap();
        prop_assert!(solved.is_minimiser);
        let slack = &program.bounds - &program.rows * &solved.x;
        prop_assert!(slack.iter().all(|&slack| slack > -1e-9), "{slack}");
        let mut stationary = &program.hessian * &solved.x + &program.gradient;
        for (&row, &multiplier) in solved.active.iter().zip(&solved.multipliers) {
            prop_assert!(multiplier > -1e-7, "{multiplier}");
            prop_assert!(slack[row].abs() < 1e-8, "{}", slack[row]);
            stationary += program.rows.row(row).transpose() * multiplier;
        }
        prop_assert!(stationary.norm() < 1e-7, "{stationary}");
    }
}

#[test]
fn bounds_below_zero_keep_the_variables_where_they_are() {
    let program = QuadraticProgram {
        hessian: DMatrix::identity(1, 1),
        gradient: DVector::from_element(1, -1.0),
        rows: DMatrix::from_element(1, 1, 1.0),
        bounds: DVector::from_element(1, -0.5),
    };
    assert_eq!(program.solve().unwrap().x[0], 0.0);
}

#[test]
fn what_is_not_finite_or_not_convex_has_no_solution() {
    let mut program = program(3, 4, &[0.3, -0.2, 0.9, 0.4]);
    program.gradient[1] = f64::NAN;
    assert!(program.solve().is_none());
    program.gradient[1] = 0.0;
    program.hessian = -program.hessian;
    assert!(program.solve().is_none());
}
