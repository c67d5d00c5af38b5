// Programs for the graphics processor: the light of voxels, and rays through them. Both do what the
// session's renderer does, in the same order: see crates/render.

/// Corners of bricks in a layer of the volume.
export const LAYER = `#version 300 es
in vec2 brick;
uniform vec2 bricks;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  gl_Position = vec4((brick + corner) / bricks * 2.0 - 1.0, 0.0, 1.0);
}`;

/// Colour, premultiplied, and opacity of a step of each voxel; or its value and that it was seen.
export const LIGHT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler3D;
uniform sampler3D voxels;
uniform sampler2D table;
uniform sampler2D slopes;
uniform int layer;
uniform int mode;
uniform bool grey;
uniform vec2 window;
uniform vec3 pitch;
uniform float unit_mm, step_mm, border_mm;
uniform vec4 parts;
uniform bool two_sided;
uniform vec3 to_light, halfway;
uniform vec4 depth;
uniform vec2 cue;
out vec4 lit;

const float FLAT = 2e-3;

// Share of white, and weight.
vec2 share(ivec3 at) {
  vec4 read = floor(texelFetch(voxels, at, 0) * 255.0 + 0.5);
  float code = read.b * 256.0 + read.a;
  float weight = code < 0.5 ? 0.0 : exp2(floor(code / 4096.0)) * (1.0 + mod(code, 4096.0) / 4096.0);
  return vec2((read.r * 256.0 + read.g) / 65280.0, weight);
}

// Grey value and weight.
vec2 voxel(ivec3 at) {
  vec2 read = share(at);
  return vec2(mix(window.x, window.y, read.x), read.y);
}

float gradient(float centre, vec2 before, vec2 behind, float pitch) {
  float weight = before.y + behind.y;
  if (weight <= 0.0) return 0.0;
  float rise = behind.y > 0.0 ? behind.y * (behind.x - centre) : 0.0;
  float approach = before.y > 0.0 ? before.y * (centre - before.x) : 0.0;
  return (rise + approach) / (weight * pitch);
}

float factor(float slope) {
  int n = textureSize(slopes, 0).x;
  vec2 before = texelFetch(slopes, ivec2(0), 0).rg;
  if (slope <= before.x) return before.y;
  for (int i = 1; i < n; i++) {
    vec2 next = texelFetch(slopes, ivec2(i, 0), 0).rg;
    if (slope < next.x) return mix(before.y, next.y, (slope - before.x) / (next.x - before.x));
    before = next;
  }
  return before.y;
}

float opacity(float of_value, float slope) {
  float alpha = of_value;
  if (border_mm > 0.0) alpha = slope >= FLAT ? clamp(slope * border_mm * of_value, 0.0, 1.0) : 0.0;
  alpha *= factor(slope);
  if (step_mm == unit_mm || alpha <= 0.0 || alpha >= 1.0) return alpha;
  return 1.0 - pow(1.0 - alpha, step_mm / unit_mm);
}

float cosine(vec3 slope, float length, vec3 direction) {
  float c = -dot(slope, direction) / length;
  return clamp(two_sided ? abs(c) : c, 0.0, 1.0);
}

void main() {
  ivec3 at = ivec3(gl_FragCoord.xy, layer);
  vec2 read = share(at);
  lit = vec4(0.0);
  if (read.y <= 0.0) return;
  if (mode == 2) {
    lit = grey ? vec4(read.x, 1.0, 0.0, 0.0) : vec4(read.xxx, 1.0);
    return;
  }
  vec2 own = voxel(at);
  vec3 slope = vec3(
    gradient(own.x, voxel(at - ivec3(1, 0, 0)), voxel(at + ivec3(1, 0, 0)), pitch.x),
    gradient(own.x, voxel(at - ivec3(0, 1, 0)), voxel(at + ivec3(0, 1, 0)), pitch.y),
    gradient(own.x, voxel(at - ivec3(0, 0, 1)), voxel(at + ivec3(0, 0, 1)), pitch.z));
  float steep = length(slope);
  float place = read.x * 255.0;
  int low = int(place);
  vec4 entry = mix(texelFetch(table, ivec2(low, 0), 0), texelFetch(table, ivec2(min(255, low + 1), 0), 0), fract(place));
  float alpha = opacity(entry.a, steep);
  vec3 colour = vec3(1.0);
  float strength = alpha;
  if (mode == 0) {
    float body = parts.x, highlight = 0.0;
    if (steep >= FLAT) {
      float facing = cosine(slope, steep, to_light);
      if (facing > 0.0) {
        body += parts.y * facing;
        float reflected = cosine(slope, steep, halfway);
        highlight = parts.z * (reflected > 0.0 ? pow(reflected, parts.w) : 0.0);
      }
    }
    colour = clamp(body * entry.rgb + highlight, 0.0, 1.0);
    float far = clamp(depth.w + dot(depth.xyz, vec3(at)), 0.0, 1.0);
    if (cue.y > 0.0) strength *= cue.x * cue.y / (cue.y + far * (cue.x - cue.y));
  }
  colour *= strength;
  lit = grey ? vec4(colour.r, alpha, 0.0, 0.0) : vec4(colour, alpha);
}`;

/// All of the picture.
export const PICTURE = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`;

/// A ray for each pixel: samples at the session's places, composited in its blocks.
export const RAYS = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler3D;
uniform sampler3D lit;
uniform sampler3D visible;
uniform sampler2D table;
uniform bool perspective;
uniform vec3 origin, right, down, ahead;
uniform mat3 region_from_world;
uniform float near_mm, step_mm;
uniform int samples, arity;
uniform float stop, top;
uniform int mode;
uniform bool grey;
uniform float height;
uniform vec3 background;
out vec4 pixel;

vec3 colour(float share) {
  float at = clamp(share, 0.0, 1.0) * 255.0;
  vec3 low = texelFetch(table, ivec2(int(at), 0), 0).rgb;
  vec3 high = texelFetch(table, ivec2(min(255, int(at) + 1), 0), 0).rgb;
  return mix(low, high, fract(at));
}

void main() {
  vec2 at_pixel = vec2(gl_FragCoord.x - 0.5, height - 0.5 - gl_FragCoord.y);
  vec3 base = origin + right * at_pixel.x + down * at_pixel.y;
  vec3 stride = ahead;
  if (perspective) {
    vec3 per_mm = region_from_world * normalize(ahead + right * at_pixel.x + down * at_pixel.y);
    base = origin + per_mm * near_mm;
    stride = per_mm * step_mm;
  }
  ivec3 bricks = textureSize(visible, 0);
  vec3 voxels = vec3(bricks * 8);
  vec3 along = mix(stride, vec3(1e-9), lessThan(abs(stride), vec3(1e-9)));
  vec3 low = -base / along, high = (voxels - base) / along;
  vec3 least = min(low, high), most = max(low, high);
  float last = float(samples - 1);
  int k = int(ceil(clamp(max(max(least.x, least.y), least.z), 0.0, last + 1.0)));
  int end = int(floor(clamp(min(min(most.x, most.y), most.z), -1.0, last))) + 1;
  vec3 sum = vec3(0.0);
  float clear = 1.0;
  int block = k / arity;
  while (k < end) {
    if (k / arity != block) {
      block = k / arity;
      if (mode == 0 && clear < stop) break;
      if (mode == 1 && clear < 1.0 && sum.r >= top) break;
    }
    vec3 at = base + stride * float(k);
    ivec3 brick = ivec3(floor(at / 8.0));
    if (any(lessThan(brick, ivec3(0))) || any(greaterThanEqual(brick, bricks))) {
      k++;
      continue;
    }
    if (texelFetch(visible, brick, 0).r == 0.0) {
      vec3 leave = (vec3(brick) * 8.0 + 8.0 * vec3(greaterThan(along, vec3(0.0))) - at) / along;
      k += max(1, int(ceil(min(min(leave.x, leave.y), leave.z) - 1e-3)));
      continue;
    }
    vec4 read = textureLod(lit, (at + 0.5) / voxels, 0.0);
    vec3 rgb = grey ? read.rrr : read.rgb;
    float alpha = grey ? read.g : read.a;
    if (mode == 0) {
      sum += clear * rgb;
      clear -= clear * alpha;
    } else if (mode == 1) {
      if (alpha >= 0.5) {
        sum.r = clear >= 1.0 ? rgb.r / alpha : max(sum.r, rgb.r / alpha);
        clear = 0.0;
      }
    } else {
      sum.r += rgb.r;
      clear -= alpha;
    }
    k++;
  }
  if (mode > 0) {
    float seen = 1.0 - clear;
    bool is_empty = mode == 1 ? seen <= 0.0 : seen <= 1.0 / 64.0;
    sum = is_empty ? vec3(0.0) : colour(sum.r / seen);
    clear = is_empty ? 1.0 : 0.0;
  }
  pixel = vec4(sum + clear * background, 1.0);
}`;
