//! The ply model of a yarn's strands: its spec, and which models are as good.

use crate::yarn::YarnOfCloth;
use crate::yarn::fibers::is_monofilament;
use plywave::Result;
use plywave::spec::rules::invalid;
use plywave::spec::{FiberSpec, Packing, PlySpec, YarnSpec};

/// Largest number of fibers in a strand that is simulated.
pub(crate) const MAX_FIBERS: u32 = 200;

/// Relative difference of radii up to which a model stands for a strand.
const RADII: f64 = 0.02;
/// Relative difference of numbers of fibers up to which it does.
const FIBERS: f64 = 0.05;
/// Difference of the angles of the fibers at the rim up to which it does [rad].
const ANGLES: f64 = 0.02;

impl YarnOfCloth {
    /// Spec of the ply model of a strand. `file` and the `name` of the yarn's table identify it in errors.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for a strand that cannot be simulated, such as one of too many fibers.
    pub fn ply(&self, file: &str, name: &str) -> Result<YarnSpec> {
        if self.fibers > MAX_FIBERS {
            let hint = format!("a strand of {MAX_FIBERS} fibers at most can be simulated; use more bundles, 7 or 19");
            return Err(invalid(file, &format!("{name}.fibers"), self.fibers, hint));
        }
        let mut fiber = self.fiber.spec.clone();
        let mut tenths = 10.0 * self.strand_radius_um();
        if is_monofilament(self.fibers, &fiber) {
            // Fibers of one size have no jitter from fiber to fiber, and the ply contains its fiber.
            fiber.size_jitter = 0.0;
            tenths = tenths.ceil();
        }
        let radius_um = tenths.round() / 10.0;
        let (hand, turns) = self.fiber_twist;
        let is_bundle = self.bundles > 1;
        let what = if is_bundle { "bundle" } else { "single" };
        let spec = YarnSpec {
            name: format!("{} {what} of {}", self.fiber.name, self.count),
            fiber,
            blend: None,
            ply: PlySpec {
                fibers: self.fibers,
                radius_um: Some(radius_um),
                radii_um: None,
                min_gap_um: if is_bundle { 0.1 } else { 0.2 },
                packing: Packing::Falling,
                fiber_pitch_um: (turns > 0.0).then(|| (1e6 / turns).round()),
                handedness: hand,
            },
            yarn: Default::default(),
            beam: Default::default(),
            absorption: Default::default(),
            simulation: Default::default(),
            family: None,
        };
        spec.check(&format!("{file} ({name})"))?;
        Ok(spec)
    }
}

fn near(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * a.abs().max(b.abs())
}

/// Whether a model of the ply `model` stands for the ply `wanted`: the same fibers, radii within 2 %, numbers
/// of fibers within 5 %, fibers at the rim that lean alike within 0.02 rad.
pub fn alike(wanted: &YarnSpec, model: &YarnSpec) -> bool {
    let ([a, b], [c, d]) = (wanted.ply_radii_um(), model.ply_radii_um());
    let angle = |spec: &YarnSpec| (spec.ply.twist().rad_per_um() * spec.ply_radii_um()[0]).atan();
    same_fiber(&wanted.fiber, &model.fiber)
        && match (&wanted.blend, &model.blend) {
            (None, None) => true,
            (Some(a), Some(b)) => near(a.share, b.share, 0.01) && a.dye == b.dye && same_fiber(&a.fiber, &b.fiber),
            _ => false,
        }
        && model.yarn.plies == 1
        && model.ply.packing == wanted.ply.packing
        && near(a, c, RADII)
        && near(b, d, RADII)
        && near(f64::from(wanted.ply.fibers), f64::from(model.ply.fibers), FIBERS)
        && (angle(wanted) - angle(model)).abs() <= ANGLES
        && wanted.beam == model.beam
}

/// Whether two kinds of fibers are the same but for rounding.
fn same_fiber(a: &FiberSpec, b: &FiberSpec) -> bool {
    let numbers = |fiber: &FiberSpec| {
        let table = toml::Table::try_from(fiber).unwrap_or_default();
        let mut numbers = Vec::new();
        collect(&toml::Value::Table(table), &mut String::new(), &mut numbers);
        numbers
    };
    let (a, b) = (numbers(a), numbers(b));
    let same = |((name, x), (other, y)): (&(String, f64), &(String, f64))| name == other && near(*x, *y, 0.01);
    a.len() == b.len() && a.iter().zip(&b).all(same)
}

/// The numbers of a value with their paths; texts are part of the path.
fn collect(value: &toml::Value, path: &mut String, numbers: &mut Vec<(String, f64)>) {
    use toml::Value;
    let length = path.len();
    match value {
        Value::Table(table) => {
            for (name, value) in table {
                *path += &format!(".{name}");
                collect(value, path, numbers);
                path.truncate(length);
            }
        }
        Value::Array(list) => list.iter().for_each(|value| collect(value, path, numbers)),
        Value::String(text) => numbers.push((format!("{path}={text}"), 0.0)),
        other => numbers.push((path.clone(), plywave::spec::rules::number(other).unwrap_or(0.0))),
    }
}
