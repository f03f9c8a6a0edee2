//! Skies from files: OpenEXR with colors in any layer, or luminance, and Radiance pictures.

use crate::room::{check_room, open_file};
use crate::{Environment, RenderError};
use exr::meta::header::Header;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

/// Largest number of texels of an environment: 16384 x 8192.
const MAX_TEXELS: u64 = 1 << 27;
/// Largest file that is read [bytes]: all texels as 32-bit floats in eight channels.
const MAX_BYTES: u64 = 32 * MAX_TEXELS;
/// Least size of a chunk of an EXR [bytes]: 8 in the table of offsets, 4 of its place, 4 of its size.
const CHUNK_BYTES: u64 = 16;
/// Bytes per texel of an environment: the colors, twice while they are read, and the running sums.
const TEXEL_BYTES: u64 = 32;
/// Least size of a row of a Radiance picture [bytes].
const ROW_BYTES: u64 = 4;
/// The largest finite half float, which replaces infinite values.
const MAX_HALF: f32 = 65504.0;
/// Largest radiance; far above the sun's over that of its sky.
const MAX_RADIANCE: f32 = 1e12;
/// Largest number of channels or layers in a message.
const MAX_NAMES: usize = 20;
/// Names in lower case of a layer with all light, in a file with several layers.
const WHOLE: [&str; 4] = ["combined", "rgba", "beauty", "c"];
/// Shares of red, green and blue in the luminance of linear sRGB (ITU-R BT.709), which OpenEXR uses for
/// luminance and chroma.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Linear sRGB as in the file, before invalid radiances are replaced.
struct Picture {
    width: usize,
    /// `values[y][x]`, rows from the top.
    values: Vec<[f32; 3]>,
    /// Whether the values are half floats, whose largest value replaces infinity.
    is_half: bool,
    /// Names of the channels.
    names: [String; 3],
}

impl Environment {
    /// A picture in latitude and longitude: OpenEXR, or Radiance (`.hdr`, `.pic`), rows from the zenith down;
    /// with notes on assumptions and replaced values, a line each.
    ///
    /// An EXR has colors in channels `R`, `G`, `B`, in `Y`, `RY`, `BY`, or in one channel that counts as
    /// gray, in a layer of any name. Of several layers, `layer` chooses one; by default it is the one without
    /// a name or with a name for all light. Values count as linear sRGB. Negative values and NaN count as 0,
    /// infinite half floats as the largest half.
    ///
    /// # Errors
    /// [`RenderError::Picture`] if the file cannot be read, has more than 134 M texels, no colors, or no such
    /// `layer`; [`RenderError::TooLarge`]; [`RenderError::Io`].
    pub fn load(path: &Path, layer: Option<&str>) -> Result<(Environment, Vec<String>), RenderError> {
        let name = path.display().to_string();
        let bad = |what: String| RenderError::Picture { file: name.clone(), what };
        let (mut file, bytes) = open_file(path, MAX_BYTES)?;
        let mut magic = Vec::new();
        let read = file.by_ref().take(4).read_to_end(&mut magic).and_then(|_| file.rewind());
        read.map_err(|source| RenderError::Io { file: name.clone(), source })?;
        let mut notes = Vec::new();
        let picture = if magic == [0x76, 0x2f, 0x31, 0x01] {
            read_exr(file, &name, bytes, layer, &mut notes)?
        } else if magic.starts_with(b"#?") {
            if let Some(layer) = layer {
                return Err(bad(format!("a Radiance picture has no layers, so none is named {layer}; leave it out")));
            }
            read_radiance(file, &name, bytes)?
        } else {
            return Err(bad("neither OpenEXR nor Radiance; convert it to an .exr or .hdr in linear light".into()));
        };
        let Picture { width, mut values, is_half, names } = picture;
        let height = values.len() / width.max(1);
        notes.extend(mend(&mut values, width, is_half, &names));
        if width != 2 * height {
            notes.push(format!(
                "{width} x {height} texels are stretched over the sphere; a picture in latitude and longitude has twice as many columns as rows"
            ));
        }
        let sky = Environment::picture(width, values).map_err(|e| bad(e.to_string()))?;
        if sky.is_dark() {
            notes.push("black: no light comes from it".into());
        }
        Ok((sky, notes))
    }
}

/// Replaces invalid radiances; returns a line with their number and the first.
fn mend(values: &mut [[f32; 3]], width: usize, is_half: bool, names: &[String; 3]) -> Option<String> {
    let mended = |v: f32| match v {
        v if v == f32::INFINITY => {
            if is_half {
                MAX_HALF
            } else {
                0.0
            }
        }
        v if v.is_nan() || v <= 0.0 => 0.0,
        v => v.min(MAX_RADIANCE),
    };
    let (mut count, mut first) = (0u64, None);
    let gray = names[0] == names[1];
    for (at, texel) in values.iter_mut().enumerate() {
        for (k, v) in texel.iter_mut().enumerate() {
            let new = mended(*v);
            // NaN is unequal to all values.
            if new != *v && !(gray && k > 0) {
                count += 1;
                first.get_or_insert((at % width, at / width, k, *v, new));
            }
            *v = new;
        }
    }
    let (x, y, k, old, new) = first?;
    let name = &names[k];
    Some(if count == 1 {
        format!("{name} of pixel ({x}, {y}) is {old}, taken as {new}")
    } else {
        format!("{count} values are no radiances; the first, {name} of pixel ({x}, {y}), is {old}, taken as {new}")
    })
}

/// Refuses a picture that is too large.
fn check_size(name: &str, [w, h]: [u64; 2], sample_bytes: u64) -> Result<(), RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let texels = w.saturating_mul(h);
    if texels == 0 {
        return Err(bad(format!("{w} x {h} texels; use a picture of at least one")));
    }
    if texels > MAX_TEXELS {
        return Err(bad(format!("{w} x {h} texels; use a picture of at most {MAX_TEXELS}")));
    }
    check_room(&format!("{name}: a sky of {w} x {h} texels"), texels.saturating_mul(sample_bytes + TEXEL_BYTES))
}

fn read_radiance(file: BufReader<File>, name: &str, bytes: u64) -> Result<Picture, RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let decoder = HdrDecoder::new_nonstrict(file).map_err(|e| bad(e.to_string()))?;
    let (w, h) = decoder.dimensions();
    check_size(name, [w, h].map(u64::from), 12)?;
    if u64::from(h) * ROW_BYTES > bytes {
        return Err(bad(format!("{w} x {h} texels do not fit into {bytes} bytes; the file is cut off")));
    }
    // Header lines give the factors of the radiances.
    let about = decoder.metadata();
    let by = about.exposure.unwrap_or(1.0);
    let (r, g, b) = about.color_correction.unwrap_or((1.0, 1.0, 1.0));
    if let Some(wrong) = [by, r, g, b].into_iter().find(|v| !(v.is_finite() && *v > 0.0)) {
        return Err(bad(format!("EXPOSURE or COLORCORR is {wrong}; it is a finite number above 0")));
    }
    let image = image::DynamicImage::from_decoder(decoder).map_err(|e| bad(e.to_string()))?;
    let mut values = image.into_rgb32f().into_raw().as_chunks().0.to_vec();
    for texel in &mut values {
        *texel = [texel[0] / (by * r), texel[1] / (by * g), texel[2] / (by * b)];
    }
    Ok(Picture { width: w as usize, values, is_half: false, names: ["R", "G", "B"].map(String::from) })
}

/// Location of the colors in an EXR.
struct Colors {
    /// Index of the file's part.
    part: usize,
    /// Name of the layer; empty if unnamed.
    layer: String,
    kind: Kind,
    /// Names of the channels: red, green, blue; luminance and its two chromas; or three times the same.
    channels: [String; 3],
}

#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Kind {
    Rgb,
    Chroma,
    Luminance,
    /// Any single channel.
    Single,
}

/// Layers of a part with their channels: the name before the last dot, and those after it. The part's name is
/// prepended if they do not contain it.
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

/// All colors of a file, in its order.
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
                Some((Kind::Rgb, rgb))
            } else if let Some(chroma) = all([&["Y"], &["RY"], &["BY"]]) {
                Some((Kind::Chroma, chroma))
            } else if let Some(y) = of(&["Y"]).filter(|_| !is_vector) {
                Some((Kind::Luminance, one(y)))
            } else {
                match plain.collect::<Vec<_>>()[..] {
                    [(_, only)] => Some((Kind::Single, one(only.clone()))),
                    _ => None,
                }
            };
            found.extend(colors.map(|(kind, channels)| Colors { part, layer, kind, channels }));
        }
    }
    found
}

/// A readable list of at most a line.
fn listed(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    let more = names.len().saturating_sub(MAX_NAMES);
    let list = names[..names.len() - more].join(", ");
    if more > 0 { format!("{list} and {more} more") } else { list }
}

/// The layer of the given name, or else the one most likely to have the light.
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
    if kind == Kind::Single {
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

fn read_exr(
    mut file: BufReader<File>,
    name: &str,
    bytes: u64,
    layer: Option<&str>,
    notes: &mut Vec<String>,
) -> Result<Picture, RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let meta = exr::meta::MetaData::read_from_buffered(&mut file, false).map_err(|e| bad(e.to_string()))?;
    file.rewind().map_err(|source| RenderError::Io { file: name.into(), source })?;
    meta.headers.iter().try_for_each(|header| check_header(name, header, bytes))?;
    let colors = choose(&meta.headers, layer, notes).map_err(bad)?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(file)
        .map_err(|e| bad(e.to_string()))?;
    // The picture is the display window; the data may be a part of it, or reach beyond.
    let display = image.attributes.display_window;
    let [w, h] = [display.size.x(), display.size.y()];
    check_size(name, [w as u64, h as u64], 0)?;
    if let Some(c) = image.attributes.chromaticities
        && !is_srgb(&c)
    {
        notes.push("its primaries are not those of sRGB; its numbers are taken as linear sRGB all the same".into());
    }
    let gone = || bad("a channel of its header is not in its data".into());
    let part = image.layer_data.get(colors.part).ok_or_else(gone)?;
    let planes: Vec<&FlatSamples> = colors
        .channels
        .iter()
        .filter_map(|c| part.channel_data.list.iter().find(|have| have.name.to_string() == *c).map(|c| &c.sample_data))
        .collect();
    let [a, b, c] = planes[..] else { return Err(gone()) };
    let at = part.attributes.layer_position - display.position;
    let (wide, high) = (part.size.x(), part.size.y());
    let mut values = vec![[0.0f32; 3]; w * h];
    let mut outside = w * h;
    for y in 0..high {
        for x in 0..wide {
            let place = [x as i64 + i64::from(at.x()), y as i64 + i64::from(at.y())];
            if (0..w as i64).contains(&place[0]) && (0..h as i64).contains(&place[1]) {
                let k = y * wide + x;
                let read = [a, b, c].map(|plane| plane.value_by_flat_index(k).to_f32());
                values[place[1] as usize * w + place[0] as usize] = match colors.kind {
                    Kind::Chroma => of_chroma(read),
                    _ => read,
                };
                outside -= 1;
            }
        }
    }
    if outside > 0 {
        notes.push(format!("{outside} of {w} x {h} texels are outside its data window and dark"));
    }
    let names = if colors.kind == Kind::Chroma { ["R", "G", "B"].map(String::from) } else { colors.channels };
    Ok(Picture { width: w, values, is_half: matches!(a, FlatSamples::F16(_)), names })
}

/// Linear sRGB of luminance, (R - Y) / Y and (B - Y) / Y.
fn of_chroma([y, ry, by]: [f32; 3]) -> [f32; 3] {
    let (r, b) = ((1.0 + ry) * y, (1.0 + by) * y);
    [r, (y - LUMINANCE[0] * r - LUMINANCE[2] * b) / LUMINANCE[1], b]
}

fn is_srgb(c: &exr::meta::attribute::Chromaticities) -> bool {
    let near = |v: exr::math::Vec2<f32>, [x, y]: [f32; 2]| (v.x() - x).abs().max((v.y() - y).abs()) < 0.005;
    let [red, green, blue, white] = crate::picture::REC_709;
    near(c.red, red) && near(c.green, green) && near(c.blue, blue) && near(c.white, white)
}

/// Refuses an EXR by its header alone, before anything is allocated by the sizes that it claims.
fn check_header(name: &str, header: &Header, bytes: u64) -> Result<(), RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let [w, h] = [header.layer_size.x() as u64, header.layer_size.y() as u64];
    if header.deep {
        return Err(bad("deep pixels; a sky has one color a pixel: flatten it".into()));
    }
    if let Some(channel) = header.channels.list.iter().find(|c| c.sampling != exr::math::Vec2(1, 1)) {
        let channel = &channel.name;
        return Err(bad(format!("channel {channel} has fewer samples than pixels; save it as R, G, B, or Y alone")));
    }
    check_size(name, [w, h], header.channels.bytes_per_pixel as u64)?;
    // Every chunk has an entry in a table and a header.
    if (header.chunk_count as u64).saturating_mul(CHUNK_BYTES) > bytes {
        return Err(bad(format!("{w} x {h} texels do not fit into {bytes} bytes; the file is cut off")));
    }
    Ok(())
}
