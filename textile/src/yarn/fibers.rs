//! Fibers by name, with what their makers and textbooks say of them, and fibers of a spec's own.
//!
//! Sources: M&H is W. E. Morton and J. W. S. Hearle, "Physical Properties of Textile Fibres" (densities;
//! tables of refractive indices along and across the fiber, here `(n_along + 2 n_across) / 3`). Shapes and
//! sizes are those of Yu 2025, Fig. 3 and section 4, and of textbooks; roughnesses and jitters are chosen.

use crate::words::nearest;
use plywave::Result;
use plywave::color::Undyed;
use plywave::optics::Metal;
use plywave::spec::rules::{self, Key, KeyKind, Rules, invalid, optional, required};
use plywave::spec::{FIBER_KEYS, FiberSpec, Shape};
use std::f64::consts::PI;
use toml::{Table, Value};

/// A kind of fiber.
#[derive(Clone, Debug, PartialEq)]
pub struct Fiber {
    /// Name, as in the spec.
    pub name: String,
    /// Cross section and optical properties.
    pub spec: FiberSpec,
    /// Density [g/cm3].
    pub density_g_per_cm3: f64,
    /// Whether the fiber is short and needs twist to make a yarn.
    pub is_staple: bool,
    /// Share of a round single yarn's section that these fibers fill.
    pub packing: f64,
    /// Twist factor of the tex system that singles of this fiber usually have; 0 for filaments.
    pub alpha_tex: f64,
    /// Whether a yarn of this fiber is one thick fiber, if neither names nor counts have a size.
    pub is_monofilament: bool,
    /// Absorption without dye; `None` for a clear or opaque fiber.
    pub undyed: Option<Undyed>,
}

/// An entry of the table of fibers.
struct Known {
    names: &'static [&'static str],
    shape: Shape,
    size_jitter: f64,
    shape_jitter: f64,
    eta: f64,
    alpha: f64,
    metal: Option<Metal>,
    density: f64,
    is_staple: bool,
    packing: f64,
    alpha_tex: f64,
    /// Scattering in the material [1/um].
    scattering: f64,
    is_monofilament: bool,
    undyed: Option<Undyed>,
}

const COTTON: Known = Known {
    names: &["cotton"],
    // 17 um wide and 9 um thick before the dent, with a collapsed lumen (Yu 2025, section 4.3: 10 to 20 um).
    shape: Shape::Kidney { a_um: 8.5, b_um: 4.5, dent: 0.35, lumen: 0.5 },
    size_jitter: 0.1,
    shape_jitter: 0.12,
    // M&H: 1.578 along, 1.532 across; 1.52 g/cm3.
    eta: 1.547,
    alpha: 0.25,
    metal: None,
    density: 1.52,
    is_staple: true,
    // F. T. Peirce (Journal of the Textile Institute 28, 1937): 1.1 cm3/g.
    packing: 0.598,
    // English factor 4.
    alpha_tex: 3827.0,
    scattering: 0.0,
    is_monofilament: false,
    undyed: Some(Undyed::Cellulose),
};

const FILAMENT: Known = Known {
    names: &["fiber"],
    shape: Shape::Circle { radius_um: 7.5 },
    size_jitter: 0.01,
    shape_jitter: 0.0,
    eta: 1.6,
    alpha: 0.2,
    metal: None,
    density: 1.38,
    is_staple: false,
    // Chosen: drawn filaments side by side.
    packing: 0.65,
    alpha_tex: 0.0,
    scattering: 0.0,
    is_monofilament: false,
    undyed: None,
};

/// A thick fiber that is a yarn by itself.
const MONOFILAMENT: Known =
    Known { shape: Shape::Circle { radius_um: 100.0 }, size_jitter: 0.0, is_monofilament: true, ..FILAMENT };

/// A wire of a metal: smooth but for its drawing, of 16 um.
const WIRE: Known =
    Known { shape: Shape::Circle { radius_um: 8.0 }, eta: 0.0, alpha: 0.15, packing: 0.614, ..FILAMENT };

/// The fibers, by name.
const KNOWN: &[Known] = &[
    COTTON,
    Known {
        names: &["mercerized cotton", "mercerised cotton"],
        // Caustic soda swells the fiber to a nearly round section without a lumen.
        shape: Shape::Ellipse { a_um: 6.6, b_um: 5.6 },
        eta: 1.543,
        alpha: 0.15,
        ..COTTON
    },
    Known {
        names: &["wool", "merino"],
        // 17.8 um, elliptical as wool is.
        shape: Shape::Ellipse { a_um: 9.6, b_um: 8.2 },
        size_jitter: 0.1,
        shape_jitter: 0.06,
        // M&H: 1.553 along, 1.543 across; 1.31 g/cm3. The scales make it rough.
        eta: 1.546,
        alpha: 0.3,
        density: 1.31,
        packing: 0.65,
        // Metric factor 85, of worsted singles.
        alpha_tex: 2690.0,
        undyed: Some(Undyed::Wool),
        ..COTTON
    },
    Known {
        names: &["cashmere"],
        shape: Shape::Circle { radius_um: 7.75 },
        size_jitter: 0.1,
        shape_jitter: 0.06,
        eta: 1.546,
        alpha: 0.25,
        density: 1.31,
        packing: 0.6,
        alpha_tex: 2500.0,
        undyed: Some(Undyed::Wool),
        ..COTTON
    },
    Known {
        names: &["mohair"],
        shape: Shape::Circle { radius_um: 15.0 },
        size_jitter: 0.1,
        shape_jitter: 0.06,
        eta: 1.546,
        alpha: 0.15,
        density: 1.31,
        packing: 0.6,
        alpha_tex: 2500.0,
        undyed: Some(Undyed::Wool),
        ..COTTON
    },
    Known {
        names: &["alpaca"],
        shape: Shape::HollowCircle { radius_um: 12.5, lumen: 0.45, lumen_eta: 1.0, lumen_dye: 0.0 },
        size_jitter: 0.1,
        shape_jitter: 0.15,
        eta: 1.546,
        alpha: 0.2,
        density: 1.31,
        packing: 0.6,
        alpha_tex: 2500.0,
        undyed: Some(Undyed::Wool),
        ..COTTON
    },
    Known {
        names: &["flax", "linen"],
        // Cells are polygons of 15 to 20 um with a narrow lumen; here ellipses.
        shape: Shape::Ellipse { a_um: 8.8, b_um: 7.8 },
        size_jitter: 0.1,
        shape_jitter: 0.1,
        // M&H: 1.596 along, 1.528 across.
        eta: 1.551,
        alpha: 0.18,
        density: 1.5,
        packing: 0.537,
        alpha_tex: 3410.0,
        ..COTTON
    },
    Known {
        names: &["silk", "raw silk"],
        shape: Shape::RoundedTriangle { radius_um: 8.0, rounding_um: 1.5 },
        size_jitter: 0.08,
        shape_jitter: 0.1,
        // M&H: 1.591 along, 1.538 across; 1.34 g/cm3.
        eta: 1.556,
        alpha: 0.12,
        density: 1.34,
        undyed: Some(Undyed::Silk),
        ..FILAMENT
    },
    Known {
        names: &["viscose", "rayon"],
        shape: Shape::Serrated { radius_um: 7.0, depth: 0.13, teeth: 8 },
        size_jitter: 0.05,
        shape_jitter: 0.12,
        // M&H: 1.539 along, 1.519 across; 1.49 g/cm3.
        eta: 1.526,
        alpha: 0.15,
        density: 1.49,
        undyed: Some(Undyed::Cellulose),
        ..FILAMENT
    },
    Known {
        names: &["lyocell", "modal"],
        shape: Shape::Circle { radius_um: 6.0 },
        size_jitter: 0.03,
        eta: 1.54,
        alpha: 0.12,
        density: 1.5,
        is_staple: true,
        packing: 0.6,
        alpha_tex: 3500.0,
        undyed: Some(Undyed::Cellulose),
        ..FILAMENT
    },
    // M&H: 1.725 along, 1.537 across; 1.38 g/cm3. Semi-dull.
    Known { names: &["polyester", "terylene"], ..FILAMENT },
    // M&H: 1.582 along, 1.519 across; 1.14 g/cm3.
    Known { names: &["nylon", "polyamide"], size_jitter: 0.03, eta: 1.54, density: 1.14, ..FILAMENT },
    // M&H: 1.50; 1.19 g/cm3. Dry-spun acrylics are bean-shaped.
    Known {
        names: &["acrylic"],
        shape: Shape::Kidney { a_um: 9.0, b_um: 7.5, dent: 0.3, lumen: 0.0 },
        size_jitter: 0.05,
        shape_jitter: 0.1,
        eta: 1.5,
        density: 1.19,
        is_staple: true,
        packing: 0.55,
        alpha_tex: 2600.0,
        ..FILAMENT
    },
    // 0.91 g/cm3; 1.49.
    Known { names: &["polypropylene"], size_jitter: 0.03, eta: 1.49, density: 0.91, ..FILAMENT },
    // High density: 0.95 g/cm3; 1.54 (Polymer Handbook). Crystals make a millimeter of it milky; 1 mm of
    // transport is chosen.
    Known { names: &["polyethylene", "hdpe"], eta: 1.54, alpha: 0.1, density: 0.95, scattering: 0.001, ..MONOFILAMENT },
    // Yarn of shade cloth: 21 % of polyester in 79 % of extruded vinyl, 0.254 or 0.457 mm thick (data sheet
    // of MechoSystems' ThermoVeil). Vinyl: 1.54, plasticized 1.3 g/cm3 (Polymer Handbook). Here one body,
    // white by 1 % of rutile; its transport length of 50 um and its roughness are chosen.
    Known {
        names: &["pvc coated", "vinyl coated"],
        shape: Shape::Circle { radius_um: 200.0 },
        eta: 1.54,
        alpha: 0.3,
        density: 1.32,
        scattering: 0.02,
        ..MONOFILAMENT
    },
    // E-glass: 2.6 g/cm3, filaments of 5.3 um.
    Known {
        names: &["glass"],
        shape: Shape::Circle { radius_um: 2.65 },
        size_jitter: 0.05,
        eta: 1.555,
        alpha: 0.0,
        density: 2.6,
        ..FILAMENT
    },
    Known { names: &["gold"], metal: Some(Metal::Gold), density: 19.3, ..WIRE },
    Known { names: &["silver"], metal: Some(Metal::Silver), density: 10.5, ..WIRE },
    Known { names: &["copper"], metal: Some(Metal::Copper), density: 8.96, ..WIRE },
    Known { names: &["aluminium", "aluminum"], metal: Some(Metal::Aluminium), density: 2.7, ..WIRE },
];

/// Names of the built-in fibers.
pub fn fiber_names() -> Vec<&'static str> {
    KNOWN.iter().map(|known| known.names[0]).collect()
}

impl Known {
    fn fiber(&self) -> Fiber {
        let spec = FiberSpec {
            shape: self.shape.clone(),
            size_jitter: self.size_jitter,
            shape_jitter: self.shape_jitter,
            angle_jitter_rad: None,
            eta: self.eta,
            kappa: None,
            metal: self.metal,
            dispersion_um2: None,
            alpha_fiber: self.alpha,
            scattering_per_um: self.scattering,
            scattering_g: 0.0,
        };
        Fiber {
            name: self.names[0].into(),
            spec,
            density_g_per_cm3: self.density,
            is_staple: self.is_staple,
            packing: self.packing,
            alpha_tex: self.alpha_tex,
            is_monofilament: self.is_monofilament,
            undyed: self.undyed,
        }
    }
}

/// Whether a strand is one round fiber, which fills it.
pub(crate) fn is_monofilament(fibers: u32, fiber: &FiberSpec) -> bool {
    fibers == 1 && matches!(fiber.shape, Shape::Circle { .. } | Shape::HollowCircle { .. })
}

/// The same shape, `by` times as large.
fn scaled(shape: &Shape, by: f64) -> Shape {
    let mut shape = shape.clone();
    match &mut shape {
        Shape::Circle { radius_um }
        | Shape::HollowCircle { radius_um, .. }
        | Shape::Trilobal { radius_um, .. }
        | Shape::Serrated { radius_um, .. } => *radius_um *= by,
        Shape::Ellipse { a_um, b_um } | Shape::Kidney { a_um, b_um, .. } => {
            *a_um *= by;
            *b_um *= by;
        }
        Shape::RoundedTriangle { radius_um, rounding_um } | Shape::Stone { radius_um, rounding_um, .. } => {
            *radius_um *= by;
            *rounding_um *= by;
        }
        Shape::Polygon { points_um, rounding_um, .. } => {
            points_um.iter_mut().flatten().for_each(|x| *x *= by);
            *rounding_um *= by;
        }
    }
    shape
}

impl Fiber {
    /// Area of the material of a fiber, without jitter [um2]. The dried lumen of a kidney is a slit, which
    /// counts as closed.
    pub fn material_um2(&self) -> f64 {
        let hollow = match &self.spec.shape {
            Shape::HollowCircle { lumen, lumen_eta, .. } if *lumen_eta == 1.0 => lumen * lumen,
            _ => 0.0,
        };
        self.spec.shape.area_um2() * (1.0 - hollow)
    }

    /// Linear density of a fiber [dtex].
    pub fn dtex(&self) -> f64 {
        1e-2 * self.material_um2() * self.density_g_per_cm3
    }

    /// The fiber with another linear density [dtex].
    #[must_use]
    pub fn of_dtex(mut self, dtex: f64) -> Fiber {
        self.spec.shape = scaled(&self.spec.shape, (dtex / self.dtex()).sqrt());
        self
    }

    /// Parses a fiber from text: a name, then optionally its diameter (`wool 19.5 um`, of the circle of its
    /// area) or linear density (`polyester 1.5 den`), a section (`round`, `trilobal`, `hollow`) and a luster
    /// (`bright`, `dull`). The error tells what to write.
    pub fn parse(text: &str) -> std::result::Result<Fiber, String> {
        let plain = text.trim().to_lowercase();
        let words: Vec<&str> = plain.split_whitespace().collect();
        let starts = |known: &&Known| {
            let longest = known.names.iter().filter(|name| {
                let name: Vec<&str> = name.split(' ').collect();
                words.starts_with(&name)
            });
            longest.map(|name| name.split(' ').count()).max()
        };
        let found = KNOWN.iter().filter_map(|known| Some((starts(&known)?, known))).max_by_key(|(count, _)| *count);
        let Some((count, known)) = found else { return Err(unknown(words.first().copied().unwrap_or_default())) };
        let mut fiber = known.fiber();
        let mut rest = words[count..].iter().copied().peekable();
        let mut size = None;
        while let Some(word) = rest.next() {
            let end = word.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(word.len());
            if let Ok(number) = word[..end].parse::<f64>() {
                let unit = if end < word.len() { &word[end..] } else { rest.next().unwrap_or_default() };
                if size.replace((number, unit)).is_some() {
                    return Err("give one size, such as \"19.5 um\" or \"1.5 den\"".into());
                }
                continue;
            }
            let area = fiber.spec.shape.area_um2();
            match word {
                "round" => fiber.spec.shape = Shape::Circle { radius_um: (area / PI).sqrt() },
                "trilobal" => {
                    let depth = 0.25;
                    let radius_um = (area / (PI * (1.0 + 0.5 * depth * depth))).sqrt();
                    fiber.spec.shape = Shape::Trilobal { radius_um, depth };
                }
                "hollow" => {
                    let radius_um = (area / PI).sqrt();
                    fiber.spec.shape = Shape::HollowCircle { radius_um, lumen: 0.4, lumen_eta: 1.0, lumen_dye: 0.0 };
                }
                // Chosen: titanium dioxide and the surface that it makes.
                "bright" => fiber.spec.alpha_fiber = 0.08,
                "semi-dull" => fiber.spec.alpha_fiber = 0.2,
                "dull" => fiber.spec.alpha_fiber = 0.3,
                "filament" => {
                    fiber.is_staple = false;
                    fiber.alpha_tex = 0.0;
                }
                "staple" | "spun" => {
                    fiber.is_staple = true;
                    if fiber.alpha_tex == 0.0 {
                        (fiber.alpha_tex, fiber.packing) = (COTTON.alpha_tex, 0.6);
                    }
                }
                other => {
                    return Err(format!(
                        "{other} after {}: write a size (19.5 um, 1.5 den, 2 dtex), round, trilobal, hollow, bright, \
                         semi-dull, dull, filament or staple",
                        fiber.name
                    ));
                }
            }
        }
        let sized = match size {
            None => fiber.dtex(),
            Some((um, "um" | "micron" | "microns" | "µm" | "μm")) => {
                let by = um / (4.0 * fiber.spec.shape.area_um2() / PI).sqrt();
                fiber.dtex() * by * by
            }
            Some((den, "den" | "denier" | "d")) => den / 0.9,
            Some((dtex, "dtex")) => dtex,
            Some((number, unit)) => return Err(format!("{number} {unit}: write a size in um, den or dtex")),
        };
        let by = (sized / fiber.dtex()).sqrt();
        if !(0.1..=10.0).contains(&by) {
            let usual = (4.0 * fiber.spec.shape.area_um2() / PI).sqrt();
            return Err(format!("{} is some {usual:.0} um wide; use a tenth to ten times that", fiber.name));
        }
        fiber = fiber.of_dtex(sized);
        fiber.name = words.join(" ");
        Ok(fiber)
    }
}

/// Message for a name that is no fiber.
fn unknown(word: &str) -> String {
    match nearest(word, KNOWN.iter().flat_map(|known| known.names).copied()) {
        Some(name) => format!("{word} is no known fiber; did you mean {name}?"),
        None => format!(
            "{word} is no known fiber; use one of {}, or a table such as {{ like = \"cotton\", alpha_fiber = 0.3 }}",
            fiber_names().join(", ")
        ),
    }
}

/// Keys of a fiber of a spec's own, in addition to those of a ply's fiber.
pub(crate) const OWN_KEYS: &[Key] = &[
    optional("like", KeyKind::Text, "every key of its own"),
    optional("density_g_per_cm3", KeyKind::Number(0.5, 25.0), "that of `like`"),
    optional("staple", KeyKind::Custom(BOOL), "that of `like`; false"),
];
const BOOL: rules::Custom = rules::Custom {
    expected: "true or false",
    check: |file, key, value| match value.is_bool() {
        true => Ok(()),
        false => Err(invalid(file, key, value, "use true or false")),
    },
};
const FIBER_RULES: Rules = Rules {
    keys: &[required("fiber", KeyKind::Table(FIBER_KEYS))],
    units: &["_um", "_rad"],
    example: "fabrics/cloths/satin.toml",
    foreign: &[],
};

/// The rule of a key `fiber`.
pub(crate) const RULE: rules::Custom = rules::Custom {
    expected: "a fiber such as \"cotton\", \"wool 19.5 um\" or \"polyester 1.5 den\", or a table",
    check: |file, key, value| read(file, key, value).map(|_| ()),
};

/// Reads the value of a key `fiber`: a text, or a table.
pub(crate) fn read(file: &str, key: &str, value: &Value) -> Result<Fiber> {
    match value {
        Value::String(text) => Fiber::parse(text).map_err(|hint| invalid(file, key, value, hint)),
        Value::Table(table) => own(file, key, table),
        _ => Err(invalid(file, key, value, "use a name such as \"cotton\" or \"wool 19.5 um\", or a table")),
    }
}

/// A fiber of a table's keys, on top of those of the fiber that it is like.
fn own(file: &str, key: &str, table: &Table) -> Result<Fiber> {
    let like = match table.get("like") {
        None => None,
        Some(Value::String(text)) => {
            Some(Fiber::parse(text).map_err(|hint| invalid(file, &format!("{key}.like"), text, hint))?)
        }
        Some(other) => return Err(invalid(file, &format!("{key}.like"), other, "use a name such as \"cotton\"")),
    };
    let mut merged = match &like {
        Some(like) => Table::try_from(&like.spec).unwrap_or_default(),
        None => Table::new(),
    };
    let mut own_keys = Table::new();
    for (name, value) in table {
        match OWN_KEYS.iter().any(|known| known.name == name) {
            true => own_keys.insert(name.clone(), value.clone()),
            false => merged.insert(name.clone(), value.clone()),
        };
    }
    let rules = Rules { keys: OWN_KEYS, ..FIBER_RULES };
    rules::check(file, &own_keys, &rules)?;
    let mut root = Table::new();
    root.insert("fiber".into(), Value::Table(merged.clone()));
    rules::check(file, &root, &FIBER_RULES)?;
    let spec: FiberSpec = rules::typed(merged, file, &FIBER_RULES)?;
    let density = own_keys.get("density_g_per_cm3").and_then(rules::number);
    let Some(density) = density.or(like.as_ref().map(|like| like.density_g_per_cm3)) else {
        let hint = "give the density of the material, or like = \"cotton\" for all that is not given";
        return Err(invalid(file, &format!("{key}.density_g_per_cm3"), "(absent)", hint));
    };
    let staple = own_keys.get("staple").and_then(Value::as_bool);
    let base = like.unwrap_or_else(|| FILAMENT.fiber());
    let is_staple = staple.unwrap_or(base.is_staple);
    Ok(Fiber {
        spec,
        density_g_per_cm3: density,
        alpha_tex: if is_staple && base.alpha_tex == 0.0 { COTTON.alpha_tex } else { base.alpha_tex },
        is_staple,
        ..base
    })
}
