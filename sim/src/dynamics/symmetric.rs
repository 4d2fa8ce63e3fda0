//! Products of small matrices that the recursions are made of, written out: their loops are short,
//! and half of a symmetric matrix need not be computed.

use nalgebra::{Matrix3, Vector3};

/// A symmetric 3 x 3 matrix.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Symmetric {
    pub xx: f64,
    pub xy: f64,
    pub xz: f64,
    pub yy: f64,
    pub yz: f64,
    pub zz: f64,
}

impl Symmetric {
    /// `scale I`.
    #[inline(always)]
    pub fn isotropic(scale: f64) -> Self {
        Self {
            xx: scale,
            yy: scale,
            zz: scale,
            ..Self::default()
        }
    }

    /// `R diag(moments) R'`.
    #[inline(always)]
    pub fn turned(r: &Matrix3<f64>, moments: &Vector3<f64>) -> Self {
        let [a, b, c] = [moments.x, moments.y, moments.z];
        let [x, y, z] = [
            [a * r.m11, b * r.m12, c * r.m13],
            [a * r.m21, b * r.m22, c * r.m23],
            [a * r.m31, b * r.m32, c * r.m33],
        ];
        Self {
            xx: x[0] * r.m11 + x[1] * r.m12 + x[2] * r.m13,
            xy: x[0] * r.m21 + x[1] * r.m22 + x[2] * r.m23,
            xz: x[0] * r.m31 + x[1] * r.m32 + x[2] * r.m33,
            yy: y[0] * r.m21 + y[1] * r.m22 + y[2] * r.m23,
            yz: y[0] * r.m31 + y[1] * r.m32 + y[2] * r.m33,
            zz: z[0] * r.m31 + z[1] * r.m32 + z[2] * r.m33,
        }
    }

    /// Inertia of a point mass at `p` about the origin: `m (p' p I - p p')`.
    #[inline(always)]
    pub fn point_mass(mass: f64, p: &Vector3<f64>) -> Self {
        let m = p * mass;
        Self {
            xx: m.y * p.y + m.z * p.z,
            xy: -m.x * p.y,
            xz: -m.x * p.z,
            yy: m.x * p.x + m.z * p.z,
            yz: -m.y * p.z,
            zz: m.x * p.x + m.y * p.y,
        }
    }

    #[inline(always)]
    pub fn add(&self, other: &Self) -> Self {
        Self {
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            xz: self.xz + other.xz,
            yy: self.yy + other.yy,
            yz: self.yz + other.yz,
            zz: self.zz + other.zz,
        }
    }

    #[inline(always)]
    pub fn sub(&self, other: &Self) -> Self {
        self.add(&other.scaled(-1.0))
    }

    #[inline(always)]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            xx: self.xx * factor,
            xy: self.xy * factor,
            xz: self.xz * factor,
            yy: self.yy * factor,
            yz: self.yz * factor,
            zz: self.zz * factor,
        }
    }

    #[inline(always)]
    pub fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(
            self.xx * v.x + self.xy * v.y + self.xz * v.z,
            self.xy * v.x + self.yy * v.y + self.yz * v.z,
            self.xz * v.x + self.yz * v.y + self.zz * v.z,
        )
    }

    /// The product with a symmetric matrix that commutes with this one, and so symmetric itself.
    #[inline(always)]
    pub fn times_commuting(&self, b: &Self) -> Self {
        Self {
            xx: self.xx * b.xx + self.xy * b.xy + self.xz * b.xz,
            xy: self.xx * b.xy + self.xy * b.yy + self.xz * b.yz,
            xz: self.xx * b.xz + self.xy * b.yz + self.xz * b.zz,
            yy: self.xy * b.xy + self.yy * b.yy + self.yz * b.yz,
            yz: self.xy * b.xz + self.yy * b.yz + self.yz * b.zz,
            zz: self.xz * b.xz + self.yz * b.yz + self.zz * b.zz,
        }
    }

    #[inline(always)]
    pub fn times_matrix(&self, b: &Matrix3<f64>) -> Matrix3<f64> {
        let row = |x: f64, y: f64, z: f64| {
            [
                x * b.m11 + y * b.m21 + z * b.m31,
                x * b.m12 + y * b.m22 + z * b.m32,
                x * b.m13 + y * b.m23 + z * b.m33,
            ]
        };
        let [x, y, z] = [
            row(self.xx, self.xy, self.xz),
            row(self.xy, self.yy, self.yz),
            row(self.xz, self.yz, self.zz),
        ];
        Matrix3::new(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2])
    }

    /// `A' B` of matrices whose product is symmetric.
    #[inline(always)]
    pub fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Self {
        Self {
            xx: a.m11 * b.m11 + a.m21 * b.m21 + a.m31 * b.m31,
            xy: a.m11 * b.m12 + a.m21 * b.m22 + a.m31 * b.m32,
            xz: a.m11 * b.m13 + a.m21 * b.m23 + a.m31 * b.m33,
            yy: a.m12 * b.m12 + a.m22 * b.m22 + a.m32 * b.m32,
            yz: a.m12 * b.m13 + a.m22 * b.m23 + a.m32 * b.m33,
            zz: a.m13 * b.m13 + a.m23 * b.m23 + a.m33 * b.m33,
        }
    }

    /// The inverse, by cofactors; entries are not finite where there is none.
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let xx = self.yy * self.zz - self.yz * self.yz;
        let xy = self.xz * self.yz - self.xy * self.zz;
        let xz = self.xy * self.yz - self.xz * self.yy;
        let determinant = self.xx * xx + self.xy * xy + self.xz * xz;
        let cofactors = Self {
            xx,
            xy,
            xz,
            yy: self.xx * self.zz - self.xz * self.xz,
            yz: self.xy * self.xz - self.xx * self.yz,
            zz: self.xx * self.yy - self.xy * self.xy,
        };
        cofactors.scaled(1.0 / determinant)
    }

    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(
            self.xx, self.xy, self.xz, self.xy, self.yy, self.yz, self.xz, self.yz, self.zz,
        )
    }
}

#[inline(always)]
pub(super) fn times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        a.m11 * v.x + a.m12 * v.y + a.m13 * v.z,
        a.m21 * v.x + a.m22 * v.y + a.m23 * v.z,
        a.m31 * v.x + a.m32 * v.y + a.m33 * v.z,
    )
}

/// `A' v`.
#[inline(always)]
pub(super) fn transpose_times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        a.m11 * v.x + a.m21 * v.y + a.m31 * v.z,
        a.m12 * v.x + a.m22 * v.y + a.m32 * v.z,
        a.m13 * v.x + a.m23 * v.y + a.m33 * v.z,
    )
}

/// `r x M`, column by column.
#[inline(always)]
pub(super) fn cross_symmetric(r: &Vector3<f64>, m: &Symmetric) -> Matrix3<f64> {
    Matrix3::new(
        r.y * m.xz - r.z * m.xy,
        r.y * m.yz - r.z * m.yy,
        r.y * m.zz - r.z * m.yz,
        r.z * m.xx - r.x * m.xz,
        r.z * m.xy - r.x * m.yz,
        r.z * m.xz - r.x * m.zz,
        r.x * m.xy - r.y * m.xx,
        r.x * m.yy - r.y * m.xy,
        r.x * m.yz - r.y * m.xz,
    )
}

/// `A [r]x`: row by row, `A_i x r`.
#[inline(always)]
pub(super) fn times_cross(a: &Matrix3<f64>, r: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(
        a.m12 * r.z - a.m13 * r.y,
        a.m13 * r.x - a.m11 * r.z,
        a.m11 * r.y - a.m12 * r.x,
        a.m22 * r.z - a.m23 * r.y,
        a.m23 * r.x - a.m21 * r.z,
        a.m21 * r.y - a.m22 * r.x,
        a.m32 * r.z - a.m33 * r.y,
        a.m33 * r.x - a.m31 * r.z,
        a.m31 * r.y - a.m32 * r.x,
    )
}

/// `A + A'`.
#[inline(always)]
pub(super) fn twice_symmetric_part(a: &Matrix3<f64>) -> Symmetric {
    Symmetric {
        xx: a.m11 + a.m11,
        xy: a.m12 + a.m21,
        xz: a.m13 + a.m31,
        yy: a.m22 + a.m22,
        yz: a.m23 + a.m32,
        zz: a.m33 + a.m33,
    }
}

/// The upper half of a matrix that is symmetric.
#[inline(always)]
pub(super) fn symmetric(a: &Matrix3<f64>) -> Symmetric {
    Symmetric {
        xx: a.m11,
        xy: a.m12,
        xz: a.m13,
        yy: a.m22,
        yz: a.m23,
        zz: a.m33,
    }
}
