//! `plywave plot`: a table, a model, or both side by side, as one figure.

use crate::args::{Cli, Part, PlotArgs};
use crate::commands::look::info::NodeEnergies;
use crate::commands::{Loaded, Yarn, absorptions, load_any};
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::output;
use crate::plot::Format;
use crate::plot::budget::Budget;
use crate::plot::figure::Figure;
use crate::plot::grid::Numbers;
use crate::plot::map::Field;
use crate::plot::sheet::{self, Cell, Section, SheetBlock};
use crate::plot::text::literal;
use crate::report::number;
use crate::yarn_words::yarn_line;
use plywave::Document;
use plywave::frame::direction;
use plywave::io::FileKind;
use plywave::ply::asg::{Lobe, PARAMS};
use plywave::{PlyModel, PlyQuery};
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::{OutgoingGrid, Table};
use std::path::Path;

/// Bins of a map of a model without a table, fine enough to be invisible.
const FINE: OutgoingGrid = OutgoingGrid { theta_o: 180, phi_o: 360 };
/// Largest number of latitudes in the energy budget.
const MAX_BUDGETS: usize = 7;

/// Data to plot: a table, a model, or both.
struct Source {
    table: Option<Box<Table>>,
    model: Option<Box<PlyModel>>,
    yarn: Yarn,
    title: String,
    particulars: String,
}

/// An incidence to show.
#[derive(Clone, Copy)]
struct View {
    theta_i: f64,
    h_um: f64,
}

impl Source {
    fn load(cli: &Cli, args: &PlotArgs) -> Outcome<Self> {
        let (table, model) = match (load_any(cli, &args.file)?, &args.table, &args.model) {
            (Loaded::Table(t), None, Some(model)) => (Some(t), Some(Box::new(cli.library()?.load(model)?))),
            (Loaded::Table(t), None, None) => (Some(t), None),
            (Loaded::Model(m), Some(table), _) => (Some(Box::new(Table::load(table)?)), Some(m)),
            (Loaded::Model(m), None, None) => (None, Some(m)),
            (Loaded::Fiber(_), ..) => {
                let hint = "there is nothing to set beside a fiber table; leave --table and --model out";
                return Err(Failure::input(args.file.display(), "FILE", "a fiber table", hint));
            }
            (Loaded::Speckle(_), ..) => {
                let hint = "there is nothing to set beside speckle patterns; leave --table and --model out";
                return Err(Failure::input(args.file.display(), "FILE", "speckle patterns", hint));
            }
            (Loaded::Family(_), ..) => {
                let hint = "take a model out of it with `plywave family FAMILY --param KEY=VALUE` and plot that";
                return Err(Failure::input(args.file.display(), "FILE", "a family of plies", hint));
            }
            (Loaded::Cloth(_), ..) => {
                let hint = "FILE is a cloth; leave --table and --model out";
                return Err(Failure::input(args.file.display(), "FILE", "a cloth", hint));
            }
            (Loaded::Twin(_), ..) => {
                let hint = "twins have no figure; `plywave info` tells what it holds";
                return Err(Failure::input(args.file.display(), "FILE", "the twin of a cloth", hint));
            }
            (Loaded::Table(_), Some(_), _) => {
                let hint = "this flag goes with a model; FILE is a table, give --model instead";
                return Err(Failure::input(args.file.display(), "--table", "given", hint));
            }
            (Loaded::Model(_), None, Some(_)) => {
                let hint = "this flag goes with a table; FILE is a model, give --table instead";
                return Err(Failure::input(args.file.display(), "--model", "given", hint));
            }
        };
        let (yarn, written) = match (&table, &model) {
            (_, Some(m)) => {
                let d = m.data();
                let written = format!("preset {}, seed {}, plywave {}", d.preset, d.seed, d.program_version);
                (Yarn::from_spec(&args.file, &d.spec_text, &d.h_um)?, written)
            }
            (Some(t), None) => {
                let written = format!("preset {}, seed {}, plywave {}", t.preset, t.seed, t.program_version);
                (Yarn::from_spec(&args.file, &t.spec_text, &t.h_um)?, written)
            }
            (None, None) => {
                return Err(Failure::input(args.file.display(), "content", "none", "give a table or a model"));
            }
        };
        if let (Some(t), Some(m)) = (&table, &model) {
            same_axes(&args.file, t, m)?;
        }
        let kind = match (&table, &model) {
            (Some(_), Some(_)) => "model against table",
            (Some(_), None) => "simulated table",
            _ => "ply model",
        };
        // Names come from the file, so they are truncated to fit the page.
        let title = format!("{}: {kind}", literal(&yarn.spec.name, 80));
        let particulars = literal(&format!("{written}; {}", yarn_line(&yarn.spec)), 400);
        Ok(Source { table, model, yarn, title, particulars })
    }

    fn axes(&self) -> (&[f64], &[f64], &[f64]) {
        match (&self.model, &self.table) {
            (Some(m), _) => (&m.data().theta_i, &m.data().h_um, &m.data().sigma_per_um),
            (None, Some(t)) => (&t.theta_i, &t.h_um, &t.sigma_per_um),
            (None, None) => (&[], &[], &[]),
        }
    }

    /// The nearest node of the table; without a table, the given incidence.
    fn view(&self, theta_deg: f64, h_rel: f64) -> View {
        let (theta_i, h_um) = (theta_deg.to_radians(), h_rel * self.yarn.radius_um);
        match &self.table {
            Some(t) => View { theta_i: t.theta_i[nearest(&t.theta_i, theta_i)], h_um: t.h_um[nearest(&t.h_um, h_um)] },
            None => View { theta_i, h_um },
        }
    }

    fn sigma(&self, sigma: f64) -> f64 {
        self.table.as_ref().map_or(sigma, |t| t.sigma_per_um[nearest(&t.sigma_per_um, sigma)])
    }

    fn grid(&self) -> OutgoingGrid {
        self.table.as_ref().map_or(FINE, |t| t.grid)
    }

    /// Maps of one incidence: table, fit and residual, or the only one available. `sigma` is `None` for
    /// f_refl.
    fn cells(&self, view: View, sigma: Option<f64>) -> Vec<Cell> {
        let cell = |field, residual, lobes| Cell { field, residual, lobes, theta_i: view.theta_i };
        let table = self.table.as_ref().map(|t| {
            let (m, n) = (nearest(&t.theta_i, view.theta_i), nearest(&t.h_um, view.h_um));
            let slice = match sigma {
                None => t.refl_slice(m, n),
                Some(s) => t.high_slice(m, n, nearest(&t.sigma_per_um, s)),
            };
            Field::from_slice(t.grid, slice)
        });
        let fit = self.model.as_ref().map(|model| {
            let (theta_i, h_um) = (view.theta_i as f32, view.h_um as f32);
            let bsdf = model.at(&PlyQuery::lobes(theta_i, h_um, [sigma.unwrap_or(0.0) as f32]));
            let field = Field::from_fn(self.grid(), |theta, phi| {
                let wo = direction(theta as f32, phi as f32);
                let terms = bsdf.terms(wo);
                f64::from(if sigma.is_some() { terms.high[0] } else { terms.refl })
            });
            let at = plywave_fit::locate(model.data(), view.theta_i, view.h_um);
            let lobes = match sigma {
                None => plywave_fit::refl_lobes(model.data(), at),
                Some(s) => plywave_fit::high_lobes(model.data(), at, s),
            };
            // The outline of a cone would be the ring itself, so only round lobes have outlines.
            let round = lobes.lobes == plywave_fit::SliceLobes::Round;
            let outlines = lobes.params.chunks_exact(PARAMS).filter(|_| round).map(Lobe::from_params);
            (field, outlines.collect::<Vec<_>>())
        });
        match (table, fit) {
            (Some(table), Some((fit, lobes))) => {
                let residual = fit.minus(&table);
                vec![cell(table, false, vec![]), cell(fit, false, lobes), cell(residual, true, vec![])]
            }
            (Some(table), None) => vec![cell(table, false, vec![])],
            (None, Some((fit, lobes))) => vec![cell(fit, false, lobes)],
            (None, None) => vec![],
        }
    }

    fn columns(&self) -> Vec<String> {
        match (&self.table, &self.model) {
            (Some(_), Some(_)) => ["table", "fit", "fit - table"].map(String::from).to_vec(),
            (Some(_), None) => vec!["table".into()],
            _ => vec!["fit".into()],
        }
    }

    /// The overview: several incidences, f_refl at the left and f_high at the right.
    fn overview(&self, sigma: f64, decades: f64) -> Section {
        let last = self.axes().0.last().copied().unwrap_or(0.0).to_degrees();
        // Two of the latitudes may have the same node of a coarse table.
        let mut thetas: Vec<f64> = [0.0, 30.0, 60.0].into_iter().filter(|t| *t <= last + 1.0).collect();
        thetas.dedup_by_key(|theta| self.view(*theta, 0.0).theta_i);
        let mut offsets = vec![0.0, 0.5, 0.9];
        offsets.dedup_by_key(|h| self.view(0.0, *h).h_um);
        let both = self.table.is_some() && self.model.is_some();
        let block = |sigma: Option<f64>| {
            let (name, quantity) = names(sigma);
            let mut rows = Vec::new();
            let mut cells = Vec::new();
            for &theta in &thetas {
                let label = |v: View| format!("θ_i = {}°", rounded(v.theta_i.to_degrees(), 1));
                let views: Vec<View> = offsets.iter().map(|h| self.view(theta, *h)).collect();
                if both {
                    for view in views {
                        rows.push([label(view), self.offset(view)]);
                        cells.push(self.cells(view, sigma));
                    }
                } else {
                    rows.push([label(views[0]), String::new()]);
                    cells.push(views.iter().flat_map(|v| self.cells(*v, sigma)).collect());
                }
            }
            let columns =
                if both { self.columns() } else { offsets.iter().map(|h| self.offset(self.view(0.0, *h))).collect() };
            SheetBlock { title: name, quantity, columns, rows, cells, map_width: if both { 270 } else { 300 }, decades }
        };
        Section::Maps(vec![block(None), block(Some(sigma))])
    }

    /// Maps of this file above those of another at a few incidences, with one scale (Yu 2025, Fig. 8b: a ply
    /// alone and in its yarn).
    fn pair(&self, other: &Source, sigma: f64, decades: f64) -> Section {
        let incidences = [(0.0, 0.0), (0.0, 0.8), (40.0, 0.4)];
        let block = |sigma: Option<f64>| {
            let (title, quantity) = names(sigma);
            let row = |s: &Source| -> Vec<Cell> {
                let first = |(theta, h): (f64, f64)| s.cells(s.view(theta, h), sigma).into_iter().next();
                incidences.into_iter().filter_map(first).map(|c| Cell { lobes: vec![], ..c }).collect()
            };
            let columns = incidences
                .map(|(theta, h)| {
                    let view = self.view(theta, h);
                    format!("θ_i = {}°, {}", rounded(view.theta_i.to_degrees(), 1), self.offset(view))
                })
                .to_vec();
            let rows = [self, other].map(|s| [s.kind(), String::new()]).to_vec();
            SheetBlock { title, quantity, columns, rows, cells: vec![row(self), row(other)], map_width: 360, decades }
        };
        Section::Maps(vec![block(None), block(Some(sigma))])
    }

    /// Description: one ply, or a yarn with its number of plies.
    fn kind(&self) -> String {
        let plies = match (&self.table, &self.model) {
            (Some(t), _) => t.plies,
            (None, Some(_)) => self.yarn.spec.yarn.plies,
            (None, None) => 1,
        };
        if plies > 1 { format!("{plies} plies") } else { "one ply".into() }
    }

    fn offset(&self, view: View) -> String {
        format!("h = {} R", rounded(view.h_um / self.yarn.radius_um, 2))
    }

    /// One incidence, large.
    fn single(&self, view: View, sigmas: &[f64], decades: f64) -> Vec<Section> {
        let title = format!(" at θ_i = {}°, {}", rounded(view.theta_i.to_degrees(), 1), self.offset(view));
        let one = |sigma: Option<f64>| {
            let (name, quantity) = names(sigma);
            Section::Maps(vec![SheetBlock {
                title: name + &title,
                quantity,
                columns: self.columns(),
                rows: vec![[String::new(), String::new()]],
                cells: vec![self.cells(view, sigma)],
                map_width: 560,
                decades,
            }])
        };
        std::iter::once(one(None)).chain(sigmas.iter().map(|s| one(Some(*s)))).collect()
    }

    /// The energy budget at an absorption, at up to [`MAX_BUDGETS`] latitudes.
    fn budgets(&self, sigma: f64) -> Section {
        let (theta_i, h_um, _) = self.axes();
        let h_rel: Vec<f64> = h_um.iter().map(|h| h / self.yarn.radius_um).collect();
        let columns = h_um.len();
        // Energies of each node at sigma = 0 and at the chosen sigma.
        let nodes = match (&self.table, &self.model) {
            (None, Some(m)) => m.data().node_energies(),
            _ => Vec::new(),
        };
        let high_at = |node: usize| -> (f64, f64) {
            match (&self.table, &self.model) {
                (Some(t), _) => {
                    let sigmas = t.sigma_per_um.len();
                    let k = nearest(&t.sigma_per_um, sigma);
                    (t.energy_high[node * sigmas], t.energy_high[node * sigmas + k])
                }
                (None, Some(m)) => {
                    let at = |s: f64| nodes[node].high_at(s, &m.data().path_um);
                    (at(0.0), at(sigma))
                }
                (None, None) => (0.0, 0.0),
            }
        };
        let (refl, r_d) = match &self.table {
            Some(t) => (t.energy_refl.clone(), t.r_d.clone()),
            None => (nodes.iter().map(|e| e.refl).collect(), nodes.iter().map(|e| e.r_d).collect()),
        };
        let panels = spread(theta_i.len(), MAX_BUDGETS)
            .into_iter()
            .map(|m| {
                let row = m * columns..(m + 1) * columns;
                let high: Vec<(f64, f64)> = row.clone().map(high_at).collect();
                Budget {
                    theta_i: theta_i[m],
                    h_rel: h_rel.clone(),
                    refl: refl[row.clone()].to_vec(),
                    high: high.iter().map(|e| e.1).collect(),
                    absorbed: high.iter().map(|e| e.0 - e.1).collect(),
                    r_d: r_d[row].to_vec(),
                }
            })
            .collect();
        Section::Budgets { panels, sigma_per_um: sigma }
    }

    /// Grids of fit errors, or of the noise for a table alone.
    fn errors(&self, args: &PlotArgs) -> Outcome<Section> {
        let (theta_i, h_um, sigma) = self.axes();
        let sigmas = sigma.len();
        let h_rel: Vec<f64> = h_um.iter().map(|h| h / self.yarn.radius_um).collect();
        let numbers = |values: Vec<f64>| Numbers { theta_i: theta_i.to_vec(), h_rel: h_rel.clone(), values };
        let (refl, high, what) = match (&self.table, &self.model) {
            (Some(t), Some(m)) => {
                let e = plywave_fit::errors(m.data(), t)
                    .map_err(|e| Failure::Input(format!("{}: {e}", args.file.display())))?;
                (e.refl, e.high, "Fit error, relative L2 without noise [%]")
            }
            (None, Some(m)) => {
                (m.data().error_refl.clone(), m.data().error_high.clone(), "Fit error, relative L2 without noise [%]")
            }
            (Some(t), None) => {
                let (refl, high) = noise(t);
                (refl, high, "Noise, relative L2 [%]")
            }
            (None, None) => (vec![], vec![], ""),
        };
        let high = high.into_iter().step_by(sigmas.max(1)).collect();
        Ok(Section::Grids(vec![
            (format!("{what} of f_{{refl}}"), numbers(refl)),
            (format!("{what} of f_{{high}}, σ = 0"), numbers(high)),
        ]))
    }

    /// The absorption that the budget shows: one that absorbs about a third of the light at normal incidence
    /// in the center.
    fn telling_sigma(&self) -> f64 {
        let (_, h_um, sigma) = self.axes();
        let node = h_um.len() / 2;
        let high = match (&self.table, &self.model) {
            (Some(t), _) => t.energy_high.clone(),
            (None, Some(m)) => NodeEnergies::from_data(m.data()).high,
            (None, None) => vec![],
        };
        let row = &high[node * sigma.len()..(node + 1) * sigma.len()];
        let lost = |k: usize| (row[k] / row[0].max(1e-12) - 2.0 / 3.0).abs();
        (0..sigma.len()).min_by(|a, b| lost(*a).total_cmp(&lost(*b))).map_or(0.0, |k| sigma[k])
    }
}

/// Relative L2 noise of a table's slices; NaN for an empty slice.
fn noise(t: &Table) -> (Vec<f64>, Vec<f64>) {
    let norm2 = |slice: &[f32]| -> f64 {
        let rows = slice.chunks_exact(t.grid.phi_o).enumerate();
        rows.map(|(i, row)| row.iter().map(|v| (*v as f64).powi(2)).sum::<f64>() * t.grid.solid_angle(i)).sum()
    };
    let columns = t.h_um.len();
    let sigmas = t.sigma_per_um.len();
    let nodes = 0..t.theta_i.len() * columns;
    let refl = nodes.clone().map(|i| (t.noise_refl[i] / norm2(t.refl_slice(i / columns, i % columns))).sqrt());
    let high = nodes.flat_map(|i| {
        (0..sigmas)
            .map(move |k| (t.noise_high[i * sigmas + k] / norm2(t.high_slice(i / columns, i % columns, k))).sqrt())
    });
    (refl.collect(), high.collect())
}

/// Heading and color bar title of a component.
fn names(sigma: Option<f64>) -> (String, String) {
    match sigma {
        None => ("f_{refl}, light that was only reflected".into(), "f_{refl} [1/sr]".into()),
        Some(s) => (format!("f_{{high}}, all other light, σ = {} /μm", number(s)), "f_{high} [1/sr]".into()),
    }
}

fn rounded(value: f64, digits: i32) -> String {
    let unit = 10f64.powi(digits);
    number((value * unit).round() / unit)
}

/// Index of the value nearest to `x`.
fn nearest(axis: &[f64], x: f64) -> usize {
    (0..axis.len()).min_by(|a, b| (axis[*a] - x).abs().total_cmp(&(axis[*b] - x).abs())).unwrap_or(0)
}

/// At most `max` of `count` indices, evenly spread, including both ends.
fn spread(count: usize, max: usize) -> Vec<usize> {
    let n = count.min(max);
    if n < 2 {
        return (0..n).collect();
    }
    (0..n).map(|i| (i * (count - 1) + (n - 1) / 2) / (n - 1)).collect()
}

/// Refuses a table and a model with different incidences.
fn same_axes(file: &Path, t: &Table, m: &PlyModel) -> Outcome {
    let d = m.data();
    let close = |a: &[f64], b: &[f64]| {
        a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() <= 1e-6 * (1.0 + x.abs()))
    };
    for (key, a, b) in [
        ("theta_i", &d.theta_i, &t.theta_i),
        ("h_um", &d.h_um, &t.h_um),
        ("sigma_per_um", &d.sigma_per_um, &t.sigma_per_um),
    ] {
        if !close(a, b) {
            let value = format!("{} nodes in the model, {} in the table, or other values", a.len(), b.len());
            return Err(Failure::input(file.display(), key, value, "give a table and a model of one yarn and preset"));
        }
    }
    Ok(())
}

/// Runs the command.
pub fn run(cli: &Cli, args: &PlotArgs) -> Outcome {
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.file, "png"));
    let others = [args.table.as_deref(), args.model.as_deref()];
    let inputs: Vec<&std::path::Path> = others.into_iter().flatten().chain([args.file.as_path()]).collect();
    let format = Format::from_path(&path)?;
    output::check_writable(&path, &inputs)?;
    absorptions(&args.sigma)?;
    if matches!(kinds::kind_of(&args.file), Some(InputKind::Cloth | InputKind::ClothFile)) {
        if let Some(other) = others.into_iter().flatten().next() {
            let hint = "FILE is a cloth; leave --table and --model out";
            return Err(Failure::input(args.file.display(), "FILE", other.display(), hint));
        }
        return crate::commands::make::weave::plot(cli, &args.file, &path, format);
    }
    if args.file.extension().is_some_and(|e| e == "toml") || kinds::kind_of(&args.file) == Some(InputKind::Yarn) {
        if let Some(other) = others.into_iter().flatten().next() {
            let hint = "FILE is a yarn spec; leave --table and --model out";
            return Err(Failure::input(args.file.display(), "FILE", other.display(), hint));
        }
        let (spec, _) = plywave_textile::load_yarn_file(&args.file)?;
        let edge = matches!(args.part, Part::Edge);
        return write(cli, &path, format, &crate::commands::wave::diffraction_view::figure(args, &spec, edge)?);
    }
    if !args.gap.is_empty() || args.tilt != 0.0 || matches!(args.part, Part::Edge) {
        let hint = "--gap, --tilt and --part edge go with a yarn spec (.toml), whose beam they show";
        return Err(Failure::input(args.file.display(), "FILE", "no spec", hint));
    }
    if let Some(theta) = args.theta_i.filter(|t| !(0.0..=90.0).contains(t)) {
        let hint = "must be from 0 to 90 degrees; (-theta_i, h) is the mirror image of (theta_i, -h)";
        return Err(Failure::input("command line", "--theta-i", theta, hint));
    }
    if others.iter().all(Option::is_none) && !kinds::is_named(&args.file) {
        match plywave::io::file_kind(&args.file)? {
            FileKind::Speckle => {
                let patterns = SpecklePatterns::load(&args.file)?;
                let mut figures = vec![crate::commands::wave::speckle_view::figure(&args.file, &patterns)?];
                // Patterns without dark fibers, or with a single instance, have no noise for comparison.
                figures.extend(crate::commands::wave::noise_view::lines(&args.file, &patterns).ok());
                return write(cli, &path, format, &Figure::below(figures));
            }
            FileKind::Fiber => {
                let table = plywave_fiber::FiberTable::load(&args.file)?;
                return write(cli, &path, format, &crate::commands::look::fiber_view::figure(&args.file, &table)?);
            }
            FileKind::Table | FileKind::Model | FileKind::Twin | FileKind::Family | FileKind::Cloth => {}
        }
    }
    let source = Source::load(cli, args)?;
    if matches!(args.part, Part::Noise) {
        let file = args.file.display().to_string();
        let Some(model) = &source.model else {
            return Err(Failure::input(file, "FILE", "a table", "--part noise goes with a model that has noise"));
        };
        model.require_noise(&file)?;
        return write(cli, &path, format, &crate::commands::wave::noise_view::model(&source.title, model));
    }
    if let Some(file) = &args.beside {
        let other = Source::load(cli, &PlotArgs { file: file.clone(), table: None, model: None, ..args.clone() })?;
        let sigma = args.sigma.first().copied().unwrap_or(0.0);
        let section = source.pair(&other, sigma, f64::from(args.decades));
        return write(cli, &path, format, &sheet::page(&source.title, &source.particulars, &[section]));
    }
    let reach = source.axes().1.last().copied().unwrap_or(0.0) / source.yarn.radius_um;
    if let Some(h) = args.h_rel.filter(|h| !(0.0..=reach * (1.0 + 1e-9)).contains(&h.abs())) {
        let hint = format!("must be from -{0} to {0}, where the beam still hits the ply", number(reach));
        return Err(Failure::input("command line", "--h-rel", h, &hint));
    }
    let sigmas: Vec<f64> = args.sigma.iter().map(|s| source.sigma(*s)).collect();
    let budget_sigma = sigmas.iter().copied().find(|s| *s > 0.0).unwrap_or_else(|| source.telling_sigma());
    let map_sigmas = if sigmas.is_empty() { vec![0.0] } else { sigmas };
    let decades = f64::from(args.decades);
    let mut sections = Vec::new();
    if matches!(args.part, Part::All | Part::Maps) {
        if args.theta_i.is_some() || args.h_rel.is_some() {
            let view = source.view(args.theta_i.unwrap_or(0.0), args.h_rel.unwrap_or(0.0));
            sections.extend(source.single(view, &map_sigmas, decades));
        } else {
            sections.extend(map_sigmas.iter().map(|s| source.overview(*s, decades)));
        }
    }
    if matches!(args.part, Part::All | Part::Energy) {
        sections.push(source.budgets(budget_sigma));
    }
    if matches!(args.part, Part::All | Part::Errors) {
        sections.push(source.errors(args)?);
    }
    write(cli, &path, format, &sheet::page(&source.title, &source.particulars, &sections))
}

/// Writes a figure and reports it.
fn write(cli: &Cli, path: &Path, format: Format, figure: &Figure) -> Outcome {
    let bytes = format.encode(figure, path)?;
    output::write_whole(path, &bytes)?;
    let (width, height) = figure.size();
    if cli.json {
        return output::print_json(&serde_json::json!({
            format.name(): path.display().to_string(), "width": width, "height": height, "bytes": bytes.len(),
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| writeln!(out, "{}: {width} x {height}", path.display()))
}
