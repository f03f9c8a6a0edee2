//! Commands that show the contents of files and evaluate models.

pub mod color;
pub mod diff;
pub mod diff_models;
pub mod diff_tables;
pub mod eval;
pub mod fiber_view;
pub mod info;
pub mod info_fiber;
pub mod plot;
pub mod sample;
pub mod view;
pub mod view_server;
