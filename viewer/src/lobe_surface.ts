// A surface whose distance from the middle, in each direction, grows with f; by WebGL2.

const VERTEX = `#version 300 es
uniform highp sampler2D f;
uniform ivec2 size;
uniform mat3 turn;
uniform float largest;
out vec3 place;
out float level;
const float PI = 3.141592653589793;
void main() {
  int row = gl_VertexID / size.x;
  int column = gl_VertexID % size.x;
  float value = texelFetch(f, ivec2(column, row), 0).r;
  float angle = PI * (float(row) + 0.5) / float(size.y);
  float phi = 2.0 * PI * (float(column) + 0.5) / float(size.x);
  level = pow(max(value, 0.0) / largest, 0.4);
  // Of the ply's frame: z, its axis, lies across the page, y, towards the beam, is up.
  vec3 w = vec3(sin(angle) * cos(phi), sin(angle) * sin(phi), cos(angle));
  place = turn * vec3(w.z, w.y, -w.x) * level;
  gl_Position = vec4(place.xy * 0.95, -0.5 * place.z, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 place;
in float level;
out vec4 color;
void main() {
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float light = 0.35 + 0.65 * abs(dot(normal, normalize(vec3(0.3, 0.5, 0.8))));
  // Blue to yellow, growing in lightness.
  vec3 low = vec3(0.13, 0.25, 0.55), middle = vec3(0.15, 0.62, 0.56), high = vec3(0.99, 0.87, 0.25);
  vec3 base = level < 0.5 ? mix(low, middle, 2.0 * level) : mix(middle, high, 2.0 * level - 1.0);
  color = vec4(base * light, 1.0);
}`;

const LINE_VERTEX = `#version 300 es
uniform mat3 turn;
in vec3 at;
void main() {
  vec3 place = turn * at;
  gl_Position = vec4(place.xy * 0.95, -0.5 * place.z, 1.0);
}`;

const LINE_FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 ink;
out vec4 color;
void main() { color = vec4(ink, 1.0); }`;

function program(gl: WebGL2RenderingContext, vertex: string, fragment: string): WebGLProgram {
  const made = gl.createProgram();
  for (const [type, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ] as const) {
    const shader = gl.createShader(type);
    if (!shader) throw new Error("WebGL2 lost its context");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made) ?? "program");
  return made;
}

/** Two triangles a cell of the grid; columns close around. */
function triangles(rows: number, columns: number): Uint16Array {
  const corners: number[] = [];
  for (let row = 0; row + 1 < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const [a, b] = [row * columns + column, row * columns + ((column + 1) % columns)];
      corners.push(a, b, a + columns, a + columns, b, b + columns);
    }
  }
  return Uint16Array.from(corners);
}

/** A grid of values over the sphere, on the graphics processor. */
interface Grid {
  readonly rows: number;
  readonly texture: WebGLTexture;
  readonly triangles: WebGLBuffer;
}

/** The surface, the ply's axis and the beam. */
export class LobeSurface {
  private readonly gl: WebGL2RenderingContext;
  private readonly surface: WebGLProgram;
  private readonly line: WebGLProgram;
  private readonly lines: WebGLBuffer;
  private about = 0.5;
  private up = 0.35;
  private thetaI = 0;
  private largest = 1;
  private readonly grids: Grid[] = [];
  private shown: Grid | null = null;
  /** Pixels of the canvas to one of the screen: more when nothing moves, against jagged edges. */
  private sharpness = 1;

  constructor(private readonly canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", { antialias: false });
    if (!gl) throw new Error("This browser has no WebGL2, which the lobes are drawn with.");
    this.gl = gl;
    this.surface = program(gl, VERTEX, FRAGMENT);
    this.line = program(gl, LINE_VERTEX, LINE_FRAGMENT);
    this.lines = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lines);
    gl.enable(gl.DEPTH_TEST);
  }

  private grid(rows: number): Grid {
    const known = this.grids.find((grid) => grid.rows === rows);
    if (known) return known;
    const gl = this.gl;
    const grid = { rows, texture: gl.createTexture(), triangles: gl.createBuffer() };
    gl.bindTexture(gl.TEXTURE_2D, grid.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32F, 2 * rows, rows);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, grid.triangles);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles(rows, 2 * rows), gl.STATIC_DRAW);
    this.grids.push(grid);
    return grid;
  }

  /** Turns the view [rad], for the next drawing. */
  turn(about: number, up: number): void {
    this.about += about;
    this.up = Math.max(-1.5, Math.min(1.5, this.up + up));
  }

  /** Shows values of `Ply.map` of so many rows and twice the columns, of a beam at this latitude. */
  show(f: Float32Array, rows: number, thetaI: number, sharpness: number): void {
    const gl = this.gl;
    this.shown = this.grid(rows);
    gl.bindTexture(gl.TEXTURE_2D, this.shown.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 2 * rows, rows, gl.RED, gl.FLOAT, f);
    [this.thetaI, this.sharpness] = [thetaI, sharpness];
    this.largest = f.reduce((a, b) => Math.max(a, b), 1e-9);
    this.draw();
  }

  draw(): void {
    const { gl, shown } = this;
    if (!shown) return;
    const side = Math.max(1, Math.round(this.canvas.clientWidth * devicePixelRatio * this.sharpness));
    if (this.canvas.width !== side) this.canvas.width = this.canvas.height = side;
    gl.viewport(0, 0, side, side);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [ca, sa, cu, su] = [Math.cos(this.about), Math.sin(this.about), Math.cos(this.up), Math.sin(this.up)];
    // By columns.
    const turn = new Float32Array([ca, su * sa, -cu * sa, 0, cu, su, sa, -su * ca, cu * ca]);
    gl.useProgram(this.surface);
    gl.uniformMatrix3fv(gl.getUniformLocation(this.surface, "turn"), false, turn);
    gl.uniform2i(gl.getUniformLocation(this.surface, "size"), 2 * shown.rows, shown.rows);
    gl.bindTexture(gl.TEXTURE_2D, shown.texture);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, shown.triangles);
    gl.uniform1f(gl.getUniformLocation(this.surface, "largest"), this.largest);
    gl.drawElements(gl.TRIANGLES, 12 * shown.rows * (shown.rows - 1), gl.UNSIGNED_SHORT, 0);
    gl.useProgram(this.line);
    gl.uniformMatrix3fv(gl.getUniformLocation(this.line, "turn"), false, turn);
    const to = [Math.sin(this.thetaI), Math.cos(this.thetaI), 0];
    const ink = [0.5, 0.5, 0.5];
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, 0, 0, 1, 0, 0, 0, 0, 0, ...to]), gl.STREAM_DRAW);
    const at = gl.getAttribLocation(this.line, "at");
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
    gl.uniform3fv(gl.getUniformLocation(this.line, "ink"), ink);
    gl.drawArrays(gl.LINES, 0, 2);
    gl.uniform3f(gl.getUniformLocation(this.line, "ink"), 0.95, 0.45, 0.2);
    gl.drawArrays(gl.LINES, 2, 2);
    gl.disableVertexAttribArray(at);
  }
}
