// A ply's lobes over the beam and the absorption.

import { bound, element, slider, turning } from "./dom";
import type { Link } from "./link";
import { LobeSurface } from "./lobe_surface";
import { Ply, Traced } from "../pkg/plywave_web.js";

/** Rows of directions while something moves and at rest, where sharp lobes are to show no facets; columns are twice as many. */
const ROWS_MOVING = 64;
const ROWS_AT_REST = 128;
/** When all is at rest, after the last change [ms]. */
const REST_MS = 150;
/** Points of the polar plot. */
const POINTS = 360;
/** Powers of ten that it spans. */
const DECADES = 4;

/** Absorption [1/um] of a slider from 0 to 1: none at 0, then by powers of ten up to 0.1. */
function sigmaOf(slider: number): number {
  return slider === 0 ? 0 : 10 ** (-5 + 4 * slider);
}

/** The view of a ply. */
export class PlyView {
  private ply: Ply | null = null;
  private traced: Traced | null = null;
  private readonly surface = new LobeSurface(element<HTMLCanvasElement>("lobe"));
  private readonly values = { theta: 20, h: 0, sigma: 0.4, lambda: 550, edge: 1 };
  private readonly sliders: Record<"theta" | "h" | "sigma" | "lambda", (value: number) => number>;
  private asked = false;
  private rest = 0;
  /** Times at which frames were drawn [ms], of the last second. */
  private frames: number[] = [];

  constructor(private readonly link: Link) {
    const change = (name: keyof typeof this.values) => (value: number) => {
      this.values[name] = value;
      link.set(name, value);
      this.ask();
    };
    this.sliders = {
      theta: slider("theta", (v) => `${v.toFixed(1)}°`, change("theta")),
      h: slider("h", (v) => v.toFixed(3), change("h")),
      sigma: slider("sigma", (v) => `${sigmaOf(v).toPrecision(2)} /um`, change("sigma")),
      lambda: slider("lambda", (v) => `${v} nm`, change("lambda")),
    };
    const edge = element<HTMLInputElement>("edge");
    edge.addEventListener("change", () => change("edge")(Number(edge.checked)));
    turning(element<HTMLCanvasElement>("lobe"), (about, up) => {
      this.surface.turn(about, up);
      this.ask();
    });
    addEventListener("resize", () => this.surface.draw());
    this.drawAxes();
  }

  /** Shows a ply. */
  open(bytes: Uint8Array, file: string): string {
    const ply = new Ply(bytes, file);
    this.ply?.free();
    this.traced?.free();
    [this.ply, this.traced] = [ply, null];
    bound("h", ply.hMaxUm / ply.radiusUm);
    for (const name of ["theta", "h", "sigma", "lambda"] as const) {
      this.values[name] = this.sliders[name](this.link.number(name, this.values[name]));
    }
    const edge = element<HTMLInputElement>("edge");
    edge.checked = this.link.number("edge", 1) !== 0;
    edge.disabled = !ply.hasEdge;
    this.values.edge = Number(edge.checked);
    this.ask();
    return `${ply.name}: a ply of radius ${Number(ply.radiusUm.toFixed(1))} um`;
  }

  /** Shows the table of paths beside the model. */
  openTable(bytes: Uint8Array, file: string): void {
    const traced = new Traced(bytes, file);
    if (!this.ply?.isOf(traced)) throw new Error(`${file}: the table of another yarn spec than this model's.`);
    this.traced?.free();
    this.traced = traced;
    this.ask();
  }

  private ask(): void {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw(ROWS_MOVING);
      clearTimeout(this.rest);
      this.rest = window.setTimeout(() => this.draw(ROWS_AT_REST), REST_MS);
    });
  }

  private draw(rows: number): void {
    const ply = this.ply;
    if (!ply) return;
    let theta = (this.values.theta * Math.PI) / 180;
    let h = this.values.h * ply.radiusUm;
    let sigma = sigmaOf(this.values.sigma);
    const lambda = this.values.lambda / 1000;
    // Tables are of rays.
    const edge = this.values.edge !== 0 && ply.hasEdge && !this.traced;
    if (this.traced) [theta = 0, h = 0, sigma = 0] = this.traced.nearest(theta, h, sigma);
    const latitude = this.traced?.latitudeNear(-theta) ?? -theta;
    this.surface.show(ply.map(theta, h, sigma, lambda, edge, rows, 2 * rows), rows, theta, rows === ROWS_AT_REST ? 2 : 1);
    const directions = new Float32Array(3 * POINTS);
    for (let k = 0; k < POINTS; k++) {
      const phi = (2 * Math.PI * k) / POINTS;
      directions.set([Math.cos(latitude) * Math.cos(phi), Math.cos(latitude) * Math.sin(phi), Math.sin(latitude)], 3 * k);
    }
    this.drawSlice(ply.eval(theta, h, sigma, lambda, edge, directions), this.traced?.slice(theta, h, sigma, latitude));
    const degrees = (angle: number) => ((angle * 180) / Math.PI).toFixed(1);
    element("beside").textContent = this.traced
      ? `Dots: paths traced through fibers, at the incidence of the table that is nearest: theta_i ${degrees(theta)}°, h ${h.toFixed(1)} um, sigma ${sigma.toPrecision(2)} /um; latitude ${degrees(latitude)}°.`
      : "";
    const names = ["only reflected at fibers (f_refl)", "scattered otherwise (f_high)", "passed beside all fibers (r_d)"];
    const shares = ply.energies(theta, h, sigma);
    element("energies").innerHTML = names.map((name, k) => `<dt>${name}</dt><dd>${(100 * (shares[k] ?? 0)).toFixed(1)} %</dd>`).join("");
    const now = performance.now();
    this.frames = [...this.frames.filter((at) => now - at < 1000), now];
    element("rate").textContent = `${this.frames.length} frames in the last second`;
  }

  private drawAxes(): void {
    const circles = Array.from({ length: DECADES }, (_, k) => `<circle r="${(100 * (k + 1)) / DECADES}" />`);
    element("polar").innerHTML =
      `<g fill="none" stroke="currentColor" stroke-opacity="0.25" stroke-width="0.5">${circles.join("")}` +
      `<path d="M-100 0H100M0 -100V100" /></g><path id="slice" fill="#2a9d8f55" stroke="#2a9d8f" /><path id="traced" stroke="#e76f51" stroke-width="2.5" stroke-linecap="round" />` +
      `<g id="decades" font-size="7" fill="currentColor"></g>`;
  }

  /** Draws the model's slice, and bins of a table as dots at their middles. */
  private drawSlice(f: Float32Array, traced: Float32Array = new Float32Array()): void {
    const top = Math.ceil(Math.log10(f.reduce((a, b) => Math.max(a, b), 1e-12)));
    const points = (values: Float32Array, middle: number) =>
      [...values].map((value, k) => {
        const radius = Math.max(0, 100 * (1 - (top - Math.log10(Math.max(value, 1e-30))) / DECADES));
        const phi = (2 * Math.PI * (k + middle)) / values.length;
        return `${(radius * Math.cos(phi)).toFixed(2)} ${(-radius * Math.sin(phi)).toFixed(2)}`;
      });
    element("slice").setAttribute("d", `M${points(f, 0).join("L")}Z`);
    element("traced").setAttribute("d", points(traced, 0.5).map((at) => `M${at}h0`).join(""));
    element("decades").innerHTML = Array.from(
      { length: DECADES },
      (_, k) => `<text x="2" y="${(-100 * (k + 1)) / DECADES + 7}">1e${top - DECADES + k + 1}</text>`,
    ).join("");
  }
}
