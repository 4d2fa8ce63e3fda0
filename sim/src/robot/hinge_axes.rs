//! The axes of hinges as they stand, and what turns along them are.

use nalgebra::{Matrix3, Vector3};

/// The axes of a joint's hinges as they stand in some frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HingeAxes {
    count: usize,
    /// The axes as columns: what takes rates of the angles to those of turning.
    pub axes: Matrix3<f64>,
    /// Their dual basis: what takes turns back to steps of the angles, transposed, and moments about the axes to one moment.
    pub dual: Matrix3<f64>,
}

impl HingeAxes {
    pub(super) fn new(count: usize, axes: [Vector3<f64>; 3]) -> Self {
        let [a, b, c] = &axes;
        let dual = match count {
            1 => axes,
            2 => {
                let cos = a.dot(b);
                let squared = 1.0 - cos * cos;
                [(a - b * cos) / squared, (b - a * cos) / squared, *c]
            }
            _ => {
                let volume = a.dot(&b.cross(c));
                [b.cross(c), c.cross(a), a.cross(b)].map(|normal| normal / volume)
            }
        };
        Self {
            count,
            axes: Matrix3::from_columns(&axes),
            dual: Matrix3::from_columns(&dual),
        }
    }

    /// The same in the frame to which `orientation` leads.
    pub fn turned(&self, orientation: &Matrix3<f64>) -> Self {
        Self {
            count: self.count,
            axes: orientation * self.axes,
            dual: orientation * self.dual,
        }
    }

    /// The pairs of hinges, the lower first.
    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        let count = self.count;
        (1..count).flat_map(|upper| (0..upper).map(move |lower| (lower, upper)))
    }

    /// What steps along the angles add to second derivatives along turns, as a form of turns (N m/rad), where the gradient by turns
    /// is `moment` (N m): `1/2 moment . (e_i x e_j)` for each pair.
    pub fn curving(&self, moment: &Vector3<f64>) -> Matrix3<f64> {
        let mut form = Matrix3::zeros();
        for (i, j) in self.pairs() {
            let turned = self.axes.column(i).cross(&self.axes.column(j));
            let entry = self.dual.column(i) * self.dual.column(j).transpose();
            form += (entry + entry.transpose()) * (0.5 * moment.dot(&turned));
        }
        form
    }

    /// How fast the rate of turning changes at constant `rates` of the angles (rad/s²): lower hinges turn the axes of those above.
    pub fn bias(&self, rates: &Vector3<f64>) -> Vector3<f64> {
        (self.pairs()).fold(Vector3::zeros(), |sum, (i, j)| {
            let turned = self.axes.column(i).cross(&self.axes.column(j));
            sum + turned * (rates[i] * rates[j])
        })
    }

    /// A diagonal form of the angles as one of turns.
    pub fn form(&self, diagonal: &Vector3<f64>) -> Matrix3<f64> {
        self.dual * Matrix3::from_diagonal(diagonal) * self.dual.transpose()
    }

    /// The part of a turn or a moment that is along turns that the hinges allow.
    pub fn project(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        match self.count {
            3 => *vector,
            _ => self.axes * self.dual.tr_mul(vector),
        }
    }

    /// A form of turns on those alone that the hinges allow, the others held by as much as its mean on these.
    pub fn confine(&self, form: &Matrix3<f64>) -> Matrix3<f64> {
        if self.count == 3 {
            return *form;
        }
        let free = self.projector();
        let confined = free * form * free;
        let held = confined.trace().abs() / self.count as f64;
        confined + (Matrix3::identity() - free) * held
    }

    /// The inverse of a confined form, on those turns alone.
    pub fn release(&self, inverse: &Matrix3<f64>) -> Matrix3<f64> {
        if self.count == 3 {
            return *inverse;
        }
        let free = self.projector();
        free * inverse * free
    }

    /// What projects onto the turns that the hinges allow.
    pub fn projector(&self) -> Matrix3<f64> {
        self.axes * self.dual.transpose()
    }
}
