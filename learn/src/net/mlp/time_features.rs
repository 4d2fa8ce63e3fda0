//! What a network sees of the flow time.

use serde::{Deserialize, Serialize};

/// Features `(E)` of a flow time `t`: `E/2` cosines, then `E/2` sines, of as many angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TimeFeatures {
    /// The angles are `t 10^(-4 k / K)`, `k = 0, ..., K - 1` with `K = E/2` (Vaswani et al., NeurIPS 2017; the paper's).
    #[default]
    Plain,
    /// Half of the angles are [`Plain`](Self::Plain), with half as many for `K`; the others are `2 s 40^(-k / K)` of the logarithm
    /// `s = -ln(1 - t + 0.001)` of what is left of the noise, which tells the last hundredths of the flow apart. There the velocity
    /// across the surface grows with `1 / (1 - t)`, and `t` itself hardly changes.
    Late,
}

impl TimeFeatures {
    /// Fills `features` with those of the flow times, `(B, E)` for an `embedding` E.
    pub fn fill(self, times: &[f32], embedding: usize, features: &mut Vec<f32>) {
        let half = embedding / 2;
        let late = match self {
            Self::Plain => 0,
            Self::Late => half / 2,
        };
        let plain = half - late;
        features.clear();
        for &time in times {
            let time = f64::from(time);
            let s = -(1.0 - time + FLOOR).ln();
            let angle = |k: usize| match k.checked_sub(plain) {
                None => time * 1e4f64.powf(-(k as f64) / plain as f64),
                Some(k) => 2.0 * s * 40f64.powf(-(k as f64) / late as f64),
            };
            features.extend((0..half).map(|k| angle(k).cos() as f32));
            features.extend((0..half).map(|k| angle(k).sin() as f32));
        }
    }

    /// All of them.
    pub const ALL: [Self; 2] = [Self::Plain, Self::Late];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Late => "late",
        }
    }

    /// Whether files leave them out.
    pub(super) fn is_plain(&self) -> bool {
        *self == Self::Plain
    }
}

/// Noise that is added before its logarithm is taken, a third of the least that training has ([`LATE_TIMES`](crate::flow::LATE_TIMES)).
const FLOOR: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_features_tell_the_last_hundredths_apart_and_plain_ones_do_not() {
        let distance = |kind: TimeFeatures, [a, b]: [f32; 2]| {
            let mut features = Vec::new();
            kind.fill(&[a, b], 64, &mut features);
            let (a, b) = features.split_at(64);
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b) * (a - b))
                .sum::<f32>()
                .sqrt()
        };
        let last = [0.98, 0.995];
        assert!(distance(TimeFeatures::Plain, last) < 0.03);
        assert!(distance(TimeFeatures::Late, last) > 1.0);
        // Early in the flow both do.
        assert!(distance(TimeFeatures::Plain, [0.2, 0.6]) > 0.3);
        assert!(distance(TimeFeatures::Late, [0.2, 0.6]) > 0.3);
    }
}
