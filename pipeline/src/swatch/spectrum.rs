//! Sett and weave from the spectrum of a photograph.
//!
//! A weave of E ends and P picks per unit length repeats on a lattice; its light is a sum of waves of
//! the frequencies `u e + v p`: e and p are the waves of ends and of picks, nearly square to each other,
//! and u and v are whole multiples of one over the repeat. The draft says how strong each wave is, and
//! ridges of the yarns add waves of whole multiples. A hypothesis (weave, e, p) predicts the power at each
//! of its waves, over the power around it, as one and the square of the draft's amplitude times a factor of
//! the picture's own, one for the draft and one for the ridges of each yarn system. The logarithms are
//! compared, with a deviation of `POWER_SD`, beside those without a wave: a wave that should be there and
//! is not counts against the weave, and so does one that is stronger than its draft says. No single wave
//! counts more than `MAX_GAIN`. Only waves that the picture resolves are used. The back-lit picture may
//! have another scale and turn: lenses and stands are moved between pictures.

use super::geometry::SwatchGeometry;
use super::inputs::SwatchKnown;
use super::photo::Photo;
use plywave_textile::{Draft, NamedWeave};
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use std::f64::consts::{FRAC_PI_2, LN_2, PI, TAU};

/// Weaves that a picture is compared with.
const WEAVES: [&str; 13] = [
    "plain",
    "twill 2/1",
    "twill 2/1 S",
    "twill 2/2",
    "twill 2/2 S",
    "twill 3/1",
    "twill 3/1 S",
    "satin 5/2",
    "satin 5/3",
    "satin 8/3",
    "satin 8/5",
    "hopsack 2/2",
    "rib 2/2",
];
/// Threads per centimeter that are looked for, and the prior: means and standard deviation of their
/// logarithms, of cloths from denim to linings.
const PER_CM: [f64; 2] = [5.0, 130.0];
const USUAL_PER_CM: [f64; 2] = [36.0, 25.0];
const PRIOR_SD: f64 = 0.5;
/// Relative deviation of threads per centimeter that the user gives.
const GIVEN_SD: f64 = 0.03;
/// Largest turn of the yarns from the axes of the picture, and of the ends from square to the picks [rad].
const MAX_TURN: f64 = 0.12;
/// Deviations of those turns: a swatch is laid by its threads, and finishing leaves cloth skewed.
const TURN_SD: f64 = 0.03;
const SKEW_SD: f64 = 0.03;
/// Scales rho of the power of waves over the power around them.
const RHOS: [f64; 9] = [10.0, 32.0, 100.0, 320.0, 1e3, 3.2e3, 1e4, 3.2e4, 1e5];
/// Deviation of the logarithm of a wave's power, and the largest gain or loss of a wave. Chosen on pictures
/// of known weaves.
const POWER_SD: f64 = 1.5;
const MAX_GAIN: f64 = 8.0;
/// Deviation of the logarithm of the scale of the back-lit picture.
const SCALE_SD: f64 = 0.08;
/// Amplitude of waves that a draft's repeat allows and its crossings lack: yarns are no checks.
const LEAST_AMPLITUDE: f64 = 0.05;
/// Mean of the greatest of nine exponential numbers.
const NINE: f64 = 2.83;
/// Power that the strongest wave leaks to others, over its own.
const LEAK: f32 = 1e-3;
/// By which log-likelihoods are divided: waves of one cloth rise and fall together.
const TEMPER: f64 = 2.0;
/// Peaks that hypotheses start from, and setts of the front picture that are tried with both.
const PEAKS: usize = 10;
const STARTS: usize = 24;
/// Pixels over which the light is made even.
const EVEN_PX: usize = 33;

/// A weave with its sett as the picture shows it.
#[derive(Clone, Debug)]
pub struct WeaveGuess {
    /// The weave.
    pub weave: NamedWeave,
    /// Whether the warp runs across the picture in place of up.
    pub is_across: bool,
    /// Ends and picks per centimeter.
    pub per_cm: [f64; 2],
    /// Standard deviations of their logarithms.
    pub sd: [f64; 2],
    /// Turn of the yarns from the axes of the picture [rad].
    pub turn_rad: f64,
    /// Posterior probability among the weaves that were compared.
    pub probability: f64,
    /// Log-likelihood over that of no weave at all, tempered, with the prior of sett, turns and scale.
    pub score: f64,
}

/// The power of a picture over the power around it.
struct Spectrum {
    side: usize,
    /// `[fy][fx]`.
    power: Vec<f32>,
    /// Cycles per centimeter of a bin.
    step: f64,
    /// Largest frequency that is used [1/cm].
    most: f64,
}

impl Spectrum {
    fn new(photo: &Photo, geometry: &SwatchGeometry) -> Spectrum {
        let side = photo.size[0].min(photo.size[1]).min(1024);
        let [left, top] = photo.size.map(|of| (of - side) / 2);
        let values = photo.luminances();
        let crop: Vec<f64> = (0..side * side)
            .map(|i| f64::from(values[(top + i / side) * photo.size[0] + left + i % side]).max(1e-5).ln())
            .collect();
        let even = local_means(&crop, side, EVEN_PX);
        let window = |at: usize| 0.5 - 0.5 * (TAU * (at as f64 + 0.5) / side as f64).cos();
        let mut waves: Vec<Complex<f64>> = (0..side * side)
            .map(|i| Complex::new((crop[i] - even[i]).clamp(-2.0, 2.0) * window(i % side) * window(i / side), 0.0))
            .collect();
        transform(&mut waves, side);
        let raw: Vec<f32> = waves.iter().map(|w| w.norm_sqr() as f32).collect();
        let around = tile_medians(&raw, side);
        // The median of an exponential number is ln 2 of its mean.
        let power: Vec<f32> = raw.iter().zip(around).map(|(p, m)| p * std::f32::consts::LN_2 / m.max(1e-20)).collect();
        // Strong waves leak into their combinations, since light is no sum of waves.
        let floor = 1.0 + LEAK * power.iter().fold(0.0, |most: f32, p| most.max(*p));
        let power = power.into_iter().map(|p| p / floor).collect();
        let pixel_cm = 0.1 * geometry.seen_mm() / photo.size[0] as f64;
        let step = 1.0 / (side as f64 * pixel_cm);
        Spectrum { side, power, step, most: 0.47 / pixel_cm }
    }

    /// Power near a frequency [1/cm], the greatest of 3 x 3 bins over its mean without a wave; with `is_fine`
    /// their mean, weighed as the window spreads a wave's power, which is greatest at the wave. `None` beyond
    /// what is resolved.
    fn near(&self, [x, y]: [f64; 2], is_fine: bool) -> Option<f64> {
        if x.abs() > self.most || y.abs() > self.most || x.hypot(y) < 8.0 * self.step {
            return None;
        }
        let side = self.side as i64;
        // The power of a Hann window is 1/4 a bin beside, nearly as this.
        let spread = |f: f64| {
            let middle = (f / self.step).round();
            (middle as i64, [-1.0, 0.0, 1.0].map(|k| (-2.0 * LN_2 * (middle + k - f / self.step).powi(2)).exp()))
        };
        let ((i, across), (j, down)) = (spread(x), spread(y));
        let (mut sum, mut weights, mut most) = (0.0, 0.0, 0.0f64);
        for (b, v) in down.iter().enumerate() {
            let row = (j + b as i64 - 1).rem_euclid(side) * side;
            for (a, u) in across.iter().enumerate() {
                let power = f64::from(self.power[(row + (i + a as i64 - 1).rem_euclid(side)) as usize]);
                sum += u * v * power;
                weights += u * v;
                most = most.max(power);
            }
        }
        Some(if is_fine { sum / weights } else { most / NINE })
    }

    /// Frequencies of the strongest peaks [1/cm], the strongest first; fx >= 0.
    fn peaks(&self) -> Vec<[f64; 2]> {
        let side = self.side as i64;
        let at = |i: i64, j: i64| self.power[(j.rem_euclid(side) * side + i.rem_euclid(side)) as usize];
        let most = (self.most / self.step) as i64;
        let mut all = Vec::new();
        for j in -most..=most {
            for i in 0..=most {
                let here = at(i, j);
                if i * i + j * j < 64 || here < 12.0 || (i == 0 && j < 0) {
                    continue;
                }
                if (-2..=2).all(|a| (-2..=2).all(|b| at(i + a, j + b) <= here)) {
                    // The middle of the peak's power.
                    let (mut sum, mut middle) = (0.0, [0.0; 2]);
                    for (a, b) in (-1..=1).flat_map(|a| (-1..=1).map(move |b| (a, b))) {
                        let p = f64::from(at(i + a, j + b));
                        sum += p;
                        middle[0] += p * (i + a) as f64;
                        middle[1] += p * (j + b) as f64;
                    }
                    all.push((middle.map(|m| m / sum * self.step), sum));
                }
            }
        }
        all.sort_by(|a: &([f64; 2], f64), b| b.1.total_cmp(&a.1));
        all.into_iter().take(PEAKS).map(|peak| peak.0).collect()
    }
}

/// Means of a square of `around` pixels about each pixel, cut at the edges.
fn local_means(values: &[f64], side: usize, around: usize) -> Vec<f64> {
    let half = around / 2;
    let mut across = vec![0.0; values.len()];
    let pass = |from: &[f64], to: &mut [f64], at: &dyn Fn(usize, usize) -> usize| {
        for line in 0..side {
            let mut sums = vec![0.0; side + 1];
            (0..side).for_each(|k| sums[k + 1] = sums[k] + from[at(line, k)]);
            for k in 0..side {
                let (low, high) = (k.saturating_sub(half), (k + half + 1).min(side));
                to[at(line, k)] = (sums[high] - sums[low]) / (high - low) as f64;
            }
        }
    };
    pass(values, &mut across, &|line, k| line * side + k);
    let mut down = vec![0.0; values.len()];
    pass(&across, &mut down, &|line, k| k * side + line);
    down
}

/// Fourier transform of a square picture, in place.
fn transform(waves: &mut [Complex<f64>], side: usize) {
    let plan = FftPlanner::new().plan_fft_forward(side);
    for _ in 0..2 {
        plan.process(waves);
        for i in 0..side {
            for j in 0..i {
                waves.swap(i * side + j, j * side + i);
            }
        }
    }
}

/// Medians of the power of tiles of 16 x 16 bins, between their middles.
fn tile_medians(power: &[f32], side: usize) -> Vec<f32> {
    const TILE: usize = 16;
    let tiles = side.div_ceil(TILE);
    let median = |tile: usize| {
        let (left, top) = (tile % tiles * TILE, tile / tiles * TILE);
        let mut all: Vec<f32> = (top..(top + TILE).min(side))
            .flat_map(|y| (left..(left + TILE).min(side)).map(move |x| y * side + x))
            .map(|i| power[i])
            .collect();
        all.sort_by(f32::total_cmp);
        all[all.len() / 2].max(1e-20).ln()
    };
    let medians: Vec<f32> = (0..tiles * tiles).map(median).collect();
    let place = |at: usize| {
        let x = (at as f32 + 0.5) / TILE as f32 - 0.5 + tiles as f32;
        let low = x.floor();
        ([low as usize % tiles, (low as usize + 1) % tiles], x - low)
    };
    let one = |i: usize| {
        let (([x0, x1], s), ([y0, y1], t)) = (place(i % side), place(i / side));
        let row = |y: usize| (1.0 - s) * medians[y * tiles + x0] + s * medians[y * tiles + x1];
        ((1.0 - t) * row(y0) + t * row(y1)).exp()
    };
    (0..side * side).map(one).collect()
}

/// What makes a wave: the draft, or the ridges of ends or of picks. Each kind has a scale of its own.
const KINDS: usize = 3;

/// A wave of a weave: multiples (u, v) of ends and picks, and the square of its amplitude over that of the
/// strongest of its kind.
#[derive(Clone, Copy)]
struct Wave {
    uv: [f64; 2],
    kind: usize,
    squared: f64,
}

/// Waves of a draft up to 2 threads, half of the plane.
fn waves_of(draft: &Draft) -> Vec<Wave> {
    let (ends, picks) = (draft.ends(), draft.picks());
    let amplitude = |a: i64, b: i64| -> f64 {
        let mut sum = Complex::new(0.0, 0.0);
        for pick in 0..picks {
            for end in (0..ends).filter(|end| draft.up(pick, *end)) {
                let phase = TAU * (a as f64 * end as f64 / ends as f64 + b as f64 * pick as f64 / picks as f64);
                sum += Complex::new(phase.cos(), -phase.sin());
            }
        }
        sum.norm() / (ends * picks) as f64
    };
    // Steps by which the draft repeats; a wave that they change cannot be there.
    let repeats = |step: &(usize, usize)| {
        let same =
            |pick: usize, end: usize| draft.up(pick, end) == draft.up((pick + step.1) % picks, (end + step.0) % ends);
        (0..picks).all(|pick| (0..ends).all(|end| same(pick, end)))
    };
    let steps: Vec<(usize, usize)> = (0..ends).flat_map(|e| (0..picks).map(move |p| (e, p))).filter(repeats).collect();
    let is_there = |a: i64, b: i64| {
        let turns = |(e, p): &(usize, usize)| a as f64 * *e as f64 / ends as f64 + b as f64 * *p as f64 / picks as f64;
        steps.iter().all(|step| (turns(step) - turns(step).round()).abs() < 1e-6)
    };
    let mut all = Vec::new();
    let (most_a, most_b) = (ends as i64 * 3 / 2, picks as i64 * 3 / 2);
    for a in 0..=most_a {
        for b in -most_b..=most_b {
            if (a, b) == (0, 0) || (a == 0 && b < 0) {
                continue;
            }
            let uv = [a as f64 / ends as f64, b as f64 / picks as f64];
            // Ridges of the yarns show in every weave.
            let kind = match (a % ends as i64, b % picks as i64) {
                (0, 0) if b == 0 => 1,
                (0, 0) if a == 0 => 2,
                (0, 0) => continue,
                _ => 0,
            };
            if !is_there(a, b) {
                continue;
            }
            let of_draft = if kind > 0 { 1.0 } else { amplitude(a, b).max(LEAST_AMPLITUDE) };
            // The forms of floats are smooth.
            let smooth = (-0.5 * (uv[0] * uv[0] + uv[1] * uv[1]) / 0.49).exp();
            all.push(Wave { uv, kind, squared: (of_draft * smooth).powi(2) });
        }
    }
    for kind in 0..KINDS {
        let most = all.iter().filter(|w| w.kind == kind).map(|w| w.squared).fold(0.0, f64::max);
        all.retain(|w| w.kind != kind || w.squared > 3e-3 * most);
        all.iter_mut().filter(|w| w.kind == kind).for_each(|w| w.squared /= most);
    }
    all
}

/// A sett in both pictures.
#[derive(Clone, Copy, Debug)]
struct Sett {
    /// Ends and picks per centimeter.
    per_cm: [f64; 2],
    /// Turn of the yarns from the axes of the front picture, and of the ends from square to the picks [rad].
    turns_rad: [f64; 2],
    /// Logarithm of the scale of the back-lit picture, and its turn from the front one [rad].
    back: [f64; 2],
}

impl Sett {
    /// The sett's six numbers.
    fn numbers(&mut self) -> [&mut f64; 6] {
        let ([e, p], [turn, skew], [scale, back]) = (&mut self.per_cm, &mut self.turns_rad, &mut self.back);
        [e, p, turn, skew, scale, back]
    }

    /// The waves of ends and of picks in picture k [1/cm]; y points down.
    fn lattice(&self, k: usize, is_across: bool) -> [[f64; 2]; 2] {
        let (scale, turn) = if k == 1 { (self.back[0].exp(), self.back[1]) } else { (1.0, 0.0) };
        let quarter = if is_across { FRAC_PI_2 } else { 0.0 };
        let wave = |of: f64, angle: f64| [scale * of * angle.cos(), -scale * of * angle.sin()];
        let [middle, half] = [self.turns_rad[0] + turn + quarter, 0.5 * self.turns_rad[1]];
        [wave(self.per_cm[0], middle + half), wave(self.per_cm[1], middle - half + FRAC_PI_2)]
    }

    /// The sett of the front picture with these waves of ends and picks, if it is one.
    fn of_lattice([ends, picks]: [[f64; 2]; 2], is_across: bool, back: [f64; 2]) -> Option<Sett> {
        let quarter = if is_across { FRAC_PI_2 } else { 0.0 };
        // A wave and its opposite are one.
        let off = |of: [f64; 2], from: f64| {
            let angle = (-of[1]).atan2(of[0]) - from;
            angle - PI * (angle / PI).round()
        };
        let [a, b] = [off(ends, quarter), off(picks, quarter + FRAC_PI_2)];
        let (per_cm, turns_rad) = ([ends, picks].map(|of| of[0].hypot(of[1])), [0.5 * (a + b), a - b]);
        let is_sett = per_cm.iter().all(|of| (PER_CM[0]..=PER_CM[1]).contains(of))
            && turns_rad[0].abs() < MAX_TURN
            && turns_rad[1].abs() < MAX_TURN;
        is_sett.then_some(Sett { per_cm, turns_rad, back })
    }

    /// Logarithm of the prior of its turns and scale.
    fn prior(&self) -> f64 {
        let off =
            [self.turns_rad[0] / TURN_SD, self.turns_rad[1] / SKEW_SD, self.back[0] / SCALE_SD, self.back[1] / TURN_SD];
        -0.5 * off.iter().map(|off| off * off).sum::<f64>()
    }
}

/// Frequency of a wave of a lattice [1/cm].
fn frequency(uv: [f64; 2], [ends, picks]: [[f64; 2]; 2]) -> [f64; 2] {
    [0, 1].map(|k| uv[0] * ends[k] + uv[1] * picks[k])
}

/// Log-likelihood of a hypothesis over that of no weave.
fn evidence(spectra: &[Spectrum], waves: &[Wave], sett: &Sett, (is_across, is_fine): (bool, bool)) -> f64 {
    let of_spectrum = |(k, spectrum): (usize, &Spectrum)| {
        let lattice = sett.lattice(k, is_across);
        let seen: Vec<(usize, f64, f64)> = waves
            .iter()
            .filter_map(|w| {
                let power = spectrum.near(frequency(w.uv, lattice), is_fine)?;
                Some((w.kind, w.squared, power.max(1e-3).ln()))
            })
            .collect();
        let off = |ln: f64| (0.5 * (ln / POWER_SD).powi(2)).min(MAX_GAIN);
        let gain = |rho: f64, squared: f64, ln: f64| off(ln.max(0.0)) - off(ln - (1.0 + rho * squared).ln());
        let of_kind = |kind: usize| {
            let of_rho = |rho: &f64| -> f64 {
                seen.iter().filter(|of| of.0 == kind).map(|(_, squared, ln)| gain(*rho, *squared, *ln)).sum()
            };
            RHOS.iter().map(of_rho).fold(0.0, f64::max)
        };
        (0..KINDS).map(of_kind).sum::<f64>()
    };
    spectra.iter().enumerate().map(of_spectrum).sum()
}

fn prior(known: &SwatchKnown, per_cm: [f64; 2]) -> f64 {
    let of = |k: usize| match known.per_cm[k] {
        Some(given) => ((per_cm[k] / given).ln() / GIVEN_SD).powi(2),
        None => ((per_cm[k] / USUAL_PER_CM[k]).ln() / PRIOR_SD).powi(2),
    };
    -0.5 * (of(0) + of(1))
}

/// The weaves with their setts, the most probable first, from both pictures of a swatch.
pub fn guess_weaves(photos: [&Photo; 2], geometry: &SwatchGeometry, known: &SwatchKnown) -> Vec<WeaveGuess> {
    let spectra: Vec<Spectrum> = photos.iter().map(|photo| Spectrum::new(photo, geometry)).collect();
    let [peaks, of_back] = [0, 1].map(|k: usize| spectra[k].peaks());
    let backs = backs(&peaks, &of_back);
    let names: Vec<NamedWeave> = match &known.weave {
        Some(weave) => vec![weave.clone()],
        None => WEAVES.iter().filter_map(|name| name.parse().ok()).collect(),
    };
    let mut guesses: Vec<WeaveGuess> = Vec::new();
    for weave in names {
        let waves = waves_of(&weave.draft());
        for is_across in [false, true] {
            guesses.extend(best_sett(&spectra, (&peaks, &backs), known, (&weave, &waves), is_across));
        }
    }
    let most = guesses.iter().map(|g| g.score).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = guesses.iter().map(|g| (g.score - most).exp()).sum();
    for guess in &mut guesses {
        guess.probability = (guess.score - most).exp() / total;
    }
    guesses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    // Other weaves of the same way leave other setts open.
    let others = guesses.clone();
    for guess in &mut guesses {
        for k in 0..2 {
            let is_likely =
                |other: &&WeaveGuess| other.is_across == guess.is_across && other.probability > 0.2 * guess.probability;
            let of_way = others.iter().filter(is_likely);
            let (sum, total) = of_way.fold((0.0, guess.probability), |(sum, total), other| {
                let off = (other.per_cm[k] / guess.per_cm[k]).ln();
                (sum + other.probability * off * off, total + other.probability)
            });
            guess.sd[k] = guess.sd[k].hypot((sum / total).sqrt());
        }
    }
    guesses
}

/// Scales and turns of the back-lit picture that its strongest peaks may have.
fn backs(front: &[[f64; 2]], back: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut all = vec![[0.0; 2]];
    for f in front.iter().take(3) {
        for b in back.iter().take(3) {
            // As the angle of a complex number; y points down.
            let (dot, cross) = (f[0] * b[0] + f[1] * b[1], f[1] * b[0] - f[0] * b[1]);
            let (scale, turn) = ((b[0].hypot(b[1]) / f[0].hypot(f[1])).ln(), cross.atan2(dot));
            if scale.abs() < 3.0 * SCALE_SD && turn.abs() < 2.0 * TURN_SD {
                all.push([scale, turn]);
            }
        }
    }
    all
}

/// Setts that put two waves of a weave at two peaks.
fn starts(peaks: &[[f64; 2]], waves: &[Wave], known: &SwatchKnown, is_across: bool) -> Vec<Sett> {
    let strong: Vec<&Wave> = waves.iter().filter(|w| w.squared > 0.02).collect();
    let mut all = Vec::new();
    for (i, f) in peaks.iter().enumerate() {
        for g in &peaks[..i] {
            for (sign, w, v) in strong.iter().flat_map(|w| strong.iter().flat_map(move |v| [(1.0, w, v), (-1.0, w, v)]))
            {
                // f = w0 ends + w1 picks, g = v0 ends + v1 picks.
                let det = w.uv[0] * v.uv[1] - w.uv[1] * v.uv[0];
                if det.abs() < 1e-6 {
                    continue;
                }
                let ends = [0, 1].map(|k| (f[k] * v.uv[1] - sign * g[k] * w.uv[1]) / det);
                let picks = [0, 1].map(|k| (sign * g[k] * w.uv[0] - f[k] * v.uv[0]) / det);
                all.extend(Sett::of_lattice([ends, picks], is_across, [0.0; 2]));
            }
        }
    }
    // One peak alone tells one number; the other is as given or usual.
    let usual: [f64; 2] = std::array::from_fn(|k| known.per_cm[k].unwrap_or(USUAL_PER_CM[k]));
    all.push(Sett { per_cm: usual, turns_rad: [0.0; 2], back: [0.0; 2] });
    for f in peaks {
        let f = if is_across { [f[1], f[0]] } else { *f };
        for wave in &strong {
            let per_cm = [0, 1].map(|k: usize| match wave.uv[k].abs() {
                u if u > 1e-9 => f[k].abs() / u,
                _ => usual[k],
            });
            all.push(Sett { per_cm, turns_rad: [0.0; 2], back: [0.0; 2] });
        }
    }
    all.retain(|sett| {
        (0..2).all(|k| {
            (PER_CM[0]..=PER_CM[1]).contains(&sett.per_cm[k])
                && known.per_cm[k].is_none_or(|given| (sett.per_cm[k] / given).ln().abs() < 4.0 * GIVEN_SD)
        })
    });
    if let [Some(ends), Some(picks)] = known.per_cm {
        all.push(Sett { per_cm: [ends, picks], turns_rad: [0.0; 2], back: [0.0; 2] });
    }
    all
}

/// Climbs by single numbers, with steps that shrink.
fn climb(sett: &mut Sett, mut step: f64, score: impl Fn(&Sett) -> f64) {
    let mut best = score(sett);
    for _ in 0..6 {
        for _ in 0..2 {
            for axis in 0..6 {
                for sign in [-1.0, 1.0] {
                    let mut other = *sett;
                    let number = &mut *other.numbers()[axis];
                    *number = if axis < 2 { *number * (1.0 + sign * step) } else { *number + sign * step };
                    let value = score(&other);
                    if value > best {
                        (best, *sett) = (value, other);
                    }
                }
            }
        }
        step *= 0.6;
    }
}

/// The best sett of a weave, with what other setts leave open.
fn best_sett(
    spectra: &[Spectrum],
    (peaks, backs): (&[[f64; 2]], &[[f64; 2]]),
    known: &SwatchKnown,
    (weave, waves): (&NamedWeave, &[Wave]),
    is_across: bool,
) -> Option<WeaveGuess> {
    let score_of = |spectra: &[Spectrum], sett: &Sett, is_fine: bool| {
        evidence(spectra, waves, sett, (is_across, is_fine)) / TEMPER + prior(known, sett.per_cm) + sett.prior()
    };
    // The front picture alone, then with both.
    let setts = starts(peaks, waves, known, is_across);
    let mut found: Vec<(f64, Sett)> =
        setts.into_iter().map(|sett| (score_of(&spectra[..1], &sett, false), sett)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(STARTS);
    found = found
        .iter()
        .flat_map(|(_, sett)| backs.iter().map(|back| Sett { back: *back, ..*sett }))
        .map(|sett| (score_of(spectra, &sett, false), sett))
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(12);
    for (best, sett) in &mut found {
        climb(sett, 0.01, |sett| score_of(spectra, sett, false));
        *best = score_of(spectra, sett, false);
    }
    // The middles of the waves.
    for (_, sett) in &mut found {
        climb(sett, 2e-3, |sett| score_of(spectra, sett, true));
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (most, sett) = *found.first()?;
    let Sett { per_cm, turns_rad: [turn_rad, _], .. } = sett;
    // Resolution of a bin at the strongest waves, and the spread of other setts.
    let mut sd = [0.0; 2];
    for k in 0..2 {
        let strongest = waves
            .iter()
            .filter(|w| {
                w.uv[k].abs() > 1e-9
                    && spectra.iter().enumerate().any(|(picture, s)| {
                        s.near(frequency(w.uv, sett.lattice(picture, is_across)), false).is_some_and(|p| p > 4.0)
                    })
            })
            .map(|w| w.uv[k].abs())
            .fold(0.0, f64::max);
        let resolved = if strongest > 0.0 { 0.5 * spectra[0].step / (strongest * per_cm[k]) } else { PRIOR_SD };
        let (mut sum, mut weights) = (0.0, 0.0);
        for (value, other) in &found {
            let weight = (value - most).exp();
            weights += weight;
            sum += weight * (other.per_cm[k] / per_cm[k]).ln().powi(2);
        }
        let own = resolved.hypot((sum / weights).sqrt());
        sd[k] = known.per_cm[k].map_or(own.min(PRIOR_SD), |_| own.min(GIVEN_SD)).max(0.004);
    }
    Some(WeaveGuess { weave: weave.clone(), is_across, per_cm, sd, turn_rad, probability: 0.0, score: most })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of a draft: yarns as bright ridges, the warp brighter.
    fn picture(name: &str, per_cm: [f64; 2], side: usize, geometry: &SwatchGeometry) -> Photo {
        let draft = name.parse::<NamedWeave>().unwrap().draft();
        let photo = Photo { size: [side; 2], rgb: Vec::new(), is_saturated: vec![false; side * side] };
        let value = |i: usize| -> f32 {
            let noise = f64::from(((i as u32).wrapping_mul(2_654_435_761) >> 8) & 0xffff) / 65536.0 - 0.5;
            // A pixel is a mean over 4 x 4 points.
            let ridge = |k: usize| {
                let off = [k % 4, k / 4].map(|k| (k as f64 + 0.5) / 4.0 - 0.5);
                let [x, y] = photo.place_mm(geometry, [(i % side) as f64 + off[0], (i / side) as f64 + off[1]]);
                let [u, v] = [0.1 * x * per_cm[0], 0.1 * y * per_cm[1]];
                let (end, pick) =
                    (u.floor().rem_euclid(draft.ends() as f64), v.floor().rem_euclid(draft.picks() as f64));
                let up = draft.up(pick as usize, end as usize);
                if up { (PI * (u - u.floor())).sin() } else { 0.6 * (PI * (v - v.floor())).sin() }
            };
            let ridge = (0..16).map(ridge).sum::<f64>() / 16.0;
            (0.2 + 0.2 * ridge + 0.05 * noise) as f32
        };
        Photo { rgb: (0..side * side).map(|i| [value(i); 3]).collect(), ..photo }
    }

    #[test]
    fn weaves_and_setts_are_found() {
        let geometry = SwatchGeometry::default();
        for (name, per_cm) in [("twill 2/2", [26.0, 20.0]), ("plain", [18.0, 15.0]), ("twill 3/1 S", [27.0, 17.0])] {
            let photo = picture(name, per_cm, 512, &geometry);
            let guesses = guess_weaves([&photo, &photo], &geometry, &SwatchKnown::default());
            let best = &guesses[0];
            assert_eq!(best.weave, name.parse().unwrap(), "{guesses:?}");
            for k in 0..2 {
                assert!((best.per_cm[k] / per_cm[k] - 1.0).abs() < 0.005, "{name}: {best:?}");
            }
        }
    }
}
