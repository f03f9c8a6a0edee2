//! Tests of the language of cloths. One program.

mod cloth_spec;
mod field_wif;
mod jacquard;
mod ply_specs;
mod spec_docs;
#[path = "../../../tests/it/spec_page.rs"]
mod spec_page;
mod wif;
