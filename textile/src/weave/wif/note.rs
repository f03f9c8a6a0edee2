//! Notes on a WIF: the assumptions of the reader where a file is incomplete, contradictory or wrong.
//! Assumptions of one kind become one note.

use std::fmt;

/// Subject of a note.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum WifNoteKind {
    /// The encoding of the text.
    Encoding,
    /// A section that `[CONTENTS]` announces and the file lacks.
    Contents,
    /// The number of ends or picks.
    Threads,
    /// Lines counted from 0 instead of from 1.
    Numbering,
    /// Lines for ends, picks or colors that do not exist.
    SpareLines,
    /// Shafts or treadles beyond those of the loom.
    Loom,
    /// Lines of ones and zeros instead of numbers.
    Bits,
    /// Whether shafts rise or sink.
    Shed,
    /// A lift plan that differs from tie-up and treadling.
    LiftPlan,
    /// Ends on no shaft, which are left out.
    UnthreadedEnds,
    /// Picks with no treadle and no shaft, which are left out.
    EmptyPicks,
    /// Loose yarns above or below all others, which are left out.
    LooseYarns,
    /// Layers of cloth that no yarn joins.
    FallsApart,
    /// Colors that the table or a yarn lacks, or that cannot be read.
    Colors,
    /// The range of the color values.
    ColorRange,
    /// Distances between yarns that the cloth spec leaves to the file.
    Spacing,
}

/// A note on a WIF; it prints as its text in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WifNote {
    /// Subject of the note; a file has at most one note of each kind.
    pub kind: WifNoteKind,
    /// The findings, each with the assumption of the reader.
    pub text: String,
}

impl fmt::Display for WifNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Largest number of findings that a note lists; it counts the others.
const MAX_LISTED: usize = 3;

/// Collects findings and merges those of one kind into one note.
#[derive(Default)]
pub(crate) struct Notes(Vec<(WifNoteKind, Vec<String>)>);

impl Notes {
    pub fn add(&mut self, kind: WifNoteKind, finding: String) {
        match self.0.iter_mut().find(|(known, _)| *known == kind) {
            Some((_, findings)) if findings.contains(&finding) => {}
            Some((_, findings)) => findings.push(finding),
            None => self.0.push((kind, vec![finding])),
        }
    }

    /// The notes, sorted by kind.
    pub fn finish(mut self) -> Vec<WifNote> {
        self.0.sort_by_key(|(kind, _)| *kind);
        let note = |(kind, findings): (WifNoteKind, Vec<String>)| {
            let more = findings.len().saturating_sub(MAX_LISTED);
            let mut text = findings[..findings.len().min(MAX_LISTED)].join("; ");
            if more > 0 {
                text += &format!("; and {more} more of this kind");
            }
            WifNote { kind, text: plywave::one_line(&text, 600) }
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
        let texts: Vec<String> = notes.finish().iter().map(ToString::to_string).collect();
        assert_eq!(texts, ["x y", "b; a; c; and 2 more of this kind"]);
    }
}
