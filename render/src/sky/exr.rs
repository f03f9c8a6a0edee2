//! Reads skies from OpenEXR: chooses the layer with the colors and decodes its texels to linear values.
//!
//! Only the chosen part of a file is decoded, block by block, so that memory is proportional to the display
//! window; the display window is limited relative to the data window.

use crate::RenderError;
use crate::sky::picture::{Picture, check_shape, check_size, no_colors};
use crate::sky::primaries::Primaries;
use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::f16;
use std::fs::File;
use std::io::{BufReader, Seek};

/// Minimum size of a chunk of an EXR [bytes]: 8 in the table of offsets, 4 for its position, 4 for its size.
const CHUNK_BYTES: u64 = 16;
/// Largest number of channels or layers in a message.
const MAX_NAMES: usize = 20;
/// Names, in lower case, of a layer that contains all light, for files with several layers.
const WHOLE: [&str; 4] = ["combined", "rgba", "beauty", "c"];
/// Largest ratio of the display window's texels to those of the data window, and the reverse: a lamp of a few
/// degrees in a dark sky may have a data window cropped to the lamp.
const MAX_TIMES: u64 = 64;
/// Number of texels up to which a window is never too large for the other one: 1024 x 512.
const SMALL_TEXELS: u64 = 1 << 19;

/// Location of the colors in an EXR.
struct Colors {
    /// Index of the file's part.
    part: usize,
    /// Name of the layer; empty for an unnamed layer.
    layer: String,
    kind: ExrKind,
    /// Names of the channels: red, green, blue; or luminance and its two chromas; or one channel three times.
    channels: [String; 3],
}

impl Colors {
    /// Whether the colors depend on the file's primaries; grays do not.
    fn has_primaries(&self) -> bool {
        matches!(self.kind, ExrKind::Rgb | ExrKind::Chroma)
    }
}

#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum ExrKind {
    Rgb,
    Chroma,
    Luminance,
    /// A single channel, taken as gray.
    Single,
}

/// Layers of a part with their channels: a channel's name is split at its last dot. The part's name is
/// prepended to layers whose names do not contain it.
fn layers_of(header: &Header) -> Vec<(String, Vec<(String, String)>)> {
    let mut layers: Vec<(String, Vec<(String, String)>)> = Vec::new();
    let part = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    for channel in &header.channels.list {
        let full = channel.name.to_string();
        let (before, last) = full.rsplit_once('.').unwrap_or(("", &full));
        let layer = match (part.is_empty(), before.is_empty()) {
            (true, _) => before.to_string(),
            (false, true) => part.clone(),
            (false, false) if before.starts_with(&part) => before.to_string(),
            (false, false) => format!("{part}.{before}"),
        };
        let last = last.to_ascii_uppercase();
        match layers.iter_mut().find(|(name, _)| *name == layer) {
            Some((_, channels)) => channels.push((last, full)),
            None => layers.push((layer, vec![(last, full)])),
        }
    }
    layers
}

/// All sets of colors in a file, in file order.
fn colors_of(headers: &[Header]) -> Vec<Colors> {
    let mut found = Vec::new();
    for (part, header) in headers.iter().enumerate() {
        for (layer, channels) in layers_of(header) {
            let of = |names: &[&str]| {
                let named = |(last, _): &&(String, String)| names.contains(&last.as_str());
                channels.iter().find(named).map(|(_, full)| full.clone())
            };
            let all = |names: [&[&str]; 3]| {
                let [a, b, c] = names.map(of);
                Some([a?, b?, c?])
            };
            let is_vector = of(&["X", "Z"]).is_some();
            let one = |name: String| [name.clone(), name.clone(), name];
            let plain = channels.iter().filter(|(last, _)| last != "A");
            let colors = if let Some(rgb) = all([&["R", "RED"], &["G", "GREEN"], &["B", "BLUE"]]) {
                Some((ExrKind::Rgb, rgb))
            } else if let Some(chroma) = all([&["Y"], &["RY"], &["BY"]]) {
                Some((ExrKind::Chroma, chroma))
            } else if let Some(y) = of(&["Y"]).filter(|_| !is_vector) {
                Some((ExrKind::Luminance, one(y)))
            } else {
                match plain.collect::<Vec<_>>()[..] {
                    [(_, only)] => Some((ExrKind::Single, one(only.clone()))),
                    _ => None,
                }
            };
            found.extend(colors.map(|(kind, channels)| Colors { part, layer, kind, channels }));
        }
    }
    found
}

/// A readable list of names, cut to about a line.
fn listed(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    let more = names.len().saturating_sub(MAX_NAMES);
    let list = names[..names.len() - more].join(", ");
    if more > 0 { format!("{list} and {more} more") } else { list }
}

/// The layer with the given name, or else the layer that most likely contains the light.
fn choose(headers: &[Header], layer: Option<&str>, notes: &mut Vec<String>) -> Result<Colors, String> {
    let mut found = colors_of(headers);
    let channels = || {
        let names = headers.iter().flat_map(|h| h.channels.list.iter().map(|c| c.name.to_string()));
        listed(names)
    };
    if found.is_empty() {
        return Err(format!("no colors; its channels are {}: give R, G and B, or Y", channels()));
    }
    let name = |c: &Colors| if c.layer.is_empty() { format!("that of {}", c.channels[0]) } else { c.layer.clone() };
    if let Some(wanted) = layer {
        let is_it = |c: &Colors| c.layer.eq_ignore_ascii_case(wanted) || c.channels[0].eq_ignore_ascii_case(wanted);
        let Some(at) = found.iter().position(is_it) else {
            return Err(format!("no layer {wanted}; those with colors are {}", listed(found.iter().map(name))));
        };
        return Ok(found.swap_remove(at));
    }
    let is_whole = |c: &Colors| {
        let last = c.layer.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
        WHOLE.contains(&last.as_str())
    };
    let rank = |c: &Colors| (c.kind as usize, !c.layer.is_empty(), !is_whole(c));
    let at = (0..found.len()).min_by_key(|i| rank(&found[*i])).unwrap_or(0);
    let kind = found[at].kind;
    let alike = found.iter().filter(|c| c.kind == kind).count();
    if kind == ExrKind::Single {
        if alike > 1 {
            return Err(format!("no colors; its channels are {}: --sky-layer takes one of them as gray", channels()));
        }
        notes.push(format!("its one channel, {}, is taken as gray", found[at].channels[0]));
    } else if alike > 1 && !found[at].layer.is_empty() {
        let others = found.iter().enumerate().filter(|(i, c)| *i != at && c.kind == kind).map(|(_, c)| name(c));
        notes.push(format!("layer {} is the sky; --sky-layer takes another: {}", name(&found[at]), listed(others)));
    }
    Ok(found.swap_remove(at))
}

/// Reads the colors of an EXR file of `bytes` bytes.
pub(crate) fn read_exr(
    mut file: BufReader<File>,
    name: &str,
    bytes: u64,
    layer: Option<&str>,
    notes: &mut Vec<String>,
) -> Result<Picture, RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let failed = |e: exr::error::Error| bad(e.to_string());
    let headers = MetaData::read_from_buffered(&mut file, false).map_err(failed)?.headers;
    file.rewind().map_err(|source| RenderError::Io { file: name.into(), source })?;
    check_chunks(&headers, bytes).map_err(bad)?;
    let colors = choose(&headers, layer, notes).map_err(bad)?;
    let part = colors.part;
    let header = headers[part].clone();
    check_header(name, &header)?;
    let primaries = if colors.has_primaries() { primaries_of(&header) } else { Primaries::SRGB };
    let luminance = primaries.luminance().filter(|y| y.y > 0.0);
    let luminance = luminance.ok_or_else(|| bad(no_colors(primaries)))?.as_vec3().to_array();
    let mut texels = Texels::new(&header, &colors);
    let reader = exr::block::read(file, false).map_err(failed)?;
    let chunks = reader.filter_chunks(false, |_, _, block| block.layer == part && block.level == Vec2(0, 0));
    for block in chunks.map_err(failed)?.sequential_decompressor(false) {
        texels.add(&block.map_err(failed)?, &header).map_err(failed)?;
    }
    let Texels { window: [width, height], mut values, read, inside, .. } = texels;
    if read < header.layer_size.area() {
        return Err(bad("some of its texels are missing; the file is cut off".into()));
    }
    if colors.kind == ExrKind::Chroma {
        values.iter_mut().for_each(|texel| *texel = of_chroma(*texel, luminance));
    }
    let outside = (width * height).saturating_sub(inside);
    if outside > 0 {
        notes.push(format!("{outside} of {width} x {height} texels are outside its data window and dark"));
    }
    let is_half = texels.kinds[0] == SampleType::F16;
    let names = if colors.kind == ExrKind::Chroma { ["R", "G", "B"].map(String::from) } else { colors.channels };
    Ok(Picture { width, values, is_half, names, primaries })
}

/// Texels of a display window, filled block by block from the data window.
struct Texels {
    /// Width and height.
    window: [usize; 2],
    /// Position of the data window within the display window.
    at: [i64; 2],
    /// Index of each channel in the file.
    channels: [usize; 3],
    kinds: [SampleType; 3],
    /// `values[y][x]`; 0 outside of the data.
    values: Vec<[f32; 3]>,
    /// Number of texels read, and number of those inside the window.
    read: usize,
    inside: usize,
}

impl Texels {
    fn new(header: &Header, colors: &Colors) -> Texels {
        let display = header.shared_attributes.display_window;
        let at = header.own_attributes.layer_position;
        let list = &header.channels.list;
        let channels = std::array::from_fn(|k| {
            list.iter().position(|c| c.name.to_string() == colors.channels[k]).unwrap_or_default()
        });
        let (window, start) = ([display.size.x(), display.size.y()], display.position);
        Texels {
            window,
            at: [(at.x(), start.x()), (at.y(), start.y())].map(|(a, b)| i64::from(a) - i64::from(b)),
            channels,
            kinds: channels.map(|k: usize| list[k].sample_type),
            values: vec![[0.0; 3]; window[0] * window[1]],
            read: 0,
            inside: 0,
        }
    }

    fn add(&mut self, block: &UncompressedBlock, header: &Header) -> exr::error::UnitResult {
        for line in block.lines(&header.channels) {
            let place = line.location.position;
            let x = place.x() as i64 + self.at[0];
            let y = place.y() as i64 + self.at[1];
            let channels = self.channels;
            for k in (0..3).filter(|k| channels[*k] == line.location.channel) {
                let inside = match self.kinds[k] {
                    SampleType::F16 => self.row(k, x, y, line.read_samples::<f16>().map(|v| Ok(v?.to_f32())))?,
                    SampleType::F32 => self.row(k, x, y, line.read_samples::<f32>())?,
                    SampleType::U32 => self.row(k, x, y, line.read_samples::<u32>().map(|v| Ok(v? as f32)))?,
                };
                if k == 0 {
                    self.read += line.location.sample_count;
                    self.inside += inside;
                }
            }
        }
        Ok(())
    }

    /// Sets a channel of a row that begins at a position in the window; returns the number of texels inside.
    fn row(
        &mut self,
        channel: usize,
        x: i64,
        y: i64,
        samples: impl Iterator<Item = exr::error::Result<f32>>,
    ) -> exr::error::Result<usize> {
        let [width, height] = self.window.map(|n| n as i64);
        let mut inside = 0;
        for (x, sample) in (x..).zip(samples) {
            let sample = sample?;
            if (0..width).contains(&x) && (0..height).contains(&y) {
                self.values[(y * width + x) as usize][channel] = sample;
                inside += 1;
            }
        }
        Ok(inside)
    }
}

/// Linear RGB from luminance, (R - Y) / Y and (B - Y) / Y, given the weights of red, green and blue in the
/// luminance.
fn of_chroma([y, ry, by]: [f32; 3], share: [f32; 3]) -> [f32; 3] {
    let (r, b) = ((1.0 + ry) * y, (1.0 + by) * y);
    [r, (y - share[0] * r - share[2] * b) / share[1], b]
}

/// Primaries of a header: its chromaticities, or those of sRGB if it has none.
fn primaries_of(header: &Header) -> Primaries {
    let of = |v: Vec2<f32>| [v.x(), v.y()].map(f64::from);
    match header.shared_attributes.chromaticities {
        Some(c) => Primaries([c.red, c.green, c.blue, c.white].map(of)),
        None => Primaries::SRGB,
    }
}

/// Refuses headers whose chunks cannot fit in a file of `bytes` bytes, before any allocation by the sizes
/// that they declare: every chunk has an entry in a table and a header of its own.
fn check_chunks(headers: &[Header], bytes: u64) -> Result<(), String> {
    let chunks = headers.iter().map(|header| header.chunk_count as u64).fold(0, u64::saturating_add);
    if chunks.saturating_mul(CHUNK_BYTES) <= bytes {
        return Ok(());
    }
    let [w, h] = headers.first().map_or([0; 2], |header| [header.layer_size.x(), header.layer_size.y()]);
    Err(format!("{w} x {h} texels do not fit into {bytes} bytes; the file is cut off"))
}

/// Refuses a part by its header: deep pixels, subsampled channels, disproportionate windows.
fn check_header(name: &str, header: &Header) -> Result<(), RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    if header.deep {
        return Err(bad("deep pixels; a sky has one color a pixel: flatten it".into()));
    }
    if let Some(channel) = header.channels.list.iter().find(|c| c.sampling != Vec2(1, 1)) {
        let channel = &channel.name;
        return Err(bad(format!("channel {channel} has fewer samples than pixels; save it as R, G, B, or Y alone")));
    }
    let size = |v: Vec2<usize>| [v.x() as u64, v.y() as u64];
    let [display, data] = [header.shared_attributes.display_window.size, header.layer_size].map(size);
    check_shape(name, display)?;
    let areas = [display, data].map(|[w, h]| w.saturating_mul(h));
    let max = |of: u64| SMALL_TEXELS.max(MAX_TIMES.saturating_mul(of));
    if areas[0] > max(areas[1]) || areas[1] > max(areas[0]) {
        let [[w, h], [data_w, data_h]] = [display, data];
        return Err(bad(format!(
            "a display window of {w} x {h} texels for data of {data_w} x {data_h}; save it with a data window of the whole sky"
        )));
    }
    check_size(name, display, 0)?;
    check_size(name, data, 0)
}
