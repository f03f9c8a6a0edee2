//! Builds a family of plies from one spec with ranges: chooses its nodes, simulates their tables, and fits
//! them jointly.

use crate::error::Error;
use crate::recipe::Recipe;
use crate::run::Run;
use crate::stages::{check_fit, simulate, simulate_job, tell_fit, with_lobes_of};
use plywave::Document;
use plywave::ply::{FamilyAxis, FamilyData, FamilyParam, FamilyParams, PlyData, PlyFamily};
use plywave::spec::YarnSpec;
use plywave_fit::{FamilyMiddle, FamilyTables, FitErrors, FitOptions, errors, fit_family};
use plywave_runs::{Found, PartsFolder, Plan, RunError};
use plywave_sim::SimulateJob;
use plywave_tables::table::Table;
use std::path::Path;
use std::sync::Arc;

/// Options for choosing a family's nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyOptions {
    /// Initial nodes along each axis, in equal steps of its coordinate.
    pub first_nodes: usize,
    /// Largest number of nodes along an axis.
    pub most_nodes: usize,
    /// Largest error of f_high at the center of a cell relative to that at the adjacent nodes, rms over all
    /// slices. A cell with a larger error is split in two.
    pub error_ratio: f64,
    /// Largest difference between an energy of the model and of the simulation at the center of a cell. A
    /// cell with a larger difference is split too.
    pub energy: f64,
    /// Whether the centers of cells are simulated for the joint fit.
    pub middles: bool,
}

impl Default for FamilyOptions {
    fn default() -> Self {
        FamilyOptions { first_nodes: 3, most_nodes: 7, error_ratio: 1.15, energy: 0.004, middles: true }
    }
}

/// Folder of simulated tables, from which a stopped run resumes.
#[derive(Clone, Copy, Debug)]
pub struct FamilyFolder<'a> {
    /// The folder. It contains the tables of nodes as `DIGEST.pwt`, and the shards of the running one in
    /// `DIGEST.parts`.
    pub path: &'a Path,
}

/// Refuses specs that do not describe a family.
///
/// # Errors
/// [`plywave::Error::Invalid`], with the reason.
pub fn check_family_spec(spec: &YarnSpec, file: &str) -> Result<(), Error> {
    let refuse = |key: &str, value: String, hint: &str| {
        let (file, key, hint) = (file.into(), key.into(), hint.into());
        Err(Error::Runtime(plywave::Error::Invalid { file, key, value, hint }))
    };
    if spec.family.is_none() {
        return refuse(
            "family",
            "(absent)".into(),
            "give ranges, as `[family]` with `fiber_pitch_um = [300.0, 4000.0]`",
        );
    }
    if spec.yarn.plies > 1 {
        let hint = "families are of one ply; build models of such yarns one by one";
        return refuse("yarn.plies", spec.yarn.plies.to_string(), hint);
    }
    Ok(())
}

/// Recipe of one yarn of a family.
///
/// # Errors
/// Those of the changed spec.
pub fn member(recipe: &Recipe, params: &FamilyParams) -> Result<Recipe, Error> {
    let spec = params.applied_to(&recipe.spec);
    let file = &recipe.file;
    let text = spec.to_text(file)?;
    spec.check(file)?;
    Ok(Recipe { spec, spec_text: text, speckle: crate::Speckle::None, ..recipe.clone() })
}

/// The axes of a spec's ranges, with `count` nodes each in equal steps of the axis's coordinate.
fn axes(spec: &YarnSpec, count: usize) -> Vec<FamilyAxis> {
    let Some(family) = spec.family else { return Vec::new() };
    let radius = spec.ply_ring().radius_um;
    let ranges = [family.fiber_pitch_um, family.alpha_fiber, family.eta];
    let of = |(param, range): (FamilyParam, Option<[f64; 2]>)| {
        let [low, high] = range?;
        let (x, y) = (param.coordinate(low, radius), param.coordinate(high, radius));
        let value = |i: usize| match i {
            0 => low,
            i if i + 1 == count => high,
            i => param.of_coordinate(x + (y - x) * i as f64 / (count - 1) as f64, radius),
        };
        Some(FamilyAxis { param, values: (0..count).map(value).collect() })
    };
    FamilyParam::ALL.into_iter().zip(ranges).filter_map(of).collect()
}

/// Values at the centers of an axis's cells; a center halves its cell in the axis's coordinate.
fn middles_of(axis: &FamilyAxis, radius: f64) -> Vec<f64> {
    let x = |v: f64| axis.param.coordinate(v, radius);
    axis.values.windows(2).map(|w| axis.param.of_coordinate(0.5 * (x(w[0]) + x(w[1])), radius)).collect()
}

/// The yarns of the product of axes, with `values` along each.
fn product(spec: &YarnSpec, axes: &[FamilyAxis], values: impl Fn(&FamilyAxis) -> Vec<f64>) -> Vec<FamilyParams> {
    axes.iter().fold(vec![FamilyParams::from_spec(spec)], |all, axis| {
        let values = values(axis);
        let with = |params: FamilyParams| {
            values.iter().map(move |v| {
                let mut params = params;
                params.set(axis.param, *v);
                params
            })
        };
        all.into_iter().flat_map(with).collect()
    })
}

/// The yarns at the nodes of the axes, and those at the centers of cells if the fit uses them.
fn yarns(spec: &YarnSpec, axes: &[FamilyAxis], middles: bool) -> [Vec<FamilyParams>; 2] {
    let radius = spec.ply_ring().radius_um;
    let between = if middles { product(spec, axes, |axis| middles_of(axis, radius)) } else { Vec::new() };
    [product(spec, axes, |axis| axis.values.clone()), between]
}

/// Nodes around a query and their weights.
fn corners(axes: &[FamilyAxis], params: &FamilyParams, radius: f64) -> Vec<(usize, f64)> {
    axes.iter().fold(vec![(0, 1.0)], |all, axis| {
        let (low, t) = axis.locate(params.get(axis.param), radius);
        let n = axis.values.len();
        let of = |(node, w): (usize, f64)| [(node * n + low, w * (1.0 - t)), (node * n + low + 1, w * t)];
        all.into_iter().flat_map(of).filter(|c| c.1 > 0.0).collect()
    })
}

/// Name of a member's table in a [`FamilyFolder`], without its ending.
fn table_name(digest: &str) -> &str {
    &digest[..digest.len().min(16)]
}

/// A simulated member of a family: its folder of shards in a [`FamilyFolder`], and its job.
pub struct FamilyJob {
    /// `NAME.parts`.
    pub folder: String,
    /// The job.
    pub job: SimulateJob,
}

/// All jobs of [`build_family`] with these options, if nodes are not chosen by error
/// ([`FamilyOptions::most_nodes`] at most [`FamilyOptions::first_nodes`]). They serve callers that run the
/// shards elsewhere and put them into a folder.
///
/// # Errors
/// Those of [`build_family`], before any work.
pub fn family_jobs(recipe: &Recipe, options: &FamilyOptions) -> Result<Vec<FamilyJob>, Error> {
    check_family_spec(&recipe.spec, &recipe.file)?;
    let axes = axes(&recipe.spec, options.first_nodes.max(2));
    let of = |params: &FamilyParams| {
        let job = simulate_job(&member(recipe, params)?)?;
        Ok(FamilyJob { folder: format!("{}.parts", table_name(&Plan::from_job(&job).digest)), job })
    };
    yarns(&recipe.spec, &axes, options.middles).iter().flatten().map(of).collect()
}

/// The table of a member: loaded from the folder, or simulated and saved there.
fn table(recipe: &Recipe, folder: Option<FamilyFolder<'_>>, run: &Run<'_>) -> Result<Table, Error> {
    let Some(folder) = folder else { return simulate(recipe, run) };
    let digest = Plan::from_job(&simulate_job(recipe)?).digest;
    let name = table_name(&digest);
    let path = folder.path.join(format!("{name}.pwt"));
    if path.exists()
        && let Ok(table) = Table::load(&path)
        && table.spec_text == recipe.spec_text
        && table.seed == recipe.seed
    {
        return Ok(table);
    }
    let of = |e: RunError| Error::of_simulation(e, &recipe.file);
    let parts = PartsFolder::open(folder.path.join(format!("{name}.parts")), Found::Resume).map_err(of)?;
    let table = simulate(recipe, &Run { parts: Some(&parts), ..*run })?;
    table.save(&path)?;
    parts.remove();
    Ok(table)
}

/// Tables by parameters; each is simulated once.
struct Tables<'a> {
    recipe: &'a Recipe,
    folder: Option<FamilyFolder<'a>>,
    run: &'a Run<'a>,
    known: Vec<([u64; 3], Arc<Table>)>,
}

impl Tables<'_> {
    fn at(&mut self, params: &FamilyParams) -> Result<Arc<Table>, Error> {
        let key = FamilyParam::ALL.map(|p| params.get(p).to_bits());
        if let Some((_, table)) = self.known.iter().find(|(k, _)| *k == key) {
            return Ok(table.clone());
        }
        self.run.check_stop()?;
        let made = Arc::new(table(&member(self.recipe, params)?, self.folder, self.run)?);
        self.known.push((key, made.clone()));
        Ok(made)
    }
}

/// Builds the family of a recipe whose spec has ranges, on the current thread pool. The result depends on
/// recipe and options alone.
///
/// *Nodes.* Along each axis, with the others at their middle nodes, a family of that line alone is fitted and
/// compared with new simulations at the centers of its cells. The cell with the largest error relative to its
/// limit, [`FamilyOptions::error_ratio`] or [`FamilyOptions::energy`], is split at its center. This repeats
/// until all cells are within both limits or the axis has [`FamilyOptions::most_nodes`]. Then all nodes of
/// the product of the axes, and the centers of its cells, are simulated and fitted together.
///
/// # Errors
/// [`Error::Interrupted`] if the run was stopped; specs that do not describe a family; those of the stages.
pub fn build_family(
    recipe: &Recipe,
    options: &FamilyOptions,
    folder: Option<FamilyFolder<'_>>,
    run: &Run<'_>,
) -> Result<FamilyData, Error> {
    check_family_spec(&recipe.spec, &recipe.file)?;
    let radius = recipe.spec.ply_ring().radius_um;
    let mut axes = axes(&recipe.spec, options.first_nodes.max(2));
    let mut tables = Tables { recipe, folder, run, known: Vec::new() };
    if options.most_nodes > options.first_nodes {
        let mut center = FamilyParams::from_spec(&recipe.spec);
        axes.iter().for_each(|axis| center.set(axis.param, axis.values[axis.values.len() / 2]));
        for axis in &mut axes {
            refine_axis(axis, &center, radius, options, &mut tables)?;
        }
    }
    let [nodes, between] = yarns(&recipe.spec, &axes, options.middles);
    let nodes = nodes.iter().map(|p| tables.at(p)).collect::<Result<Vec<_>, Error>>()?;
    let mut middles = Vec::new();
    for params in between {
        middles.push(FamilyMiddle { corners: corners(&axes, &params, radius), table: tables.at(&params)? });
    }
    run.check_stop()?;
    fit_tables(recipe, &axes, &nodes, &middles, run)
}

/// Adds nodes to an axis (see [`build_family`]).
fn refine_axis(
    axis: &mut FamilyAxis,
    center: &FamilyParams,
    radius: f64,
    options: &FamilyOptions,
    tables: &mut Tables<'_>,
) -> Result<(), Error> {
    let on = |value: f64| {
        let mut params = *center;
        params.set(axis.param, value);
        params
    };
    let line = member(tables.recipe, center)?;
    while axis.values.len() < options.most_nodes {
        let nodes = axis.values.iter().map(|v| tables.at(&on(*v))).collect::<Result<Vec<_>, Error>>()?;
        let data = fit_tables(&line, std::slice::from_ref(axis), &nodes, &[], tables.run)?;
        let error = |model: &PlyData, table: &Table| {
            errors(model, table).map_err(|source| Error::Fit { file: line.file.clone(), source })
        };
        let own = data
            .nodes
            .iter()
            .zip(&nodes)
            .map(|(node, table)| Ok(error(node, table)?.rms_high[0]))
            .collect::<Result<Vec<f64>, Error>>()?;
        let family = PlyFamily::from_data(data)?;
        let mut worst = (1.0, None);
        for (i, value) in middles_of(axis, radius).into_iter().enumerate() {
            let table = tables.at(&on(value))?;
            let model = family.data_at(&on(value))?;
            let got = error(&model, &table)?;
            let beside = (0.5 * (own[i].powi(2) + own[i + 1].powi(2))).sqrt();
            let shape = got.rms_high[0] / beside.max(1e-6) / options.error_ratio;
            let energy = energies_off(&model, &table, &got).into_iter().fold(0.0, f64::max) / options.energy;
            let over = shape.max(energy);
            if over > worst.0 {
                worst = (over, Some((i, value)));
            }
        }
        tables.run.check_stop()?;
        let Some((cell, value)) = worst.1 else { break };
        axis.values.insert(cell + 1, value);
    }
    Ok(())
}

/// Largest differences between r_d, E_refl and E_high of a model, as fractions of the beam, and those of the
/// table of `errors`: at the nodes of the slices and, for r_d, at the table's finer nodes.
pub fn energies_off(model: &PlyData, table: &Table, errors: &FitErrors) -> [f64; 3] {
    let fine = table.fine_energies();
    let columns = fine.miss_h_um.len();
    let at = |i: usize| model.energies.at(fine.miss_theta_i[i / columns], fine.miss_h_um[i % columns]).r_d;
    let largest = |differences: &mut dyn Iterator<Item = f64>| differences.map(f64::abs).fold(0.0, f64::max);
    [
        largest(&mut fine.miss.iter().enumerate().map(|(i, miss)| at(i) - miss)),
        largest(&mut errors.energy_refl.iter().copied()),
        largest(&mut errors.energy_high.iter().copied()),
    ]
}

fn fit_tables(
    recipe: &Recipe,
    axes: &[FamilyAxis],
    nodes: &[Arc<Table>],
    middles: &[FamilyMiddle],
    run: &Run<'_>,
) -> Result<FamilyData, Error> {
    let options: FitOptions = with_lobes_of(&recipe.quality.fit(), &recipe.spec);
    let edge = check_fit(&nodes[0], &recipe.spec, &options, &recipe.file)?;
    let tables = FamilyTables { spec_text: &recipe.spec_text, axes, nodes, middles, edge: Some(edge) };
    fit_family(&tables, &options, &|p| tell_fit(run, p))
        .map_err(|source| Error::Fit { file: recipe.file.clone(), source })
}
