//! Reads vertices, texture coordinates, normals, and faces or lines of a Wavefront OBJ file. Names,
//! materials, colors, smoothing groups, points and curves are ignored.
//!
//! Coordinates stay in double precision, and faces stay polygons with the number of their first line.
//! Ignored text may be in any encoding. Lines end with LF, CR LF or CR; a backslash at the end of a line
//! continues the statement.
//! line continues a statement.

use crate::RenderError;
use std::borrow::Cow;

/// Index of a missing texture coordinate or normal.
pub(crate) const NONE: u32 = u32::MAX;

/// Kind of elements to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    /// Faces: `f`, or `fo` in old files.
    Face,
    /// Polylines: `l`.
    Line,
}

impl Element {
    /// Whether a statement defines an element of this kind.
    fn is(self, statement: &str) -> bool {
        match self {
            Element::Face => matches!(statement, "f" | "fo"),
            Element::Line => statement == "l",
        }
    }

    /// Name of the element in messages.
    fn name(self) -> &'static str {
        match self {
            Element::Face => "face",
            Element::Line => "line",
        }
    }
}

/// Statements that a file may begin with.
const STATEMENTS: [&str; 12] = ["v", "vt", "vn", "vp", "o", "g", "s", "f", "l", "p", "mtllib", "usemtl"];

/// The geometry of a file.
#[derive(Debug, Default)]
pub(crate) struct Obj {
    /// Vertices, in the file's units.
    pub positions: Vec<[f64; 3]>,
    /// Texture coordinates.
    pub uvs: Vec<[f64; 2]>,
    /// Normals, not normalized.
    pub normals: Vec<[f64; 3]>,
    /// Corners of all faces, or points of all lines, element by element.
    corners: Vec<Corner>,
    /// Elements in file order: the first line of each, from 1, and the end of its corners.
    faces: Vec<(u32, u32)>,
}

/// Indices of a face's corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// Index of a vertex.
    pub position: u32,
    /// Index of a texture coordinate, or [`NONE`].
    pub uv: u32,
    /// Index of a normal, or [`NONE`].
    pub normal: u32,
}

impl Obj {
    /// Whether a text begins with an OBJ statement.
    pub fn is(bytes: &[u8]) -> bool {
        let text = decode(bytes.get(..bytes.len().min(1 << 16)).unwrap_or_default());
        let mut lines = Lines { rest: &text, number: 0 };
        let first = lines.find_map(|line| statement(line).0.split_ascii_whitespace().next());
        first.is_some_and(|word| STATEMENTS.contains(&word))
    }

    /// Reads the vertices and faces from the bytes of a file; `name` identifies it in errors.
    ///
    /// # Errors
    /// Those of [`Obj::elements`].
    pub fn read(bytes: &[u8], name: &str) -> Result<Obj, RenderError> {
        Obj::elements(bytes, name, Element::Face)
    }

    /// Reads the vertices and the elements of one kind; `name` identifies the file in errors.
    ///
    /// # Errors
    /// [`RenderError::Mesh`] with the line number for invalid text and for an index out of range.
    pub fn elements(bytes: &[u8], name: &str, element: Element) -> Result<Obj, RenderError> {
        let bad = |line: usize, what: String| RenderError::Mesh { file: name.into(), line, what };
        let text = decode(bytes);
        let mut obj = Obj::default();
        let mut lines = Lines { rest: &text, number: 0 };
        while let Some(line) = lines.next() {
            let (number, (head, mut continued)) = (lines.number, statement(line));
            let Some(kind) = head.split_ascii_whitespace().next() else { continue };
            if !matches!(kind, "v" | "vt" | "vn") && !element.is(kind) {
                continue;
            }
            let mut whole = Cow::Borrowed(head);
            while continued && let Some(line) = lines.next() {
                let (more, again) = statement(line);
                whole = Cow::Owned(format!("{whole} {more}"));
                continued = again;
            }
            let words = whole.split_ascii_whitespace().skip(1);
            match kind {
                "v" => obj.position(words),
                "vt" => obj.uv(words),
                "vn" => obj.normal(words),
                _ => obj.face(words, number as u32, element),
            }
            .map_err(|what| bad(number, what))?;
        }
        // Corners may refer to vertices that are defined later, so indices are checked at the end.
        for (line, corners) in obj.faces() {
            for corner in corners {
                for (index, count, what) in [
                    (corner.position, obj.positions.len(), "vertex"),
                    (corner.uv, obj.uvs.len(), "texture coordinate"),
                    (corner.normal, obj.normals.len(), "normal"),
                ] {
                    if index != NONE && index as usize >= count {
                        let of = element.name();
                        return Err(bad(line, format!("a {of} names {what} {}, and there are {count}", index + 1)));
                    }
                }
            }
        }
        Ok(obj)
    }

    /// Faces or lines: the first line of each in the file, and its corners.
    pub fn faces(&self) -> impl Iterator<Item = (usize, &[Corner])> {
        let mut from = 0;
        self.faces.iter().map(move |&(line, end)| {
            let corners = &self.corners[from..end as usize];
            from = end as usize;
            (line as usize, corners)
        })
    }

    /// Reads `v x y z`, optionally followed by a weight that divides the coordinates, or by colors.
    fn position<'a>(&mut self, mut words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let mut position = [0.0; 3];
        for x in &mut position {
            *x = real(words.next().ok_or("a vertex of fewer than three coordinates")?)?;
        }
        if let (Some(weight), None) = (words.next(), words.next()) {
            let w = real(weight)?;
            if w == 0.0 {
                return Err("a vertex of weight 0, infinitely far; give it a weight above 0".into());
            }
            position = position.map(|x| x / w);
        }
        self.positions.push(position);
        Ok(())
    }

    /// Reads `vt u v`; a missing v is 0.
    fn uv<'a>(&mut self, mut words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let u = real(words.next().ok_or("a texture coordinate without numbers")?)?;
        self.uvs.push([u, words.next().map_or(Ok(0.0), real)?]);
        Ok(())
    }

    /// Reads `vn x y z`.
    fn normal<'a>(&mut self, mut words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let mut normal = [0.0; 3];
        for x in &mut normal {
            *x = real(words.next().ok_or("a normal of fewer than three components")?)?;
        }
        self.normals.push(normal);
        Ok(())
    }

    /// Reads `f v/vt/vn ..` or `l v/vt ..`; positive indices count from 1, negative ones back from the end.
    fn face<'a>(&mut self, words: impl Iterator<Item = &'a str>, line: u32, element: Element) -> Result<(), String> {
        let wrong = |word: &str| format!("not a corner of a {}: {word}", element.name());
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for word in words {
            let mut indices = [NONE; 3];
            let mut parts = word.split('/');
            for (k, part) in parts.by_ref().take(3).enumerate() {
                // `v//vn` and `v/` have empty parts, which stand for missing indices.
                if k == 0 || !part.is_empty() {
                    indices[k] = index(part, counts[k]).ok_or_else(|| wrong(word))?;
                }
            }
            if parts.next().is_some() {
                return Err(wrong(word));
            }
            let [position, uv, normal] = indices;
            self.corners.push(Corner { position, uv, normal });
        }
        let end = u32::try_from(self.corners.len()).map_err(|_| "more corners of faces than 32 bits count")?;
        self.faces.push((line, end));
        Ok(())
    }
}

fn real(word: &str) -> Result<f64, String> {
    word.parse().map_err(|_| format!("not a number: {word}"))
}

/// Zero-based index from a one-based index or a negative one that counts back from the current end.
fn index(word: &str, count: usize) -> Option<u32> {
    let from_one: i64 = word.parse().ok()?;
    let index = if from_one < 0 { count as i64 + from_one } else { from_one - 1 };
    u32::try_from(index).ok().filter(|i| *i != NONE)
}

/// Decodes the text of a file. Statements are ASCII in all encodings except UTF-16, which has a byte order
/// mark.
fn decode(bytes: &[u8]) -> Cow<'_, str> {
    let utf16 = |units: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = units.as_chunks().0.iter().map(|pair| unit(*pair)).collect();
        Cow::Owned(String::from_utf16_lossy(&units))
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8_lossy(rest),
        _ => String::from_utf8_lossy(bytes),
    }
}

/// Iterator over lines that end with LF, CR LF or CR.
struct Lines<'a> {
    rest: &'a str,
    /// Number of the last line, from 1.
    number: usize,
}

impl<'a> Iterator for Lines<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.bytes().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(self.rest.len());
        let (line, tail) = self.rest.split_at(end);
        self.rest = tail.strip_prefix("\r\n").or_else(|| tail.get(1..)).unwrap_or("");
        self.number += 1;
        Some(line)
    }
}

/// A line without its comment, and whether a backslash at its end continues the statement. A backslash in a
/// comment has no meaning: a Windows path there may end with one.
fn statement(line: &str) -> (&str, bool) {
    match line.split_once('#') {
        Some((before, _)) => (before, false),
        None => match line.trim_ascii_end().strip_suffix('\\') {
            Some(before) => (before, true),
            None => (line, false),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faces as lines and corners `[position, uv, normal]`.
    fn faces(bytes: &[u8]) -> Vec<(usize, Vec<[u32; 3]>)> {
        let obj = Obj::read(bytes, "x").unwrap();
        obj.faces().map(|(line, c)| (line, c.iter().map(|c| [c.position, c.uv, c.normal]).collect())).collect()
    }

    const THREE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n";

    #[test]
    fn corners_have_all_forms() {
        let (n, want) = (NONE, |a, b| vec![[0, a, b], [1, a, b], [2, a, b]]);
        for (form, [uv, normal]) in [
            ("f 1 2 3", [n, n]),
            ("f 1/1 2/1 3/1", [0, n]),
            ("f 1/1/ 2/1/ 3/1/", [0, n]),
            ("f 1//1 2//1 3//1", [n, 0]),
            ("f 1/1/1 2/1/1 3/1/1", [0, 0]),
            ("f -3/-1/-1 -2/-1/-1 -1/-1/-1", [0, 0]),
            ("\tfo  1/1/1\t2/1/1   3/1/1  # a face", [0, 0]),
            ("f 1/1/1 \\\n 2/1/1 \\  \n\n\\\n", [0, 0]),
        ] {
            let got = faces(format!("{THREE}{form}\n").as_bytes());
            let want = if form.contains('\\') { vec![[0, 0, 0], [1, 0, 0]] } else { want(uv, normal) };
            assert_eq!(got, [(6, want)], "{form}");
        }
        // A negative index counts back from the face; a positive one may refer to later vertices.
        let late = faces(b"v 0 0 0\nv 1 0 0\nf 1 2 3\nf -1 -2 1\nv 0 1 0\n");
        assert_eq!(late, [(3, vec![[0, n, n], [1, n, n], [2, n, n]]), (4, vec![[1, n, n], [0, n, n], [0, n, n]])]);
    }

    #[test]
    fn lines_end_and_go_on_in_all_ways() {
        let text = "# C:\\cloth\\\nmtllib C:\\cloth\\\nv 0 0 \\\n 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nl 1 2 \\\n3\np 1\ncurv 0 1 1 2 \\\n3 1\nf 1 2\\\n 3 # \\\nf 3 2 1\n";
        for end in ["\n", "\r\n", "\r"] {
            let lines: Vec<usize> = faces(text.replace('\n', end).as_bytes()).iter().map(|f| f.0).collect();
            assert_eq!(lines, [13, 15], "{end:?}");
        }
        // The end of the file ends a statement.
        assert_eq!(faces(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 \\").len(), 1);
    }

    #[test]
    fn names_are_in_any_encoding() {
        let named = |name: &[u8]| [b"usemtl ", name, b"\ng \x00\xff\no a#\n", THREE.as_bytes(), b"f 1 2 3\n"].concat();
        for name in [&b"K\xfcper_gr\xfcn"[..], "Köper".as_bytes(), b"\x83J\x83\x5c", b""] {
            assert_eq!(faces(&named(name)).len(), 1);
        }
        let text = format!("{THREE}usemtl Köper\nf 1 2 3\n");
        let units = |unit: fn(u16) -> [u8; 2]| {
            "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(unit).collect::<Vec<u8>>()
        };
        for bytes in [units(u16::to_le_bytes), units(u16::to_be_bytes), format!("\u{feff}{text}").into_bytes()] {
            assert_eq!(faces(&bytes).len(), 1);
        }
    }

    #[test]
    fn numbers_are_doubles_with_weights_or_colors() {
        let text =
            "v 4500000.125 1e-3 -0.1\nv 2 4 6 2\nv 1 2 3 0.5 0.5 0.5\nv 1 2 3 1 0.5 0.5 0.5\nvt 0.25\nvt 0.25 0.5 0\n";
        let obj = Obj::read(text.as_bytes(), "x").unwrap();
        assert_eq!(obj.positions, [[4500000.125, 1e-3, -0.1], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]);
        assert_eq!(obj.uvs, [[0.25, 0.0], [0.25, 0.5]]);
    }

    #[test]
    fn what_is_wrong_is_told_by_line() {
        for (bad, line, words) in [
            ("v 0 0\n", 1, "fewer than three"),
            ("\n\nv 1 x 0\n", 3, "not a number: x"),
            ("v 0,5 1 0\n", 1, "not a number: 0,5"),
            ("v 1 2 3 0\n", 1, "weight 0"),
            ("vt\n", 1, "texture"),
            ("vn 1 2\n", 1, "normal"),
            ("v 0 0 0\nf 1 0 1\n", 2, "not a corner of a face: 0"),
            ("v 0 0 0\nf 1 -2 1\n", 2, "not a corner of a face: -2"),
            ("v 0 0 0\nf 1 1.0 1\n", 2, "1.0"),
            ("v 0 0 0\nf 1/1/1/1 1 1\n", 2, "1/1/1/1"),
            ("v 0 0 0\nf /1 1 1\n", 2, "/1"),
            ("v 0 0 0\nf 1 1 2\n", 2, "vertex 2, and there are 1"),
            ("v 0 0 0\nf 1/1 1 1\n", 2, "texture coordinate 1, and there are 0"),
            ("v 0 0 0\nf 1//7 1 1\n", 2, "normal 7, and there are 0"),
            ("v 0 0 0\nf 1 99999999999 1\n", 2, "99999999999"),
        ] {
            match Obj::read(bad.as_bytes(), "bad") {
                Err(RenderError::Mesh { line: at, what, .. }) => {
                    assert!(at == line && what.contains(words), "{bad:?}: {at}: {what}");
                }
                other => panic!("{bad:?}: {other:?}"),
            }
        }
    }
}
