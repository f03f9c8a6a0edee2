//! Lists of yarns in messages: ends and picks, by number.

use crate::weave::draft::YarnSet;

/// The words for one yarn of a set and for several.
pub(crate) fn words(family: YarnSet) -> [&'static str; 2] {
    match family {
        YarnSet::Warp => ["end", "ends"],
        YarnSet::Weft => ["pick", "picks"],
    }
}

/// Number of runs that [`numbered`] lists.
const MAX_RUNS: usize = 4;

/// Formats ascending numbers, such as "end 3", "ends 1, 3 and 5 to 9" or "picks 1, 3, 5, 7 and 12 more", with
/// a word for one and for several.
pub(crate) fn numbered([one, several]: [&str; 2], numbers: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &n in numbers {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == n => *last = n,
            _ => runs.push([n, n]),
        }
    }
    let listed: Vec<String> = runs
        .iter()
        .take(MAX_RUNS)
        .map(|[first, last]| match last - first {
            0 => first.to_string(),
            1 => format!("{first}, {last}"),
            _ => format!("{first} to {last}"),
        })
        .collect();
    let more: usize = runs.iter().skip(MAX_RUNS).map(|[first, last]| last - first + 1).sum();
    let list = listed.join(", ");
    match (numbers.len(), more) {
        (1, _) => format!("{one} {list}"),
        (_, 0) => match list.rsplit_once(", ") {
            Some((head, last)) => format!("{several} {head} and {last}"),
            None => format!("{several} {list}"),
        },
        _ => format!("{several} {list} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_listed_as_one_would_say_them() {
        let of = |numbers: &[usize]| numbered(["end", "ends"], numbers);
        assert_eq!(of(&[3]), "end 3");
        assert_eq!(of(&[1, 3]), "ends 1 and 3");
        assert_eq!(of(&[4, 5]), "ends 4 and 5");
        assert_eq!(of(&[4, 5, 6]), "ends 4 to 6");
        assert_eq!(of(&[1, 2, 4, 6, 7, 8, 9]), "ends 1, 2, 4 and 6 to 9");
        assert_eq!(of(&[1, 3, 5, 7, 9, 10, 12]), "ends 1, 3, 5, 7 and 3 more");
    }
}
