//! The noise of a model as stored in its file.

use super::spectrum::{self, NoiseSpectrum};
use super::tiles::{self, NoiseTiles};
use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};

/// Speckle noise of a ply (Yu 2025, 6.2).
#[derive(Clone, Debug, PartialEq)]
pub enum Noise {
    /// The parameters from which tiles are made at first use: some kilobytes.
    Spectrum(NoiseSpectrum),
    /// The tiles themselves, megabytes: from earlier files, or of values that are not from a Gaussian field.
    Tiles(NoiseTiles),
}

impl From<NoiseSpectrum> for Noise {
    fn from(spectrum: NoiseSpectrum) -> Noise {
        Noise::Spectrum(spectrum)
    }
}

impl From<NoiseTiles> for Noise {
    fn from(tiles: NoiseTiles) -> Noise {
        Noise::Tiles(tiles)
    }
}

impl Noise {
    /// All tensors that a file may have for noise.
    pub(crate) fn names() -> impl Iterator<Item = &'static str> {
        tiles::NAMES.into_iter().chain(tiles::FRAME_NAMES).chain(spectrum::NAMES)
    }

    pub(crate) fn write(&self, w: &mut Writer) {
        match self {
            Noise::Spectrum(spectrum) => spectrum.write(w),
            Noise::Tiles(tiles) => tiles.write(w),
        }
    }

    pub(crate) fn read(r: &Reader<'_>) -> Result<Option<Noise>> {
        let has = |names: &[&'static str]| names.iter().copied().find(|name| r.has(name));
        match (has(&tiles::NAMES), has(&spectrum::NAMES), has(&tiles::FRAME_NAMES)) {
            (None, None, None) => Ok(None),
            (Some(_), None, _) => Ok(Some(NoiseTiles::read(r)?.into())),
            (None, ..) => Ok(Some(NoiseSpectrum::read(r)?.into())),
            (Some(tiles), Some(spectrum), _) => {
                Err(invalid(r.file(), tiles, "present", &format!("expected it or {spectrum}, not both")))
            }
        }
    }

    pub(crate) fn check(&self, c: &Check<'_>) -> Result<()> {
        match self {
            Noise::Spectrum(spectrum) => spectrum.check(c),
            Noise::Tiles(tiles) => tiles.check(c),
        }
    }
}
