//! Extension module of the Python package `plywave`. The public API is in `plywave/`: its functions check
//! shapes and types and pass flat arrays to the classes here.

mod batch;
mod check;
mod cloth;
mod cloth_queries;
mod compare;
mod errors;
mod export;
mod family;
mod fiber;
mod files;
mod kernel_calls;
mod model;
mod shards;
mod swatch;
mod tensors;
mod watch;
mod work;

use pyo3::prelude::*;

/// Fast parts of the package `plywave`.
#[pymodule]
fn _plywave(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("MAX_CHANNELS", batch::MAX_CHANNELS)?;
    module.add("RGB_LAMBDA_UM", plywave::color::RGB_LAMBDA_UM.to_vec())?;
    module.add("Error", module.py().get_type::<errors::Error>())?;
    module.add_class::<model::Model>()?;
    module.add_class::<cloth::Cloth>()?;
    module.add_class::<fiber::Fiber>()?;
    module.add_class::<family::Family>()?;
    module.add_function(wrap_pyfunction!(files::read_checked, module)?)?;
    module.add_function(wrap_pyfunction!(files::check_bytes, module)?)?;
    module.add_function(wrap_pyfunction!(files::rewritten, module)?)?;
    module.add_function(wrap_pyfunction!(files::file_kind, module)?)?;
    module.add_function(wrap_pyfunction!(files::write_file, module)?)?;
    module.add_function(wrap_pyfunction!(files::toml_of_json, module)?)?;
    module.add_function(wrap_pyfunction!(check::check, module)?)?;
    module.add_function(wrap_pyfunction!(swatch::swatch, module)?)?;
    module.add_function(wrap_pyfunction!(work::build, module)?)?;
    module.add_function(wrap_pyfunction!(work::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(work::fit, module)?)?;
    module.add_function(wrap_pyfunction!(work::fit_quality, module)?)?;
    module.add_function(wrap_pyfunction!(work::wave_scatter, module)?)?;
    module.add_function(wrap_pyfunction!(work::wave_tabulate, module)?)?;
    module.add_function(wrap_pyfunction!(work::wave_speckle, module)?)?;
    module.add_function(wrap_pyfunction!(shards::plan_build, module)?)?;
    module.add_function(wrap_pyfunction!(shards::plan_tabulate, module)?)?;
    module.add_function(wrap_pyfunction!(shards::plan_speckle, module)?)?;
    module.add_function(wrap_pyfunction!(shards::plan_twin, module)?)?;
    module.add_function(wrap_pyfunction!(shards::plan_compare, module)?)?;
    module.add_function(wrap_pyfunction!(family::plan_family, module)?)?;
    module.add_function(wrap_pyfunction!(family::build_family, module)?)?;
    module.add_function(wrap_pyfunction!(shards::run_block, module)?)?;
    module.add_function(wrap_pyfunction!(shards::check_block, module)?)?;
    module.add_function(wrap_pyfunction!(shards::block_name, module)?)?;
    module.add_function(wrap_pyfunction!(shards::run_job, module)?)?;
    module.add_function(wrap_pyfunction!(files::json_of_toml, module)?)?;
    tensors::register(module)
}
