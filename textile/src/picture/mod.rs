//! Pictures as drafts: a weave for each color, with extra wefts and double cloths.

pub(crate) mod area;
mod bind;
pub(crate) mod colors;
pub(crate) mod pixels;
pub(crate) mod spec;
