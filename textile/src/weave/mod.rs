//! Weaves: drafts, their names, and weavers' files.

pub(crate) mod draft;
pub(crate) mod floats;
pub(crate) mod layers;
pub(crate) mod named;
pub(crate) mod names;
pub(crate) mod wif;
