//! Files of strands: Cem Yuksel's `.hair`, Mitsuba's curve text, pbrt's text, lines of a Wavefront OBJ.
//!
//! | file | units and radii |
//! |---|---|
//! | `.hair` | coordinates in the file's units; thickness is a diameter in the same, one per strand point or one for all |
//! | Mitsuba's text | `x y z radius` a line, an empty line between curves; `x y z` where the scene has the radius |
//! | pbrt's text | `width`, or `width0` to `width1`, is a diameter; `basis` `bezier` or `bspline`, of degree 3 or 2; transforms are applied |
//! | Wavefront OBJ | elements `l`, of which one that begins at the last vertex of the one before continues it; the scene has the radius |
//!
//! The colors and transparency of `.hair` files, pbrt's shapes other than curves, the normals of ribbons, and
//! OBJ statements other than vertices and lines are ignored.

use super::import_options::{MAX_BYTES, StrandFile, refuse_packed};
use super::pbrt;
use super::words::cut;
use super::{MAX_POINTS, StrandNotes, Strands};
use crate::RenderError;
use crate::memory_limit::read_file;
use crate::surface::obj::{Element, Obj};
use plywave::io::Folder;
use std::path::Path;

impl Strands {
    /// Reads a file; its contents determine the format: `.hair` begins with `HAIR`, Mitsuba's text with a
    /// number, an OBJ with one of its statements, and pbrt's text contains the word `Shape` or begins with
    /// one of its own statements. Files that pbrt's text includes are read from the file's folder.
    ///
    /// # Errors
    /// [`RenderError::Strands`], [`RenderError::Io`], [`RenderError::TooLarge`].
    pub fn load(path: &Path, options: &StrandFile) -> Result<(Strands, StrandNotes), RenderError> {
        let file = path.display().to_string();
        let bytes = read_file(path, MAX_BYTES).map_err(|e| match e {
            RenderError::Picture { file, what } => RenderError::Strands { file, what },
            other => other,
        })?;
        read(&bytes, &file, options, Some(&Folder::of_file(path)))
    }

    /// Reads the bytes of a file that includes no other files; `file` identifies it in errors.
    ///
    /// # Errors
    /// Those of [`Strands::load`].
    pub fn from_bytes(bytes: &[u8], file: &str, options: &StrandFile) -> Result<(Strands, StrandNotes), RenderError> {
        read(bytes, file, options, None)
    }
}

fn read(
    bytes: &[u8],
    file: &str,
    options: &StrandFile,
    folder: Option<&Folder>,
) -> Result<(Strands, StrandNotes), RenderError> {
    let bad = |what: String| RenderError::Strands { file: file.to_string(), what };
    refuse_packed(bytes).map_err(bad)?;
    let mut notes = StrandNotes::default();
    let strands = if bytes.starts_with(b"HAIR") {
        hair(bytes, file, options, &mut notes)?
    } else if Obj::is(bytes) {
        obj_lines(bytes, file, options, &mut notes)?
    } else if pbrt::is(bytes) {
        pbrt::read(bytes, file, options, folder, &mut notes)?
    } else {
        const NEITHER: &str =
            "neither .hair nor text; give a .hair file, curves as Mitsuba's or pbrt's text, or lines of an OBJ";
        mitsuba(std::str::from_utf8(bytes).map_err(|_| bad(NEITHER.into()))?, file, options, &mut notes)?
    };
    if strands.is_empty() {
        const GIVE: &str = "give a .hair file, curves as Mitsuba's or pbrt's text, or lines (l) of an OBJ";
        let thin = if notes.without_width > 0 { "; radius_um sets the radius of all" } else { "" };
        return Err(bad(match notes.lines()[..] {
            [] => format!("no strands; {GIVE}"),
            ref lines => format!("no strands: {}{thin}", lines.join("; ")),
        }));
    }
    Ok((strands, notes))
}

/// Reads the `.hair` format: a header of 128 bytes, then arrays of segments per strand, points and thickness.
/// Flags in the header tell which arrays are present.
fn hair(bytes: &[u8], file: &str, options: &StrandFile, notes: &mut StrandNotes) -> Result<Strands, RenderError> {
    const HEADER: usize = 128;
    let bad = |what: String| RenderError::Strands { file: file.to_string(), what };
    let cut = |needs: u64| bad(format!("{} bytes where {needs} are needed; the file is cut off", bytes.len()));
    if bytes.len() < HEADER {
        return Err(cut(HEADER as u64));
    }
    let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let real = |at: usize| f32::from_bits(word(at));
    let (count, total, flags) = (word(4) as usize, word(8) as usize, word(12));
    let has = |bit: u32| flags >> bit & 1 == 1;
    let (segments, points, thickness) = (has(0), has(1), has(2));
    let (default_segments, default_thickness) = (word(16) as usize, real(20));
    if !points {
        return Err(bad("no points in it; write the file with its points".into()));
    }
    let mut needs = HEADER as u64;
    needs += if segments { 2 * count as u64 } else { 0 };
    needs += 12 * total as u64 + if thickness { 4 * total as u64 } else { 0 };
    if (bytes.len() as u64) < needs {
        return Err(cut(needs));
    }
    Strands::check_memory(total as u64)?;
    let points_at = HEADER + if segments { 2 * count } else { 0 };
    let thickness_at = points_at + 12 * total;
    let mut strands = Strands::new(options.basis);
    let mut next = 0;
    let mut curve = Vec::new();
    for strand in 0..count {
        let place = || format!("strand {}", strand + 1);
        let n = 1 + if segments {
            usize::from(u16::from_le_bytes([bytes[HEADER + 2 * strand], bytes[HEADER + 2 * strand + 1]]))
        } else {
            default_segments
        };
        if n > MAX_POINTS {
            return Err(bad(format!("{}: {n} points; at most {MAX_POINTS}, split the strand", place())));
        }
        if next + n > total {
            return Err(bad(format!(
                "{} takes the points {next} to {} of {total}; the counts do not agree",
                place(),
                next + n
            )));
        }
        curve.clear();
        curve.extend((next..next + n).map(|i| {
            let at = points_at + 12 * i;
            let width = if thickness { real(thickness_at + 4 * i) } else { default_thickness };
            options.point([real(at), real(at + 4), real(at + 8)], 0.5 * width)
        }));
        options.push(&mut strands, &mut curve, notes, file, &place())?;
        next += n;
    }
    if next != total {
        return Err(bad(format!("its strands take {next} of {total} points; the counts do not agree")));
    }
    Ok(strands)
}

/// Message for points without a radius.
const NO_RADIUS: &str = "without a radius; a line is `x y z radius`, or `x y z` where the scene sets strands.radius_um";

/// Reads Mitsuba's text: `x y z radius` per line, or `x y z` if the scene sets the radius; empty lines
/// separate curves.
fn mitsuba(text: &str, file: &str, options: &StrandFile, notes: &mut StrandNotes) -> Result<Strands, RenderError> {
    let mut strands = Strands::new(options.basis);
    let mut curve: Vec<[f32; 4]> = Vec::new();
    let mut begun = 0;
    for (k, line) in text.lines().chain([""]).enumerate() {
        let line = line.trim();
        if line.is_empty() {
            if !curve.is_empty() {
                options.push(&mut strands, &mut curve, notes, file, &format!("curve at line {begun}"))?;
                curve.clear();
            }
            continue;
        }
        let bad =
            |what: String| RenderError::Strands { file: file.to_string(), what: format!("line {}: {what}", k + 1) };
        let mut values = [0.0f32; 4];
        let mut words = line.split_ascii_whitespace();
        for (value, name) in values.iter_mut().zip(["x", "y", "z", ""]) {
            let word = match words.next() {
                Some(word) => word,
                None if !name.is_empty() => return Err(bad(format!("without {name}; a line is `x y z radius`"))),
                None if options.radius_mm.is_some() => break,
                None => return Err(bad(NO_RADIUS.into())),
            };
            *value =
                word.parse().map_err(|_| bad(format!("{:?} is no number; a line is `x y z radius`", cut(word))))?;
        }
        if let Some(word) = words.next() {
            return Err(bad(format!("{:?} after the radius; a line is `x y z radius`", cut(word))));
        }
        if curve.is_empty() {
            begun = k + 1;
        }
        if curve.len() == MAX_POINTS {
            return Err(bad(format!("more than {MAX_POINTS} points in one curve; split it by an empty line")));
        }
        curve.push(options.point([values[0], values[1], values[2]], values[3]));
    }
    Ok(strands)
}

/// Reads the lines of an OBJ. Programs without polylines write one element per edge, so an element that
/// begins at the last vertex of the previous one continues its strand.
fn obj_lines(bytes: &[u8], file: &str, options: &StrandFile, notes: &mut StrandNotes) -> Result<Strands, RenderError> {
    let bad = |line: usize, what: String| RenderError::Strands {
        file: file.to_string(),
        what: if line > 0 { format!("line {line}: {what}") } else { what },
    };
    let obj = Obj::elements(bytes, file, Element::Line).map_err(|e| match e {
        RenderError::Mesh { line, what, .. } => bad(line, what),
        other => other,
    })?;
    let mut strands = Strands::new(options.basis);
    let mut lines = obj.faces().peekable();
    if let Some((line, _)) = lines.peek()
        && options.radius_mm.is_none()
    {
        return Err(bad(*line, "a line of an OBJ has no radius; set strands.radius_um in the scene".into()));
    }
    let mut curve: Vec<[f32; 4]> = Vec::new();
    while let Some((begun, corners)) = lines.next() {
        let point = |index: u32| options.point(obj.positions[index as usize].map(|x| x as f32), 0.0);
        let mut end = corners.last().map(|corner| corner.position);
        curve.clear();
        curve.extend(corners.iter().map(|corner| point(corner.position)));
        while let Some((_, more)) = lines.next_if(|(_, next)| end.is_some() && next.first().map(|c| c.position) == end)
        {
            curve.extend(more.iter().skip(1).map(|corner| point(corner.position)));
            end = more.last().map(|corner| corner.position);
        }
        if !curve.is_empty() {
            options.push(&mut strands, &mut curve, notes, file, &format!("line element at line {begun}"))?;
        }
    }
    Ok(strands)
}

/// Writes strands as Mitsuba's curve text, in mm.
pub fn mitsuba_text(strands: &Strands) -> String {
    use std::fmt::Write;
    let mut text = String::new();
    for curve in strands.curves() {
        for [x, y, z, r] in curve {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{x} {y} {z} {r}");
        }
        text.push('\n');
    }
    text
}
