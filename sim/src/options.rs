//! Sizes of a simulation: instances, paths, and the grids of incidence and outgoing directions. There are
//! named presets; keys of the spec override them.

use plywave::spec::{SimulationSpec, YarnSpec};
use serde::{Deserialize, Serialize};

/// X.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TracerKind {
    /// The screw march where the geometry allows it, else the mesh.
    #[default]
    Auto,
    /// The screw march through the cross section's distance grid.
    Screw,
    /// Triangles in a BVH.
    Mesh,
}

/// Sizes of a simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimOptions {
    /// Name of the preset that the options started from, for the record.
    pub preset: String,
    /// Seed of geometry and paths.
    pub seed: u64,
    /// Number of geometry instances of the ensemble. Every path rotates its instance at random, so that 8
    /// instances replace hundreds of fixed ones (docs/explain/papers/yu_2025.md, departure 8).
    pub instances: u32,
    /// Number of paths per incident latitude, shared by all h.
    pub paths_per_theta: u64,
    /// Number of incident latitudes, odd.
    pub theta_i_nodes: u32,
    /// Maximum incident latitude [rad].
    pub theta_i_max_rad: f64,
    /// Number of beam offsets, odd.
    pub h_nodes: u32,
    /// Number of latitude bins of the outgoing sphere.
    pub theta_o_bins: u32,
    /// Number of azimuth bins of the outgoing sphere.
    pub phi_o_bins: u32,
    /// Number of shards per incident latitude. A shard is the unit of work; an interruption loses at most the
    /// running shards.
    pub shards: u32,
    /// X.
    pub tracer: TracerKind,
    /// Whether to trace the whole yarn of the spec's plies instead of one ply: the brute-force reference of
    /// the model's multi-ply construction.
    pub traced_plies: bool,
}

impl SimOptions {
    /// Preset for a first look: under a minute for polyester on two cores, fit included.
    pub fn preview() -> Self {
        SimOptions {
            preset: "preview".into(),
            seed: 1,
            instances: 8,
            paths_per_theta: 500_000,
            theta_i_nodes: 5,
            theta_i_max_rad: 80f64.to_radians(),
            h_nodes: 13,
            theta_o_bins: 45,
            phi_o_bins: 90,
            shards: 8,
            tracer: TracerKind::Auto,
            traced_plies: false,
        }
    }

    /// Preset of the shipped models.
    pub fn standard() -> Self {
        SimOptions {
            preset: "standard".into(),
            instances: 32,
            paths_per_theta: 2_000_000,
            theta_i_nodes: 13,
            theta_i_max_rad: 84f64.to_radians(),
            h_nodes: 25,
            theta_o_bins: 90,
            phi_o_bins: 180,
            shards: 32,
            ..Self::preview()
        }
    }

    /// Preset for validation, with which the other presets are compared.
    pub fn reference() -> Self {
        SimOptions {
            preset: "reference".into(),
            instances: 64,
            paths_per_theta: 16_000_000,
            theta_i_nodes: 19,
            h_nodes: 37,
            theta_o_bins: 120,
            phi_o_bins: 240,
            shards: 64,
            ..Self::standard()
        }
    }

    /// The preset of this name: "preview", "standard" or "reference".
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "preview" => Some(Self::preview()),
            "standard" => Some(Self::standard()),
            "reference" => Some(Self::reference()),
            _ => None,
        }
    }

    /// These options with the overrides of the spec.
    pub fn overridden_by(mut self, spec: &SimulationSpec) -> Self {
        fn set<T: Copy>(to: &mut T, from: Option<T>) {
            if let Some(v) = from {
                *to = v;
            }
        }
        set(&mut self.instances, spec.instances);
        set(&mut self.paths_per_theta, spec.paths_per_theta);
        set(&mut self.theta_i_nodes, spec.theta_i_nodes);
        set(&mut self.theta_i_max_rad, spec.theta_i_max_rad);
        set(&mut self.h_nodes, spec.h_nodes);
        set(&mut self.theta_o_bins, spec.theta_o_bins);
        set(&mut self.phi_o_bins, spec.phi_o_bins);
        self
    }

    /// Incident latitudes [rad], uniform from 0.
    pub fn theta_i(&self) -> Vec<f64> {
        let n = self.theta_i_nodes.max(2);
        (0..n).map(|m| self.theta_i_max_rad * f64::from(m) / f64::from(n - 1)).collect()
    }

    /// Beam offsets [um], uniform over |h| <= R + d_cut. R is the ply's radius, or the larger one of an
    /// ellipse.
    pub fn h_um(&self, spec: &YarnSpec) -> Vec<f64> {
        let radius = spec.ply.radius_um.or(spec.ply.radii_um.map(|r| r[0].max(r[1]))).unwrap_or(0.0);
        let reach = radius + spec.beam.beam().d_cut_um;
        let n = self.h_nodes.max(2);
        (0..n).map(|k| reach * (2.0 * f64::from(k) / f64::from(n - 1) - 1.0)).collect()
    }
}
