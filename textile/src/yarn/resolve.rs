//! From the keys of a yarn to the yarn: what a label leaves open follows from what it says.
//!
//! Number of fibers in a strand: the area of the fibers of the count over that of a fiber. Radius of a
//! strand: that area over the packing. A round single has the packing of its fiber; cut into bundles that
//! touch, each bundle has that packing times the square of the yarn's radius over that of all bundles, but
//! not more than so few fibers can have.

use crate::yarn::count::{Count, fiber_area_um2, round_radius_um};
use crate::yarn::fibers::{self, Fiber, is_monofilament};
use crate::yarn::finish::Finish;
use crate::yarn::hairs::Hairs;
use crate::yarn::keys::UNDYED;
use crate::yarn::ply::MAX_FIBERS;
use crate::yarn::stripe::Stripe;
use crate::yarn::twist::YarnTwist;
use crate::yarn::{Derived, YarnOfCloth, reach, stripes};
use plywave::cloth::{Slits, Unevenness, YarnColor};
use plywave::color::srgb_of_value;
use plywave::spec::rules::{invalid, number};
use plywave::spec::{FiberSpec, Handedness, Shape as FiberShape};
use plywave::{Error, Result};
use std::f64::consts::PI;
use toml::{Table, Value};

/// Default length over which uneven yarns change [mm].
const USUAL_MM: f64 = 10.0;
/// Largest angle of the fibers at the rim of a yarn to its axis [rad]; beyond it twist makes no yarn, but
/// kinks it (J. W. S. Hearle, P. Grosberg and S. Backer, "Structural Mechanics of Fibers, Yarns, and
/// Fabrics", 1969: crepe yarns come near it).
const MAX_ANGLE: f64 = 0.25 * PI;
/// Shares of a section that fibers can fill: below, there is no yarn; above, no room.
const PACKINGS: std::ops::RangeInclusive<f64> = 0.1..=0.9;
/// Number of fibers of a single from which it is made of bundles, in a weave: each then has ten.
const BUNDLED: f64 = 70.0;
/// Number of filaments of a flat yarn from which it is made of bundles.
const BUNDLED_FILAMENTS: f64 = 28.0;

/// Where a yarn is used, which decides how it is bundled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Use {
    /// Crossed by others, which flatten it.
    Woven,
    /// In loops, or alone.
    Loose,
}

/// Shares of a strand that 1 to 6 fibers fill at random in every draw of their sizes: near the densest of
/// equal circles in a circle, and what fibers of other shapes and sizes reach (measured by packing them).
const FEW_EVEN: [f64; 6] = [1.0, 0.42, 0.58, 0.638, 0.637, 0.62];
const FEW: [f64; 6] = [0.2, 0.33, 0.43, 0.54, 0.54, 0.55];
/// The same of 7 to 17 round fibers of several sizes, and of other fibers, which nest.
const SOME: [f64; 2] = [0.54, 0.69];
/// The same of 74 fibers and more.
const MANY: f64 = 0.78;
/// Largest relative deviation of the sizes of fibers that count as equal.
const EVEN: f64 = 0.03;

/// Largest share of a strand's section that so many fibers usually fill, drawn at random.
fn max_packing(fibers: u32, fiber: &FiberSpec) -> f64 {
    let is_round = matches!(fiber.shape, FiberShape::Circle { .. } | FiberShape::HollowCircle { .. });
    let is_even = is_round && (fiber.size_jitter <= EVEN || fibers == 1);
    let few = if is_even { FEW_EVEN } else { FEW };
    match few.get(fibers.saturating_sub(1) as usize) {
        Some(few) => *few,
        None => {
            let some = SOME[usize::from(is_even || !is_round)];
            some + (MANY - some) * ((f64::from(fibers) / 17.0).ln() / (74.0f64 / 17.0).ln()).clamp(0.0, 1.0)
        }
    }
}

/// The keys of a yarn, which passed their rules, and what was derived so far.
struct Reader<'a> {
    file: &'a str,
    /// Name of the yarn's table.
    name: &'a str,
    keys: &'a Table,
    derived: Vec<Derived>,
}

impl Reader<'_> {
    fn number(&self, key: &str) -> Option<f64> {
        self.keys.get(key).and_then(number)
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.keys.get(key).and_then(Value::as_str)
    }

    fn integer(&self, key: &str) -> Option<u32> {
        self.keys.get(key).and_then(Value::as_integer).map(|n| n as u32)
    }

    fn twist(&self, key: &str) -> Option<YarnTwist> {
        self.text(key).and_then(|text| text.parse().ok())
    }

    fn refuse(&self, key: &str, value: impl ToString, hint: impl Into<String>) -> Error {
        invalid(self.file, &format!("{}.{key}", self.name), value.to_string(), hint)
    }

    fn absent(&self, key: &str) -> Error {
        self.refuse(key, "(absent)", "this key must be given")
    }

    /// Refuses two keys of which one is enough.
    fn refuse_both(&self, key: &str, other: &str) -> Result<()> {
        match (self.keys.get(key), self.keys.get(other)) {
            (Some(value), Some(_)) => Err(self.refuse(key, value, format!("give either {other} or {key}, not both"))),
            _ => Ok(()),
        }
    }

    fn derive(&mut self, key: &'static str, value: String, from: String) {
        self.derived.push(Derived { key, value, from });
    }

    /// The fibers, and the count.
    fn material(&mut self) -> Result<(Fiber, Count)> {
        let value = self.keys.get("fiber").ok_or_else(|| self.absent("fiber"))?;
        let mut fiber = fibers::read(self.file, &format!("{}.fiber", self.name), value)?;
        let count: Count = self.text("count").and_then(|text| text.parse().ok()).ok_or_else(|| self.absent("count"))?;
        if let Some(filaments) = count.filaments
            && !has_size(Some(value))
        {
            fiber = fiber.of_dtex(10.0 * count.single_tex / f64::from(filaments));
            self.derive("fiber", format!("filaments of {:.2} dtex", fiber.dtex()), count.to_string());
        }
        check_filaments(&count, &fiber).map_err(|hint| self.refuse("count", &count, hint))?;
        Ok((fiber, count))
    }

    /// Number of singles.
    fn plies(&self, count: &Count) -> Result<u32> {
        match (self.integer("plies"), count.plies) {
            (Some(own), Some(of_count)) if own != of_count => {
                Err(self.refuse("plies", own, format!("the count {count} has {of_count}; write one of them")))
            }
            (own, of_count) => Ok(own.or(of_count).unwrap_or(1)),
        }
    }

    /// Number of bundles of a yarn of so many fibers.
    fn bundles(&mut self, used: Use, plies: u32, fiber: &Fiber, fibers: f64) -> u32 {
        let from = if fiber.is_staple { BUNDLED } else { BUNDLED_FILAMENTS };
        let usual = match (used, plies) {
            (Use::Woven, 1) if fibers >= 7.0 * f64::from(MAX_FIBERS) => 19,
            (Use::Woven, 1) if fibers >= from => 7,
            _ => 1,
        };
        let own = self.integer("bundles");
        if own.is_none() && usual > 1 {
            self.derive("bundles", usual.to_string(), format!("{fibers:.0} fibers, which cross others"));
        }
        own.unwrap_or(usual)
    }

    /// Share of a strand's section that its fibers fill. `strand_um2` is their area; the yarn has `strands`
    /// of them and `wide` times their radius.
    fn packing(&mut self, fiber: &Fiber, fibers: u32, count: &Count, strand_um2: f64, shape: Shape) -> Result<f64> {
        let Shape { strands, bundles, wide } = shape;
        self.refuse_both("diameter_um", "packing")?;
        if let Some(packing) = self.number("packing") {
            return Ok(packing);
        }
        if let Some(diameter) = self.number("diameter_um") {
            let packing = strand_um2 / (PI * (0.5 * diameter / wide).powi(2));
            if !PACKINGS.contains(&packing) {
                let width = |packing: f64| 2.0 * wide * round_radius_um(strand_um2, packing);
                let share = strands * strand_um2 / (0.25 * PI * diameter * diameter);
                let [low, high] = [width(*PACKINGS.end()), width(*PACKINGS.start())];
                let hint = format!(
                    "the fibers of {count} would fill {share:.2} of a yarn this wide; use {low:.0} to {high:.0} um, or another count"
                );
                return Err(self.refuse("diameter_um", diameter, hint));
            }
            self.derive("packing", format!("{packing:.3}"), format!("{count} in {diameter} um"));
            return Ok(packing);
        }
        let gathered = if bundles > 1 && fiber.is_staple { wide * wide / f64::from(bundles) } else { 1.0 };
        // The number of fibers is whole, and hollow fibers take more room than their material.
        let outlines = f64::from(fibers) * fiber.spec.shape.area_um2() / strand_um2;
        let usual = if is_monofilament(fibers, &fiber.spec) { 1.0 } else { fiber.packing * gathered };
        let packing = usual.min(max_packing(fibers, &fiber.spec) / outlines);
        let of = if bundles > 1 { "bundle" } else { "single" };
        self.derive("packing", format!("{packing:.3}"), format!("{} in a {of}", fiber.name));
        Ok(packing)
    }

    /// Twist of the fibers in a strand, and of the strands about each other, each with its direction [1/m].
    fn twists(&mut self, fiber: &Fiber, count: &Count, plies: u32, bundles: u32) -> Result<[(Handedness, f64); 2]> {
        const NONE: (Handedness, f64) = (Handedness::Z, 0.0);
        let single = match self.twist("twist") {
            Some(twist) => twist.turns(count.single_tex),
            None => {
                let turns = (fiber.alpha_tex / count.single_tex.sqrt()).round();
                if turns > 0.0 {
                    self.derive("twist", format!("Z {turns}/m"), format!("usual for {}", fiber.name));
                }
                (Handedness::Z, turns)
            }
        };
        let plied = match self.twist("ply_twist") {
            Some(_) if plies < 2 => {
                let value = self.text("ply_twist").unwrap_or_default();
                return Err(self.refuse("ply_twist", value, "a single yarn has none; write twist, or plies = 2"));
            }
            Some(twist) => twist.turns(count.single_tex * f64::from(plies)),
            None if plies > 1 && single.1 > 0.0 => {
                // A balanced yarn: the plies' fibers come to lie along it (Hearle, Grosberg and Backer 1969).
                let hand = if single.0 == Handedness::Z { Handedness::S } else { Handedness::Z };
                let turns = (single.1 / f64::from(plies).sqrt()).round();
                self.derive("ply_twist", format!("{hand:?} {turns}/m"), "balances the singles".into());
                (hand, turns)
            }
            None => NONE,
        };
        Ok(match (bundles > 1, plies > 1) {
            // Bundles turn with the yarn.
            (true, false) => [single, single],
            (true, true) => [plied, plied],
            (false, true) => [single, plied],
            (false, false) => [single, NONE],
        })
    }

    /// Refuses twist that no yarn holds.
    fn check_twist(&self, yarn: &YarnOfCloth) -> Result<()> {
        let of_strands = if yarn.plies > 1 { "ply_twist" } else { "twist" };
        let of_fibers = if yarn.bundles > 1 { of_strands } else { "twist" };
        for (key, um, (_, turns)) in
            [(of_fibers, yarn.strand_radius_um(), yarn.fiber_twist), (of_strands, yarn.radius_um(), yarn.strand_twist)]
        {
            let angle = (2e-6 * PI * um * turns).atan();
            if angle > MAX_ANGLE {
                let most = (1e6 * MAX_ANGLE.tan() / (2.0 * PI * um)).floor();
                let hint = format!(
                    "the fibers at the rim would lean by {:.0} degrees, which no yarn holds; use {most} turns a meter or fewer",
                    angle.to_degrees()
                );
                return Err(self.refuse(key, self.text(key).unwrap_or("(usual)"), hint));
            }
        }
        if yarn.strand_twist.1 > 0.0 && yarn.strands() > 1 && yarn.symmetry() == 1 {
            let hint = format!("{} bundles cannot be twisted in a periodic cloth; use 3, 7 or 19", yarn.bundles);
            return Err(self.refuse("bundles", yarn.bundles, hint));
        }
        Ok(())
    }

    fn color(&self, fiber: &Fiber) -> Result<YarnColor> {
        self.refuse_both("sigma_per_um", "color")?;
        if self.text("color") == Some(UNDYED) {
            let hint = format!("{} has no color of its own: leave this out for clear fibers", fiber.name);
            return fiber.undyed.map(YarnColor::Natural).ok_or_else(|| self.refuse("color", UNDYED, hint));
        }
        let srgb = self.keys.get("color").and_then(srgb_of_value);
        let srgb = srgb.map(|srgb| YarnColor::Srgb(srgb.map(|v| v as f32)));
        let sigma = || self.number("sigma_per_um").map(|sigma| YarnColor::Sigma(sigma as f32));
        Ok(srgb.or_else(sigma).unwrap_or(YarnColor::Undyed))
    }

    fn stripes(&self) -> Result<Vec<Stripe>> {
        self.refuse_both("stripes", "color")?;
        self.refuse_both("stripes", "sigma_per_um")?;
        match self.keys.get("stripes") {
            Some(value) => stripes::read(self.file, &format!("{}.stripes", self.name), value),
            None => Ok(Vec::new()),
        }
    }

    fn slits(&self) -> Result<Option<Slits>> {
        let share = self.number("slit_share");
        match (self.number("slit_um"), share) {
            (Some(width), None) => Ok(Some(Slits::of_width(width as f32))),
            (Some(width), Some(share)) => Ok(Some(Slits { width_um: width as f32, share: share as f32 })),
            (None, Some(share)) => {
                let hint = "give slit_um, the width of the slits, too, or leave this key out";
                Err(self.refuse("slit_share", share, hint))
            }
            (None, None) => Ok(None),
        }
    }

    /// The unevenness of a finish with keys of the spec's own.
    fn unevenness(&self, finish: &Finish) -> Result<Option<Unevenness>> {
        let [count_cv, spacing_cv, mm] = ["count_cv", "spacing_cv", "uneven_mm"].map(|key| self.number(key));
        match (finish.unevenness, count_cv, spacing_cv, mm) {
            (None, None, None, Some(mm)) => {
                let hint = "give finish, count_cv or spacing_cv, what changes over this length, or leave this key out";
                Err(self.refuse("uneven_mm", mm, hint))
            }
            (None, None, None, None) => Ok(None),
            (of_finish, ..) => {
                let base = of_finish.unwrap_or(Unevenness { count_cv: 0.0, spacing_cv: 0.0, length_mm: USUAL_MM });
                Ok(Some(Unevenness {
                    count_cv: count_cv.unwrap_or(base.count_cv),
                    spacing_cv: spacing_cv.unwrap_or(base.spacing_cv),
                    length_mm: mm.unwrap_or(base.length_mm),
                }))
            }
        }
    }
}

/// How a yarn's section is divided.
#[derive(Clone, Copy)]
struct Shape {
    /// Number of strands.
    strands: f64,
    bundles: u32,
    /// Radius of the yarn over that of a strand.
    wide: f64,
}

/// Reads a yarn whose keys passed their rules; `name` is the name of its table.
pub(crate) fn resolve(file: &str, name: &str, keys: &Table, used: Use) -> Result<YarnOfCloth> {
    let mut reader = Reader { file, name, keys, derived: Vec::new() };
    let (mut fiber, count) = reader.material()?;
    let plies = reader.plies(&count)?;
    let area_um2 = fiber_area_um2(count.single_tex * f64::from(plies), fiber.density_g_per_cm3);
    let bundles = reader.bundles(used, plies, &fiber, area_um2 / fiber.material_um2());
    let strands = f64::from(if bundles > 1 { bundles } else { plies });
    let shape = Shape { strands, bundles, wide: reach(if bundles > 1 { 1 } else { plies }, bundles) };
    let strand_um2 = area_um2 / strands;
    let is_unsized = count.filaments.is_none() && !has_size(keys.get("fiber"));
    let fibers = reader.integer("fibers").or((fiber.is_monofilament && is_unsized).then_some(1)).unwrap_or_else(|| {
        let fibers = (strand_um2 / fiber.material_um2()).round().max(1.0);
        let of = format!("{count} of {} of {:.2} dtex", fiber.name, fiber.dtex());
        reader.derive("fibers", format!("{fibers:.0} a strand"), of);
        fibers as u32
    });
    if fibers == 1 && is_unsized {
        let dtex = 1e-2 * strand_um2 * fiber.density_g_per_cm3;
        fiber = fiber.of_dtex(dtex);
        reader.derive("fiber", format!("one filament of {:.1} dtex", fiber.dtex()), count.to_string());
    }
    let packing = reader.packing(&fiber, fibers, &count, strand_um2, shape)?;
    if !keys.contains_key("diameter_um") {
        let radius_um = round_radius_um(strand_um2, packing);
        let text = format!("{:.1}, strands of R {radius_um:.1} um", 2.0 * shape.wide * radius_um);
        reader.derive("diameter_um", text, "count and packing".into());
    }
    let [fiber_twist, strand_twist] = reader.twists(&fiber, &count, plies, bundles)?;
    reader.refuse_both("tension", "crimp_percent")?;
    let finish = reader.text("finish").and_then(|text| Finish::parse(text).ok()).unwrap_or_default();
    let color = reader.color(&fiber)?;
    let yarn = YarnOfCloth {
        model: reader.text("model").map(str::to_string),
        fiber,
        count,
        plies,
        bundles,
        fibers,
        packing,
        fiber_twist,
        strand_twist,
        tension: reader.number("tension").unwrap_or(1.0),
        crimp_percent: reader.number("crimp_percent"),
        stiffness: reader.number("stiffness").unwrap_or(0.5),
        cohesion: reader.number("cohesion").unwrap_or(0.02),
        unevenness: reader.unevenness(&finish)?,
        color,
        stripes: reader.stripes()?,
        slits: reader.slits()?,
        hairs: match keys.get("hairs") {
            Some(table) => table.clone().try_into::<Hairs>().ok(),
            None => finish.hairs,
        },
        derived: std::mem::take(&mut reader.derived),
    };
    reader.check_twist(&yarn)?;
    Ok(yarn)
}

/// Whether the value of `fiber` fixes the size of the fibers.
fn has_size(fiber: Option<&Value>) -> bool {
    match fiber {
        Some(Value::String(text)) => text.contains(|c: char| c.is_ascii_digit()),
        Some(Value::Table(table)) => table.contains_key("shape"),
        _ => false,
    }
}

/// Checks that the filaments of a count have the size of the fiber.
fn check_filaments(count: &Count, fiber: &Fiber) -> std::result::Result<(), String> {
    let Some(filaments) = count.filaments else { return Ok(()) };
    let of_count = 10.0 * count.single_tex / f64::from(filaments);
    let by = of_count / fiber.dtex();
    match (0.75..=1.33).contains(&by) {
        true => Ok(()),
        false => Err(format!(
            "its {filaments} filaments have {of_count:.2} dtex each, but {} has {:.2}; leave one of them out",
            fiber.name,
            fiber.dtex()
        )),
    }
}
