// A ply's lobes over the beam and the absorption.

import { element, slider, turning } from "./dom";
import type { Link } from "./link";
import { LobeSurface } from "./lobe_surface";
import { Ply } from "../pkg/plywave_web.js";

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
  private readonly surface = new LobeSurface(element<HTMLCanvasElement>("lobe"));
  private readonly values = { theta: 20, h: 0, sigma: 0.4, lambda: 550, edge: 1 };
  private readonly sliders: Record<"theta" | "h" | "sigma" | "lambda", (value: number) => void>;
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
    this.ply = ply;
    for (const name of ["theta", "h", "sigma", "lambda"] as const) {
      this.values[name] = this.link.number(name, this.values[name]);
      this.sliders[name](this.values[name]);
    }
    const edge = element<HTMLInputElement>("edge");
    edge.checked = this.link.number("edge", 1) !== 0;
    edge.disabled = !ply.hasEdge;
    this.values.edge = Number(edge.checked);
    this.ask();
    return `${ply.name}: a ply of radius ${ply.hMaxUm.toFixed(0)} um`;
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
    const theta = (this.values.theta * Math.PI) / 180;
    const h = this.values.h * ply.hMaxUm;
    const sigma = sigmaOf(this.values.sigma);
    const lambda = this.values.lambda / 1000;
    const edge = this.values.edge !== 0 && ply.hasEdge;
    this.surface.show(ply.map(theta, h, sigma, lambda, edge, rows, 2 * rows), rows, theta, rows === ROWS_AT_REST ? 2 : 1);
    const directions = new Float32Array(3 * POINTS);
    for (let k = 0; k < POINTS; k++) {
      const phi = (2 * Math.PI * k) / POINTS;
      directions.set([Math.cos(theta) * Math.cos(phi), Math.cos(theta) * Math.sin(phi), -Math.sin(theta)], 3 * k);
    }
    this.drawSlice(ply.eval(theta, h, sigma, lambda, edge, directions));
    const names = ["reflected at fibers once", "scattered otherwise", "passed beside all fibers"];
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
      `<path d="M-100 0H100M0 -100V100" /></g><path id="slice" fill="#2a9d8f55" stroke="#2a9d8f" />` +
      `<g id="decades" font-size="7" fill="currentColor"></g>`;
  }

  private drawSlice(f: Float32Array): void {
    const top = Math.ceil(Math.log10(f.reduce((a, b) => Math.max(a, b), 1e-12)));
    let path = "";
    f.forEach((value, k) => {
      const radius = Math.max(0, 100 * (1 - (top - Math.log10(Math.max(value, 1e-30))) / DECADES));
      const phi = (2 * Math.PI * k) / f.length;
      path += `${k ? "L" : "M"}${(radius * Math.cos(phi)).toFixed(2)} ${(-radius * Math.sin(phi)).toFixed(2)}`;
    });
    element("slice").setAttribute("d", path + "Z");
    element("decades").innerHTML = Array.from(
      { length: DECADES },
      (_, k) => `<text x="2" y="${(-100 * (k + 1)) / DECADES + 7}">1e${top - DECADES + k + 1}</text>`,
    ).join("");
  }
}
