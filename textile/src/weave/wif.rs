//! Reader for WIF, the weavers' exchange format ("Weaving Information File" 1.1, R. Nielsen and others,
//! 1997): an INI file with threading, tie-up and treadling or lift plan, colors, and distances of yarns. The
//! reader returns the draft, the color of each yarn and the spacings.
//!
//! Section and key names are case-insensitive; `;` begins a comment. Yarns, shafts, treadles and colors are
//! numbered from 1, and 0 means none. A pick names shafts through its treadles or through the lift plan. With
//! `Rising Shed` the warp is on top where a shaft of the end is named; otherwise it is on top where none is.
//!
//! Files depart from the format in many ways. Departures that can be read lead to a [`WifNote`]; only files
//! that define no draft are errors. This reader departs from the format in two points. Without `Rising Shed`
//! the shed rises, as programs assume, although optional booleans default to false in the format. The lift
//! plan takes precedence over tie-up and treadling; the format does not specify this.

mod colors;
mod note;
mod spacing;
mod text;

pub use note::{WifNote, WifNoteKind};
pub use spacing::WifSpacing;

use crate::weave::draft::YarnSet;
use crate::weave::draft::{Draft, MAX_THREADS};
use crate::weave::layers::Layer;
use crate::weave::names::{numbered, words};
use note::Notes;
use plywave::Result;
use text::{Ini, Loom, Rows};

/// Largest number of shafts and treadles; a Jacquard loom has one shaft per end.
const MAX_SHAFTS: usize = MAX_THREADS;

/// The weave that a WIF describes.
#[derive(Clone, Debug, PartialEq)]
pub struct Wif {
    /// The draft of the yarns that are woven, in the order of the file.
    pub draft: Draft,
    /// Color of each end [sRGB, 0 to 1]; empty if the file has none.
    pub warp_srgb: Vec<[f32; 3]>,
    /// Color of each pick [sRGB, 0 to 1]; empty if the file has none.
    pub weft_srgb: Vec<[f32; 3]>,
    /// Distance from end to end and from pick to pick, if the file has one.
    pub spacing: [Option<WifSpacing>; 2],
    /// Assumptions of the reader where the file is incomplete or wrong, one note per kind.
    pub notes: Vec<WifNote>,
}

impl Wif {
    /// Reads a WIF in UTF-8, UTF-16 or an older encoding; `file` names it in messages.
    ///
    /// # Errors
    /// [`plywave::Error::Format`] if the file is no WIF. [`plywave::Error::Invalid`] with section and key if
    /// it defines no draft: a required section is missing, there is text in place of numbers, a number
    /// exceeds [`MAX_THREADS`], or no yarn is bound.
    pub fn parse(bytes: &[u8], file: &str) -> Result<Wif> {
        let mut notes = Notes::default();
        let ini = Ini::read(bytes, file, &mut notes)?;
        check_contents(&ini, &mut notes);
        let declared = ini.count("WEAVING", "Shafts", MAX_SHAFTS)?;
        let shafts = Loom { name: "shaft", count: declared };
        let threading = ini.loom_rows("THREADING", MAX_SHAFTS, shafts, &mut notes)?;
        if threading.lines.is_empty() {
            return Err(missing(&ini, "THREADING", "give the shaft of each end"));
        }
        let plans = Plans::read(&ini, &threading, &mut notes)?;
        let rising = ini.truth("WEAVING", "Rising Shed")?;
        match rising {
            Some(true) => {}
            Some(false) => notes.add(
                WifNoteKind::Shed,
                "[WEAVING] Rising Shed = false: the shafts that are named sink, and the warp is on top where none does"
                    .into(),
            ),
            None => notes.add(WifNoteKind::Shed, "no Rising Shed in [WEAVING]: the shafts that are named rise".into()),
        }
        let ends = threads(&ini, YarnSet::Warp, threading.count(), &mut notes)?;
        let picks = threads(&ini, YarnSet::Weft, plans.picks(), &mut notes)?;
        let threading = threading.fit(ends, &mut notes);
        let [used, greatest] = [greatest_of(&threading), plans.greatest()];
        let (section, named) = plans.named(picks, &mut notes);
        let drawdown = |named: &[Shafts]| {
            drawdown(&threading, named, rising != Some(false))
                .ok_or_else(|| ini.invalid("WARP", "Threads", ends, format!("use 1 to {MAX_THREADS} threads")))
        };
        let full = drawdown(&named[0])?;
        if let Some(other) = named.get(1) {
            compare(&full, &drawdown(other)?, &mut notes);
        }
        let unused = [
            threading.iter().map(Vec::is_empty).collect::<Vec<bool>>(),
            named[0].iter().map(Shafts::is_empty).collect::<Vec<bool>>(),
        ];
        let retained = woven(&full, unused, &mut notes);
        let [warp, weft] = &retained;
        let Some(draft) = Draft::from_fn(weft.len(), warp.len(), |pick, end| full.up(weft[pick], warp[end])) else {
            let hint = match greatest > used {
                true => format!(
                    "shaft {greatest} is named, and the ends are on {used}; shafts are numbers with commas, such as 1,2"
                ),
                false => "bind the yarns: each must pass at least once above and once below another".into(),
            };
            return Err(ini.invalid(section, "1", "a draft in which no yarn binds another", hint));
        };
        if let Some(text) = Layer::note(&draft.layers_apart(), &retained) {
            notes.add(WifNoteKind::FallsApart, text);
        }
        let [warp_srgb, weft_srgb] = readable(colors::colors(&ini, [ends, picks], &retained, &mut notes), &mut notes)?;
        let spacing =
            YarnSet::EACH.map(|family| spacing::spacing(&ini, family, &retained[family as usize], &mut notes));
        Ok(Wif { draft, warp_srgb, weft_srgb, spacing, notes: notes.finish() })
    }
}

/// Returns the colors, or empty lists and a note if they cannot be read: the draft does not need them.
fn readable(colors: Result<[Vec<[f32; 3]>; 2]>, notes: &mut Notes) -> Result<[Vec<[f32; 3]>; 2]> {
    match colors {
        Err(plywave::Error::Invalid { key, value, hint, .. }) => {
            let finding = format!("{key} = {value} is no color ({hint}): the colors of the file are left out");
            notes.add(WifNoteKind::Colors, finding);
            Ok(Default::default())
        }
        other => other,
    }
}

fn greatest_of(lists: &[Vec<u64>]) -> u64 {
    lists.iter().flatten().copied().max().unwrap_or(0)
}

fn section_of(family: YarnSet) -> &'static str {
    match family {
        YarnSet::Warp => "WARP",
        YarnSet::Weft => "WEFT",
    }
}

fn colors_of(family: YarnSet) -> &'static str {
    match family {
        YarnSet::Warp => "WARP COLORS",
        YarnSet::Weft => "WEFT COLORS",
    }
}

fn missing(ini: &Ini<'_>, section: &str, hint: &str) -> plywave::Error {
    let state = if ini.has(section) { "is empty" } else { "is missing" };
    ini.invalid(section, "1", "(absent)", format!("the section [{section}] {state}; {hint}"))
}

/// Notes sections that `[CONTENTS]` announces and the file lacks. The contents are only a hint: sections are
/// read if they exist.
fn check_contents(ini: &Ini<'_>, notes: &mut Notes) {
    let names =
        ["WEAVING", "WARP", "WEFT", "THREADING", "TIEUP", "TREADLING", "LIFTPLAN", "COLOR PALETTE", "COLOR TABLE"];
    let colors = ["WARP COLORS", "WEFT COLORS"];
    let announced = |name: &&str| ini.truth("CONTENTS", name).is_ok_and(|announced| announced == Some(true));
    let absent: Vec<&str> = names.into_iter().chain(colors).filter(|name| announced(name) && !ini.has(name)).collect();
    if !absent.is_empty() {
        let finding = format!("[CONTENTS] announces {}, which the file lacks", absent.join(", "));
        notes.add(WifNoteKind::Contents, finding);
    }
}

/// Number of yarns of a set: the declared one, or else the number of lines.
fn threads(ini: &Ini<'_>, family: YarnSet, lines: usize, notes: &mut Notes) -> Result<usize> {
    let section = section_of(family);
    if let Some(declared) = ini.count(section, "Threads", MAX_THREADS)? {
        return Ok(declared);
    }
    if lines > MAX_THREADS {
        let hint = format!("the lines go to {lines}; use 1 to {MAX_THREADS}");
        return Err(ini.invalid(section, "Threads", "(absent)", hint));
    }
    let [_, several] = words(family);
    notes.add(WifNoteKind::Threads, format!("no Threads in [{section}]: {lines} {several}, as the lines say"));
    Ok(lines)
}

/// Rejects shafts that the loom does not have and that no end is on: such a number must mean something else.
fn check_shafts(ini: &Ini<'_>, plans: [&Rows; 2], count: usize) -> Result<()> {
    let is_beyond = |list: &[u64]| list.iter().any(|n| *n > count as u64);
    let mut all = plans.into_iter().flat_map(|rows| rows.lines.iter().map(move |(line, list)| (rows, *line, list)));
    match all.find(|(_, _, list)| is_beyond(list)) {
        Some((rows, line, list)) => Err(ini.beyond(rows.section, line, list, "shaft", count)),
        None => Ok(()),
    }
}

/// Notes shafts or treadles beyond the declared number.
fn check_loom(ini: &Ini<'_>, key: &str, used: usize, notes: &mut Notes) -> Result<()> {
    match ini.count("WEAVING", key, MAX_SHAFTS)? {
        Some(declared) if declared >= used => {}
        Some(declared) => {
            let finding =
                format!("[WEAVING] {key} = {declared}, but number {used} is used: the loom is taken to have {used}");
            notes.add(WifNoteKind::Loom, finding);
        }
        None => notes.add(WifNoteKind::Loom, format!("no {key} in [WEAVING]: {used}, the greatest number used")),
    }
    Ok(())
}

/// A set of shafts as bits.
struct Shafts(Vec<u64>);

impl Shafts {
    /// Builds the set from numbers that start at 1.
    fn from_numbers(numbers: &[u64]) -> Shafts {
        let mut set = Shafts(Vec::new());
        for &number in numbers {
            let (word, bit) = (number as usize / 64, number % 64);
            if set.0.len() <= word {
                set.0.resize(word + 1, 0);
            }
            set.0[word] |= 1 << bit;
        }
        set
    }

    fn has(&self, number: u64) -> bool {
        self.0.get(number as usize / 64).is_some_and(|word| word >> (number % 64) & 1 == 1)
    }

    fn add(&mut self, other: &Shafts) {
        if self.0.len() < other.0.len() {
            self.0.resize(other.0.len(), 0);
        }
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a |= b);
    }

    fn meets(&self, other: &Shafts) -> bool {
        self.0.iter().zip(&other.0).any(|(a, b)| a & b != 0)
    }

    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// The shafts of each pick, by lift plan, by tie-up and treadling, or by both.
struct Plans {
    lift: Option<Rows>,
    /// Treadles of each pick, and the shafts tied to each treadle, from index 0.
    treadles: Option<(Rows, Vec<Vec<u64>>)>,
}

impl Plans {
    fn read(ini: &Ini<'_>, threading: &Rows, notes: &mut Notes) -> Result<Plans> {
        let declared = ini.count("WEAVING", "Shafts", MAX_SHAFTS)?;
        let count = declared.unwrap_or(0).max(threading.greatest());
        let shafts = Loom { name: "shaft", count: Some(count) };
        let lift = ini.loom_rows("LIFTPLAN", MAX_SHAFTS, shafts, notes)?;
        let tieup = ini.loom_rows("TIEUP", MAX_SHAFTS, shafts, notes)?;
        let treadles = ini.count("WEAVING", "Treadles", MAX_SHAFTS)?.unwrap_or(tieup.count());
        let treadles = Loom { name: "treadle", count: Some(treadles) };
        let treadling = ini.loom_rows("TREADLING", MAX_SHAFTS, treadles, notes)?;
        if declared.is_some() {
            check_shafts(ini, [&lift, &tieup], count)?;
        }
        let shafts = [threading, &lift, &tieup].map(Rows::greatest).into_iter().max().unwrap_or(0);
        check_loom(ini, "Shafts", shafts, notes)?;
        let whole = !tieup.lines.is_empty() && !treadling.lines.is_empty();
        let treadles = whole.then(|| {
            let used = treadling.greatest();
            let declared = check_loom(ini, "Treadles", used, notes);
            let rows = tieup.count().min(MAX_SHAFTS).max(used);
            declared.map(|()| (treadling, tieup.fit(rows, notes)))
        });
        let treadles = treadles.transpose()?;
        let lift = (!lift.lines.is_empty()).then_some(lift);
        if lift.is_none() && treadles.is_none() {
            let hint = "give either [LIFTPLAN], or [TIEUP] and [TREADLING]";
            let section = if ini.has("TREADLING") && !ini.has("TIEUP") { "TIEUP" } else { "TREADLING" };
            return Err(missing(ini, section, hint));
        }
        Ok(Plans { lift, treadles })
    }

    /// The largest shaft number.
    fn greatest(&self) -> u64 {
        let tied = self.treadles.iter().flat_map(|(_, tied)| tied.iter());
        let lifted = self.lift.iter().flat_map(|rows| rows.lines.values());
        lifted.chain(tied).map(|list| greatest_of(std::slice::from_ref(list))).max().unwrap_or(0)
    }

    /// Number of picks with lines.
    fn picks(&self) -> usize {
        let rows = self.lift.iter().chain(self.treadles.as_ref().map(|(rows, _)| rows));
        rows.map(Rows::count).max().unwrap_or(0)
    }

    /// The section that takes precedence, and the shafts that it names at each pick; followed by those of the
    /// other plan, if the file has both.
    fn named(self, picks: usize, notes: &mut Notes) -> (&'static str, Vec<Vec<Shafts>>) {
        let section = if self.lift.is_some() { "LIFTPLAN" } else { "TREADLING" };
        let mut all = Vec::new();
        if let Some(rows) = self.lift {
            all.push(rows.fit(picks, notes).iter().map(|list| Shafts::from_numbers(list)).collect());
        }
        if let Some((rows, tieup)) = self.treadles {
            let tied: Vec<Shafts> = tieup.iter().map(|list| Shafts::from_numbers(list)).collect();
            let of = |pressed: &Vec<u64>| {
                let mut set = Shafts(Vec::new());
                pressed.iter().filter_map(|n| tied.get(*n as usize - 1)).for_each(|shafts| set.add(shafts));
                set
            };
            all.push(rows.fit(picks, notes).iter().map(of).collect());
        }
        (section, all)
    }
}

/// The draft of all ends and picks; `None` if it exceeds the size of a draft.
fn drawdown(threading: &[Vec<u64>], named: &[Shafts], rising: bool) -> Option<Draft> {
    // An end is nearly always on one shaft, but a file may put it on thousands; a bit set is faster then.
    let many: Vec<Option<Shafts>> =
        threading.iter().map(|list| (list.len() > 8).then(|| Shafts::from_numbers(list))).collect();
    Draft::from_fn(named.len(), threading.len(), |pick, end| {
        let is_named = match &many[end] {
            None => threading[end].iter().any(|n| named[pick].has(*n)),
            Some(set) => set.meets(&named[pick]),
        };
        is_named == rising
    })
}

/// Notes how much tie-up and treadling differ from the lift plan.
fn compare(plan: &Draft, other: &Draft, notes: &mut Notes) {
    let crossings = (plan.ends() * plan.picks()) as f64;
    let differ = plan.differences(other) as f64;
    if differ > 0.0 {
        let percent = |share: f64| (1000.0 * share).round() / 10.0;
        notes.add(
            WifNoteKind::LiftPlan,
            format!(
                "[LIFTPLAN] differs from [TIEUP] and [TREADLING] at {} % of the crossings: the lift plan is taken, with the warp on top at {} %; by the \
                 other it were {} %",
                percent(differ / crossings).max(0.1),
                percent(plan.warp_share()),
                percent(other.warp_share())
            ),
        );
    }
}

/// Indices of the ends and picks that are woven, from 0. Yarns that are `unused` are left out, and then,
/// until each remaining yarn passes once above and once below another, yarns that lie loose on the face or
/// the back.
fn woven(full: &Draft, unused: [Vec<bool>; 2], notes: &mut Notes) -> [Vec<usize>; 2] {
    let kinds = [
        (WifNoteKind::UnthreadedEnds, "on no shaft, bound by no pick"),
        (WifNoteKind::EmptyPicks, "no shaft moves, bound by no end"),
    ];
    for (k, family) in YarnSet::EACH.into_iter().enumerate() {
        let list: Vec<usize> = (1..=unused[k].len()).filter(|n| unused[k][n - 1]).collect();
        if !list.is_empty() {
            let (kind, why) = kinds[k];
            notes.add(kind, format!("{} left out: {why}", numbered(words(family), &list)));
        }
    }
    let mut is_retained = unused.map(|list| list.into_iter().map(|unused| !unused).collect::<Vec<bool>>());
    let loose = full.peel(&mut is_retained);
    for family in YarnSet::EACH {
        for (up, side) in [(true, "above"), (false, "below")] {
            let mut list: Vec<usize> = loose.iter().filter(|l| (l.0, l.2) == (family, up)).map(|l| l.1 + 1).collect();
            list.sort_unstable();
            if !list.is_empty() {
                let across = words(family.other())[1];
                let finding = format!("{} left out, loose {side} all {across}", numbered(words(family), &list));
                notes.add(WifNoteKind::LooseYarns, finding);
            }
        }
    }
    is_retained.map(|retained| (0..retained.len()).filter(|at| retained[*at]).collect())
}
