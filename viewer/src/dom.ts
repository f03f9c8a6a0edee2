// Elements of the page by their id.

/** The element with this id. */
export function element<T extends Element>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`no element ${id}`);
  return found as unknown as T;
}

/** A slider whose value shows beside its name. Returns a function that sets it, and returns the value within the slider's range. */
export function slider(id: string, show: (value: number) => string, changed: (value: number) => void): (value: number) => number {
  const input = element<HTMLInputElement>(id);
  const output = input.parentElement?.querySelector("output");
  const tell = () => {
    const text = show(input.valueAsNumber);
    if (output) output.textContent = text;
    input.setAttribute("aria-valuetext", text);
  };
  input.addEventListener("input", () => {
    tell();
    changed(input.valueAsNumber);
  });
  return (value) => {
    input.valueAsNumber = value;
    tell();
    return input.valueAsNumber;
  };
}

/** Lets a slider go from -`most` to `most`, by whole steps of it. */
export function bound(id: string, most: number): void {
  const input = element<HTMLInputElement>(id);
  const step = Number(input.step);
  input.max = (Math.floor(most / step + 1e-6) * step).toFixed(6);
  input.min = `-${input.max}`;
}

/** Turns by dragging and by arrow keys: calls `turned` with the angles [rad] about the upright axis and up. */
export function turning(canvas: HTMLCanvasElement, turned: (about: number, up: number) => void): void {
  const perPixel = 0.01;
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) turned(-event.movementX * perPixel, event.movementY * perPixel);
  });
  canvas.addEventListener("keydown", (event) => {
    const step = 0.1;
    const [about, up] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] }[event.key] ?? [0, 0];
    if (about !== 0 || up !== 0) {
      event.preventDefault();
      turned(about ?? 0, up ?? 0);
    }
  });
}
