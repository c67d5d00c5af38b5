// The browser's graphics processor by WebGL 2: a context, programs, and textures.

import { LAYER, LIGHT, PICTURE, RAYS } from "./gpu_shaders.js";

// Texture units: voxels as they came, their light, visible bricks, colours, and factors of slopes.
const UNITS = { voxels: 0, lit: 1, visible: 2, table: 3, slopes: 4 };

// Names of processors that are imitated. Not every browser counts them as slow.
const IMITATED = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/// Returns a context, or throws a sentence. `software` accepts a processor that is imitated, which
/// is too slow for anything but tests.
export function contextOf(canvas, software) {
  if (typeof WebGL2RenderingContext === "undefined") throw new Error("this browser has no WebGL 2");
  const asks = { alpha: false, antialias: false, depth: false, failIfMajorPerformanceCaveat: !software, powerPreference: "high-performance" };
  const gl = canvas.getContext("webgl2", asks);
  const known = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = known ? gl.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
  if (!gl || (!software && IMITATED.test(name))) throw new Error("this browser has no fast WebGL 2");
  // Half-precision numbers are drawn into, and read between.
  if (!gl.getExtension("EXT_color_buffer_float") && !gl.getExtension("EXT_color_buffer_half_float")) {
    throw new Error("this browser cannot draw into half-precision textures");
  }
  return gl;
}

/// Programs and textures of a context. After a loss of the context, another one is made.
export class Gpu {
  gl;
  light;
  rays;
  #textures = {};
  #frame;

  constructor(gl) {
    this.gl = gl;
    this.light = this.#program(LAYER, LIGHT);
    this.rays = this.#program(PICTURE, RAYS);
    this.#frame = gl.createFramebuffer();
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
  }

  #program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    // The only attribute, if there is one.
    gl.bindAttribLocation(program, 0, "brick");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error(`this browser cannot compile the page's drawing: ${[gl.getProgramInfoLog(program), ...logs].filter(Boolean).join(" ")}`);
    }
    const uniforms = {};
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) ?? 0;
    for (let n = 0; n < count; n += 1) {
      const { name, type } = gl.getActiveUniform(program, n);
      uniforms[name] = { place: gl.getUniformLocation(program, name), type };
    }
    return { program, uniforms };
  }

  /// Begins a program with these values by name.
  use({ program, uniforms }, values) {
    const { gl } = this;
    gl.useProgram(program);
    for (const [name, value] of Object.entries({ ...UNITS, ...values })) {
      if (!uniforms[name]) continue;
      const { place, type } = uniforms[name];
      if ([gl.INT, gl.BOOL, gl.SAMPLER_2D, gl.SAMPLER_3D].includes(type)) gl.uniform1i(place, value);
      else if (type === gl.FLOAT) gl.uniform1f(place, value);
      else if (type === gl.FLOAT_VEC2) gl.uniform2fv(place, value);
      else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, value);
      else if (type === gl.FLOAT_VEC4) gl.uniform4fv(place, value);
      else gl.uniformMatrix3fv(place, false, value);
    }
  }

  /// Replaces a texture of the volume by an empty one of `size` texels.
  volume(name, format, size, linear = false) {
    const { gl } = this;
    this.#begin(name, gl.TEXTURE_3D, linear);
    gl.texStorage3D(gl.TEXTURE_3D, 1, format, ...size);
  }

  /// Replaces a texture of a row of numbers, so many a texel.
  row(name, numbers, each) {
    const { gl } = this;
    this.#begin(name, gl.TEXTURE_2D, false);
    const [format, kind] = each === 2 ? [gl.RG32F, gl.RG] : [gl.RGBA32F, gl.RGBA];
    gl.texImage2D(gl.TEXTURE_2D, 0, format, numbers.length / each, 1, 0, kind, gl.FLOAT, Float32Array.from(numbers));
  }

  /// Replaces a box of texels.
  write(name, at, size, format, bytes) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.texSubImage3D(gl.TEXTURE_3D, 0, ...at, ...size, format, gl.UNSIGNED_BYTE, bytes);
  }

  /// Draws into layers of a texture from now on; null: into the canvas.
  into(name, layer, [width, height]) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, name ? this.#frame : null);
    if (name) gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, this.#textures[name], 0, layer);
    gl.viewport(0, 0, width, height);
  }

  #begin(name, kind, linear) {
    const { gl } = this;
    gl.deleteTexture(this.#textures[name] ?? null);
    this.#textures[name] = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(kind, this.#textures[name]);
    const filter = linear ? gl.LINEAR : gl.NEAREST;
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(kind, key, filter);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(kind, key, gl.CLAMP_TO_EDGE);
  }
}
