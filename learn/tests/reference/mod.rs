//! The network of the paper once more: plain, slow, in f64, written from the equations alone.

use std::collections::HashMap;

use tdcr_learn::net::{MlpShape, TimeFeatures};

/// The paper's weight of the colours' error.
const COLOR_WEIGHT: f32 = 0.05;

/// Parameters by tensor name.
pub struct Reference {
    shape: MlpShape,
    tensors: HashMap<String, Vec<f64>>,
}

/// One cloud of a batch.
pub struct Cloud {
    pub time: f64,
    pub condition: Vec<f64>,
    pub points: Vec<Vec<f64>>,
    pub targets: Vec<Vec<f64>>,
}

fn silu(x: f64) -> f64 {
    x / (1.0 + (-x).exp())
}

impl Reference {
    pub fn new(shape: MlpShape, params: &[f64]) -> Self {
        let tensors = shape.tensors().into_iter();
        let tensors = tensors.map(|tensor| (tensor.name, params[tensor.range].to_vec()));
        Self {
            shape,
            tensors: tensors.collect(),
        }
    }

    fn tensor(&self, name: &str) -> &[f64] {
        &self.tensors[name]
    }

    /// `W x`, `W` row-major.
    fn product(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let rows = self.tensor(&format!("{name}.weight")).chunks(x.len());
        rows.map(|row| row.iter().zip(x).map(|(w, x)| w * x).sum())
            .collect()
    }

    fn linear(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let bias = self.tensor(&format!("{name}.bias"));
        self.product(name, x)
            .iter()
            .zip(bias)
            .map(|(y, b)| y + b)
            .collect()
    }

    fn embedding(&self, time: f64, condition: &[f64]) -> Vec<f64> {
        let half = self.shape.embedding / 2;
        // With late features, the second half of the angles is of the logarithm of the noise.
        let plain = match self.shape.time_features {
            TimeFeatures::Late => half - half / 2,
            _ => half,
        };
        let noise = (1.0 / (1.001 - time)).ln();
        let angle = |k: usize| match k < plain {
            true => time * (-(1e4f64.ln()) * k as f64 / plain as f64).exp(),
            false => 2.0 * noise / 40f64.powf((k - plain) as f64 / (half - plain) as f64),
        };
        let cosines = (0..half).map(|k| angle(k).cos());
        let features: Vec<f64> = cosines.chain((0..half).map(|k| angle(k).sin())).collect();
        let (time, condition) = (self.linear("time", &features), self.condition(condition));
        time.iter()
            .zip(&condition)
            .map(|(t, c)| silu(*t) + silu(*c))
            .collect()
    }

    /// The condition after its layer and its blocks.
    fn condition(&self, condition: &[f64]) -> Vec<f64> {
        let mut h = self.linear("condition", condition);
        for l in 0..self.shape.condition_blocks {
            let normed = self.norm(&format!("condition_blocks.{l}"), &h);
            let activated: Vec<f64> = normed.iter().map(|m| silu(*m)).collect();
            let residual = self.linear(&format!("condition_blocks.{l}.linear"), &activated);
            h = normed.iter().zip(residual).map(|(m, r)| m + r).collect();
        }
        h
    }

    /// LayerNorm of `h` with the weight and bias of a block's norm.
    fn norm(&self, block: &str, h: &[f64]) -> Vec<f64> {
        let mean = h.iter().sum::<f64>() / h.len() as f64;
        let variance = h.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / h.len() as f64;
        let weight = self.tensor(&format!("{block}.norm.weight"));
        let bias = self.tensor(&format!("{block}.norm.bias"));
        let affine = weight.iter().zip(bias);
        let rows = h.iter().zip(affine);
        rows.map(|(h, (w, b))| (h - mean) / (variance + 1e-5).sqrt() * w + b)
            .collect()
    }

    /// The point, then for each octave the sines of its position's three coordinates, then their cosines.
    fn inputs(&self, point: &[f64]) -> Vec<f64> {
        let mut inputs = point.to_vec();
        for octave in 0..self.shape.octaves {
            let angles =
                [0, 1, 2].map(|axis| 2f64.powi(octave as i32) * std::f64::consts::PI * point[axis]);
            inputs.extend(angles.map(f64::sin));
            inputs.extend(angles.map(f64::cos));
        }
        inputs
    }

    pub fn velocity(&self, time: f64, condition: &[f64], point: &[f64]) -> Vec<f64> {
        let width = self.shape.width;
        let e = self.embedding(time, condition);
        let shift = self.linear("shift", &e);
        let mut h: Vec<f64> = self
            .product("input", &self.inputs(point))
            .iter()
            .zip(shift)
            .map(|(x, s)| x + s)
            .collect();
        for l in 0..self.shape.depth - 1 {
            let norm = self.norm(&format!("blocks.{l}"), &h);
            let film = self.linear(&format!("blocks.{l}.film"), &e);
            let modulated: Vec<f64> = (0..width)
                .map(|k| norm[k] * (1.0 + film[k]) + film[width + k])
                .collect();
            let activated: Vec<f64> = modulated.iter().map(|m| silu(*m)).collect();
            let residual = self.linear(&format!("blocks.{l}.linear"), &activated);
            h = modulated.iter().zip(residual).map(|(m, r)| m + r).collect();
        }
        let activated: Vec<f64> = h.iter().map(|h| silu(*h)).collect();
        self.linear("output", &activated)
    }

    /// Mean squared velocity error over all components of positions, plus that of colours, weighted.
    pub fn loss(&self, clouds: &[Cloud]) -> f64 {
        let mut sum = 0.0;
        let mut components = 0;
        for cloud in clouds {
            for (point, target) in cloud.points.iter().zip(&cloud.targets) {
                let velocity = self.velocity(cloud.time, &cloud.condition, point);
                let errors = velocity.iter().zip(target).map(|(v, u)| (v - u).powi(2));
                let weights = [1.0, 1.0, 1.0]
                    .into_iter()
                    .chain([f64::from(COLOR_WEIGHT); 3]);
                sum += errors.zip(weights).map(|(e, w)| w * e).sum::<f64>();
                components += 3;
            }
        }
        sum / components as f64
    }
}

/// Gradient of the reference's loss by every parameter, by central differences.
pub fn loss_gradient(shape: MlpShape, params: &[f64], clouds: &[Cloud]) -> Vec<f64> {
    const STEP: f64 = 1e-5;
    let loss = |index: usize, step: f64| {
        let mut params = params.to_vec();
        params[index] += step;
        Reference::new(shape, &params).loss(clouds)
    };
    let derivative = |index| (loss(index, STEP) - loss(index, -STEP)) / (2.0 * STEP);
    (0..params.len()).map(derivative).collect()
}
