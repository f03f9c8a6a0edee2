//! Calls of a cloth from the kernels of Dr.Jit's LLVM backend, for `plywave.mitsuba`.
//!
//! A kernel of Dr.Jit calls a ray tracer by the address of a function with the signature of Embree's
//! `rtcIntersect`: it hands over a packet of rays in columns, of which 12 words are inputs, and reads the
//! hits. The functions here have that signature and answer queries of a cloth: they run in the threads of
//! Dr.Jit, for the active lanes only, without copies of wavefronts and without Python.
//!
//! What does not fit into a packet comes by [`put`] before, and is fetched by [`get`] after; tokens that
//! the kernel hands from call to call order them. A query that is asked again is prepared once: each thread
//! keeps the scattering function of each lane.
//!
//! The references in the signatures are what Dr.Jit's kernels pass: arrays on the kernel's stack, and the
//! address of a [`ClothModel`] that [`kept_for_ever`] has given.

use plywave::cloth::{Channels, ClothBsdf, ClothModel};
use plywave::color::RGB_LAMBDA_UM;
use plywave::{Bsdf, BsdfSample, ClothQuery};
use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Largest number of lanes of a packet.
const MAX_LANES: usize = 16;
/// Number of words that a call takes, and of the columns of a packet (`RTCRayHit`).
const WORDS: usize = 12;
const COLUMNS: usize = 20;
/// Columns of the results; the kernel takes a lane for a miss if the column `HIT` is -1.
const RESULTS: [usize; 5] = [8, 15, 16, 17, 19];
const HIT: usize = 18;
/// Words of a query: position, direction towards the viewer and footprint; then the direction towards the
/// light or three random numbers, the token of [`put`], and which of its numbers count.
const QUERY: usize = 6;
const DIRECTION: usize = 6;
const TOKEN: usize = 9;
const GIVEN: usize = 10;
/// Bits of [`GIVEN`]: absorptions of the two kinds of yarns, wavelengths.
const SIGMAS: [u32; 2] = [1, 2];
const LAMBDA: u32 = 4;
/// Number of words of each of these among the words of [`put`].
const MAX_CHANNELS: usize = WORDS / 3;
/// Number of rows that a thread keeps between calls. A kernel needs one or two.
const KEPT: usize = 64;

/// A packet in columns.
type Packet<const W: usize> = [[u32; W]; COLUMNS];
/// Words of the lanes of a packet.
type Rows = [[u32; WORDS]; MAX_LANES];

/// What a thread keeps between calls, found by its token.
struct Ring {
    next: u32,
    rows: Vec<(u32, Rows)>,
}

impl Ring {
    /// Keeps rows; returns their token.
    fn add(&mut self, rows: Rows) -> u32 {
        self.next = self.next.wrapping_add(1);
        self.rows[self.next as usize % KEPT] = (self.next, rows);
        self.next
    }

    /// The rows of a token; `None` if they were overwritten or belong to another thread.
    fn find(&self, token: u32) -> Option<&Rows> {
        let (of, rows) = &self.rows[token as usize % KEPT];
        (*of == token).then_some(rows)
    }
}

/// What makes a query: the address of the cloth, the words of the query, which others are given, and these.
type Key = (usize, [u32; QUERY], u32, [u32; WORDS]);

/// The last query of a lane.
struct Lane<const N: usize> {
    key: Key,
    bsdf: Option<ClothBsdf<'static, N>>,
}

thread_local! {
    static RING: RefCell<Ring> = RefCell::new(Ring { next: 0, rows: vec![(0, [[0; WORDS]; MAX_LANES]); KEPT] });
}

/// Access to the lanes of a thread.
trait Lanes<const N: usize> {
    fn with<R>(f: impl FnOnce(&mut Vec<Lane<N>>) -> R) -> R;
}

macro_rules! lanes {
    ($($n:literal)*) => {$(
        impl Lanes<$n> for () {
            fn with<R>(f: impl FnOnce(&mut Vec<Lane<$n>>) -> R) -> R {
                thread_local! {
                    static LANES: RefCell<Vec<Lane<$n>>> = RefCell::new(
                        (0..MAX_LANES).map(|_| Lane { key: (0, [0; QUERY], 0, [0; WORDS]), bsdf: None }).collect()
                    );
                }
                LANES.with_borrow_mut(f)
            }
        }
    )*};
}
lanes!(1 3 4);

fn query<const N: usize>(words: &[u32; QUERY], given: u32, more: &[u32; WORDS]) -> ClothQuery<'static, N> {
    let [x, y, a, b, c, footprint_um] = words.map(f32::from_bits);
    let numbers = |part: usize| -> [f32; N] { std::array::from_fn(|k| f32::from_bits(more[MAX_CHANNELS * part + k])) };
    let is_spectral = given & LAMBDA != 0;
    let mut rgb = [0.0; N];
    RGB_LAMBDA_UM.iter().zip(&mut rgb).for_each(|(from, to)| *to = *from);
    ClothQuery {
        channels: if is_spectral { Channels::Wavelengths } else { Channels::LinearSrgb },
        sigma_per_um: [0, 1].map(|kind: usize| (given & SIGMAS[kind] != 0).then(|| numbers(kind))),
        footprint_um,
        ..ClothQuery::new([x, y], [a, b, c], if is_spectral { numbers(2) } else { rgb })
    }
}

/// Answers the active lanes of a packet: `answer` gets the scattering function, direction or random numbers,
/// and the lane, and returns the results.
fn for_each<const W: usize, const N: usize>(
    valid: &[i32; W],
    cloth: &'static ClothModel,
    packet: &mut Packet<W>,
    mut answer: impl FnMut(&ClothBsdf<'static, N>, [f32; 3], usize) -> [u32; RESULTS.len()],
) where
    (): Lanes<N>,
{
    let address = std::ptr::from_ref(cloth) as usize;
    <() as Lanes<N>>::with(|lanes| {
        for (i, lane) in lanes.iter_mut().enumerate().take(W) {
            let mut results = [0; RESULTS.len()];
            if valid[i] != 0 {
                let given = packet[GIVEN][i];
                let mut more = [0; WORDS];
                if given != 0 {
                    more = RING.with_borrow(|ring| ring.find(packet[TOKEN][i]).map_or(more, |rows| rows[i]));
                }
                let words = std::array::from_fn(|k| packet[k][i]);
                let key = (address, words, given, more);
                if lane.bsdf.is_none() || lane.key != key {
                    lane.key = key;
                    lane.bsdf = Some(cloth.at(&query(&words, given, &more)));
                }
                if let Some(bsdf) = &lane.bsdf {
                    results = answer(bsdf, std::array::from_fn(|k| f32::from_bits(packet[DIRECTION + k][i])), i);
                }
            }
            RESULTS.iter().zip(results).for_each(|(column, result)| packet[*column][i] = result);
        }
    });
    packet[HIT] = [0; W];
}

/// Keeps the 12 words of each lane for the call that gets the token, the fourth result: absorptions of the
/// two kinds of yarns and wavelengths, four words each.
extern "C" fn put<const W: usize>(_: &[i32; W], _: usize, _: usize, packet: &mut Packet<W>) {
    let mut rows: Rows = [[0; WORDS]; MAX_LANES];
    for (i, row) in rows.iter_mut().enumerate().take(W) {
        *row = std::array::from_fn(|k| packet[k][i]);
    }
    let token = RING.with_borrow_mut(|ring| ring.add(rows));
    RESULTS.iter().for_each(|column| packet[*column] = [0; W]);
    packet[RESULTS[3]] = [token; W];
    packet[HIT] = [0; W];
}

/// The first four words that the call of this token has kept for each lane.
extern "C" fn get<const W: usize>(valid: &[i32; W], _: usize, _: usize, packet: &mut Packet<W>) {
    RING.with_borrow(|ring| {
        for i in 0..W {
            let row =
                if valid[i] != 0 { ring.find(packet[TOKEN][i]).map_or([0; WORDS], |rows| rows[i]) } else { [0; WORDS] };
            RESULTS.iter().zip(row).take(4).for_each(|(column, word)| packet[*column][i] = word);
        }
    });
    packet[HIT] = [0; W];
}

/// f by channel, then the density.
extern "C" fn eval_pdf<const W: usize, const N: usize>(
    valid: &[i32; W],
    cloth: &'static ClothModel,
    _: usize,
    packet: &mut Packet<W>,
) where
    (): Lanes<N>,
{
    for_each(valid, cloth, packet, |bsdf: &ClothBsdf<'static, N>, w, _| {
        let (f, pdf) = bsdf.eval_pdf(w);
        let mut results = [0; RESULTS.len()];
        f.iter().zip(&mut results).for_each(|(f, result)| *result = f.to_bits());
        results[N] = pdf.to_bits();
        results
    });
}

/// The direction, and its density or, negative, the probability of straight light; then the token by which
/// [`get`] gives f, or the energy of straight light.
extern "C" fn sample<const W: usize, const N: usize>(
    valid: &[i32; W],
    cloth: &'static ClothModel,
    _: usize,
    packet: &mut Packet<W>,
) where
    (): Lanes<N>,
{
    let mut kept: Rows = [[0; WORDS]; MAX_LANES];
    for_each(valid, cloth, packet, |bsdf: &ClothBsdf<'static, N>, u, i| {
        let (w, weight, pdf) = match bsdf.sample(u) {
            BsdfSample::Scattered(s) => (s.w, s.weight, s.pdf),
            BsdfSample::Straight { weight, probability } => ([0.0; 3], weight, -probability),
            BsdfSample::Absorbed => ([0.0; 3], [0.0; N], 0.0),
        };
        weight.iter().zip(&mut kept[i]).for_each(|(weight, word)| *word = (weight * pdf.abs()).to_bits());
        [w[0].to_bits(), w[1].to_bits(), w[2].to_bits(), pdf.to_bits(), 0]
    });
    packet[RESULTS[4]] = [RING.with_borrow_mut(|ring| ring.add(kept)); W];
}

/// The energy of straight light.
extern "C" fn straight<const W: usize, const N: usize>(
    valid: &[i32; W],
    cloth: &'static ClothModel,
    _: usize,
    packet: &mut Packet<W>,
) where
    (): Lanes<N>,
{
    for_each(valid, cloth, packet, |bsdf: &ClothBsdf<'static, N>, _, _| [bsdf.straight()[0].to_bits(), 0, 0, 0, 0]);
}

/// Addresses of `put`, `get`, `eval_pdf`, `sample` and `straight`.
pub(crate) type Addresses = [usize; 5];

fn addresses_of<const W: usize, const N: usize>() -> Addresses
where
    (): Lanes<N>,
{
    [
        put::<W> as *const () as usize,
        get::<W> as *const () as usize,
        eval_pdf::<W, N> as *const () as usize,
        sample::<W, N> as *const () as usize,
        straight::<W, N> as *const () as usize,
    ]
}

/// Addresses of the functions for packets of so many lanes and channels; `None` for other numbers than
/// those of Dr.Jit and Mitsuba.
pub(crate) fn addresses(lanes: usize, channels: usize) -> Option<Addresses> {
    Some(match (lanes, channels) {
        (4, 1) => addresses_of::<4, 1>(),
        (4, 3) => addresses_of::<4, 3>(),
        (4, 4) => addresses_of::<4, 4>(),
        (8, 1) => addresses_of::<8, 1>(),
        (8, 3) => addresses_of::<8, 3>(),
        (8, 4) => addresses_of::<8, 4>(),
        (16, 1) => addresses_of::<16, 1>(),
        (16, 3) => addresses_of::<16, 3>(),
        (16, 4) => addresses_of::<16, 4>(),
        _ => return None,
    })
}

/// The cloth of a key, which says all of its file and its options, for as long as the process runs: threads
/// keep what borrows from it. A cloth of the same key is the same.
pub(crate) fn kept_for_ever(key: &str, cloth: &Arc<ClothModel>) -> &'static ClothModel {
    static ALL: Mutex<Option<HashMap<String, &'static Arc<ClothModel>>>> = Mutex::new(None);
    let mut all = ALL.lock().unwrap_or_else(PoisonError::into_inner);
    let all = all.get_or_insert_default();
    all.entry(key.to_owned()).or_insert_with(|| Box::leak(Box::new(cloth.clone())))
}
