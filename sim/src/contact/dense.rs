//! What contacts' forces change by, as a dense matrix of the joints' turns.

use faer::Mat;
use nalgebra::{Const, Dyn, Matrix3, Matrix3xX, OMatrix};

use crate::chain::Chain;
use crate::energy::{Coupling, Pressing, add_block};

/// Adds to the derivatives of the moments by the joints' turns what the forces of contacts change by.
pub(super) fn add_stiffness(pressing: &Pressing, chain: &Chain, jacobian: &mut Mat<f64>) {
    let centres = &chain.centres;
    for (disc, form) in pressing.forms.iter().enumerate() {
        if form.iter().all(|number| *number == 0.0) {
            continue;
        }
        // A turn `t` of joint `j` turns the disc by `t`, and displaces its joint's centre by `t x (c_disc - c_j)`.
        let lever = |joint: usize| (centres[disc] - centres[joint]).cross_matrix().transpose();
        let [turns, mixed, levered, shifts] = [(0, 0), (0, 3), (3, 0), (3, 3)]
            .map(|(row, column)| form.fixed_view::<3, 3>(row, column).into_owned());
        for i in 0..=disc {
            let left = lever(i).transpose();
            for j in 0..=disc {
                let right = lever(j);
                let block: Matrix3<f64> =
                    turns + mixed * right + left * levered + left * shifts * right;
                add_block(jacobian, i, j, &block);
            }
        }
    }
    for pair in &pressing.pairs {
        // Displacement of the first point from the second by a turn of each joint.
        let n = centres.len();
        let mut apart = Matrix3xX::zeros(3 * n);
        for (point, sign) in pair.points.iter().zip([1.0, -1.0]) {
            for (joint, centre) in centres.iter().enumerate().take(point.disc + 1) {
                let arm = (point.position - centre).cross_matrix().transpose();
                let mut block = apart.fixed_view_mut::<3, 3>(0, 3 * joint);
                block += arm * sign;
            }
        }
        let forced = pair.form() * &apart;
        for i in 0..n {
            for j in 0..n {
                let [row, column] = [i, j].map(|joint| 3 * joint);
                let block: Matrix3<f64> =
                    apart.fixed_columns::<3>(row).transpose() * forced.fixed_columns::<3>(column);
                add_block(jacobian, i, j, &block);
            }
        }
    }
    for coupling in &pressing.couplings {
        add_coupling(coupling, chain, jacobian);
    }
}

fn add_coupling(coupling: &Coupling, chain: &Chain, jacobian: &mut Mat<f64>) {
    // Motions of both discs by a turn of each joint.
    let n = chain.centres.len();
    let mut motions = OMatrix::<f64, Const<12>, Dyn>::zeros(3 * n);
    for (end, disc) in coupling.discs.into_iter().enumerate() {
        for (joint, centre) in chain.centres.iter().enumerate().take(disc + 1) {
            let arm = (coupling.position - centre).cross_matrix().transpose();
            let [turn, shift] = [6 * end, 6 * end + 3];
            motions
                .fixed_view_mut::<3, 3>(turn, 3 * joint)
                .copy_from(&Matrix3::identity());
            motions
                .fixed_view_mut::<3, 3>(shift, 3 * joint)
                .copy_from(&arm);
        }
    }
    let forced = coupling.form * &motions;
    for i in 0..n {
        for j in 0..n {
            let block: Matrix3<f64> =
                motions.fixed_columns::<3>(3 * i).transpose() * forced.fixed_columns::<3>(3 * j);
            add_block(jacobian, i, j, &block);
        }
    }
}
