//! Notes on a WIF: what the reader took where a file says nothing, says it twice, or is wrong. One line for
//! each kind of assumption, however often it was made.

use std::fmt;

/// What a note is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum WifNoteKind {
    /// The encoding of the text.
    Encoding,
    /// A section that `[CONTENTS]` announces and the file lacks.
    Contents,
    /// The number of ends or picks.
    Threads,
    /// Lines counted from 0 where they count from 1.
    Numbering,
    /// Lines for ends, picks or colors that there are not.
    SpareLines,
    /// Shafts or treadles beyond those of the loom.
    Loom,
    /// Lines of ones and zeros in place of numbers.
    Bits,
    /// Whether shafts rise or sink.
    Shed,
    /// A lift plan that differs from tie-up and treadling.
    LiftPlan,
    /// Ends on no shaft, which are left out.
    UnthreadedEnds,
    /// Picks of no treadle and no shaft, which are left out.
    EmptyPicks,
    /// Yarns above or below all others, which are left out.
    LooseYarns,
    /// Layers of cloth that no yarn joins.
    FallsApart,
    /// Colors that the table lacks, that a yarn lacks, or that cannot be read.
    Colors,
    /// The range of the colors' numbers.
    ColorRange,
    /// Distances between yarns that the cloth spec leaves to the file.
    Spacing,
}

/// A note on a WIF; it prints as its text, one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WifNote {
    /// What it is about; a file has one note of a kind at most.
    pub kind: WifNoteKind,
    /// What was found and what was taken.
    pub text: String,
}

impl fmt::Display for WifNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Findings of one kind that a note tells; it counts the others.
const TOLD: usize = 3;

/// Collects findings; those of one kind become one note.
#[derive(Default)]
pub(super) struct Notes(Vec<(WifNoteKind, Vec<String>)>);

impl Notes {
    pub fn add(&mut self, kind: WifNoteKind, finding: String) {
        match self.0.iter_mut().find(|(known, _)| *known == kind) {
            Some((_, findings)) if findings.contains(&finding) => {}
            Some((_, findings)) => findings.push(finding),
            None => self.0.push((kind, vec![finding])),
        }
    }

    /// The notes, in the order of the kinds.
    pub fn finish(mut self) -> Vec<WifNote> {
        self.0.sort_by_key(|(kind, _)| *kind);
        let note = |(kind, findings): (WifNoteKind, Vec<String>)| {
            let more = findings.len().saturating_sub(TOLD);
            let mut text = findings[..findings.len().min(TOLD)].join("; ");
            if more > 0 {
                text += &format!("; and {more} more of this kind");
            }
            WifNote { kind, text: crate::one_line(&text, 600) }
        };
        self.0.into_iter().map(note).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_has_one_note() {
        let mut notes = Notes::default();
        for finding in ["b", "a", "b", "c", "d", "e"] {
            notes.add(WifNoteKind::Colors, finding.into());
        }
        notes.add(WifNoteKind::Shed, "x\ny".into());
        let told: Vec<String> = notes.finish().iter().map(ToString::to_string).collect();
        assert_eq!(told, ["x y", "b; a; c; and 2 more of this kind"]);
    }
}
