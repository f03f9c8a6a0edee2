//! Damage that knows what files are made of.

use plywave::math::hash::SplitMix64;

/// Random choices: every input of a run follows from one number.
#[derive(Clone, Debug)]
pub struct Rng(SplitMix64);

impl Rng {
    /// The choices that follow from a seed.
    pub fn new(seed: u64) -> Rng {
        Rng(SplitMix64(seed))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Below `n`; 0 for 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n.max(1) as u64) as usize
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }
}

/// Numbers at the borders of what is allowed, and beyond.
const ODD: [f64; 22] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1.05,
    1.0501,
    1e-12,
    1e-45,
    1e-300,
    -1e-9,
    2.0,
    3.0,
    100.0,
    1e6,
    1e9,
    1e19,
    1e30,
    3.5e38,
    f64::MAX,
    f64::NAN,
    f64::INFINITY,
];
/// Words in place of numbers in text.
const WORDS: [&str; 16] = [
    "0",
    "-1",
    "1e9",
    "-1e-9",
    "1e-300",
    "1e308",
    "nan",
    "inf",
    "-inf",
    "4294967296",
    "18446744073709551615",
    "0.5",
    "3",
    "[]",
    "\"x\"",
    "true",
];

/// One to four changes of a good file.
pub fn mutate(seed: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..1 + rng.below(4) {
        let tensors = header(&bytes).is_some();
        let text = !tensors && std::str::from_utf8(&bytes).is_ok();
        bytes = match rng.below(8) {
            0 => flipped(bytes, rng),
            1 if rng.below(4) == 0 => cut(bytes, rng),
            2 => spliced(bytes, rng),
            3..=4 if tensors => with_header(bytes, rng),
            _ if tensors => with_numbers(bytes, rng),
            3..=5 if text => with_words(bytes, rng),
            _ if text => with_lines(bytes, rng),
            _ => flipped(bytes, rng),
        };
    }
    // A part whose checksum does not hold is read no further: most get a good one.
    if seed.windows(12).take(4096).any(|w| w == b"plywave-part") && rng.below(4) > 0 {
        checksummed(&mut bytes);
    }
    bytes
}

/// The JSON header of a safetensors file and where its data begin.
fn header(bytes: &[u8]) -> Option<(serde_json::Value, usize)> {
    let n = u64::from_le_bytes(*bytes.first_chunk()?);
    let end = usize::try_from(n).ok()?.checked_add(8).filter(|end| *end <= bytes.len())?;
    Some((serde_json::from_slice(&bytes[8..end]).ok()?, end))
}

fn joined(header: &serde_json::Value, data: &[u8]) -> Vec<u8> {
    let text = header.to_string();
    [&(text.len() as u64).to_le_bytes(), text.as_bytes(), data].concat()
}

fn flipped(mut bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    for _ in 0..1 + rng.below(4) {
        let at = rng.below(bytes.len());
        if let Some(byte) = bytes.get_mut(at) {
            *byte ^= 1 << rng.below(8);
        }
    }
    bytes
}

fn cut(mut bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    bytes.truncate(rng.below(bytes.len() + 1));
    bytes
}

/// A stretch repeated, overwritten or taken out.
fn spliced(mut bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    let from = rng.below(bytes.len());
    let stretch = bytes[from..(from + rng.below(64)).min(bytes.len())].to_vec();
    let at = rng.below(bytes.len() + 1);
    let end = (at + rng.below(2) * stretch.len()).min(bytes.len());
    bytes.splice(at..end, if rng.below(3) == 0 { Vec::new() } else { stretch });
    bytes
}

/// A number in the header's document, or a tensor's shape, type, name or place.
fn with_header(bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    let Some((mut head, end)) = header(&bytes) else { return bytes };
    let key = "plywave";
    let text = head.pointer("/__metadata__/plywave").and_then(|t| t.as_str()).map(str::to_string);
    match text.and_then(|t| serde_json::from_str::<serde_json::Value>(&t).ok()) {
        Some(mut document) if rng.below(2) == 0 => {
            let many = leaves(&mut document);
            let mut at = rng.below(many);
            change(&mut document, &mut at, rng);
            head["__metadata__"][key] = document.to_string().into();
        }
        _ => {
            let many = leaves(&mut head);
            let mut at = rng.below(many);
            change(&mut head, &mut at, rng);
        }
    }
    joined(&head, &bytes[end..])
}

/// Numbers and texts in a document.
fn leaves(value: &mut serde_json::Value) -> usize {
    match value {
        serde_json::Value::Array(list) => list.iter_mut().map(leaves).sum(),
        serde_json::Value::Object(map) => map.values_mut().map(leaves).sum(),
        _ => 1,
    }
}

/// Changes leaf `at`.
fn change(value: &mut serde_json::Value, at: &mut usize, rng: &mut Rng) {
    match value {
        serde_json::Value::Array(list) => list.iter_mut().for_each(|v| change(v, at, rng)),
        serde_json::Value::Object(map) => map.values_mut().for_each(|v| change(v, at, rng)),
        leaf => {
            if *at == 0 {
                *leaf = match rng.below(4) {
                    0 => rng.pick(&[0u64, 1, 2, 3, 1 << 32, u64::MAX, u64::MAX / 8 + 1]).into(),
                    1 => serde_json::json!(rng.pick(&ODD)),
                    2 => "F64".into(),
                    _ => match leaf.as_str() {
                        Some(text) => {
                            let changed = with_words(text.as_bytes().to_vec(), rng);
                            String::from_utf8_lossy(&changed).into_owned().into()
                        }
                        None => serde_json::json!(leaf.as_f64().unwrap_or(0.0) * f64::from(2.0 * rng.unit())),
                    },
                };
            }
            *at = at.wrapping_sub(1);
        }
    }
}

/// Numbers of one tensor: one of them odd, all of them scaled, or a stretch the same.
fn with_numbers(mut bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    let Some((head, end)) = header(&bytes) else { return bytes };
    let Some(map) = head.as_object() else { return bytes };
    let tensors: Vec<&serde_json::Value> = map.iter().filter(|(k, _)| *k != "__metadata__").map(|(_, v)| v).collect();
    if tensors.is_empty() {
        return bytes;
    }
    let tensor = tensors[rng.below(tensors.len())];
    let offset = |i: usize| {
        tensor["data_offsets"][i].as_u64().and_then(|v| usize::try_from(v).ok()).and_then(|v| v.checked_add(end))
    };
    let (Some(from), Some(to)) = (offset(0), offset(1)) else { return bytes };
    let wide = tensor["dtype"] == "F64";
    let step = if wide { 8 } else { 4 };
    let Some(data) = bytes.get_mut(from..to) else { return bytes };
    let count = data.len() / step;
    let first = rng.below(count);
    let (how, odd, factor) = (rng.below(4), rng.pick(&ODD), f64::from(4.0 * rng.unit()));
    let range = match how {
        0 | 1 => first..first + 1,
        2 => 0..count,
        _ => first..count.min(first + 1 + rng.below(64)),
    };
    for i in range {
        let Some(number) = data.get_mut(i * step..(i + 1) * step) else { break };
        if let Ok(number) = <&mut [u8; 8]>::try_from(&mut *number) {
            let old = f64::from_le_bytes(*number);
            *number = (if how == 0 || how == 3 { odd } else { old * factor }).to_le_bytes();
        } else if let Ok(number) = <&mut [u8; 4]>::try_from(number) {
            let old = f64::from(f32::from_le_bytes(*number));
            *number = ((if how == 0 || how == 3 { odd } else { old * factor }) as f32).to_le_bytes();
        }
    }
    bytes
}

/// A number of a text replaced.
fn with_words(bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    let digit = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'-');
    let starts: Vec<usize> =
        (0..bytes.len()).filter(|i| digit(&bytes[*i]) && (*i == 0 || !digit(&bytes[i - 1]))).collect();
    if starts.is_empty() {
        return bytes;
    }
    let from = starts[rng.below(starts.len())];
    let to = from + bytes[from..].iter().take_while(|b| digit(b)).count();
    let old: f64 = std::str::from_utf8(&bytes[from..to]).ok().and_then(|t| t.parse().ok()).unwrap_or(1.0);
    let new = match rng.below(3) {
        0 => rng.pick(&WORDS).to_string(),
        1 => format!("{}", old * f64::from(3.0 * rng.unit())),
        _ => format!("{}", (old * f64::from(3.0 * rng.unit())).round()),
    };
    [&bytes[..from], new.as_bytes(), &bytes[to..]].concat()
}

/// A line taken out, repeated, or put elsewhere.
fn with_lines(bytes: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
    let mut lines: Vec<&[u8]> = bytes.split(|b| *b == b'\n').collect();
    let (from, to) = (rng.below(lines.len()), rng.below(lines.len()));
    match rng.below(3) {
        0 => drop(lines.remove(from)),
        1 => lines.insert(to, lines[from]),
        _ => lines.swap(from, to),
    }
    lines.join(&b'\n')
}

/// The checksum at the end of a part made to hold.
fn checksummed(bytes: &mut [u8]) {
    use sha2::Digest;
    if let Some(end) = bytes.len().checked_sub(32) {
        let (content, checksum) = bytes.split_at_mut(end);
        checksum.copy_from_slice(sha2::Sha256::digest(&*content).as_slice());
    }
}
