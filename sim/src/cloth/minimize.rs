//! Minimization of smooth functions of many variables: L-BFGS (Nocedal and Wright 2006, algorithm 7.5).

/// Steps that are remembered.
const MEMORY: usize = 20;
/// Share of the expected decrease that a step must bring (Armijo's condition).
const DECREASE: f64 = 1e-4;

/// How a minimization ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct Minimum {
    /// Largest component of the gradient.
    pub slope: f64,
    /// Steps.
    pub steps: usize,
}

/// Minimizes from `x`; `function` fills the gradient and returns the value. Ends when no component of the
/// gradient is above `slope`, after `steps`, or when no step decreases the value. No variable moves by more
/// than `max_move` in a step.
pub(super) fn minimize(
    x: &mut [f64],
    slope: f64,
    steps: usize,
    max_move: f64,
    mut function: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> Minimum {
    let n = x.len();
    let mut gradient = vec![0.0; n];
    let mut value = function(x, &mut gradient);
    let mut memory: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
    let (mut trial, mut new_gradient) = (x.to_vec(), vec![0.0; n]);
    let mut failed = 0;
    for step in 0..steps {
        let largest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
        if largest <= slope {
            return Minimum { slope: largest, steps: step };
        }
        let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
        let mut alphas = vec![0.0; memory.len()];
        for (k, (s, y, per)) in memory.iter().enumerate().rev() {
            alphas[k] = per * dot(s, &direction);
            add(&mut direction, -alphas[k], y);
        }
        if let Some((s, y, _)) = memory.last() {
            let scale = dot(s, y) / dot(y, y);
            direction.iter_mut().for_each(|d| *d *= scale);
        }
        for (k, (s, y, per)) in memory.iter().enumerate() {
            let beta = per * dot(y, &direction);
            add(&mut direction, alphas[k] - beta, s);
        }
        let mut downhill = dot(&direction, &gradient);
        if downhill >= 0.0 || downhill.is_nan() {
            direction = gradient.iter().map(|g| -g).collect();
            downhill = -dot(&gradient, &gradient);
            memory.clear();
        }
        let longest = direction.iter().fold(0.0f64, |m, d| m.max(d.abs()));
        let mut length = (max_move / longest).min(1.0);
        let mut found = false;
        for _ in 0..30 {
            for i in 0..n {
                trial[i] = x[i] + length * direction[i];
            }
            let new = function(&trial, &mut new_gradient);
            if new <= value + DECREASE * length * downhill + 1e-13 * value.abs() {
                let s: Vec<f64> = (0..n).map(|i| trial[i] - x[i]).collect();
                let y: Vec<f64> = (0..n).map(|i| new_gradient[i] - gradient[i]).collect();
                let sy = dot(&s, &y);
                if sy > 1e-10 * dot(&y, &y).sqrt() * dot(&s, &s).sqrt() {
                    if memory.len() == MEMORY {
                        memory.remove(0);
                    }
                    memory.push((s, y, 1.0 / sy));
                }
                x.copy_from_slice(&trial);
                std::mem::swap(&mut gradient, &mut new_gradient);
                value = new;
                found = true;
                break;
            }
            length *= 0.5;
        }
        if found {
            failed = 0;
        } else {
            failed += 1;
            memory.clear();
            if failed > 1 {
                let largest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
                return Minimum { slope: largest, steps: step };
            }
        }
    }
    let largest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
    Minimum { slope: largest, steps }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(a: &mut [f64], by: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += by * b);
}
