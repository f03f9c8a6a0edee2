//! Flags of tracing the explicit fibers of a cloth.

use super::build::{ResumeArgs, ShardArgs};
use clap::Args;
use std::path::PathBuf;

/// `plywave twin`.
#[derive(Debug, Args)]
pub struct TwinArgs {
    /// Cloth spec. Of its models, only their yarn specs are used.
    pub spec: PathBuf,
    /// Twin to write [default: the spec's name with .pwx].
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Views as TILT or TILT:AZIMUTH [degrees]: the light's tilt from the face's normal, above 90 from the
    /// back, and its azimuth from the weft (across the warp) towards the warp (along it) [default: 0, 30:0,
    /// 60:0, 75:0, 30:90, 60:90, 45:45, 60:45].
    #[arg(long, value_name = "T:A", num_args = 1, value_delimiter = ',', allow_negative_numbers = true, value_parser = view)]
    pub views: Vec<[f64; 2]>,
    /// Absorption coefficients [1/um]; WARP:WEFT where they differ.
    #[arg(long, value_name = "SIGMA", num_args = 1, value_delimiter = ',', allow_negative_numbers = true, default_value = "0,0.003,0.01", value_parser = sigma)]
    pub sigma: Vec<[f64; 2]>,
    /// Paths per view.
    #[arg(long, value_name = "N", default_value_t = 500_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub paths: u64,
    /// Seed of the packing and of the paths.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Repeats to trace along the weft and along the warp [default: the fewest that keep the pitches of plies
    /// and fibers within 10 %, or fewer where memory is short].
    #[arg(long, value_name = "NX,NY", num_args = 1, value_parser = repeats)]
    pub repeats: Option<[u32; 2]>,
    /// Points around a round fiber; outlines with dents have more [default: 24]. The rings along
    /// the fibers become closer in proportion.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(8..=512))]
    pub points: Option<u32>,
    /// What to do with shards of an earlier run.
    #[command(flatten)]
    pub resume: ResumeArgs,
    /// Shares of the run.
    #[command(flatten)]
    pub shards: ShardArgs,
}

/// Two numbers with `between` them, or one with its fallback.
fn pair(text: &str, between: char, fallback: impl Fn(f64) -> Option<f64>) -> Option<[f64; 2]> {
    let number = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    match text.split_once(between) {
        Some((a, b)) => Some([number(a)?, number(b)?]),
        None => number(text).and_then(|a| Some([a, fallback(a)?])),
    }
}

pub fn view(text: &str) -> Result<[f64; 2], String> {
    pair(text, ':', |_| Some(0.0))
        .filter(|[tilt, azimuth]| (0.0..=180.0).contains(tilt) && (tilt - 90.0).abs() >= 0.1 && azimuth.abs() <= 360.0)
        .ok_or(
            "give TILT or TILT:AZIMUTH in degrees: a tilt from 0 to 180 but not 90, an azimuth from -360 to 360".into(),
        )
}

fn sigma(text: &str) -> Result<[f64; 2], String> {
    pair(text, ':', Some)
        .filter(|pair| pair.iter().all(|s| (0.0..=1e3).contains(s)))
        .ok_or("give SIGMA or WARP:WEFT, from 0 to 1000 per um".into())
}

fn repeats(text: &str) -> Result<[u32; 2], String> {
    pair(text, ',', |_| None)
        .filter(|pair| pair.iter().all(|n| (1.0..=1000.0).contains(n) && n.fract() == 0.0))
        .map(|pair| pair.map(|n| n as u32))
        .ok_or("give NX,NY, whole numbers from 1 to 1000".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_read() {
        assert_eq!(view("60:45"), Ok([60.0, 45.0]));
        assert_eq!(view("120"), Ok([120.0, 0.0]));
        assert_eq!(sigma("0.01"), Ok([0.01; 2]));
        assert_eq!(sigma("0.01:0"), Ok([0.01, 0.0]));
        assert_eq!(repeats("2,3"), Ok([2, 3]));
        assert!(["90", "181", "a", "1:b", "-3", "nan", "10:400"].iter().all(|bad| view(bad).is_err()));
        assert!(["-1", "x", "0:1e9", ""].iter().all(|bad| sigma(bad).is_err()));
        assert!(["2", "0,1", "1.5,2", "1,2,3"].iter().all(|bad| repeats(bad).is_err()));
    }
}
