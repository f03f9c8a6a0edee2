//! Charts of knits: a stitch for each course and wale, as seen on the face.
//!
//! Before a course is knitted, the loops on its needles are moved: `>` and `<` move the loops of a wale to
//! the next one, and the letters of a cable, such as `RRll`, move loops past each other. Then the yarn is
//! laid over the needles. `K` and `P` draw it through all loops on the needle, and so do cables, and moves
//! where a loop has come to the needle; a needle that a move has emptied gets a new open loop. `T` leaves the
//! loops on the needle and lays the yarn over it, `M` leaves them and passes behind.

use std::fmt;

/// Maximum number of courses and of wales of a chart.
pub const MAX_CHART: usize = 256;
/// Maximum number of tucks and misses over which a loop is held. Chosen: knitters advise against more, since
/// the held loop becomes too tight.
pub const MAX_HELD: usize = 4;
/// Maximum number of loops that a stitch holds: one held over four tucks with their loops. Chosen: so many
/// strands of yarn fit on a needle.
const MAX_LOOPS: usize = MAX_HELD + 1;
/// Maximum number of loops of a side of a cable.
const MAX_CABLE: usize = 4;

/// What is done at a needle in a course.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stitch {
    /// Knit: the yarn is drawn through the loops from behind.
    Knit,
    /// Purl: the yarn is drawn through the loops from the front.
    Purl,
    /// Tuck: the yarn is laid over the needle, which keeps its loops.
    Tuck,
    /// Miss: the yarn passes behind the loops, which the needle keeps.
    Miss,
    /// The loops move to the next wale: 1 to the right, -1 to the left.
    Move(i32),
    /// The loops cross others.
    Cable {
        /// Number of wales by which they move to the right.
        by: i32,
        /// Whether they pass in front.
        is_front: bool,
    },
}

impl Stitch {
    /// Number of wales by which loops move to the right before the course is knitted.
    pub fn shift(self) -> i32 {
        match self {
            Stitch::Move(by) | Stitch::Cable { by, .. } => by,
            _ => 0,
        }
    }

    /// Whether the needle keeps the loops that are on it after the moves.
    pub fn keeps(self) -> bool {
        matches!(self, Stitch::Tuck | Stitch::Miss)
    }
}

/// Stitches of one repeat of a knit; it repeats over courses and wales.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chart {
    wales: usize,
    /// `[course][wale]`, the first course first.
    stitches: Vec<Stitch>,
}

/// What is wrong with a chart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChartError {
    /// Row as written, from the top, if one row is wrong.
    pub row: Option<usize>,
    /// What is there.
    pub value: String,
    /// What to do.
    pub hint: String,
}

impl fmt::Display for ChartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.row {
            Some(row) => write!(f, "row {}, {}: {}", row + 1, self.value, self.hint),
            None => write!(f, "{}: {}", self.value, self.hint),
        }
    }
}

impl ChartError {
    fn new(row: Option<usize>, value: impl Into<String>, hint: impl Into<String>) -> ChartError {
        ChartError { row, value: value.into(), hint: hint.into() }
    }
}

/// Reads the letters of a row.
fn read_row(letters: &[char], row: usize) -> Result<Vec<Stitch>, ChartError> {
    let mut stitches = Vec::with_capacity(letters.len());
    while stitches.len() < letters.len() {
        let at = stitches.len();
        let one = match letters[at] {
            'K' => Stitch::Knit,
            'P' => Stitch::Purl,
            'T' => Stitch::Tuck,
            'M' => Stitch::Miss,
            '>' => Stitch::Move(1),
            '<' => Stitch::Move(-1),
            'R' | 'r' | 'L' | 'l' => {
                stitches.extend(read_cable(letters, at, row)?);
                continue;
            }
            other => {
                let hint = "use K, P, T, M, > and <, or cables such as RRll and rrLL";
                return Err(ChartError::new(Some(row), format!("{other:?} at wale {}", at + 1), hint));
            }
        };
        stitches.push(one);
    }
    Ok(stitches)
}

/// Reads the cable that starts at a letter.
fn read_cable(letters: &[char], at: usize, row: usize) -> Result<Vec<Stitch>, ChartError> {
    let run = |from: usize, sides: [char; 2]| {
        let first = letters.get(from).copied().filter(|c| sides.contains(c));
        first.map_or(0, |first| letters[from..].iter().take_while(|c| **c == first).count())
    };
    let right = run(at, ['R', 'r']);
    let left = run(at + right, ['L', 'l']);
    let text: String = letters[at..at + (right + left).max(1)].iter().collect();
    let refused = |hint: &str| Err(ChartError::new(Some(row), format!("{text:?} at wale {}", at + 1), hint));
    let is_end = at + right + left == letters.len();
    let (first, last) = (letters[0], letters[letters.len() - 1]);
    if (right == 0 && at == 0 && "Rr".contains(last)) || (left == 0 && is_end && "Ll".contains(first)) {
        return refused("the cable crosses the edge of the row; begin all rows at another wale");
    }
    if right == 0 || left == 0 {
        return refused("complete the cable: R or r for loops that move right, then l or L, as RRll or rrLL");
    }
    if right > MAX_CABLE || left > MAX_CABLE {
        return refused("use 1 to 4 loops on each side of a cable");
    }
    let is_front = letters[at] == 'R';
    if is_front == (letters[at + right] == 'L') {
        return refused("use capitals for the loops in front, small letters for those behind, as RRll or rrLL");
    }
    let of = |by: usize, sign: i32, is_front: bool| Stitch::Cable { by: sign * by as i32, is_front };
    let mut stitches = vec![of(left, 1, is_front); right];
    stitches.extend(vec![of(right, -1, !is_front); left]);
    Ok(stitches)
}

impl Chart {
    /// Reads a chart from rows of letters; the last row is the first course.
    ///
    /// # Errors
    /// What is wrong with the first row that is wrong, or with a loop that no stitch holds.
    pub fn from_rows<S: AsRef<str>>(rows: &[S]) -> Result<Chart, ChartError> {
        let wales = rows.first().map_or(0, |row| row.as_ref().chars().count());
        if !(1..=MAX_CHART).contains(&rows.len()) || !(1..=MAX_CHART).contains(&wales) {
            let hint = format!("use 1 to {MAX_CHART} rows of 1 to {MAX_CHART} stitches");
            return Err(ChartError::new(None, format!("{} rows of {wales} stitches", rows.len()), hint));
        }
        let mut read = Vec::with_capacity(rows.len());
        for (row, text) in rows.iter().enumerate() {
            let letters: Vec<char> = text.as_ref().chars().collect();
            if letters.len() != wales {
                let value = format!("{} stitches", letters.len());
                return Err(ChartError::new(
                    Some(row),
                    value,
                    format!("use rows of one length; the first has {wales}"),
                ));
            }
            let stitches = read_row(&letters, row)?;
            check_moves(&stitches, row)?;
            read.push(stitches);
        }
        read.reverse();
        let chart = Chart { wales, stitches: read.concat() };
        chart.check_loops()?;
        Ok(chart)
    }

    /// Number of wales of the repeat.
    pub fn wales(&self) -> usize {
        self.wales
    }

    /// Number of courses of the repeat.
    pub fn courses(&self) -> usize {
        self.stitches.len() / self.wales
    }

    /// The stitch of a course and wale, whose numbers may lie in any repeat.
    pub fn stitch(&self, course: i64, wale: i64) -> Stitch {
        let [course, wale] =
            [(course, self.courses()), (wale, self.wales)].map(|(at, count)| at.rem_euclid(count as i64) as usize);
        self.stitches[course * self.wales + wale]
    }

    /// Whether all stitches are knit or purl.
    pub fn is_plain(&self) -> bool {
        self.stitches.iter().all(|stitch| matches!(stitch, Stitch::Knit | Stitch::Purl))
    }

    /// Course and wale of the stitch that holds a loop, within `most` courses.
    fn holder(&self, [course, mut wale]: [i64; 2], most: usize) -> Option<[i64; 2]> {
        (course + 1..=course + most as i64).find_map(|at| {
            wale += i64::from(self.stitch(at, wale).shift());
            (!self.stitch(at, wale).keeps()).then_some([at, wale])
        })
    }

    /// Checks that a stitch holds each loop, after few tucks and misses, and that none holds too many.
    fn check_loops(&self) -> Result<(), ChartError> {
        let mut counts = vec![0; self.stitches.len()];
        for course in 0..self.courses() {
            for wale in 0..self.wales {
                let at = [course as i64, wale as i64];
                if self.stitch(at[0], at[1]) == Stitch::Miss {
                    continue;
                }
                if let Some([by, on]) = self.holder(at, MAX_HELD + 1) {
                    let at = [(by, self.courses()), (on, self.wales)].map(|(at, n)| at.rem_euclid(n as i64) as usize);
                    counts[at[0] * self.wales + at[1]] += 1;
                    continue;
                }
                let value = format!("the loop of course {}, wale {}", course + 1, wale + 1);
                // After so many courses all places have been tried.
                let hint = match self.holder(at, self.stitches.len() + 1) {
                    None => "the knit runs: no stitch holds this loop; use K or P where it ends".to_string(),
                    Some([by, _]) => {
                        format!("it is held over {} tucks and misses; use {MAX_HELD} in a row at most", by - at[0] - 1)
                    }
                };
                return Err(ChartError::new(None, value, hint));
            }
        }
        // A column of misses alone has no loop at all.
        for wale in 0..self.wales {
            if (0..self.courses()).all(|course| self.stitch(course as i64, wale as i64) == Stitch::Miss) {
                let hint = "the knit runs: no stitch holds a loop there; use K or P in one course";
                return Err(ChartError::new(None, format!("wale {} of M alone", wale + 1), hint));
            }
        }
        match counts.iter().position(|count| *count > MAX_LOOPS) {
            None => Ok(()),
            Some(at) => {
                let value = format!("the stitch of course {}, wale {}", at / self.wales + 1, at % self.wales + 1);
                let hint = format!("it holds {} loops; use {MAX_LOOPS} at most", counts[at]);
                Err(ChartError::new(None, value, hint))
            }
        }
    }
}

/// Checks the moves of a row.
fn check_moves(stitches: &[Stitch], row: usize) -> Result<(), ChartError> {
    let count = stitches.len();
    for wale in 0..count {
        let (before, here, after) =
            (stitches[(wale + count - 1) % count], stitches[wale], stitches[(wale + 1) % count]);
        if here == Stitch::Move(1) && after == Stitch::Move(-1) {
            let value = format!("\"><\" at wale {}", wale + 1);
            let hint = "two loops change places; use the cable Rl or rL, which says which one passes in front";
            return Err(ChartError::new(Some(row), value, hint));
        }
        let is_cable = matches!(here, Stitch::Cable { .. });
        let come = [before == Stitch::Move(1), after == Stitch::Move(-1), is_cable];
        if here.shift() != 0 && come.iter().filter(|is| **is).count() > 1 {
            let hint = "two loops come to a wale whose own loop moves on; use K there, or move one of them less";
            return Err(ChartError::new(Some(row), format!("moves onto wale {}", wale + 1), hint));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Letters are stitches, the last row is the first course, and cables pass each other's number of loops.
    #[test]
    fn letters_are_stitches() {
        let chart = Chart::from_rows(&["KPTMKK", "K<KK>K", "RRlrLL"]).unwrap();
        assert_eq!((chart.wales(), chart.courses(), chart.is_plain()), (6, 3, false));
        let cable = |by, is_front| Stitch::Cable { by, is_front };
        let course = |course: i64| (0..6).map(|wale| chart.stitch(course, wale)).collect::<Vec<_>>();
        let first =
            [cable(1, true), cable(1, true), cable(-2, false), cable(2, false), cable(-1, true), cable(-1, true)];
        assert_eq!(course(0), first);
        assert_eq!(chart.stitch(1, 1), Stitch::Move(-1));
        let last = [Stitch::Knit, Stitch::Purl, Stitch::Tuck, Stitch::Miss, Stitch::Knit, Stitch::Knit];
        assert_eq!((course(2), course(-1), course(5)), (last.into(), last.into(), last.into()));
        assert_eq!(chart.stitch(3, -1), cable(-1, true));
        assert!(Chart::from_rows(&["KP", "PK"]).unwrap().is_plain());
    }

    /// What cannot be knitted is refused in a line that says where.
    #[test]
    fn charts_that_cannot_be_knitted_are_refused() {
        let wide = "K".repeat(MAX_CHART + 1);
        for (rows, want) in [
            (&[][..], "0 rows of 0 stitches: use 1 to 256 rows of 1 to 256 stitches"),
            (&[wide.as_str()], "1 rows of 257 stitches: use 1 to 256"),
            (&["KK", "K"], "row 2, 1 stitches: use rows of one length; the first has 2"),
            (&["KQ"], "row 1, 'Q' at wale 2: use K, P, T, M, > and <, or cables"),
            (&["K."], "'.' at wale 2"),
            (&["KRRK"], "\"RR\" at wale 2: complete the cable"),
            (&["KLLK"], "\"LL\" at wale 2: complete the cable"),
            (&["KRRLL"], "\"RRLL\" at wale 2: use capitals for the loops in front"),
            (&["Krrll"], "\"rrll\" at wale 2: use capitals"),
            (&["KRRRRRl"], "\"RRRRRl\" at wale 2: use 1 to 4 loops on each side"),
            (&["llKRR"], "\"ll\" at wale 1: the cable crosses the edge of the row"),
            (&["KKRlRR", "lKKKKK"], "row 1, \"RR\" at wale 5: complete the cable"),
            (&["K><K"], "\"><\" at wale 2: two loops change places; use the cable Rl or rL"),
            (&["K>><K"], "\"><\" at wale 3: two loops"),
            (&[">><KK", "KKKKK"], "\"><\" at wale 2"),
            (&["K>RlK"], "moves onto wale 3: two loops come to a wale whose own loop moves on"),
            (&["KRl<K"], "moves onto wale 3: two loops"),
            (&["KM"], "wale 2 of M alone: the knit runs: no stitch holds a loop there"),
            (&["T", "M"], "the loop of course 2, wale 1: the knit runs: no stitch holds this loop"),
            (&["KK", "KT", "KM", "KT", "KM", "KM"], "the loop of course 6, wale 2: it is held over 5 tucks and misses"),
            (&["T>", "T<", "T>", "T<", "T>"], "the loop of course 1, wale 1: the knit runs"),
        ] {
            let got = Chart::from_rows(rows);
            let Err(error) = got else { panic!("{rows:?} must be refused: {want}") };
            assert!(error.to_string().contains(want), "{rows:?}: {error}\n{want}");
        }
    }

    /// A stitch holds five loops at most.
    #[test]
    fn stitches_hold_few_loops() {
        assert!(Chart::from_rows(&["K", "T", "T", "T", "T"]).is_ok());
        let error = Chart::from_rows(&["K>KK", "KTTK", "KTTK"]).unwrap_err();
        assert_eq!(error.to_string(), "the stitch of course 3, wale 3: it holds 6 loops; use 5 at most");
    }
}
