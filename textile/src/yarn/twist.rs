//! Twist as written on labels: turns per length, or a twist factor of the count.

use plywave::spec::{Handedness, Twist};
use std::str::FromStr;

/// Twist of a yarn: direction and turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YarnTwist {
    /// No twist.
    None,
    /// Turns per meter.
    PerMeter(Handedness, f64),
    /// Twist factor alpha of the tex system: turns per meter times the square root of the count in tex.
    Factor(Handedness, f64),
}

/// Factor of the tex system of an English cotton factor of 1, turns per inch over the square root of Ne.
const ALPHA_OF_ENGLISH: f64 = 39.370_078_74 * 24.300_577;
/// Factor of the tex system of a metric factor of 1, turns per meter over the square root of Nm.
const ALPHA_OF_METRIC: f64 = 31.622_776_6;

const FORMS: &str =
    "write direction and turns, such as \"Z 1000/m\", \"S 12/inch\" or \"Z alpha_e 4\" (a twist factor), or \"none\"";

impl FromStr for YarnTwist {
    type Err = String;

    /// Parses a twist. The error tells what to write, as the end of a message.
    fn from_str(text: &str) -> Result<YarnTwist, String> {
        let plain = text.trim().to_lowercase().replace(['α'], "alpha_");
        if matches!(&*plain, "none" | "0") {
            return Ok(YarnTwist::None);
        }
        let (mut hand, mut number, mut unit) = (None, None, String::new());
        for word in plain.split_whitespace() {
            match word {
                "z" => hand = Some(Handedness::Z),
                "s" => hand = Some(Handedness::S),
                _ if word.starts_with(|c: char| c.is_ascii_digit()) => {
                    let end = word.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(word.len());
                    if number.is_some() {
                        return Err(FORMS.into());
                    }
                    number = word[..end].parse::<f64>().ok();
                    unit += &word[end..];
                }
                _ => unit += word,
            }
        }
        let number = number.filter(|n| n.is_finite()).ok_or(FORMS)?;
        let hand = hand.ok_or("begin with the direction, Z or S, such as \"Z 1000/m\"")?;
        match &*unit {
            "/m" | "tpm" | "t/m" => Ok(YarnTwist::PerMeter(hand, number)),
            "/inch" | "/in" | "tpi" => Ok(YarnTwist::PerMeter(hand, number * 39.370_078_74)),
            "/cm" => Ok(YarnTwist::PerMeter(hand, number * 100.0)),
            "alpha_e" => Ok(YarnTwist::Factor(hand, number * ALPHA_OF_ENGLISH)),
            "alpha_m" => Ok(YarnTwist::Factor(hand, number * ALPHA_OF_METRIC)),
            "alpha_tex" => Ok(YarnTwist::Factor(hand, number)),
            "" => Err(format!("{number} of what? {FORMS}")),
            other => Err(format!("{other} is no unit of twist; {FORMS}")),
        }
    }
}

impl YarnTwist {
    /// Direction, and turns per meter of a yarn of this count [tex].
    pub fn turns(self, tex: f64) -> (Handedness, f64) {
        match self {
            YarnTwist::None => (Handedness::Z, 0.0),
            YarnTwist::PerMeter(hand, turns) => (hand, turns),
            YarnTwist::Factor(hand, alpha) => (hand, alpha / tex.sqrt()),
        }
    }

    /// The twist of a yarn of this count [tex].
    pub fn of_count(self, tex: f64) -> Twist {
        let (hand, turns) = self.turns(tex);
        Twist::from_turns_per_m(turns, hand)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twists_are_read() {
        let ne7 = 84.36;
        for (text, hand, turns) in [
            ("Z 1000/m", Handedness::Z, 1000.0),
            ("S 700 /m", Handedness::S, 700.0),
            ("12.5tpi Z", Handedness::Z, 492.1),
            // Four turns an inch per root of Ne 7 are 10.58 an inch.
            ("Z alpha_e 4", Handedness::Z, 416.7),
            ("z αe 4", Handedness::Z, 416.7),
            ("Z alpha_m 121.2", Handedness::Z, 417.3),
            ("S 10/cm", Handedness::S, 1000.0),
            ("none", Handedness::Z, 0.0),
        ] {
            let got = text.parse::<YarnTwist>().unwrap_or_else(|e| panic!("{text}: {e}")).turns(ne7);
            assert!(got.0 == hand && (got.1 - turns).abs() < 2e-3 * turns.max(1.0), "{text}: {got:?}");
        }
        for (text, want) in [
            ("1000/m", "begin with the direction"),
            ("Z 1000", "1000 of what?"),
            ("Z", "write direction and turns"),
            ("Z 10/mile", "/mile is no unit of twist"),
            ("Z 10 20/m", "write direction and turns"),
        ] {
            let got = text.parse::<YarnTwist>().expect_err(text);
            assert!(got.contains(want), "{text}: {got}");
        }
    }
}
