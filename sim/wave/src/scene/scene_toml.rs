//! Reader of a scene's TOML: from flat tables to bodies and lists of incidences. Only this file of the wave
//! code reads keys and degrees.
//!
//! It checks the range of every key, so that the solvers get valid bodies only.

use crate::scene::description::{Beams, Method, Scene, invalid};
use crate::{Body, C64, Shape, WaveError};
use plywave::spec::rules::number;
use std::path::Path;
use toml::{Table, Value};

/// Maximum size of a scene file that is read [bytes].
const MAX_BYTES: u64 = 4 << 20;
/// Maximum length of a list of wavelengths, angles or offsets.
const MAX_LIST: usize = 100_000;
/// Maximum number of fibers in a scene.
const MAX_FIBERS: usize = 2000;
/// Maximum depth of nested lumens.
const MAX_NEST: usize = 16;
/// Maximum number of corners of a polygon and of coefficients of a Fourier outline.
const MAX_POINTS: usize = 2000;
/// Highest harmonic of a Fourier outline.
const MAX_HARMONIC: i64 = 256;

/// Closed range of a wall's lengths [um].
const SIZE: (f64, f64) = (1e-4, 1e4);
/// Closed range of coordinates [um].
const PLACE: (f64, f64) = (-1e5, 1e5);

impl Scene {
    /// Reads a scene from its text.
    ///
    /// # Errors
    /// [`WaveError::Unreadable`] for text that is not TOML, [`WaveError::Invalid`] for a key that is unknown,
    /// absent or out of range, [`WaveError::SelfCrossing`], [`WaveError::Overlap`] and
    /// [`WaveError::LumenOutside`] for impossible walls.
    pub fn parse(text: &str) -> Result<Scene, WaveError> {
        let table: Table = toml::from_str(text).map_err(|e| {
            let at = e.span().and_then(|span| text.as_bytes().get(..span.start)).map(|head| {
                let line = 1 + head.iter().filter(|&&byte| byte == b'\n').count();
                format!("line {line}: ")
            });
            let what = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
            WaveError::Unreadable { what: at.unwrap_or_default() + &what, hint: "use TOML".into() }
        })?;
        let scene = read_scene(&SceneKeys { path: String::new(), table: &table })?;
        scene.check()?;
        Ok(scene)
    }

    /// Reads a scene from a file, and also returns the file's text. Messages do not name the file.
    ///
    /// # Errors
    /// The errors of [`Scene::parse`], and [`WaveError::Unreadable`] for a file that cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<(Scene, String), WaveError> {
        let unreadable = |what: String, hint: String| WaveError::Unreadable { what, hint };
        let text = plywave::io::read_text(path, MAX_BYTES).map_err(|error| match error {
            plywave::Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                unreadable("no such file".into(), "check the path".into())
            }
            plywave::Error::Io { source, .. } => unreadable(source.to_string(), "check the path and its rights".into()),
            plywave::Error::Format { what, hint, .. } => unreadable(what, hint),
            other => unreadable(other.to_string(), "check the file".into()),
        })?;
        Ok((Scene::parse(&text)?, text))
    }
}

/// A TOML table and the path by which messages name it.
struct SceneKeys<'a> {
    path: String,
    table: &'a Table,
}

impl<'a> SceneKeys<'a> {
    fn name(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) }
    }

    fn refuse<T>(&self, key: &str, hint: impl Into<String>) -> Result<T, WaveError> {
        let value = self.table.get(key).map_or("(absent)".to_string(), show);
        Err(invalid(&self.name(key), value, hint))
    }

    /// Refuses keys that are not among `known`.
    fn only(&self, known: &[&str]) -> Result<(), WaveError> {
        const UNITS: [&str; 2] = ["_um", "_deg"];
        let Some(key) = self.table.keys().find(|key| !known.contains(&key.as_str())) else { return Ok(()) };
        let other_unit = known.iter().find(|name| {
            UNITS
                .iter()
                .find_map(|unit| name.strip_suffix(unit))
                .is_some_and(|stem| key == stem || key.strip_prefix(stem).is_some_and(|rest| rest.starts_with('_')))
        });
        match other_unit {
            Some(name) => self.refuse(key, format!("unknown unit: use {name}")),
            None => self.refuse(key, format!("unknown key: use one of {}", known.join(", "))),
        }
    }

    /// A number in a closed range; `None` if the key is absent.
    fn maybe(&self, key: &str, (min, max): (f64, f64)) -> Result<Option<f64>, WaveError> {
        match self.table.get(key).map(number) {
            None => Ok(None),
            Some(Some(x)) if (min..=max).contains(&x) => Ok(Some(x)),
            Some(_) => self.refuse(key, format!("use a number from {min} to {max}")),
        }
    }

    /// A number in a closed range.
    fn must(&self, key: &str, range: (f64, f64)) -> Result<f64, WaveError> {
        match self.maybe(key, range)? {
            Some(x) => Ok(x),
            None => self.refuse(key, format!("give a number from {} to {}", range.0, range.1)),
        }
    }

    /// One or more numbers in a closed range; `None` if the key is absent.
    fn list(&self, key: &str, (min, max): (f64, f64)) -> Result<Option<Vec<f64>>, WaveError> {
        let Some(value) = self.table.get(key) else { return Ok(None) };
        let hint = || format!("use a list of 1 to {MAX_LIST} numbers from {min} to {max}");
        let Some(list) = value.as_array().filter(|list| (1..=MAX_LIST).contains(&list.len())) else {
            return self.refuse(key, hint());
        };
        let mut numbers = Vec::with_capacity(list.len());
        for (i, entry) in list.iter().enumerate() {
            match number(entry) {
                Some(x) if (min..=max).contains(&x) => numbers.push(x),
                _ => return Err(invalid(&format!("{}[{i}]", self.name(key)), show(entry), hint())),
            }
        }
        Ok(Some(numbers))
    }

    /// `[x, y]` in the range of coordinates; `None` if the key is absent.
    fn place(&self, key: &str) -> Result<Option<[f64; 2]>, WaveError> {
        let Some(value) = self.table.get(key) else { return Ok(None) };
        match tuple::<2>(value) {
            Some([x, y]) if within(x, PLACE) && within(y, PLACE) => Ok(Some([x, y])),
            _ => self.refuse(key, format!("use [x, y] within {} um of the origin", PLACE.1)),
        }
    }

    /// A list of `N`-tuples of finite numbers, `min_count` or more.
    fn tuples<const N: usize>(&self, key: &str, min_count: usize, what: &str) -> Result<Vec<[f64; N]>, WaveError> {
        let hint = || format!("use a list of {min_count} to {MAX_POINTS} {what}");
        let list = self.table.get(key).and_then(Value::as_array);
        let Some(list) = list.filter(|list| (min_count..=MAX_POINTS).contains(&list.len())) else {
            return self.refuse(key, hint());
        };
        let mut tuples = Vec::with_capacity(list.len());
        for (i, entry) in list.iter().enumerate() {
            match tuple(entry) {
                Some(t) => tuples.push(t),
                None => return Err(invalid(&format!("{}[{i}]", self.name(key)), entry, hint())),
            }
        }
        Ok(tuples)
    }

    /// One of these words; `None` if the key is absent.
    fn word(&self, key: &str, words: &[&str]) -> Result<Option<usize>, WaveError> {
        let Some(value) = self.table.get(key) else { return Ok(None) };
        match words.iter().position(|word| value.as_str() == Some(word)) {
            Some(i) => Ok(Some(i)),
            None => self.refuse(key, format!("use one of \"{}\"", words.join("\", \""))),
        }
    }
}

/// Text of a value; small and large numbers have an exponent.
fn show(value: &Value) -> String {
    match value {
        Value::Float(x) if x.is_finite() => format!("{x:?}"),
        other => other.to_string(),
    }
}

fn tuple<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(number).collect();
    numbers?.try_into().ok()
}

fn within(x: f64, (min, max): (f64, f64)) -> bool {
    (min..=max).contains(&x)
}

fn read_scene(keys: &SceneKeys<'_>) -> Result<Scene, WaveError> {
    keys.only(&["lambda_um", "theta_i_deg", "phi_i_deg", "n_phi_out", "tolerance", "method", "beam", "fiber"])?;
    let Some(lambda_um) = keys.list("lambda_um", (1e-2, 1e3))? else {
        return keys.refuse("lambda_um", "give a list of wavelengths");
    };
    let theta_i = keys.list("theta_i_deg", (-89.9, 89.9))?.unwrap_or_else(|| vec![0.0]);
    let Some(phi_i) = keys.list("phi_i_deg", (-360.0, 360.0))? else {
        return keys.refuse("phi_i_deg", "give a list of azimuths the light comes from");
    };
    let n_phi_out = match keys.table.get("n_phi_out") {
        None => 360,
        Some(Value::Integer(n)) if (1..=100_000).contains(n) => *n as usize,
        Some(_) => return keys.refuse("n_phi_out", "use an integer from 1 to 100000"),
    };
    let tolerance = match keys.table.get("tolerance").map(number) {
        None => 1e-6,
        Some(Some(x)) if (1e-13..=0.1).contains(&x) => x,
        Some(_) => return keys.refuse("tolerance", "use a number from 1e-13, the least that rounding allows, to 0.1"),
    };
    let method = keys.word("method", &Method::ALL.map(Method::name))?.map_or(Method::Auto, |i| Method::ALL[i]);
    let beams = match keys.table.get("beam") {
        None => None,
        Some(Value::Table(table)) => Some(read_beams(&SceneKeys { path: keys.name("beam"), table })?),
        Some(_) => return keys.refuse("beam", "use a table, [beam]"),
    };
    let fibers: &[Value] = match keys.table.get("fiber") {
        None => return keys.refuse("fiber", "give one or more [[fiber]]"),
        Some(Value::Array(fibers)) if (1..=MAX_FIBERS).contains(&fibers.len()) => fibers,
        Some(Value::Array(fibers)) => {
            let hint = format!("use 1 to {MAX_FIBERS}");
            return Err(invalid("fiber", format!("{} of them", fibers.len()), hint));
        }
        Some(_) => return keys.refuse("fiber", "use double brackets, [[fiber]]"),
    };
    let mut bodies = Vec::with_capacity(fibers.len());
    for (i, fiber) in fibers.iter().enumerate() {
        let path = format!("fiber[{i}]");
        match fiber {
            Value::Table(table) => bodies.push(read_body(&SceneKeys { path, table }, None)?),
            other => return Err(invalid(&path, other, "use tables, [[fiber]]")),
        }
    }
    let radians = |list: Vec<f64>| list.into_iter().map(f64::to_radians).collect();
    Ok(Scene {
        lambda_um,
        theta_i: radians(theta_i),
        phi_i: radians(phi_i),
        n_phi_out,
        tolerance,
        method,
        beams,
        bodies,
    })
}

fn read_beams(keys: &SceneKeys<'_>) -> Result<Beams, WaveError> {
    keys.only(&["w0_um", "h_um"])?;
    let w0_um = keys.must("w0_um", (1e-3, 1e5))?;
    let h_um = keys.list("h_um", (-1e5, 1e5))?.unwrap_or_else(|| vec![0.0]);
    Ok(Beams { w0_um, h_um })
}

/// Reads a fiber, or the lumen of `outer`, which comes with its nesting depth.
fn read_body(keys: &SceneKeys<'_>, outer: Option<(&Body, usize)>) -> Result<Body, WaveError> {
    const SHAPES: [(&str, &[&str]); 4] = [
        ("circle", &["radius_um"]),
        ("ellipse", &["a_um", "b_um"]),
        ("fourier", &["coeffs"]),
        ("polygon", &["points_um", "rounding_um"]),
    ];
    let Some(shape) = keys.word("shape", &SHAPES.map(|(name, _)| name))? else {
        return keys.refuse("shape", "give \"circle\", \"ellipse\", \"fourier\" or \"polygon\"");
    };
    let (name, own) = SHAPES[shape];
    keys.only(&[own, &["shape", "center_um", "rotation_deg", "eta", "kappa", "lumen"]].concat())?;
    let shape = match name {
        "circle" => Shape::Circle { radius_um: keys.must("radius_um", SIZE)? },
        "ellipse" => {
            let (a_um, b_um) = (keys.must("a_um", SIZE)?, keys.must("b_um", SIZE)?);
            if a_um.max(b_um) > 1000.0 * a_um.min(b_um) {
                return keys.refuse("b_um", format!("use a value within a factor of 1000 of a_um = {a_um}"));
            }
            Shape::Ellipse { a_um, b_um }
        }
        "fourier" => Shape::Fourier { coeffs: read_coeffs(keys)? },
        _ => {
            let points_um = keys.tuples::<2>("points_um", 3, "corners [x, y]")?;
            if let Some(p) = points_um.iter().find(|p| !p.iter().all(|&x| within(x, PLACE))) {
                let hint = format!("use corners within {} um of the origin", PLACE.1);
                return Err(invalid(&keys.name("points_um"), format!("[{}, {}]", p[0], p[1]), hint));
            }
            Shape::Polygon { points_um, rounding_um: keys.must("rounding_um", SIZE)? }
        }
    };
    const ETA: (f64, f64) = (1e-3, 100.0);
    let eta = match outer {
        Some(_) => keys.maybe("eta", ETA)?.unwrap_or(1.0),
        None => keys.must("eta", ETA)?,
    };
    let kappa = keys.maybe("kappa", (0.0, 100.0))?.unwrap_or(0.0);
    let center_um = keys.place("center_um")?.or(outer.map(|(b, _)| b.center_um)).unwrap_or([0.0; 2]);
    let rotation = keys.maybe("rotation_deg", (-360.0, 360.0))?.map(f64::to_radians);
    let rotation_rad = rotation.or(outer.map(|(b, _)| b.rotation_rad)).unwrap_or(0.0);
    let mut body = Body { shape, center_um, rotation_rad, eta, kappa, lumen: None };
    let depth = outer.map_or(0, |(_, depth)| depth);
    match keys.table.get("lumen") {
        None => {}
        Some(_) if depth == MAX_NEST => {
            return Err(invalid(&keys.name("lumen"), "(a table)", format!("use {MAX_NEST} nested lumens at most")));
        }
        Some(Value::Table(table)) => {
            let lumen = read_body(&SceneKeys { path: keys.name("lumen"), table }, Some((&body, depth + 1)))?;
            body.lumen = Some(Box::new(lumen));
        }
        Some(_) => return keys.refuse("lumen", "use a table, [fiber.lumen]"),
    }
    Ok(body)
}

fn read_coeffs(keys: &SceneKeys<'_>) -> Result<Vec<(i32, C64)>, WaveError> {
    let triples = keys.tuples::<3>("coeffs", 1, "triples [k, re, im]")?;
    let mut coeffs: Vec<(i32, C64)> = Vec::with_capacity(triples.len());
    for (i, &[k, re, im]) in triples.iter().enumerate() {
        let refuse =
            |hint: String| Err(invalid(&format!("{}[{i}]", keys.name("coeffs")), format!("[{k}, {re}, {im}]"), hint));
        if k.fract() != 0.0 || k.abs() > MAX_HARMONIC as f64 {
            return refuse(format!("use an integer k from -{MAX_HARMONIC} to {MAX_HARMONIC}"));
        }
        if re.abs() > PLACE.1 || im.abs() > PLACE.1 {
            return refuse(format!("use parts of {} um at most", PLACE.1));
        }
        if coeffs.iter().any(|&(other, _)| other == k as i32) {
            return refuse("this k is given twice; leave one out".into());
        }
        coeffs.push((k as i32, C64::new(re, im)));
    }
    let size = coeffs.iter().filter(|(k, _)| *k != 0).map(|(_, c)| c.norm()).fold(0.0, f64::max);
    if !within(size, SIZE) {
        let hint = format!("give at least one c_k with k other than 0, the largest from {} to {} um", SIZE.0, SIZE.1);
        return keys.refuse("coeffs", hint);
    }
    Ok(coeffs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarization;
    use crate::scene::description::degrees;
    use proptest::prelude::*;

    const FULL: &str = r#"
lambda_um = [0.4, 0.55]
theta_i_deg = [0, -30.0]
phi_i_deg = [90, 12.5]
n_phi_out = 180
tolerance = 1e-5
method = "nystrom"

[beam]
w0_um = 10.0
h_um = [-5.0, 0.0, 5.0]

[[fiber]]
shape = "ellipse"
a_um = 7.5
b_um = 6.0
center_um = [1.0, 2.0]
rotation_deg = 30.0
eta = 1.55
kappa = 1e-4
[fiber.lumen]
shape = "circle"
radius_um = 2.0
[fiber.lumen.lumen]
shape = "circle"
radius_um = 1.0
center_um = [1.5, 2.0]
eta = 1.33

[[fiber]]
shape = "fourier"
coeffs = [[1, 3.0, 0.0], [-2, 0.3, 0.1]]
center_um = [20.0, 0.0]
eta = 1.5

[[fiber]]
shape = "polygon"
points_um = [[0, 0], [5, 0], [0, 5]]
rounding_um = 0.5
center_um = [-20.0, 0.0]
eta = 1.5
"#;
    const MIN: &str = "lambda_um = [0.5]\nphi_i_deg = [0]\n[[fiber]]\nshape = \"circle\"\nradius_um = 1\neta = 1.5\n";

    #[test]
    fn all_keys_are_read() {
        let scene = Scene::parse(FULL).unwrap();
        assert_eq!(scene.lambda_um, [0.4, 0.55]);
        assert_eq!(scene.theta_i, [0.0, -30.0f64.to_radians()]);
        assert_eq!(scene.phi_i, [90.0f64.to_radians(), 12.5f64.to_radians()]);
        assert_eq!((scene.n_phi_out, scene.tolerance, scene.method), (180, 1e-5, Method::Nystrom));
        assert_eq!(scene.beams, Some(Beams { w0_um: 10.0, h_um: vec![-5.0, 0.0, 5.0] }));
        assert_eq!(scene.cases(), 2 * 2 * 2 * 3 * 2);
        assert_eq!(scene.bodies.len(), 3);
        let fiber = &scene.bodies[0];
        assert_eq!(fiber.index(), C64::new(1.55, 1e-4));
        // By default a lumen is air about its fiber's center with the fiber's rotation; its center is in the
        // scene's frame.
        let lumen = fiber.lumen.as_deref().unwrap();
        assert_eq!((lumen.center_um, lumen.rotation_rad), (fiber.center_um, fiber.rotation_rad));
        assert_eq!((lumen.eta, lumen.kappa), (1.0, 0.0));
        let core = lumen.lumen.as_deref().unwrap();
        assert_eq!((core.center_um, core.eta), ([1.5, 2.0], 1.33));
        assert_eq!(
            scene.bodies[1].shape,
            Shape::Fourier { coeffs: vec![(1, C64::new(3.0, 0.0)), (-2, C64::new(0.3, 0.1))] }
        );
    }

    #[test]
    fn silent_keys_take_their_defaults() {
        let scene = Scene::parse(MIN).unwrap();
        assert_eq!((scene.theta_i, scene.n_phi_out, scene.tolerance), (vec![0.0], 360, 1e-6));
        assert_eq!((scene.method, scene.beams), (Method::Auto, None));
        let fiber = &scene.bodies[0];
        assert_eq!((fiber.center_um, fiber.rotation_rad, fiber.kappa, &fiber.lumen), ([0.0; 2], 0.0, 0.0, &None));
        let beam = Scene::parse(&MIN.replace("[[fiber]]", "[beam]\nw0_um = 5\n[[fiber]]")).unwrap();
        assert_eq!(beam.beams.unwrap().h_um, [0.0]);
    }

    /// Cases by wavelength, latitude, azimuth, offset, polarization, the last fastest.
    #[test]
    fn cases_are_ordered() {
        let scene = Scene::parse(FULL).unwrap();
        let waves: Vec<(f64, f64)> = scene.waves().iter().map(|w| (w.lambda_um, degrees(w.theta_i))).collect();
        assert_eq!(waves, [(0.4, 0.0), (0.4, -30.0), (0.55, 0.0), (0.55, -30.0)]);
        let sources = scene.sources();
        let got: Vec<(f64, f64, bool)> = sources
            .iter()
            .map(|s| (degrees(s.phi_i), s.beam.unwrap().h_um, s.pol == Polarization::Tm))
            .take(7)
            .collect();
        let want = [(90.0, -5.0, true), (90.0, -5.0, false), (90.0, 0.0, true), (90.0, 0.0, false)];
        assert_eq!(got[..4], want);
        assert_eq!(got[6], (12.5, -5.0, true));
        assert_eq!(sources.len() * waves.len(), scene.cases());
    }

    /// Every refusal names its key and is one line.
    #[test]
    fn bad_values_are_refused() {
        let edits: &[(&str, &str, &[&str])] = &[
            ("[0.4, 0.55]", "[]", &["lambda_um", "[]"]),
            ("[0.4, 0.55]", "0.4", &["lambda_um", "list"]),
            ("[0.4, 0.55]", "[0.4, 0.0]", &["lambda_um[1]", "0.0"]),
            ("[0.4, 0.55]", "[0.4, nan]", &["lambda_um[1]", "nan"]),
            ("[0.4, 0.55]", "[-0.4]", &["lambda_um[0]", "-0.4"]),
            ("[0.4, 0.55]", "[\"0.4\"]", &["lambda_um[0]"]),
            ("lambda_um", "lambda_nm", &["lambda_nm", "use lambda_um"]),
            ("theta_i_deg", "theta_i_rad", &["theta_i_rad", "use theta_i_deg"]),
            ("[0, -30.0]", "[90]", &["theta_i_deg[0]", "90"]),
            ("[0, -30.0]", "[-inf]", &["theta_i_deg[0]", "-inf"]),
            ("phi_i_deg = [90, 12.5]", "", &["phi_i_deg", "absent"]),
            ("[90, 12.5]", "[361]", &["phi_i_deg[0]", "361"]),
            ("n_phi_out = 180", "n_phi_out = 0", &["n_phi_out", "0"]),
            ("n_phi_out = 180", "n_phi_out = 1.5", &["n_phi_out", "1.5"]),
            ("n_phi_out = 180", "n_phi_out = 1000000000", &["n_phi_out"]),
            ("tolerance = 1e-5", "tolerance = 0", &["tolerance", "0"]),
            ("tolerance = 1e-5", "tolerance = 1e-16", &["tolerance", "1e-16", "1e-13"]),
            ("tolerance = 1e-5", "tolerance = nan", &["tolerance", "nan"]),
            ("\"nystrom\"", "\"magic\"", &["method", "magic", "compressed"]),
            ("\"nystrom\"", "7", &["method", "7"]),
            ("w0_um = 10.0", "w0_um = 0", &["beam.w0_um", "0"]),
            ("w0_um = 10.0", "w0_um = 0.3", &["beam.w0_um", "0.3"]),
            ("w0_um = 10.0", "", &["beam.w0_um", "absent"]),
            ("h_um = [-5.0, 0.0, 5.0]", "h_um = []", &["beam.h_um"]),
            ("h_um = [-5.0, 0.0, 5.0]", "h = [1]", &["beam.h", "h_um"]),
            ("\"ellipse\"", "\"square\"", &["fiber[0].shape", "square", "polygon"]),
            ("a_um = 7.5", "a_um = -7.5", &["fiber[0].a_um", "-7.5"]),
            ("a_um = 7.5", "a_um = 1e9", &["fiber[0].a_um"]),
            ("a_um = 7.5", "radius_um = 7.5", &["fiber[0].radius_um", "unknown"]),
            ("[1.0, 2.0]", "[1.0, nan]", &["fiber[0].center_um", "nan"]),
            ("[1.0, 2.0]", "[1.0]", &["fiber[0].center_um"]),
            ("eta = 1.55", "eta = 0", &["fiber[0].eta"]),
            ("eta = 1.55", "", &["fiber[0].eta", "absent"]),
            ("eta = 1.55", "eta = inf", &["fiber[0].eta", "inf"]),
            ("kappa = 1e-4", "kappa = -1e-4", &["fiber[0].kappa", "-0.0001"]),
            ("eta = 1.33", "eta = 0.5", &["fiber[0].lumen.lumen.eta", "0.5", "-30"]),
            ("[1.5, 2.0]", "[2.5, 2.0]", &["fiber[0].lumen", "fiber[0].lumen.lumen", "overlap"]),
            ("[1.5, 2.0]", "[9.5, 2.0]", &["fiber[0].lumen.lumen", "outside"]),
            ("coeffs = [[1, 3.0, 0.0]", "coeffs = [[1, 3.0]", &["fiber[1].coeffs[0]"]),
            ("coeffs = [[1, 3.0, 0.0]", "coeffs = [[1.5, 3.0, 0.0]", &["fiber[1].coeffs[0]", "1.5"]),
            ("[1, 3.0, 0.0], [-2, 0.3, 0.1]", "[0, 3.0, 0.0]", &["fiber[1].coeffs", "other than 0"]),
            ("[-2, 0.3, 0.1]", "[1, 0.3, 0.1]", &["fiber[1].coeffs[1]", "twice"]),
            ("[-2, 0.3, 0.1]", "[-2, 3.0, 0.1]", &["fiber[1]", "crosses itself"]),
            ("[20.0, 0.0]", "[8.0, 0.0]", &["fiber[0]", "fiber[1]", "overlap"]),
            ("[[0, 0], [5, 0], [0, 5]]", "[[0, 0], [5, 0]]", &["fiber[2].points_um", "3 to"]),
            ("[[0, 0], [5, 0], [0, 5]]", "[[0, 0], [5, 0], [0, 1e7]]", &["fiber[2].points_um", "10000000"]),
            ("rounding_um = 0.5", "rounding_um = 5", &["fiber[2].rounding_um", "5"]),
            ("rounding_um = 0.5", "rounding_um = 0", &["fiber[2].rounding_um"]),
            ("[beam]", "beam = 3\n[else]", &["beam"]),
            ("[fiber.lumen]", "[fiber.lumens]", &["fiber[0].lumens", "unknown"]),
            ("lambda_um = ", "lambda_um = = ", &["line 2"]),
        ];
        for (from, to, words) in edits {
            assert!(FULL.contains(from), "{from}");
            let error = Scene::parse(&FULL.replacen(from, to, 1)).expect_err(to).to_string();
            for word in *words {
                assert!(error.contains(word), "{to}: no {word:?} in {error}");
            }
            assert_eq!(error.lines().count(), 1, "{error}");
        }
        for text in ["", "fiber = 3", "fiber = []", "fiber = [1]", "[fiber]"] {
            let error = Scene::parse(&format!("lambda_um = [0.5]\nphi_i_deg = [0]\n{text}")).unwrap_err().to_string();
            assert!(error.starts_with("fiber"), "{error}");
        }
    }

    /// Runs too large to hold are refused at once, by their number.
    #[test]
    fn too_many_cases_are_refused() {
        let list = (0..3000).map(|i| format!("{}", 0.3 + 1e-4 * f64::from(i))).collect::<Vec<_>>().join(",");
        let text = MIN.replace("[0.5]", &format!("[{list}]")).replace("[0]", &format!("[{list}]"));
        let error = Scene::parse(&text).unwrap_err().to_string();
        assert!(error.contains("18000000 cases") && error.contains("1.3e10"), "{error}");
    }

    #[test]
    fn deep_nests_are_refused() {
        let nest = |n: usize, close: &str| format!("{MIN}lumen{} = 1\n{close}", ".lumen".repeat(n));
        for n in [0, 5, 40, 500] {
            assert!(Scene::parse(&nest(n, "")).is_err());
        }
        let mut text = MIN.replace("radius_um = 1\n", "radius_um = 100\n");
        for i in 1..=20 {
            text += &format!("[fiber{}]\nshape = \"circle\"\nradius_um = {}\n", ".lumen".repeat(i), 100 - i);
        }
        let error = Scene::parse(&text).unwrap_err().to_string();
        assert!(error.contains("16 nested"), "{error}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]

        /// No text makes the parser panic; accepted scenes pass their own check.
        #[test]
        fn any_text_is_taken_or_refused(text in "\\PC{0,200}") {
            if let Ok(scene) = Scene::parse(&text) {
                prop_assert!(scene.check().is_ok());
            }
        }

        /// A valid scene with a piece replaced by another token does not either.
        #[test]
        fn any_edit_is_taken_or_refused(
            at in 0..FULL.len(), cut in 0usize..12,
            token in prop::sample::select(vec![
                "", "nan", "-inf", "1e308", "-1e308", "1e-320", "0", "-1", "[", "]", "[[", "[]", "\"", "=", "\n", "{}", "99999999999999999999",
                "[1, 1]", "\"circle\"", "true", "1979-05-27", "[fiber.lumen]", "0.0", ",", "\u{0}",
            ]),
        ) {
            let mut text = FULL.to_string();
            let end = (at + cut).min(text.len());
            text.replace_range(at..end, token);
            if let Ok(scene) = Scene::parse(&text) {
                prop_assert!(scene.check().is_ok());
                prop_assert!(scene.bodies.iter().all(|b| b.eta > 0.0 && b.kappa >= 0.0));
            }
        }

        /// Angles are restored from radians as written.
        #[test]
        fn degrees_come_back(tenths in -3600i32..3600) {
            let angle = f64::from(tenths) / 10.0;
            prop_assert_eq!(degrees(angle.to_radians()), angle);
        }
    }
}
