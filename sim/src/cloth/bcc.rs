//! Reader and writer of binary curve collections (`.bcc`), the files of C. Yuksel's yarn-level cloth models
//! (<http://www.cemyuksel.com/cyCodeBase/soln/using_bcc_files.html>), little-endian:
//!
//! | bytes | what |
//! |---|---|
//! | 3 | `BCC` |
//! | 1 | 0x44: integers and numbers of 4 bytes |
//! | 2 | kind of curve: `C0` uniform Catmull-Rom, `PL` polyline |
//! | 1 | dimensions, 3 |
//! | 1 | axis that points up: 0 x, 1 y, 2 z |
//! | 8, 8 | number of curves, and of all their points |
//! | 40 | free text |
//! | then | for each curve the number of its points, i32, negative if it is closed, and the points, f32 |
//!
//! A uniform Catmull-Rom curve starts at its second point and ends at its last but one.

/// A curve of a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BccCurve {
    /// Its points, in the unit and orientation of the file.
    pub points: Vec<[f64; 3]>,
    pub is_closed: bool,
}

/// The contents of a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bcc {
    pub curves: Vec<BccCurve>,
    pub is_polyline: bool,
    /// Axis that points up: 0 x, 1 y, 2 z.
    pub up: u8,
}

const HEADER: usize = 64;
const TEXT: &[u8] = b"plywave, um";

/// Bytes that are still to be read.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }
}

/// Reads a file. The error describes what is wrong with it.
pub(super) fn read(bytes: &[u8]) -> Result<Bcc, String> {
    let mut all = Bytes(bytes);
    let short = || "it ends within its header".to_string();
    if all.take::<3>().as_ref() != Some(b"BCC") {
        return Err("it does not begin with BCC".into());
    }
    let [size] = all.take().ok_or_else(short)?;
    if size != 0x44 {
        return Err(format!("its numbers are of the kind {size:#04x}; 0x44, of 4 bytes each, can be read"));
    }
    let kind: [u8; 2] = all.take().ok_or_else(short)?;
    let is_polyline = match &kind {
        b"PL" => true,
        [b'C', _] => false,
        _ => {
            return Err(format!(
                "its curves are of the kind {:?}; C0 and PL can be read",
                String::from_utf8_lossy(&kind)
            ));
        }
    };
    let [dimensions, up] = all.take().ok_or_else(short)?;
    if dimensions != 3 || up > 2 {
        return Err(format!("it has {dimensions} dimensions, {up} up; 3 dimensions with x, y or z up can be read"));
    }
    let count = u64::from_le_bytes(all.take().ok_or_else(short)?);
    let points = u64::from_le_bytes(all.take().ok_or_else(short)?);
    all.take::<40>().ok_or_else(short)?;
    // Each curve takes 4 bytes, and each point 12.
    let size = count.checked_mul(4).zip(points.checked_mul(12)).and_then(|(a, b)| a.checked_add(b));
    if size != Some(all.0.len() as u64) {
        return Err(format!("its header has {count} curves of {points} points, for which it has the wrong length"));
    }
    let mut curves = Vec::with_capacity(count as usize);
    for curve in 1..=count {
        let ends = || format!("it ends within curve {curve}");
        let number = i32::from_le_bytes(all.take().ok_or_else(ends)?);
        let mut points = Vec::new();
        for _ in 0..number.unsigned_abs() {
            let mut point = [0.0; 3];
            for x in &mut point {
                *x = f64::from(f32::from_le_bytes(all.take().ok_or_else(ends)?));
            }
            if !point.iter().all(|x: &f64| x.is_finite()) {
                return Err(format!("curve {curve} has a point that is no number"));
            }
            points.push(point);
        }
        curves.push(BccCurve { points, is_closed: number < 0 });
    }
    Ok(Bcc { curves, is_polyline, up })
}

/// The bytes of a file. Curves have fewer than 2^31 points, the limit of the format.
pub(super) fn write(bcc: &Bcc) -> Vec<u8> {
    let points: usize = bcc.curves.iter().map(|curve| curve.points.len()).sum();
    let mut out = Vec::with_capacity(HEADER + 4 * bcc.curves.len() + 12 * points);
    out.extend(b"BCC\x44");
    out.extend(if bcc.is_polyline { b"PL" } else { b"C0" });
    out.extend([3, bcc.up]);
    out.extend((bcc.curves.len() as u64).to_le_bytes());
    out.extend((points as u64).to_le_bytes());
    out.extend(TEXT);
    out.resize(HEADER, 0);
    for curve in &bcc.curves {
        let count = curve.points.len() as i32;
        out.extend(if curve.is_closed { -count } else { count }.to_le_bytes());
        for x in curve.points.as_flattened() {
            out.extend((*x as f32).to_le_bytes());
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Bcc {
        let curve = |n: usize, is_closed| BccCurve {
            points: (0..n).map(|i| [i as f64, 0.5 * i as f64, -2.0]).collect(),
            is_closed,
        };
        Bcc { curves: vec![curve(5, false), curve(4, true)], is_polyline: false, up: 2 }
    }

    #[test]
    fn files_come_back() {
        for bcc in [sample(), Bcc { is_polyline: true, up: 1, ..sample() }, Bcc { curves: vec![], ..sample() }] {
            assert_eq!(read(&write(&bcc)).unwrap(), bcc);
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        let good = write(&sample());
        for end in 0..good.len() {
            assert!(read(&good[..end]).is_err(), "{end}");
        }
        for (at, byte, want) in [
            (0, b'X', "begin with BCC"),
            (3, 0x48, "0x48"),
            (4, b'Q', "kind"),
            (6, 2, "2 dimensions"),
            (7, 9, "9 up"),
            (8, 3, "wrong length"),
            (15, 255, "wrong length"),
            (23, 255, "wrong length"),
            (64, 200, "curve 1"),
            (71, 0x7f, "no number"),
        ] {
            let mut bad = good.clone();
            bad[at] = byte;
            if at == 71 {
                bad[68..72].copy_from_slice(&f32::NAN.to_le_bytes());
            }
            let message = read(&bad).unwrap_err();
            assert!(message.contains(want) && message.lines().count() == 1, "{at}: {message}");
        }
    }
}
