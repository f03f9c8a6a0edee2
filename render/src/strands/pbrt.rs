//! Reads pbrt's text in one pass: transforms, blocks, objects, included files and curves.
//!
//! The rules are those of pbrt-v4 (`parser.cpp`, `scene.cpp`): a transform multiplies the current one from
//! the right, `WorldBegin` resets it, an object's curves retain the transform of their definition, and
//! instances multiply theirs from the left. Statements of pbrt-v2 and -v3 that v4 lacks are ignored, like all
//! statements without geometry.

use super::import_options::{MAX_BYTES, StrandFile, refuse_packed};
use super::pbrt_curve::{Curve, CurveAttributes};
use super::words::{Word, Words, number, shown};
use super::{Basis, StrandNotes, Strands};
use crate::RenderError;
use glam::{DMat4, DVec3};
use plywave::io::{AssetSource, Folder};
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

/// Largest depth of nested blocks.
const MAX_BLOCKS: usize = 10_000;
/// Largest depth of included files.
const MAX_FILES: usize = 32;
/// Largest number of files read, repetitions included.
const MAX_READ: usize = 100_000;
/// Largest number of instances, nested ones included.
const MAX_INSTANCES: usize = 1 << 22;
/// Largest depth of nested objects.
const MAX_WITHIN: usize = 64;
/// Number of points at which memory is checked first.
const FIRST_CHECK: usize = 1 << 20;

/// Ignored statements.
const PASSED: &[&[u8]] = &[
    b"Accelerator",
    b"AreaLightSource",
    b"ColorSpace",
    b"Exterior",
    b"Film",
    b"Integrator",
    b"Interior",
    b"LightSource",
    b"MakeNamedMaterial",
    b"MakeNamedMedium",
    b"Material",
    b"MediumInterface",
    b"NamedMaterial",
    b"Option",
    b"PixelFilter",
    b"Renderer",
    b"ReverseOrientation",
    b"Sampler",
    b"SurfaceIntegrator",
    b"Texture",
    b"TransformTimes",
    b"Volume",
    b"VolumeIntegrator",
    b"WorldEnd",
];
/// Interpreted statements.
const FOLLOWED: &[&[u8]] = &[
    b"ActiveTransform",
    b"Attribute",
    b"AttributeBegin",
    b"AttributeEnd",
    b"Camera",
    b"ConcatTransform",
    b"CoordSysTransform",
    b"CoordinateSystem",
    b"Identity",
    b"Import",
    b"Include",
    b"LookAt",
    b"ObjectBegin",
    b"ObjectEnd",
    b"ObjectInstance",
    b"Rotate",
    b"Scale",
    b"Shape",
    b"Transform",
    b"TransformBegin",
    b"TransformEnd",
    b"Translate",
    b"WorldBegin",
];

/// Whether a text is pbrt's: it does not begin with a number, and it begins with a statement or contains the
/// word `Shape`.
pub fn is(bytes: &[u8]) -> bool {
    let mut words = Words::new(bytes);
    let Ok(Some(first)) = words.next() else { return false };
    if number(&first).is_some() {
        return false;
    }
    let mut next = Some(first);
    while let Some(word) = next {
        if let Word::Bare(name) = word
            && (name == b"Shape" || word == first && [PASSED, FOLLOWED].iter().any(|list| list.contains(&name)))
        {
            return true;
        }
        next = words.next().ok().flatten();
    }
    false
}

/// Reads all curves of a text into strands.
pub fn read(
    bytes: &[u8],
    file: &str,
    options: &StrandFile,
    folder: Option<&Folder>,
    notes: &mut StrandNotes,
) -> Result<Strands, RenderError> {
    let mut reader = Reader {
        options,
        folder,
        notes,
        strands: Strands::new(Basis::BSpline),
        state: State {
            space: DMat4::IDENTITY,
            at_start: true,
            at_end: true,
            moves: false,
            attributes: CurveAttributes::default(),
        },
        blocks: Vec::new(),
        systems: HashMap::new(),
        objects: HashMap::new(),
        object: None,
        uses: Vec::new(),
        files: Path::new(file).file_name().iter().map(|name| name.to_string_lossy().into_owned()).collect(),
        read: [bytes.len() as u64, 1],
        points: 0,
        check_at: FIRST_CHECK,
    };
    reader.text(bytes, file)?;
    reader.notes.open_blocks += reader.blocks.len() as u64;
    reader.end_object();
    let objects = std::mem::take(&mut reader.objects);
    let mut instances = 0;
    for of in std::mem::take(&mut reader.uses) {
        reader.put(&of, &objects, &DMat4::IDENTITY, &mut Vec::new(), &mut instances)?;
    }
    Ok(reader.strands)
}

/// Graphics state, which blocks save and restore.
#[derive(Clone)]
struct State {
    /// The current transform.
    space: DMat4,
    /// Whether transforms apply at the start and at the end of the shutter interval.
    at_start: bool,
    at_end: bool,
    /// Whether the transforms at the start and at the end differ.
    moves: bool,
    /// Attributes that apply to all following curves.
    attributes: CurveAttributes,
}

#[derive(Clone, Copy, PartialEq)]
enum PbrtBlock {
    Attributes,
    Object,
}

/// An instance of an object.
struct Use {
    name: Vec<u8>,
    space: DMat4,
    moves: bool,
    file: String,
    line: usize,
}

/// An object: the contents between `ObjectBegin` and `ObjectEnd`.
#[derive(Default)]
struct Object {
    /// Curves in the object's space.
    curves: Vec<Curve>,
    uses: Vec<Use>,
    moves: bool,
}

struct Reader<'a> {
    options: &'a StrandFile,
    folder: Option<&'a Folder>,
    notes: &'a mut StrandNotes,
    strands: Strands,
    state: State,
    blocks: Vec<(State, PbrtBlock)>,
    /// Named coordinate systems.
    systems: HashMap<Vec<u8>, DMat4>,
    objects: HashMap<Vec<u8>, Object>,
    /// The object under definition.
    object: Option<(Vec<u8>, Object)>,
    uses: Vec<Use>,
    /// Stack of included files, by name relative to the folder of the first file.
    files: Vec<String>,
    /// Number of bytes and number of files read.
    read: [u64; 2],
    /// Number of control points so far, including those of objects.
    points: usize,
    check_at: usize,
}

impl Reader<'_> {
    /// Reads a whole text.
    fn text(&mut self, bytes: &[u8], file: &str) -> Result<(), RenderError> {
        let mut words = Words::new(bytes);
        let mut values = Vec::new();
        let mut points = Vec::new();
        loop {
            let next = words.next();
            let line = words.line;
            let bad = |what: String| RenderError::Strands { file: file.into(), what: format!("line {line}: {what}") };
            let name = match next.map_err(bad)? {
                None => return Ok(()),
                Some(Word::Bare(name)) => name,
                Some(word) => return Err(bad(format!("{} where a statement begins", word.shown()))),
            };
            match name {
                b"Shape" => {
                    let kind = words.quoted(name).map_err(bad)?;
                    if kind != b"curve" {
                        self.notes.count_shape(kind);
                        words.pass().map_err(bad)?;
                        continue;
                    }
                    let mut attributes = self.state.attributes;
                    points.clear();
                    attributes.read(&mut words, &mut values, &mut points).map_err(bad)?;
                    self.curve(&attributes, &points).map_err(|what| bad(format!("curve: {what}")))?;
                }
                b"Include" | b"Import" => {
                    let named = words.quoted(name).map_err(bad)?;
                    let named = std::str::from_utf8(named).map_err(|_| bad("a file's name that is no UTF-8".into()))?;
                    let before = (name == b"Import").then(|| (self.state.clone(), self.blocks.len()));
                    let (bytes, named) = self.include(named).map_err(bad)?;
                    let shown = self.folder.map_or_else(String::new, |folder| folder.display(&named));
                    self.files.push(named);
                    self.text(&bytes, &shown)?;
                    self.files.pop();
                    if let Some((state, blocks)) = before {
                        if self.blocks.len() < blocks {
                            return Err(bad("Import of a file that ends a block which it did not begin".into()));
                        }
                        self.state = state;
                        self.blocks.truncate(blocks);
                    }
                }
                b"ObjectInstance" => {
                    let of = Use {
                        name: words.quoted(name).map_err(bad)?.to_vec(),
                        space: self.state.space,
                        moves: self.state.moves,
                        file: file.to_string(),
                        line,
                    };
                    self.object.as_mut().map_or(&mut self.uses, |(_, object)| &mut object.uses).push(of);
                }
                _ if PASSED.contains(&name) => words.pass().map_err(bad)?,
                _ => self.statement(name, &mut words, &mut values).map_err(bad)?,
            }
        }
    }

    /// Reads a statement of transforms, blocks or attributes.
    fn statement<'w>(&mut self, name: &[u8], words: &mut Words<'w>, values: &mut Vec<Word<'w>>) -> Result<(), String> {
        match name {
            b"Identity" => self.transform(|_| DMat4::IDENTITY),
            b"Translate" => {
                let by = DMat4::from_translation(words.numbers(name)?.into());
                self.transform(|space| space * by);
            }
            b"Scale" => {
                let by = DMat4::from_scale(words.numbers(name)?.into());
                self.transform(|space| space * by);
            }
            b"Rotate" => {
                let [degrees, x, y, z] = words.numbers(name)?;
                let axis = DVec3::new(x, y, z).try_normalize().ok_or("Rotate about an axis of length 0")?;
                let by = DMat4::from_axis_angle(axis, degrees.to_radians());
                self.transform(|space| space * by);
            }
            b"LookAt" => {
                let v: [f64; 9] = words.numbers(name)?;
                let [eye, to, up] = [0, 3, 6].map(|k| DVec3::new(v[k], v[k + 1], v[k + 2]));
                let ahead = (to - eye).normalize_or_zero();
                let right = up.normalize_or_zero().cross(ahead).try_normalize();
                let right = right.ok_or("LookAt along its own up direction")?;
                let axes = [right, ahead.cross(right), ahead].map(|axis| axis.extend(0.0));
                let by = DMat4::from_cols(axes[0], axes[1], axes[2], eye.extend(1.0)).inverse();
                self.transform(|space| space * by);
            }
            b"Transform" => {
                let to = matrix(words.numbers(name)?)?;
                self.transform(|_| to);
            }
            b"ConcatTransform" => {
                let by = matrix(words.numbers(name)?)?;
                self.transform(|space| space * by);
            }
            b"CoordinateSystem" => {
                self.systems.insert(words.quoted(name)?.to_vec(), self.state.space);
            }
            b"CoordSysTransform" => {
                let of = words.quoted(name)?;
                let to = *self.systems.get(of).ok_or_else(|| format!("no coordinate system {} before", shown(of)))?;
                self.transform(|_| to);
            }
            b"ActiveTransform" => {
                let (start, end) = match words.next()? {
                    Some(Word::Bare(b"All")) => (true, true),
                    Some(Word::Bare(b"StartTime")) => (true, false),
                    Some(Word::Bare(b"EndTime")) => (false, true),
                    _ => return Err("ActiveTransform takes All, StartTime or EndTime".into()),
                };
                (self.state.at_start, self.state.at_end) = (start, end);
            }
            b"Camera" => {
                self.systems.insert(b"camera".to_vec(), self.state.space.inverse());
                words.pass()?;
            }
            b"WorldBegin" => {
                let State { space, at_start, at_end, moves, .. } = &mut self.state;
                (*space, *at_start, *at_end, *moves) = (DMat4::IDENTITY, true, true, false);
                self.systems.insert(b"world".to_vec(), DMat4::IDENTITY);
            }
            b"AttributeBegin" | b"TransformBegin" => self.begin(PbrtBlock::Attributes)?,
            b"AttributeEnd" | b"TransformEnd" => self.end(PbrtBlock::Attributes, name)?,
            b"ObjectBegin" => {
                let of = words.quoted(name)?;
                if self.object.is_some() {
                    return Err("ObjectBegin within an object".into());
                }
                if self.objects.contains_key(of) {
                    return Err(format!("object {} is defined twice", shown(of)));
                }
                self.begin(PbrtBlock::Object)?;
                self.object = Some((of.to_vec(), Object::default()));
            }
            b"ObjectEnd" => {
                self.end(PbrtBlock::Object, name)?;
                self.end_object();
            }
            b"Attribute" => match words.quoted(name)? {
                b"shape" => self.state.attributes.read(words, values, &mut Vec::new())?,
                _ => words.pass()?,
            },
            _ => return Err(format!("unknown statement {}; correct it, or take it out", shown(name))),
        }
        Ok(())
    }

    fn transform(&mut self, change: impl Fn(DMat4) -> DMat4) {
        let State { space, at_start, at_end, moves, .. } = &mut self.state;
        if *at_start {
            *space = change(*space);
        }
        *moves |= at_start != at_end;
    }

    fn begin(&mut self, block: PbrtBlock) -> Result<(), String> {
        if self.blocks.len() >= MAX_BLOCKS {
            return Err(format!("more than {MAX_BLOCKS} blocks within one another"));
        }
        self.blocks.push((self.state.clone(), block));
        Ok(())
    }

    fn end(&mut self, block: PbrtBlock, name: &[u8]) -> Result<(), String> {
        match self.blocks.pop_if(|(_, open)| *open == block) {
            Some((state, _)) => self.state = state,
            None => return Err(format!("{} without its beginning", String::from_utf8_lossy(name))),
        }
        Ok(())
    }

    fn end_object(&mut self) {
        if let Some((name, object)) = self.object.take() {
            self.objects.insert(name, object);
        }
    }

    /// Adds a curve to the object under definition, or to the strands.
    fn curve(&mut self, attributes: &CurveAttributes, points: &[DVec3]) -> Result<(), String> {
        let space = self.state.space;
        if space.determinant() == 0.0 {
            return Err("the transform flattens space (determinant 0); use scales other than 0".into());
        }
        let curve = attributes.curve(points)?.moved(&space);
        self.count(curve.points()).map_err(|e| e.to_string())?;
        match &mut self.object {
            Some((_, object)) => {
                object.moves |= self.state.moves;
                object.curves.push(curve);
            }
            None => {
                self.notes.moving += u64::from(self.state.moves);
                curve.add(&mut self.strands, self.options, self.notes)?;
            }
        }
        Ok(())
    }

    /// Checks the available memory each time the number of points has doubled.
    fn count(&mut self, points: usize) -> Result<(), RenderError> {
        self.points += points;
        if self.points > self.check_at {
            self.check_at = 2 * self.points;
            Strands::check_memory(self.check_at as u64)?;
        }
        Ok(())
    }

    /// Adds the curves of an instance, and of nested instances.
    fn put<'o>(
        &mut self,
        of: &'o Use,
        objects: &'o HashMap<Vec<u8>, Object>,
        outer: &DMat4,
        within: &mut Vec<&'o [u8]>,
        instances: &mut usize,
    ) -> Result<(), RenderError> {
        let place = format!("line {}: ObjectInstance {}", of.line, shown(&of.name));
        let bad = |what: String| RenderError::Strands { file: of.file.clone(), what: format!("{place}: {what}") };
        let object = objects.get(&of.name).ok_or_else(|| bad("no object of that name".into()))?;
        if within.contains(&&of.name[..]) {
            return Err(bad("the object is within itself".into()));
        }
        *instances += 1;
        if *instances > MAX_INSTANCES || within.len() >= MAX_WITHIN {
            return Err(bad(format!("more than {MAX_INSTANCES} instances, or {MAX_WITHIN} within one another")));
        }
        let space = *outer * of.space;
        if space.determinant() == 0.0 {
            return Err(bad("the transform flattens space (determinant 0); use scales other than 0".into()));
        }
        for curve in &object.curves {
            self.count(curve.points())?;
            self.notes.moving += u64::from(of.moves || object.moves);
            curve.clone().moved(&space).add(&mut self.strands, self.options, self.notes).map_err(bad)?;
        }
        within.push(&of.name);
        for inner in &object.uses {
            self.put(inner, objects, &space, within, instances)?;
        }
        within.pop();
        Ok(())
    }

    /// Bytes of an included file, and its name relative to the folder of the first file. The file is looked
    /// up in that folder, as in pbrt, or beside the including file.
    fn include(&mut self, named: &str) -> Result<(Vec<u8>, String), String> {
        let folder = self.folder.ok_or_else(|| format!("Include {named:?} without a folder to read it from"))?;
        let beside = self.files.last().and_then(|file| Path::new(file).parent()).map(|parent| parent.join(named));
        let names = [Some(PathBuf::from(named)), beside].into_iter().flatten().map(|path| plain(&path));
        let mut failed = String::new();
        for name in names {
            if self.files.contains(&name) {
                return Err(format!("Include {named:?}: the file includes itself"));
            }
            match folder.read(&name, MAX_BYTES.saturating_sub(self.read[0])) {
                Ok(bytes) => {
                    self.read = [self.read[0] + bytes.len() as u64, self.read[1] + 1];
                    if self.files.len() >= MAX_FILES || self.read[1] > MAX_READ as u64 {
                        return Err(format!("Include {named:?}: too many files, or too many within one another"));
                    }
                    refuse_packed(&bytes).map_err(|what| format!("Include {named:?}: {what}"))?;
                    self.notes.included.insert(folder.path(&name));
                    return Ok((bytes, name));
                }
                Err(error) => failed = format!("Include {named:?}: {error}"),
            }
        }
        Err(failed)
    }
}

/// A path with `.` and `name/..` removed.
fn plain(path: &Path) -> String {
    let mut parts: Vec<Component<'_>> = Vec::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if matches!(parts.last(), Some(Component::Normal(_))) => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    parts.iter().collect::<PathBuf>().to_string_lossy().into_owned()
}

/// A matrix in pbrt's order: column by column, with the last row 0, 0, 0, 1.
fn matrix(values: [f64; 16]) -> Result<DMat4, String> {
    let m = DMat4::from_cols_array(&values);
    let last = m.row(3);
    if last.truncate() != DVec3::ZERO || last.w == 0.0 {
        return Err("a matrix with perspective; its last row must be 0 0 0 1, which is every fourth number".into());
    }
    Ok(m * (1.0 / last.w))
}
