// The viewer's image of one or two XYZ images: zoom, exposure, the sRGB curve or a palette, and a comparison of both.
// A screen pixel that is smaller than a sample shows the nearest sample; a larger one shows the mean XYZ of its area.
// Positions in the image are fractions of its width and height. Twin: holoview/viewer/render/tone_mapping.py, tone_map.
//#include "lib/srgb.wgsl"

@group(0) @binding(0) var<uniform> viewport: Viewport;

@group(1) @binding(0) var<storage, read> image_a: array<vec4f>;
@group(1) @binding(1) var<storage, read> image_b: array<vec4f>;
@group(1) @binding(2) var<storage, read> palette: array<u32>;  // 256 colours
@group(1) @binding(3) var target_texture: texture_storage_2d<rgba8unorm, write>;

// Options are constants, not uniforms: lavapipe recompiles a shader for each submission if its branches depend on a
// uniform.
override comparison: u32 = 0u;  // ONE, WIPE, SIDES or DIFFERENCE
override only_b: bool = false;  // with ONE: show image b
override has_palette: bool = false;
override is_linear: bool = false;  // the value, not its sRGB code, is the index into the palette
override has_gamma: bool = false;
override keeps_hue: bool = false;  // of a colour that the screen can't show
override has_grid: bool = false;
override taps: i32 = 1;  // the most samples that a pixel covers along an axis
override is_sparse: bool = false;  // a pixel covers more samples, of which taps × taps are read

const LUMINANCE = vec3f(0.21263901, 0.71516868, 0.07219232);  // of linear sRGB: SRGB_TO_XYZ[1]
const ONE = 0u;
const WIPE = 1u;
const SIDES = 2u;
const DIFFERENCE = 3u;

// XYZ of a sample, or of the nearest one if it lies outside the image.
fn sample_at(is_b: bool, position: vec2i, size: vec2i) -> vec3f {
    let nearest = clamp(position, vec2i(0), size - 1);
    let index = nearest.y * size.x + nearest.x;
    if (is_b) {
        return image_b[index].xyz;
    }
    return image_a[index].xyz;
}

// Mean XYZ over the area of a pixel with the corners `low` and `high`, in samples. Each sample is weighted by its
// covered area; point sampling would produce moiré.
fn mean_xyz(is_b: bool, low: vec2f, high: vec2f, size: vec2i) -> vec3f {
    if (taps == 1) {
        return sample_at(is_b, vec2i(floor(0.5 * (low + high))), size);
    }
    var sum = vec3f(0.0);
    if (is_sparse) {
        for (var y = 0; y < taps; y++) {
            for (var x = 0; x < taps; x++) {
                let fraction = (vec2f(f32(x), f32(y)) + 0.5) / f32(taps);
                sum += sample_at(is_b, vec2i(floor(mix(low, high, fraction))), size);
            }
        }
        return sum / f32(taps * taps);
    }
    let first = vec2i(floor(low));
    for (var y = first.y; y < first.y + taps; y++) {
        let height = max(min(high.y, f32(y + 1)) - max(low.y, f32(y)), 0.0);
        for (var x = first.x; x < first.x + taps; x++) {
            let width = max(min(high.x, f32(x + 1)) - max(low.x, f32(x)), 0.0);
            sum += width * height * sample_at(is_b, vec2i(x, y), size);
        }
    }
    return sum / ((high.x - low.x) * (high.y - low.y));
}

// Exposed channels of an image at a position, from 0 (black) to 1 (white).
fn channels(is_b: bool, position: vec2f) -> vec3f {
    let size = vec2f(select(viewport.size_a, viewport.size_b, is_b));
    let half_step = 0.5 * viewport.step;
    let gain = select(viewport.gain_a, viewport.gain_b, is_b);
    let xyz = gain.xyz * mean_xyz(is_b, (position - half_step) * size, (position + half_step) * size, vec2i(size));
    return vec3f(
        dot(viewport.channel_r.xyz, xyz) + viewport.channel_r.w,
        dot(viewport.channel_g.xyz, xyz) + viewport.channel_g.w,
        dot(viewport.channel_b.xyz, xyz) + viewport.channel_b.w,
    );
}

// sRGB codes of linear channels, with the viewer's gamma.
fn encode(value: vec3f) -> vec3f {
    let code = srgb_encode(clamp(value, vec3f(0.0), vec3f(1.0)));
    if (has_gamma) {
        return pow(code, vec3f(1.0 / viewport.gamma));
    }
    return code;
}

// The colour with channels from 0 to 1 of the same hue. Twin: holoview/colour.py, gamut_map by "hue".
fn with_hue(value: vec3f) -> vec3f {
    let luminance = max(dot(value, LUMINANCE), 0.0);
    let least = min(min(value.x, min(value.y, value.z)), 0.0);
    if (luminance <= 0.0) {
        return vec3f(0.0);
    }
    let inside = max(luminance + luminance / (luminance - least) * (value - luminance), vec3f(0.0));
    return inside / max(max(inside.x, max(inside.y, inside.z)), 1.0);
}

// Colour of the palette for an index from 0 to 1.
fn palette_colour(code: f32) -> vec3f {
    return unpack4x8unorm(palette[u32(round(255.0 * clamp(code, 0.0, 1.0)))]).rgb;
}

fn colour(is_b: bool, position: vec2f) -> vec3f {
    if (comparison == DIFFERENCE) {
        let difference = channels(false, position) - channels(true, position);
        if (has_palette) {
            return palette_colour(0.5 + 0.5 * difference.x);
        }
        return encode(abs(difference));
    }
    let value = channels(is_b, position);
    if (!has_palette) {
        if (keeps_hue) {
            return encode(with_hue(value));
        }
        return encode(value);
    }
    if (is_linear) {
        return palette_colour(value.x);
    }
    return palette_colour(encode(value).x);
}

// Whether an edge between two samples passes through the pixel at a position.
fn on_grid(position: vec2f) -> bool {
    let size = vec2f(viewport.size_a);
    return any(floor(position * size) != floor((position - viewport.step) * size));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= viewport.size)) {
        return;
    }
    let half_width = viewport.size.x / 2u;
    let is_right = comparison == SIDES && id.x >= half_width;
    let pixel = vec2f(f32(select(id.x, id.x - half_width, is_right)), f32(id.y)) + 0.5;
    let position = viewport.origin + pixel * viewport.step;
    let is_b = is_right || (comparison == WIPE && f32(id.x) >= viewport.split) || (comparison == ONE && only_b);
    var shown = viewport.background.rgb;
    if (all(position >= vec2f(0.0)) && all(position < vec2f(1.0))) {
        shown = colour(is_b, position);
        if (has_grid && on_grid(position)) {
            shown = mix(shown, vec3f(0.5), 0.35);
        }
    }
    let is_seam = (comparison == SIDES && id.x == half_width)
        || (comparison == WIPE && abs(f32(id.x) + 0.5 - viewport.split) < 1.0);
    if (is_seam) {
        shown = vec3f(0.95);
    }
    textureStore(target_texture, vec2i(id.xy), vec4f(shown, 1.0));
}
