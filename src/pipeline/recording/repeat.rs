//! What of a robot's errors does not repeat.

use super::Compared;

/// Pulls are nearly the same where none differs by more than this share of the widest range of a servo.
const NEARLY: f64 = 0.01;
/// Rows between two that count as at other times.
const APART: usize = 8;
/// Rows that are compared with each other at most.
const MOST_ROWS: usize = 5000;

/// The share of the first marker's residuals that does not repeat (m); none where no pulls come again.
pub(super) fn repeatability(compared: &Compared) -> Option<f64> {
    let pulls = &compared.file.recording.pulls;
    let range = |servo: usize| {
        let all = pulls.iter().map(|row| row[servo]);
        all.clone().fold(f64::MIN, f64::max) - all.fold(f64::MAX, f64::min)
    };
    let nearly = NEARLY * (0..pulls.first()?.len()).map(range).fold(0.0, f64::max);
    let (mut sum, mut count) = (0.0, 0);
    for a in 0..pulls.len().min(MOST_ROWS) {
        for b in a + APART..pulls.len().min(MOST_ROWS) {
            let mut pairs = pulls[a].iter().zip(&pulls[b]);
            let residuals = [a, b].map(|row| compared.after.markers[row].iter().flatten().next());
            if let [Some(one), Some(other)] = residuals
                && pairs.all(|(p, q)| (p - q).abs() < nearly)
            {
                sum += (one - other).norm_squared();
                count += 1;
            }
        }
    }
    (count > 0).then(|| (0.5 * sum / f64::from(count)).sqrt())
}
